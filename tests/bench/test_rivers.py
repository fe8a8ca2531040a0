"""The real place of a suite, with its course exchanged for one made by hand."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.env import handmade
from thalweg.bench import film
from thalweg.bench.evaluation import Course
from thalweg.bench.files import ResultsError
from thalweg.bench.river import Rivers
from thalweg.bench.suites import Arm, Run, Suite
from thalweg.env import sample_starts

SUITE = Suite(
    "tiny", (Arm("PPO", seeds=(0,), steps=512),), train_level="Easy", test_levels=("Easy",), episodes=4, packaged=False
)
RUN = Run("baseline", "random", 0)


@pytest.fixture
def rivers(monkeypatch: pytest.MonkeyPatch) -> Rivers:
    ring = handmade.ring()
    course = Course(ring, sample_starts(ring, 4, 0), np.zeros(4), np.arange(4))
    monkeypatch.setattr(Course, "of_level", classmethod(lambda *_: course))
    return Rivers(SUITE)


def test_the_film_shows_the_very_flight_of_its_row(rivers: Rivers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    filmed: list[Any] = []
    monkeypatch.setattr(film, "write_film", lambda path, world, flight, title, **_: filmed.append(flight))
    row = rivers.evaluate(RUN, tmp_path, "Easy", lambda _: None)[2]
    rivers.film(RUN, tmp_path, row, tmp_path / "film.mp4", lambda: None)
    (flight,) = filmed
    assert flight.episode == row
    assert len(flight.poses) == row.length
    np.testing.assert_array_equal(flight.poses[0], [row.x, row.y, row.z, row.yaw])


@pytest.mark.parametrize(("field", "value"), [("return_", 9.75), ("length", 499), ("reason", "Success"), ("x", 1.0)])
def test_a_flight_that_ends_otherwise_than_its_row_is_not_filmed(
    rivers: Rivers, tmp_path: Path, field: str, value: Any
):
    row = rivers.evaluate(RUN, tmp_path, "Easy", lambda _: None)[1]
    other = replace(row, **{field: value})
    with pytest.raises(ResultsError, match=f"{field.rstrip('_')} .*{value!r} in the results"):
        rivers.film(RUN, tmp_path, other, tmp_path / "film.mp4", lambda: None)
    assert list(tmp_path.iterdir()) == []
