"""Behaviour cloning: a policy that sees frames learns from recorded flights; nothing is flown.

The student is that of imitation. In each recorded step, the move that was made is the best one, and all others are
equally bad. What only the simulator knows is not recorded, so that the student does not predict it.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.student import LOSSES, Lesson, Student
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy_file import About
from thalweg.algos.policy.vision import rows_of
from thalweg.core import versions
from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.torch_threads import default_torch_threads, torch_threads
from thalweg.core.config import parse_config, to_plain
from thalweg.env import EnvConfig
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.spaces import action_space
from thalweg.env.task.bird_eye import COLUMNS, ROWS
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import RENDER_VERSION
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import RECORDED_DIGEST, RECORDINGS, device_identity, read_status
from thalweg.train.imitation.flights import lesson_of
from thalweg.train.imitation.frame_memory import check_frame_memory, copies_of_drawn
from thalweg.train.imitation.mask_noise import corrupt
from thalweg.train.imitation.mirroring import mirror
from thalweg.train.imitation.recorded_flights import RecordedFlights
from thalweg.train.imitation.student_trainer import StudentTrainer, begin_student
from thalweg.train.rollouts.episodes import Episode, EpisodeStatistics
from thalweg.train.run_in_folder import (
    RunResult,
    check_numbers,
    check_seconds,
    open_folder,
    result_of,
    train_to_end,
)

ALGORITHM = "BC"
"""Name of behaviour cloning in files and tables."""


@dataclass(frozen=True)
class Cloning:
    """A run in which a student learns from recordings."""

    folder: Path
    """Folder of the run; an interrupted one is resumed."""
    recordings: Sequence[Path]
    """Folders of recordings, see `thalweg.datasets`; their names are recorded, but do not distinguish runs."""
    steps: int
    """Number of recorded steps to learn from; a step counts each time it is drawn."""
    seed: int = 0
    sequences: int = 32
    """Sequences that are drawn for each update."""
    settings: dict[str, Any] | None = None
    """Settings of `ImitationConfig` that differ from the defaults; those of flights have no effect."""
    threads: int | None = None
    """Threads for learning; None: `OMP_NUM_THREADS`, or as many as the cores that this process may use."""
    checkpoint_seconds: float = 60.0
    """Least time between two checkpoints."""
    begin_with: Path | None = None
    """As of an `Imitation`."""
    device: str = "cpu"
    """Device of the student, see `thalweg.core.compute.device`. A run is resumed on the kind of device that it began
    on."""

    def run(self, *, progress: bool = False) -> RunResult:
        """Train the student, or resume the run in the folder, which is known by the content of its recordings; of a
        finished run the result is returned.

        Raises, before anything is learnt, `AlgorithmError` for a wrong setting, or a policy of another kind to begin
        with; `DatasetError` for recordings that cannot be read; `DeviceError` for a device that cannot be used; and
        `ConfigError` or `TrainingError` for recordings that a student cannot learn from, frames that do not fit into
        the memory, and other wrong arguments. Raises `NotFiniteError` for a loss that is not finite.
        """
        return self._with_whole_numbers()._run(progress)

    def _with_whole_numbers(self) -> "Cloning":
        """Return the same with Python's integers, which files can hold; raises `TrainingError` for other numbers."""
        check_seconds(checkpoint_seconds=self.checkpoint_seconds)
        numbers = {"steps": (self.steps, 1), "sequences": (self.sequences, 1), "seed": (self.seed, 0)}
        if self.threads is not None:
            numbers["threads"] = (self.threads, 1)
        return replace(self, **dict(zip(numbers, check_numbers(**numbers), strict=True)))

    def _run(self, progress: bool) -> RunResult:
        settings = {"auxiliary_weight": 0.0, **(self.settings or {})}
        config = parse_config(ImitationConfig, settings, "settings")
        if config.auxiliary_weight:
            raise TrainingError("auxiliary_weight must be 0 with recordings, which do not tell what is predicted")
        threads = default_torch_threads() if self.threads is None else self.threads
        if not self.recordings:
            raise TrainingError("recordings must be at least one folder, such as recordings/steady")
        device = torch.device(resolve_device(self.device))
        if read_status(self.folder).get("state") != "finished":
            check_frame_memory(config, self.sequences, copies_of_drawn(config), "sequences")
        flights = RecordedFlights(self.recordings, config.observation)
        if len(flights.first) < config.sequence:
            raise TrainingError(
                f"the recordings have {len(flights.first)} steps, fewer than the {config.sequence} of one sequence:"
                f" record more, or set sequence={len(flights.first)}"
            )
        identity = self._identity(config, flights) | device_identity(device.type)
        actions, sizes = actions_of(action_space("multidiscrete")), (len(FEATURES), ROWS * COLUMNS)
        with torch_threads(1):
            student = Student(config, actions, MOVE_OPTIONS, sizes, self.seed, identity["context"], device)
        if self.begin_with is not None:
            identity["begin_with"] = begin_student(student, self.begin_with)
        status = open_folder(self.folder, identity, threads, device=str(device))
        if status.get("state") == "finished":
            return result_of(self.folder, status, resumed_from=None, already_finished=True)
        student.policy.about = About(ALGORITHM, to_plain(config), identity["context"])
        trainer = CloningTrainer(flights, student, self.steps, self.sequences, self.seed, threads)
        return train_to_end(
            self.folder, trainer, identity, progress=progress, checkpoint_seconds=self.checkpoint_seconds
        )

    def _identity(self, config: ImitationConfig, flights: RecordedFlights) -> dict[str, Any]:
        """Return what distinguishes the run from others."""
        context = {
            "observation": config.observation,
            "render_version": RENDER_VERSION,
            "imitation_version": versions.IMITATION,
            "env": EnvConfig(observation=config.observation).as_data(),
            RECORDINGS: [folder.name for folder in self.recordings],
            "recorded_flights": flights.count,
            "recorded_steps": len(flights.first),
            RECORDED_DIGEST: flights.digest.hexdigest()[:16],
        }
        return {
            "algorithm": ALGORITHM,
            "preset": "default",
            "config": to_plain(config),
            "steps": self.steps,
            "seed": self.seed,
            "num_envs": self.sequences,
            "context": context,
        }


class CloningTrainer(StudentTrainer):
    """Draws sequences of recorded steps and learns from them; it touches no file."""

    def __init__(
        self, flights: RecordedFlights, student: Student, steps: int, sequences: int, seed: int, threads: int
    ) -> None:
        """Learn from `steps` steps, `sequences` sequences at a time."""
        super().__init__(
            student, EpisodeStatistics(1, [""]), ("draw", "learn"), steps=steps, seed=seed, threads=threads
        )
        self.recorded, self.sequences = flights, sequences
        self.rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
        self._lesson: Lesson | None = None

    def start(self, state: dict[str, Any] | None = None) -> None:
        """Begin, or resume from a state."""
        if state is not None:
            self.load_state(state)

    @property
    def ready(self) -> bool:
        """Whether sequences are drawn."""
        return self._lesson is not None

    def step(self) -> list[Episode]:
        """Draw sequences, some of them mirrored, some with corrupted masks; returns no episodes."""
        config, before = self.student.config, time.perf_counter()
        images, sequences = self.recorded.draw(config.sequence, self.sequences, self.rng)
        start = np.zeros((self.sequences, config.memory_size), np.float32)
        sequences = sequences._replace(start=start)
        mirror(images, sequences, config.mirrored, self.rng)
        corrupt(images, config.observation, config.corrupted_masks, self.rng)
        self._lesson = lesson_of(sequences, rows_of(images, sequences.last))
        self.statistics.steps += config.sequence * self.sequences
        self.stages["draw"] += time.perf_counter() - before
        return []

    def update(self) -> dict[str, float]:
        """Learn from the sequences that were drawn; returns losses and learning rate."""
        assert self._lesson is not None
        self.student.decay(self.statistics.steps / self.steps)
        found = self.learn(self._lesson)
        self._lesson = None
        self.updates += 1
        losses = {name: found[name] for name in LOSSES[:2]}  # the others predict what is not recorded
        return {**losses, "learning_rate": self.student.optimiser.rate}

    def state(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on; valid between updates."""
        return super().state() | {"rng": self.rng.bit_generator.state}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        super().load_state(state)
        self.rng.bit_generator.state = state["rng"]
