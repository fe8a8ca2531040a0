"""Options for wind, current and dynamics that several commands share; docs/weather.md says what they mean."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import FlagCreatePairsOff, arg

from thalweg.cli.options import UsageError, settings_from

if TYPE_CHECKING:
    from thalweg.env.forces.options import ForceOptions

NONE = "none"
"""Word for no wind, or still water."""


@dataclass(frozen=True)
class ForceFlags:
    """Options for what moves a vehicle besides its own steps. Those that are not given are off in a training, those of
    the training in an evaluation, and those of the suite in a benchmark."""

    wind: tuple[str, ...] = ()
    """Mean wind in m/s, a number or a range such as 1 4, and settings such as towards_deg=[0,90]; or none."""
    current: tuple[str, ...] = ()
    """Speed of the water in mid-channel in m/s, a number or a range such as 0.2 0.8; or none."""
    carried_by_current: Annotated[bool, FlagCreatePairsOff] = False
    """Let the vehicle float, so that the current carries it; with --current."""
    dynamics: Literal["kinematic", "inertial"] | None = None
    """`kinematic`: an action is a step; `inertial`: it commands velocities, which follow with a lag."""
    inertia: tuple[str, ...] = ()
    """Settings of inertial dynamics, such as time_constant_s=0.3 forward_m_per_s=3."""

    def options(self, usual: "ForceOptions | None" = None) -> "ForceOptions":
        """Return what these options say, and what is `usual` where they say nothing.

        Raises `UsageError` for text that is not understood or does not go together, and `ConfigError` for values that
        are not allowed, which names them.
        """
        from thalweg.core.config import parse_config
        from thalweg.env.forces.options import ForceOptions
        from thalweg.env.physics.inertia import Inertia
        from thalweg.env.physics.wind import Wind

        found = usual or ForceOptions()
        if self.dynamics is not None:
            found = replace(found, dynamics=self.dynamics)
        if self.inertia:
            if found.dynamics != "inertial":
                raise UsageError("--inertia goes with --dynamics inertial")
            found = replace(found, inertia=parse_config(Inertia, settings_from(self.inertia, "--inertia"), "--inertia"))
        if self.wind:
            data = _wind(self.wind)
            found = replace(found, wind=None if data is None else parse_config(Wind, data, "--wind"))
        if self.current:
            found = replace(found, current_m_per_s=_range("--current", self.current))
            if found.current_m_per_s is None:
                found = replace(found, carried_by_current=False)
        if self.carried_by_current:
            if found.current_m_per_s is None:
                raise UsageError("--carried-by-current goes with --current, which says how fast the water is")
            found = replace(found, carried_by_current=True)
        return found


Forces = Annotated[ForceFlags, arg(name="")]
"""Its options stand among those of the command."""
STILL = ForceFlags()


def _wind(texts: Sequence[str]) -> Mapping[str, Any] | None:
    """Return the fields of a `Wind`; None for no wind."""
    if list(texts) == [NONE]:
        return None
    settings = settings_from([text for text in texts if "=" in text], "--wind")
    numbers = [text for text in texts if "=" not in text]
    if numbers and "speed_m_per_s" in settings:
        raise UsageError(f"--wind {' '.join(texts)}: the speed is given twice")
    return settings | ({"speed_m_per_s": _range("--wind", numbers)} if numbers else {})


def _range(option: str, texts: Sequence[str]) -> tuple[float, float] | None:
    """Return one or two numbers as a range in m/s; None for none."""
    if list(texts) == [NONE]:
        return None
    try:
        numbers = [float(text) for text in texts]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2):
        raise UsageError(
            f"{option} takes one number or two in m/s, such as 2 or 1 4, or {NONE}, not {' '.join(texts)!r}"
        )
    return numbers[0], numbers[-1]
