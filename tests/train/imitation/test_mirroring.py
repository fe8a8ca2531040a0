"""Tests of mirrored sequences: they are those of the mirror image of a river and of a pose."""

import numpy as np
import pytest

from tests.env.handmade import canal
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.task.bird_eye import COLUMNS, ROWS, open_water
from thalweg.env.task.ideal_eye import FEATURES, mirrored
from thalweg.train.imitation.mirroring import ORDER, mirror
from thalweg.train.imitation.sequences import Sequences

POSES = np.array([[15.0, 1.0, 4.2, 0.3], [21.0, -0.5, 5.1, -1.1], [30.0, 0.2, 3.0, 0.0]])


def told(side: float, islands: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The ideal eye, maps and worths of moves at poses on a canal, or in its mirror image."""
    world = canal(60.0, width_m=9.0, islands=[[26.0, 1.5 * side, 3.0, 1.0, 0.2 * side]] if islands else [])
    env = RiverVectorEnv([world], len(POSES), EnvConfig(observation="none"))
    env.reset(seed=0, options={"pose": POSES * [1.0, side, 1.0, side]})
    return env.ideal_eye(), open_water(env.courses, env.state), env.move_worths()


def test_a_mirrored_river_is_seen_as_mirrored_numbers_and_maps():
    eye, maps, _ = told(1.0)
    eye_there, maps_there, _ = told(-1.0)
    assert mirrored(eye) == pytest.approx(eye_there, abs=1e-4)
    assert (maps[..., ::-1] == maps_there).all() and (maps != maps_there).any()


def test_the_teacher_judges_mirrored_moves_alike():
    """Beside an island the grid of its ways, which has no mirror image, makes a small difference for some moves."""
    (*_, worths), (*_, there) = told(1.0, islands=False), told(-1.0, islands=False)
    assert worths[:, ORDER] == pytest.approx(there, abs=1e-6)
    assert not np.allclose(worths, there)
    (*_, worths), (*_, there) = told(1.0), told(-1.0)
    assert worths[:, ORDER] == pytest.approx(there, abs=0.2)


def test_moves_in_a_mirror_turn_and_step_to_the_other_side():
    assert MOVE_OPTIONS[ORDER][:, [0, 2]].tolist() == MOVE_OPTIONS[:, [0, 2]].tolist()
    assert MOVE_OPTIONS[ORDER][:, [1, 3]].tolist() == (2 - MOVE_OPTIONS[:, [1, 3]]).tolist()


def sequences(rng: np.random.Generator, length: int, count: int) -> Sequences:
    values = {name: np.zeros((length, count)) for name in Sequences._fields}
    return Sequences(
        **values
        | {
            "last": rng.integers(-1, 3, (length, count, 4)).astype(np.int8),
            "fresh": np.zeros((length, count), bool),
            "start": np.ones((count, 5), np.float32),
            "worths": rng.normal(size=(length, count, len(MOVE_OPTIONS))).astype(np.float32),
            "privileged": rng.normal(size=(length, count, len(FEATURES))).astype(np.float32),
            "maps": rng.integers(0, 256, (length, count, ROWS * COLUMNS // 8)).astype(np.uint8),
        }
    )


def copied(given: Sequences) -> Sequences:
    return Sequences(*(array.copy() for array in given))


def test_mirrored_twice_is_as_before_but_begins_an_episode():
    rng = np.random.default_rng(0)
    before, images = sequences(rng, 3, 2), rng.integers(0, 256, (3, 2, 8, 8, 4), np.uint8)
    after, drawn = copied(before), images.copy()
    mirror(drawn, after, 1.0, rng)
    assert (drawn == images[..., ::-1, :]).all()
    assert (after.last[1:, :, [0, 2]] == before.last[1:, :, [0, 2]]).all()
    assert ((after.last[1:] == -1) == (before.last[1:] == -1)).all()
    mirror(drawn, after, 1.0, rng)
    for name in ("last", "worths", "privileged", "maps"):
        assert (getattr(after, name)[1:] == getattr(before, name)[1:]).all(), name
    assert (drawn == images).all() and after.fresh[0].all() and not after.fresh[1:].any()
    assert (after.last[0] == -1).all() and (after.start == 0).all()


def test_a_share_of_the_sequences_is_mirrored():
    rng = np.random.default_rng(1)
    before, images = sequences(rng, 2, 200), rng.integers(0, 256, (2, 200, 2, 2, 1), np.uint8)
    after, drawn = copied(before), images.copy()
    mirror(drawn, after, 0.3, rng)
    begun = after.fresh[0]
    assert 40 <= begun.sum() <= 80
    same = (drawn == images).all(axis=(0, 2, 3, 4)) & (after.worths == before.worths).all(axis=(0, 2))
    assert same[~begun].all() and (after.start[~begun] == 1).all()
    assert not (after.worths == before.worths).all(axis=(0, 2))[begun].any()
    mirror(drawn, after, 0.0, rng)
    assert (after.fresh[0] == begun).all()


def test_all_of_a_mirrored_sequence_is_mirrored():
    rng = np.random.default_rng(0)
    before, seen = sequences(rng, 3, 2), np.zeros((3, 2, 8, 8, 4), np.uint8)
    after = copied(before)
    mirror(seen, after, 1.0, rng)
    aside = before.last[1:, :, [1, 3]]
    assert np.array_equal(after.last[1:, :, [1, 3]], np.where(aside < 0, -1, 2 - aside))
    assert np.array_equal(after.privileged, mirrored(before.privileged))
    maps, there = (np.unpackbits(each.maps, axis=-1).reshape(3, 2, ROWS, COLUMNS) for each in (before, after))
    assert np.array_equal(there, maps[..., ::-1])
