"""Training of an encoder of geometry on batches that are drawn anew in each epoch; an interrupted run resumes.

An epoch depends on the previous ones only through the weights and Adam's moments, which the checkpoint holds, and on
what `Lessons` draws for it. Drawing and what the quantities are is left to the caller.
"""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from thalweg.core import versions
from thalweg.core.compute.heap import keep_freed_memory
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.core.config import to_plain
from thalweg.core.machine import package_version
from thalweg.core.run_folder import CHECKPOINT, FolderKind
from thalweg.encoder.checkpoint import Row, resume_state, save_state, state_tensors
from thalweg.encoder.encoder import Encoder
from thalweg.encoder.files import EncoderFileError, save_geometry
from thalweg.encoder.geometry import GeometryConfig, GeometryNetwork, Scale, geometry_loss
from thalweg.encoder.reconstruction import check_images, to_batch
from thalweg.encoder.training import (
    METRICS,
    epoch_generator,
    progress_bar,
    resolve_precision,
    restore_rows,
    say_resumed,
    write_rows,
)
from thalweg.encoder.vae import EncoderInputError

KIND, PREFIX = "geometry encoder training", "network."
GEOMETRY_FOLDER = FolderKind(KIND, CHECKPOINT, EncoderFileError)
COLUMNS = ("epoch", "loss", "held_out_r2", "learning_rate", "images_per_s")
"""Columns of `metrics.csv`: the mean loss over the steps of an epoch; R² of the predictions on the frames held out, the
mean over the quantities by their weights; the learning rate; and images learnt from per second, drawing included."""
CLIP = 1.0
"""Greatest norm of a gradient."""


@dataclass(frozen=True)
class Labelled:
    """Frames with what is true of them."""

    frames: np.ndarray
    """[K, H, W, 4] uint8."""
    truths: np.ndarray
    """[K, T], in the units of the quantities; NaN where one is not defined."""


class Lessons(Protocol):
    """What an encoder of geometry learns from."""

    scale: Scale
    """Of the quantities."""
    held_out: Labelled
    """Frames that are never learnt from."""

    def draw(self, epoch: int) -> Iterator[Labelled]:
        """Yield the sets of frames of an epoch, which depend on its number alone."""
        ...


def train_geometry(
    lessons: Lessons,
    config: GeometryConfig,
    folder: str | Path,
    *,
    epochs: int,
    seed: int = 0,
    precision: str = "auto",
    device: str = "cpu",
    identity: Mapping[str, Any] | None = None,
    progress: bool = True,
) -> GeometryNetwork:
    """Train for some epochs and return the network; resumes what was interrupted in `folder`.

    `identity` describes the lessons: a folder of others is refused. Raises `EncoderInputError` for settings that don't
    fit, and `EncoderFileError` when the folder holds another run or a damaged checkpoint.
    """
    if epochs < 1:
        raise EncoderInputError(f"epochs must be at least 1, not {epochs}")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    run = {
        "config": to_plain(config),
        "epochs": epochs,
        "seed": seed,
        "precision": resolve_precision(precision, device),
        "encoder_version": versions.ENCODER,
        **(identity or {}),
    }
    keep_freed_memory()
    state = _State(config, lessons.scale, run, device)
    rows = state.resume(folder / CHECKPOINT)
    restore_rows(folder / METRICS, COLUMNS, rows)
    if progress:
        say_resumed(folder, len(rows), epochs)
    with progress_bar(progress) as bar:
        task = bar.add_task("training the encoder", total=epochs, completed=len(rows), note="")
        for epoch in range(len(rows), epochs):
            # One thread: what is drawn at the same time needs the others.
            with torch_threads(1):
                rows.append(state.epoch(lessons, epoch))
            state.save(folder / CHECKPOINT, rows)
            write_rows(folder / METRICS, COLUMNS, rows)
            score = rows[-1]["held_out_r2"]
            told = "" if score is None else f", R² held out {score:.3f}"
            bar.update(task, advance=1, note=f"{rows[-1]['images_per_s']:.0f} images/s{told}")
    return state.network.cpu().eval()


def write_geometry(path: Path, network: GeometryNetwork, about: Mapping[str, Any]) -> None:
    """Write the file of a trained encoder, with the versions that made it beside `about`."""
    save_geometry(path, network, {**about, "thalweg": package_version("thalweg"), "torch": torch.__version__})


def r_squared(predicted: np.ndarray, truths: np.ndarray) -> np.ndarray:
    """Return R² [T] of predictions [K, T] of quantities [K, T]; NaN truths are left out, and NaN is that of a constant.

    R² = 1 - mean squared error / variance.
    """
    known = np.isfinite(truths)
    masked = np.where(known, truths, np.nan).astype(np.float64)
    variance = np.nanvar(masked, axis=0)
    error = np.nanmean(np.square(masked - predicted), axis=0)
    return np.where(variance > 0, 1.0 - error / np.where(variance > 0, variance, 1.0), np.nan)


class _State:
    """Network and optimiser, with their checkpoints."""

    def __init__(self, config: GeometryConfig, scale: Scale, run: Mapping[str, Any], device: str):
        self.run = dict(run)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(run["seed"])
            self.network = GeometryNetwork(config, scale).to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), config.learning_rate, fused=True)
        weights = config.weights or (1.0,) * len(config.targets)
        self.weights = torch.tensor(weights, dtype=torch.float32, device=device)

    def epoch(self, lessons: Lessons, epoch: int) -> Row:
        """Learn from what is drawn for an epoch; returns its row of `metrics.csv`."""
        started, config = time.perf_counter(), self.network.config
        rate = self._set_rate(epoch)
        draw = epoch_generator(self.run["seed"], epoch)
        total, count = 0.0, 0
        for lesson in lessons.draw(epoch):
            check_images(lesson.frames, config)
            order = torch.randperm(len(lesson.frames), generator=draw).numpy()
            for chosen in np.array_split(order, math.ceil(len(order) / config.batch)):
                total += self._step(lesson.frames[chosen], lesson.truths[chosen]) * len(chosen)
                count += len(chosen)
        speed = round(count / (time.perf_counter() - started), 1)
        score = self._score(lessons.held_out)
        return dict(zip(COLUMNS, (epoch + 1, total / count, score, rate, speed), strict=True))

    def _step(self, frames: np.ndarray, truths: np.ndarray) -> float:
        """Take a gradient step on frames [N, H, W, 4] with truths [N, T]; returns the loss."""
        network = self.network.train()
        device = self.weights.device
        batch = to_batch(frames, network.config, device)
        scaled = (torch.from_numpy(truths).to(device, torch.float32) - network.mean) / network.deviation
        with torch.autocast(device.type, torch.bfloat16, enabled=self.run["precision"] == "bfloat16"):
            predicted = network(batch)
        loss = geometry_loss(predicted.float(), scaled, self.weights, network.config.huber)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        self.optimizer.step()
        return loss.item()

    def _set_rate(self, epoch: int) -> float:
        """Set the learning rate of an epoch, counted from 0: along a half cosine; returns it."""
        config = self.network.config
        passed = epoch / max(self.run["epochs"] - 1, 1)
        share = config.least_rate + (1.0 - config.least_rate) * 0.5 * (1.0 + math.cos(math.pi * passed))
        for group in self.optimizer.param_groups:
            group["lr"] = config.learning_rate * share
        return config.learning_rate * share

    def _score(self, held_out: Labelled) -> float | None:
        """Return R² of the predictions of frames held out, mean over the quantities by their weights; None where there
        is nothing to predict."""
        network = self.network
        if not len(held_out.frames):
            return None
        with torch.random.fork_rng(devices=[]):
            copy = GeometryNetwork(network.config)
        copy.load_state_dict(network.state_dict())
        encoder = Encoder(copy)
        found = r_squared(encoder.predict(encoder(held_out.frames)), held_out.truths)
        weights = np.where(np.isfinite(found), self.weights.cpu().numpy(), 0.0)
        return float((np.nan_to_num(found) * weights).sum() / weights.sum()) if weights.sum() else None

    def save(self, path: Path, rows: list[Row]) -> None:
        """Write the state that the next epoch needs and the rows so far to one file."""
        save_state(path, GEOMETRY_FOLDER.owner, self.run, rows, state_tensors(self.network, PREFIX, self.optimizer))

    def resume(self, path: Path) -> list[Row]:
        """Restore model and optimiser and return the rows of the finished epochs; without a file, return no rows."""
        return resume_state(path, GEOMETRY_FOLDER, COLUMNS, self.run, self.network, PREFIX, self.optimizer)
