"""Tests of the readers: the same line from every format, and files that are refused."""

import json
import zipfile

import numpy as np
import pytest

from tests.world.real.drawn_files import from_metres, line, planned, straight, write
from thalweg.world import WorldFileError
from thalweg.world.real.sources.features import MAX_POSITIONS
from thalweg.world.real.sources.overpass import overpass_features

pytest.importorskip("gpxpy")
pytest.importorskip("defusedxml")
pytest.importorskip("shapely")

PLACES = from_metres(straight(count=5))
GPX = '<gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">{}</gpx>'
KML = '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'
KML_LINE = (
    "<Placemark><name>Isar</name>{data}<LineString>{mode}<coordinates>{places}</coordinates></LineString></Placemark>"
)
WIDTH = '<ExtendedData><Data name="width"><value>12 m</value></Data></ExtendedData>'


def track(places, name: str = "Isar") -> str:
    points = "".join(f'<trkpt lon="{x!r}" lat="{y!r}"/>' for x, y in places)
    return f"<trk><name>{name}</name><trkseg>{points}</trkseg></trk>"


def kml_places(places, z: float = 0.0) -> str:
    return " ".join(f"{x!r},{y!r},{z}" for x, y in places)


def overpass(*elements: dict) -> str:
    return json.dumps({"version": 0.6, "generator": "Overpass API", "elements": list(elements)})


def way(places, number: int = 1, **tags: str) -> dict:
    return {"type": "way", "id": number, "tags": tags, "geometry": [{"lon": x, "lat": y} for x, y in places]}


FORMATS = {
    "river.gpx": GPX.format(track(PLACES)),
    "route.gpx": GPX.format(
        "<rte><name>Isar</name>" + "".join(f'<rtept lon="{x!r}" lat="{y!r}"/>' for x, y in PLACES) + "</rte>"
    ),
    "parts.gpx": GPX.format(track(PLACES[:4]) + track(PLACES[:2:-1])),
    "river.kml": KML.format(KML_LINE.format(data=WIDTH, mode="", places=kml_places(PLACES, 500.0))),
    "overpass.json": overpass(way(PLACES[:3], 1, waterway="river", name="Isar"), way(PLACES[2:], 2, waterway="river")),
    "nested.geojson": json.dumps(
        {
            "type": "Feature",
            "id": "way/1",
            "properties": {"type": "way", "id": 1, "tags": {"waterway": "river", "name": "Isar"}, "meta": {}},
            "geometry": {"type": "LineString", "coordinates": PLACES},
        }
    ),
    "ogr.geojson": json.dumps(
        {
            "type": "Feature",
            "properties": {"osm_id": "1", "waterway": "river", "name": "Isar", "other_tags": '"width"=>"12","a"=>"b"'},
            "geometry": {"type": "LineString", "coordinates": PLACES},
        }
    ),
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_river_comes_from_every_format(tmp_path, name):
    plain = planned(write(tmp_path, line(straight(count=5), width=12, name="Isar"), name="plain.geojson"))
    (tmp_path / name).write_text(FORMATS[name])
    plan = planned(tmp_path / name, width_m=12.0)
    np.testing.assert_allclose(plan.river.position_m, plain.river.position_m, atol=1e-6)
    assert plan.name == "Isar"
    assert np.ptp(plan.river.level_m) == 0


def test_widths_come_from_extended_data_and_from_packed_tags(tmp_path):
    for name in ("river.kml", "ogr.geojson"):
        (tmp_path / name).write_text(FORMATS[name])
        assert (planned(tmp_path / name).river.width_m == 12).all()


def test_altitudes_of_kml_count_only_if_they_are_absolute(tmp_path):
    places = " ".join(f"{x!r},{y!r},{500 - index}" for index, (x, y) in enumerate(PLACES))
    mode = "<altitudeMode>absolute</altitudeMode>"
    (tmp_path / "a.kml").write_text(KML.format(KML_LINE.format(data=WIDTH, mode=mode, places=places)))
    assert np.ptp(planned(tmp_path / "a.kml").river.level_m) == pytest.approx(4)
    for name in ("", "clampToGround", "relativeToGround", "relativeToSeaFloor"):
        mode = f"<altitudeMode>{name}</altitudeMode>" if name else ""
        (tmp_path / "a.kml").write_text(KML.format(KML_LINE.format(data=WIDTH, mode=mode, places=places)))
        assert np.ptp(planned(tmp_path / "a.kml").river.level_m) == 0


def test_elevations_of_gpx_count(tmp_path):
    points = "".join(f'<trkpt lon="{x!r}" lat="{y!r}"><ele>{500 - i}</ele></trkpt>' for i, (x, y) in enumerate(PLACES))
    (tmp_path / "a.gpx").write_text(GPX.format(f"<trk><trkseg>{points}</trkseg></trk>"))
    assert np.ptp(planned(tmp_path / "a.gpx", width_m=9.0).river.level_m) == pytest.approx(4)
    assert np.ptp(planned(tmp_path / "a.gpx", width_m=9.0, flat_water=True).river.level_m) == 0


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1", "windows-1252"])
def test_text_may_be_in_the_encoding_that_it_declares(tmp_path, encoding):
    named = GPX.format(track(PLACES, "Bäche"))
    declared = f'<?xml version="1.0" encoding="{encoding.removesuffix("-sig")}"?>'
    (tmp_path / "a.gpx").write_bytes(f"{declared}\n{named}".encode(encoding))
    assert planned(tmp_path / "a.gpx", width_m=9.0).name == "Bäche"
    if encoding.startswith("utf"):
        feature = FORMATS["nested.geojson"].replace("Isar", "Bäche")
        (tmp_path / "a.geojson").write_bytes(feature.encode(encoding))
        assert planned(tmp_path / "a.geojson", width_m=9.0).name == "Bäche"


OUTER = from_metres([(0, -8), (200, -8), (200, 8), (0, 8)])
INNER = from_metres([(60, 1), (70, 1), (70, 4), (60, 4), (60, 1)])


def member(places, role: str, number: int) -> dict:
    return {"type": "way", "ref": number, "role": role, "geometry": [{"lon": x, "lat": y} for x, y in places]}


def test_a_multipolygon_of_overpass_is_assembled_from_its_ways(tmp_path):
    relation = {
        "type": "relation",
        "id": 9,
        "tags": {"type": "multipolygon", "natural": "water", "water": "river"},
        "members": [
            member(OUTER[:2], "outer", 1),
            member([OUTER[0], OUTER[3], OUTER[2]], "outer", 2),
            member(OUTER[1:3], "outer", 3),
            member(INNER, "inner", 4),
        ],
    }
    (tmp_path / "a.json").write_text(overpass(relation))
    plan = planned(tmp_path / "a.json")
    assert plan.river.length_m == pytest.approx(200, abs=0.05)
    np.testing.assert_allclose(plan.river.width_m, 16, atol=0.02)
    assert len(plan.solids.islands) == 1
    relation["members"].pop(1)
    (tmp_path / "open.json").write_text(overpass(relation))
    with pytest.raises(WorldFileError, match=r"relation/9: a ring of the multipolygon is open at \[11\.0"):
        planned(tmp_path / "open.json")


def test_each_hole_of_a_multipolygon_belongs_to_the_ring_around_it():
    def square(x: float, size: float) -> list:
        return from_metres([(x, 0), (x + size, 0), (x + size, size), (x, size), (x, 0)])

    corners = [(0, 0), (5, 0), (5, 5), (0, 5), (0, 0)]
    rings = {"outer": (0, 100, 200), "inner": (110, 120, 10)}
    members = [member(square(x, 50), "outer", 1) for x in rings["outer"]]
    members += [member(from_metres([(x + dx, 20 + dy) for dx, dy in corners]), "inner", 2) for x in rings["inner"]]
    relation = {"type": "relation", "id": 9, "tags": {"type": "multipolygon"}, "members": members}
    found = [feature.rings for feature in overpass_features({"elements": [relation]}).features]
    assert [len(each) for each in found] == [2, 3, 1]
    expected = [[10], [110, 120], []]
    for each, holes in zip(found, expected, strict=True):
        west = [from_metres([(x, 20)])[0][0] for x in holes]
        assert [hole[:, 0].min() for hole in each[1:]] == pytest.approx(west)


def test_closed_ways_of_overpass_are_areas_if_their_tags_are(tmp_path):
    banks = way([*OUTER, OUTER[0]], 1, natural="water", water="river")
    islet = way(INNER, 2, place="islet")
    (tmp_path / "a.json").write_text(overpass(banks, islet))
    assert len(planned(tmp_path / "a.json").solids.islands) == 1


BOMB = "<!DOCTYPE b [" + "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 9}">' for i in range(9)) + ']><gpx a="&e9;"/>'
BAD = {
    "bomb.gpx": (BOMB, "its XML has a document type or entities, .*: refused"),
    "external.kml": ('<!DOCTYPE k SYSTEM "file:///etc/passwd"><kml/>', "its XML has a document type or entities"),
    "bomb16.kml": (BOMB.encode("utf-16"), "its XML has a document type or entities"),
    "broken.gpx": ("<gpx><trk>", "not XML: no element found"),
    "other.xml": ("<svg/>", r"XML of the kind <svg>; expected GeoJSON, Overpass JSON, GPX or KML$"),
    "map.osm": ("<osm version='0.6'/>", r"convert it with osmtogeojson river.osm > river.geojson"),
    "empty.gpx": (GPX.format(""), "no water way in it: it is empty"),
    "point.gpx": (GPX.format('<wpt lon="1" lat="2"/>'), "no water way in it, but 1 waypoint"),
    "short.gpx": (GPX.format(track(PLACES[:1])), "segment 0 of track Isar is a line of 1 positions; at least 2"),
    "words.gpx": (GPX.format('<trk><trkseg><trkpt lon="east" lat="1"/></trkseg></trk>'), "not GPX"),
    "far.gpx": (GPX.format(track([(11, 48), (11, 148)])), r"position 1 of segment 0 .* is \[11, 148\], which is no"),
    "words.kml": (KML.format(KML_LINE.format(data="", mode="", places="11,48 east,3")), 'Isar: "east,3" is no'),
    "none.kml": (KML.format(KML_LINE.format(data="", mode="", places="")), "placemark Isar has no coordinates"),
    "ids.json": (json.dumps({"elements": [{"type": "way", "id": 4, "nodes": [1]}]}), "way/4 has no geometry: end the"),
    "cut.json": (
        json.dumps({"elements": [], "remark": "runtime error: Query timed out in \"query\" at line 3"}),
        "the Overpass server gave up, so that parts are missing: .*timed out",
    ),
    "box.json": (
        overpass({"type": "way", "id": 7, "geometry": [{"lon": 1, "lat": 2}, None, {"lon": 1.1, "lat": 2}]}),
        r"way/7 leaves the query's box and comes back: end the query with `out geom;`, without a box",
    ),
    "what.json": (json.dumps({"elements": [3]}), "not Overpass JSON: 3 stands where an element is expected"),
    "empty.json": ("  \n", "the file is empty; expected GeoJSON, Overpass JSON, GPX or KML"),
    "db.gpkg": (b"SQLite format 3\x00...", r"a database, such as a GeoPackage: convert it with ogr2ogr .* db\.gpkg"),
    "a.shp": (b"\x00\x00\x27\x0a....", r"a shapefile: convert it with ogr2ogr -f GeoJSON river.geojson a\.shp"),
    "noise.geojson": (b"\x80\x81", r"not text in UTF-8 \(byte 0\)"),
    "deep.geojson": ('{"type": "GeometryCollection", "geometries": [' * 3000, "nested too deep"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_is_not_a_river_is_refused_with_what_would_be_right(tmp_path, name):
    content, message = BAD[name]
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(WorldFileError, match=message) as raised:
        planned(path, width_m=9.0)
    assert str(raised.value).startswith(f"{path}: ")


def test_a_zip_archive_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.kmz", "w") as archive:
        archive.writestr("doc.kml", "<kml/>")
    with pytest.raises(WorldFileError, match="a zip archive, such as KMZ or a zipped shapefile: unpack it first"):
        planned(tmp_path / "a.kmz")


def test_a_system_is_for_geojson_only(tmp_path):
    (tmp_path / "a.gpx").write_text(FORMATS["river.gpx"])
    with pytest.raises(WorldFileError, match=r"crs='EPSG:3857' goes with GeoJSON; GPX, KML and Overpass JSON are in"):
        planned(tmp_path / "a.gpx", crs="EPSG:3857")


def test_files_that_are_too_large_are_refused(tmp_path):
    (tmp_path / "a.kml").write_bytes(b"<kml>" + b" " * 16_000_001 + b"</kml>")
    with pytest.raises(WorldFileError, match=r"16 MB of XML; limit 16 MB: keep only the river"):
        planned(tmp_path / "a.kml")
    many = "[11, 48]," * MAX_POSITIONS
    (tmp_path / "a.geojson").write_text(f'{{"type": "LineString", "coordinates": [{many}[11, 48.1]]}}')
    with pytest.raises(
        WorldFileError, match=r"more than 500000 positions: keep only the river, its bridges and islands"
    ):
        planned(tmp_path / "a.geojson")
    with (tmp_path / "b.geojson").open("wb") as file:
        file.truncate(300_000_000)
    with pytest.raises(WorldFileError, match="300 MB; limit 64 MB"):
        planned(tmp_path / "b.geojson")
