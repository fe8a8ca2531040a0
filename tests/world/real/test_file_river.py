"""Tests of rivers from files with several ways, banks, bridges and islands, worked by hand in metres."""

import json

import numpy as np
import pytest

from tests.world.real.drawn_files import box, line, planned, polygon, straight, write
from tests.world.real.geojson_files import feature
from thalweg.world import World, WorldError, WorldFileError
from thalweg.world.bridges import Bridge

pytest.importorskip("shapely")
pytest.importorskip("pyproj")

RIVER = line(straight(), waterway="river", width="12 m", name="Test River")


def test_the_reader_of_files_has_a_second_name():
    assert World.from_geojson is World.from_file


def test_two_ways_drawn_against_one_another_are_one_river(tmp_path):
    west, east = straight(0, 100, 5), straight(100, 200, 5)
    one = planned(write(tmp_path, RIVER))
    two = planned(write(tmp_path, line(east[::-1], width=12), line(west, width="12 m"), name="two.geojson"))
    # Both are as long: the first one in the file runs west.
    np.testing.assert_allclose(two.river.position_m[::-1], one.river.position_m, atol=0.01)
    assert two.notes == ("2 ways joined, 1 of them turned",)
    assert (one.name, two.name) == ("Test River", "two")


def test_a_way_beside_others_that_are_left_out_is_one_way(tmp_path):
    stub = line([(200, 0), (200.5, 0)], waterway="river")
    plan = planned(write(tmp_path, RIVER, stub))
    assert plan.notes == ("1 way joined, 0 of them turned; 1 beside the main stem left out",)


def test_the_centre_line_and_width_of_a_rectangle(tmp_path):
    plan = planned(write(tmp_path, polygon(box(0, -6, 200, 6), natural="water")))
    river = plan.river
    assert river.length_m == pytest.approx(200, abs=0.02)
    np.testing.assert_allclose(river.position_m[:, 1], 0, atol=0.01)
    np.testing.assert_allclose(river.width_m, 12, atol=0.01)
    assert river.position_m[0, 0] < river.position_m[-1, 0]  # it begins at the end of the first position
    assert plan.notes == ("centre line and widths of 12.0 to 12.0 m measured between the banks",)


def test_a_line_beside_the_middle_gives_the_banks_their_direction_and_name(tmp_path):
    banks = polygon(box(0, -6, 200, 6), natural="water")
    way = line(straight(190, 10, 5, y=2.5), waterway="river", name="Test River", width=3)
    plan = planned(write(tmp_path, banks, way))
    assert plan.name == "Test River"
    assert plan.river.position_m[0, 0] > plan.river.position_m[-1, 0]
    np.testing.assert_allclose(plan.river.position_m[:, 1], plan.river.position_m[0, 1], atol=0.02)
    np.testing.assert_allclose(plan.river.width_m, 12, atol=0.02)


def test_elevations_of_ways_between_measured_banks_are_left_out_with_a_note(tmp_path):
    way = line(straight(), waterway="river")
    for index, place in enumerate(way["geometry"]["coordinates"]):
        place.append(500.0 - index)
    path = write(tmp_path, polygon(box(0, -6, 200, 6), natural="water"), way)
    plan, flat = planned(path), planned(path, flat_water=True)
    assert plan.notes[-1] == "elevations of the ways left out: the water between measured banks is level"
    assert np.ptp(plan.river.level_m) == 0
    assert plan.notes[:-1] == flat.notes


def test_polygons_that_touch_are_one_and_a_pond_far_from_the_line_does_not_count(tmp_path):
    parts = [polygon(box(0, -6, 90, 6)), polygon(box(90.2, -6, 200, 6)), polygon(box(50, 60, 90, 80))]
    plan = planned(write(tmp_path, *parts, line(straight())))
    assert plan.river.length_m == pytest.approx(200, abs=0.05)


def test_banks_that_cover_little_of_the_ways_leave_their_widths(tmp_path):
    plan = planned(write(tmp_path, polygon(box(0, -6, 60, 6), natural="water"), RIVER))
    assert plan.notes == ("no piece of the banks covers more than 30% of the ways: widths are those of the ways",)
    assert plan.river.length_m == pytest.approx(200, abs=0.02)


def test_of_banks_in_several_pieces_the_share_is_that_of_one(tmp_path):
    pieces = [polygon(box(0, -6, 90, 6), natural="water"), polygon(box(120, -6, 200, 6), natural="water")]
    plan = planned(write(tmp_path, *pieces, RIVER))
    assert plan.notes == ("no piece of the banks covers more than 45% of the ways: widths are those of the ways",)


def test_holes_and_islets_are_islands_and_ways_with_bridges_are_bridges(tmp_path):
    banks = polygon(box(0, -10, 200, 10), box(60, 2, 72, 5), natural="water")
    islet = polygon(box(120, -5, 130, -2), place="islet")
    far = polygon(box(120, 45, 130, 48), place="islet")
    bridge = line([(160, -40), (160, 40)], highway="footway", bridge="yes")
    other = line([(160, 140), (190, 140)], highway="footway", bridge="yes")
    plan = planned(write(tmp_path, banks, islet, far, bridge, other))
    middle = np.array([100.0, 0.0])
    np.testing.assert_allclose(plan.solids.islands[:, :2] + middle, [[125, -3.5], [66, 3.5]], atol=0.02)
    (row,) = plan.solids.bridges
    assert (Bridge(*row).x + 100, Bridge(*row).width, Bridge(*row).span) == pytest.approx((160, 3, 19.6), abs=0.02)
    assert (
        plan.notes[-1] == "1 bridge, 2 islands, 2 bridges or islands not on the course, too small or along it left out"
    )
    bare = planned(write(tmp_path, banks, islet, bridge), open_water=True)
    assert len(bare.solids.islands) == len(bare.solids.bridges) == 0


def test_a_world_has_the_islands_and_bridges_of_its_file(tmp_path):
    bridge = line([(40, -30), (40, 30)], bridge="yes")
    path = write(tmp_path, line(straight(0, 80, 5), width=14), polygon(box(15, 2, 21, 4), place="islet"), bridge)
    world = World.from_file(path, plants=False)
    assert (len(world.islands), len(world.bridges)) == (1, 1)
    x, y = world.islands[0, :2]
    row, column = (
        round((at - origin) / 0.25) for at, origin in ((y, world.grid.origin_y_m), (x, world.grid.origin_x_m))
    )
    assert world.ground_m[row, column] > world.water_m[row, column]


def test_an_island_that_fills_the_river_is_refused_with_the_way_out(tmp_path):
    path = write(tmp_path, line(straight(), width=8), polygon(box(90, -4, 110, 4), place="islet"))
    with pytest.raises(
        WorldFileError, match=r"no safe pose at arc \d+\.\d m: .*; open_water leaves bridges and islands"
    ):
        planned(path)
    assert planned(path, open_water=True).river.length_m == pytest.approx(200, abs=0.02)


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:3857", "EPSG:25832"])
@pytest.mark.parametrize("named", ["member", "option"])
def test_projected_coordinates_give_the_same_river_to_a_centimetre(tmp_path, crs, named):
    import pyproj

    plain = write(tmp_path, line(straight(y=3.0), width=12), name="plain.geojson")
    data = json.loads(plain.read_text())
    coordinates = data["features"][0]["geometry"]["coordinates"]
    to = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    data["features"][0]["geometry"]["coordinates"] = [to.transform(*place) for place in coordinates]
    if named == "member":
        data["crs"] = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:EPSG::{crs[5:]}"}}
    (tmp_path / "projected.geojson").write_text(json.dumps(data))
    projected = planned(tmp_path / "projected.geojson", crs=crs if named == "option" else None)
    np.testing.assert_allclose(projected.river.position_m, planned(plain).river.position_m, atol=0.01)


def test_a_way_without_width_takes_it_from_its_neighbours_unless_one_is_given(tmp_path):
    ways = [line(straight(0, 100, 5), width=8), line(straight(100, 150, 3)), line(straight(150, 250, 5), width=10)]
    path = write(tmp_path, *ways)
    width = planned(path).river.width_m
    assert (width[0], width[-1]) == (8, 10)
    assert width[len(width) // 2] == pytest.approx(9, abs=0.5)
    assert planned(path, width_m=20.0).river.width_m.max() == pytest.approx(20)


def test_a_line_is_run_backwards_and_flat_on_request(tmp_path):
    path = write(tmp_path, line(straight(), width=12))
    assert planned(path, reverse=True).river.position_m[0, 0] > 0
    steep = json.loads(path.read_text())
    for index, place in enumerate(steep["features"][0]["geometry"]["coordinates"]):
        place.append(100.0 + 30.0 * (index % 2))
    path.write_text(json.dumps(steep))
    with pytest.raises(WorldFileError, match=r"an elevation of .* lies .* from a profile .* Else pass flat_water"):
        planned(path)
    assert np.ptp(planned(path, flat_water=True).river.level_m) == 0


TRIANGLE = [(0, 0), (100, 20), (200, 0), (0, 0)]
OPEN = [[[11, 48], [11.1, 48], [11, 48.1], [11.1, 48.1]]]
BOW = [(0, 0), (100, 20), (100, 0), (0, 20), (0, 0)]
BAD_FILES = {
    "only roads": ([line(straight(), highway="path")], {}, r"no water way in it, but 1 other line; expected a line of"),
    "two roads": ([line(straight(), highway="path")] * 2, {}, r"no water way in it, but 2 other lines; expected"),
    "only a bridge": ([line(straight(), bridge="yes")], {}, "no water way in it, but 1 bridge"),
    "no width": ([line(straight())], {}, "no width: give the line the property width_m, in metres, or width, such as"),
    "wide word": ([line(straight(), width="wide")], {}, 'width of feature 0 is "wide"; expected a number of metres'),
    "too few widths": ([line(straight(), width=[3, 4])], {}, "width has 2 numbers for 9 positions"),
    "gap": (
        [line(straight(0, 90, 3)), line(straight(120, 200, 3))],
        {"width_m": 9.0},
        r"2 ways of water in 2 pieces that do not join: .*, 30\.0 m from the nearest end",
    ),
    "line crosses itself": (
        [line([(0, 0), (100, 0), (100, 50), (50, 50), (50, -50)], width=8)],
        {},
        "the line crosses itself between its piece at longitude 11.0",
    ),
    "polygon crosses itself": ([polygon(BOW)], {}, r"feature 0: the polygon crosses itself at longitude 11\.\d+"),
    "a pond": ([polygon(box(0, 0, 40, 30))], {}, r"is \d+ m long and 30 m wide, which is no river; expected at least"),
    "two ponds": (
        [polygon(box(0, 0, 100, 9)), polygon(box(0, 30, 100, 39))],
        {},
        r"2 polygons of water that do not join: the largest lies 21\.0 m from the next one; limit 0\.5 m",
    ),
    "a thread": ([polygon(box(0, 0, 100, 1))], {}, r"the banks are at most 1\.00 m apart; at least 2\.20 m are needed"),
    "unclosed": (
        [{**polygon(BOW), "geometry": {"type": "Polygon", "coordinates": OPEN}}],
        {},
        "do not end where they begin; expected at least 4",
    ),
    "nobody of that name": ([RIVER], {"river_name": "Rhine"}, "no water is named 'Rhine'; the names are Test River"),
    "unknown system": ([RIVER], {"crs": "EPSG:99"}, r"reference system 'EPSG:99' is unknown; name one such as"),
    "degrees in metres": ([RIVER], {"crs": "EPSG:32632"}, "looks like degrees and not like metres in EPSG:32632"),
    "latitude of another datum": (
        [feature([[11.0, 105.0], [11.001, 105.0], [11.002, 105.0]])],
        {"crs": "EPSG:4258"},
        r"position 0 of feature 0 is \[11, 105\], which is no longitude .* and latitude",
    ),
    "heights": ([RIVER], {"crs": "EPSG:5773"}, r"EPSG:5773 \(Vertical CRS\) has no positions on a map; name a"),
    "halves of characters": ([RIVER], {"crs": "\ud800"}, r"reference system '\\ud800' is unknown; name one such as"),
    "mixed": (
        [feature([[11.0, 48.0], [678000.0, 5321000.0], [11.01, 48.0]])],
        {},
        r"position 1 of feature 0 is \[678000, 5321000\], which is no longitude .* \(1 of its 3 positions are",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("features", "options", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_a_file_without_a_river_is_refused_with_what_would_be_right(tmp_path, features, options, message):
    path = write(tmp_path, *features)
    with pytest.raises(WorldFileError, match=message) as raised:
        planned(path, **options)
    assert str(raised.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"crs": ""}, "crs is ''; expected text"),
        ({"river_name": 3}, "river_name is 3; expected text"),
        ({"reverse": "yes"}, "reverse is 'yes'; expected True or False"),
        ({"start_m": -1}, "start_m is -1 m; expected at least 0 m"),
    ],
)
def test_an_option_of_the_wrong_kind_is_refused_before_the_file_is_read(tmp_path, options, message):
    with pytest.raises(WorldError, match=message):
        planned(tmp_path / "none.geojson", **options)


def test_without_the_libraries_a_line_works_and_a_polygon_names_the_extra(tmp_path, monkeypatch):
    import sys

    for name in ("shapely", "pyproj", "gpxpy", "defusedxml", "defusedxml.ElementTree"):
        monkeypatch.setitem(sys.modules, name, None)
    assert planned(write(tmp_path, RIVER)).river.length_m == pytest.approx(200, abs=0.02)
    for features, options in (([polygon(box(0, 0, 99, 9))], {}), ([RIVER], {"crs": "EPSG:3857"})):
        with pytest.raises(WorldFileError, match=r"needs (shapely|pyproj), .* pip install '\.\[geo\]'"):
            planned(write(tmp_path, *features), **options)
    for name, text in (("a.gpx", "<gpx/>"), ("a.kml", "<kml/>")):
        (tmp_path / name).write_text(text)
        with pytest.raises(
            WorldFileError, match=r"needs defusedxml, which is not installed: .*: pip install '\.\[geo\]'"
        ):
            planned(tmp_path / name)


def test_a_line_of_two_positions_is_a_straight_river(tmp_path):
    plan = planned(write(tmp_path, line([(0, 0), (200, 0)], width=12)))
    assert plan.river.length_m == pytest.approx(200, abs=1e-3)
    assert plan.river.segments == round(200 / 1.3)


def test_the_polygon_of_a_whole_river_is_cut_to_the_ways(tmp_path):
    """80 km of banks would be too much; the way is 200 m long."""
    whole = polygon(box(-40_000, -6, 40_000, 6), natural="water")
    plan = planned(write(tmp_path, whole, RIVER))
    assert plan.river.length_m == pytest.approx(200, abs=10)
    np.testing.assert_allclose(plan.river.width_m, 12, atol=0.1)
    with pytest.raises(WorldFileError, match="its banks extend over more than 60 km: cut them to the reach"):
        planned(write(tmp_path, whole))
