"""Tests of what a finished run prints."""

import math
from dataclasses import replace
from pathlib import Path

from thalweg.cli.run_result import print_result
from thalweg.train import RunResult

RESULT = RunResult(
    folder=Path("runs/x"),
    algorithm="PPO",
    steps=2048,
    episodes=7,
    return_mean=1.256,
    cost_mean=0.5,
    cost_rate=0.01,
    seconds=12.4,
    resumed_from=None,
    already_finished=False,
    warnings=("the limit never binds",),
)
COMMAND = "Evaluate it: thalweg evaluate runs/x --unseen\n"


def test_the_last_episodes_and_the_command_that_evaluates(capsys):
    print_result(RESULT, ["--unseen"])
    line = "runs/x: PPO, 2,048 steps, 7 episodes in 12 s; last 50: return 1.26, cost 0.50\n"
    assert capsys.readouterr().out == line + COMMAND


def test_a_run_without_an_episode_has_no_mean(capsys):
    print_result(replace(RESULT, episodes=0, return_mean=math.nan, cost_mean=math.nan), ["--unseen"])
    line = "runs/x: PPO, 2,048 steps, 0 episodes in 12 s; too few steps for an episode to end\n"
    assert capsys.readouterr().out == line + COMMAND


def test_a_resumed_run_repeats_its_warnings(capsys):
    print_result(replace(RESULT, resumed_from=1024), ["--unseen"])
    assert capsys.readouterr().err == "Warning: the limit never binds\n"


def test_a_finished_run_says_so_beside_its_result(capsys):
    print_result(replace(RESULT, already_finished=True, warnings=()), ["--unseen"])
    printed = capsys.readouterr()
    assert printed.err == "runs/x was finished before; nothing was trained.\n"
    assert printed.out.startswith("runs/x: PPO, 2,048 steps") and "finished before" not in printed.out
