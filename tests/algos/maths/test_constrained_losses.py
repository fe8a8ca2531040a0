"""The losses of P3O and CUP against numbers worked by hand, and where their gradients vanish."""

import pytest
import torch

from thalweg.algos.maths import losses

F64 = torch.float64
ZEROS = torch.zeros(4, dtype=F64)
RATIO = torch.tensor([1.5, 1.5, 0.5, 0.5], dtype=F64)
COSTS = torch.tensor([1.0, -1.0, 1.0, -1.0], dtype=F64)


def penalty(violation: float, scale: float = 0.01, clipped: bool = True) -> float:
    return losses.p3o_penalty(RATIO.log(), ZEROS, COSTS, violation, clip=0.2, scale=scale, clipped=clipped).item()


def test_the_penalty_of_p3o_by_hand():
    # max(1.5, 1.2) + max(-1.5, -1.2) + max(0.5, 0.8) + max(-0.5, -0.8) = 1.5 - 1.2 + 0.8 - 0.5, of four
    assert penalty(0.0) == pytest.approx(0.15)
    assert penalty(5.0) == pytest.approx(0.15 + 0.01 * 5.0)
    # 1.5 - 1.5 + 0.5 - 0.5
    assert penalty(0.0, clipped=False) == pytest.approx(0.0)
    assert penalty(5.0, clipped=False) == pytest.approx(0.05)
    assert penalty(5.0, clipped=False, scale=1.0) == pytest.approx(5.0)


@pytest.mark.parametrize(("violation", "opens"), [(-14.9, True), (-15.1, False)])
def test_the_gate_of_p3o_flips_where_the_surrogate_equals_what_is_left_to_the_limit(violation: float, opens: bool):
    # 0.15 = 0.01 · 15: a little less room, and there is a gradient; a little more, and there is none
    log_prob = RATIO.log().requires_grad_()
    loss = losses.p3o_penalty(log_prob, ZEROS, COSTS, violation, clip=0.2, scale=0.01)
    loss.backward()
    assert log_prob.grad is not None
    assert (loss.item() > 0) == opens and bool(log_prob.grad.any()) == opens


def test_the_projection_of_cup_by_hand():
    kl = torch.tensor([0.1, 0.2, 0.3, 0.4], dtype=F64)
    costs = torch.tensor([2.0, 0.0, 1.0, 4.0], dtype=F64)
    # mean KL 0.25; (1 - 0.9·0.5) / (1 - 0.9) = 5.5; (1.5·2 + 0.5·1 + 0.5·4) / 4 = 1.375
    found = losses.cup_projection(RATIO.log(), ZEROS, kl, costs, discount=0.9, trace=0.5)
    assert found.item() == pytest.approx(0.25 + 5.5 * 1.375)


def test_the_surrogate_by_hand():
    assert losses.surrogate(RATIO.log(), ZEROS, COSTS).item() == pytest.approx(0.0)
    assert losses.surrogate(RATIO.log(), ZEROS, COSTS.abs()).item() == pytest.approx(1.0)


def test_a_cost_with_an_axis_too_many_is_refused():
    with pytest.raises(ValueError, match="same shape"):
        losses.p3o_penalty(torch.zeros(3), torch.zeros(3), torch.zeros(3, 1), 0.0, clip=0.2, scale=0.01)
    with pytest.raises(ValueError, match="same shape"):
        losses.cup_projection(torch.zeros(3), torch.zeros(3), torch.zeros(3, 1), torch.zeros(3), discount=0.9, trace=0)
