"""Checks of what environments are given: worlds, and their config."""

from collections.abc import Iterable
from typing import Any

from thalweg.env.config import ConfigError, EnvConfig
from thalweg.world.record import World


def worlds_of(given: Any, name: str = "worlds") -> tuple[World, ...]:
    """Return one or several worlds as a tuple; raises `ConfigError`, with the name of the argument, for anything else
    and for none."""
    worlds: tuple[Any, ...] = tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else (given,)
    several = " or a sequence of them" if name == "worlds" else ""
    for world in worlds:
        if not isinstance(world, World):
            found = f"{type(world).__name__} {world!r:.60}"
            raise ConfigError(f"{name} must be a thalweg.world.World{several}, not {found}")
    if not worlds:
        raise ConfigError(f"{name} must hold at least one river")
    return worlds


def check_config(config: Any) -> None:
    """Raise `ConfigError` for a config that is none."""
    if not isinstance(config, EnvConfig):
        raise ConfigError(f"config must be an EnvConfig, not {type(config).__name__} {config!r:.60}")
