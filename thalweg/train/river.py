"""Training on the river task: worlds, what the policy sees of them, and an algorithm.

Other environments are passed to `thalweg.train.run` directly, which does not depend on rivers.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, Unpack, cast, get_args

from thalweg.algos.policy.policy import OptionCopy
from thalweg.algos.registry import algorithm_named
from thalweg.core import versions
from thalweg.core.cache import is_stored
from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.torch_threads import default_torch_threads
from thalweg.core.notices import notice
from thalweg.core.seeds import compact_seeds, parse_seeds, refuse_unseen
from thalweg.encoder import Encoder, PluginEncoder, check_render_version, encoder_plugin, load_encoder
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.assignment import DrawnRivers
from thalweg.env.rivers.memory import bytes_of, check_all_fit, drawn_bytes
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.tasks import task_plugin
from thalweg.render import RENDER_VERSION, compilation
from thalweg.train.encoder_of_run import check_camera_fits, file_of_its_own, tell_other_optics
from thalweg.train.errors import TrainingError
from thalweg.train.fast_steps import fast_step_in_words, fast_step_of
from thalweg.train.folder.run_record import RUN_FOLDER, TASK_PLUGIN, read_context
from thalweg.train.latent import LatentTensorEnv, LatentVectorEnv
from thalweg.train.numbers import NumbersTensorEnv, NumbersVectorEnv
from thalweg.train.observations import (
    FELT,
    IMAGES,
    PRIVILEGED,
    TAUGHT,
    check_parts,
    check_policy_fits,
    encoder_hash,
    is_taught,
    observation_of_run,
    parts_of_codes,
)
from thalweg.train.run import CommonExecution, Execution, configured, has_asymmetric_critics, run, sees_images
from thalweg.train.run_in_folder import RunResult, check_numbers, load_policy
from thalweg.world import Level, Reach, World, level_named, load_or_build
from thalweg.world.generate.memory import free_bytes
from thalweg.world.store.world_cache import cache_path


def load_compatible_encoder(path: str | Path | None = None, device: str = "cpu") -> Encoder:
    """Load an encoder that was trained on frames of this version of the renderer, and start compiling the renderer.

    `path` is that of its file or of the folder of its run, or the name of one that comes with the package, or is a
    plug-in; None: `default`.

    Raises `EncoderFileError` or `EncoderInputError` for another one, and `PluginError` for a plug-in that is broken.
    """
    if path is not None and (plugin := encoder_plugin(str(path))) is not None:
        encoder: Encoder = PluginEncoder(plugin, resolve_device(device))
    else:
        encoder = load_encoder(path, device=resolve_device(device))
        check_render_version(encoder, RENDER_VERSION)
    # Only who has an encoder looks at frames: baselines compile no renderer.
    if encoder.device.type == "cpu":
        compilation.begin()
    return encoder


def announce_build(level: Level | Reach, seed: int) -> None:
    """Print a line if the river of a level or a file and a seed is not cached."""
    if not (level.is_cached(seed) if isinstance(level, Reach) else is_stored(cache_path(level, seed))):
        print_once(f"building the river {level.name}, seed {seed}: a few seconds")


@cache
def print_once(line: str) -> None:
    """Print each line once, as a notice."""
    notice(line)


def banks_version(grounds: Iterable[Level | Reach]) -> dict[str, int]:
    """Return what records say of the kinds of banks of some rivers: their version, or nothing where all are forest.

    Raises `WorldError` for a file from which no river can be made.
    """
    others = any(ground.has_banks if isinstance(ground, Reach) else ground.banks for ground in grounds)
    return {"banks_version": versions.BANKS} if others else {}


RiverChange = Literal["auto", "fixed", "episode"]


class RiverExecution(CommonExecution, total=False):
    """Keyword arguments of `RiverTraining.train` for how and where it executes, and with which policy it starts."""

    threads: int | None


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
        in_memory = 1 if self.rivers_in_memory is None else self.rivers_in_memory
        count, in_memory = check_numbers(num_envs=(self.num_envs, 1), rivers_in_memory=(in_memory, 1))
        object.__setattr__(self, "num_envs", count)
        if self.rivers_in_memory is not None:
            object.__setattr__(self, "rivers_in_memory", in_memory)
        object.__setattr__(self, "world_seeds", parse_seeds(self.world_seeds, "world_seeds", TrainingError))
        if not isinstance(self.river, str | Reach):
            object.__setattr__(self, "river", tuple(self.river))
            names = [level.name for level in self.levels]
            if not names or len(set(names)) < len(names):
                raise TrainingError(f"levels must be at least one, each once, not {', '.join(names) or 'none'}")
        if not isinstance(self.river, Reach):
            refuse_unseen(self.seeds, "world_seeds", TrainingError)
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
    def grounds(self) -> Sequence[Level | Reach]:
        """The levels, or the real river."""
        return [self.river] if isinstance(self.river, Reach) else self.levels

    @property
    def listed(self) -> list[tuple[Level | Reach, int]]:
        """The rivers by level, or real river, and seed."""
        return [(ground, seed) for ground in self.grounds for seed in self.seeds]

    def about(self) -> dict[str, Any]:
        """Return what config.yaml says about the rivers, as plain data.

        Raises `WorldError` for an unknown level, and for a file from which no river can be made.
        """
        names = [level.name for level in self.levels]
        if isinstance(self.river, Reach):
            ground: dict[str, Any] = {"river": self.river.as_data()}
        else:
            ground = {"level": names[0]} if len(names) == 1 else {"levels": names}
        ground |= banks_version(self.grounds)
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
        proprioception: bool = False,
        settings: dict | None = None,
        preset: str = "default",
        **execution: Unpack[RiverExecution],
    ) -> RunResult:
        """Train with a progress bar, or resume the run in the folder.

        The policy sees the codes of the encoder, or for None the privileged observation, or with the setting policy=cnn
        images: `observation` says which of `IMAGES`, by default those of the policy to begin with, or `rgb+mask`. With
        `proprioception`, also if the config observes it, a policy of codes or of the privileged observation takes that
        beside them. On the CPU the environments are those of Gymnasium, on a GPU those of tensors; the encoder must be
        on the device. `threads` is for acting and learning; by default as many as the algorithm benefits from, within
        OMP_NUM_THREADS. For `begin_with` and `graphs`, see `thalweg.train.run`.

        Raises the errors of `thalweg.train.run`; those of settings, and of a folder that does not hold a run on this
        river, before a world is built.
        """
        if unknown := sorted(execution.keys() - RiverExecution.__annotations__):
            raise TypeError(f"train() got an unexpected keyword argument {unknown[0]!r}")
        threads = execution.pop("threads", None)
        common = cast(CommonExecution, execution)
        how = Execution(**common)
        entry = algorithm_named(algorithm)
        resolved = configured(entry, settings, preset, self.num_envs, how.begin_with)
        if getattr(resolved, "separate_costs", False) and len(self.config.cost_kinds) > 2:
            raise TrainingError(
                "cost_limits are limits of tight and loose costs, but this task has also"
                f" {', '.join(self.config.cost_kinds[2:])}: set cost_limit, that of their sum"
            )
        begun, copied = self._begun(how.begin_with)
        seen = observation_of_run(sees_images(resolved), encoder, observation, begun)
        felt = proprioception or "proprioception" in self.config.parts
        check_parts(seen, felt, self.config.observation)
        taught: dict[str, Any] = {TAUGHT: True} if is_taught(begun) else {}
        context = self._context(seen, encoder, felt) | taught
        RUN_FOLDER.require_same_file(folder, read_context(folder).get("river") or {}, context.get("river", {}))
        self._check_fits(begun, encoder, seen, felt)
        device = resolve_device(how.device)
        if seen in IMAGES and device != "cpu":
            raise TrainingError(f"policy=cnn learns on the CPU only, not on {device}: leave the device out")
        told = has_asymmetric_critics(resolved)
        env = self._envs(encoder, device, seen=seen, critic_info=told, proprioception=felt)
        if seen in IMAGES:
            compilation.begin()
        if threads is None:
            threads = default_torch_threads() if seen in IMAGES else min(entry.threads, default_torch_threads())
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
                threads=threads,
                copied_option=copied,
                **common,
            )
        finally:
            env.close()

    def _begun(self, begin_with: str | Path | None) -> tuple[Any, OptionCopy | None]:
        """Return the policy that a run begins with, None for none, and which option of it becomes a fast step, which is
        told; raises the errors of `load_policy` and `fast_step_of`."""
        if begin_with is None:
            return None, None
        begun = load_policy(begin_with)
        if (copied := fast_step_of(begun, self.config.task)) is not None:
            notice(fast_step_in_words(begun, self.config.task))
        return begun, copied

    def _check_fits(self, begun: Any, encoder: Encoder | None, seen: str, felt: bool) -> None:
        """Raise the errors of `check_policy_fits` for the policy to begin with, None for none, and of
        `check_camera_fits` for the encoder; an encoder of other optics is told."""
        rules = self.config
        if begun is not None:
            of = {"task": rules.task, "vehicle": rules.vehicle, "action": rules.action}
            check_policy_fits(begun, encoder, offered=seen, proprioception=felt, **of)
        if encoder is not None:
            check_camera_fits(rules.camera, encoder)
            tell_other_optics(rules.camera, encoder)

    def _context(self, seen: str, encoder: Encoder | None, felt: bool = False) -> dict[str, Any]:
        """Return what the policy file and config.yaml say about rivers, observation and rules; `felt`: whether the
        policy takes proprioception."""
        if encoder is not None:
            about: dict[str, Any] = {
                "encoder": encoder_hash(encoder),
                **file_of_its_own(encoder),
                "render_version": RENDER_VERSION,
            }
        elif seen in IMAGES:
            about = {"observation": seen, "render_version": RENDER_VERSION}
        else:
            about = {"observation": seen, "privileged_version": versions.PRIVILEGED}
        if felt:
            about[FELT] = versions.PROPRIOCEPTION
        if self.config.task != "River":
            about["tasks_version"] = versions.TASKS
        if (plugin := task_plugin(self.config.task)) is not None:
            about[TASK_PLUGIN] = plugin.as_data()
        if self.config.task_record.props and seen != PRIVILEGED:
            about["props_version"] = versions.PROPS
        if self.config.has_forces:
            about["forces_version"] = versions.FORCES
        if self.config.vehicle != "uav" and seen == PRIVILEGED:
            about["vehicles_version"] = versions.VEHICLES
        config = self.config if encoder is not None and not felt else self._config_of(seen, encoder, felt)
        return {**self.about(), **about, "env": config.as_data()}

    def _config_of(self, seen: str, encoder: Encoder | None, felt: bool) -> EnvConfig:
        """Return the config with what a policy sees and takes as its observation; nothing else is drawn."""
        if felt:
            parts = (seen,) if encoder is None else parts_of_codes(encoder)
            return self.config.with_options(observation=(*parts, "proprioception"))
        return (
            self.config.with_options(observation=seen) if encoder is None else self.config.seen_through(encoder.inputs)
        )

    def _envs(
        self,
        encoder: Encoder | None,
        device: str,
        *,
        seen: str = PRIVILEGED,
        critic_info: bool = False,
        proprioception: bool = False,
    ) -> Any:
        """Return the environments on a device, with codes of the encoder, or without one with what is `seen`; nothing
        else is drawn. `critic_info` replaces that of the config: it is for training, and no part of the task."""
        config = self._config_of(seen, encoder, proprioception).with_options(critic_info=critic_info)
        if device == "cpu":
            env = self._vector_env(config)
            if encoder is not None:
                return LatentVectorEnv(env, encoder)
            return NumbersVectorEnv(env) if proprioception else env
        if self.changes_river:
            raise TrainingError(
                f"on a GPU, rivers do not change: {len(self.listed)} rivers for {self.num_envs} environments; give as"
                " many environments, or fewer seeds"
            )
        from thalweg.env.torch_env import TensorRiverEnv

        tensors = TensorRiverEnv(self.worlds(drawn=config.channels > 0), self.num_envs, config, device=device)
        if encoder is not None:
            return LatentTensorEnv(tensors, encoder)
        return NumbersTensorEnv(tensors) if proprioception else tensors

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
