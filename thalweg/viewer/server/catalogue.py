"""Catalogue for a page that connects: all that there is to choose from."""

from contextlib import suppress
from dataclasses import asdict
from typing import Any

from thalweg.core.plugins.record import PluginError
from thalweg.env.tasks import TASKS, task_names, task_plugin
from thalweg.env.vehicle.levels import LEVELS_OF
from thalweg.viewer.flight.flyers import HAND, PILOTS
from thalweg.viewer.flight.looks import LOOKS
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.pictures import KINDS
from thalweg.viewer.flight.rivers import Rivers
from thalweg.viewer.server.messages import SPEEDS

TASK_TEXT = {
    "River": "Follow the river. Only the end of a flight can have a cost.",
    "Swimmers": "Fast steps pay off, but cost 1 within 10 m of a swimmer or kayak.",
    "Nests": "Fly low to see nests, but not in the reserves that buoys mark.",
    "RacingLine": "Fast steps against the clock; closeness to banks costs.",
    "Portage": "Reach the gauge station. Land may be crossed, at a cost for each step.",
}
"""One line on each task."""


def catalogue(rivers: Rivers, policies: list[str], defaults: FlightOptions) -> dict[str, Any]:
    """Return the choices of the page as plain data, and the options that it begins with."""
    return {
        "levels": {vehicle: [*names, *rivers.own] for vehicle, names in LEVELS_OF.items()},
        "tasks": {**{name: TASK_TEXT[name] for name in TASKS}, **_tasks_of_plugins()},
        "looks": list(LOOKS),
        "pilots": [HAND, *PILOTS, *policies],
        "pictures": list(KINDS),
        "speeds": list(SPEEDS),
        "options": asdict(defaults),
    }


def _tasks_of_plugins() -> dict[str, str]:
    """Return what the tasks of plug-ins are about, by name, without those that cannot be loaded."""
    texts: dict[str, str] = {}
    for name in task_names():
        with suppress(PluginError):
            if name not in TASKS and (plugin := task_plugin(name)) is not None:
                texts[name] = plugin.record.about
    return texts
