"""Whatever a file holds, it becomes a river or an error that names the file: random JSON and damaged files."""

import json
import random

import pytest

from tests.world.real.drawn_files import box, line, planned, polygon, straight, write
from tests.world.real.sources.test_reading import FORMATS
from thalweg.world import WorldFileError

pytest.importorskip("gpxpy")
pytest.importorskip("shapely")

WRONG = (None, True, -1, 1e308, "", "x", [], {}, [[]], {"type": "Point"}, [11.0], [11.0, "48"], float("inf"), "Feature")
"""Values that are put in place of others."""


def replaced(value, generator: random.Random):
    """A copy of a JSON value in which one value somewhere is another one."""
    if isinstance(value, dict | list) and value and generator.random() < 0.9:
        copied = dict(value) if isinstance(value, dict) else list(value)
        keys = list(copied) if isinstance(copied, dict) else range(len(copied))
        key = generator.choice(list(keys))
        if generator.random() < 0.1:
            del copied[key]
        else:
            copied[key] = replaced(copied[key], generator)
        return copied
    return generator.choice(WRONG)


def is_refused_or_a_river(path) -> bool:
    """Whether a file is refused by name; raises whatever else it raises."""
    try:
        plan = planned(path, width_m=9.0)
    except WorldFileError as error:
        assert str(error).startswith(f"{path}: ")
        return True
    assert plan.river.length_m > 0
    return False


def test_a_file_with_one_wrong_value_is_a_river_or_refused_by_name(tmp_path):
    generator = random.Random(0)
    banks = polygon(box(0, -6, 200, 6), box(40, 1, 46, 3), natural="water")
    plain = write(tmp_path, banks, line(straight(), name="Isar", width="12"), line([(99, -20), (99, 20)], bridge="yes"))
    values = [
        json.loads(plain.read_text()),
        json.loads(FORMATS["overpass.json"]),
        json.loads(FORMATS["nested.geojson"]),
    ]
    path = tmp_path / "wrong.json"
    refused = 0
    for index in range(240):
        path.write_text(json.dumps(replaced(values[index % len(values)], generator)))
        refused += is_refused_or_a_river(path)
    assert 40 < refused < 240


@pytest.mark.parametrize("name", ["river.gpx", "river.kml", "overpass.json"])
def test_a_damaged_file_is_a_river_or_refused_by_name(tmp_path, name):
    generator = random.Random(1)
    content = FORMATS[name].encode()
    path = tmp_path / name
    refused = 0
    for _ in range(60):
        damaged = bytearray(content)
        for _ in range(generator.choice((1, 1, 5))):
            damaged[generator.randrange(len(damaged))] = generator.randrange(256)
        path.write_bytes(damaged[: generator.choice((len(damaged), generator.randrange(len(damaged))))])
        refused += is_refused_or_a_river(path)
    assert refused > 20
