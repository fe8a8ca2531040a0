"""OmniSafe's side of the comparison, in a process that runs under OmniSafe's Python and imports nothing of Thalweg.

`compare.py` starts it. It reads one request as JSON from standard input and, after training, writes one line of JSON to
standard output. OmniSafe is not modified: the environment is registered as its guide says, and all settings go through
its own configuration. Its logs are not used; the environment itself records episodes and times.

A request has the `algorithm`, the `settings` as OmniSafe nests them, and the number of steps between two time stamps,
`stamp_every`. The answer has

* episodes: [step, return, cost, length] of each finished episode, counted in steps of the environment;
* stamps: [steps, seconds, seconds of processor time] after every `stamp_every` steps, and at the end;
* decisions: seconds of each decision of a planner;
* gradient_steps: number of steps of each optimiser;
* networks: the shapes of all weights;
* environment_s: seconds inside the toy;
* versions.
"""

import importlib.metadata
import json
import os
import platform
import sys
import tempfile
import time
from collections import Counter
from typing import Any, ClassVar

import numpy as np
import omnisafe  # pyright: ignore[reportMissingImports]
import torch
from gymnasium import spaces
from omnisafe.envs.core import CMDP, env_register  # pyright: ignore[reportMissingImports]
from torch.optim.optimizer import register_optimizer_step_post_hook

from toy import ACTIONS, CHANCE, LENGTH, RISK, SIZE, Toy  # isort: skip  beside this file

FIRST = np.zeros(1, np.int64)


class Record:
    """Records the episodes and times of the training environment."""

    def __init__(self, stamp_every: int) -> None:
        self.every, self.steps, self.stamps = stamp_every, 0, []
        self.episodes, self.inside = [], 0.0
        self.return_, self.cost, self.length = 0.0, 0.0, 0

    def begin(self) -> None:
        self.return_, self.cost, self.length = 0.0, 0.0, 0

    def before(self, now: float) -> None:
        if self.steps % self.every == 0:
            self.stamp(now)

    def stamp(self, now: float) -> None:
        self.stamps.append((self.steps, now, time.process_time()))

    def after(self, reward: float, cost: float, done: bool) -> None:
        self.steps += 1
        self.return_, self.cost, self.length = self.return_ + reward, self.cost + cost, self.length + 1
        if done:
            self.episodes.append([self.steps, self.return_, self.cost, self.length])


@env_register
class ToyCMDP(CMDP):  # pyright: ignore[reportUntypedBaseClass]
    """The toy as an environment of OmniSafe. The first instance writes the record; later ones are for evaluation."""

    _support_envs: ClassVar[list] = ["Toy-v0"]
    _num_envs = 1
    need_auto_reset_wrapper = True
    need_time_limit_wrapper = False
    record: ClassVar[Any] = None

    def __init__(self, env_id: str, **_: Any) -> None:
        self._observation_space = spaces.Box(-np.inf, np.inf, (SIZE,), np.float32)
        self._action_space = spaces.Box(-1.0, 1.0, (ACTIONS,), np.float32)
        self._metadata = {}
        self.toy = Toy(1)
        self.writes, ToyCMDP.record = ToyCMDP.record, None

    @property
    def max_episode_steps(self) -> int:
        return LENGTH

    def set_seed(self, seed: int) -> None:
        self.toy.seed([seed])

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        if seed is not None:
            self.set_seed(seed)
        self.toy.begin(FIRST)
        if self.writes:
            self.writes.begin()
        return torch.from_numpy(self.toy.observations()[0]), {}

    def step(self, action: Any) -> Any:
        start = time.perf_counter()
        if self.writes:
            self.writes.before(start)
        reward, cost, terminated, truncated = self.toy.step(action.detach().numpy()[None])
        if self.writes:
            self.writes.after(float(reward[0]), float(cost[0]), bool(terminated[0] or truncated[0]))
        signals = [torch.as_tensor(x[0], dtype=torch.float32) for x in (reward, cost)]
        ends = [torch.as_tensor(x[0]) for x in (terminated, truncated)]
        obs = torch.from_numpy(self.toy.observations()[0])
        if self.writes:
            self.writes.inside += time.perf_counter() - start
        return (obs, *signals, *ends, {})

    def get_cost_from_obs_tensor(self, obs: Any, is_binary: bool = True) -> Any:
        """Return the cost [..., 1] for planners that do not learn it: the probability of a fall."""
        return RISK * obs[..., CHANCE : CHANCE + 1].clamp(0.0, 1.0)

    def render(self) -> None:
        return None

    def close(self) -> None:
        return None


class Counting:
    """Counts the steps of each optimiser of an agent, by its attribute name."""

    def __init__(self) -> None:
        self.counted = Counter()
        register_optimizer_step_post_hook(self)

    def __call__(self, optimizer: Any, *_: Any) -> None:
        self.counted[id(optimizer)] += 1

    def by_name(self, agent: Any) -> dict:
        names = {}
        owners = [getattr(agent, name, None) for name in ("_actor_critic", "_lagrange", "_dynamics")]
        owners += [getattr(owners[2], "ensemble_model", None), agent]
        for owner in filter(None, owners):
            names |= {id(value): name for name, value in vars(owner).items() if name.endswith("optimizer")}
        return {names.get(key, "other"): count for key, count in self.counted.items()}


def shapes(agent: Any) -> dict:
    """Return the shapes of all weights, network by network."""
    parts = dict(getattr(agent, "_actor_critic", torch.nn.Module()).named_children())
    if hasattr(agent, "_dynamics"):
        parts["dynamics"] = agent._dynamics.ensemble_model
    return {name: [list(weights.shape) for weights in part.parameters()] for name, part in parts.items()}


def timed(planner: Any) -> list:
    """Return a list to which the planner will append the seconds of each decision."""
    spent, decide = [], planner.output_action

    def timed_decide(*arguments: Any, **named: Any) -> Any:
        start = time.perf_counter()
        action = decide(*arguments, **named)
        spent.append(time.perf_counter() - start)
        return action

    planner.output_action = timed_decide
    return spent


def versions() -> dict:
    """Return the versions of Python, OmniSafe and the libraries that matter for speed and learning."""
    numbers = {name: importlib.metadata.version(name) for name in ("omnisafe", "torch", "numpy")}
    return {"python": platform.python_version(), **numbers}


def run_request(order: dict) -> dict:
    """Train as requested; returns the answer."""
    record = ToyCMDP.record = Record(order["stamp_every"])
    counting = Counting()
    agent = omnisafe.Agent(order["algorithm"], "Toy-v0", custom_cfgs=order["settings"])  # pyright: ignore[reportAttributeAccessIssue]
    decisions = timed(agent.agent._planner) if hasattr(agent.agent, "_planner") else []
    agent.agent.learn()
    record.stamp(time.perf_counter())
    return {
        "episodes": record.episodes,
        "stamps": record.stamps,
        "decisions": decisions,
        "gradient_steps": counting.by_name(agent.agent),
        "networks": shapes(agent.agent),
        "environment_s": record.inside,
        "versions": versions(),
    }


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of OmniSafe must not mix with the answer
    order = json.load(sys.stdin)
    with tempfile.TemporaryDirectory() as folder:
        order["settings"].setdefault("logger_cfgs", {})["log_dir"] = folder
        answer = run_request(order)
    print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
