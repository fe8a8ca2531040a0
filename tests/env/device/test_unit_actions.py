"""Unit actions of tensors, and errors, against those of arrays."""

import numpy as np
import pytest
import torch

from thalweg.env.device.unit_actions import tensor_unit_actions
from thalweg.env.spaces import ActionError, to_unit_actions
from thalweg.env.task.motion import ROUNDING

N = 500
OPTIONS = torch.randint(-2, 5, (N, 4), generator=torch.Generator().manual_seed(0))
NUMBERS = 1.3 * torch.randn(N, 4, generator=torch.Generator().manual_seed(0))
"""Some of both are out of range."""


@pytest.mark.parametrize("ratio", [0.0, 2.5])
@pytest.mark.parametrize(
    ("kind", "actions", "low", "high"),
    [
        ("multidiscrete", OPTIONS, 0, 2),
        ("multidiscrete", OPTIONS.to(torch.int8), 0, 2),
        ("continuous", NUMBERS, -1, 1),
        ("continuous", NUMBERS.double(), -1, 1),
        ("continuous", OPTIONS, -1, 1),
    ],
    ids=["options", "bytes", "numbers", "doubles", "integers"],
)
def test_actions_are_those_of_arrays_clipped_to_the_range(
    kind: str, actions: torch.Tensor, low: int, high: int, ratio: float
):
    given = actions.clone()
    found = tensor_unit_actions(kind, actions, N, ratio)
    expected = to_unit_actions(kind, actions.numpy().clip(low, high), N, ratio)
    assert found.dtype == torch.float64 and found.is_contiguous()
    np.testing.assert_array_equal(found.numpy(), expected)
    assert torch.equal(actions, given)


@pytest.mark.parametrize("ratio", [0.0, 2.5])
def test_nan_is_no_move(ratio: float):
    actions = torch.full((2, 4), 0.25)
    actions[0] = torch.nan
    actions[1, 2] = torch.nan
    found = tensor_unit_actions("continuous", actions, 2, ratio)
    assert found.tolist() == [[0.0, 0.0, 0.0, 0.0], [0.25, 0.25, 0.0, 0.25]]


def test_doubles_are_no_memory_of_the_caller():
    actions = torch.zeros(N, 4, dtype=torch.float64)
    tensor_unit_actions("continuous", actions, N, 2.0)[:] = 0.5
    assert not actions.any()


@pytest.mark.parametrize("ratio", [1.5, 2.5])
def test_a_step_forward_is_whole_where_a_fast_one_begins(ratio: float):
    steps = torch.tensor([0.0, 0.5, 1.0, 1.0 + 0.5 * ROUNDING, 1.0 + 2.0 * ROUNDING, ratio, -0.5], dtype=torch.float64)
    shares = steps / ratio
    actions = torch.zeros(len(shares), 4, dtype=torch.float64)
    actions[:, 2] = shares
    found = tensor_unit_actions("continuous", actions, len(actions), ratio).numpy()
    in_range = actions.clamp(-1.0, 1.0).numpy()
    np.testing.assert_array_equal(found, to_unit_actions("continuous", in_range, len(actions), ratio))


@pytest.mark.parametrize(
    ("kind", "actions", "words"),
    [
        ("multidiscrete", torch.ones(N, 3, dtype=torch.int64), r"actions have shape \(500, 3\); needed: \(500, 4\)"),
        ("multidiscrete", torch.ones(N + 1, 4, dtype=torch.int64), r"actions have shape \(501, 4\)"),
        ("continuous", torch.ones(4), r"actions have shape \(4,\)"),
        ("multidiscrete", torch.ones(N, 4), "float32; multidiscrete actions are integers 0, 1 or 2"),
        ("multidiscrete", torch.ones(N, 4, dtype=torch.bool), "bool; multidiscrete actions are integers 0, 1 or 2"),
        ("continuous", torch.ones(N, 4, dtype=torch.bool), "bool; continuous actions are numbers in -1..1"),
        ("continuous", torch.ones(N, 4, dtype=torch.complex64), r"complex64; continuous actions are numbers in -1..1"),
    ],
)
def test_wrong_shapes_and_types_are_refused_as_those_of_arrays(kind: str, actions: torch.Tensor, words: str):
    for make in (lambda: tensor_unit_actions(kind, actions, N), lambda: to_unit_actions(kind, actions.numpy(), N)):
        with pytest.raises(ActionError, match=words):
            make()
