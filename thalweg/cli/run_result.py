"""Output of a finished run: its result, its warnings, and the command that evaluates its policy."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from thalweg.core.notices import notice

if TYPE_CHECKING:
    from thalweg.train import RunResult


TOO_SHORT = "too few steps for an episode to end"
NO_EPISODE = {"BC": "learnt from recordings, nothing was flown"}
"""What is said of a run without an episode, by its algorithm."""


def tell_finished(folder: Path) -> None:
    """Say that a training was finished before."""
    notice(f"{folder} was finished before; nothing was trained.")


def print_result(result: "RunResult", evaluation: Sequence[str]) -> None:
    """Print the result of a run; `evaluation`: options of the command that evaluates it."""
    if result.already_finished:
        tell_finished(result.folder)
    last = f"last 50: return {result.return_mean:.2f}, cost {result.cost_mean:.2f}"
    print(
        f"{result.folder}: {result.algorithm}, {result.steps:,} steps, {result.episodes:,} episodes in"
        f" {result.seconds:.0f} s; {last if result.episodes else NO_EPISODE.get(result.algorithm, TOO_SHORT)}"
    )
    if result.already_finished or result.resumed_from is not None:  # else they have been shown
        for line in result.warnings:
            notice(f"Warning: {line}")
    print(f"Evaluate it: {shlex.join(['thalweg', 'evaluate', str(result.folder), *evaluation])}")
