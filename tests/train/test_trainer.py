"""Tests of what a run tells a learner between its updates, with a learner that only writes down what it is told."""

import csv
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.train.small_runs import SMALL_PLANS
from tests.train.toys import Count, Walk
from thalweg.algos import ALGORITHMS, Entry
from thalweg.algos.common.state import CPU
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy import Policy
from thalweg.train import TrainingError, UnitWarning, run
from thalweg.train.folder.run_record import read_status
from thalweg.train.rollouts.collector import HostCollector
from thalweg.train.rollouts.env_stepper import EnvStepper
from thalweg.train.rollouts.episodes import Episode
from thalweg.train.trainer import Trainer

STEPS, EVERY = 200, 5
"""Of the run, and steps of each environment between updates."""


class Scribe:
    """Walks to the right; reports metrics after every `period`th update only."""

    def __init__(self, task: Task, *, period: int = 1, resets: bool = False, separate: bool = False) -> None:
        self.policy = Policy(task.obs_size, actions_of(task.action_space))
        self.rollout_steps, self.resets, self.separate_costs = EVERY, resets, separate
        self.period, self.updates = period, 0
        self.told: list[Feedback] = []
        self.seen: list[dict[str, torch.Tensor]] = []

    def act(self, obs: torch.Tensor, fresh: torch.Tensor) -> torch.Tensor:
        return torch.tensor([[2, 0]]).expand(len(obs), -1)[:, : self.policy.actions.count]

    def warm_up_critics(self) -> None:
        raise AssertionError("nothing was begun with")

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        self.updates += 1
        self.told.append(feedback)
        self.seen.append({name: value.clone() for name, value in vars(rollout).items() if value is not None})
        return {"told": len(feedback.new_costs)} if self.updates % self.period == 0 else {}

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        return {}

    def state(self) -> dict[str, Any]:
        return {"updates": self.updates}

    def load_state(self, state: dict[str, Any]) -> None:
        self.updates = int(state["updates"])


def trained(env: Any = None, steps: int = STEPS, **settings: Any) -> tuple[Scribe, list[list[Episode]], Trainer]:
    """A learner after its run, and the episodes that ended before each of its updates."""
    env = env or Walk()
    collector = HostCollector(env, EnvStepper(env), CPU, threads=1)
    learner = Scribe(Task(collector.obs_size, env.single_action_space, env.num_envs, 0, {}), **settings)
    trainer = Trainer(collector, learner, steps, seed=0, threads=1)
    trainer.start()
    ended: list[list[Episode]] = [[]]
    while not trainer.done:
        ended[-1] += trainer.step()
        if trainer.ready:
            trainer.update()
            ended.append([])
    return learner, ended[:-1], trainer


def test_new_costs_are_those_of_the_episodes_since_the_last_update():
    learner, ended, _ = trained()
    assert len(learner.told) == STEPS // (4 * EVERY) and sum(map(len, ended)) > 10
    assert [told.new_costs[:, 0].tolist() for told in learner.told] == [[e.cost for e in each] for each in ended]


def test_feedback_accumulates_until_a_report():
    learner, ended, trainer = trained(period=3)
    collected = [
        [e.cost for each in ended[update - update % 3 : update + 1] for e in each] for update in range(len(ended))
    ]
    assert [told.new_costs[:, 0].tolist() for told in learner.told] == collected
    assert trainer.updates == len(ended) // 3


def test_recent_costs_and_the_count_carry_over_updates():
    learner, ended, _ = trained()
    costs = [e.cost for each in ended for e in each]
    last = learner.told[-1]
    assert last.recent_costs[:, 0].tolist() == costs[-100:] and last.episodes == len(costs)
    assert last.largest_costs == (max(costs),)
    lengths = [e.length for each in ended for e in each]
    assert last.mean_length == pytest.approx(np.mean(lengths[-100:])) and len(set(lengths)) > 3
    assert math.isnan(learner.told[0].mean_length) == (not ended[0])


def test_progress_is_that_before_the_rollout_and_steps_left_those_after_it():
    learner, _, _ = trained()
    assert [told.progress for told in learner.told] == [update / 10 for update in range(10)]
    assert [told.steps_left for told in learner.told] == [STEPS - 20 * (update + 1) for update in range(10)]


def test_costs_apart_are_tight_and_loose_in_the_rollout_too():
    learner, ended, _ = trained(separate=True)
    assert [told.new_costs.tolist() for told in learner.told] == [[[e.tight, e.loose] for e in each] for each in ended]
    costs = torch.cat([seen["costs"] for seen in learner.seen])
    assert costs.shape == (STEPS // 4, 4, 2)
    total = [sum(each) for each in zip(*((e.tight, e.loose) for each in ended for e in each), strict=True)]
    assert costs.sum((0, 1)).tolist() == total and total[0] > 0


def test_an_environment_without_separate_costs_is_refused_at_its_first_step():
    env = SyncVectorEnv([lambda: Count(3)], autoreset_mode=AutoresetMode.SAME_STEP)
    with pytest.raises(TrainingError, match=r"does not report them separately: info\['costs'\] \[N, 2\] is needed"):
        trained(env, steps=20, separate=True)


class CountByKind(Count):
    """A count whose cost is loose."""

    def step(self, action: Any):
        *rest, info = super().step(action)
        return *rest, info | {"costs": np.array([0.0, info["cost"]])}


def test_environments_that_all_reset_in_one_step_have_no_separate_costs_in_it():
    env = SyncVectorEnv([lambda: CountByKind(3)] * 2, autoreset_mode=AutoresetMode.NEXT_STEP)
    learner, _, _ = trained(env, steps=20, separate=True)
    costs = torch.cat([seen["costs"] for seen in learner.seen])
    assert costs[:8, 0].tolist() == [[0, 0], [0, 0], [0, 1], [0, 0], [0, 0], [0, 0], [0, 1], [0, 0]]


def test_a_learner_with_resets_starts_every_rollout_with_new_episodes():
    learner, _, _ = trained(resets=True)
    for seen in learner.seen:
        assert seen["fresh"][0].all() and not seen["obs"][0, :, 2].any()  # the walkers' clocks
    plain, _, _ = trained()
    assert plain.seen[0]["fresh"][0].all() and not all(seen["fresh"][0].any() for seen in plain.seen[1:])
    starts = torch.stack([seen["obs"][0, :, 0] for seen in learner.seen])
    assert len(starts.unique()) == starts.numel()  # from new seeds each time


def test_episodes_discarded_by_a_reset_are_not_counted():
    learner, ended, trainer = trained(resets=True)
    episodes = [e for each in ended for e in each]
    assert trainer.statistics.count == len(episodes) == learner.told[-1].episodes
    finished = sum(int((seen["terminated"] | seen["truncated"]).sum()) for seen in learner.seen)
    assert len(episodes) == finished > 0
    assert max(e.length for e in episodes) <= EVERY
    # What was paid in an episode cut off is in none of them.
    paid = [float(seen["rewards"].sum()) for seen in learner.seen]
    assert sum(e.return_ for e in episodes) < sum(paid) - 1.0


def test_no_environment_is_reset_without_a_report():
    learner, _, _ = trained(resets=True, period=2)
    begun = [bool(seen["fresh"][0].all()) for seen in learner.seen]
    assert begun == [update % 2 == 0 for update in range(10)]


class Stop(Exception):
    pass


class StopsAt(Walk):
    """Raises in the given vector step."""

    stop = 37

    def step(self, actions: Any):
        if self.total + 1 == self.stop:
            raise Stop
        return super().step(actions)


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with open(folder / name) as file:
        return list(csv.DictReader(file))


def test_a_learner_with_nothing_to_report_writes_no_row_and_resumes_with_what_was_collected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    entry = Entry("SCRIBE", OnPolicyConfig, lambda config, task: Scribe(task, period=3), "writes down what it is told")
    monkeypatch.setitem(ALGORITHMS, "SCRIBE", entry)
    given: dict[str, Any] = {"steps": STEPS, "seed": 1, "checkpoint_seconds": 0.0}
    run("scribe", Walk(), folder=tmp_path / "whole", **given)
    metrics = rows(tmp_path / "whole", "metrics.csv")
    assert [row["update"] for row in metrics] == ["1", "2", "3"]
    assert [row["steps"] for row in metrics] == ["60", "120", "180"]
    ended = [int(row["step"]) for row in rows(tmp_path / "whole", "episodes.csv")]
    assert [int(row["told"]) for row in metrics] == [
        sum(at - 60 < step <= at for step in ended) for at in (60, 120, 180)
    ]
    with pytest.raises(Stop):
        run("scribe", StopsAt(), folder=tmp_path / "broken", **given)
    assert run("scribe", Walk(), folder=tmp_path / "broken", **given).resumed_from == 140
    again = rows(tmp_path / "broken", "metrics.csv")
    assert [row["told"] for row in again] == [row["told"] for row in metrics]
    assert (tmp_path / "broken" / "episodes.csv").read_text() == (tmp_path / "whole" / "episodes.csv").read_text()


class SmallUnits(Walk):
    """Walkers that see their clock as one of two tiny numbers, beside a number that is constant but for rounding."""

    def _obs(self) -> np.ndarray:
        obs = super()._obs()
        obs[:, 1] = 3.0 * (1.0 + 1e-7 * np.sign(obs[:, 0]))
        obs[:, 2] *= 1e-6
        return obs


@pytest.mark.parametrize("settings", [{}, {"frame_stack": 2}, {"normalise_observations": False}])
def test_a_run_warns_once_of_numbers_that_vary_but_are_ignored(settings: dict[str, Any], tmp_path: Path):
    config = {"steps_per_update": 128, "minibatch": 64, "passes": 1, "hidden": [8]} | settings
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = run("PPO", SmallUnits(), steps=1280, seed=0, folder=tmp_path, config=config)
    found = [str(each.message) for each in caught if each.category is UnitWarning]
    if "normalise_observations" in settings:
        assert not found
    else:
        assert len(found) == 1 and "numbers of the observation, counted from 0: 2; they vary" in found[0]
        assert read_status(tmp_path)["warnings"] == {"numbers_ignored": found[0]}
    assert result.episodes > 40


def test_a_run_of_a_planner_warns_of_them_too(tmp_path: Path):
    with pytest.warns(UnitWarning, match="numbers of the observation, counted from 0: 2; they vary"):
        run("CCEPETS", SmallUnits(), steps=640, seed=0, folder=tmp_path, config=SMALL_PLANS | {"frame_stack": 2})


def test_observations_of_usual_units_give_no_such_warning(tmp_path: Path):
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnitWarning)
        run("PPO", Walk(), steps=1280, seed=0, folder=tmp_path, config={"steps_per_update": 128, "hidden": [8]})
