"""Training of the finder of water on frames of many rivers under all looks, drawn anew for each epoch.

Frames are mirrored, cut, and changed in gain and gamma at random, so that the network also learns from other lenses and
sensors than those of the looks.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.core import versions
from thalweg.core.compute.heap import keep_freed_memory
from thalweg.core.compute.torch_threads import default_torch_threads, torch_threads
from thalweg.core.machine import package_version
from thalweg.core.run_folder import CHECKPOINT, FolderKind
from thalweg.core.seeds import compact_seeds
from thalweg.encoder.checkpoint import Row, check_folder, resume_state, save_state, state_tensors
from thalweg.encoder.files import EncoderFileError
from thalweg.encoder.training import METRICS, epoch_generator, progress_bar, restore_rows, say_resumed, write_rows
from thalweg.encoder.vae import EncoderInputError
from thalweg.encoder.water import SIDES, WaterSegmenter, colours_of, mean_iou, save_segmenter, water_in
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.render import RENDER_VERSION, Camera, Renderer
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.encoder.drawing import Drawing, size_of
from thalweg.train.encoder.frames import BATCH, clock_times, sample_poses
from thalweg.train.encoder.grounds import JUDGED_APART, Grounds
from thalweg.world import Reach

KIND, PREFIX, FILE = "water training", "network.", "water.safetensors"
WATER_FOLDER = FolderKind(KIND, CHECKPOINT, EncoderFileError)
COLUMNS = ("epoch", "loss", "held_out_iou", "learning_rate", "images_per_s")
BATCH_IMAGES, RATE, LEAST_RATE = 32, 2e-3, 0.02
"""Frames of a minibatch, first learning rate of Adam, and the least one as a share of it."""
SMALLEST_CUT = 0.5
"""Least side of a part that is cut out of a frame, as a share of the frame's."""
GAIN, GAMMA = 0.25, 0.35
"""Greatest change of each colour's gain, and of the logarithm of gamma."""


@dataclass(frozen=True)
class WaterTraining:
    """A training of the finder of water."""

    folder: Path
    """Folder of the training; an interrupted one is resumed."""
    levels: tuple[str, ...] = ("Easy", "Medium", "Hard")
    world_seeds: Sequence[int] = tuple(range(1000, 1006))
    """Seeds of the rivers of each level for training."""
    held_out_seeds: Sequence[int] = tuple(range(3000, 3002))
    """Seeds of the rivers of each level on which the network is evaluated."""
    river: Reach | None = None
    """A real river in place of the levels: the seeds are then those of its plants and hills, and the network is
    evaluated on the same course, under other ones."""
    images: int = 2048
    """Number of frames that are drawn for each epoch."""
    held_out: int = 384
    """Number of frames for evaluation."""
    epochs: int = 12
    seed: int = 0
    camera: Camera = DEFAULT_CONFIG.camera
    """Its sides must be multiples of `thalweg.encoder.water.SIDES` pixels."""
    quality: Quality = "full"
    """Quality of the frames of training; those for evaluation are full."""
    command: str = ""
    """The command line, which is written to the file."""

    @property
    def grounds(self) -> Grounds:
        """The levels, or the real river."""
        return Grounds(self.levels, self.river)

    def run(self, *, progress: bool = True) -> "WaterResult":
        """Train, or resume; a folder whose training is finished is read, and nothing is drawn.

        Raises `EncoderInputError` for numbers out of range, `EncoderFileError` for the folder of another training or
        one that another process is at, and `WorldError` for an unknown level or a file of no river.
        """
        self._check()
        run = self._identity()
        check_folder(self.folder, WATER_FOLDER, run)
        with WATER_FOLDER.locked(self.folder):
            return self._train(run, progress)

    def _train(self, run: dict[str, Any], progress: bool) -> "WaterResult":
        """Take the epochs that are missing, and write the network once all are there."""
        state, path = _State(run), self.folder / FILE
        rows = state.resume(self.folder / CHECKPOINT)
        restore_rows(self.folder / METRICS, COLUMNS, rows)
        finished = len(rows) == self.epochs and path.is_file()
        if len(rows) < self.epochs:
            self._learn(state, rows, progress)
        iou = self._iou_of(rows[-1])
        if not finished:
            about = {"run": run, "held_out_iou": iou, "render_version": RENDER_VERSION, "command": self.command}
            about |= {"thalweg": package_version("thalweg"), "torch": torch.__version__}
            save_segmenter(path, state.network, about)
        return WaterResult(path, iou, already_finished=finished)

    def _check(self) -> None:
        """Raise an error for settings that don't fit."""
        self.grounds.check()
        for name in ("images", "held_out", "epochs"):
            if getattr(self, name) < 1:
                raise EncoderInputError(f"{name} must be at least 1, not {getattr(self, name)}")
        if self.seed < 0:
            raise EncoderInputError(f"seed must be 0 or more, not {self.seed}")
        self.grounds.check_seeds(self.world_seeds, self.held_out_seeds)
        if shared := set(self.world_seeds) & set(self.held_out_seeds):
            raise EncoderInputError(f"held_out_seeds must be others than world_seeds, but {min(shared)} is in both")
        if any(side % SIDES for side in size_of(self.camera)):
            raise EncoderInputError(
                f"height_px and width_px of the camera must be multiples of {SIDES} for a finder of water, not"
                f" {self.camera.height_px} and {self.camera.width_px}"
            )

    def _learn(self, state: "_State", rows: list[Row], progress: bool) -> None:
        """Take the epochs that are missing in `rows`, and add a row for each."""
        self.grounds.check_all_fit(self.world_seeds, self.held_out_seeds)
        views: tuple[tuple[Sequence[int], Quality], ...] = (
            (self.world_seeds, self.quality),
            (self.held_out_seeds, "full"),
        )
        shown, judged = (Renderer(self.grounds.worlds(seeds), self.camera, quality) for seeds, quality in views)
        held_out = draw(judged, self.held_out, self.seed + JUDGED_APART)
        keep_freed_memory()
        threads = default_torch_threads()
        if progress:
            say_resumed(self.folder, len(rows), self.epochs)
        with progress_bar(progress) as bar:
            task = bar.add_task("training the finder of water", total=self.epochs, completed=len(rows), note="")
            for epoch in range(len(rows), self.epochs):
                frames = draw(shown, self.images, self.seed + 1000 * epoch)
                with torch_threads(threads):
                    rows.append(state.epoch(frames, held_out, epoch, self.epochs))
                state.save(self.folder / CHECKPOINT, rows)
                write_rows(self.folder / METRICS, COLUMNS, rows)
                bar.update(task, advance=1, note=f"IoU held out {rows[-1]['held_out_iou']:.3f}")

    def _iou_of(self, row: Row) -> float:
        """Return the IoU held out of an epoch; raises `EncoderFileError` for a row of a damaged checkpoint."""
        iou = row.get("held_out_iou")
        if iou is None:
            raise EncoderFileError(
                f"{self.folder / CHECKPOINT}: its last epoch has no held_out_iou; train in a new folder"
            )
        return iou

    def _identity(self) -> dict[str, Any]:
        """Return what distinguishes the training from others."""
        return {
            **self.grounds.as_data(),
            "world_seeds": compact_seeds(self.world_seeds),
            "held_out_seeds": compact_seeds(self.held_out_seeds),
            "images": self.images,
            "held_out": self.held_out,
            "epochs": self.epochs,
            "seed": self.seed,
            "encoder_version": versions.ENCODER,
            "render_version": RENDER_VERSION,
            "world_version": versions.WORLD,
            **Drawing(self.camera, self.quality).as_data(),
        }


@dataclass(frozen=True)
class WaterResult:
    """File and measurement of a finished training."""

    path: Path
    """The file of the finder of water."""
    iou: float
    """Mean over frames held out of the IoU of water found and true."""
    already_finished: bool
    """Whether the training was finished before, so that nothing was trained."""


def draw(renderer: Renderer, count: int, seed: int) -> np.ndarray:
    """Return frames uint8 [count, H, W, 4] at random poses in the renderer's rivers, each under a look of its own."""
    worlds, rng = list(renderer.worlds), np.random.default_rng([seed, 3])
    index = np.arange(count) % len(worlds)
    poses, time_s = sample_poses(worlds, index, seed), clock_times(count, seed)
    looks = np.array([Randomisation().draw(rng)[0] for _ in range(count)])
    camera = renderer.camera
    frames = np.empty((count, camera.height_px, camera.width_px, 4), np.uint8)
    for start in range(0, count, BATCH):
        rows = slice(start, start + BATCH)
        frames[rows] = renderer.render(poses[rows], index[rows], time_s[rows], look=looks[rows])
    return frames


def varied(frames: np.ndarray, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Return colours [N, 3, H, W] in 0..1 and water [N, H, W] of frames [N, H, W, 4], each changed at random: mirrored,
    cut, and with other gains and gamma."""
    count, height, width, _ = frames.shape
    colours = colours_of(frames)
    both = torch.cat([colours, torch.from_numpy(frames[:, None, ..., 3] > 127).float()], 1)
    size = rng.uniform(SMALLEST_CUT, 1.0, count)
    turned = np.where(rng.random(count) < 0.5, -1.0, 1.0)
    across, down = ((1.0 - size) * rng.uniform(-1, 1, count) for _ in range(2))
    theta = np.zeros((count, 2, 3), np.float32)
    theta[:, 0, 0], theta[:, 0, 2], theta[:, 1, 1], theta[:, 1, 2] = size * turned, across, size, down
    grid = nn.functional.affine_grid(torch.from_numpy(theta), [count, 4, height, width], align_corners=False)
    cut = nn.functional.grid_sample(both, grid, padding_mode="border", align_corners=False)
    gamma = torch.from_numpy(np.exp(rng.uniform(-GAMMA, GAMMA, (count, 1, 1, 1))).astype(np.float32))
    gain = torch.from_numpy(rng.uniform(1 - GAIN, 1 + GAIN, (count, 3, 1, 1)).astype(np.float32))
    return (cut[:, :3].clamp(0, 1) ** gamma * gain).clamp(0, 1), (cut[:, 3] > 0.5).float()


class _State:
    """Network and optimiser, with their checkpoints."""

    def __init__(self, run: dict[str, Any]) -> None:
        self.run = run
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(run["seed"])
            self.network = WaterSegmenter()
        self.optimizer = torch.optim.Adam(self.network.parameters(), RATE)

    def epoch(self, frames: np.ndarray, held_out: np.ndarray, epoch: int, epochs: int) -> Row:
        """Learn from frames; returns the row of the epoch, counted from 0, of `metrics.csv`."""
        started, network = time.perf_counter(), self.network.train()
        rate = RATE * max(LEAST_RATE, 0.5 * (1.0 + math.cos(math.pi * epoch / epochs)))
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        order = torch.randperm(len(frames), generator=epoch_generator(self.run["seed"], epoch)).numpy()
        rng, total = np.random.default_rng([self.run["seed"], epoch, 4]), 0.0
        for chosen in np.array_split(order, math.ceil(len(order) / BATCH_IMAGES)):
            colours, water = varied(frames[chosen], rng)
            loss = nn.functional.binary_cross_entropy_with_logits(network(colours), water)
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            self.optimizer.step()
            total += loss.item() * len(chosen)
        speed = round(len(frames) / (time.perf_counter() - started), 1)
        found = mean_iou(water_in(network.eval(), held_out), held_out[..., 3] > 127)
        return dict(zip(COLUMNS, (epoch + 1, total / len(frames), found, rate, speed), strict=True))

    def save(self, path: Path, rows: list[Row]) -> None:
        """Write the state that the next epoch needs and the rows so far to one file."""
        save_state(path, WATER_FOLDER.owner, self.run, rows, state_tensors(self.network, PREFIX, self.optimizer))

    def resume(self, path: Path) -> list[Row]:
        """Restore model and optimiser and return the rows of the finished epochs; without a file, return no rows."""
        return resume_state(path, WATER_FOLDER, COLUMNS, self.run, self.network, PREFIX, self.optimizer)
