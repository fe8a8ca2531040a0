"""The student: a policy that sees images, and what it predicts beside its moves while it learns.

From the features of its policy it predicts the privileged state and a bird's-eye map of the channel. Letters: L steps
of a sequence, C sequences, B = L C states, M moves, O options of all branches, H numbers of the recurrent state, E
features, P numbers of the privileged state, G cells of the map.
"""

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.cuda_graphs import CudaGraphs
from thalweg.algos.common.errors import require_finite
from thalweg.algos.common.state import (
    CPU,
    generator_state,
    load_generator,
    load_module,
    module_state,
    new_generator,
)
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.targets import cross_entropy, expected_regret, move_log_probs, regrets, soft_targets
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.memory import Sequences
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.policy_file import About
from thalweg.core.compute.torch_layers import uninitialised
from thalweg.core.config import to_plain

ALGORITHM = "DAgger"
"""Name of the algorithm in files and tables."""
LEAST_RATE = 0.05
"""Learning rate at the end of a run, as a share of that at its beginning."""
LOSSES: tuple[str, ...] = ("cross_entropy", "regret", "privileged_error", "map_error")
"""Losses of a gradient step, in the order in which they are logged."""


@dataclass(frozen=True)
class Lesson:
    """Sequences of what the student saw, with what its teacher knows."""

    rows: Tensor
    """[L, C, pixels + A] uint8, see `thalweg.algos.policy.vision`."""
    fresh: Tensor
    """[L, C] bool, whether the step begins an episode."""
    starts: Tensor
    """[C, H] recurrent state before the first step; H = 0 without memory."""
    worths: Tensor
    """[L, C, M] float32, worth of each move."""
    privileged: Tensor
    """[L, C, P] float32, in metres and radians."""
    maps: Tensor
    """[L, C, G] uint8, 1 where the channel is open."""


class Student:
    """A policy with eyes, its predictions, and their optimiser, on one device.

    On a GPU, gradient steps are recorded as CUDA graphs: a memory of 32 steps takes a thousand launches, which would
    take the host longer than the GPU.
    """

    def __init__(
        self,
        config: ImitationConfig,
        actions: Actions,
        moves: np.ndarray,
        sizes: tuple[int, int],
        seed: int,
        context: Any,
        device: torch.device = CPU,
    ) -> None:
        """Initialise the networks.

        Args:
            config: Settings.
            actions: The action space, of independent branches.
            moves: [M, A] option of each move in each branch.
            sizes: P and G.
            seed: Seed of weights, samples and the order of sequences.
            context: Plain data that the policy's file keeps.
            device: Where the networks are.
        """
        self.config, self.device = config, device
        self.generator = new_generator(device, seed)
        shape = config.shape
        assert shape.eyes is not None
        self.policy = Policy(
            shape.eyes.pixels + actions.count,
            actions,
            shape,
            greedy=True,
            generator=self.generator,
            about=About(ALGORITHM, to_plain(config), context),
        )
        self.moves = torch.from_numpy(np.ascontiguousarray(moves, np.int64)).to(device)
        inputs = self.policy.actor.stack.sizes[0]
        self.privileged, self.map = (_linear(inputs, size, self.generator) for size in sizes)
        self.scale = Normaliser(sizes[0], device=device)
        """Statistics of the privileged state; it is predicted in deviations."""
        parameters = [*self.policy.actor.parameters(), *self.privileged.parameters(), *self.map.parameters()]
        self.optimiser = Adam(parameters, config.learning_rate)
        weights = [1.0, config.regret_weight, *2 * [config.auxiliary_weight]]
        self._weights = torch.tensor(weights, dtype=torch.float32, device=device)
        self._graphs = CudaGraphs(device.type == "cuda", [])
        self._held: dict[tuple[int, ...], Lesson] = {}
        """Memory on a GPU for lessons, by their numbers of steps and sequences; recorded steps read it."""
        self._found = torch.zeros(len(LOSSES), dtype=torch.float32, device=device)
        """Losses of the last gradient step."""

    def update_scale(self, privileged: Tensor) -> None:
        """Add privileged states [B, P] to the statistics by which their predictions are scaled."""
        self.scale.update(privileged.to(self.device))

    def decay(self, progress: float) -> None:
        """Set the learning rate for this share of the run, 0..1."""
        self.optimiser.rate = self.config.learning_rate * (1.0 - (1.0 - LEAST_RATE) * min(progress, 1.0))

    def learn(self, lesson: Lesson) -> dict[str, float]:
        """Take a gradient step for each batch of sequences, in random order; returns the mean losses.

        Raises `NotFiniteError` for losses that are not finite.
        """
        lesson = self._ready(lesson)
        order = torch.randperm(lesson.rows.shape[1], generator=self.generator, device=self.device)
        found = []
        for columns in order.split(self.config.sequences_per_batch):
            self._graphs.run(partial(self._step, lesson), columns, tuple(lesson.fresh.shape), None)
            found.append(self._found.clone())
        means: dict[str, float] = dict(zip(LOSSES, torch.stack(found).mean(0).tolist(), strict=True))
        require_finite(**means)
        return means

    def _ready(self, lesson: Lesson) -> Lesson:
        """Return a lesson on the device, in memory that stays in place, with the privileged state in deviations."""
        lesson = replace(lesson, privileged=self.scale(lesson.privileged.to(self.device)))
        if self.device.type == "cpu":
            return lesson
        parts = {field.name: getattr(lesson, field.name) for field in fields(lesson)}
        key = tuple(lesson.fresh.shape)
        if key not in self._held:
            self._held[key] = Lesson(
                **{name: torch.empty_like(part, device=self.device) for name, part in parts.items()}
            )
        for name, part in parts.items():
            getattr(self._held[key], name).copy_(part)
        return self._held[key]

    def _step(self, lesson: Lesson, columns: Tensor) -> None:
        """Take one gradient step on the sequences `columns`; their losses are in `_found`."""
        losses = self.losses(lesson, columns)
        self.optimiser.zero_grad()
        (self._weights * losses).sum().backward()
        for parameter in self.optimiser.parameters:
            if parameter.grad is None:
                parameter.grad = torch.zeros_like(parameter)
        self.optimiser.step(self.config.max_grad_norm)
        self._found.copy_(losses.detach())

    def losses(self, lesson: Lesson, columns: Tensor) -> Tensor:
        """Return the losses [4] of the sequences `columns`, see `LOSSES`; the lesson's privileged state is in
        deviations."""
        features = self.features(lesson, columns)
        log_probs = self.log_probs(self.policy.actor.parameters_of(features))
        regret = regrets(lesson.worths[:, columns].flatten(0, 1), self.config.worst_regret)
        seen = lesson.privileged[:, columns].flatten(0, 1)
        maps = lesson.maps[:, columns].flatten(0, 1).float()
        return torch.stack(
            [
                cross_entropy(soft_targets(regret, self.config.temperature), log_probs),
                expected_regret(regret, log_probs, self.config.worst_regret),
                (self.privileged(features) - seen).square().mean(),
                functional.binary_cross_entropy_with_logits(self.map(features), maps),
            ]
        )

    def log_probs(self, logits: Tensor) -> Tensor:
        """Return the log probabilities of moves [B, M] from the logits of the policy's network [B, O]."""
        branches = [functional.log_softmax(part, -1) for part in logits.split(self.policy.actions.sizes, -1)]
        return move_log_probs(branches, self.moves)

    def features(self, lesson: Lesson, columns: Tensor) -> Tensor:
        """Return what the policy's perceptron takes [B, E]."""
        rows, actor = lesson.rows.index_select(1, columns), self.policy.actor
        if actor.gru is None:
            return actor.features(rows.flatten(0, 1))
        every = torch.arange(rows.shape[0] * rows.shape[1], device=self.device)
        return actor.features(Sequences(rows, lesson.fresh[:, columns], {"actor": lesson.starts[columns]}, every))

    def state(self) -> dict[str, Any]:
        """Return everything that learning needs to resume."""
        return {
            "actor": module_state(self.policy.actor),
            "privileged": module_state(self.privileged),
            "map": module_state(self.map),
            "scale": self.scale.state(),
            "optimiser": self.optimiser.state(),
            "generator": generator_state(self.generator),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        load_module(self.policy.actor, state["actor"])
        load_module(self.privileged, state["privileged"])
        load_module(self.map, state["map"])
        self.scale.load_state(state["scale"])
        self.optimiser.load_state(state["optimiser"])
        load_generator(self.generator, state["generator"])


def _linear(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    """Return a linear layer with small random weights from a generator."""
    layer = uninitialised(nn.Linear, inputs, outputs, device=generator.device)
    with torch.no_grad():
        layer.weight.normal_(0.0, 0.01, generator=generator)
        layer.bias.zero_()
    return layer
