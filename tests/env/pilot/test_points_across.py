"""Tests of points across the river and of what stands between them, with values worked by hand."""

import math

import pytest

from tests.env.handmade import canal
from thalweg.env import EnvConfig
from thalweg.env.pilot.points_across import hindrance, offset_of
from thalweg.env.task.course_arrays import pack_courses

ISLAND = [30.0, 0.0, 3.0, 1.0, 0.0]
"""x, y, half lengths and angle of an island in the middle of a canal along x."""
COURSES = pack_courses([canal(width_m=8.0, islands=[ISLAND])], EnvConfig())


def test_points_divide_the_river_evenly_from_right_to_left():
    assert [offset_of(2.0, point, 5) for point in range(5)] == [-2.0, -1.0, 0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("start", "end", "found"),
    [
        ((10.0, 0.0), (11.0, 0.0), 0.0),
        ((10.0, 0.0), (11.0, 1.0), 0.0),  # as steep as permitted
        ((10.0, 0.0), (11.0, -2.0), 2.0 - math.sqrt(2.5)),
        ((29.0, 0.0), (30.0, 0.0), 1.0),
        ((29.0, 1.5), (31.0, 1.5), 0.0),  # beside the island
        ((30.0, -2.0), (30.0, 2.0), 1.0 + 4.0 - math.sqrt(8.0)),  # both at once
    ],
)
def test_steep_ways_and_those_over_islands_are_hindered(start, end, found):
    aside = end[1] - start[1]
    assert hindrance(COURSES, 0, *start, *end, aside) == pytest.approx(found, abs=1e-12)
