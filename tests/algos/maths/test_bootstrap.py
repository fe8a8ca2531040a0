"""Targets of action values, by hand."""

import pytest
import torch

from thalweg.algos.maths.bootstrap import target

F64 = torch.float64


def test_two_signals_with_discounts_of_their_own_by_hand():
    found = target(
        torch.tensor([[1.0, 2.0], [0.0, 1.0]], dtype=F64),
        torch.tensor([1.0, 0.0], dtype=F64),
        torch.tensor([[4.0, 100.0], [0.5, 100.0]], dtype=F64),
        torch.tensor([[0.5], [0.8]], dtype=F64),
    )
    # 1 + 0.5·4 = 3, and 2 at the end; 0 + 0.8·0.5 = 0.4, and 1 at the end
    assert found.tolist() == [[3.0, 2.0], [0.4, 1.0]]


def test_shapes_that_would_broadcast_are_refused():
    with pytest.raises(ValueError, match="same shape"):
        target(torch.zeros(2, 3), torch.zeros(3, 1), torch.zeros(2, 3), torch.zeros(2, 1))
    with pytest.raises(ValueError, match="dimensions"):
        target(torch.zeros(2, 3), torch.zeros(3), torch.zeros(2, 3), torch.zeros(2))
