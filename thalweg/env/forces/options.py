"""`ForceOptions`: wind, current and dynamics as data, as suites, commands and the contexts of policies name them."""

from collections.abc import Mapping
from dataclasses import field, fields
from typing import Any

from thalweg.core.config import frozen_config, parse_config, to_plain
from thalweg.env.config import Current, Dynamics, EnvConfig
from thalweg.env.errors import ConfigError
from thalweg.env.physics.feasible import has_forces
from thalweg.env.physics.inertia import Inertia
from thalweg.env.physics.wind import Wind


@frozen_config(ConfigError)
class ForceOptions:
    """The fields of an `EnvConfig` that make anything but its own steps move a vehicle; by default nothing does."""

    dynamics: Dynamics = "kinematic"
    """`kinematic`: an action is a step; `inertial`: it commands velocities, by continuous actions."""
    inertia: Inertia = field(default_factory=Inertia)
    """Maximum speeds, time constants and accelerations of inertial dynamics."""
    wind: Wind | None = None
    """Mean wind and gusts. None: no wind."""
    current_m_per_s: Current | None = None
    """Speed of the water's surface in mid-channel; a pair is a range. None: still water."""
    carried_by_current: bool = False
    """Whether the vehicle floats."""

    @classmethod
    def of_env_data(cls, data: Mapping[str, Any]) -> "ForceOptions":
        """Return those of an `EnvConfig.as_data`, as the context of a policy holds it."""
        return parse_config(cls, {each.name: data[each.name] for each in fields(cls) if each.name in data})

    def applied(self, config: EnvConfig) -> EnvConfig:
        """Return a config with these options, and continuous actions for inertial dynamics; raises `ConfigError` for
        what does not go together."""
        options: dict[str, Any] = {each.name: getattr(self, each.name) for each in fields(self)}
        if self.dynamics == "inertial":
            options["action"] = "continuous"
        return config.with_options(**options)

    def as_data(self) -> dict[str, Any]:
        """Return plain data of what differs from the defaults; empty if nothing does."""
        usual = ForceOptions()
        changed = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: to_plain(value) for name, value in changed.items() if value != getattr(usual, name)}

    @property
    def push(self) -> bool:
        """Whether anything but its own steps moves a vehicle; as `EnvConfig.has_forces`."""
        return has_forces(self.dynamics, self.wind, self.current_m_per_s)
