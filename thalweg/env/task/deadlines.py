"""Deadlines of tasks in steps, and the refusal of one that nobody can meet.

Within the banks no way past a piece of a course is shorter than that along the inner bank: the length of the piece less
half of the width for each radian of its turn. Over land none is shorter than the straight line. A deadline that is too
short for such a way at the greatest step is refused, with a margin by which those of the package's tasks never are,
whatever the river. One that is not refused may still be beyond every pilot.
"""

import math

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.errors import ConfigError
from thalweg.env.tasks import Task
from thalweg.world.record import River, World

MARGIN = 0.9
"""Share of the least number of steps that a deadline must allow: an episode starts within a segment and ends as it
enters the last one, and of the rivers of a level none is to be refused alone."""


def deadline(task: Task, river: River) -> int:
    """Return the deadline of a task in steps: its share of the way at one metre a step.

    The way is the whole course; of a loop with a station it is half, which is as far as a station is.
    """
    return math.ceil(task.deadline_steps_per_m * _way_m(task, river))


def check_deadline(world: World, config: EnvConfig) -> None:
    """Raise `ConfigError`, with the least that could be enough, for a deadline that no flight of a loop can meet.

    Open courses are left out, where an episode may start just before the end, and so are a maximum length that replaces
    the deadline, and vehicles that wind, current or inertia move.
    """
    task, river = config.task_record, world.river
    if not task.deadline_steps_per_m > 0 or config.max_steps is not None or not river.closed or config.has_forces:
        return
    step_m = math.hypot(max(config.forward_step_m, task.fast_step_m), config.lateral_step_m)
    needed = least_way_m(task, river) / step_m
    if deadline(task, river) >= MARGIN * needed:
        return
    least = math.ceil(100.0 * needed / _way_m(task, river)) / 100.0
    way = "in a straight line the station is" if task.portage else "along the inner bank the course takes"
    raise ConfigError(
        f"nobody can meet the deadline of {config.task} on {world.label}, {deadline(task, river)} steps:"
        f" even {way} {math.ceil(needed)} steps of {step_m:.2f} m; deadline_steps_per_m of the task must be at least"
        f" {least:g}, got {task.deadline_steps_per_m:g}"
    )


def least_way_m(task: Task, river: River) -> float:
    """Return the metres that a flight of a loop is at least long which passes all of it, or reaches the station."""
    if task.portage:
        apart = np.linalg.norm(river.position_m - np.roll(river.position_m, len(river.position_m) // 2, axis=0), axis=1)
        return max(float(np.min(apart - river.width_m)), 0.0)
    along = np.diff(np.append(river.arc_m, river.length_m))
    direction = np.arctan2(river.tangent[:, 1], river.tangent[:, 0])
    turn = np.abs(np.angle(np.exp(1j * (np.roll(direction, -1) - direction))))
    return float(np.maximum(along - 0.5 * turn * river.width_m, 0.0).sum())


def _way_m(task: Task, river: River) -> float:
    """Return the metres of course that a deadline is for."""
    return 0.5 * river.length_m if task.portage and river.closed else river.length_m
