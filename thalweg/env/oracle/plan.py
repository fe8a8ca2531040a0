"""Tables that the oracle computes before a flight: what is still to be had from each place that it may come to.

Distances are metres ahead: along the course from the start, in the direction of travel. Dimension letters: N flights, G
metres ahead, P points across the river, T steps, H heights, Y and X cells of a grid over land and water.
"""

from typing import NamedTuple

import numpy as np


class Plan(NamedTuple):
    """Tables of N flights in one river; those that a task does not need have one number for each flight."""

    start_arc: np.ndarray
    """[N] float64, metres along the course of the start."""
    travel: np.ndarray
    """[N] int64, 1 or -1: direction of travel at the start."""
    completed_m: np.ndarray
    """[N] float64, metres ahead at which the course is completed."""
    reach: np.ndarray
    """[N, G] float32, metres from the centre line to the outer points across, at each metre ahead."""
    place: np.ndarray
    """[N, G, P, 2] float64, metres: x and y of the points across."""
    lane: np.ndarray
    """[N, G, P] int8, the point across to fly to at the next metre ahead."""
    lane_steps: np.ndarray
    """[N, G, P] float32, steps still to be flown from a point across, cost counted in steps by its price."""
    height: np.ndarray
    """[N, G] float32, metres: z to fly at."""
    lowest: np.ndarray
    """[N, G] float32, metres: least z that bridges and the band of heights permit."""
    climb_value: np.ndarray
    """[N, G, H] float32, return less priced cost to be had from a height above the water."""
    climb: np.ndarray
    """[N, G, H] int8, best vertical move there: 1, 0 or -1; twice that for one that does not fly on."""
    speed_value: np.ndarray
    """[N, T, G] float32, return less priced cost to be had after so many steps."""
    speed: np.ndarray
    """[N, T, G] int8, best move there: 0 none, 1 a metre forward, 2 a fast step."""
    grid_origin: np.ndarray
    """[N, 2] float64, metres: x and y of the centre of the first cell."""
    grid_steps: np.ndarray
    """[N, Y, X] float32, steps to the station, cost counted in steps by its price."""
    grid_next: np.ndarray
    """[N, Y, X] int32, the cell of the cheapest way to fly to next, as y times X plus x."""
    price: float
    """Return that a cost of 1 is worth."""
    step_worth: float
    """Return that a step is worth in a flight against the deadline: that of a metre of course."""


def empty_plan(flights: int, price: float, step_worth: float) -> Plan:
    """Return a plan of N flights whose tables are still to be replaced."""
    table = lambda dimensions, kind: np.zeros((flights, *[1] * dimensions), kind)  # noqa: E731
    return Plan(
        start_arc=np.zeros(flights),
        travel=np.ones(flights, np.int64),
        completed_m=np.zeros(flights),
        reach=table(1, np.float32),
        place=np.zeros((flights, 1, 1, 2)),
        lane=table(2, np.int8),
        lane_steps=table(2, np.float32),
        height=table(1, np.float32),
        lowest=table(1, np.float32),
        climb_value=table(2, np.float32),
        climb=table(2, np.int8),
        speed_value=table(2, np.float32),
        speed=table(2, np.int8),
        grid_origin=np.zeros((flights, 2)),
        grid_steps=table(2, np.float32),
        grid_next=table(2, np.int32),
        price=price,
        step_worth=step_worth,
    )
