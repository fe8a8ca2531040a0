"""What do the Gymnasium ids make? The environments of a level from keyword arguments; unknown ones list the known."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from gymnasium.vector import AutoresetMode

from thalweg.env.config import DEFAULT_CONFIG, ConfigError, EnvConfig
from thalweg.env.single import RiverEnv
from thalweg.env.vector import RiverVectorEnv
from thalweg.world.record import World


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
    worlds = _worlds(level, None if world is None else [world], None if world_seed is None else [world_seed])
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
    given = [worlds] if isinstance(worlds, World) else worlds
    return RiverVectorEnv(
        _worlds(level, given, world_seeds),
        num_envs,
        config,
        renderer=renderer,
        autoreset_mode=autoreset_mode,
        render_mode=render_mode,
    )


make_single.metadata = RiverEnv.metadata  # pyright: ignore[reportFunctionMemberAccess]


def _with_options(config: EnvConfig, options: dict[str, Any], own: Sequence[str]) -> EnvConfig:
    """The config with some fields changed; raises `ConfigError` for an unknown option."""
    known = [*own, *(field.name for field in fields(config))]
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise ConfigError(f"unknown option {', '.join(map(repr, unknown))}; known: {', '.join(known)}")
    return config.with_options(**options)


def _worlds(level: str, worlds: Sequence[World] | None, seeds: Sequence[int] | None) -> Sequence[World]:
    """The given worlds, or those of the level from some seeds, or its fixed one."""
    if worlds is not None:
        if seeds is not None:
            raise ConfigError("give either worlds or seeds of worlds, not both")
        return list(worlds)
    from thalweg.world import load_or_build
    from thalweg.world.levels import level_named

    if seeds is None:
        seeds = [level_named(level).default_seed]
    if not seeds:
        raise ConfigError("at least one seed of a world is needed")
    return [load_or_build(level, int(seed)) for seed in seeds]
