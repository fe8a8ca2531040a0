"""Stored sequences come back as they were, the latest ones are kept, and corrupted masks change nothing else."""

import numpy as np
import pytest

from thalweg.train.imitation.mask_noise import corrupt
from thalweg.train.imitation.sequences import COLUMN, Sequences, SequenceStore

LENGTH = 4


def sequences(count: int, seed: int) -> Sequences:
    rng = np.random.default_rng(seed)
    numbers = {
        name: rng.integers(0, 100, (LENGTH, count, 3) if COLUMN[name] else (count, 3)) for name in Sequences._fields
    }
    return Sequences(**numbers)


def same(found: Sequences, expected: Sequences) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))


def test_sequences_come_back_as_they_were():
    store, first, second = SequenceStore(100, LENGTH), sequences(3, 0), sequences(2, 1)
    store.add(first)
    store.add(second)
    assert store.count == 5 and store.most == 25
    assert same(store.take(np.arange(3)), first)
    assert same(store.take(np.array([3, 4])), second)


def test_the_oldest_ones_make_room():
    store = SequenceStore(3 * LENGTH, LENGTH)
    for seed in range(4):
        store.add(sequences(1, seed))
    assert store.count == 3
    assert same(store.take(np.array([0])), sequences(1, 3))
    assert same(store.take(np.array([1])), sequences(1, 1))


@pytest.mark.parametrize("added", [0, 2, 5])
def test_a_store_resumes(added: int):
    store, other = SequenceStore(3 * LENGTH, LENGTH), SequenceStore(3 * LENGTH, LENGTH)
    for seed in range(added):
        store.add(sequences(1, seed))
    other.load_state(store.state())
    for each in (store, other):
        each.add(sequences(1, 9))
    assert other.count == store.count
    assert same(other.take(np.arange(store.count)), store.take(np.arange(store.count)))


def images(channels: int) -> np.ndarray:
    return np.full((6, 40, 32, 32, channels), 100, np.uint8)


def test_corrupted_masks_leave_the_image_alone():
    found = images(4)
    corrupt(found, "rgb+mask", 0.5, np.random.default_rng(0))
    assert (found[..., :3] == 100).all()
    changed = (found[..., 3] != 100).any(axis=(0, 2, 3))
    assert 0.3 < changed.mean() < 0.7
    assert set(np.unique(found[..., 3])) == {0, 100, 255}


def test_a_quarter_of_corrupted_masks_show_no_water_and_the_others_show_some_of_it():
    found = images(4)
    corrupt(found, "rgb+mask", 1.0, np.random.default_rng(0))
    masks = found[..., 3].reshape(-1, 32 * 32)
    dry = (masks == 0).all(1)
    assert 0.15 < dry.mean() < 0.35
    assert (masks[~dry] == 100).any(1).all()


@pytest.mark.parametrize(("observation", "channels", "share"), [("rgb", 3, 1.0), ("mask", 1, 0.0)])
def test_nothing_is_corrupted_without_a_mask_or_a_share(observation: str, channels: int, share: float):
    found = images(channels)
    corrupt(found, observation, share, np.random.default_rng(0))
    assert (found == 100).all()
