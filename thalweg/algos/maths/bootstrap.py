"""What should an action value have been? One step of what was paid, and then what a critic says of the rest."""

from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape


def target(paid: Tensor, going_on: Tensor, next_values: Tensor, discounts: Tensor) -> Tensor:
    """y = x + γ (1 - terminated) V(s') of each signal [S, B], the reward's and the costs' (Watkins, Dayan 1992).

    Args:
        paid: x [S, B], reward and costs of the step.
        going_on: 1 - terminated [B], as numbers; a truncation is no end: what would have come counts.
        next_values: V(s') [S, B], at the observation that the step led to.
        discounts: γ [S, 1].
    """
    rank(2, paid=paid, discounts=discounts)
    same_shape(paid=paid, next_values=next_values)
    same_shape(going_on=going_on, one_signal=paid[0])
    return paid + discounts * (going_on * next_values)
