"""Options that choose a flight: river, start, task, vehicle and look."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from thalweg.cli.command import Command
from thalweg.cli.options import DEFAULT_LEVEL, NO_FILE, Plugins, River, UsageError, checked_task


@dataclass(frozen=True)
class ChosenFlight(Command):
    """A flight by its options."""

    level: str | None = None
    """Easy, Medium or Hard; Medium by default, for the boat Medium-Deep."""
    world_seed: int | None = None
    """Seed of the river; by default the fixed river of the level. With --river: of its plants and hills."""
    river: River = NO_FILE
    seed: int = 0
    """Seed of the flight: its start, and what moves in it."""
    task: str | None = None
    """River, Swimmers, Nests, RacingLine or Portage; by default that on which the policy was trained, else River."""
    vehicle: Literal["uav", "asv"] | None = None
    """`uav` flies; `asv` is a boat, for Easy, Medium-Deep and Hard-Deep. By default that of the policy, else `uav`."""
    action: Literal["multidiscrete", "continuous"] | None = None
    """Kind of actions, by default that of the policies."""
    look: str = "as trained"
    """Appearance: as trained, autumn, mist, overcast, brown water, still water, poor camera or random."""
    wind: float = 0.0
    """Mean speed of the wind in m/s; 0 is no wind."""
    quality: Literal["full", "fast"] = "full"
    """Quality of the frames; `fast` reflects only the sky, filters less, and interpolates the ground."""
    plugin: Plugins = ()

    def chosen(self, size_px: int, like: Any = None) -> tuple[Any, Any]:
        """Return the rivers that can be flown, `Rivers`, and the options of the flight, `FlightOptions`.

        Task, with its hard mode, vehicle and dynamics are those that the policy `like` was trained with, as far as
        options do not say; those of the paper's task for None. Raises `UsageError`, `ViewerError`, `WorldError` and
        `ConfigError` for options that are wrong or do not go together, before anything is built.
        """
        from thalweg.env.tasks import PAPER_TASK
        from thalweg.viewer.flight.options import FlightOptions
        from thalweg.viewer.flight.rivers import Rivers
        from thalweg.world import level_named

        trained = {} if like is None else _trained_with(like)
        task = checked_task(self.task or trained.get("task", PAPER_TASK))
        vehicle = self.vehicle or trained.get("vehicle", "uav")
        reach = self.river.reach("--level", self.level, levels_have_banks=True)
        named = self.river.on_banks(self.level or DEFAULT_LEVEL[vehicle])
        level = level_named(named).name if reach is None else reach.name
        options = FlightOptions(
            level=level,
            world_seed=self.world_seed,
            seed=self.seed,
            task=task,
            hard=task != PAPER_TASK and trained.get("hard", False),
            vehicle=vehicle,
            action=self.action or trained.get("action", "multidiscrete"),
            dynamics=trained.get("dynamics", "kinematic"),
            look=self.look,
            wind_m_per_s=self.wind,
            quality=self.quality,
            size_px=size_px,
        )
        options.rules  # noqa: B018  # options that do not go together are refused
        return Rivers(reach), options

    def with_actions_of(self, options: Any, policies: Mapping[str, Any]) -> Any:
        """Return the options of the flight with continuous actions if one of the policies, by what they were given as,
        has such; raises `UsageError` if other actions were asked for.

        Policies of discrete actions also fly with continuous ones.
        """
        from thalweg.train.observations import action_of

        for given, policy in policies.items():
            if action_of(policy) == "continuous":
                if self.action == "multidiscrete":
                    raise UsageError(
                        f"--action multidiscrete does not go with {given}, which has continuous actions: leave it out"
                    )
                return replace(options, action="continuous")
        return options


def _trained_with(policy: Any) -> dict[str, Any]:
    """Return the options of a flight with which a policy was trained; raises `UsageError` for inertia of its own."""
    from thalweg.env.physics.inertia import Inertia
    from thalweg.train.observations import flies_hard, forces_of, task_of, vehicle_of

    forces = forces_of(policy)
    dynamics = forces.dynamics
    if dynamics == "inertial" and forces.inertia != Inertia():
        raise UsageError(
            "the policy was trained with settings of inertia of its own, which such flights do not have: fly it by"
            " `thalweg evaluate`"
        )
    return {
        "task": task_of(policy),
        "hard": flies_hard(policy),
        "vehicle": vehicle_of(policy),
        "dynamics": dynamics,
        **({"action": "continuous"} if dynamics == "inertial" else {}),
    }


def free_name(given: str, taken: Collection[str]) -> str:
    """Return the name of a policy for people, numbered where the name is taken."""
    name = policy_name(given)
    number, free = 2, name
    while free in taken:
        free, number = f"{name} ({number})", number + 1
    return free


def policy_name(given: str) -> str:
    """Return the name of a policy for people: that of its file or folder, or the name that it was given by."""
    return given if not Path(given).exists() else Path(given).resolve().name
