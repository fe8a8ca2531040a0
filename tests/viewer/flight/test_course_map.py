"""Tests of the map as plain data."""

import numpy as np

from tests.env import handmade
from thalweg.viewer.flight.course_map import map_of, props_on_map


def test_banks_lie_half_a_width_to_either_side_of_the_course():
    told = map_of(handmade.canal(length_m=60.0))  # 6 m wide, along x
    assert told["closed"] is False and told["length_m"] == 60.0
    assert told["left"][0] == [0.0, 3.0] and told["right"][0] == [0.0, -3.0]
    assert told["centre"][-1] == [60.0, 0.0]


def test_props_are_told_by_kind_and_place_without_empty_rows():
    rows = np.array([[[1, 2.0, 3.0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [3, -1.5, 4.25, 0, 0, 0]]], np.float32)
    assert props_on_map(rows) == [[1.0, 2.0, 3.0], [3.0, -1.5, 4.25]]
    assert props_on_map(None) == []
