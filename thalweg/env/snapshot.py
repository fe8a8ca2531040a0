"""Snapshots: the whole state of a vector environment as plain arrays, copied, checked and restored to the bit."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.task.course_arrays import config_fingerprint, fingerprint
from thalweg.env.task.rules import State
from thalweg.render.records.appearance import check_values as check_look_values
from thalweg.world.record import World

FIXED_KEYS = {"fingerprint": "other worlds", "world": "other worlds", "config": "another config"}
"""Keys whose values must equal those of the environment, and the meaning of a difference."""
MASK_32, MASK_64 = (1 << 32) - 1, (1 << 64) - 1
POSSIBLE = {
    "travel": "1 or -1",
    "pose": "finite numbers",
    "time_s": "a finite number",
    "visited": "0 or 1, and 0 beyond the course",
    "visited_count": "the number of segments visited",
    "steps": "0 or more",
    "idle": "0 or more",
    "last_pose": "finite numbers",
    "last_action": "finite numbers",
    "scene": "0 or more",
    "station": "a finite number of 0 or more",
    "way": "a finite number of 0 or more",
    "sun": "the number of one of the world's lights, from 0",
    "generator": "the words of a PCG64, or all 0 where no episode has begun",
    "seed": "0 or more",
    "episode": "0 or more, and from 1 on while an episode runs",
    "look": "the number of one of the looks, from 0",
    "ended": "0 or 1",
}
"""Values that the arrays of a state may have, in words; those of `segment` depend on the course."""
LONGEST_VALUE = 80
"""Characters of a value in an error; a longer one is cut."""


class StateError(ValueError):
    """A state that does not fit the environment: other worlds, another config or number of environments, missing
    arrays, or impossible values."""


def fingerprints(worlds: Sequence[World]) -> np.ndarray:
    """Return the hash [W] uint64 of each world."""
    return np.array([fingerprint(world) for world in worlds], dtype=np.uint64)


def env_identity(rivers: np.ndarray, config: EnvConfig) -> dict[str, np.ndarray]:
    """Return what a state must have in common with an environment: the hashes of its rivers, such as `fingerprints`,
    and that of its config, [1] uint64."""
    return {"fingerprint": rivers, "config": np.array([config_fingerprint(config)], dtype=np.uint64)}


def copy_state(
    state: State,
    generators: list[np.random.Generator | None],
    started: np.ndarray,
    ended: np.ndarray,
    identity: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Return copies of the fields of `State`, begun and ended [N] bool, generator [N, 6] uint64, and the identity."""
    return {
        **{name: value.copy() for name, value in state._asdict().items()},
        "begun": started.copy(),
        "ended": ended.copy(),
        "generator": np.stack([pack_generator(generator) for generator in generators]),
        **{name: value.copy() for name, value in identity.items()},
    }


def check_arrays(given: Mapping[str, np.ndarray], current: Mapping[str, np.ndarray]) -> None:
    """Raise `StateError` unless `given` has the keys, shapes and types of an environment's `current` state, and belongs
    to the same worlds and config."""
    if set(given) != set(current):
        missing, unknown = sorted(set(current) - set(given)), sorted(set(given) - set(current))
        raise StateError(f"the state lacks {missing} and has unknown {unknown}")
    for name, value in current.items():
        array = np.asarray(given[name])
        if array.shape != value.shape or array.dtype != value.dtype:
            raise StateError(f"{name} is {array.dtype} {array.shape}; this environment has {value.dtype} {value.shape}")
        if name in FIXED_KEYS and not np.array_equal(array, value):
            raise StateError(f"the state belongs to {FIXED_KEYS[name]} ({name} differs)")


def check_values(given: Mapping[str, np.ndarray], segments: np.ndarray, own: Mapping[str, np.ndarray]) -> None:
    """Raise `StateError` with the name of the first array whose values would lead a step out of bounds.

    segments [N] are those of each environment's course. `own` has the rows [N] bool with impossible values of the
    arrays that only environments of this kind have.
    """
    given = {name: np.asarray(array) for name, array in given.items()}
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
        **own,
    }
    remembered = [name for name in ("last_pose", "last_action") if name in given]  # with proprioception only
    wrong |= {name: ~np.isfinite(given[name]).all(axis=1) for name in remembered}
    if "way" in given:  # with tasks beside the paper's only
        wrong |= {"scene": given["scene"] < 0}
        wrong |= {name: ~(np.isfinite(given[name]) & (given[name] >= 0)) for name in ("station", "way")}
    for name, rows in wrong.items():
        if rows.any():
            row = int(np.argmax(rows))
            value, allowed = given[name][row], POSSIBLE.get(name, f"0..{segments[row] - 1}")
            if name == "visited":
                at = int(np.argmax((visited > on_course)[row]))
                value = f"{visited[row, at]} at segment {at}"
            raise impossible(name, value, allowed, row)


def impossible(name: str, value: Any, allowed: str, row: int) -> StateError:
    """Return the error of a value in an array of a state; `allowed`: what would be right, `row`: whose it is."""
    numbers = np.ravel(value).tolist()
    shown = ", ".join(f"{number:.3g}" if isinstance(number, float) else str(number) for number in numbers)
    shown = shown if len(shown) <= LONGEST_VALUE else f"{shown[: LONGEST_VALUE - 3]}..."
    shown = f"[{shown}]" if np.ndim(value) else shown
    return StateError(f"{name} has an impossible value, {shown}; allowed: {allowed} (environment {row})")


def check_looks(looks: np.ndarray) -> None:
    """Raise `StateError` for looks [N, P] that no frame can have."""
    try:
        check_look_values(looks)
    except ValueError as reason:
        raise StateError(f"the look of an environment is impossible: {reason}") from None


def restore_state(
    given: Mapping[str, np.ndarray],
    state: State,
    generators: list[np.random.Generator | None],
    started: np.ndarray,
    ended: np.ndarray,
) -> None:
    """Write a checked state into the arrays of an environment."""
    for name, value in state._asdict().items():
        if name in given:
            value[...] = given[name]
    started[:] = given["begun"]
    ended[:] = given["ended"]
    generators[:] = [unpack_generator(row) for row in np.asarray(given["generator"])]


def pack_generator(generator: np.random.Generator | None) -> np.ndarray:
    """Return the state of a PCG64 generator as [6] uint64, or zeros for None (a PCG64 increment is odd, never zero)."""
    if generator is None:
        return np.zeros(6, dtype=np.uint64)
    stored = generator.bit_generator.state
    if stored["bit_generator"] != "PCG64":
        raise StateError(f"only PCG64 generators can be stored, not {stored['bit_generator']}")
    state, increment = stored["state"]["state"], stored["state"]["inc"]
    words = [
        state >> 64,
        state & MASK_64,
        increment >> 64,
        increment & MASK_64,
        stored["has_uint32"],
        stored["uinteger"],
    ]
    return np.array(words, dtype=np.uint64)


def impossible_generators(stored: np.ndarray, begun: np.ndarray) -> np.ndarray:
    """Return whether each row of packed generators [N, 6] uint64 is none of a PCG64; zeros are right only where no
    episode has begun [N] bool."""
    words = np.asarray(stored)
    damaged = (words[:, 3] & np.uint64(1) == 0) | (words[:, 4] > 1) | (words[:, 5] > np.uint64(MASK_32))
    return np.where(words.any(axis=1), damaged, begun)


def unpack_generator(stored: np.ndarray) -> np.random.Generator | None:
    """Return the generator with a state packed into [6] uint64, or None for zeros."""
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
