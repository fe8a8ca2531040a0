"""Training on the river task: worlds, what the policy sees of them, and an algorithm.

Other environments are passed to `thalweg.train.run` directly, which does not depend on rivers.
"""

import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

from thalweg.algos.policy.actions import Actions
from thalweg.algos.registry import algorithm_named
from thalweg.core import versions
from thalweg.core.cache import file_hash
from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.torch_threads import default_torch_threads
from thalweg.core.seeds import compact_seeds, parse_seeds
from thalweg.encoder import Encoder, check_render_version, load_encoder
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.env.rivers.assignment import DrawnRivers
from thalweg.env.rivers.memory import bytes_of, check_all_fit, drawn_bytes
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import CHANNELS
from thalweg.env.task.priced.eye import features_of
from thalweg.render import RENDER_VERSION, compilation
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import RUN_FOLDER, read_config
from thalweg.train.latent import LatentTensorEnv, LatentVectorEnv
from thalweg.train.run import configured, has_asymmetric_critics, run, sees_images
from thalweg.train.run_in_folder import RunResult, load_policy
from thalweg.world import Level, Reach, World, level_named, load_or_build
from thalweg.world.generate.memory import free_bytes
from thalweg.world.store.world_cache import cache_path

BRANCHES = (3, 3, 3, 3)
"""Number of options of each branch of an action: vertical, yaw, longitudinal, lateral."""
FRAMES, PRIVILEGED, IMAGES = "frames", "privileged", tuple(CHANNELS)
"""What a policy of the river task sees: frames through an encoder, the privileged observation, which draws nothing
(`thalweg.env.task.ideal_eye`), or, with convolutions of its own, images: `rgb+mask`, `rgb` or `mask`."""
IN_WORDS = {FRAMES: "frames through an encoder", PRIVILEGED: "the privileged observation"} | {
    channels: f"images ({channels})" for channels in IMAGES
}
SEEN_BY_CRITICS = {True: "the privileged state and progress too", False: "what the policy sees"}
"""What critics see in training, by whether they are asymmetric."""


def load_compatible_encoder(path: Path | None = None, device: str = "cpu") -> Encoder:
    """Load an encoder that was trained on frames of this version of the renderer, and start compiling the renderer.

    Raises `EncoderFileError` or `EncoderInputError` for another one.
    """
    encoder = load_encoder(path, device=resolve_device(device))
    check_render_version(encoder, RENDER_VERSION)
    # Only who has an encoder looks at frames: baselines compile no renderer.
    if encoder.device.type == "cpu":
        compilation.begin()
    return encoder


def encoder_hash(encoder: Encoder) -> str:
    """Return the hash of the encoder's file, which identifies it."""
    return file_hash(Path(encoder.about["path"]))


def observation_of(policy: Any) -> str:
    """Return what a policy was trained on: `FRAMES`, `PRIVILEGED` or one of `IMAGES`.

    A policy that does not say it sees frames: files of earlier versions knew nothing else. Raises `TrainingError` for
    any other observation, and for a policy with convolutions that does not say which images it sees.
    """
    found = _context_of(policy).get("observation", FRAMES)
    if found not in (FRAMES, PRIVILEGED, *IMAGES):
        raise TrainingError(
            f"the policy was trained on the observation {found!r}; on rivers policies see {FRAMES}, {PRIVILEGED},"
            f" {', '.join(IMAGES)}"
        )
    if _image_of(policy) is not None and found not in IMAGES:
        raise TrainingError(
            f"the policy takes images, but does not say which: its context has the observation {found!r} instead of one"
            f" of {', '.join(IMAGES)}"
        )
    return found


def task_of(policy: Any) -> str:
    """Return the task that a policy was trained on, that of the paper if it does not say it."""
    return _context_of(policy).get("env", {}).get("task", "River")


def check_policy_fits(
    policy: Any, encoder: Encoder | None, *, offered: str | None = None, task: str = "River", vehicle: str = "uav"
) -> None:
    """Raise `TrainingError` unless a policy fits an observation and the actions of the river task.

    The observation is the codes of the encoder. For None it is `offered`, by default images for a policy of images, and
    the privileged observation, which differs by `task` and `vehicle`, for any other. A policy without spaces, such as a
    baseline, always fits. The vehicle must be the one that the policy was trained for.
    """
    context, seen = _context_of(policy), observation_of(policy)
    if encoder is not None:
        offered = FRAMES
    elif offered is None:
        offered = seen if seen in IMAGES else PRIVILEGED
    if seen != offered and ("observation" in context or "encoder" in context):
        raise TrainingError(
            f"the policy was trained on {IN_WORDS[seen]}, but here it would see {IN_WORDS[offered]};"
            f" choose {IN_WORDS[seen]}, or another policy"
        )
    _check_versions(seen, context)
    trained_for = context.get("env", {}).get("vehicle", "uav")
    if context and trained_for != vehicle:
        raise TrainingError(f"the policy was trained for the vehicle {trained_for}, not {vehicle}")
    _check_inputs(policy, offered, encoder, (task, vehicle))
    actions: Actions | None = getattr(policy, "actions", None)
    if actions is not None and (actions.sizes, actions.start, actions.shape) != (BRANCHES, (0, 0, 0, 0), (4,)):
        found = f"{actions.sizes} from {actions.start}" if actions.sizes else f"a Box of shape {actions.shape}"
        raise TrainingError(f"the river task takes four branches of 3 options, counted from 0, not {found}")
    trained_with = context.get("encoder")
    if encoder is not None and trained_with is not None and trained_with != (current := encoder_hash(encoder)):
        raise TrainingError(
            f"the policy was trained on the codes of encoder {trained_with}, but this is encoder {current};"
            " use the encoder that it was trained with"
        )


def _check_versions(seen: str, context: dict[str, Any]) -> None:
    """Raise `TrainingError` if what a policy sees was of another version in its training."""
    made_with = context.get("privileged_version", 1)
    if seen == PRIVILEGED and made_with != versions.PRIVILEGED:
        raise TrainingError(
            f"the policy was trained on version {made_with} of the privileged observation, but this is version"
            f" {versions.PRIVILEGED}; train it again"
        )
    for name, kept in (("tasks", versions.TASKS), ("vehicles", versions.VEHICLES)):
        trained_on = context.get(f"{name}_version", kept)
        if trained_on != kept:
            raise TrainingError(
                f"the policy was trained on version {trained_on} of the {name}, but this is version {kept}; train it"
                " again"
            )
    drawn_with = context.get("render_version")
    if seen in IMAGES and drawn_with != RENDER_VERSION:
        raise TrainingError(
            f"the policy was trained on images of renderer version {drawn_with}, but the renderer is version"
            f" {RENDER_VERSION}; train it again"
        )


def _check_inputs(policy: Any, offered: str, encoder: Encoder | None, of: tuple[str, str]) -> None:
    """Raise `TrainingError` unless a policy takes as many numbers, or images of the shape, that it is offered."""
    if offered in IMAGES:
        camera = DEFAULT_CONFIG.camera
        needed = (camera.height_px, camera.width_px, CHANNELS[offered])
        offers = f"{IN_WORDS[offered]} have the shape"
    elif encoder is None:
        of_task = "" if of[0] == "River" else f" of the task {of[0]}"
        needed, offers = len(features_of(*of)), f"privileged observation{of_task} has"
    else:
        needed, offers = encoder.latent, "encoder returns"
    takes = _image_of(policy) or getattr(policy, "obs_size", needed)
    if takes != needed:
        found = f"images of the shape {takes}" if _image_of(policy) else f"{takes} numbers"
        raise TrainingError(f"the policy takes {found}, but the {offers} {needed}")


def _image_of(policy: Any) -> tuple[int, int, int] | None:
    """Return H, W, C of the images that a policy with convolutions takes; None for any other."""
    eyes = getattr(getattr(policy, "shape", None), "eyes", None)
    return None if eyes is None else eyes.image


def _context_of(policy: Any) -> dict[str, Any]:
    """Return the context in which a policy was trained; empty for one that was not."""
    return getattr(getattr(policy, "about", None), "context", {})


def observation_of_run(images: bool, encoder: Encoder | None, chosen: str | None, begun: Any = None) -> str:
    """Return what the policy of a run sees: `FRAMES`, `PRIVILEGED` or one of `IMAGES`.

    `images` is whether it has convolutions, `chosen` the observation that was asked for, if any, `begun` the policy
    that the run begins with. Raises `TrainingError` for what does not go together.
    """
    if not images:
        expected = PRIVILEGED if encoder is None else FRAMES
        if chosen in IMAGES:
            raise TrainingError(f"the observation {chosen} is for policies with convolutions: set policy=cnn")
        if chosen is not None and chosen != expected:
            raise TrainingError(f"the observation {chosen} was asked for, but there is {IN_WORDS[expected]}")
        return expected
    if encoder is not None:
        raise TrainingError("policy=cnn sees images itself: leave the encoder out, or use policy=mlp")
    if chosen is None:
        found = FRAMES if begun is None else observation_of(begun)
        chosen = found if found in IMAGES else IMAGES[0]
    if chosen not in IMAGES:
        raise TrainingError(f"policy=cnn sees images, {' or '.join(IMAGES)}, not {IN_WORDS.get(chosen, chosen)}")
    return chosen


def announce_build(level: Level | Reach, seed: int) -> None:
    """Print a line if the river of a level or a file and a seed is not cached."""
    if isinstance(level, Reach) or not cache_path(level, seed).is_file():
        print_once(f"building the river {level.name}, seed {seed}: a few seconds")


@cache
def print_once(line: str) -> None:
    """Print each line once, to stderr: stdout is for results."""
    print(line, file=sys.stderr, flush=True)


RiverChange = Literal["auto", "fixed", "episode"]


@dataclass(frozen=True)
class RiverTraining:
    """Rivers and environments in which a policy is trained."""

    river: str | Reach | tuple[str, ...]
    """Name of a level, or a real river; or several levels, whose rivers are listed one level after another."""
    num_envs: int
    world_seeds: tuple[int, ...] = ()
    """Seeds of rivers of each level, by default that of its fixed one; for a real river, of its plants and hills. A
    `range`, or texts such as "0 5 1000:1016", are converted."""
    config: EnvConfig = field(default_factory=EnvConfig)
    """Rules and camera."""
    rivers: RiverChange = "auto"
    """`fixed`: environment i stays in river i, or i modulo their number; `episode`: each episode is flown in a random
    one; `auto`: `episode` if there are more rivers than environments, which could not all be flown otherwise."""
    rivers_in_memory: int | None = None
    """Greatest number of rivers in memory, if they change; None derives it from the free memory."""

    def __post_init__(self) -> None:
        if self.num_envs < 1:
            raise TrainingError(f"num_envs must be at least 1, not {self.num_envs}")
        object.__setattr__(self, "world_seeds", parse_seeds(self.world_seeds, "world_seeds", TrainingError))
        if not isinstance(self.river, str | Reach):
            object.__setattr__(self, "river", tuple(self.river))
            names = [level.name for level in self.levels]
            if not names or len(set(names)) < len(names):
                raise TrainingError(f"levels must be at least one, each once, not {', '.join(names) or 'none'}")
        if self.rivers not in get_args(RiverChange):
            raise TrainingError(f"rivers must be one of {', '.join(get_args(RiverChange))}, not {self.rivers!r}")
        if self.rivers_in_memory is not None and not self.changes_river:
            raise TrainingError("rivers_in_memory is for rivers that change with each episode; these are fixed")
        if self.rivers == "fixed" and len(self.listed) > self.num_envs:
            raise TrainingError(
                f"of {len(self.listed):,} fixed rivers, {self.num_envs} environments would fly in {self.num_envs} only;"
                " give as many environments, fewer seeds, or rivers=episode"
            )
        if self.changes_river and isinstance(self.river, Reach):
            raise TrainingError(
                f"{len(self.seeds)} seeds of {self.river.name} for {self.num_envs} environments: the seeds of a"
                " real river change its plants and hills, not its course; give at most one for each environment"
            )

    @property
    def changes_river(self) -> bool:
        """Whether each episode is flown in a random river."""
        return self.rivers == "episode" or (self.rivers == "auto" and len(self.listed) > self.num_envs)

    @property
    def levels(self) -> list[Level]:
        """Levels whose rivers are listed; empty for a real river. Raises `WorldError` for an unknown one."""
        names = (self.river,) if isinstance(self.river, str) else self.river
        return [] if isinstance(names, Reach) else [level_named(name) for name in names]

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the rivers of each level."""
        return self.world_seeds or (self.levels[0].default_seed if self.levels else 0,)

    @property
    def listed(self) -> list[tuple[Level | Reach, int]]:
        """The rivers by level, or real river, and seed."""
        grounds = [self.river] if isinstance(self.river, Reach) else self.levels
        return [(ground, seed) for ground in grounds for seed in self.seeds]

    def about(self) -> dict[str, Any]:
        """Return what config.yaml says about the rivers, as plain data.

        Raises `WorldError` for an unknown level or a missing file.
        """
        names = [level.name for level in self.levels]
        if isinstance(self.river, Reach):
            ground: dict[str, Any] = {"river": self.river.as_data()}
        else:
            ground = {"level": names[0]} if len(names) == 1 else {"levels": names}
        if self.changes_river:
            return {**ground, "world_seeds": compact_seeds(self.seeds), "rivers": "episode"}
        return {**ground, "world_seeds": list(self.seeds)}

    def worlds(self, *, drawn: bool = True) -> list[World]:
        """Return the rivers, built or loaded from the cache; a build is announced on the terminal, and so is the memory
        of the host that several of them take, more if they are `drawn`.

        Raises `WorldError` for a file from which no river can be made, before anything is announced, and `ConfigError`
        for more rivers than fit into the memory, once the first one is there.
        """
        if isinstance(self.river, Reach):
            self.river.check()
        found: list[World] = []
        for ground, seed in self.listed:
            announce_build(ground, seed)
            found.append(ground.build(seed) if isinstance(ground, Reach) else load_or_build(ground, seed))
            if len(found) == 1 and (count := len(self.listed)) > 1:
                each = drawn_bytes(found[0]) if drawn else bytes_of(found[0])
                check_all_fit(count, each, free_bytes())
                print_once(f"{count:,} rivers, all of them in memory, {count * each / 1e6:,.1f} MB")
        return found

    def train(
        self,
        algorithm: str,
        encoder: Encoder | None,
        *,
        steps: int,
        seed: int,
        folder: Path,
        observation: str | None = None,
        settings: dict | None = None,
        preset: str = "default",
        threads: int | None = None,
        device: str = "cpu",
        begin_with: Path | None = None,
        graphs: bool = False,
    ) -> RunResult:
        """Train with a progress bar, or resume the run in the folder.

        The policy sees the codes of the encoder, or for None the privileged observation, or with the setting policy=cnn
        images: `observation` says which of `IMAGES`, by default those of the policy to begin with, or `rgb+mask`. On
        the CPU the environments are those of Gymnasium, on a GPU those of tensors; the encoder must be on the device.
        `threads` is for acting and learning; by default as many as the algorithm benefits from, within OMP_NUM_THREADS.
        For `begin_with` and `graphs`, see `thalweg.train.run`.

        Raises the errors of `thalweg.train.run`; those of settings, and of a folder that does not hold a run on this
        river, before a world is built.
        """
        entry = algorithm_named(algorithm)
        resolved = configured(entry, settings, preset, self.num_envs, begin_with)
        if getattr(resolved, "separate_costs", False) and len(self.config.cost_kinds) > 2:
            raise TrainingError(
                "cost_limits are limits of tight and loose costs, but this task has also"
                f" {', '.join(self.config.cost_kinds[2:])}: set cost_limit, that of their sum"
            )
        begun = None if begin_with is None else load_policy(begin_with)
        seen = observation_of_run(sees_images(resolved), encoder, observation, begun)
        context = self._context(seen, encoder)
        existing = (read_config(folder) or {"run": {}})["run"].get("context", {})
        RUN_FOLDER.require_same_file(folder, existing.get("river", {}), context.get("river", {}))
        if begun is not None:
            rules = self.config
            check_policy_fits(begun, encoder, offered=seen, task=rules.task, vehicle=rules.vehicle)
        device = resolve_device(device)
        if seen in IMAGES and device != "cpu":
            raise TrainingError(f"policy=cnn learns on the CPU only, not on {device}: leave the device out")
        env = self._envs(encoder, device, seen=seen, critic_info=has_asymmetric_critics(resolved))
        if seen in IMAGES:
            compilation.begin()
        learning_threads = default_torch_threads() if seen in IMAGES else min(entry.threads, default_torch_threads())
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
                threads=learning_threads if threads is None else threads,
                device=device,
                begin_with=begin_with,
                graphs=graphs,
            )
        finally:
            env.close()

    def _context(self, seen: str, encoder: Encoder | None) -> dict[str, Any]:
        """Return what the policy file and config.yaml say about rivers, observation and rules."""
        tasks = {} if self.config.task == "River" else {"tasks_version": versions.TASKS}
        if encoder is not None:
            codes = {"encoder": encoder_hash(encoder), "render_version": RENDER_VERSION}
            return {**self.about(), **codes, **tasks, "env": self.config.as_data()}
        version = {"privileged_version": versions.PRIVILEGED}
        if seen in IMAGES:
            version = {"render_version": RENDER_VERSION}
        elif self.config.vehicle != "uav":
            version["vehicles_version"] = versions.VEHICLES
        return {**self.about(), "observation": seen, **version, **tasks, "env": self._config_of(seen).as_data()}

    def _config_of(self, seen: str) -> EnvConfig:
        return self.config.with_options(observation=seen)

    def _envs(self, encoder: Encoder | None, device: str, *, seen: str = PRIVILEGED, critic_info: bool = False) -> Any:
        """Return the environments on a device, with codes of the encoder, or without one with what is `seen`; nothing
        else is drawn. `critic_info` replaces that of the config: it is for training, and no part of the task."""
        config = self._config_of(seen) if encoder is None else self.config.seen_through(encoder.inputs)
        config = config.with_options(critic_info=critic_info)
        if device == "cpu":
            env = self._vector_env(config)
            return env if encoder is None else LatentVectorEnv(env, encoder)
        if self.changes_river:
            raise TrainingError(
                f"on a GPU, rivers do not change: {len(self.listed)} rivers for {self.num_envs} environments; give as"
                " many environments, or fewer seeds"
            )
        from thalweg.env.torch_env import TensorRiverEnv

        tensors = TensorRiverEnv(self.worlds(drawn=config.channels > 0), self.num_envs, config, device=device)
        return tensors if encoder is None else LatentTensorEnv(tensors, encoder)

    def _vector_env(self, config: EnvConfig) -> RiverVectorEnv:
        """Return the environments on the CPU; says how many rivers are in memory if they change."""
        levels = self.levels
        if not levels or (config.channels and not self.changes_river):
            return RiverVectorEnv(self.worlds(drawn=config.channels > 0), self.num_envs, config)
        rivers = RiverList.of_levels([(level, self.seeds) for level in levels], self.rivers_in_memory)
        if not self.changes_river:
            # Where nothing is drawn, rivers need no land, which takes most of the time to build.
            bare = rivers.course if config.vehicle == "uav" else rivers.sounded
            return RiverVectorEnv([bare(river) for river in range(len(rivers))], self.num_envs, config)
        env = RiverVectorEnv(rivers, self.num_envs, config)
        if isinstance(env.rivers, DrawnRivers):
            print_once(env.rivers.pool.description)
        return env
