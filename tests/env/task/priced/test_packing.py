"""Places of swimmers, reserves and buoys."""

import numpy as np
import pytest

from tests.env.task.priced import reference
from tests.env.task.priced.flights import made, rivers
from thalweg.env.task.priced.swimmers import mover_at


@pytest.mark.parametrize("name", ["ring", "canal", "Hard"])
def test_swimmers_and_kayaks_keep_to_the_water_and_move_slowly(name: str):
    world = rivers()[name]
    courses = made("Swimmers", world, 1).courses
    count = int(courses.swimmers[0])
    assert count == max(1, round(world.river.length_m / 40))
    kinds = set()
    for index in range(count):
        places = []
        for steps in range(0, 300, 5):
            mover = mover_at(courses, 0, 99, steps, index)
            assert not reference.over_land(world, mover.x, mover.y)
            kinds.add(mover.kind)
            places.append((mover.x, mover.y))
        pace = np.linalg.norm(np.diff(places, axis=0), axis=1) / 5
        assert 0.05 < pace.max() < 0.7  # metres a step of 0.25 s
    assert kinds <= {1, 2}


def test_a_mover_heads_where_it_goes():
    courses = made("Swimmers", rivers()["ring"], 1).courses
    a, b = mover_at(courses, 0, 5, 1000, 0), mover_at(courses, 0, 5, 1001, 0)
    heading = np.arctan2(b.y - a.y, b.x - a.x)
    assert abs((a.yaw - heading + np.pi) % (2 * np.pi) - np.pi) < 0.1


@pytest.mark.parametrize("name", ["ring", "canal", "Hard"])
def test_reserves_are_a_third_of_the_course_and_marked_at_both_edges(name: str):
    world = rivers()[name]
    courses = made("Nests", world, 1).courses
    begin, end = courses.reserve.T
    assert (end - begin).sum() == pytest.approx(world.river.length_m / 3)
    assert (begin >= 0).all() and (end <= world.river.length_m).all() and (begin[1:] > end[:-1]).all()
    for x, y in courses.buoy[:, 1:3]:
        arc, past, _ = reference.nearest(world.river, x, y)
        assert past == pytest.approx(-0.5, abs=0.15) and ((begin - 0.5 < arc) & (arc < end + 0.5)).any()
    other = made("Nests", world, 1).courses
    np.testing.assert_array_equal(courses.reserve, other.reserve)
