"""How is a run interrupted and resumed? The whole state of a vector environment as plain arrays, and back, to the
bit."""

from collections.abc import Mapping

import numpy as np

from thalweg.env.task.rules import State
from thalweg.render.records.appearance import check_values

FIXED = {"fingerprint": "other worlds", "world": "other worlds", "config": "another config"}
"""Keys whose values must be those of the environment itself, and what it means when they differ."""
WORD = (1 << 64) - 1


class StateError(ValueError):
    """A state that does not fit the environment: other worlds, another config or number of environments, missing
    arrays, or values that no episode has."""


def gathered(
    state: State,
    generators: list[np.random.Generator | None],
    begun: np.ndarray,
    ended: np.ndarray,
    fixed: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Copies of everything: the fields of `State`, begun and ended [N] bool, generator [N, 6] uint64, and what is
    `fixed`: fingerprint [W] uint64 and config [1] uint64."""
    return {
        **{name: value.copy() for name, value in state._asdict().items()},
        "begun": begun.copy(),
        "ended": ended.copy(),
        "generator": np.stack([words(generator) for generator in generators]),
        **{name: value.copy() for name, value in fixed.items()},
    }


def check(given: Mapping[str, np.ndarray], own: Mapping[str, np.ndarray], segments: np.ndarray, suns: int) -> None:
    """Raises `StateError` unless `given` has the keys, shapes and types of `own`, belongs to the same worlds and
    config, and holds values that an episode can have; segments [N] of each environment's course; suns: how many
    lights each world has."""
    if set(given) != set(own):
        missing, unknown = sorted(set(own) - set(given)), sorted(set(given) - set(own))
        raise StateError(f"the state lacks {missing} and has unknown {unknown}")
    for name, value in own.items():
        array = np.asarray(given[name])
        if array.shape != value.shape or array.dtype != value.dtype:
            raise StateError(f"{name} is {array.dtype} {array.shape}; this environment has {value.dtype} {value.shape}")
        if name in FIXED and not np.array_equal(array, value):
            raise StateError(f"the state belongs to {FIXED[name]} ({name} differs)")
    _check_values({name: np.asarray(array) for name, array in given.items()}, segments, suns)


def _check_values(given: Mapping[str, np.ndarray], segments: np.ndarray, suns: int) -> None:
    """Raises `StateError` by the name of the first array whose values would lead a step out of bounds."""
    segment, visited = given["segment"], given["visited"]
    on_course = np.arange(visited.shape[1]) < segments[:, None]
    wrong = {
        "segment": (segment < 0) | (segment >= segments),
        "travel": np.abs(given["travel"]) != 1,
        "pose": ~np.isfinite(given["pose"]).all(axis=1),
        "time_s": ~np.isfinite(given["time_s"]),
        "visited": (visited > on_course).any(axis=1),
        "visited_count": given["visited_count"] != visited.sum(axis=1),
        "steps": given["steps"] < 0,
        "idle": given["idle"] < 0,
        "sun": (given["sun"] < 0) | (given["sun"] >= suns),
        "generator": given["begun"] & ~given["generator"].any(axis=1),
    }
    for name, rows in wrong.items():
        if rows.any():
            row = int(np.argmax(rows))
            allowed = f"; allowed: 0..{segments[row] - 1}" if name == "segment" else ""
            raise StateError(f"{name} has a value that no episode has{allowed} (environment {row})")
    try:
        check_values(given["look"])
    except ValueError as reason:
        raise StateError(f"the look of an environment is none: {reason}") from None


def scatter(
    given: Mapping[str, np.ndarray],
    state: State,
    generators: list[np.random.Generator | None],
    begun: np.ndarray,
    ended: np.ndarray,
) -> None:
    """Write a checked state into the arrays of an environment."""
    for name, value in state._asdict().items():
        value[...] = given[name]
    begun[:] = given["begun"]
    ended[:] = given["ended"]
    generators[:] = [generator_of(row) for row in np.asarray(given["generator"])]


def words(generator: np.random.Generator | None) -> np.ndarray:
    """The state of a PCG64 generator as [6] uint64; all zero for none (a PCG64 increment is odd, so never zero)."""
    if generator is None:
        return np.zeros(6, dtype=np.uint64)
    whole = generator.bit_generator.state
    if whole["bit_generator"] != "PCG64":
        raise StateError(f"only PCG64 generators can be stored, not {whole['bit_generator']}")
    state, increment = whole["state"]["state"], whole["state"]["inc"]
    parts = [state >> 64, state & WORD, increment >> 64, increment & WORD, whole["has_uint32"], whole["uinteger"]]
    return np.array(parts, dtype=np.uint64)


def generator_of(stored: np.ndarray) -> np.random.Generator | None:
    """The generator whose state is stored [6] uint64, or None for zeros."""
    high, low, increment_high, increment_low, has_uint32, uinteger = (int(word) for word in stored)
    if increment_low == 0:
        return None
    bits = np.random.PCG64()
    bits.state = {
        "bit_generator": "PCG64",
        "state": {"state": high << 64 | low, "inc": increment_high << 64 | increment_low},
        "has_uint32": has_uint32,
        "uinteger": uinteger,
    }
    return np.random.Generator(bits)
