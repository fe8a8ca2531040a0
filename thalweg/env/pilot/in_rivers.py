"""Pilots of environments whose rivers may change: the route of each river is planned once."""

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.pilot.boat import BoatPilot
from thalweg.env.pilot.scripted import ScriptedPilot
from thalweg.env.pilot.steady import SteadyPilot
from thalweg.env.rivers.assignment import Rivers
from thalweg.env.rivers.courses import join_courses
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.rules import State

KEPT_ROUTES = 512
"""Routes that are kept, up to 200 kB each."""
Pilot = ScriptedPilot | SteadyPilot | BoatPilot
PILOTS: dict[str, dict[str, type[Pilot]]] = {
    "uav": {"scripted": ScriptedPilot, "steady": SteadyPilot},
    "asv": {"scripted": BoatPilot},
}
"""The pilots of each vehicle by their names."""


class PilotInRivers:
    """A pilot of some kind in the rivers of an environment, whichever they are now."""

    def __init__(self, kind: type[Pilot], config: EnvConfig) -> None:
        self._kind, self._config = kind, config
        self._planned: OrderedDict[int, tuple[CourseArrays, Any]] = OrderedDict()
        """Courses and their routes by the identity of the courses, the last used ones last."""
        self._key: tuple[int, ...] = ()
        self._pilot: Pilot | None = None

    def pilot(self, rivers: Rivers, state: State) -> tuple[Pilot, State]:
        """Return a pilot for the rivers that are flown in now, and the state as it takes it."""
        parts, world = rivers.in_use()
        key = tuple(map(id, parts))
        if self._pilot is None or key != self._key:
            self._key, self._pilot = key, self._made(parts)
        return self._pilot, state._replace(world=world)

    def _made(self, parts: Sequence[CourseArrays]) -> Pilot:
        """Return a pilot for courses."""
        routes = [self._route(part) for part in parts]
        while len(self._planned) > max(KEPT_ROUTES, len(parts)):
            self._planned.popitem(last=False)
        joined: Any = type(routes[0])(*(np.concatenate(arrays) for arrays in zip(*routes, strict=True)))
        return self._kind(join_courses(parts), self._config, joined)

    def _route(self, part: CourseArrays) -> Any:
        """Return the routes through courses."""
        if id(part) not in self._planned:
            self._planned[id(part)] = part, self._kind(part, self._config).route
        self._planned.move_to_end(id(part))
        return self._planned[id(part)][1]
