"""How does a policy learn on our rivers? Worlds, an encoder that fits them and an algorithm, brought together.

Other environments go to `thalweg.train.run` as they are; nothing there knows of rivers.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from thalweg.algos.policy.actions import Actions
from thalweg.algos.registry import algorithm_named
from thalweg.core.cache import file_hash
from thalweg.core.device import resolve_device
from thalweg.core.torch_threads import default_torch_threads
from thalweg.encoder import Encoder, check_render_version, load_encoder
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.render import RENDER_VERSION
from thalweg.train.build_notice import announce
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import read_config
from thalweg.train.latent import LatentVectorEnv
from thalweg.train.rollouts.torch_collector import LatentTensorEnv
from thalweg.train.run import RunResult, load_policy, run
from thalweg.world import Reach, World, level_named, load_or_build

BRANCHES = (3, 3, 3, 3)
"""Options of each branch of an action: climb, turn, forward, side."""


def load_fitting_encoder(path: Path | None = None, device: str = "cpu") -> Encoder:
    """An encoder on a device that was trained on frames as this renderer draws them; raises the encoder's own
    errors."""
    encoder = load_encoder(path, device=resolve_device(device))
    check_render_version(encoder, RENDER_VERSION)
    return encoder


def mark(encoder: Encoder) -> str:
    """What tells an encoder from every other: the mark of its file."""
    return file_hash(Path(encoder.about["path"]))


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


def check_same_file(folder: Path, context: Mapping[str, Any]) -> None:
    """Raise `TrainingError` where the run in a folder was begun on a real river's file that has changed since.

    `context` is that of the run to come. Whatever else differs is found by `thalweg.train.run`.
    """
    begun = read_config(folder) or {"run": {}}
    there = begun["run"].get("context", {}).get("river", {})
    here = context.get("river", {})
    if there.get("file") == here.get("file") and there.get("content") != here.get("content"):
        raise TrainingError(
            f"{here['file']} has changed since the run in {folder} was begun: its content was {there['content']} and "
            f"is {here['content']} now. Bring the old file back to go on, or choose another folder."
        )


@dataclass(frozen=True)
class TrainingGround:
    """Where a policy is trained."""

    place: str | Reach
    """A level by name, or a real river."""
    num_envs: int
    world_seeds: tuple[int, ...] = ()
    """Rivers of the level, its fixed one if none is given; of a real river its plants and hills."""
    config: EnvConfig = field(default_factory=EnvConfig)
    """The rules and the camera."""

    def __post_init__(self) -> None:
        if self.num_envs < 1:
            raise TrainingError(f"num_envs must be at least 1, not {self.num_envs}")
        if min(self.world_seeds, default=0) < 0:
            raise TrainingError(f"a seed of a world is 0 or more, not {min(self.world_seeds)}")

    @property
    def seeds(self) -> tuple[int, ...]:
        """Of the worlds, one each."""
        usual = level_named(self.place).default_seed if isinstance(self.place, str) else 0
        return self.world_seeds or (usual,)

    def about(self) -> dict[str, Any]:
        """What config.yaml says of the rivers, as plain data; raises `WorldError` for an unknown level or no file."""
        place = self.place
        named = {"river": place.as_data()} if isinstance(place, Reach) else {"level": level_named(place).name}
        return {**named, "world_seeds": list(self.seeds)}

    def worlds(self) -> list[World]:
        """The rivers, built or from the cache folder; it is said on the terminal what takes a while."""
        place = self.place if isinstance(self.place, Reach) else level_named(self.place)
        for seed in self.seeds:
            announce(place, seed)
        if isinstance(place, Reach):
            return [place.build(seed) for seed in self.seeds]
        return [load_or_build(place, seed) for seed in self.seeds]

    def train(
        self,
        algorithm: str,
        encoder: Encoder,
        *,
        steps: int,
        seed: int,
        folder: Path,
        settings: dict | None = None,
        preset: str = "default",
        threads: int | None = None,
        device: str = "cpu",
        begin_with: Path | None = None,
        graphs: bool = False,
    ) -> RunResult:
        """Train with a progress bar, going on from what lies in the folder.

        On the CPU the environments are Gymnasium's, on a GPU those of tensors; the encoder must be on the device.
        `threads` are those of acting and learning; as many as pay and were asked for if not given. `begin_with` and
        `graphs`: see `thalweg.train.run`.

        Raises the errors of `thalweg.train.run`, those of settings and of a folder that is no run on this river before
        a world is built.
        """
        entry = algorithm_named(algorithm)
        entry.configure(settings, preset, self.num_envs)
        context = {
            **self.about(),
            "encoder": mark(encoder),
            "render_version": RENDER_VERSION,
            "env": asdict(self.config),
        }
        check_same_file(folder, context)
        if begin_with is not None:
            check_sees_as_trained(load_policy(begin_with), encoder)
        place = resolve_device(device)
        env = self._seen_through(encoder, place)
        try:
            return run(
                entry.name,
                env,
                steps=steps,
                seed=seed,
                folder=folder,
                config=settings,
                preset=preset,
                context=context,
                progress=True,
                threads=min(entry.threads, default_torch_threads()) if threads is None else threads,
                device=place,
                begin_with=begin_with,
                graphs=graphs,
            )
        finally:
            env.close()

    def _seen_through(self, encoder: Encoder, device: str) -> Any:
        """The environments on a device, whose observations are codes."""
        if device == "cpu":
            return LatentVectorEnv(RiverVectorEnv(self.worlds(), self.num_envs, self.config), encoder)
        from thalweg.env.torch_env import TensorRiverEnv

        return LatentTensorEnv(TensorRiverEnv(self.worlds(), self.num_envs, self.config, device=device), encoder)
