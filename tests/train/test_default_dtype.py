"""Tests that PyTorch's default type of numbers, which another library in the process may set, changes nothing."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.train.small_runs import SMALL, numbers, train
from thalweg.algos import ALGORITHMS
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.encoder import load_encoder
from thalweg.encoder.encoder import PACKAGED
from thalweg.train import load_policy


@contextmanager
def double() -> Iterator[None]:
    """PyTorch makes tensors of float64 where no type is stated."""
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("algorithm", list(ALGORITHMS))
def test_a_run_has_the_same_numbers(algorithm: str, tmp_path: Path):
    train(tmp_path / "single", algorithm, steps=512)
    with double():
        train(tmp_path / "double", algorithm, steps=512)
    assert numbers(tmp_path / "single") == numbers(tmp_path / "double")


@pytest.mark.parametrize(
    "settings", [{"memory": "gru", "memory_size": 8, "sequence": 5}, {"frame_stack": 3}], ids=["gru", "frames"]
)
def test_a_run_that_remembers_has_the_same_numbers(settings: dict, tmp_path: Path):
    train(tmp_path / "single", config=SMALL | settings, steps=512)
    with double():
        train(tmp_path / "double", config=SMALL | settings, steps=512)
    assert numbers(tmp_path / "single") == numbers(tmp_path / "double")


def test_a_policy_acts_alike(tmp_path: Path):
    train(tmp_path, steps=256)
    obs, fresh = np.zeros((3, load_policy(tmp_path).obs_size), np.float32), np.ones(3, dtype=bool)
    expected = load_policy(tmp_path).player(3, deterministic=True)(obs, fresh)
    with double():
        policy = load_policy(tmp_path)
        assert {parameter.dtype for parameter in policy.actor.parameters()} == {torch.float32}
        assert np.array_equal(policy.player(3, deterministic=True)(obs, fresh), expected)


def test_a_packaged_policy_acts_alike():
    images, fresh = np.zeros((2, 128, 128, 4), np.uint8), np.ones(2, dtype=bool)
    expected = load_policy(PACKAGED_POLICY).player(2, deterministic=True)(images, fresh)
    with double():
        assert np.array_equal(load_policy(PACKAGED_POLICY).player(2, deterministic=True)(images, fresh), expected)


@pytest.mark.parametrize("name", [None, *PACKAGED])
def test_an_encoder_gives_the_same_codes(name: str | None):
    encoder = load_encoder(name)
    size, channels = encoder.config.size_px, len(encoder.config.channels)
    sides = (size, size) if isinstance(size, int) else size
    frames = np.random.default_rng(0).integers(0, 256, (3, *sides, channels), dtype=np.uint8)
    codes = encoder(frames)
    with double():
        found = load_encoder(name)
        assert found(frames).dtype == np.float32
        np.testing.assert_array_equal(found(frames), codes)
        read = found.predict if hasattr(found.model, "predict") else found.decode
        assert len(read(codes)) == 3
