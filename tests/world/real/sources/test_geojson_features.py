"""Tests of reading GeoJSON files: every form of a line, and the errors for invalid files."""

import tracemalloc

import numpy as np
import pytest

from tests.world.real.geojson_files import EAST, feature, read, written
from thalweg.world import World, WorldFileError


@pytest.mark.parametrize(
    "wrap",
    [
        lambda one: {"type": "FeatureCollection", "features": [one]},
        lambda one: {
            "type": "FeatureCollection",
            "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
            "features": [
                {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [7.0, 45.0]}},
                {"type": "Feature", "properties": None, "geometry": None},
                one,
            ],
        },
        lambda one: one | {"geometry": {"type": "GeometryCollection", "geometries": [one["geometry"]]}},
        lambda one: one | {"crs": {"type": "name", "properties": {"name": "EPSG:4326"}}, "bbox": [7, 45, 7.02, 45]},
        lambda one: one | {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::4326"}}},
        lambda one: feature([place for place in EAST for _ in range(3)]),
        lambda one: feature([EAST], "MultiLineString"),
        lambda one: feature([EAST[2:], EAST[:2], EAST[1:3]], "MultiLineString"),
        lambda one: feature([[*EAST[0], 3.0, 99], *[[*place, 3.0] for place in EAST[1:]]]),
    ],
    ids=[
        "collection",
        "among others",
        "geometries",
        "crs",
        "crs as urn",
        "repeated",
        "one part",
        "parts in any order",
        "measures",
    ],
)
def test_the_same_line_is_found_in_every_kind_of_object(tmp_path, wrap):
    plain = read(tmp_path, feature(EAST))
    np.testing.assert_array_equal(read(tmp_path, wrap(feature(EAST))).points, plain.points)


def test_a_bare_geometry_takes_its_width_from_the_argument_and_its_name_from_the_file(tmp_path):
    line = read(tmp_path, feature(EAST)["geometry"], width_m=9.5)
    assert (line.points[:, 3] == 9.5).all()
    assert line.name == "river"


@pytest.mark.parametrize(
    ("properties", "widths"),
    [
        ({"width_m": 8.5}, [8.5] * 5),
        ({"width_m": None, "width": "15"}, [15.0] * 5),
        ({"width_m": 8, "width": 99}, [8.0] * 5),
        ({"width_m": [8, 9, 10.5, 11, 12]}, [8.0, 9.0, 10.5, 11.0, 12.0]),
    ],
)
def test_the_width_of_the_file_overrides_the_argument(tmp_path, properties, widths):
    assert read(tmp_path, feature(EAST, **properties), width_m=33.0).points[:, 3].tolist() == widths


NESTED = '{"type": "GeometryCollection", "geometries": [' * 900 + "]}" * 900


BAD_FILES = {
    "broken": ('{"type": "Feature",', "not JSON: .*line 1 column 20"),
    "not a number": ('{"type": "LineString", "coordinates": [[NaN, 1], [2, 3]]}', "not JSON: NaN is not a number"),
    "not text": (b'{"name": "\xff"}', r"not text in UTF-8 \(byte 10\)"),
    "empty": ("", "the file is empty; expected GeoJSON"),
    "deep": (NESTED, "not GeoJSON: nested too deep"),
    "deeper": ("[" * 200_000, "nested too deep"),
    "list": ([1, 2], r"not GeoJSON: \[1, 2\] stands where an object with a `type` is expected"),
    "other json": ({"hello": 1}, r"not GeoJSON: .*hello.* object with a `type`"),
    "topology": ({"type": "Topology"}, 'type "Topology" is unknown; expected FeatureCollection'),
    "no features": ({"type": "FeatureCollection"}, "the FeatureCollection has no list of features"),
    "nothing": ({"type": "FeatureCollection", "features": []}, "no water way in it: it is empty; expected a line of"),
    "point": (feature([7, 45], "Point"), "no water way in it, but 1 Point"),
    "one position": (feature([[7, 45]]), "the LineString is a line of 1 positions; at least 2 are needed"),
    "no coordinates": ({"type": "LineString"}, "coordinates of the LineString are null; expected a list of positions"),
    "words": (
        feature([[7, 45], ["7", "45"], [7, 46]]),
        r'position 1 of the LineString is \["7", "45"\]; expected longitude, latitude',
    ),
    "true": (feature([[7, True], [7, 46]]), r"position 0 of the LineString is \[7, true\]"),
    "infinite": (
        '{"type": "LineString", "coordinates": [[7, 45], [7, 1e999]]}',
        r"position 1 of the LineString is \[7, Infinity\]",
    ),
    "projected": (
        feature([[691000.5, 5334000], [691100, 5334000]]),
        r"position 0 of .* is \[691000.5, 5334000\], which is no longitude .*; for projected coordinates, name",
    ),
    "latitude first": (
        feature([[45, 100.5], [45, 100.6]]),
        r"position 0 of .* is \[45, 100.5\].*longitude comes first",
    ),
    "turned too far": (feature([[7, 45], [187.5, 45]]), r"position 1 of .* is \[187.5, 45\], which is no longitude"),
    "crs": (
        feature(EAST) | {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}},
        r"is \[7, 45\], which looks like degrees and not like metres in urn:ogc:def:crs:EPSG::25832",
    ),
    "linked crs": (feature(EAST) | {"crs": {"type": "link", "properties": {"href": "x"}}}, "its crs is .*href"),
    "gap": (
        feature([EAST[:2], EAST[3:]], "MultiLineString"),
        r"longest ends at longitude 7\.015.* \(part 1 of the MultiLineString\), 788\.5 m from the nearest end of",
    ),
    "no parts": (feature([], "MultiLineString"), r"has no parts: its coordinates are \[\]"),
    "no width": (feature(EAST, width_m=None), "no width: give the line the property width_m.*or pass width_m"),
    "wide word": (feature(EAST, width_m="wide"), 'width_m of the LineString is "wide"; expected a number of metres'),
    "negative": (feature(EAST, width_m=-3), "width_m of the LineString is -3; expected a number of metres above 0"),
    "true width": (feature(EAST, width_m=True), "width_m of the LineString is true; expected"),
    "nan width": (feature(EAST, width_m="nan"), 'width_m of the LineString is "nan"; expected'),
    "a bad one": (feature(EAST, width_m=[9, 9, 0, 9, 9]), r"width_m\[2\] of the LineString is 0; expected a number"),
    "too few": (feature(EAST, width_m=[9, 9]), "width_m has 2 numbers for 5 positions; expected one for each"),
    "list in parts": (
        feature([EAST], "MultiLineString", width_m=[9] * 5),
        "a list of widths needs a LineString; a MultiLineString has one width",
    ),
    "some elevations": (
        feature([[*EAST[0], 5.0], *EAST[1:]]),
        "position 1 of the line has no elevation, but others have",
    ),
    "missing value": (
        feature([[*p, -9999] for p in EAST]),
        r"elevation of position 0 is -9999 m; limit -500 to 7000 m",
    ),
}


@pytest.mark.parametrize(("content", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_an_invalid_file_is_refused_with_its_path_and_the_reason(tmp_path, content, message):
    path = written(tmp_path, content)
    with pytest.raises(WorldFileError, match=message) as raised:
        World.from_file(path, plants=False)
    assert str(raised.value).startswith(f"{path}: ")


def test_a_missing_file_and_a_folder_are_refused_by_path(tmp_path):
    for path in (tmp_path / "none.geojson", tmp_path):
        with pytest.raises(WorldFileError, match=f"{path}: there is no such file"):
            World.from_file(path)


def test_a_file_that_is_too_large_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "land.geojson"
    with path.open("wb") as file:
        file.truncate(300_000_000)
    tracemalloc.start()
    try:
        with pytest.raises(WorldFileError, match="300 MB; limit 64 MB: keep only the river"):
            World.from_file(path)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_a_number_that_no_float_holds_is_refused(tmp_path):
    high = [[*EAST[0], 10**400], *([*place, 1] for place in EAST[1:])]
    for content in (feature(EAST, width_m=10**400), feature(high)):
        with pytest.raises(WorldFileError, match=r"river\.geojson: "):
            read(tmp_path, content)


def test_halves_of_characters_in_a_name_are_replaced(tmp_path):
    assert read(tmp_path, feature(EAST, name="El\ud800de")).name == "El?de"
