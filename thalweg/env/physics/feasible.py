"""Forces that move a vehicle: whether there are any, and a refusal of those that none could hold against."""

from thalweg.env.physics.inertia import Inertia
from thalweg.env.physics.wind import Wind, strongest_held, strongest_push


def has_forces(dynamics: str, wind: Wind | None, current_m_per_s: tuple[float, float] | None) -> bool:
    """Return whether anything but its own steps moves a vehicle, by the fields of an `EnvConfig`."""
    return dynamics == "inertial" or wind is not None or current_m_per_s is not None


def check_forces(
    steps: tuple[float, float, float],
    inertia: Inertia | None,
    wind: Wind | None,
    current_m_per_s: tuple[float, float] | None,
    carried: bool,
) -> None:
    """Raise `ValueError` for a wind or a current that the vehicle cannot hold against, with the greatest that it can.

    `steps`: the duration of a step in seconds, and the sizes in metres of a step sideways and of one forward, which
    count where there is no inertia. Held against means sideways for the wind, which may come from any side, and forward
    for the current, which goes along the course.
    """
    step_s, lateral_m, forward_m = steps
    if carried and current_m_per_s is None:
        raise ValueError("carried_by_current needs a current: set current_m_per_s")
    if inertia is None and wind is None and not carried:
        return
    if step_s == 0:
        raise ValueError("step_s must be above 0 for wind, current and inertial dynamics, got 0")
    lateral, forward = (lateral_m / step_s, forward_m / step_s)
    if inertia is not None:
        lateral, forward = inertia.lateral_m_per_s, inertia.forward_m_per_s
    if wind is not None:
        share = wind.drift_share if inertia is None else inertia.wind_share
        push = strongest_push(wind, share)
        if push > lateral:
            raise ValueError(
                f"wind.speed_m_per_s = {wind.speed_m_per_s[1]:g} pushes the vehicle by up to {push:.3g} m/s in gusts,"
                f" but it flies sideways by {lateral:.3g} m/s at most; it holds against a wind of"
                f" {strongest_held(wind, share, lateral):.3g} m/s"
            )
    if carried and current_m_per_s is not None and current_m_per_s[1] > forward:
        raise ValueError(
            f"current_m_per_s = {current_m_per_s[1]:g} is faster than the vehicle; the greatest that it holds"
            f" against is its own speed, {forward:.3g} m/s"
        )
