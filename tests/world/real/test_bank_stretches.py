"""Tests of kinds of banks in files: per way, turned with it, cut with the course, and over the ends of a loop."""

from dataclasses import replace

import numpy as np
import pytest

from tests.world.lines import circle
from tests.world.real.drawn_files import from_metres, line, write
from thalweg.world import WorldError, WorldFileError
from thalweg.world.banks import text_of
from thalweg.world.real.file_river import plan_file
from thalweg.world.real.reach import Reach
from thalweg.world.real.selection import Selection


def straight(start: float, end: float) -> list[tuple[float, float]]:
    return [(float(x), 0.0) for x in np.linspace(start, end, 9)]


def banks_of(path, **options) -> str:
    return text_of(plan_file(path, Selection(**options)).banks)


def test_a_way_alone_gives_its_kind_to_the_whole_river(tmp_path):
    assert banks_of(write(tmp_path, line(straight(0, 160), width=8, banks="meadow"))) == "meadow"


def test_each_way_has_its_own_and_a_turned_one_its_other_side(tmp_path):
    one = line(straight(0, 100), width=8, banks="reeds_left")
    other = line(straight(250, 100), width=8, banks="quay_left")
    onward = line(straight(250, 400), width=8)
    found = banks_of(write(tmp_path, one, other, onward))
    assert found == "reeds_0-100_left+quay_100-250_right"


def test_a_span_is_measured_along_its_way(tmp_path):
    ways = line(straight(0, 100), width=8), line(straight(100, 300), width=8, banks="quay_20-50_right")
    assert banks_of(write(tmp_path, *ways)) == "quay_120-150_right"


def test_what_lies_outside_the_reach_is_cut(tmp_path):
    path = write(tmp_path, line(straight(0, 100), width=8, banks="reeds"), line(straight(100, 300), width=8))
    assert banks_of(path, start_m=60, length_m=150).startswith("reeds_0-4")
    assert banks_of(path, start_m=150, length_m=100) == "forest"


def test_reversing_the_river_changes_the_sides(tmp_path):
    path = write(tmp_path, line(straight(0, 200), width=8, banks="quay_0-50_left"))
    assert banks_of(path, reverse=True) == "quay_150-_right"


def test_a_way_beside_the_main_stem_counts_for_nothing(tmp_path):
    side = line([(100.0, 0.0), (105.0, 40.0), (110.0, 60.0)], width=6, banks="quay")
    ways = line(straight(0, 100), width=8), line(straight(100, 300), width=8, banks="meadow")
    assert banks_of(write(tmp_path, *ways, side)) == "meadow_100-"


def test_a_loop_of_one_kind_and_a_stretch_over_its_end(tmp_path):
    ring = [*map(tuple, circle(40.0, 60)), (40.0, 0.0)]
    assert banks_of(write(tmp_path, line(ring, width=8, banks="meadow"))) == "meadow"
    spanned = banks_of(write(tmp_path, line(ring, width=8, banks="reeds_200-240")))
    start, end = (float(each) for each in spanned.removeprefix("reeds_").split("-"))
    assert (start, end) == pytest.approx((200, 240), abs=1.5)


@pytest.mark.parametrize(
    ("radius", "count", "turned"), [(49.10885, 65, True), (31.22921, 53, False), (48.19907, 88, True)]
)
def test_a_stretch_may_begin_or_end_where_a_loop_is_closed(tmp_path, radius, count, turned):
    """Rounding led past the end of each of these loops."""
    ring = [*map(tuple, circle(radius, count)), (radius, 0.0)]
    ring = ring[::-1] if turned else ring
    length = 2 * count * radius * np.sin(np.pi / count)
    for value, wanted in (("reeds_0-40", (0, 40)), ("reeds_100-", (100, length))):
        (reach,) = plan_file(write(tmp_path, line(ring, width=8, banks=value)), Selection()).banks
        assert (reach.start_m, length if reach.end_m is None else reach.end_m) == pytest.approx(wanted, abs=0.2)


def test_the_option_lies_over_the_file_and_forest_takes_it_away(tmp_path):
    path = write(tmp_path, line(straight(0, 200), width=8, banks="meadow"))
    assert banks_of(path, banks="quay_50-80") == "meadow+quay_50-80"
    assert banks_of(path, banks="forest") == "forest"
    assert banks_of(path, banks=["reeds", "forest_10-20"]) == "reeds+forest_10-20"


def test_the_note_says_which_banks_there_are(tmp_path):
    path = write(tmp_path, line(straight(0, 200), width=8, banks="meadow"))
    assert plan_file(path, Selection()).notes[-1] == "banks: meadow"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("lawn", r"river\.geojson: .*: banks: unknown kind 'lawn'.*known: forest, meadow, reeds, quay"),
        (3, r"river\.geojson: .*: banks are 3; expected a kind"),
        ("quay_0-500", r"river\.geojson: .*: banks: quay_0-500 is not on the way, which is 200\.0 m long"),
    ],
)
def test_a_bad_property_names_the_file_the_way_and_the_value(tmp_path, value, message):
    path = write(tmp_path, line(straight(0, 200), width=8, banks=value))
    with pytest.raises(WorldFileError, match=message):
        plan_file(path, Selection())


def test_a_bad_option_is_refused():
    with pytest.raises(WorldError, match=r"unknown kind 'lawn'"):
        Selection(banks="lawn")


def test_a_reach_of_the_option_that_is_not_on_the_course_names_it(tmp_path):
    path = write(tmp_path, line(straight(0, 200), width=8))
    with pytest.raises(WorldFileError, match=r"quay_0-300 is not on the course, which is 200"):
        plan_file(path, Selection(banks="quay_0-300"))


def test_the_data_of_a_reach_has_banks_only_if_they_are_chosen(tmp_path):
    reach = Reach(write(tmp_path, line(straight(0, 200), width=8)))
    assert "banks" not in reach.as_data()
    assert replace(reach, banks="meadow").as_data()["banks"] == "meadow"


def test_places_west_of_the_antimeridian_are_followed(tmp_path):
    degrees = np.array(from_metres(straight(0, 160))) - [11.0, 48.0]
    shifted = (degrees + np.array([179.999, 48.0])).tolist()
    wrapped = [[x - 360.0 if x > 180 else x, y] for x, y in shifted]
    feature = {"type": "Feature", "properties": {"width": 8, "banks": "reeds_0-40"}}
    feature["geometry"] = {"type": "LineString", "coordinates": wrapped}
    assert banks_of(write(tmp_path, feature)) == "reeds_0-40"


def test_a_span_may_lead_over_the_end_of_a_closed_way(tmp_path):
    ring = [*map(tuple, circle(40.0, 60)), (40.0, 0.0)]
    over = banks_of(write(tmp_path, line(ring, width=8, banks="quay_200-20")))
    first, last = (float(each) for each in over.removeprefix("quay_").split("-"))
    assert (first, last) == (pytest.approx(200, abs=2.0), pytest.approx(20, abs=2.0))
    with pytest.raises((WorldError, WorldFileError), match="is not on the way"):
        banks_of(write(tmp_path, line(ring, width=8, banks="quay_300-20")))
    with pytest.raises((WorldError, WorldFileError), match="is not on the way"):
        banks_of(write(tmp_path, line(straight(0, 300), width=8, banks="quay_200-20")))
