"""Fitting of the ensemble to the replay buffer: a fixed number of gradient steps per collection, or epochs until the
held-out loss stops improving."""

import itertools
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.adam import Adam
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.planning.model.ensemble import Ensemble
from thalweg.algos.planning.model.transitions import ReplayBuffer
from thalweg.algos.policy.mlp_autograd import layers_of

MIN_IMPROVEMENT = 0.01
"""Least relative decrease of the held-out loss that counts as an improvement."""
MAX_EPOCHS = 100
"""Upper bound of the epochs of one refit."""


class Fitter:
    """Optimiser of the ensemble: Adam with a weight decay that differs between layers."""

    def __init__(self, ensemble: Ensemble, config: PlanningConfig, generator: torch.Generator) -> None:
        self.ensemble, self.config, self.generator = ensemble, config, generator
        learnt = [ensemble.stack.flat] if config.fixed_variance_bounds else [ensemble.stack.flat, ensemble.bounds]
        self.optimiser = Adam(learnt, config.model_learning_rate)
        self._decay = _decays(ensemble, config.model_decay)
        self._since_refit = 0

    def fit(self, replay: ReplayBuffer, new_steps: int) -> Tensor | None:
        """Fit the ensemble after `new_steps` environment steps, as `fitting` in the config says.

        Returns the mean loss of each head [4] over the gradient steps, None if there were none.
        """
        self._since_refit += new_steps
        if not replay.size:
            return None
        if self.config.fitting == "steady":
            return self._mean(self._steady(replay))
        if self._since_refit < self.config.refit_steps:
            return None
        self._since_refit %= self.config.refit_steps
        return self._mean(self._refit(replay))

    @torch.no_grad()
    def held_out(self, replay: ReplayBuffer) -> Tensor:
        """Return the loss of each head [4, M] on the held-out transitions."""
        return self.ensemble.losses(replay.held_out(), 1.0)

    def _steady(self, replay: ReplayBuffer) -> list[Tensor]:
        """Take `model_steps` gradient steps on random minibatches, one per model."""
        shape = (self.ensemble.stack.count, self.config.minibatch)
        return [
            self._step(replay, replay.sample_indices(shape, self.generator)) for _ in range(self.config.model_steps)
        ]

    def _refit(self, replay: ReplayBuffer) -> list[Tensor]:
        """Run epochs over the replay buffer, each model in its own order, until no held-out loss improves any more."""
        members, log = self.ensemble.stack.count, []
        training = replay.training_indices()
        if not len(training):  # of one transition, which is held out
            return []
        device, patience = training.device, self.config.refit_patience
        best = torch.full((members,), torch.inf, dtype=torch.float32, device=device)
        for _ in range(MAX_EPOCHS):
            permutations = [
                torch.randperm(len(training), generator=self.generator, device=device) for _ in range(members)
            ]
            orders = [training[order] for order in permutations]
            log += [self._step(replay, indices) for indices in torch.stack(orders).split(self.config.minibatch, 1)]
            error = self.held_out(replay).sum(0)
            better = best.isinf() | (best - error > MIN_IMPROVEMENT * best.abs())
            best = torch.where(better, error, best)
            patience = self.config.refit_patience if better.any() else patience - 1
            if patience == 0:
                break
        return log

    def _step(self, replay: ReplayBuffer, indices: Tensor) -> Tensor:
        """Take one gradient step on the transitions with indices [M, B]; returns the losses [4]."""
        losses = self.ensemble.losses(replay.rows(indices), self.config.rarity)
        self.optimiser.zero_grad()
        (losses.sum() + self.ensemble.bounds_loss()).backward()
        flat = self.ensemble.stack.flat
        assert flat.grad is not None
        flat.grad.addcmul_(self._decay, flat.detach())
        self.optimiser.step()
        return losses.detach().mean(-1)

    @staticmethod
    def _mean(log: list[Tensor]) -> Tensor | None:
        return torch.stack(log).mean(0) if log else None

    def state(self) -> dict[str, Any]:
        """Return the optimiser state and steps since the last refit."""
        return {"optimiser": self.optimiser.state(), "since_refit": self._since_refit}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.optimiser.load_state(state["optimiser"])
        self._since_refit = int(state["since_refit"])


def _decays(ensemble: Ensemble, last: float) -> Tensor:
    """Return the weight decay of each parameter: 0 for biases, from `last` / 4 to `last` for weights.

    It rises in the code of Chua et al. 2018 as well, in steps chosen for each task.
    """
    sizes, count = ensemble.stack.sizes, ensemble.stack.count
    decays = torch.zeros_like(ensemble.stack.flat.detach())
    shares = np.linspace(0.25, 1.0, len(list(itertools.pairwise(sizes))))
    for (weight, _), share in zip(layers_of(decays, count, sizes), shares, strict=True):
        weight.fill_(last * float(share))
    return decays
