"""Training of an autoencoder on a set of frames; a run that is interrupted at any epoch resumes with the same numbers.

All that is random in an epoch comes from a generator seeded by (seed, epoch), so that an epoch needs nothing from the
one before but the weights and Adam's moments, and those lie in `checkpoint.safetensors`. `metrics.csv` is written from
the checkpoint's own rows, so the two never disagree. Collecting frames is not done here.
"""

import csv
import hashlib
import io
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from thalweg.core.atomic_io import write_atomic
from thalweg.core.run_folder import FolderKind
from thalweg.encoder.files import FORMAT, EncoderFileError, read_tensors, save_vae, write_tensors
from thalweg.encoder.reconstruction import check_images, mean_image_mse, reconstruction_mse, to_batch
from thalweg.encoder.vae import VAE, EncoderInputError, VAEConfig, vae_loss

COLUMNS = ("epoch", "loss", "mse", "kl", "held_out_mse", "images_per_s")
"""Columns of `metrics.csv`: means over the steps of the epoch, with noise in the code and the batch's own norms;
`held_out_mse` is as the encoder is used, on the images held out, and empty when there are none."""


ENCODER_FOLDER = FolderKind("encoder training", "checkpoint.safetensors", EncoderFileError)

Row = dict[str, float | None]


@dataclass(frozen=True)
class Source:
    """Where the images come from; written into the encoder's file and used for nothing else."""

    level: str = ""
    """Level of the world whose frames they are."""
    seed: int | None = None
    """Seed of the poses."""
    render_version: int | None = None
    """Version of the renderer that drew them."""
    command: str = ""
    """What a person types to do it all again."""


@dataclass(frozen=True)
class TrainingResult:
    """What a finished training left."""

    path: Path
    """The encoder's file."""
    train_mse: float
    """Mean squared error on the images trained on (the paper's way), as in `thalweg.encoder.reconstruction`."""
    held_out_mse: float | None
    """The same on the images held out; None when there were none."""
    mean_image_mse: float
    """The error of always answering with the mean image of the training set: what any reconstruction must beat."""
    rows: list[Row]
    """One row per epoch, as in `metrics.csv`."""


def train_encoder(
    images: np.ndarray,
    config: VAEConfig,
    folder: str | Path,
    *,
    epochs: int = 100,
    batch: int = 128,
    seed: int = 0,
    held_out: int = 0,
    precision: str = "auto",
    device: str = "cpu",
    source: Source = Source(),
    progress: bool = True,
) -> TrainingResult:
    """Train on images uint8 [K, H, W, 4] and write `folder/encoder.safetensors`; resumes what was interrupted.

    `held_out` images, drawn by `seed`, are only measured. `precision` is "float32", "bfloat16" or "auto": bfloat16
    where the machine has instructions for it. Raises `EncoderInputError` for images or settings that don't fit, and
    `EncoderFileError` when the folder holds another run or a damaged checkpoint.
    """
    check_images(images, config, held_out)
    if epochs < 1 or batch < 2:
        raise EncoderInputError(f"epochs must be at least 1 and batch at least 2, not {epochs} and {batch}")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    run = {
        "config": asdict(config),
        "epochs": epochs,
        "batch": batch,
        "seed": seed,
        "held_out": held_out,
        "images": len(images),
        "images_hash": hashlib.sha256(np.ascontiguousarray(images).data).hexdigest()[:16],
        "precision": resolve_precision(precision, device),
    }
    kept, aside = (images[part] for part in split(len(images), held_out, seed))
    state = _State(config, run, device)
    rows = state.resume(folder / "checkpoint.safetensors")
    with _bar(progress) as bar:
        task = bar.add_task("training the encoder", total=epochs, completed=len(rows), note="")
        for epoch in range(len(rows), epochs):
            started = time.perf_counter()
            row = {"epoch": epoch + 1, **state.epoch(kept, epoch)}
            speed = len(kept) / (time.perf_counter() - started)
            row["held_out_mse"] = reconstruction_mse(state.vae, aside) if held_out else None
            rows.append({**row, "images_per_s": round(speed, 1)})
            state.save(folder / "checkpoint.safetensors", rows)
            _write_rows(folder / "metrics.csv", rows)
            bar.update(task, advance=1, note=f"{speed:.0f} images/s, mse {row['mse']:.5f}, kl {row['kl']:.2f}")
    return _finish(folder / "encoder.safetensors", state, kept, aside, rows, source)


def split(count: int, held_out: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of the images that are trained on, and of those held out, both in order; drawn by `seed`."""
    order = np.random.default_rng([seed, 0]).permutation(count)
    return np.sort(order[held_out:]), np.sort(order[:held_out])


def resolve_precision(precision: str, device: str = "cpu") -> str:
    """ "float32" or "bfloat16"; "auto" becomes what is faster on the device."""
    if precision not in ("auto", "float32", "bfloat16"):
        raise EncoderInputError(f"unknown precision {precision!r}; known: auto, float32, bfloat16")
    if precision != "auto":
        return precision
    if torch.device(device).type == "cuda":
        return "bfloat16" if torch.cuda.is_bf16_supported() else "float32"
    found = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return "bfloat16" if found.get("avx512_bf16") or found.get("amx_bf16") else "float32"


def epoch_generator(seed: int, epoch: int) -> torch.Generator:
    """All that is random in an epoch: the order of the images, and the noise in the codes."""
    return torch.Generator().manual_seed(int(np.random.SeedSequence([seed, 1, epoch]).generate_state(1)[0]))


class _State:
    """The model and its optimiser, and how they go to disk and come back."""

    def __init__(self, config: VAEConfig, run: Mapping[str, Any], device: str):
        self.run = dict(run)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(run["seed"])
            self.vae = VAE(config).to(device)
        self.optimizer = torch.optim.Adam(self.vae.parameters(), config.learning_rate, fused=True)

    def epoch(self, images: np.ndarray, epoch: int) -> dict[str, float]:
        """One pass over images uint8 [K, H, W, 4] in batches of nearly equal size; the means of loss, MSE and KL."""
        vae, config, device = self.vae.train(), self.vae.config, next(self.vae.parameters()).device
        draw = epoch_generator(self.run["seed"], epoch)
        order = torch.randperm(len(images), generator=draw).numpy()
        sums = np.zeros(3)
        for chosen in np.array_split(order, math.ceil(len(order) / self.run["batch"])):
            batch = to_batch(images[chosen], config, device)
            noise = torch.randn((len(chosen), config.latent), generator=draw).to(device)
            with torch.autocast(device.type, torch.bfloat16, enabled=self.run["precision"] == "bfloat16"):
                reconstruction, mean, log_variance = vae(batch, noise)
            losses = vae_loss(batch, reconstruction, mean, log_variance, config.kl_weight)
            self.optimizer.zero_grad(set_to_none=True)
            losses[0].backward()
            self.optimizer.step()
            sums += np.array([value.item() for value in losses]) * len(chosen)
        return dict(zip(("loss", "mse", "kl"), (sums / len(images)).tolist(), strict=True))

    def save(self, path: Path, rows: list[Row]) -> None:
        """Everything the next epoch needs, and the rows so far, as one file."""
        tensors = {f"vae.{name}": tensor for name, tensor in self.vae.state_dict().items()}
        for index, moments in self.optimizer.state_dict()["state"].items():
            tensors |= {f"adam.{index}.{name}": tensor for name, tensor in moments.items()}
        write_tensors(path, tensors, {"kind": "encoder training", "format": FORMAT, "run": self.run, "rows": rows})

    def resume(self, path: Path) -> list[Row]:
        """The rows of the epochs that are done, with the model and optimiser as they were then; none without a file."""
        if not path.exists():
            return []
        tensors, about = read_tensors(path, "encoder training")
        recorded = {name: value for name, value in about.get("run", {}).items() if name in self.run}
        ENCODER_FOLDER.require_same(path.parent, recorded, self.run)
        state = {**self.optimizer.state_dict(), "state": {}}
        for name, tensor in tensors.items():
            if name.startswith("adam."):
                _, index, moment = name.split(".")
                state["state"].setdefault(int(index), {})[moment] = tensor
        try:
            self.vae.load_state_dict({name[4:]: value for name, value in tensors.items() if name.startswith("vae.")})
            self.optimizer.load_state_dict(state)
            self._lay_out_moments()
        except (RuntimeError, ValueError) as error:
            raise EncoderFileError(f"{path}: the tensors don't fit the model: {error}") from error
        return about["rows"]

    def _lay_out_moments(self) -> None:
        """Give Adam's moments the memory layout of their weights: the fused step walks both in the order of memory."""
        for weight, moments in self.optimizer.state.items():
            for name in ("exp_avg", "exp_avg_sq"):
                moments[name] = torch.empty_like(weight).copy_(moments[name])


def _write_rows(path: Path, rows: list[Row]) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([row[name] for name in COLUMNS] for row in rows)
    write_atomic(path, text.getvalue())


def _bar(shown: bool) -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, TextColumn("{task.fields[note]}"), disable=not shown)


def _finish(
    path: Path, state: _State, kept: np.ndarray, aside: np.ndarray, rows: list[Row], source: Source
) -> TrainingResult:
    """Measure the errors on images uint8 [K, H, W, 4] trained on and held out, and write the encoder's file."""
    errors = {
        "train_mse": reconstruction_mse(state.vae, kept),
        "held_out_mse": reconstruction_mse(state.vae, aside) if len(aside) else None,
        "mean_image_mse": mean_image_mse(kept, state.vae.config),
    }
    made_of = {"level": source.level, "image_seed": source.seed, "render_version": source.render_version}
    versions = {"thalweg": version("thalweg"), "torch": torch.__version__}
    save_vae(path, state.vae, {**state.run, **errors, **made_of, **versions, "command": source.command})
    return TrainingResult(path=path, rows=rows, **errors)
