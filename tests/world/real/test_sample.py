"""The sample of docs/your-river.md: what the reader says of an answer of Overpass with ways, banks, bridges and an
island."""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.world.real.drawn_files import from_metres
from thalweg.world import Reach

pytest.importorskip("shapely")
pytest.importorskip("pyproj")

PAGE = Path(__file__).resolve().parents[3] / "docs" / "your-river.md"
WATER = {"waterway": "river", "name": "River Cam"}


def element(number: int, metres, **tags: str) -> dict:
    places = [{"lon": x, "lat": y} for x, y in from_metres(metres)]
    return {"type": "way", "id": number, "tags": tags, "geometry": places}


def answer() -> dict:
    """An answer of Overpass about 600 m of a river: seven ways, two of them drawn upstream, an area, three bridges and
    an islet."""
    x = np.arange(0.0, 601.0, 5.0)
    middle = np.column_stack([x, 14.0 * np.sin(x / 70.0)])
    half = 0.5 * (13.0 + 4.0 * np.sin(x / 90.0))
    across = np.column_stack([-np.gradient(middle[:, 1], x), np.ones(len(x))])
    across *= (half / np.hypot(*across.T))[:, None]
    banks = np.concatenate([middle + across, (middle - across)[::-1], (middle + across)[:1]])
    cuts = [0, 15, 30, 52, 70, 85, 104, 121]
    parts = [middle[max(first - 1, 0) : last] for first, last in itertools.pairwise(cuts)]
    ways = [element(number, part[::-1] if number in (2, 5) else part, **WATER) for number, part in enumerate(parts)]
    bridges = [
        element(20 + at, [middle[at] + (0, -30), middle[at] + (0, 30)], highway="footway", bridge="yes")
        for at in (20, 60, 100)
    ]
    turn = np.linspace(0.0, 2 * np.pi, 13)
    islet = middle[40] + np.column_stack([5.0 * np.cos(turn), 1.5 * np.sin(turn)])
    islet[-1] = islet[0]
    area = element(10, banks, natural="water", water="river")
    return {"version": 0.6, "elements": [*ways, area, *bridges, element(11, islet, place="islet")]}


def test_the_page_shows_what_the_command_says_of_a_file(tmp_path: Path):
    path = tmp_path / "cam.json"
    path.write_text(json.dumps(answer()))
    told = re.search(
        r"says what it did.*?```text\n(.*?)```\n\nWith `--banks (\S+)` it adds `(.*?)`", PAGE.read_text(), re.S
    )
    assert told is not None
    shown, banks, added = told.groups()
    for lines, reach in ((shown, Reach(path)), (shown + added, Reach(path, banks=banks))):
        assert lines.splitlines() == [f"{path.name}: {note}" for note in reach.notes()]
