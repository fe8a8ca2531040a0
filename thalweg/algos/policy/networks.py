"""The networks of a policy and its critics: the actor and a stack of critics, each with an optional recurrent memory.

Letters: B rows, D numbers of an observation, M numbers of a recurrent state, P parameters of an action distribution.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.algos.common.adam import Adam
from thalweg.algos.maths import losses
from thalweg.algos.policy import fast_path, mlp_numba
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.memory import Gru, Sequences
from thalweg.algos.policy.mlp import Initial, StackedMLP
from thalweg.algos.policy.mlp_autograd import Activation
from thalweg.algos.policy.vision import Convolutions, Eyes

BLOCK_ROWS = 1024
"""Rows of a block in `Actor.in_blocks`."""


@dataclass(frozen=True)
class NetworkShape:
    """Sizes, activation and initialisation of a policy's network and its critics."""

    hidden: tuple[int, ...] = (64, 64)
    activation: Activation = "tanh"
    initial: Initial = "orthogonal"
    memory: int = 0
    """Size of the recurrent state; 0: no memory."""
    eyes: Eyes | None = None
    """Convolutions of a policy that sees images; None: it sees numbers."""

    def as_data(self) -> dict[str, Any]:
        """Return plain data for JSON, which `from_data` reads."""
        data = asdict(self)
        if self.eyes is None:
            del data["eyes"]  # as in files from before there were any
        return data

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> "NetworkShape":
        """Return the shape of `as_data`."""
        eyes = data.get("eyes")
        if eyes is not None:
            eyes = Eyes(tuple(eyes["image"]), tuple(eyes["filters"]), eyes["features"])
        return cls(**{**data, "hidden": tuple(data["hidden"]), "eyes": eyes})


class Actor(nn.Module):
    """Parameters [B, P] of the action distribution, from observations [B, D] or from sequences.

    They are logits or numbers, see `Actions.outputs`. Those of a Gaussian policy are means and log standard deviations,
    which are the same in every state. With eyes, observations are rows of bytes, see `thalweg.algos.policy.vision`.
    """

    def __init__(self, inputs: int, actions: Actions, shape: NetworkShape, generator: torch.Generator) -> None:
        super().__init__()
        sizes = actions.sizes or (1,) * actions.count
        self.eyes = Convolutions(shape.eyes, sizes, generator) if shape.eyes else None
        inputs = inputs if self.eyes is None else self.eyes.outputs
        self.gru = Gru(inputs, shape.memory, generator) if shape.memory else None
        # With a last layer near zero, the first policy is nearly uniform over the options, whatever it observes.
        self.stack = StackedMLP(
            1,
            inputs + shape.memory,
            shape.hidden,
            actions.outputs,
            last_gain=0.01,
            activation=shape.activation,
            initial=shape.initial,
            generator=generator,
        )
        log_std = torch.zeros(actions.count, dtype=torch.float32, device=generator.device)
        self.log_std = nn.Parameter(log_std) if actions.kind == "gaussian" else None

    def forward(self, inputs: Tensor | Sequences, twice_differentiable: bool = False) -> Tensor:
        """Return [B, P]; with `twice_differentiable`, by the definition, which has second derivatives."""
        return self.parameters_of(self.features(inputs), twice_differentiable)

    def features(self, inputs: Tensor | Sequences) -> Tensor:
        """Return what the perceptron takes [B, E]: observations or features of images, and the recurrent state."""
        return _features(self.gru, self.seen(inputs), "actor")

    def parameters_of(self, features: Tensor, twice_differentiable: bool = False) -> Tensor:
        """Return [B, P] from `features`."""
        outputs = (self.stack.reference if twice_differentiable else self.stack)(features)[0]
        return outputs if self.log_std is None else torch.cat([outputs, self.log_std.expand_as(outputs)], -1)

    def seen(self, inputs: Tensor | Sequences) -> Tensor | Sequences:
        """Return what the rest of the network sees of inputs: features of images, or the inputs themselves."""
        if self.eyes is None:
            return inputs
        if isinstance(inputs, Tensor):
            return self.eyes.in_blocks(inputs)
        features = self.eyes.in_blocks(inputs.obs.flatten(0, 1))
        return replace(inputs, obs=features.view(*inputs.obs.shape[:2], -1))

    def in_blocks(self, inputs: Tensor | Sequences) -> Tensor:
        """Return [B, P] for all states of a rollout, computed in blocks of rows that stay in the processor's cache."""
        return (
            torch.cat([self(rows) for rows in inputs.split(BLOCK_ROWS)]) if isinstance(inputs, Tensor) else self(inputs)
        )

    def forward_and_backward(self, inputs: Tensor | Sequences) -> tuple[Tensor, Callable[[Tensor], None]]:
        """Return [B, P] and a function that backpropagates.

        The function takes the gradient of [B, P] and leaves that of the network in `grad`, replacing what was there.
        """
        if not isinstance(inputs, Tensor) or self.eyes is not None:
            for parameter in self.parameters():
                parameter.grad = None
            recorded = self(inputs)
            return recorded.detach(), recorded.backward
        outputs, backward_stack = self.stack.forward_and_backward(inputs)
        log_std, count = self.log_std, outputs.shape[-1]
        parameters = outputs[0]
        if log_std is not None:
            parameters = torch.cat([parameters, log_std.detach().expand_as(parameters)], -1)

        def backward(grad: Tensor) -> None:
            backward_stack(grad[:, :count].unsqueeze(0))
            if log_std is not None:
                log_std.grad = grad[:, count:].sum(0)

        return parameters, backward

    def clear_inputs(self, which: Tensor) -> None:
        """Set the weights of the observation's numbers `which` [D] bool to 0; not for images."""
        clear_inputs(self.gru, self.stack, which)

    def step(self, obs: Tensor, state: Tensor, fresh: Tensor) -> tuple[Tensor, Tensor]:
        """Return [N, P] and the recurrent state after observations [N, D]."""
        assert self.gru is not None
        seen = obs if self.eyes is None else self.eyes(obs)
        state = self.gru.step(seen, state, fresh)
        return self.parameters_of(torch.cat([seen, state], -1)), state


def clear_inputs(gru: Gru | None, stack: StackedMLP, which: Tensor) -> None:
    """Set the weights of inputs to 0, of a recurrent network and of the perceptrons that see the same inputs: those of
    `which` [d] bool among the first d inputs."""
    stack.clear_inputs(which)
    if gru is not None:
        gru.clear_inputs(which)


def minibatch_count(rows: int, minibatch: int) -> int:
    """Return the number of minibatches of about `minibatch` rows each, none of which is a small remainder."""
    return max(1, round(rows / minibatch))


def minibatch_bounds(rows: int, minibatch: int) -> np.ndarray:
    """Return the first row of each minibatch, and the end of the last one."""
    batches = np.array_split(np.arange(rows), minibatch_count(rows, minibatch))
    return np.concatenate([[0], np.cumsum([len(batch) for batch in batches])])


class Critics(nn.Module):
    """`count` perceptrons with one output each: [B, D] or sequences -> [count, B].

    They share no weights, except that with a memory they share one recurrent network.
    """

    def __init__(self, count: int, inputs: int, shape: NetworkShape, generator: torch.Generator) -> None:
        super().__init__()
        self.count = count
        self.gru = Gru(inputs, shape.memory, generator) if shape.memory else None
        self.stack = StackedMLP(
            count,
            inputs + shape.memory,
            shape.hidden,
            1,
            activation=shape.activation,
            initial=shape.initial,
            generator=generator,
        )

    def forward(self, inputs: Tensor | Sequences) -> Tensor:
        return self.stack(_features(self.gru, inputs, "critics")).squeeze(-1)

    def clear_inputs(self, which: Tensor) -> None:
        """Set the weights of inputs to 0: those of `which` [d] bool among the first d inputs."""
        clear_inputs(self.gru, self.stack, which)

    @property
    def compiled(self) -> bool:
        """Whether `fit_epoch` is used: the fast path is on and the network suits compiled loops."""
        return fast_path.enabled() and self.gru is None and self.stack.compilable and self.stack.flat.is_cpu

    def fit_epoch(
        self, inputs: Tensor, targets: Tensor, *, minibatch: int, optimiser: Adam, l2: float, max_norm: float
    ) -> Tensor:
        """Take one gradient step per minibatch of about `minibatch` rows, and return the losses [steps, count].

        Each step is `regress` followed by `optimiser.step(max_norm)`, but all of them are one compiled call, which
        leaves Python to other threads.

        Args:
            inputs: [B, D].
            targets: [B, count].
            minibatch: Approximate rows of a step.
            optimiser: Adam of the parameters.
            l2: Weight of the sum of squares of all parameters.
            max_norm: Largest norm of a gradient.
        """
        bounds = minibatch_bounds(len(inputs), minibatch)
        errors = np.empty((len(bounds) - 1, self.count), np.float32)
        _, (first,), (second,), (count,) = optimiser.arrays()
        adam = mlp_numba.AdamArrays(first, second, int(count), np.float32(optimiser.rate))
        rows, aims = inputs.numpy(), targets.contiguous().numpy()
        count[...] = mlp_numba.fit_epoch(
            rows, aims, bounds, self.stack.arrays(), adam, np.float32(l2), float(max_norm), errors
        )
        return torch.from_numpy(errors)

    def regress(self, inputs: Tensor | Sequences, targets: Tensor, l2: float = 0.0) -> Tensor:
        """Return ½ E[(V - target)²] [count] for targets [count, B], and leave its gradient in `grad`.

        The gradient is that of the sum over critics plus `l2` times the sum of squares of all parameters; it replaces
        what was there.
        """
        if isinstance(inputs, Tensor) and fast_path.enabled():
            values, backward = self.stack.forward_and_backward(inputs)
            values = values.squeeze(-1)
            backward(losses.squared_error_grad(values, targets).unsqueeze(-1))
            errors = losses.squared_error(values, targets)
        else:
            for parameter in self.parameters():
                parameter.grad = None
            errors = losses.squared_error(self(inputs), targets)
            errors.sum().backward()
        for parameter in self.parameters():
            if l2 and parameter.grad is not None:
                parameter.grad.add_(parameter.detach(), alpha=2.0 * l2)
        return errors.detach()


def _features(gru: Gru | None, inputs: Tensor | Sequences, name: str) -> Tensor:
    """Return the input of the perceptrons: a tensor as it is, or the features [B, D + M] of sequences."""
    if isinstance(inputs, Tensor):
        return inputs
    assert gru is not None
    return gru.features(inputs, name)
