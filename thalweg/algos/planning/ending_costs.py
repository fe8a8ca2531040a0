"""Share of all costs so far that ended their episodes, by cost."""

from typing import Any

import torch

from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.interface import Rollout


class EndingCosts:
    """Running sums of each of M costs, of all and of those paid in an episode's last step, and counts of steps."""

    def __init__(self, costs: int) -> None:
        self._sums = torch.zeros(2, costs, dtype=torch.float64)
        """[2, M]: all costs, and those of last steps."""
        self._counts = torch.zeros(2, dtype=torch.float64)
        """[2]: all steps, and last steps."""

    @property
    def shares(self) -> tuple[float, ...]:
        """e [M], the share of each cost that ended its episode; 0 for a cost that was never paid.

        e = (s - p) / (1 - p), within 0..1, for the share s that was paid in last steps and the share p of such steps:
        costs that have nothing to do with the end come with it in p of the cases. With costs below 0, s may be above 1.
        """
        steps, last = self._counts.tolist()
        chance = last / steps if steps else 0.0
        if chance == 1.0:
            return (1.0,) * self._sums.shape[1]
        seen = [part / total if total > 0.0 else 0.0 for total, part in self._sums.T.tolist()]
        return tuple(min(max(0.0, (share - chance) / (1.0 - chance)), 1.0) for share in seen)

    def update(self, rollout: Rollout) -> None:
        """Add the steps of a rollout; that of a truncation is not a last step."""
        last = (rollout.terminated & rollout.valid).double()
        steps = torch.stack([rollout.valid.double(), last])
        self._sums += torch.einsum("stn,tnc->sc", steps, rollout.costs.double()).cpu()
        self._counts += steps.sum((1, 2)).cpu()

    def state(self) -> dict[str, Any]:
        """Return the sums and counts, as arrays."""
        return {"sums": array_of(self._sums), "counts": array_of(self._counts)}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self._sums, self._counts = tensor_of(state["sums"], CPU), tensor_of(state["counts"], CPU)
