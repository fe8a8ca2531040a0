"""How does a policy learn on our rivers? Worlds, an encoder that fits them and an algorithm, brought together.

Other environments go to `thalweg.train.run` as they are; nothing there knows of rivers.
"""

import hashlib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from thalweg.algos.actions import Actions
from thalweg.algos.registry import algorithm_named
from thalweg.algos.settings import config_from
from thalweg.encoder import Encoder, check_render_version, load_encoder
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.render import RENDER_VERSION
from thalweg.train.announce import announce
from thalweg.train.errors import TrainingError
from thalweg.train.latent import LatentVectorEnv
from thalweg.train.run import RunResult, run
from thalweg.world import level_named, load_or_build

BRANCHES = (3, 3, 3, 3)
"""Options of each branch of an action: climb, turn, forward, side."""


def load_fitting_encoder(path: Path | None = None) -> Encoder:
    """An encoder that was trained on frames as this renderer draws them; raises the encoder's own errors."""
    encoder = load_encoder(path)
    check_render_version(encoder, RENDER_VERSION)
    return encoder


def file_mark(path: Path) -> str:
    """What tells a file from every other: a hash of its content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def mark(encoder: Encoder) -> str:
    """What tells an encoder from every other: the mark of its file."""
    return file_mark(Path(encoder.about["path"]))


def check_sees_as_trained(policy: Any, encoder: Encoder) -> None:
    """Raise `TrainingError` unless the policy fits the encoder's codes and our rivers' actions.

    A policy without spaces of its own, such as a baseline, fits everything.
    """
    seen = getattr(policy, "obs_size", encoder.latent)
    if seen != encoder.latent:
        raise TrainingError(f"the policy sees {seen} numbers, but the encoder gives {encoder.latent}")
    actions: Actions | None = getattr(policy, "actions", None)
    if actions is not None and (actions.sizes, actions.start, actions.shape) != (BRANCHES, (0, 0, 0, 0), (4,)):
        found = f"{actions.sizes} from {actions.start}" if actions.sizes else f"a Box of shape {actions.shape}"
        raise TrainingError(f"our rivers take four branches of 3 options, counted from 0, not {found}")
    learnt = getattr(getattr(policy, "about", None), "context", {}).get("encoder")
    if learnt is not None and learnt != mark(encoder):
        raise TrainingError(
            f"the policy was trained on the codes of encoder {learnt}, but this is encoder {mark(encoder)};"
            " give the encoder that it was trained with"
        )


@dataclass(frozen=True)
class TrainingGround:
    """Where a policy is trained."""

    level: str
    num_envs: int
    world_seeds: tuple[int, ...] = ()
    """Rivers of the level; its fixed one if none is given."""
    config: EnvConfig = field(default_factory=EnvConfig)
    """The rules and the camera."""

    def __post_init__(self) -> None:
        if self.num_envs < 1:
            raise TrainingError(f"num_envs must be at least 1, not {self.num_envs}")
        if min(self.world_seeds, default=0) < 0:
            raise TrainingError(f"a seed of a world is 0 or more, not {min(self.world_seeds)}")

    def train(
        self, algorithm: str, encoder: Encoder, *, steps: int, seed: int, folder: Path, settings: dict | None = None
    ) -> RunResult:
        """Train with a progress bar, going on from what lies in the folder.

        Raises the errors of `thalweg.train.run`, those of settings before a world is built.
        """
        entry = algorithm_named(algorithm)
        config = config_from(entry.config, settings)
        level = level_named(self.level)
        seeds = self.world_seeds or (level.default_seed,)
        context = {
            "level": level.name,
            "world_seeds": list(seeds),
            "encoder": mark(encoder),
            "render_version": RENDER_VERSION,
            "env": asdict(self.config),
        }
        for number in seeds:
            announce(level, number)
        worlds = [load_or_build(level, number) for number in seeds]
        env = LatentVectorEnv(RiverVectorEnv(worlds, self.num_envs, self.config), encoder)
        try:
            return run(
                entry.name, env, steps=steps, seed=seed, folder=folder, config=config, context=context, progress=True
            )
        finally:
            env.close()
