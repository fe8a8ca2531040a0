"""Tests of the zones of banks, on a straight river and on a ring."""

import numpy as np
import pytest

from tests.world.generate.banks import straight
from tests.world.lines import circle, course
from thalweg.world.banks import KINDS, read_banks
from thalweg.world.generate.banks.zones import STEP_M, kinds_along
from thalweg.world.real.centerline import read_river


@pytest.fixture(scope="module")
def land():
    return straight.terrain()


def test_distance_arc_length_and_side_are_those_of_a_straight_river(land):
    found = straight.zones("meadow", land)
    for x, y in ((10.0, 6.0), (30.0, -4.5), (45.0, 3.0), (20.0, -1.0)):
        assert straight.at(land, found.bank_m, x, y) == pytest.approx(abs(y) - 4.0, abs=0.15)
        assert straight.at(land, found.arc_m, x, y) == pytest.approx(x, abs=0.15)
        assert straight.at(land, found.side, x, y) == np.sign(y)


def test_the_arc_length_goes_on_beyond_the_ends(land):
    found = straight.zones("meadow", land)
    before, after = (straight.at(land, found.arc_m, x, 6.0) for x in (-20.0, 80.0))
    assert before < -10.0 and after > 70.0


def test_a_reach_is_on_its_side_and_between_its_ends(land):
    found = straight.zones("quay_20-40_left", land).share
    assert list(found) == ["quay"]
    for x, y, expected in ((30, 5, 1), (30, -5, 0), (10, 5, 0), (50, 5, 0), (20, 5, 0.5), (40, 5, 0.5)):
        assert straight.at(land, found["quay"], x, y) == pytest.approx(expected, abs=0.1)


def test_shares_add_up_and_the_last_reach_counts(land):
    found = straight.zones("meadow+reeds_0-30", land).share
    total = found["meadow"] + found["reeds"]
    assert total == pytest.approx(np.ones_like(total), abs=2e-3)
    assert straight.at(land, found["reeds"], 15.0, 5.0) == pytest.approx(1.0, abs=1e-3)
    assert straight.at(land, found["meadow"], 45.0, 5.0) == pytest.approx(1.0, abs=1e-3)


def test_a_bank_goes_on_beyond_the_ends_of_an_open_course(land):
    share = straight.zones("reeds_30-", land).share["reeds"]
    assert straight.at(land, share, 75.0, 6.0) == pytest.approx(1.0, abs=1e-3)
    assert straight.at(land, share, -15.0, 6.0) == pytest.approx(0.0, abs=1e-3)


def test_a_reach_may_go_over_the_end_of_a_loop():
    river = read_river(course(circle(25.0, 80), 6.0), True, 1.0)
    kinds = kinds_along(river, read_banks("quay_150-10"), "left")
    arc = (np.arange(len(kinds)) + 0.5) * river.length_m / len(kinds)
    assert ((kinds == KINDS.index("quay")) == ((arc >= 150) | (arc < 10))).all()
    assert river.length_m / len(kinds) == pytest.approx(STEP_M, abs=1e-3)


def test_islands_count_as_water_and_are_marked():
    land = straight.terrain(islands=np.array([[30.0, 0.0, 3.0, 1.2, 0.0]]))
    found = straight.zones("meadow", land)
    assert straight.at(land, found.island_m, 30.0, 0.0) == 0.0
    assert straight.at(land, found.bank_m, 30.0, 0.0) == pytest.approx(-4.0, abs=0.05)
    assert straight.at(land, found.island_m, 30.0, 2.2) == pytest.approx(1.0, abs=0.3)
    assert straight.at(land, found.island_m, 10.0, 0.0) > 100.0
