"""Entry points of the Gymnasium ids: the environments of a level, from keyword arguments."""

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Literal

from gymnasium.vector import AutoresetMode

from thalweg.core.seeds import parse_seeds
from thalweg.env.config import DEFAULT_CONFIG, ConfigError, EnvConfig, check_options, integer_at_least
from thalweg.env.env import RiverEnv
from thalweg.env.given import check_config, worlds_of
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.vector_env import RiverVectorEnv
from thalweg.world.record import World

if TYPE_CHECKING:
    from thalweg.env.torch_env import TensorRiverEnv

Seeds = Sequence[int] | range | str
"""Seeds as `thalweg.core.seeds.parse_seeds` reads them."""


def make_single(
    level: str,
    *,
    world: World | None = None,
    world_seed: int | None = None,
    banks: Any = None,
    renderer: Any = None,
    render_mode: str | None = None,
    config: EnvConfig = DEFAULT_CONFIG,
    **options: Any,
) -> RiverEnv:
    """Create one environment in a river of the level: its fixed one, that of `world_seed`, or a given `world`.

    `banks` are the kinds of the level's banks, such as "meadow"; see `thalweg.world.banks.read_banks`.

    Further options are fields of `EnvConfig`; raises `UnknownOptionError`, a `ConfigError` and a `TypeError`, for an
    unknown one, and lists the known.
    """
    config = _with_options(config, options, ("world", "world_seed", "banks", "renderer", "render_mode", "config"))
    _start_compilation(config)
    seeds = None if world_seed is None else [integer_at_least("world_seed", world_seed, 0)]
    given = None if world is None else worlds_of([world], "world")
    worlds = _worlds(_on_banks(level, banks, world), given, seeds)
    return RiverEnv(worlds[0], config, renderer=renderer, render_mode=render_mode)


def make_vector(
    level: str,
    num_envs: int = 1,
    *,
    worlds: World | Sequence[World] | None = None,
    world_seeds: Seeds | None = None,
    banks: Any = None,
    rivers: Literal["fixed", "episode"] = "fixed",
    renderer: Any = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
    render_mode: str | None = None,
    config: EnvConfig = DEFAULT_CONFIG,
    **options: Any,
) -> RiverVectorEnv:
    """Create N environments in rivers of the level: its fixed one, those of `world_seeds`, or given `worlds`.

    `banks` are the kinds of the level's banks, such as "meadow"; see `thalweg.world.banks.read_banks`.
    `world_seeds` is a list of seeds, a `range`, or a text such as "0 5 1000:1016". With `rivers="fixed"` environment i
    stays in river i modulo their number; with "episode" each episode is flown in a random one.

    Further options are fields of `EnvConfig`; raises `UnknownOptionError`, a `ConfigError` and a `TypeError`, for an
    unknown one, and lists the known.
    """
    arguments = (
        "num_envs",
        "worlds",
        "world_seeds",
        "banks",
        "rivers",
        "renderer",
        "autoreset_mode",
        "render_mode",
        "config",
    )
    config = _with_options(config, options, arguments)
    level = _on_banks(level, banks, worlds)
    if rivers not in ("fixed", "episode"):
        raise ConfigError(f"rivers must be 'fixed' or 'episode', not {rivers!r}")
    _start_compilation(config)
    given = None if worlds is None else worlds_of(worlds)
    seeds = None if world_seeds is None else _seeds(world_seeds)
    chosen: RiverList | Sequence[World]
    if rivers == "episode" and seeds is not None and given is None:
        chosen = RiverList.of_levels([(level, seeds)])
    else:
        chosen = _worlds(level, given, seeds)
        chosen = RiverList(chosen) if rivers == "episode" else chosen
    return RiverVectorEnv(
        chosen,
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
    world_seeds: Seeds | None = None,
    banks: Any = None,
    device: str = "auto",
    config: EnvConfig = DEFAULT_CONFIG,
    **options: Any,
) -> "TensorRiverEnv":
    """Create N environments of tensors on one device, as `make_vector`; `thalweg.make_torch` calls it."""
    from thalweg.core.compute.device import resolve_device
    from thalweg.env.torch_env import TensorRiverEnv

    arguments = ("num_envs", "worlds", "world_seeds", "banks", "device", "config")
    config, device = _with_options(config, options, arguments), resolve_device(device)
    level = _on_banks(level, banks, worlds)
    if device == "cpu":
        _start_compilation(config)
    given = None if worlds is None else worlds_of(worlds)
    rivers = _worlds(level, given, None if world_seeds is None else _seeds(world_seeds))
    return TensorRiverEnv(rivers, num_envs, config, device=device)


make_single.metadata = RiverEnv.metadata  # pyright: ignore[reportFunctionMemberAccess]


def _with_options(config: EnvConfig, options: dict[str, Any], arguments: Sequence[str]) -> EnvConfig:
    """Return the config with some fields changed; raises `ConfigError` for one that is none, and `UnknownOptionError`
    for an unknown option."""
    check_config(config)
    check_options(options, [*arguments, *(field.name for field in fields(config))])
    return config.with_options(**options)


def _start_compilation(config: EnvConfig) -> None:
    """Start compiling the kernels of frames, if they are not cached, while the worlds are built."""
    if config.channels:
        from thalweg.render import compilation

        compilation.begin()


def _worlds(level: str, worlds: Sequence[World] | None, seeds: Sequence[int] | None) -> Sequence[World]:
    """Return the given worlds, those of the level with the checked seeds, or its fixed one."""
    if worlds is not None:
        if seeds is not None:
            raise ConfigError("give either worlds or seeds of worlds, not both")
        return worlds
    if not isinstance(level, str):
        raise ConfigError(f"level must be a name, not {level!r}")
    from thalweg.world import load_or_build
    from thalweg.world.levels import level_named

    if seeds is None:
        seeds = [level_named(level).default_seed]
    return [load_or_build(level, seed) for seed in seeds]


def _on_banks(level: str, banks: Any, worlds: Any) -> str:
    """Return the name of the level with other banks, if some are asked for.

    Raises `ConfigError` for banks beside given worlds, and `WorldError` for an unknown kind.
    """
    if banks is None:
        return level
    if worlds is not None:
        raise ConfigError("give either worlds or banks, not both: a world has its banks already")
    from thalweg.world.levels import on_banks

    return on_banks(level, banks)


def _seeds(given: Any) -> tuple[int, ...]:
    """Return seeds of worlds as integers; raises `ConfigError` for anything else."""
    seeds = parse_seeds(given, "world_seeds", ConfigError)
    if not seeds:
        raise ConfigError("world_seeds needs at least one seed")
    return seeds
