"""Tests of the channel beyond the ends of an open course."""

import numpy as np
import pytest
from scipy import ndimage

from tests.world.lines import circle, course
from thalweg.world import World, geometry
from thalweg.world.generate import terrain
from thalweg.world.generate.continuation import continued
from thalweg.world.generate.hydrology import MIN_LAND_M
from thalweg.world.real.centerline import read_river
from thalweg.world.record import River

STRAIGHT = np.stack([np.linspace(0.0, 120.0, 30), np.zeros(30)], axis=1)
BENT = np.stack([np.linspace(0.0, 150.0, 40), 12 * np.sin(np.linspace(0.0, 9.0, 40))], axis=1)
HOOK = circle(20.0, 60)[:40] + np.array([3.0, -40.0])


def on_map(river: River) -> River:
    return continued(river, *terrain.make_grid(river.position_m))


def waters(wet: np.ndarray) -> int:
    """How many separate waters a map [GY, GX] has."""
    count = ndimage.label(wet, np.ones((3, 3)), output=np.zeros(wet.shape, np.int32))
    assert isinstance(count, int)
    return count


def on_border(wet: np.ndarray) -> np.ndarray:
    """The nodes [GY, GX] of a water that lie on the border of the map."""
    ring = np.zeros_like(wet)
    ring[[0, -1]] = ring[:, [0, -1]] = True
    return wet & ring


def test_a_closed_river_is_not_touched():
    river = read_river(course(circle(30.0, 60)), True, 0.0)
    assert on_map(river) is river


@pytest.mark.parametrize("line", [STRAIGHT, BENT, HOOK])
def test_both_ends_go_on_to_the_edge_of_the_map_and_the_course_stays(line):
    points = course(line)
    world = World.from_centerline(points, closed=False, plants=False)
    wet = world.water_m > world.ground_m
    assert waters(wet) == 1
    assert waters(on_border(wet)) == 2
    river = read_river(points, False, 0.0)
    for name in ("position_m", "arc_m", "tangent", "width_m", "depth_m", "level_m"):
        np.testing.assert_array_equal(getattr(world.river, name), getattr(river, name))
    longer = on_map(river)
    first = int(np.argmin(np.hypot(*(longer.position_m - river.position_m[0]).T)))
    np.testing.assert_array_equal(longer.position_m[first : first + len(river.arc_m)], river.position_m)
    assert (longer.width_m[:first] == river.width_m[0]).all()
    assert (longer.level_m[first + len(river.arc_m) :] == river.level_m[-1]).all()


@pytest.mark.parametrize("line", [STRAIGHT, BENT, HOOK])
def test_the_continuation_leaves_land_between_itself_and_every_other_arm(line):
    longer = on_map(read_river(course(line), False, 0.0))
    assert len(geometry.self_crossings(longer.position_m, closed=False)) == 0
    apart = geometry.distances(longer.position_m)
    arc = geometry.arc_between(longer.arc_m, longer.length_m, False)
    needed = longer.width_m[0] + MIN_LAND_M
    assert apart[arc > 1.7 * needed].min() > needed - 0.5
    assert np.abs(geometry.curvature(longer.position_m, False)).max() * longer.width_m[0] / 2 < 1


def test_an_end_with_no_way_out_stays_as_it_is():
    # The line winds inwards: its last arm is shut in by the others.
    angle = np.linspace(0.0, 4.4 * np.pi, 240)
    spiral = (70.0 - 13.0 * angle / np.pi)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    river = read_river(course(spiral, width_m=8.0), False, 0.0)
    longer = on_map(river)
    assert len(longer.arc_m) > len(river.arc_m)
    np.testing.assert_array_equal(longer.position_m[-len(river.arc_m) :], river.position_m)
