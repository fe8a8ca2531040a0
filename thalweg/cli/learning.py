"""Commands that learn: encoders of what the camera sees, and policies."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import subcommand

from thalweg.cli.options import NO_FILE, River, check_file, settings_from


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
        from thalweg.train.encoder.training import collect_and_train

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
        from thalweg.train.encoder.frames import collect_frames

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
    precision: str = "auto"
    """float32, bfloat16, or auto: what is faster on this machine; all encoders of a study are trained alike."""

    def run(self) -> int:
        import shlex

        from thalweg.bench.studies.encoder_study import Plan, run_study

        plan = Plan(self.level, self.images, self.held_out, self.epochs, self.seed, self.precision)
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
        from thalweg.train.river import RiverTraining, load_compatible_encoder

        settings = settings_from(self.set)
        algorithm = algorithm_named(self.algorithm).name
        place = self.river.reach("--level", self.level) or self.level or "Medium"
        ground = RiverTraining(place, self.num_envs, self.world_seeds)
        result = ground.train(
            algorithm,
            load_compatible_encoder(self.encoder, self.device),
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
