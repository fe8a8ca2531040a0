"""`Inertia`: velocities that follow commands with a lag and limited acceleration, solved exactly over a step.

The velocity v follows c + g, where c is the command and g the wind's push: v' = (c + g - v) / T, limited in size to the
acceleration a. This is a multirotor whose controller cancels the drag of its own motion through still air but has no
integral action, so that the drag of the wind, k w per unit of mass, leaves an error of g = T k w at rest. The drag
of rotors at low speeds is linear in the airspeed (Faessler, Franchi, Scaramuzza, "Differential Flatness of Quadrotor
Dynamics Subject to Rotor Drag for Accurate Tracking of High-Speed Trajectories", RA-L 2018).

The error e = c + g - v keeps its direction while it shrinks, so that its size alone is solved for: at first, while it
exceeds a T, by a per second, and after that exponentially.
"""

import math
from typing import Annotated

from pydantic import Field

from thalweg.core.compute.jit import kernel
from thalweg.core.config import FiniteNonNegative, FinitePositive, frozen_config
from thalweg.env.errors import ConfigError

UNLIMITED = 1.0e300
"""Acceleration that nothing reaches."""


@frozen_config(ConfigError, numpy_scalars=True)
class Inertia:
    """Dynamics of a vehicle that is commanded by velocities; an action of 1 commands the maximum speed of its axis."""

    forward_m_per_s: FinitePositive = 4.0
    """Maximum speed forward; as the default steps, 1 m in 0.25 s."""
    lateral_m_per_s: FinitePositive = 2.0
    """Maximum speed sideways."""
    vertical_m_per_s: FinitePositive = 4.0
    """Maximum speed of climb and descent."""
    yaw_deg_per_s: FinitePositive = 40.0
    """Maximum yaw rate."""
    time_constant_s: FinitePositive = 0.4
    """Time constant of the horizontal velocity."""
    vertical_time_constant_s: FinitePositive = 0.4
    """Time constant of the vertical velocity."""
    yaw_time_constant_s: FinitePositive = 0.15
    """Time constant of the yaw rate."""
    acceleration_m_per_s2: FinitePositive = 5.0
    """Maximum horizontal acceleration."""
    vertical_acceleration_m_per_s2: FinitePositive = 5.0
    """Maximum vertical acceleration."""
    drag_per_s: Annotated[FiniteNonNegative, Field(le=10)] = 0.4
    """Acceleration by the drag of the air per metre a second of wind."""

    @property
    def wind_share(self) -> float:
        """Share of the wind's velocity with which it carries a vehicle whose command is zero, in the long run."""
        return self.drag_per_s * self.time_constant_s


@kernel(fastmath=False, allocates=False)
def limited_lag(error, time_constant, acceleration, duration):
    """Return (what is left of an error >= 0 after a duration, its integral over it).

    It shrinks by error / time_constant per second, but by no more than `acceleration`.
    """
    ramp = min(max(error / acceleration - time_constant, 0.0), duration)
    rest = error - acceleration * ramp
    decay = math.exp(-(duration - ramp) / time_constant)
    integral = (error - 0.5 * acceleration * ramp) * ramp + rest * time_constant * (1.0 - decay)
    return rest * decay, integral


@kernel(fastmath=False, allocates=False)
def follow(velocity, target, time_constant, acceleration, duration):
    """Return (velocity, way) after a duration in which a velocity of one axis follows its target."""
    error = target - velocity
    left, integral = limited_lag(abs(error), time_constant, acceleration, duration)
    sign = 1.0 if error >= 0.0 else -1.0
    return target - sign * left, target * duration - sign * integral


@kernel(fastmath=False, allocates=False)
def follow_plane(vx, vy, target_x, target_y, time_constant, acceleration, duration):
    """Return (vx, vy, way x, way y) after a duration in which a velocity in a plane follows its target."""
    ex, ey = target_x - vx, target_y - vy
    size = math.sqrt(ex * ex + ey * ey)
    left, integral = limited_lag(size, time_constant, acceleration, duration)
    ux = ex / size if size > 0.0 else 0.0
    uy = ey / size if size > 0.0 else 0.0
    return (
        target_x - left * ux,
        target_y - left * uy,
        target_x * duration - integral * ux,
        target_y * duration - integral * uy,
    )
