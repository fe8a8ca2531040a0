"""Progress bars of evaluations and films."""

import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from thalweg.bench.evaluate.evaluation import Step


def progress_bar(console: Console, unit: str) -> Progress:
    """Return a progress bar that counts units such as episodes, with a rate; its tasks have a field `rate`."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(f"{unit}  {{task.fields[rate]}}"),
        TimeElapsedColumn(),
        console=console,
    )


def track_episodes(progress: Progress, name: str, episodes: int) -> Callable[[Step], None]:
    """Return the `on_step` of `evaluate` that advances a progress bar."""
    task = progress.add_task(name, total=episodes, rate="")
    started_at = time.perf_counter()
    steps = 0

    def on_step(step: Step) -> None:
        nonlocal steps
        steps += len(step.flying)
        rate = steps / max(time.perf_counter() - started_at, 1e-9)
        remaining = len(step.flying) + step.waiting
        progress.update(task, completed=episodes - remaining, rate=f"{rate:,.0f} steps/s")

    return on_step


def complete(progress: Progress) -> None:
    """Fill the bars: `on_step` is not called after the last step."""
    for task in progress.tasks:
        progress.update(task.id, completed=task.total)


def track_frames(progress: Progress, name: str, frames: int) -> Callable[[], None]:
    """Return a callback for each frame of a film that advances a progress bar."""
    task = progress.add_task(name, total=frames, rate="")
    started_at = time.perf_counter()
    rendered = 0

    def on_frame() -> None:
        nonlocal rendered
        rendered += 1
        rate = rendered / max(time.perf_counter() - started_at, 1e-9)
        progress.update(task, completed=rendered, rate=f"{rate:,.1f} frames/s")

    return on_frame
