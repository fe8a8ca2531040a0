"""`thalweg encoder train | show | study`: encoders of what the camera sees."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from thalweg.cli.options import NO_FILE, River, UsageError, check_file
from thalweg.core.seeds import parse_seeds


@dataclass(frozen=True)
class EncoderTrain:
    """Collect frames from random poses and train an autoencoder on them; the same command resumes."""

    out: Path
    """Folder of the run."""
    inputs: Literal["rgb+mask", "rgb", "mask"] = "rgb+mask"
    """Channels that the encoder sees."""
    latent: int = 16
    """Size of a code."""
    architecture: str = "lean"
    """`lean`, or `paper` for the architecture of the paper, which trains far more slowly."""
    level: str = "Medium"
    """Level whose river the images show."""
    river: River = NO_FILE
    world_seeds: tuple[str, ...] = ()
    """Seeds of the rivers, such as 0 5 1000:1016, where 1016 is excluded; by default the fixed river of the level."""
    images: int = 2000
    """Number of training images."""
    held_out: int = 200
    """Number of further images, used for measurement only."""
    epochs: int = 100
    """Epochs of training."""
    seed: int = 0
    """Seed of the poses and of the training."""

    def run(self) -> int:
        from thalweg.encoder import VAEConfig
        from thalweg.train.encoder.training import collect_and_train

        reach = self.river.reach("--level", None if self.level == "Medium" else self.level)
        result = collect_and_train(
            self.out,
            VAEConfig(inputs=self.inputs, latent=self.latent, architecture=self.architecture),
            level=reach or self.level,
            world_seeds=parse_seeds(self.world_seeds, "--world-seeds", UsageError),
            images=self.images,
            held_out=self.held_out,
            epochs=self.epochs,
            seed=self.seed,
            command=shlex.join(["thalweg", *sys.argv[1:]]),
        )
        held_out = "" if result.held_out_mse is None else f", on held-out images {result.held_out_mse:.5f}"
        print(f"{result.path}: mean squared error {result.train_mse:.5f}{held_out}")
        return 0


@dataclass(frozen=True)
class EncoderShow:
    """Describe an encoder, and draw frames, masks and their reconstructions."""

    path: Path | None = None
    """Folder of `encoder train`, or encoder file; by default the one that comes with the package."""
    level: str = "Medium"
    """Level whose river the frames show."""
    count: int = 8
    """Number of frames."""
    seed: int = 1
    """Seed of the poses."""
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
        print(f"{self.out}: {self.count} frames and their reconstructions")
        return 0


@dataclass(frozen=True)
class EncoderStudy:
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

    def run(self) -> int:
        from thalweg.bench.studies.encoder_study import StudyConfig, run_study

        config = StudyConfig(self.level, self.images, self.held_out, self.epochs, self.seed, self.precision)
        page = run_study(self.out, config, command=shlex.join(["thalweg", *sys.argv[1:]]))
        print(f"{page.read_text(encoding='utf-8')}\n{page}: these tables, with their figures and CSV files beside it")
        return 0


@dataclass(frozen=True)
class Encoder:
    """Train, inspect or compare encoders."""


ENCODER_COMMANDS = {"train": EncoderTrain, "show": EncoderShow, "study": EncoderStudy}
"""The commands that follow `thalweg encoder`."""
