"""Tests that settings without a meaning at infinity, and layers beyond any memory, are refused in all algorithms."""

import math
from dataclasses import fields

import pytest

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.registry import algorithm_named, algorithm_names
from thalweg.core.config import parse_config

LIMITS = {"max_grad_norm", "target_kl", "multiplier_max", "clip", "target_noise_clip", "largest_variance", "rarity"}
"""Settings at infinity of which nothing is limited."""
KINDS = {name: type(algorithm_named(name).configure({}, "default", 4)) for name in algorithm_names()}
KINDS |= {"imitation": ImitationConfig}


def numbers_of(kind: type) -> dict[str, bool]:
    """Return the names of settings that are floats, and whether they are limits."""
    return {field.name: field.name in LIMITS for field in fields(kind) if isinstance(field.default, float)}  # pyright: ignore


@pytest.mark.parametrize("name", KINDS)
def test_infinity_is_a_limit_or_refused(name: str):
    kind = KINDS[name]
    assert numbers_of(kind)
    for setting, is_limit in numbers_of(kind).items():
        if is_limit:
            assert getattr(parse_config(kind, {setting: math.inf}), setting) == math.inf
        else:
            with pytest.raises(AlgorithmError, match=f"^{setting} must be"):
                parse_config(kind, {setting: math.inf})


@pytest.mark.parametrize("name", KINDS)
def test_layers_have_a_greatest_size(name: str):
    given = {"hidden": [100_000_000_000], "model_hidden": [10**6], "filters": [10**6], "memory_size": 10**6}
    known = {field.name for field in fields(KINDS[name])}  # pyright: ignore[reportArgumentType]
    for setting in given.keys() & known:
        with pytest.raises(AlgorithmError, match=rf"^{setting}(\[0\])? must be a whole number from [01] to 65536, got"):
            parse_config(KINDS[name], {setting: given[setting]})
    assert "hidden" in known
