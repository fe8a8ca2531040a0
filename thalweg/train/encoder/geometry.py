"""Training of an encoder of geometry on rivers: what it learns from, and what a linear probe reads from its codes.

Stored are poses; frames are drawn anew in each epoch, each under another look. Codes are judged on rivers that were
never trained on, under all looks, along flights and at random starts. Where views are of several tasks, a quantity is
learnt from those of its own task, and codes are judged on each.
"""

import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.compute.device import resolve_device
from thalweg.core.config import to_plain
from thalweg.core.run_folder import DEVICE
from thalweg.core.seeds import compact_seeds, parse_seeds
from thalweg.encoder import Encoder, EncoderInputError, load_encoder, sides
from thalweg.encoder.checkpoint import check_folder, require_same_run
from thalweg.encoder.files import FILE, load_model
from thalweg.encoder.geometry import GeometryConfig, Scale
from thalweg.encoder.geometry_training import GEOMETRY_FOLDER, Labelled, train_geometry, write_geometry
from thalweg.encoder.linear_probe import probe_r_squared
from thalweg.encoder.training import resolve_precision
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.tasks import PAPER_TASK
from thalweg.render import RENDER_VERSION, compilation
from thalweg.render.records.camera import Camera
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.encoder.drawing import camera_as_data, size_of
from thalweg.train.encoder.grounds import JUDGED_APART, Grounds
from thalweg.train.encoder.probe_table import probe_data, probe_table, read_probe
from thalweg.train.encoder.targets import mirrored_targets, shown_of, targets_of, weights_of
from thalweg.train.encoder.views import TARGETS, KnownViews, draw_views, flight_views, start_views
from thalweg.train.encoder_of_run import check_size_fits
from thalweg.train.flip import flipped
from thalweg.world import Reach

CHUNK = 1024
"""Frames that are drawn at a time."""
FITTED = 4096
"""Greatest number of frames of the rivers of training, for each task, that the linear probe is fitted to."""
PROBE = "probe.csv"
"""Name of the table of R² of linear probes, the last file that a training writes."""
KINDS = {"flights": flight_views, "starts": start_views}
"""Kinds of views on which codes are judged."""
VERSION = 1
"""Version of the views and of what is learnt from them: a folder of another one is refused."""


def geometry_config(tasks: Sequence[str] = (PAPER_TASK,), **settings: Any) -> GeometryConfig:
    """Return the config of an encoder that predicts what the ideal eye sees of the river, and a camera of some tasks;
    `settings` differ from the defaults. Raises `EncoderInputError` for tasks that `targets_of` refuses."""
    targets = targets_of(tasks)
    return GeometryConfig(targets=targets, weights=weights_of(targets), **settings)


@dataclass(frozen=True)
class GeometryTraining:
    """A training on rivers of some levels, or of a file, and its measurement on others."""

    folder: Path
    """Folder of the training; an interrupted one is resumed."""
    config: GeometryConfig
    levels: tuple[str, ...] = ("Easy", "Medium", "Hard")
    world_seeds: Any = "1000:1022"
    """Seeds of the rivers of each level, as `thalweg.core.seeds.parse_seeds` reads them."""
    held_out_seeds: Any = "3000:3006"
    """Seeds of the rivers of each level on which the codes are judged."""
    river: Reach | None = None
    """A real river in place of the levels: the seeds are then those of its plants and hills, and codes are judged at
    other places of the same course, under other ones; see `thalweg.train.encoder.grounds`."""
    tasks: tuple[str, ...] = (PAPER_TASK,)
    """Tasks whose views are learnt from, each as often; `config` is `geometry_config` of the same."""
    views: int = 96
    """Stored views of each river and task, of flights."""
    images: int = 4096
    """Frames that are drawn for an epoch."""
    passes: int = 4
    """How often a drawn frame is learnt from, each time with a random half of them mirrored."""
    held_out: int = 1024
    """Frames of each kind of views, and of each task, on which codes are judged."""
    epochs: int = 16
    seed: int = 0
    camera: Camera = DEFAULT_CONFIG.camera
    """Whose frames are learnt from and judged; `config` has their size."""
    quality: Quality = "fast"
    """Quality of the frames of training; those on which codes are judged are full."""
    rivers_in_memory: int | None = None
    """Greatest number of rivers in memory; None derives it from the free memory."""
    precision: str = "auto"
    device: str = "cpu"
    """Where frames are drawn and the encoder learns, see `thalweg.core.compute.device`."""
    command: str = ""
    """Command, which is stored in the encoder's file."""

    def run(self, *, progress: bool = True) -> "GeometryResult":
        """Train and measure, or resume the training in the folder; a finished one is read, and nothing is drawn,
        so that it needs no device.

        Raises `EncoderInputError` for settings out of range, `EncoderFileError` for the folder of another training or
        one that another process is at, `WorldError` for an unknown level or a file of no river, and `DeviceError`,
        before anything is drawn.
        """
        self._check()
        path, table = self.folder / FILE, self.folder / PROBE
        self._check_folder(path)
        if path.is_file() and table.is_file():
            return GeometryResult(path, read_probe(table, self.targets), self.targets, already_finished=True)
        device = resolve_device(self.device)
        check_folder(self.folder, GEOMETRY_FOLDER, {**self._run, **self._learns(device)})
        with GEOMETRY_FOLDER.locked(self.folder):
            return self._train(path, table, device, progress)

    def _train(self, path: Path, table: Path, device: str, progress: bool) -> "GeometryResult":
        """Train or resume, and write the encoder and the table of its probes."""
        self.grounds.check_all_fit(self.seeds, self.judged_seeds)  # each list alone, in two threads, may fit
        compilation.begin()
        with ThreadPoolExecutor(1, "thalweg-held-out") as worker:  # loading rivers takes one core each
            judged = worker.submit(self._judged)
            lessons = RiverLessons(self)
            held_out = judged.result()
        lessons.held_out = held_out["flights"].views
        try:
            network = train_geometry(
                lessons,
                self.config,
                self.folder,
                epochs=self.epochs,
                seed=self.seed,
                precision=self.precision,
                device=device,
                identity={**self._identity, DEVICE: torch.device(device).type},
                progress=progress,
            )
            fitted = lessons.fitted()
        finally:
            lessons.close()
        encoders = {"geometry": Encoder(network), "default": load_encoder()}
        scores = {
            (name, label): found
            for name, each in encoders.items()
            if sides(each.config.size_px) == size_of(self.camera)
            for judged in held_out.values()
            for label, found in judged.r_squared(each, fitted).items()
        }
        write_geometry(path, network, {**self._about, "r_squared": probe_data(scores, self.targets)})
        write_atomic(table, probe_table(scores, self.targets))
        return GeometryResult(path, scores, self.targets, already_finished=False)

    def _check(self) -> None:
        """Raise an error for settings that don't fit."""
        self.grounds.check()
        self.grounds.check_limit(self.rivers_in_memory)
        check_size_fits(self.camera, self.config.size_px, "that is trained", EncoderInputError)
        if self.config.targets != self.targets:
            raise EncoderInputError(
                f"config predicts {len(self.config.targets)} quantities, but views of {', '.join(self.tasks)} have"
                f" {len(self.targets)}: make it by geometry_config(tasks)"
            )
        self.grounds.check_seeds(self.seeds, self.judged_seeds)
        if shared := sorted(set(self.seeds) & set(self.judged_seeds)):
            raise EncoderInputError(
                f"world_seeds and held_out_seeds share {shared[0]}: codes are judged on other rivers"
            )
        for name in ("views", "images", "passes", "held_out", "epochs"):
            least = 16 if name in ("images", "held_out") else 1
            if (value := getattr(self, name)) < least:
                raise EncoderInputError(f"{name} must be at least {least}, not {value}")
        if self.seed < 0:
            raise EncoderInputError(f"seed must be 0 or more, not {self.seed}")

    def _check_folder(self, path: Path) -> None:
        """Raise `EncoderFileError` for the folder of another training, by its checkpoint and by the encoder's file."""
        check_folder(self.folder, GEOMETRY_FOLDER, self._run)
        if path.is_file():  # finished folders are also kept without their checkpoint
            _, recorded = load_model(path)
            require_same_run(self.folder, GEOMETRY_FOLDER, recorded, self._run)

    @property
    def _run(self) -> dict[str, Any]:
        """Return what distinguishes the training from others, wherever it learns."""
        return {**self._identity, "epochs": self.epochs, "seed": self.seed, "config": to_plain(self.config)}

    def _learns(self, device: str) -> dict[str, Any]:
        """Return what distinguishes where it learns from elsewhere: the precision, and the kind of device."""
        return {"precision": resolve_precision(self.precision, device), DEVICE: torch.device(device).type}

    @cached_property
    def targets(self) -> tuple[str, ...]:
        """Names of the T quantities."""
        return targets_of(self.tasks)

    @property
    def _of_paper(self) -> bool:
        """Whether all views are of the paper's task, so that it need not be named."""
        return tuple(self.tasks) == (PAPER_TASK,)

    @cached_property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the rivers of training."""
        return parse_seeds(self.world_seeds, "world_seeds", EncoderInputError)

    @cached_property
    def judged_seeds(self) -> tuple[int, ...]:
        """Seeds of the rivers on which codes are judged."""
        return parse_seeds(self.held_out_seeds, "held_out_seeds", EncoderInputError)

    @property
    def grounds(self) -> Grounds:
        """The levels, or the real river."""
        return Grounds(self.levels, self.river)

    def rivers(self, seeds: tuple[int, ...]) -> RiverList:
        """Return the rivers of all levels, or of the file, with these seeds."""
        return self.grounds.listed(seeds, self.rivers_in_memory)

    def drawn(self, rivers: RiverList, quality: Quality) -> RiverVectorEnv:
        """Return an environment that draws rivers under all looks."""
        config = EnvConfig(randomisation=Randomisation(), quality=quality, camera=self.camera)
        return RiverVectorEnv(rivers, 1, config, device=self.device)

    def _judged(self) -> "dict[str, Judged]":
        """Return frames of rivers held out, by the kind of views."""
        rivers, found = self.rivers(self.judged_seeds), {}
        seed = self.seed if self.river is None else self.seed + JUDGED_APART
        env = self.drawn(rivers, "full")
        for number, (kind, views_of) in enumerate(KINDS.items()):
            views = views_of(rivers, -(-self.held_out // len(rivers)), seed, self.tasks, self.camera)
            rows = [np.flatnonzero(views.task == task)[: self.held_out] for task in range(len(self.tasks))]
            views = views.rows(np.concatenate(rows))
            frames = draw_views(env, views, np.random.default_rng([self.seed, 4, number]))
            found[kind] = Judged(Labelled(frames, views.truths), self._labels(kind))
        env.close()
        return found

    def _labels(self, kind: str) -> tuple[str, ...]:
        """Return how the views of each task are called in tables: by their kind, if none but the paper's task was
        asked for."""
        return (kind,) if self._of_paper else tuple(f"{kind} in {task}" for task in self.tasks)

    @property
    def _identity(self) -> dict[str, Any]:
        """Return what distinguishes the lessons from others, as plain data."""
        seen = {"tasks": list(self.tasks), "tasks_version": versions.TASKS, "props_version": versions.PROPS}
        return {
            **({} if self._of_paper else seen),
            **self.grounds.as_data(),
            "world_seeds": compact_seeds(self.seeds),
            "held_out_seeds": compact_seeds(self.judged_seeds),
            "views": self.views,
            "images": self.images,
            "passes": self.passes,
            "held_out": self.held_out,
            "quality": self.quality,
            **camera_as_data(self.camera),
            "render_version": RENDER_VERSION,
            "lessons_version": VERSION,
            "encoder_version": versions.ENCODER,
            "steady_version": versions.STEADY,
            "privileged_version": versions.PRIVILEGED,
            "rules_version": versions.RULES,
            "world_version": versions.WORLD,
        }

    @property
    def _about(self) -> dict[str, Any]:
        """Return what the encoder's file says about its training."""
        return {**self._identity, "epochs": self.epochs, "seed": self.seed, "command": self.command}


@dataclass(frozen=True)
class Judged:
    """Views on which codes are judged: so many of one task, then as many of the next."""

    views: Labelled
    labels: tuple[str, ...]
    """How those of each task are called in tables."""

    def r_squared(self, encoder: Encoder, fitted: Labelled) -> dict[str, np.ndarray]:
        """Return R² [T] of linear probes by label, fitted to the codes of other frames of all tasks together."""
        codes, known = encoder(self.views.frames), self.views.truths
        fit = encoder(fitted.frames), fitted.truths
        parts = zip(*(np.split(each, len(self.labels)) for each in (codes, known)), strict=True)
        return {label: probe_r_squared(*fit, *part) for label, part in zip(self.labels, parts, strict=True)}


class RiverLessons:
    """Frames of stored views of rivers, drawn anew in each epoch."""

    def __init__(self, training: GeometryTraining) -> None:
        self.training = training
        self.held_out = Labelled(np.zeros((0, 0, 0, 4), np.uint8), np.zeros((0, len(training.targets))))
        rivers = training.rivers(training.seeds)
        self.views = flight_views(rivers, training.views, training.seed, training.tasks, training.camera)
        self.scale = Scale.of(self.views.truths)
        self._env = training.drawn(rivers, training.quality)
        draw_views(self._env, self.views.rows(slice(len(rivers))), np.random.default_rng(0))  # loads the rivers

    def draw(self, epoch: int) -> Iterator[Labelled]:
        """Yield the sets of frames of an epoch, about `CHUNK` at a time, each as often as there are passes.

        While one set is learnt from, the next one is drawn in the background.
        """
        order, looks, mirrors = (np.random.default_rng([self.training.seed, stream, epoch]) for stream in (5, 7, 8))
        chosen = list(self._chosen(self.training.images, order))
        with ThreadPoolExecutor(1, "thalweg-lessons") as worker:
            ahead = worker.submit(draw_views, self._env, chosen[0], looks)
            for views, following in zip(chosen, [*chosen[1:], None], strict=True):
                frames = ahead.result()
                if following is not None:
                    ahead = worker.submit(draw_views, self._env, following, looks)
                for _ in range(self.training.passes):
                    yield half_mirrored(frames, views.truths, mirrors, self.training.targets)

    def fitted(self) -> Labelled:
        """Return the frames of the rivers of training that a probe is fitted to."""
        generator = np.random.default_rng([self.training.seed, 6])
        count = min(FITTED, 2 * self.training.held_out) * len(self.training.tasks)
        chosen = list(self._chosen(count, generator))
        frames = [draw_views(self._env, views, generator) for views in chosen]
        return Labelled(np.concatenate(frames), np.concatenate([views.truths for views in chosen]))

    def _chosen(self, count: int, generator: np.random.Generator) -> Iterator[KnownViews]:
        """Yield random views, about `CHUNK` at a time; none is chosen twice before all were."""
        stored, order = len(self.views.river), np.zeros(0, np.int64)
        while len(order) < count:
            order = np.concatenate([order, generator.permutation(stored)])
        # A set of one frame has no batch statistics: it is joined to the one before.
        starts = [at for at in range(0, count, CHUNK) if at == 0 or count - at > 1]
        for start, end in itertools.pairwise([*starts, count]):
            yield self.views.rows(order[start:end])

    def close(self) -> None:
        """Stop what runs in the background."""
        self._env.close()


@dataclass(frozen=True)
class GeometryResult:
    """File and measurement of a finished training."""

    path: Path
    """The encoder's file."""
    scores: dict[tuple[str, str], np.ndarray]
    """R² [T] of linear probes by encoder, `geometry` or, where it takes frames of that size, the package's `default`,
    and kind of views, with their task where tasks were given."""
    targets: tuple[str, ...]
    """Names of the T quantities."""
    already_finished: bool
    """Whether the training was finished before, so that nothing was trained."""

    @property
    def lines(self) -> list[str]:
        """A line for each encoder and kind of views, with R² of what decides a flight, and its cost in a task."""
        lines = []
        for (name, kind), found in self.scores.items():
            told = {key: found[self.targets.index(key)] for key in shown_of(self.targets)}
            known = [f"{key} {value:.2f}" for key, value in told.items() if key in TARGETS or np.isfinite(value)]
            lines.append(f"{name}, {kind}: {', '.join(known)}")
        return lines


def half_mirrored(
    frames: np.ndarray, truths: np.ndarray, generator: np.random.Generator, targets: Sequence[str] = TARGETS
) -> Labelled:
    """Return frames [K, H, W, C] and truths [K, T] of the `targets`, each with probability 1/2 those of the view in a
    mirror."""
    chosen = generator.random(len(frames)) < 0.5
    seen, known = frames.copy(), truths.copy()
    seen[chosen], known[chosen] = flipped(frames[chosen]), mirrored_targets(truths[chosen], targets)
    return Labelled(seen, known)
