"""Tests of the file to which `thalweg oracle` adds its points."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from thalweg.bench.fronts.fronts import FIXED, FrontPoint, read_fronts
from thalweg.cli.oracle import FlyOracle
from thalweg.core import versions


def test_commands_that_add_to_one_file_at_once_lose_no_point(tmp_path: Path):
    out, levels = tmp_path / "fronts.csv", ("Easy", "Medium", "Hard")

    def add(level: str) -> None:
        command, points = FlyOracle(tasks=("Swimmers",), levels=(level,), out=out), {}
        for price in map(float, range(10)):
            points[price] = FrontPoint("Swimmers", level, FIXED, price, 100, 1, 1, 1, 1, 1, 1, versions.TASKS)
            command._keep(points)

    with ThreadPoolExecutor(len(levels)) as pool:
        list(pool.map(add, levels))
    found = [(point.level, point.price) for point in read_fronts(out)]
    assert sorted(found) == sorted((level, float(price)) for level in levels for price in range(10))


@pytest.mark.parametrize("unseen", [False, True])
def test_fronts_are_flown_on_the_rivers_that_are_asked_for(unseen: bool, monkeypatch: pytest.MonkeyPatch):
    told: list[bool] = []
    monkeypatch.setattr(
        "thalweg.bench.fronts.flights.front_points", lambda *_, unseen, prices: told.append(unseen) or iter(())
    )
    with pytest.raises(StopIteration):
        FlyOracle(tasks=("Swimmers",), levels=("Easy",), unseen=unseen)._fly("Swimmers", "Easy")
    assert told == [unseen]
