"""`thalweg encoder train | show | study`: encoders of what the camera sees."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from thalweg.cli.command import COMMAND_LINE, NO_CHECKPOINT, Command
from thalweg.cli.encoder_defaults import by_target
from thalweg.cli.options import DEFAULT_LEVEL, NO_FILE, Plugins, River, UsageError, check_file
from thalweg.cli.run_result import tell_finished
from thalweg.cli.views import camera_from
from thalweg.core.run_folder import CHECKPOINT
from thalweg.core.seeds import parse_seeds


@dataclass(frozen=True)
class EncoderTrain(Command):
    """Train an autoencoder, an encoder of geometry, or a finder of water on frames; the same command resumes."""

    out: Path
    """Folder of the run."""
    target: Literal["image", "geometry", "water"] = "image"
    """What is learnt: the image (an autoencoder), what an ideal eye sees of it, or where water is, for `follow`."""
    inputs: Literal["rgb+mask", "rgb", "mask"] = "rgb+mask"
    """Channels that the encoder sees."""
    latent: Annotated[int | None, by_target("latent")] = None
    """Size of a code."""
    architecture: str = "lean"
    """`lean`, or `paper` for the architecture of the paper, which trains far more slowly."""
    level: Annotated[tuple[str, ...], by_target("level")] = ()
    """Level whose river the images show; for geometry and water several."""
    river: River = NO_FILE
    world_seeds: Annotated[tuple[str, ...], by_target("world_seeds")] = ()
    """Seeds of rivers, such as 0 5 1000:1016; for image the fixed one. With --river geometry and water: 1000:1006."""
    held_out_seeds: Annotated[tuple[str, ...], by_target("held_out_seeds")] = ()
    """For geometry and water: seeds of rivers, with --river 3000:3002 by default, for measurement only."""
    images: Annotated[int | None, by_target("images")] = None
    """Training images; for geometry and water those of an epoch."""
    held_out: Annotated[int | None, by_target("held_out")] = None
    """Further images, for measurement only; for geometry so many of flights and of starts, in each task."""
    epochs: Annotated[int | None, by_target("epochs")] = None
    """Epochs of training."""
    views: Annotated[int | None, by_target("views")] = None
    """For geometry only: stored views of each river and task, of flights."""
    tasks: Annotated[tuple[str, ...], by_target("tasks")] = ()
    """For geometry only: tasks whose views are learnt from; what a camera can tell of each is predicted too."""
    rivers_in_memory: int | None = None
    """For geometry only: greatest number of rivers of levels in memory; derived from the free memory by default."""
    camera: tuple[str, ...] = ()
    """Settings of the camera, such as fov_deg=75 pitch_deg=10, and before them the YAML file of a calibration."""
    quality: Annotated[Literal["full", "fast"] | None, by_target("quality")] = None
    """Quality of the frames; `fast` reflects only the sky, filters less, and interpolates the ground."""
    randomise: bool = False
    """For image only: vary light, water, plants, camera angles, noise and clouds; the other targets always do."""
    device: Annotated[str | None, by_target("device")] = None
    """For geometry only: where to draw frames and learn: cpu, cuda, cuda:1, or auto."""
    seed: int = 0
    """Seed of the poses and of the training."""

    resumes = True

    def after_interrupt(self) -> str:
        return super().after_interrupt() if (self.out / CHECKPOINT).exists() else NO_CHECKPOINT

    def run(self) -> int:
        if self.target == "water":
            return self._learn_water()
        return self._learn_geometry() if self.target == "geometry" else self._learn_images()

    def _given(self, *names: str) -> dict[str, Any]:
        """Return the options of these names that were given."""
        return {name: value for name in names if (value := getattr(self, name)) not in (None, ())}

    def _camera(self) -> Any:
        """Return the camera of the frames; raises the errors of `camera_from`."""
        from thalweg.env.config import DEFAULT_CONFIG

        return camera_from(self.camera) if self.camera else DEFAULT_CONFIG.camera

    def _refuse_options_of_image(self) -> None:
        """Raise `UsageError` for --randomise, since looks vary in any case, and for --banks, which levels name."""
        if self.randomise:
            raise UsageError(f"--target {self.target} is learnt under varied looks in any case: leave --randomise out")
        if self.river.banks and self.river.river is None:
            raise UsageError(
                "--banks is for --target image: give levels with their banks, such as --level Medium+meadow"
            )

    def _grounds(self) -> dict[str, Any]:
        """Return the rivers of a training that is judged on others: levels or a real river, and the seeds of both."""
        from thalweg.train.encoder.grounds import REACH_SEEDS

        reach = self.river.reach("--level", self.level)
        ground = {"levels": self.level} if self.level else {}
        seeds = {
            name: parse_seeds(given, f"--{name.replace('_', '-')}", UsageError)
            for name, given in self._given("world_seeds", "held_out_seeds").items()
        }
        return ground | seeds if reach is None else {"river": reach, **REACH_SEEDS, **seeds}

    def _judged_on(self) -> str:
        """Return on what codes or networks are judged, in words."""
        return "rivers held out" if self.river.river is None else "the same course under other plants and hills"

    def _learn_images(self) -> int:
        """Train an autoencoder."""
        from thalweg.encoder import VAEConfig
        from thalweg.train.encoder.drawing import Drawing, size_of
        from thalweg.train.encoder.training import collect_and_train

        if others := self._given("held_out_seeds", "views", "tasks", "rivers_in_memory", "device"):
            option = f"--{next(iter(others)).replace('_', '-')}"
            targets = "geometry or water" if "held_out_seeds" in others else "geometry"
            raise UsageError(f"{option} is for --target {targets}: leave it out, or choose that target")
        if len(self.level) > 1:
            raise UsageError(f"--level takes one level for --target image, not {' '.join(self.level)}")
        reach = self.river.reach("--level", self.level, levels_have_banks=True)
        named = self.level or ((DEFAULT_LEVEL["uav"],) if self.river.banks else ())
        ground = reach or next(map(self.river.on_banks, named), None)
        drawing = Drawing(self._camera(), randomise=self.randomise, **self._given("quality"))
        size_px = size_of(drawing.camera)
        result = collect_and_train(
            self.out,
            VAEConfig(inputs=self.inputs, architecture=self.architecture, size_px=size_px, **self._given("latent")),
            world_seeds=parse_seeds(self.world_seeds, "--world-seeds", UsageError),
            seed=self.seed,
            drawing=drawing,
            command=COMMAND_LINE.get(),
            **({"level": ground} if ground else {}),
            **self._given("images", "held_out", "epochs"),
        )
        if result.already_finished:
            tell_finished(self.out)
        held_out = "" if result.held_out_mse is None else f", on held-out images {result.held_out_mse:.5f}"
        print(f"{result.path}: mean squared error {result.train_mse:.5f}{held_out}")
        return 0

    def _learn_water(self) -> int:
        """Train a finder of water; raises `UsageError` for options that it does not take."""
        from thalweg.train.encoder.water import WaterTraining

        self._refuse_options_of_image()
        changed = [name for name in ("inputs", "architecture") if getattr(self, name) != getattr(type(self), name)]
        if others := [*self._given("latent", "views", "tasks", "rivers_in_memory", "device"), *changed]:
            option = f"--{others[0].replace('_', '-')}"
            raise UsageError(f"{option} does not go with --target water, which learns from colours of rivers")
        result = WaterTraining(
            self.out,
            seed=self.seed,
            camera=self._camera(),
            command=COMMAND_LINE.get(),
            **self._grounds(),
            **self._given("images", "held_out", "epochs", "quality"),
        ).run()
        if result.already_finished:
            tell_finished(self.out)
        print(f"{result.path}: IoU of water {result.iou:.3f} on {self._judged_on()}, under all looks")
        return 0

    def _learn_geometry(self) -> int:
        """Train an encoder of geometry."""
        from thalweg.train.encoder.drawing import size_of
        from thalweg.train.encoder.geometry import GeometryTraining, geometry_config

        self._refuse_options_of_image()
        camera = self._camera()
        settings = {"inputs": self.inputs, "architecture": self.architecture, "size_px": size_of(camera)}
        result = GeometryTraining(
            self.out,
            geometry_config(**self._given("tasks", "latent"), **settings),
            seed=self.seed,
            camera=camera,
            command=COMMAND_LINE.get(),
            **self._grounds(),
            **self._given("images", "held_out", "epochs", "views", "tasks", "rivers_in_memory", "device", "quality"),
        ).run()
        if result.already_finished:
            tell_finished(self.out)
        judged = f"judged on {self._judged_on()}, under all looks"
        print(f"{result.path}, {judged}, by R² of a linear regression on the code:")
        print("\n".join(result.lines))
        return 0


@dataclass(frozen=True)
class EncoderShow(Command):
    """Describe an encoder, and draw frames, masks and their reconstructions if it has any."""

    path: Path | None = None
    """Folder of `encoder train`, encoder file, `geometry`, or a plug-in's name; by default the packaged autoencoder."""
    level: str = "Medium"
    """Level whose river the frames show."""
    count: int = 8
    """Number of frames."""
    seed: int = 1
    """Seed of the poses."""
    out: Path = Path("reconstructions.png")
    """The picture, a PNG; one that is there is replaced."""
    plugin: Plugins = ()

    def run(self) -> int:
        from thalweg.encoder import VAE, draw_reconstructions, load_encoder
        from thalweg.encoder.plugin import PluginEncoder, encoder_plugin
        from thalweg.train.encoder.frames import collect_frames
        from thalweg.train.encoder_of_run import camera_of_encoder

        check_file("--out", self.out, ".png")
        plugin = None if self.path is None else encoder_plugin(str(self.path))
        encoder = load_encoder(self.path) if plugin is None else PluginEncoder(plugin)
        for key, value in encoder.about.items():
            print(f"{key}: {value}")
        if not isinstance(encoder.model, VAE):
            return 0
        frames = collect_frames(self.count, level=self.level, seed=self.seed, camera=camera_of_encoder(encoder))
        draw_reconstructions(frames, encoder, self.out)
        print(f"{self.out}: {self.count} frames and their reconstructions")
        return 0


@dataclass(frozen=True)
class EncoderStudy(Command):
    """Compare encoders of several code sizes and inputs, and probe their codes linearly; the same command resumes."""

    out: Path
    """Folder of the study."""
    level: str = "Medium"
    """Level whose river the images show."""
    images: int = 2000
    """Number of training images."""
    held_out: int = 500
    """Number of further images, used for measurement only."""
    epochs: int = 100
    """Epochs of training."""
    seed: int = 0
    """Seed of the poses and of the training."""
    precision: str = "auto"
    """float32, bfloat16, or auto for the faster of the two on this machine; the same for all encoders of a study."""

    resumes = True

    def run(self) -> int:
        from thalweg.bench.studies.encoder_study import StudyConfig, run_study

        config = StudyConfig(self.level, self.images, self.held_out, self.epochs, self.seed, self.precision)
        page = run_study(self.out, config, command=COMMAND_LINE.get())
        print(f"{page.read_text(encoding='utf-8')}\n{page}: these tables, with their figures and CSV files beside it")
        return 0


@dataclass(frozen=True)
class Encoder(Command):
    """Train, inspect or compare encoders."""


ENCODER_COMMANDS = {"train": EncoderTrain, "show": EncoderShow, "study": EncoderStudy}
"""The commands that follow `thalweg encoder`."""
