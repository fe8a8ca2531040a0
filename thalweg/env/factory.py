"""What do the Gymnasium ids make? The environments of a level from keyword arguments; unknown ones list the known."""

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from gymnasium.vector import AutoresetMode

from thalweg.env.config import DEFAULT_CONFIG, ConfigError, EnvConfig, refuse_unknown, whole
from thalweg.env.env import RiverEnv
from thalweg.env.vector_env import RiverVectorEnv
from thalweg.world.record import World

if TYPE_CHECKING:
    from thalweg.env.torch_env import TensorRiverEnv


def make_single(
    level: str,
    *,
    world: World | None = None,
    world_seed: int | None = None,
    renderer: Any = None,
    render_mode: str | None = None,
    config: EnvConfig = DEFAULT_CONFIG,
    **options: Any,
) -> RiverEnv:
    """One environment in a river of the level, its fixed one or that of `world_seed`, or in a `world` of one's own.

    Further options are fields of `EnvConfig`.
    """
    config = _with_options(config, options, ("world", "world_seed", "renderer", "render_mode", "config"))
    _begin_compiling(config)
    seeds = None if world_seed is None else [whole("world_seed", world_seed, 0)]
    worlds = _worlds(level, None if world is None else [world], seeds)
    return RiverEnv(worlds[0], config, renderer=renderer, render_mode=render_mode)


def make_vector(
    level: str,
    num_envs: int = 1,
    *,
    worlds: World | Sequence[World] | None = None,
    world_seeds: Sequence[int] | None = None,
    renderer: Any = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
    render_mode: str | None = None,
    config: EnvConfig = DEFAULT_CONFIG,
    **options: Any,
) -> RiverVectorEnv:
    """N environments in rivers of the level, its fixed one or those of `world_seeds`, or in `worlds` of one's own.

    Further options are fields of `EnvConfig`.
    """
    own = ("num_envs", "worlds", "world_seeds", "renderer", "autoreset_mode", "render_mode", "config")
    config = _with_options(config, options, own)
    _begin_compiling(config)
    given = [worlds] if isinstance(worlds, World) else worlds
    return RiverVectorEnv(
        _worlds(level, given, None if world_seeds is None else _seeds(world_seeds)),
        num_envs,
        config,
        renderer=renderer,
        autoreset_mode=autoreset_mode,
        render_mode=render_mode,
    )


def make_tensors(
    level: str,
    num_envs: int = 1,
    *,
    worlds: World | Sequence[World] | None = None,
    world_seeds: Sequence[int] | None = None,
    device: str = "auto",
    config: EnvConfig = DEFAULT_CONFIG,
    **options: Any,
) -> "TensorRiverEnv":
    """As `make_vector`, of tensors on one device; `thalweg.make_torch` calls it."""
    from thalweg.core.device import resolve_device
    from thalweg.env.torch_env import TensorRiverEnv

    own = ("num_envs", "worlds", "world_seeds", "device", "config")
    config, device = _with_options(config, options, own), resolve_device(device)
    if device == "cpu":
        _begin_compiling(config)
    given = [worlds] if isinstance(worlds, World) else worlds
    rivers = _worlds(level, given, None if world_seeds is None else _seeds(world_seeds))
    return TensorRiverEnv(rivers, num_envs, config, device=device)


make_single.metadata = RiverEnv.metadata  # pyright: ignore[reportFunctionMemberAccess]


def _with_options(config: EnvConfig, options: dict[str, Any], own: Sequence[str]) -> EnvConfig:
    """The config with some fields changed; raises `ConfigError` for an unknown option."""
    refuse_unknown("option", options, [*own, *(field.name for field in fields(config))])
    return config.with_options(**options)


def _begin_compiling(config: EnvConfig) -> None:
    """Let the frames' kernel be compiled while the worlds are built, on a first start."""
    if config.observation != "none":
        from thalweg.render import compilation

        compilation.begin()


def _worlds(level: str, worlds: Sequence[World] | None, seeds: Sequence[int] | None) -> Sequence[World]:
    """The given worlds, or those of the level from some checked seeds, or its fixed one."""
    if worlds is not None:
        if seeds is not None:
            raise ConfigError("give either worlds or seeds of worlds, not both")
        return list(worlds)
    if not isinstance(level, str):
        raise ConfigError(f"level must be a name, not {level!r}")
    from thalweg.world import load_or_build
    from thalweg.world.levels import level_named

    if seeds is None:
        seeds = [level_named(level).default_seed]
    return [load_or_build(level, seed) for seed in seeds]


def _seeds(given: Sequence[int]) -> list[int]:
    """Seeds of worlds as whole numbers; raises `ConfigError` for anything else."""
    if isinstance(given, str) or not hasattr(given, "__iter__"):
        raise ConfigError(f"world_seeds must be a list of whole numbers, not {given!r}")
    seeds = [whole("each of world_seeds", seed, 0) for seed in given]
    if not seeds:
        raise ConfigError("world_seeds needs at least one seed")
    return seeds
