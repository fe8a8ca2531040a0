"""Ensemble of M probabilistic networks that predict the next frame, the reward, the costs and the end of the episode
(Chua et al. 2018, with heads for termination and costs).

Dimensions: M models, B rows, K stacked frames of D numbers, F action features, C costs.
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
"""Initial bounds of the log-variance, with the predicted change in units of its standard deviation."""
BOUNDS_WEIGHT = 0.01
"""Weight of the distance between the two bounds in the loss (Chua et al. 2018, appendix A.1)."""
HEADS = ("state", "reward", "cost", "end")


@dataclass(frozen=True)
class OutputLayout:
    """Layout of the network's output, which has 2 D + 2 + C numbers."""

    frame: int
    """D, numbers of a frame."""
    costs: int
    """C, number of costs."""

    @property
    def outputs(self) -> int:
        """Size of the output."""
        return 2 * self.frame + 2 + self.costs

    @property
    def slices(self) -> tuple[slice, slice, slice, slice, slice]:
        """Mean change of the frame, reward, raw log-variance of that change, logits of the costs, logit of the end.

        The outputs that a sigmoid follows are adjacent, so that one call covers them.
        """
        d, c = self.frame, self.costs
        return (
            slice(0, d),
            slice(d, d + 1),
            slice(d + 1, 2 * d + 1),
            slice(2 * d + 1, 2 * d + 1 + c),
            slice(2 * d + 1 + c, 2 * d + 2 + c),
        )


def action_feature_count(actions: Actions) -> int:
    """Return F, size of `action_features`."""
    return sum(actions.sizes) if actions.kind == "categorical" else actions.count


def action_features(actions: Actions, raw: Tensor) -> Tensor:
    """Return features [..., F] of the actions executed for raw actions [..., A].

    Discrete actions are one-hot, continuous ones unchanged, or the middle of their bin with the adapter "box_scaled".
    """
    if actions.kind != "categorical":
        return actions.quantised(raw)
    first = constant((0, *itertools.accumulate(actions.sizes[:-1])), raw.device)
    return torch.zeros(*raw.shape[:-1], sum(actions.sizes), dtype=torch.float32, device=raw.device).scatter_(
        -1, raw + first, 1.0
    )


class TargetScale:
    """Running mean and standard deviation of a prediction target, which scale it to about 1 without clipping."""

    def __init__(self, size: int, device: torch.device = CPU) -> None:
        self.moments = Normaliser(size, device=device)
        self.mean, self.std = (
            torch.zeros(size, dtype=torch.float32, device=device),
            torch.ones(size, dtype=torch.float32, device=device),
        )

    def update(self, values: Tensor) -> None:
        """Add values [B, size]."""
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
        # A constant target is not scaled: its standard deviation is 0.
        self.std = torch.where(std > 1e-6, std, 1.0).float()


class Ensemble:
    """M models, with the statistics that normalise their inputs and targets."""

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
        self.frames, self.actions, self.layout = frames, actions, OutputLayout(frame, costs)
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
        self.bounds = nn.Parameter(
            torch.tensor(LOG_VARIANCE, dtype=torch.float32, device=device).unsqueeze(-1).repeat(1, frame)
        )
        """[2, D], lower and upper bounds of the log-variance."""
        self.observed = Normaliser(frame, normalise, device)
        """Statistics of a frame, the same for all K: imagined rollouts shift frames within the stack."""
        self.change, self.reward = TargetScale(frame, device), TargetScale(1, device)
        self.ranges = torch.tensor([[0.0], [1.0]], dtype=torch.float32, device=device).repeat(1, costs)
        """[2, C], least and largest cost so far, 0 included; the range is 1 until two different costs were seen."""
        self._cost_extremes = torch.zeros(2, costs, dtype=torch.float32, device=device)
        self.counts = torch.zeros(1 + costs + 1, dtype=torch.float64, device=device)
        """Number of steps, then the sums of `cost_shares` and of terminations, for the weights of rare events."""

    def update_statistics(self, batch: Batch) -> None:
        """Update the statistics with new transitions."""
        self.observed.update(batch.obs[:, -self.layout.frame :])
        continues = ~batch.terminated
        self.change.update((batch.next_frame - batch.obs[:, -self.layout.frame :])[continues])
        self.reward.update(batch.rewards.unsqueeze(-1))
        if len(batch.obs):
            low, high = (
                torch.minimum(self._cost_extremes[0], batch.costs.amin(0)),
                self._cost_extremes[1].maximum(batch.costs.amax(0)),
            )
            self._cost_extremes = torch.stack([low, high])
            self.ranges = torch.stack([low, torch.where(high > low, high, low + 1.0)])
        shares = self.cost_shares(batch.costs).sum(0)
        counted = torch.cat([shares.new_tensor([len(batch.obs)]), shares, batch.terminated.sum().unsqueeze(0)])
        self.counts = self.counts + counted.double()

    def normalised(self, obs: Tensor) -> Tensor:
        """Return the inputs of the networks: observations [..., K * D] with each frame normalised."""
        return self.observed(obs.unflatten(-1, (self.frames, -1))).flatten(-2)

    def cost_shares(self, costs: Tensor) -> Tensor:
        """Return the costs [..., C] scaled by their range to 0..1; the sigmoid of each cost head predicts their mean.

        One kind of head thus predicts both binary costs and costs of any size.
        """
        low, high = self.ranges
        return ((costs - low) / (high - low)).clamp(0.0, 1.0)

    def losses(self, batch: Batch, rarity: float) -> Tensor:
        """Return the losses [4, M] of the heads (state, reward, cost, end) for each model, means over the batch.

        Args:
            batch: Transitions [M, B, ...] or [B, ...].
            rarity: Largest weight of a rare event relative to its absence.

        The state loss ignores frames after a termination.
        """
        x = torch.cat([self.normalised(batch.obs), action_features(self.actions, batch.actions)], -1)
        out = self.stack(x)
        mean, reward, raw, cost, end = (out[..., part] for part in self.layout.slices)
        continues = (~batch.terminated).to(out.dtype).expand(out.shape[:-1])
        change = batch.next_frame - batch.obs[..., -self.layout.frame :]
        target = ((change - self.change.mean) / self.change.std).expand_as(mean)
        variance = dynamics.bounded_variance(raw, *self.bounds)
        state = dynamics.gaussian_nll(mean, variance, target).mean(-1) * continues
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
        """Return mean predictions, and the error of the predicted frame, for a batch [B].

        Returns the means of reward, costs and termination [1 + C + 1], and the mean squared error of the frame's change
        [], in units of its variance, over the steps that do not terminate.

        Probabilities are averaged over models, not logits, as in imagined rollouts.
        """
        out = self.stack(torch.cat([self.normalised(batch.obs), action_features(self.actions, batch.actions)], -1))
        mean, reward, _, cost, end = (out[..., part] for part in self.layout.slices)
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
        """Return the loss [] that pulls the bounds of the log-variance together."""
        return BOUNDS_WEIGHT * (self.bounds[1] - self.bounds[0]).sum()

    def state(self) -> dict[str, Any]:
        """Return the weights and statistics, as arrays and plain data."""
        return {
            "stack": module_state(self.stack),
            "bounds": array_of(self.bounds),
            "observed": self.observed.state(),
            "change": self.change.state(),
            "reward": self.reward.state(),
            "ranges": array_of(self.ranges),
            "seen": array_of(self._cost_extremes),
            "counts": array_of(self.counts),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        load_module(self.stack, state["stack"])
        device = self.bounds.device
        with torch.no_grad():
            self.bounds.copy_(tensor_of(state["bounds"], CPU))
        for name in ("observed", "change", "reward"):
            getattr(self, name).load_state(state[name])
        self.ranges, self._cost_extremes, self.counts = (
            tensor_of(state[name], device) for name in ("ranges", "seen", "counts")
        )


class FrozenEnsemble:
    """Copy of an ensemble for imagined rollouts, with the scales of the targets folded into the last layer.

    Frames go in and come out normalised; rewards and costs come out in their own units.
    """

    def __init__(self, ensemble: Ensemble, dtype: torch.dtype = torch.float32) -> None:
        layout = ensemble.layout
        self.layout, self.frames = layout, ensemble.frames
        self.inputs, self.members = ensemble.inputs, ensemble.stack.count
        self.clip = CLIP if ensemble.observed.enabled else None
        """Bound of normalised frames; None without normalisation."""
        layers = [(weight.clone(), bias.clone()) for weight, bias in ensemble.stack.layers]
        scale = ensemble.observed.scale
        mean, reward, raw, _, _ = layout.slices
        low, high = ensemble.bounds.detach()
        weight, bias = layers[-1]
        change = ensemble.change.std * scale
        weight[..., mean] *= change
        bias[..., mean] = bias[..., mean] * change + ensemble.change.mean * scale
        weight[..., reward] *= ensemble.reward.std
        bias[..., reward] = bias[..., reward] * ensemble.reward.std + ensemble.reward.mean
        bias[..., raw] -= high
        self.min_variance, self.variance_scale = low.exp() * change.square(), high.exp() * change.square()
        """[D] each; the variance of a normalised frame's change is min_variance + variance_scale · sigmoid(out)."""
        self.cost_low = ensemble.ranges[0]
        self.cost_range = ensemble.ranges[1] - ensemble.ranges[0]
        self.dense = MLPInference(layers, dtype)
