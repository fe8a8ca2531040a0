"""Tests of the meaning of raw actions for the environment, by known frequencies and by hand."""

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from thalweg.algos import AlgorithmError
from thalweg.algos.policy.actions import Actions, Adapter, actions_of
from thalweg.algos.policy.distributions import Categoricals, Deterministic, Gaussians, SquashedGaussian

THREE = gym.spaces.MultiDiscrete([3])
BOX = gym.spaces.Box(np.array([-2, 0], np.float32), np.array([2, 1], np.float32), dtype=np.float32)
ADAPTERS: tuple[Adapter, ...] = ("box_literal", "box_scaled")


def below(x: float) -> float:
    """Φ(x) of the standard normal."""
    return 0.5 * (1.0 + math.erf(x / math.sqrt(2.0)))


NORMAL = {
    "box_literal": (below(0.5), below(1.5) - below(0.5), 1.0 - below(1.5)),
    "box_scaled": (below(-0.5), below(0.5) - below(-0.5), 1.0 - below(0.5)),
}
"""Of a standard normal; the first is what the study's code draws at the start, 0.69, 0.24 and 0.07."""
UNIFORM = {"box_literal": (0.75, 0.25, 0.0), "box_scaled": (0.25, 0.5, 0.25)}
"""Of numbers alike in -1..1, which is how a bounded policy explores first."""


def frequencies(raw: torch.Tensor, adapter: Adapter) -> list[float]:
    options = actions_of(THREE, adapter).options(raw.unsqueeze(1)).squeeze(1)
    return (torch.bincount(options, minlength=3) / len(options)).tolist()


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_a_standard_normal_picks_options_as_its_distribution_says(adapter: Adapter):
    drawn = torch.randn(100_000, generator=torch.Generator().manual_seed(0))
    assert frequencies(drawn, adapter) == pytest.approx(NORMAL[adapter], abs=0.005)


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_numbers_alike_in_their_range_pick_options_by_the_width_of_their_bins(adapter: Adapter):
    drawn = 2.0 * torch.rand(100_000, generator=torch.Generator().manual_seed(0)) - 1.0
    assert frequencies(drawn, adapter) == pytest.approx(UNIFORM[adapter], abs=0.005)


def test_taken_literally_bounded_numbers_never_reach_the_last_option():
    assert frequencies(torch.linspace(-1.0, 1.0, 2001), "box_literal")[2] == 0.0


def test_the_published_frequencies_are_those_of_the_literal_normal():
    assert NORMAL["box_literal"] == pytest.approx((0.69, 0.24, 0.07), abs=0.005)


def test_a_scaled_number_is_executed_as_the_middle_of_its_bin():
    actions = actions_of(gym.spaces.MultiDiscrete([3, 5, 1]), "box_scaled")
    raw = torch.tensor([[-1.7, -0.7, 0.3], [0.4, 0.2, -0.9], [0.6, 0.9, 5.0]])
    expected = [[-1.0, -0.5, -1.0], [0.0, 0.0, -1.0], [1.0, 1.0, -1.0]]
    assert actions.quantised(raw).tolist() == expected
    assert torch.equal(actions.options(actions.quantised(raw)), actions.options(raw))


@pytest.mark.parametrize(
    ("space", "adapter", "raw"),
    [
        (THREE, "box_literal", torch.tensor([[-0.3], [1.2]])),
        (THREE, "native", torch.tensor([[2], [0]])),
        (BOX, "native", torch.tensor([[0.3, 9.0]])),
    ],
    ids=["literal", "native", "box"],
)
def test_other_actions_are_learnt_for_as_they_were_drawn(space: gym.Space, adapter: Any, raw: torch.Tensor):
    assert torch.equal(actions_of(space, adapter).quantised(raw), raw)


def test_options_are_counted_from_where_the_environment_counts():
    space = gym.spaces.MultiDiscrete([2, 5], start=[1, -2])
    drawn = actions_of(space, "box_scaled").to_numpy(torch.tensor([[-1.0, -1.0], [1.0, 1.0]]))
    assert drawn.tolist() == [[1, -2], [2, 2]] and drawn.dtype == space.dtype


@pytest.mark.parametrize(
    ("kind", "numbers", "distribution"),
    [("gaussian", 2, Gaussians), ("squashed", 4, SquashedGaussian), ("point", 2, Deterministic)],
)
def test_each_kind_of_policy_reads_its_numbers(kind: Any, numbers: int, distribution: type):
    actions = actions_of(BOX, continuous=kind)
    parameters = torch.tensor([[0.5, -0.25, 0.1, 0.2]])[:, : max(numbers, 2 + 2 * (kind != "point"))]
    found = actions.distribution(parameters)
    assert actions.outputs == numbers and type(found) is distribution
    mean = parameters[:, :2]
    assert torch.equal(found.mode(), mean if kind == "gaussian" else mean.tanh())


def test_choices_read_a_logit_for_each_option():
    actions = actions_of(gym.spaces.MultiDiscrete([2, 3]))
    found = actions.distribution(torch.tensor([[0.0, 1.0, 2.0, 0.0, 0.0]]))
    assert actions.outputs == 5 and isinstance(found, Categoricals)
    assert found.mode().tolist() == [[1, 0]]


def test_an_adapter_on_a_box_is_refused():
    with pytest.raises(AlgorithmError, match="'box_scaled' is for discrete actions"):
        actions_of(BOX, "box_scaled")


def test_an_unknown_adapter_lists_the_known():
    with pytest.raises(AlgorithmError, match="'native', 'box_literal' or 'box_scaled', got 'affine'"):
        actions_of(THREE, "affine")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("space", [gym.spaces.MultiBinary(3), gym.spaces.Text(3), gym.spaces.Box(0, 9, (2,), np.int64)])
def test_an_unsupported_space_is_refused(space: gym.Space):
    with pytest.raises(AlgorithmError, match="must be Discrete, MultiDiscrete"):
        actions_of(space)


@pytest.mark.parametrize(
    "actions",
    [
        actions_of(gym.spaces.MultiDiscrete([2, 5], start=[1, -2]), "box_scaled", "squashed"),
        actions_of(gym.spaces.Discrete(4, start=7)),
        actions_of(BOX, continuous="point"),
        actions_of(gym.spaces.Box(-np.inf, np.inf, (2, 2), np.float64)),
    ],
    ids=["adapter", "discrete", "box", "unbounded"],
)
def test_a_record_survives_its_plain_data(actions: Actions):
    assert Actions.from_data(actions.as_data()) == actions


def test_a_box_with_bounds_of_0_changes_no_type_of_options():
    box = actions_of(gym.spaces.Box(0.0, 1.0, (2,), np.float64))
    options = actions_of(gym.spaces.MultiDiscrete([3, 3]))
    assert box.env_actions(torch.tensor([[0.5, -2.0]])).dtype == torch.float64
    assert options.env_actions(torch.tensor([[2, 0]])).dtype == torch.int64


def test_numbers_of_a_box_with_one_bound_are_clipped_and_not_stretched():
    low, high = np.array([0.5, -np.inf], np.float32), np.array([np.inf, 0.5], np.float32)
    found = actions_of(gym.spaces.Box(low, high)).to_numpy(torch.tensor([[-1.0, -3.0], [3.0, 2.0]]))
    assert found.tolist() == [[0.5, -3.0], [3.0, 0.5]]
