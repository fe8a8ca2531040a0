"""Arms of the ladder of rivers and of the ablations: what is trained on which rivers, and the flights of each.

Students with one head over all joint moves, in place of one for each branch, are compared by `heads.py`.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from any_river import LEVELS, LOOKS
from settings_hash import without_latest

from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.student import ALGORITHM as STUDENT
from thalweg.algos.registry import algorithm_named
from thalweg.bench.evaluate.course import UNSEEN, Course, EvaluationConfig
from thalweg.core import versions
from thalweg.core.config import parse_config, to_plain
from thalweg.encoder import load_encoder
from thalweg.train.observations import encoder_hash

RUNGS = (1, 4, 16, 64, 256)
"""Rivers of each level that an arm is trained on."""
MOST_RIVERS = 384
"""Greatest number of rivers of an arm, all levels together: the renderer keeps 20 MB of each, some 8 GB of these."""
REPEATED, SEEDS = (16, 64), (0, 1, 2)
"""Rungs that all seeds climb; the others have the first alone."""
FIRST_RIVER = 1000
"""Seed of the first river of training; rivers of a rung are among those of the next one."""
FIXED, VARIED = "fixed", "varied"
STEPS = {STUDENT: 400_000, "FOCOPS": 200_000}
"""Steps of training by algorithm."""
NUM_ENVS = 16
"""Environments of an algorithm that is no imitation."""
KINDS = ("seen", "unseen", "varied")
"""Flights: on rivers of training, on as many unseen ones as there are episodes, and on these under varied looks."""
ABLATED = 64
"""Rivers of each level of the ablations."""
ABLATIONS: dict[str, dict[str, Any]] = {
    "scripted-teacher": {"teacher": "scripted"},
    "no-memory": {"memory_size": 0},
    "no-dagger": {"teacher_steps": 10**12},
    "no-auxiliary-heads": {"auxiliary_weight": 0.0},
    "no-mask": {"observation": "rgb"},
    "no-new-starts": {"start_share": 0.0},
}
"""Settings of a student that lacks one thing each. Without DAgger the teacher flies all episodes, random moves
included, from which the student learns by behaviour cloning."""


@dataclass(frozen=True)
class Arm:
    """One training: an algorithm with a seed on some rivers."""

    name: str
    """Who climbs the ladder, or what a student lacks."""
    algorithm: str
    """`STUDENT`, or an algorithm of the registry, which sees codes unless its `settings` have `policy=cnn`."""
    rivers: int
    """Rivers of each level."""
    looks: str
    """Looks of training, `FIXED` or `VARIED`."""
    seed: int
    steps: int
    levels: tuple[str, ...] = LEVELS
    """Levels whose rivers it is trained on."""
    further: tuple[str, ...] = ()
    """Levels on which it is flown besides, on unseen rivers only."""
    encoder: Path | None = None
    """File or name of the encoder of codes; None: the one that comes with the package."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings that differ from the defaults."""
    first_river: int = FIRST_RIVER
    """Seed of its first river."""

    @property
    def label(self) -> str:
        """Name by which an arm is selected."""
        return f"{self.name}-{self.rivers}-{self.looks}-{self.seed}"

    @property
    def seeds(self) -> range:
        """Seeds of its rivers."""
        return range(self.first_river, self.first_river + self.rivers)

    @property
    def is_student(self) -> bool:
        """Whether it learns from a teacher, and sees images."""
        return self.algorithm == STUDENT

    @property
    def sees_images(self) -> bool:
        """Whether its policy sees images, and not codes of them."""
        return self.is_student or self.settings.get("policy") == "cnn"

    @cached_property
    def resolved(self) -> dict[str, Any]:
        """All settings."""
        if self.is_student:
            config = parse_config(ImitationConfig, self.student_settings, "settings")
        else:
            config = algorithm_named(self.algorithm).configure(self.settings, num_envs=NUM_ENVS)
        return to_plain(config)

    @property
    def student_settings(self) -> dict[str, Any]:
        """Settings of a student, looks included."""
        return {**self.settings, "varied_looks": self.looks == VARIED}

    @property
    def tells_cost_critics(self) -> bool:
        """Whether it has critics of costs, and these are told more than the policy sees."""
        told = self.sees_images or self.resolved.get("asymmetric_critics", False)
        return not self.is_student and told and "cost_limit" in self.resolved

    @property
    def training_versions(self) -> dict[str, int]:
        """Versions that its policy depends on."""
        if self.is_student:
            learner = {"imitation": versions.IMITATION}
        else:
            learner = {self.algorithm: versions.ALGORITHMS[self.algorithm], "training": versions.TRAINING}
            if self.sees_images or self.resolved.get("asymmetric_critics", False):
                learner["privileged"] = versions.PRIVILEGED
            if self.tells_cost_critics:
                learner["deadlines"] = versions.DEADLINES
        return learner | {"render": versions.RENDER, "rules": versions.RULES, "world": versions.WORLD}

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `ARM_KEY`."""
        made_with = self.training_versions | {"evaluation": versions.EVALUATION}
        return (
            self.name,
            " ".join(self.levels),
            str(self.rivers),
            str(self.first_river),
            self.looks,
            str(self.seed),
            str(self.steps),
            digest(without_latest(self.resolved)),
            "none" if self.sees_images else hash_of_encoder(self.encoder),
            " ".join(f"{name}={number}" for name, number in made_with.items()),
        )

    @property
    def folder(self) -> str:
        """Name of the folder of its run, another one for everything that the policy depends on."""
        encoder = None if self.sees_images else hash_of_encoder(self.encoder)
        parts = without_latest(self.resolved), self.levels, self.first_river, self.training_versions, encoder
        return f"{self.label}-{self.steps}-{digest(parts)}"

    def cells(self, episodes: int, kinds: Sequence[str] = KINDS) -> list["Cell"]:
        """Return its flights."""
        return [
            Cell(self, kind, level, episodes)
            for kind in KINDS
            if kind in kinds
            for level in (*self.levels, *(self.further if kind != "seen" else ()))
        ]


ARM_KEY = ("arm", "levels", "rivers", "first_river", "looks", "seed", "steps", "config", "encoder", "versions")
"""Columns that identify an arm. `config` is a hash of all settings."""


@dataclass(frozen=True)
class Cell:
    """Flights of one kind on one level by the policy of an arm."""

    arm: Arm
    kind: str
    level: str
    episodes: int

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `CELL_KEY`."""
        return (*self.arm.key, self.kind, self.level, str(self.episodes))

    @property
    def config(self) -> EvaluationConfig:
        """How it is flown: a student acts by its most probable options, other policies sample theirs as in training."""
        return EvaluationConfig(self.episodes, deterministic=self.arm.is_student)

    def courses(self, *, drawn: bool = True) -> Iterator[Course]:
        """Yield the rivers with their starts, and looks if they vary; `drawn` is as for `Course.of_seeds`.

        The i-th flight has the i-th start of its river's list; on rivers that were seen, it is on river i, counted
        round.
        """
        seeds = self.arm.seeds if self.kind == "seen" else range(UNSEEN, UNSEEN + self.episodes)
        chosen = seeds[: self.episodes]
        for index, course in enumerate(Course.of_seeds(self.level, chosen, self.config, drawn=drawn)):
            shown = course.varied(LOOKS, self.config) if self.kind == "varied" else course
            yield shown.those(range(index, self.episodes, len(chosen)))


CELL_KEY = (*ARM_KEY, "kind", "level", "episodes")
"""Columns that identify a cell."""


def digest(data: Any) -> str:
    """Return a hash of plain data."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:8]


@cache
def hash_of_encoder(encoder: Path | None) -> str:
    """Return the hash of an encoder's file."""
    return encoder_hash(load_encoder(encoder))


CLIMBERS: tuple[Arm, ...] = (
    Arm("student", STUDENT, 1, FIXED, 0, STEPS[STUDENT]),
    Arm("FOCOPS", "FOCOPS", 1, FIXED, 0, STEPS["FOCOPS"], ("Medium",), ("Hard",), Path("geometry")),
)
"""Who climbs the ladder, on its first rung."""


COMPARED: tuple[Arm, ...] = tuple(
    replace(CLIMBERS[1], name=name, **differs)
    for name, differs in {
        "FOCOPS-vae": {"rivers": 16, "encoder": None},
        "FOCOPS-cnn": {"rivers": 16, "encoder": None, "settings": {"policy": "cnn"}},
        "FOCOPS-hard": {"rivers": 64, "levels": ("Hard",), "further": ("Medium",)},
    }.items()
)
"""Arms beside the climber of the same algorithm, each on one rung: with codes of the autoencoder, with convolutions
that are learnt with the policy, and on rivers of Hard."""


def compared_arms() -> list[Arm]:
    """Return the arms beside the climbers, with all seeds."""
    return [replace(arm, seed=seed) for arm in COMPARED for seed in SEEDS]


def ladder_arms() -> list[Arm]:
    """Return the arms of the ladder. A climber on several levels has no more than `MOST_RIVERS` on its last rung."""
    return [
        replace(climber, rivers=min(rung, MOST_RIVERS // len(climber.levels)), looks=looks, seed=seed)
        for climber in CLIMBERS
        for rung in RUNGS
        for looks in (FIXED, VARIED)
        for seed in (SEEDS if rung in REPEATED else SEEDS[:1])
    ]


def whole_student() -> Arm:
    """Return the arm of the ladder that ablations are compared with."""
    return Arm("student", STUDENT, ABLATED, VARIED, SEEDS[0], STEPS[STUDENT])


def ablation_arms() -> list[Arm]:
    """Return the arms of the ablations."""
    return [replace(whole_student(), name=name, settings=settings) for name, settings in ABLATIONS.items()]


def all_arms() -> list[Arm]:
    """Return all arms."""
    return [*ladder_arms(), *compared_arms(), *ablation_arms()]
