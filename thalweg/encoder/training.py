"""Training of an autoencoder on a set of frames; a run that is interrupted at any epoch resumes with the same numbers.

Each epoch uses a random generator seeded by (seed, epoch), so that it depends on the previous epochs only through the
weights and Adam's moments, which the checkpoint holds. `metrics.csv` is written from the checkpoint's own rows, so the
two never disagree. Collecting frames is not done here.
"""

import csv
import hashlib
import io
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.compute.heap import keep_freed_memory
from thalweg.core.compute.torch_threads import default_torch_threads, torch_threads
from thalweg.core.config import to_plain
from thalweg.core.machine import package_version
from thalweg.core.notices import notice
from thalweg.core.run_folder import CHECKPOINT, DEVICE, FolderKind
from thalweg.encoder.checkpoint import ANEW, Row, read_checkpoint, resume_state, save_state, state_tensors
from thalweg.encoder.files import FILE, EncoderFileError, load_model, save_vae
from thalweg.encoder.reconstruction import check_images, mean_image_mse, reconstruction_mse, to_batch
from thalweg.encoder.vae import VAE, EncoderInputError, VAEConfig, vae_loss

COLUMNS = ("epoch", "loss", "mse", "kl", "held_out_mse", "images_per_s")
"""Columns of `metrics.csv`: means over the steps of the epoch, with noise in the code and the batch's own norms;
`held_out_mse` is as the encoder is used, on the images held out, and empty when there are none."""


METRICS = "metrics.csv"
"""Name of the table of all epochs."""
PREFIX = "vae."
"""Prefix of the names of the model's tensors in a checkpoint."""
ENCODER_FOLDER = FolderKind("encoder training", CHECKPOINT, EncoderFileError)


@dataclass(frozen=True)
class Source:
    """Origin of the images, which is written into the encoder's file and not used otherwise."""

    level: str = ""
    """Level of the world whose frames they are."""
    seed: int | None = None
    """Seed of the poses."""
    render_version: int | None = None
    """Version of the renderer that drew them."""
    command: str = ""
    """Command that reproduces the training."""
    world_seeds: tuple[int | str, ...] = ()
    """Seeds of the level's rivers, as numbers and ranges; empty for its fixed one."""


@dataclass(frozen=True)
class TrainingResult:
    """File, errors and metrics of a finished training."""

    path: Path
    """The encoder's file."""
    train_mse: float
    """Mean squared error on the images trained on (the paper's way), as in `thalweg.encoder.reconstruction`."""
    held_out_mse: float | None
    """The same on the images held out; None when there were none."""
    mean_image_mse: float
    """Error of always predicting the mean image of the training set, which a useful encoder stays below."""
    rows: list[Row]
    """One row per epoch, as in `metrics.csv`."""
    already_finished: bool = False
    """Whether the training was finished before, so that nothing was trained."""


def train_encoder(
    images: np.ndarray | Callable[[], np.ndarray],
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
    identity: Mapping[str, Any] | None = None,
    progress: bool = True,
) -> TrainingResult:
    """Train on images uint8 [K, H, W, 4] and write `folder/encoder.safetensors`; resumes what was interrupted.

    `images` may be a function that returns them, which is called once the folder is held by this process, if drawing
    them takes long. `held_out` images, drawn by `seed`, are only measured. `precision` is "float32", "bfloat16" or
    "auto": bfloat16 where the machine has instructions for it. `identity` describes the images: a folder of others is
    refused, as is one begun on another kind of `device`. Raises `EncoderInputError` for images or settings that don't
    fit, and `EncoderFileError` when the folder holds another run or a damaged checkpoint, or another process is at it.
    """
    if isinstance(images, np.ndarray):
        check_images(images, config, held_out)
    if epochs < 1 or batch < 3:  # parts of nearly equal size then have two images each, which batch norms need
        raise EncoderInputError(f"epochs must be at least 1 and batch at least 3, not {epochs} and {batch}")
    if seed < 0:
        raise EncoderInputError(f"seed must be 0 or more, not {seed}")
    folder, precision = Path(folder), resolve_precision(precision, device)
    keep_freed_memory()
    with ENCODER_FOLDER.locked(folder):
        if not isinstance(images, np.ndarray):
            check_images(images := images(), config, held_out)
        run = {
            "config": to_plain(config),
            "epochs": epochs,
            "batch": batch,
            "seed": seed,
            "held_out": held_out,
            "images": len(images),
            "images_hash": hashlib.sha256(np.ascontiguousarray(images).data).hexdigest()[:16],
            "precision": precision,
            DEVICE: torch.device(device).type,
            "encoder_version": versions.ENCODER,
            **(identity or {}),
        }
        train_images, held_out_images = (images[part] for part in split_indices(len(images), held_out, seed))
        state = _State(config, run, device)
        rows = state.resume(folder / CHECKPOINT)
        restore_rows(folder / METRICS, COLUMNS, rows)
        if progress:
            say_resumed(folder, len(rows), epochs)
        with torch_threads(default_torch_threads()):
            _take_epochs(folder, state, train_images, held_out_images, rows, progress)
        return _write_encoder(folder / FILE, state, train_images, held_out_images, rows, source)


def finished_training(folder: Path, epochs: int) -> TrainingResult | None:
    """Return the result of the training in a folder, read from its files, if all its epochs and its encoder are there;
    raises `EncoderFileError` for damaged ones."""
    path, checkpoint = folder / FILE, folder / ENCODER_FOLDER.record
    if not (path.is_file() and checkpoint.is_file()):
        return None
    _, rows, _ = read_checkpoint(checkpoint, ENCODER_FOLDER.owner, COLUMNS)
    if len(rows) < epochs:
        return None
    _, about = load_model(path)
    try:
        errors = {name: about[name] for name in ("train_mse", "held_out_mse", "mean_image_mse")}
    except KeyError as error:
        raise EncoderFileError(f"{path}: it lacks the {error.args[0]} of its training; {ANEW}") from error
    return TrainingResult(path=path, rows=rows, **errors, already_finished=True)


def _take_epochs(
    folder: Path, state: "_State", images: np.ndarray, held_out: np.ndarray, rows: list[Row], progress: bool
) -> None:
    """Take the epochs that are missing on images uint8 [K, H, W, 4], and append their rows; each is saved."""
    epochs = state.run["epochs"]
    with progress_bar(progress) as bar:
        task = bar.add_task("training the encoder", total=epochs, completed=len(rows), note="")
        for epoch in range(len(rows), epochs):
            started = time.perf_counter()
            row = {"epoch": epoch + 1, **state.epoch(images, epoch)}
            speed = len(images) / (time.perf_counter() - started)
            row["held_out_mse"] = reconstruction_mse(state.vae, held_out) if len(held_out) else None
            rows.append({**row, "images_per_s": round(speed, 1)})
            state.save(folder / CHECKPOINT, rows)
            write_rows(folder / METRICS, COLUMNS, rows)
            bar.update(task, advance=1, note=f"{speed:.0f} images/s, mse {row['mse']:.5f}, kl {row['kl']:.2f}")


def split_indices(count: int, held_out: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the sorted indices of the training images and of the held-out images, sampled with `seed`."""
    order = np.random.default_rng([seed, 0]).permutation(count)
    return np.sort(order[held_out:]), np.sort(order[:held_out])


def resolve_precision(precision: str, device: str = "cpu") -> str:
    """Return "float32" or "bfloat16"; "auto" becomes what is faster on the device."""
    if precision not in ("auto", "float32", "bfloat16"):
        raise EncoderInputError(f"unknown precision {precision!r}; known: auto, float32, bfloat16")
    if precision != "auto":
        return precision
    if torch.device(device).type == "cuda":
        return "bfloat16" if torch.cuda.is_bf16_supported() else "float32"
    found = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return "bfloat16" if found.get("avx512_bf16") or found.get("amx_bf16") else "float32"


def epoch_generator(seed: int, epoch: int) -> torch.Generator:
    """Return the random generator of an epoch, for the order of the images and the noise in the codes."""
    return torch.Generator().manual_seed(int(np.random.SeedSequence([seed, 1, epoch]).generate_state(1)[0]))


class _State:
    """Model and optimiser, with their checkpoints."""

    def __init__(self, config: VAEConfig, run: Mapping[str, Any], device: str):
        self.run = dict(run)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(run["seed"])
            self.vae = VAE(config).to(device)
        self.optimizer = torch.optim.Adam(self.vae.parameters(), config.learning_rate, fused=True)

    def epoch(self, images: np.ndarray, epoch: int) -> dict[str, float]:
        """Train on images uint8 [K, H, W, 4] in batches of nearly equal size; returns mean loss, MSE and KL."""
        vae, config, device = self.vae.train(), self.vae.config, next(self.vae.parameters()).device
        draw = epoch_generator(self.run["seed"], epoch)
        order = torch.randperm(len(images), generator=draw).numpy()
        sums = np.zeros(3)
        for chosen in np.array_split(order, math.ceil(len(order) / self.run["batch"])):
            batch = to_batch(images[chosen], config, device)
            noise = torch.randn((len(chosen), config.latent), dtype=torch.float32, generator=draw).to(device)
            with torch.autocast(device.type, torch.bfloat16, enabled=self.run["precision"] == "bfloat16"):
                reconstruction, mean, log_variance = vae(batch, noise)
            losses = vae_loss(batch, reconstruction, mean, log_variance, config.kl_weight)
            self.optimizer.zero_grad(set_to_none=True)
            losses[0].backward()
            self.optimizer.step()
            sums += np.array([value.item() for value in losses]) * len(chosen)
        return dict(zip(("loss", "mse", "kl"), (sums / len(images)).tolist(), strict=True))

    def save(self, path: Path, rows: list[Row]) -> None:
        """Write the state that the next epoch needs and the rows so far to one file."""
        save_state(path, ENCODER_FOLDER.owner, self.run, rows, state_tensors(self.vae, PREFIX, self.optimizer))

    def resume(self, path: Path) -> list[Row]:
        """Restore model and optimiser and return the rows of the finished epochs; without a file, return no rows."""
        return resume_state(path, ENCODER_FOLDER, COLUMNS, self.run, self.vae, PREFIX, self.optimizer)


def write_rows(path: Path, columns: Sequence[str], rows: list[Row]) -> None:
    """Write rows with these columns as a CSV file, atomically."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([row[name] for name in columns] for row in rows)
    write_atomic(path, text.getvalue())


def restore_rows(path: Path, columns: Sequence[str], rows: list[Row]) -> None:
    """Write the rows of a checkpoint that is resumed, the last of which a process that was killed may not have written
    as CSV; nothing without rows."""
    if rows:
        write_rows(path, columns, rows)


def say_resumed(folder: Path, finished: int, epochs: int) -> None:
    """Tell after which epoch a training resumes; nothing for one that begins, or is finished."""
    if 0 < finished < epochs:
        notice(f"{folder} resumes after epoch {finished} of {epochs}.")


def progress_bar(shown: bool) -> Progress:
    """Return a progress bar of epochs on stderr, with a note behind it."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, TextColumn("{task.fields[note]}"), console=Console(stderr=True), disable=not shown)


def _write_encoder(
    path: Path, state: _State, train_images: np.ndarray, held_out_images: np.ndarray, rows: list[Row], source: Source
) -> TrainingResult:
    """Measure the errors on images uint8 [K, H, W, 4] trained on and held out, and write the encoder's file."""
    errors = {
        "train_mse": reconstruction_mse(state.vae, train_images),
        "held_out_mse": reconstruction_mse(state.vae, held_out_images) if len(held_out_images) else None,
        "mean_image_mse": mean_image_mse(train_images, state.vae.config),
    }
    provenance: dict[str, Any] = {
        "level": source.level,
        "image_seed": source.seed,
        "render_version": source.render_version,
    }
    if source.world_seeds:
        provenance["world_seeds"] = list(source.world_seeds)
    packages = {"thalweg": package_version("thalweg"), "torch": torch.__version__}
    save_vae(path, state.vae, {**state.run, **errors, **provenance, **packages, "command": source.command})
    return TrainingResult(path=path, rows=rows, **errors)
