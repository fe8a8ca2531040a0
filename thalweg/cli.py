"""What can be typed? `thalweg world | render | encoder | train | evaluate | bench | report | leaderboard | speed`.

Each command is a dataclass: its fields are the options, their docstrings the help, `run` does it. What a command needs
is imported when it runs, so that `thalweg --help` answers at once.
"""

import signal
import sys
import traceback
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import OmitSubcommandPrefixes, Positional, arg, subcommand

from thalweg.options import POSE, REGISTRY, RiverFile, UsageError, check_file, settings_from
from thalweg.whole import whole, write_whole

River = Annotated[RiverFile, arg(name="")]
"""Its options stand among those of the command."""
NO_FILE = RiverFile()
PICTURES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True)
class DrawWorld:
    """Draw a river from above: centre line, widths, bridges and islands."""

    level: str | None = None
    """Easy, Medium or Hard; Medium if neither level nor file is given."""
    seed: int | None = None
    """Which river of the level; its fixed one if not given. Of a file: its plants and hills."""
    river: River = NO_FILE
    out: Path = Path("map.png")
    """The picture, a PNG; one that is there is replaced."""
    save: Path | None = None
    """Also write the world itself to this .npz file, which must be a new one."""
    overwrite: bool = False
    """Let --save replace a file that is there."""

    def run(self) -> int:
        from thalweg.world.drawing import draw

        check_file("--out", self.out, ".png")
        if self.save is not None:
            check_file("--save", self.save, ".npz")
            if self.save.exists() and not self.overwrite:
                raise UsageError(f"--save {self.save} is there already; name a new file, or replace it by --overwrite")
        world = _world(self.river, self.level, self.seed)
        draw(world, self.out)
        print(f"{self.out}: {world.name}, seed {world.seed}, a course of {world.river.length_m:.0f} m")
        if self.save is not None:
            world.save(self.save)
            print(f"{self.save}: the world")
        return 0


@dataclass(frozen=True)
class RenderFrames:
    """Draw what the camera sees: a sheet of frames, each above its water mask, or a gallery of looks."""

    level: str | None = None
    """Easy, Medium or Hard; Medium if neither level nor file is given."""
    seed: int | None = None
    """Which river of the level; its fixed one if not given. Of a file: its plants and hills."""
    river: River = NO_FILE
    pose: POSE | None = None
    """x y z yaw in metres and radians; random poses if not given."""
    poses: Literal["random", "pilot"] = "random"
    """Where the camera is when no pose is given: at random safe starts, or on the scripted pilot's flights from such
    starts, 50 steps each."""
    count: int = 8
    """How many poses."""
    poses_seed: int = 0
    """Which random poses."""
    size: int = 128
    """Height and width of a frame in pixels."""
    quality: Literal["full", "fast"] = "full"
    """fast: without reflections, filtered less, and marched once for four pixels."""
    frames: Path | None = None
    """Also write each frame by itself, as a PNG, into this folder."""
    gallery: bool = False
    """Draw one view at both ends of each range of domain randomisation instead."""
    out: Path = Path("frames.png")
    """The picture, .png, .jpg or .webp; one that is there is replaced."""

    def run(self) -> int:
        import numpy as np

        from thalweg.bench.sheet import sheet, write_frames
        from thalweg.env import sample_starts
        from thalweg.render import Camera, Renderer

        if self.count < 1:
            raise UsageError("--count must be at least 1")
        if self.gallery and (self.frames is not None or self.quality != "full"):
            raise UsageError("--gallery draws one view in the full quality: leave out --frames and --quality")
        if self.pose is not None and self.poses != "random":
            raise UsageError(f"give --pose or --poses {self.poses}, not both")
        check_file("--out", self.out, *PICTURES)
        world = _world(self.river, self.level, self.seed)
        if self.pose is not None and not world.covers(*self.pose[:2]):
            raise UsageError(f"--pose: x = {self.pose[0]:g}, y = {self.pose[1]:g} is outside the map of {world.name}")
        if self.pose is not None:
            chosen = np.array([self.pose])
        elif self.poses == "pilot":
            from thalweg.bench.flights import pilot_poses

            chosen = pilot_poses(world, self.count, self.poses_seed)
        else:
            chosen = sample_starts(world, self.count, self.poses_seed)
        camera = Camera(height_px=self.size, width_px=self.size)
        if self.gallery:
            from thalweg.bench.gallery import gallery

            with whole(self.out) as draft:
                gallery(world, chosen[0], camera).save(draft)
            print(f"{self.out}: the ranges of domain randomisation in {world.name}, seed {world.seed}")
            return 0
        frames = Renderer([world], camera, self.quality).render(chosen)
        if self.frames is not None:
            write_frames(self.frames, frames)
        with whole(self.out) as draft:
            sheet(frames).save(draft)
        for x, y, z, yaw in chosen:
            print(f"--pose {x:.3f} {y:.3f} {z:.3f} {yaw:.4f}")
        print(f"{self.out}: {len(frames)} frames of {world.name}, seed {world.seed}")
        return 0


@dataclass(frozen=True)
class EncoderTrain:
    """Collect images by random resets and train an autoencoder on them; the same command resumes."""

    out: Path
    """Folder of the run."""
    inputs: Literal["rgb+mask", "rgb", "mask"] = "rgb+mask"
    """What is encoded."""
    latent: int = 16
    """Numbers in a code."""
    architecture: str = "lean"
    """`lean`, or `paper` for the paper's own, which is far slower to train."""
    level: str = "Medium"
    """Where the images are collected."""
    images: int = 2000
    """Images to train on."""
    held_out: int = 200
    """Further images that are only measured."""
    epochs: int = 100
    """Passes over the images."""
    seed: int = 0
    """Of the poses and of the training."""

    def run(self) -> int:
        import shlex

        from thalweg.encoder import VAEConfig
        from thalweg.train.encoder import collect_and_train

        result = collect_and_train(
            self.out,
            VAEConfig(inputs=self.inputs, latent=self.latent, architecture=self.architecture),
            level=self.level,
            images=self.images,
            held_out=self.held_out,
            epochs=self.epochs,
            seed=self.seed,
            command=shlex.join(["thalweg", *sys.argv[1:]]),
        )
        aside = "" if result.held_out_mse is None else f", of images held out {result.held_out_mse:.5f}"
        print(f"{result.path}: mean squared error {result.train_mse:.5f}{aside}")
        return 0


@dataclass(frozen=True)
class EncoderShow:
    """Say what an encoder is, and draw frames, masks and their reconstructions."""

    path: Path | None = None
    """The encoder's file; the one that comes with the package if not given."""
    level: str = "Medium"
    """Where the frames come from."""
    count: int = 8
    """How many frames."""
    seed: int = 1
    """Which frames."""
    out: Path = Path("reconstructions.png")
    """The picture, a PNG; one that is there is replaced."""

    def run(self) -> int:
        from thalweg.encoder import draw_reconstructions, load_encoder
        from thalweg.train.collect import collect_frames

        check_file("--out", self.out, ".png")
        encoder = load_encoder(self.path)
        for key, value in encoder.about.items():
            print(f"{key}: {value}")
        draw_reconstructions(collect_frames(self.count, level=self.level, seed=self.seed), encoder, self.out)
        print(f"{self.out}: {self.count} frames and what their codes hold of them")
        return 0


@dataclass(frozen=True)
class EncoderStudy:
    """Compare encoders: sizes of codes, inputs, and what can be read from codes; the same command resumes."""

    out: Path
    """Folder of the study."""
    level: str = "Medium"
    """Where the images are collected."""
    images: int = 2000
    """Images to train on."""
    held_out: int = 500
    """Further images that are only measured."""
    epochs: int = 100
    """Passes over the images."""
    seed: int = 0
    """Of the poses and of the training."""

    def run(self) -> int:
        import shlex

        from thalweg.bench.encoder_study import Plan, run_study

        plan = Plan(self.level, self.images, self.held_out, self.epochs, self.seed)
        page = run_study(self.out, plan, command=shlex.join(["thalweg", *sys.argv[1:]]))
        print(f"{page.read_text(encoding='utf-8')}\n{page}: these tables, with their figures and CSV files beside it")
        return 0


@dataclass(frozen=True)
class Encoder:
    """Train an encoder, look at one, or compare many."""

    action: (
        Annotated[EncoderTrain, subcommand("train", prefix_name=False)]
        | Annotated[EncoderShow, subcommand("show", prefix_name=False)]
        | Annotated[EncoderStudy, subcommand("study", prefix_name=False)]
    )

    def run(self) -> int:
        return self.action.run()


@dataclass(frozen=True)
class Train:
    """Train a policy on a river, seen through an encoder; the same command resumes."""

    out: Path
    """Folder of the run."""
    algorithm: str = "FOCOPS"
    """As in the registry; an unknown name lists the known ones."""
    level: str | None = None
    """Easy, Medium or Hard; Medium if neither level nor file is given."""
    world_seeds: tuple[int, ...] = ()
    """Rivers of the level to train on; its fixed one if none is given. Of a file: its plants and hills."""
    river: River = NO_FILE
    steps: int = 200_000
    """Over all environments together."""
    seed: int = 0
    """Of everything random in the training."""
    num_envs: int = 16
    """Environments that are stepped together."""
    encoder: Path | None = None
    """The encoder's file; the one that comes with the package if not given."""
    preset: str = "default"
    """`default`, or `paper`: what the study ran, as far as it is known, quirks included."""
    set: tuple[str, ...] = ()
    """Settings of the algorithm on top of the preset, such as learning_rate=1e-4; an unknown one lists the known."""
    threads: int | None = None
    """Of acting and learning; if not given, two for wide networks and one for small ones, but no more than
    OMP_NUM_THREADS. Give 1 to each of several runs that share the cores."""
    begin_with: Path | None = None
    """A run's folder or a policy file: begin as that policy, such as PPO's, or one of an easier river."""
    device: str = "cpu"
    """Where it trains: cpu, cuda, cuda:1, or auto, which takes a GPU where there is one that works."""
    graphs: bool = False
    """Record gradient steps of DDPGLag, TD3Lag and SACLag, and replay them: a GPU is asked for many operations at
    once."""

    def run(self) -> int:
        import shlex

        from thalweg.algos.registry import algorithm_named
        from thalweg.train.river import TrainingGround, load_fitting_encoder

        settings = settings_from(self.set)
        algorithm = algorithm_named(self.algorithm).name
        place = self.river.reach("--level", self.level) or self.level or "Medium"
        ground = TrainingGround(place, self.num_envs, self.world_seeds)
        result = ground.train(
            algorithm,
            load_fitting_encoder(self.encoder, self.device),
            steps=self.steps,
            seed=self.seed,
            folder=self.out,
            settings=settings or None,
            preset=self.preset,
            threads=self.threads,
            device=self.device,
            begin_with=self.begin_with,
            graphs=self.graphs,
        )
        if result.already_finished:
            print(f"{self.out} was finished before; nothing was trained.")
        elif result.resumed_from is not None:
            print(f"{self.out} went on from step {result.resumed_from:,}.")
        print(
            f"{result.folder}: {result.algorithm}, {result.steps:,} steps, {result.episodes:,} episodes in"
            f" {result.seconds:.0f} s; last 50: return {result.return_mean:.2f}, cost {result.cost_mean:.2f}"
        )
        if result.already_finished or result.resumed_from is not None:  # else they have been shown
            for line in result.warnings:
                print(f"Warning: {line}")
        encoder = ["--encoder", str(self.encoder)] if self.encoder else []
        print(f"Evaluate it: {shlex.join(['thalweg', 'evaluate', str(self.out), *self.river.words(), *encoder])}")
        return 0


@dataclass(frozen=True)
class Evaluate:
    """Fly a policy from the fixed list of starts of each level and sum up."""

    policy: Positional[str]
    """A run's folder, a policy file, `packaged`, or a baseline: random, hover, forward, pilot."""
    levels: tuple[str, ...] = ()
    """Where to fly; on Easy, Medium and Hard if neither levels nor a file are given."""
    river: River = NO_FILE
    world_seed: int | None = None
    """Of a file's river: its plants and hills."""
    episodes: int = 20
    """Starts per level, each flown once."""
    starts_seed: int = 0
    """Chooses the list of starts."""
    seed: int = 0
    """Of the sampled actions."""
    deterministic: bool = False
    """Take the most probable action instead of a sampled one."""
    unseen: bool = False
    """Fly on other rivers of the levels than the fixed ones, on which nothing is trained: one start on each of so many
    rivers as there are episodes."""
    encoder: Path | None = None
    """The encoder's file; the one that comes with the package if not given."""
    out: Path | None = None
    """Also write one row per episode to this CSV file; one that is there is replaced."""
    device: str = "cpu"
    """Where frames are drawn and encoded: cpu, cuda, cuda:1, or auto, which takes a GPU where there is one that
    works."""

    def run(self) -> int:
        from thalweg.bench.command import Request, evaluate_command
        from thalweg.bench.evaluation import EvaluationConfig

        reach = self.river.reach("--levels", self.levels)
        if reach is not None and self.unseen:
            raise UsageError("--unseen goes with levels: there is but one river in a file")
        if reach is None and self.world_seed is not None:
            raise UsageError("--world-seed goes with --geojson; the levels are flown on their fixed rivers")
        places = (reach,) if reach is not None else self.levels or ("Easy", "Medium", "Hard")
        config = EvaluationConfig(self.episodes, self.starts_seed, self.deterministic)
        evaluate_command(
            Request(
                self.policy,
                places,
                config,
                self.seed,
                self.world_seed or 0,
                self.encoder,
                self.out,
                self.device,
                self.unseen,
            )
        )
        return 0


@dataclass(frozen=True)
class Bench:
    """Train, evaluate and report a whole suite; the same command resumes."""

    suite: Positional[str]
    """`quick`, `easy`, `open`, `protocols` or `paper`."""
    out: Path
    """Folder of the results."""
    jobs: int | None = None
    """Runs at a time, each in a process of its own that has its share of the cores; as many as cores if not given. 1:
    one after the other, with progress bars. On a cluster: at most so many."""
    cluster: str | None = None
    """A cluster of Ray's that does the runs: auto, the one that this machine is a node of, or HOST:PORT of its head."""
    cpus: int | None = None
    """Processors that each run takes on a cluster, and threads that it computes in; one if not given."""
    only: tuple[str, ...] = ()
    """Names of algorithms (FOCOPS), arms (FOCOPS-paper) or runs (FOCOPS-0) that are to be done now; all if none is
    given."""

    def run(self) -> int:
        from thalweg.bench.command import bench_command, hands_for

        return bench_command(self.suite, self.out, self.only, hands_for(self.jobs, self.cluster, self.cpus))


@dataclass(frozen=True)
class Report:
    """Make the report of a results folder again, from its files alone."""

    results: Positional[Path]
    """The folder that `thalweg bench` wrote."""
    out: Path | None = None
    """Where to put it, a new folder or that of an earlier report; `report` within the results if not given."""

    def run(self) -> int:
        from thalweg.bench.report import write_report

        report = write_report(self.results, self.out)
        print(f"Report: {report.page}\nTable:  {report.table}")
        for line in report.problems:
            print(f"Note:   {line}")
        return 0


@dataclass(frozen=True)
class Leaderboard:
    """Rank the trained policies of results folders: who meets the limit, then who returns most."""

    results: Positional[tuple[Path, ...]]
    """Folders that `thalweg bench` wrote."""
    out: Path | None = None
    """The page, a .md file, instead of printing it; one that is there is replaced."""

    def run(self) -> int:
        from thalweg.bench.leaderboard import leaderboard

        if self.out is not None:
            check_file("--out", self.out, ".md")
        page = leaderboard(self.results)
        if self.out is None:
            print(page)
        else:
            write_whole(self.out, page)
            print(f"{self.out}: the leaderboard")
        return 0


@dataclass(frozen=True)
class Speed:
    """Measure the speed of each part on this machine."""

    json: bool = False
    """Print JSON instead of a table."""
    quick: bool = False
    """Fewer repetitions, and no training."""
    stages: bool = False
    """Where the time of a frame goes, instead: milliseconds of each stage on one thread."""
    out: Path | None = None
    """Also write the JSON to this file; one that is there is replaced."""

    def run(self) -> int:
        from thalweg.bench.speed import speed

        return speed(as_json=self.json, quick=self.quick, out=self.out, stages=self.stages)


DESCRIPTION = (
    "A photo-realistic river world and a benchmark of safe reinforcement learning on it."
    " Further options: --version; --debug shows the traceback of an error."
)

COMMANDS = {
    "world": DrawWorld,
    "render": RenderFrames,
    "encoder": Encoder,
    "train": Train,
    "evaluate": Evaluate,
    "bench": Bench,
    "report": Report,
    "leaderboard": Leaderboard,
    "speed": Speed,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; returns the exit status: 2 for an error that the user can mend."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    given = [argument for argument in given if argument != "--debug"]
    if given == ["--version"]:
        print(f"thalweg {version('thalweg')}")
        return 0
    command = None
    try:
        command = _parse(given)
        _check_seeds(command)
        if arguments is None:
            warnings.showwarning = _show_warning
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # to be told to end is to be interrupted
        return command.run()
    except KeyboardInterrupt:
        print(f"\nInterrupted. {_after_interrupt(command)}", file=sys.stderr)
        return 130
    except Exception as error:
        if debug or not _ours(error):
            traceback.print_exc()
            return 2 if _ours(error) else 1
        print(f"thalweg: {error}", file=sys.stderr)
        return 2


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """A warning as a line, without the place in the code that it came from."""
    print(f"Warning: {message}", file=sys.stderr)


def _parse(arguments: list[str]) -> Any:
    kinds: Any = None
    for name, kind in COMMANDS.items():
        one = Annotated[kind, subcommand(name, prefix_name=False)]
        kinds = one if kinds is None else kinds | one
    return tyro.cli(
        OmitSubcommandPrefixes[kinds], prog="thalweg", description=DESCRIPTION, args=arguments, registry=REGISTRY
    )


def _after_interrupt(command: Any) -> str:
    """What becomes of a command that was interrupted."""
    if isinstance(command, Train | Bench | Encoder):
        return "The same command goes on from the last checkpoint."
    return "Nothing is kept; the same command begins anew."


def _ours(error: Exception) -> bool:
    """Whether an error says what is wrong with what it was given: our own, or the system's of a file."""
    known = isinstance(error, UsageError) or (isinstance(error, OSError) and error.filename is not None)
    return known or type(error).__module__.split(".")[0] == "thalweg"


def _world(river: RiverFile, level: str | None, seed: int | None) -> Any:
    """The world of the file, or that of the level and seed."""
    from thalweg.world import level_named, load_or_build

    if (reach := river.reach("--level", level)) is not None:
        return reach.build(seed or 0)
    chosen = level_named(level or "Medium")
    return load_or_build(chosen, chosen.default_seed if seed is None else seed)


def _check_seeds(command: Any) -> None:
    """Raise `UsageError` for a seed below zero, before anything is done."""
    for field in fields(command):
        value = getattr(command, field.name)
        if is_dataclass(value):
            _check_seeds(value)
        elif field.name.endswith(("seed", "seeds")):
            for seed in value if isinstance(value, tuple) else (value,):
                if seed is not None and seed < 0:
                    raise UsageError(f"--{field.name.replace('_', '-')} must be 0 or more, not {seed}")


if __name__ == "__main__":
    sys.exit(main())
