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

GAIN = 0.01
"""Of the loss held out, relative, that counts as getting better."""
MOST_EPOCHS = 100
"""Of one refit."""


class Fitter:
    """Adam and the weight decay of each layer."""

    def __init__(self, ensemble: Ensemble, config: PlanningConfig, generator: torch.Generator) -> None:
        self.ensemble, self.config, self.generator = ensemble, config, generator
        learnt = [ensemble.stack.flat] if config.fixed_variance_bounds else [ensemble.stack.flat, ensemble.bounds]
        self.optimiser = Adam(learnt, config.model_learning_rate)
        self._decay = _decays(ensemble, config.model_decay)
        self._since_refit = 0

    def fit(self, replay: ReplayBuffer, new_steps: int) -> Tensor | None:
        """Learn as the config says after so many new steps; returns the mean loss of each head [4] over the gradient
        steps, None if there were none."""
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
        """Loss of each head [4, M] on the steps held out."""
        return self.ensemble.losses(replay.held_out(), 1.0)

    def _steady(self, replay: ReplayBuffer) -> list[Tensor]:
        shape = (self.ensemble.stack.count, self.config.minibatch)
        return [self._step(replay, replay.places(shape, self.generator)) for _ in range(self.config.model_steps)]

    def _refit(self, replay: ReplayBuffer) -> list[Tensor]:
        """Epochs over the whole replay, each model in an order of its own, until none has gained for a while."""
        members, log = self.ensemble.stack.count, []
        fitted = replay.fitted()
        device, patience = fitted.device, self.config.refit_patience
        best = torch.full((members,), torch.inf, device=device)
        for _ in range(MOST_EPOCHS):
            drawn = [torch.randperm(len(fitted), generator=self.generator, device=device) for _ in range(members)]
            orders = [fitted[order] for order in drawn]
            log += [self._step(replay, places) for places in torch.stack(orders).split(self.config.minibatch, 1)]
            error = self.held_out(replay).sum(0)
            better = best.isinf() | (best - error > GAIN * best.abs())
            best = torch.where(better, error, best)
            patience = self.config.refit_patience if better.any() else patience - 1
            if patience == 0:
                break
        return log

    def _step(self, replay: ReplayBuffer, places: Tensor) -> Tensor:
        """One gradient step on the transitions at places [M, B]; returns the losses [4]."""
        losses = self.ensemble.losses(replay.rows(places), self.config.rarity)
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
        """What it remembers."""
        return {"optimiser": self.optimiser.state(), "since_refit": self._since_refit}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self.optimiser.load_state(state["optimiser"])
        self._since_refit = int(state["since_refit"])


def _decays(ensemble: Ensemble, last: float) -> Tensor:
    """Weight decay of each number of the stack's vector: a quarter of `last` in the first layer, rising to it by equal
    steps; none of biases. In the code of Chua et al. 2018 it rises as well, by steps chosen for each task."""
    sizes, count = ensemble.stack.sizes, ensemble.stack.count
    decays = torch.zeros_like(ensemble.stack.flat.detach())
    shares = np.linspace(0.25, 1.0, len(list(itertools.pairwise(sizes))))
    for (weight, _), share in zip(layers_of(decays, count, sizes), shares, strict=True):
        weight.fill_(last * float(share))
    return decays
