"""Ensemble of M probabilistic networks that predict the next frame, the reward, the costs and the end of the episode
(Chua et al. 2018, with heads for termination and costs).

Letters: M models, B rows, K frames seen side by side of D numbers each, F numbers of an action, C costs.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from thalweg.algos.common.state import CPU, array_of, load_module, module_state, tensor_of
from thalweg.algos.maths import dynamics
from thalweg.algos.planning.model.mlp_inference import MLPInference
from thalweg.algos.planning.model.transitions import Batch
from thalweg.algos.policy.actions import Actions, constant
from thalweg.algos.policy.mlp import StackedMLP
from thalweg.algos.policy.normaliser import CLIP, Normaliser

LOG_VARIANCE = (-10.0, 0.5)
"""Where the learnt bounds of the log-variance begin, in units of the deviation of what is predicted."""
BOUNDS_WEIGHT = 0.01
"""Of the distance between them in the loss (Chua et al. 2018, appendix A.1)."""
HEADS = ("state", "reward", "cost", "end")


@dataclass(frozen=True)
class Layout:
    """Where what is in the network's output, which has 2 D + 2 + C numbers."""

    frame: int
    """D."""
    costs: int
    """C."""

    @property
    def outputs(self) -> int:
        return 2 * self.frame + 2 + self.costs

    @property
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Mean change of the frame, reward, raw log-variance of that change, logits of the costs, logit of the end:
        what passes through a sigmoid lies side by side."""
        d, c = self.frame, self.costs
        return (
            slice(0, d),
            slice(d, d + 1),
            slice(d + 1, 2 * d + 1),
            slice(2 * d + 1, 2 * d + 1 + c),
            slice(2 * d + 1 + c, 2 * d + 2 + c),
        )


def action_feature_count(actions: Actions) -> int:
    """F: numbers that an action is to a model."""
    return sum(actions.sizes) if actions.kind == "categorical" else actions.count


def action_features(actions: Actions, raw: Tensor) -> Tensor:
    """What was executed for raw actions [..., A], as numbers [..., F]: a one for each option chosen, the number itself,
    or the middle of the bin it falls into."""
    if actions.kind != "categorical":
        return actions.quantised(raw)
    first = constant((0, *itertools.accumulate(actions.sizes[:-1])), raw.device)
    return torch.zeros(*raw.shape[:-1], sum(actions.sizes), device=raw.device).scatter_(-1, raw + first, 1.0)


class Scale:
    """Mean and deviation of what is predicted, so that the network's numbers are about 1; nothing is clipped."""

    def __init__(self, size: int, device: torch.device = CPU) -> None:
        self.moments = Normaliser(size, device=device)
        self.mean, self.std = torch.zeros(size, device=device), torch.ones(size, device=device)

    def update(self, values: Tensor) -> None:
        """Take in values [B, size]."""
        self.moments.update(values)
        self._refresh()

    def state(self) -> dict[str, Any]:
        return self.moments.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.moments.load_state(state)
        self._refresh()

    def _refresh(self) -> None:
        if self.moments.count == 0:
            return
        std = (self.moments.square / self.moments.count).sqrt()
        self.mean = self.moments.mean.float()
        # What never varies is predicted as it is.
        self.std = torch.where(std > 1e-6, std, 1.0).float()


class Ensemble:
    """M models and the scales of what they see and predict."""

    def __init__(
        self,
        frame: int,
        frames: int,
        actions: Actions,
        costs: int,
        members: int,
        hidden: tuple[int, ...],
        generator: torch.Generator,
        *,
        normalise: bool = True,
    ) -> None:
        self.frames, self.actions, self.layout = frames, actions, Layout(frame, costs)
        self.inputs = frames * frame + action_feature_count(actions)
        self.stack = StackedMLP(
            members,
            self.inputs,
            hidden,
            self.layout.outputs,
            generator=generator,
            activation="swish",
            initial="truncated",
        )
        device = generator.device
        self.bounds = nn.Parameter(torch.tensor(LOG_VARIANCE, device=device).unsqueeze(-1).repeat(1, frame))
        """[2, D] of the log-variance."""
        self.observed = Normaliser(frame, normalise, device)
        """Of a frame, whichever of the K it is: imagination moves frames from place to place."""
        self.change, self.reward = Scale(frame, device), Scale(1, device)
        self.ranges = torch.tensor([[0.0], [1.0]], device=device).repeat(1, costs)
        """[2, C] the smallest cost seen, or 0, and the largest, or what makes the range 1 before any was seen."""
        self._seen = torch.zeros(2, costs, device=device)
        self.counts = torch.zeros(1 + costs + 1, dtype=torch.float64, device=device)
        """Steps taken in, then the sum of each cost's place in its range, and of the ends."""

    def update_statistics(self, batch: Batch) -> None:
        """Adapt the scales to new steps."""
        self.observed.update(batch.obs[:, -self.layout.frame :])
        going_on = ~batch.terminated
        self.change.update((batch.next_frame - batch.obs[:, -self.layout.frame :])[going_on])
        self.reward.update(batch.rewards.unsqueeze(-1))
        if len(batch.obs):
            low, high = torch.minimum(self._seen[0], batch.costs.amin(0)), self._seen[1].maximum(batch.costs.amax(0))
            self._seen = torch.stack([low, high])
            self.ranges = torch.stack([low, torch.where(high > low, high, low + 1.0)])
        shares = self.cost_shares(batch.costs).sum(0)
        counted = torch.cat([shares.new_tensor([len(batch.obs)]), shares, batch.terminated.sum().unsqueeze(0)])
        self.counts = self.counts + counted.double()

    def seen(self, obs: Tensor) -> Tensor:
        """What networks see of observations [..., K * D]: each frame normalised."""
        return self.observed(obs.unflatten(-1, (self.frames, -1))).flatten(-2)

    def cost_shares(self, costs: Tensor) -> Tensor:
        """Where costs [..., C] lie in the range seen, 0..1: what the sigmoid of their heads predicts the mean of.

        So one head serves costs that are there or not, and costs of any size.
        """
        low, high = self.ranges
        return ((costs - low) / (high - low)).clamp(0.0, 1.0)

    def losses(self, batch: Batch, rarity: float) -> Tensor:
        """Loss of each head [4, M]: state, reward, cost, end; each a mean over the batch's rows for that model.

        Args:
            batch: Rows [M, B, ...] or [B, ...].
            rarity: The most by which a rare event counts more.

        Nothing is asked of the state after an end.
        """
        x = torch.cat([self.seen(batch.obs), action_features(self.actions, batch.actions)], -1)
        out = self.stack(x)
        mean, reward, raw, cost, end = (out[..., part] for part in self.layout.parts)
        going_on = (~batch.terminated).to(out.dtype).expand(out.shape[:-1])
        change = batch.next_frame - batch.obs[..., -self.layout.frame :]
        target = ((change - self.change.mean) / self.change.std).expand_as(mean)
        variance = dynamics.bounded_variance(raw, *self.bounds)
        state = dynamics.gaussian_nll(mean, variance, target).mean(-1) * going_on
        wanted = ((batch.rewards - self.reward.mean) / self.reward.std).expand(out.shape[:-1])
        weights = dynamics.rarity((self.counts[1:] / self.counts[0].clamp(min=1)).to(out.dtype), rarity)
        shares = self.cost_shares(batch.costs).expand_as(cost)
        terminated = batch.terminated.to(out.dtype).unsqueeze(-1).expand_as(end)
        costs = dynamics.balanced_cross_entropy(cost, shares, weights[:-1])
        ends = dynamics.balanced_cross_entropy(end, terminated, weights[-1:])
        rewards = 0.5 * (reward.squeeze(-1) - wanted).square()
        return torch.stack([state.mean(-1), rewards.mean(-1), costs.sum(-1).mean(-1), ends.sum(-1).mean(-1)])

    @torch.no_grad()
    def expected(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """What the models expect of a batch [B]: mean reward, mean of each cost and of the end [2 + C], and the mean
        squared error of the change of the frame, in deviations of that change, where the episode goes on.

        Probabilities are averaged over models, as in imagination, not their logits.
        """
        out = self.stack(torch.cat([self.seen(batch.obs), action_features(self.actions, batch.actions)], -1))
        mean, reward, _, cost, end = (out[..., part] for part in self.layout.parts)
        low, high = self.ranges
        heads = [
            reward * self.reward.std + self.reward.mean,
            low + (high - low) * torch.sigmoid(cost),
            torch.sigmoid(end),
        ]
        change = batch.next_frame - batch.obs[..., -self.layout.frame :]
        errors = ((change - self.change.mean) / self.change.std - mean.mean(0)).square().mean(-1)
        return torch.cat(heads, -1).mean((0, 1)), errors[~batch.terminated].mean()

    def bounds_loss(self) -> Tensor:
        """What draws the bounds of the log-variance together."""
        return BOUNDS_WEIGHT * (self.bounds[1] - self.bounds[0]).sum()

    def state(self) -> dict[str, Any]:
        """Everything, as arrays and plain data."""
        return {
            "stack": module_state(self.stack),
            "bounds": array_of(self.bounds),
            "observed": self.observed.state(),
            "change": self.change.state(),
            "reward": self.reward.state(),
            "ranges": array_of(self.ranges),
            "seen": array_of(self._seen),
            "counts": array_of(self.counts),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        load_module(self.stack, state["stack"])
        device = self.bounds.device
        with torch.no_grad():
            self.bounds.copy_(tensor_of(state["bounds"], CPU))
        for name in ("observed", "change", "reward"):
            getattr(self, name).load_state(state[name])
        self.ranges, self._seen, self.counts = (tensor_of(state[name], device) for name in ("ranges", "seen", "counts"))


class FrozenEnsemble:
    """The ensemble as it is now, for imagination: scales folded into the last layer, so that it sees and gives
    normalised frames, rewards and costs as they are."""

    def __init__(self, ensemble: Ensemble, dtype: torch.dtype = torch.float32) -> None:
        layout = ensemble.layout
        self.layout, self.frames, self.inputs, self.members = (
            layout,
            ensemble.frames,
            ensemble.inputs,
            ensemble.stack.count,
        )
        self.clip = CLIP if ensemble.observed.enabled else None
        """Normalised frames lie within ± this."""
        layers = [(weight.clone(), bias.clone()) for weight, bias in ensemble.stack.layers]
        scale = ensemble.observed.scale
        mean, reward, raw, _, _ = layout.parts
        low, high = ensemble.bounds.detach()
        weight, bias = layers[-1]
        change = ensemble.change.std * scale
        weight[..., mean] *= change
        bias[..., mean] = bias[..., mean] * change + ensemble.change.mean * scale
        weight[..., reward] *= ensemble.reward.std
        bias[..., reward] = bias[..., reward] * ensemble.reward.std + ensemble.reward.mean
        bias[..., raw] -= high
        self.least, self.most = low.exp() * change.square(), high.exp() * change.square()
        """[D] of the variance of a normalised frame's change: σ² = least + most sigmoid(out)."""
        self.cost_low = ensemble.ranges[0]
        self.cost_range = ensemble.ranges[1] - ensemble.ranges[0]
        self.dense = MLPInference(layers, dtype)
