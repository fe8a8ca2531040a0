"""How far is an evaluation, or a film? Bars for people to watch; nothing depends on them."""

import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from thalweg.bench.evaluate.evaluation import Step


def bar(console: Console, unit: str) -> Progress:
    """A bar that counts units such as episodes, with a rate beside it; its tasks have a field `rate`."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(f"{unit}  {{task.fields[rate]}}"),
        TimeElapsedColumn(),
        console=console,
    )


def progress_of_flights(progress: Progress, name: str, episodes: int) -> Callable[[Step], None]:
    """What `evaluate` calls before every step, to move the bar."""
    task = progress.add_task(name, total=episodes, rate="")
    begun = time.perf_counter()
    flown = 0

    def on_step(step: Step) -> None:
        nonlocal flown
        flown += len(step.flying)
        rate = flown / max(time.perf_counter() - begun, 1e-9)
        left = len(step.flying) + step.waiting
        progress.update(task, completed=episodes - left, rate=f"{rate:,.0f} steps/s")

    return on_step


def all_landed(progress: Progress) -> None:
    """Fill the bars: `on_step` is not told of the last landing."""
    for task in progress.tasks:
        progress.update(task.id, completed=task.total)


def progress_of_frames(progress: Progress, name: str, frames: int) -> Callable[[], None]:
    """What filming calls after every frame, to move the bar."""
    task = progress.add_task(name, total=frames, rate="")
    begun = time.perf_counter()
    drawn = 0

    def on_frame() -> None:
        nonlocal drawn
        drawn += 1
        rate = drawn / max(time.perf_counter() - begun, 1e-9)
        progress.update(task, completed=drawn, rate=f"{rate:,.1f} frames/s")

    return on_frame
