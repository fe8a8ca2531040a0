"""Planning policy with its model and networks, saved as one file like any other policy.

Dimensions: N environments, D numbers of a frame, K stacked frames, H steps ahead, A numbers of a raw action, C costs.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import array_of, load_module, module_state, new_generator, tensor_of
from thalweg.algos.maths import planning
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.planning.model.ensemble import Ensemble, FrozenEnsemble
from thalweg.algos.planning.planner import Budget, Decision, Method, Planner
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.memory import FrameStack
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.player import check_obs_size, to_tensors
from thalweg.algos.policy.policy_file import LOADERS, About, check_size, save_policy, tensors_of, whole_number
from thalweg.core.config import parse_config

MakeMethod = Callable[[Any, Actions, int, Callable[[], Tensor], torch.Generator], Method]
"""Factory of a method, from config, actions, observation size, standard deviation of rewards and random generator."""
METHODS: dict[str, tuple[type[PlanningConfig], MakeMethod]] = {}
"""Config class and factory of each algorithm, by its name; each planner's file registers its own."""
VALUES_BEFORE = {"plan_budget": "share", "proposal_share": 0.0}
"""Values of settings that older files lack, with which their policies plan as they did when they were saved."""


class PlannerPolicy:
    """Policy that plans each decision in an ensemble of models."""

    def __init__(
        self, obs_size: int, actions: Actions, config: PlanningConfig, about: About, generator: torch.Generator
    ) -> None:
        self.obs_size, self.actions, self.config, self.about = obs_size, actions, config, about
        self.ensemble = Ensemble(
            obs_size,
            config.frame_stack,
            actions,
            len(config.limits),
            config.members,
            config.sizes.model_hidden,
            generator,
            normalise=config.normalise_observations,
        )
        make = METHODS[about.algorithm][1]
        inputs = config.frame_stack * obs_size
        self.method = make(config, actions, inputs, lambda: self.ensemble.reward.std, generator)
        self.planner = Planner(config, actions, self.method, generator.device)
        self.episode_length = float(config.episode_length or config.sizes.horizon)
        """L, mean steps of an episode."""
        self.ending_shares = (0.0,) * len(config.limits)
        """e [M]: share of each cost so far that ended an episode."""
        self.limits = config.limits
        """Limit d [M] on the mean cost of an episode; a schedule begins above the config's."""
        self._budget: tuple[tuple[float, ...], Budget] | None = None
        """Cached budget, with what it depends on."""
        self.frozen = self._frozen()

    @property
    def device(self) -> torch.device:
        """Device of the model and the planner."""
        return self.ensemble.bounds.device

    @property
    def normaliser(self) -> Normaliser:
        """Statistics of the observations that the model sees, D numbers of one frame."""
        return self.ensemble.observed

    @property
    def budget(self) -> Budget:
        """Cost that a plan may have under the cost limits, as `plan_budget` says."""
        length = self.episode_length
        ending = self.ending_shares if self.config.plan_budget == "ends" else (0.0,) * len(self.limits)
        of = (length, *self.limits, *ending)
        if self._budget is None or self._budget[0] != of:  # cached: copied to the device once
            steps = self.config.sizes.horizon * self.config.action_repeat
            costs = [planning.budget(d, steps, length, e) for d, e in zip(self.limits, ending, strict=True)]
            self._budget = (
                of,
                Budget(torch.tensor(costs, dtype=torch.float32, device=self.device), max(length / steps, 1.0)),
            )
        return self._budget[1]

    def refresh(self) -> None:
        """Use the current weights of the model for planning."""
        self.frozen = self._frozen()

    def _frozen(self) -> FrozenEnsemble:
        return FrozenEnsemble(self.ensemble, torch.bfloat16 if self.config.precision == "bfloat16" else torch.float32)

    def player(
        self, num_envs: int, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> "PlannerPlayer":
        """Return the policy in N environments.

        Args:
            num_envs: N.
            deterministic: Has no effect: the plan's most probable action is always taken, and the search for it is
                always random.
            generator: Random generator on the policy's device; None creates one with a fixed seed.
        """
        return PlannerPlayer(self, num_envs, generator or new_generator(self.device))

    def save(self, path: str | Path) -> None:
        """Write the policy to a file, atomically."""
        model = self.ensemble.state()
        scales = {name: model[name] for name in ("observed", "change", "reward")}
        header = {
            "kind": "planner",
            "obs_size": self.obs_size,
            "actions": self.actions.as_data(),
            "episode_length": self.episode_length,
            "ending_shares": list(self.ending_shares),
            "scales": {name: {key: state[key] for key in ("count", "enabled")} for name, state in scales.items()},
        }
        tensors = {f"model.{name}": model[name] for name in ("bounds", "ranges", "seen", "counts")}
        tensors |= {f"stack.{name}": value for name, value in model["stack"].items()}
        tensors |= {f"{name}.{key}": state[key] for name, state in scales.items() for key in ("mean", "square")}
        tensors |= {f"method.{name}": value for name, value in module_state(self.method.modules).items()}
        save_policy(path, header, {name: np.ascontiguousarray(value) for name, value in tensors.items()}, self.about)

    @classmethod
    def restored(
        cls, header: dict[str, Any], tensors: dict[str, np.ndarray], about: About, generator: torch.Generator
    ) -> "PlannerPolicy":
        """Return the saved policy on the generator's device; raises `AlgorithmError` for an unknown planner."""
        if about.algorithm not in METHODS:
            raise AlgorithmError(f"this version knows no planner {about.algorithm!r}")
        kind = METHODS[about.algorithm][0]
        older = {name: value for name, value in VALUES_BEFORE.items() if hasattr(kind, name)}
        config = parse_config(kind, older | dict(about.config))
        obs_size, actions = whole_number(header, "obs_size"), Actions.from_data(header["actions"])
        check_size(config.frame_stack * obs_size, config.sizes.model_hidden, 1, tensors, config.members)
        policy = cls(obs_size, actions, config, about, generator)
        scales = {name: header["scales"][name] | tensors_of(tensors, name) for name in ("observed", "change", "reward")}
        policy.ensemble.load_state(tensors_of(tensors, "model") | scales | {"stack": tensors_of(tensors, "stack")})
        load_module(policy.method.modules, tensors_of(tensors, "method"))
        policy.episode_length = float(header["episode_length"])
        policy.ending_shares = tuple(map(float, header.get("ending_shares", policy.ending_shares)))
        if not 0.0 < policy.episode_length < math.inf:
            raise AlgorithmError(f"episode_length must be above 0, got {policy.episode_length}")
        if len(policy.ending_shares) != len(policy.limits) or not all(0 <= each <= 1 for each in policy.ending_shares):
            raise AlgorithmError(f"ending_shares must be {len(policy.limits)} shares, got {policy.ending_shares!s:.80}")
        policy.refresh()
        return policy


LOADERS["planner"] = PlannerPolicy.restored


class PlannerPlayer:
    """Planning policy in N environments, with the frame stack, plan and current action of each."""

    def __init__(
        self,
        policy: PlannerPolicy,
        num_envs: int,
        generator: torch.Generator,
        *,
        stacked: bool = False,
        exploration: float = 0.0,
    ) -> None:
        """`stacked`: whether observations already contain their K frames; `exploration`: share of decisions that are
        sampled from the plan instead of taking its most probable action."""
        self.policy, self.generator, self.exploration = policy, generator, exploration
        frames = policy.config.frame_stack
        self._size = policy.obs_size * (frames if stacked else 1)
        self._stack = FrameStack(num_envs, policy.obs_size, 1 if stacked else frames, policy.device)
        self._plans = policy.planner.distribution.first(num_envs)
        """[N, H, A, W], plan of the last decision of each environment."""
        self._planned = torch.zeros(num_envs, dtype=torch.bool, device=policy.device)
        """[N], whether there is such a plan in the current episode."""
        self._current_action = policy.planner.distribution.mode(self._plans)
        """[N, A], raw actions being repeated."""
        self._repeats_left = torch.zeros(num_envs, dtype=torch.int64, device=policy.device)
        """[N], steps for which they are still repeated."""

    def __call__(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        return self.policy.actions.to_numpy(self.raw(*to_tensors(obs, fresh, self.policy.device))[0])

    @torch.inference_mode()
    def raw(self, obs: Tensor, fresh: Tensor, *, at_random: bool = False) -> tuple[Tensor, Decision | None]:
        """Return raw actions [N, A], and the decision for the environments that planned at this step, None if none did.

        `at_random` takes uniformly random actions instead of planning.
        """
        check_obs_size(obs, self._size)
        seen = self._stack.push(obs, fresh)
        self._planned &= ~fresh
        if self.policy.config.action_repeat > 1:
            deciding = torch.nonzero((self._repeats_left == 0) | fresh).squeeze(-1)
        else:  # all environments decide at every step: no search, which would synchronise the device
            deciding = torch.arange(len(fresh), device=fresh.device)
        decision = None
        if len(deciding):
            self._current_action = self._current_action.clone()
            if at_random:
                self._current_action[deciding] = self.policy.actions.uniform(len(deciding), self.generator)
            else:
                decision, self._current_action[deciding] = self._decide(seen[deciding], deciding)
            # Assigning a number by index would copy it from the host and wait for the device.
            self._repeats_left.index_fill_(0, deciding, self.policy.config.action_repeat)
        self._repeats_left -= 1
        return self._current_action.clone(), decision

    def _decide(self, obs: Tensor, deciding: Tensor) -> tuple[Decision, Tensor]:
        """Plan for the environments with the given indices; returns the decision and raw actions."""
        policy, search = self.policy, self.policy.planner.distribution
        shape = (-1, *[1] * (self._plans.dim() - 1))
        guess = torch.where(
            self._planned[deciding].view(shape), search.shifted(self._plans[deciding]), search.first(len(deciding))
        )
        start = policy.ensemble.normalised(obs)
        decision = policy.planner.decide(policy.frozen, start, guess, policy.budget, self.generator)
        self._plans[deciding] = decision.plan
        self._planned.index_fill_(0, deciding, True)
        best = search.mode(decision.plan)
        if not self.exploration:
            return decision, best
        explores = (
            torch.rand(len(deciding), 1, dtype=torch.float32, generator=self.generator, device=deciding.device)
            < self.exploration
        )
        return decision, torch.where(explores, search.draw(decision.plan, self.generator), best)

    def state(self) -> dict[str, Any]:
        """Return the frame stack, plans and current actions, as arrays."""
        return {
            "frames": self._stack.state(),
            "plans": array_of(self._plans),
            "planned": array_of(self._planned),
            "held": array_of(self._current_action),
            "left": array_of(self._repeats_left),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self._stack.load_state(state["frames"])
        self._plans, self._planned, self._current_action, self._repeats_left = (
            tensor_of(state[name], self.policy.device) for name in ("plans", "planned", "held", "left")
        )
