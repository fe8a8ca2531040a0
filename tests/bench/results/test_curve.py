"""Tests of the curve of a run: what it holds, and that all figures of training come out as from the episodes."""

from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.results.curve import COLUMNS, CURVE, EPISODES, read_training, training_file, write_curve
from thalweg.bench.results.results import RunRow
from thalweg.bench.results.statistics import regret, running_mean, training_curve

RUN = RunRow("PPO-0", "train", "PPO", 0, 1000, "finished", "", 1.0, 1000.0)
COUNT = 130
"""Episodes: two blocks of 50, and one of 30."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run's folder with episodes of which every other one costs: in turns a tight 1, a loose 0.5, and something of
    another kind."""
    rows = []
    for index in range(COUNT):
        tight, loose = float(index % 6 == 0), 0.5 * (index % 6 == 2)
        rows.append((7 * (index + 1), 0.1 * index, tight + loose + 0.25 * (index % 6 == 4), tight, loose))
    text = "step,return,cost,tight,loose\n" + "".join(f"{','.join(map(str, row))}\n" for row in rows)
    (tmp_path / EPISODES).write_text(text)
    return tmp_path


def packed(folder: Path) -> Path:
    write_curve(folder, RUN)
    (folder / EPISODES).unlink()
    return training_file(folder)


def test_a_block_has_the_means_of_its_episodes_and_the_numbers_of_violations(folder: Path):
    """In episodes 100 to 129 five of thirty are tight, and five loose: 5 x 1, 5 x 0.5, 5 x 0.25 of cost."""
    header, *rows = packed(folder).read_text().splitlines()
    assert header == ",".join(COLUMNS) and len(rows) == 3
    step, episodes, return_, cost, tight, loose, *violations = map(float, rows[-1].split(","))
    assert (step, episodes) == (7 * 130, 30) and violations == [10, 5, 5]
    assert [return_, cost, tight, loose] == pytest.approx([11.45, 8.75 / 30, 5 / 30, 2.5 / 30])


def test_figures_of_training_are_those_of_the_episodes_at_the_ends_of_blocks(folder: Path):
    single = read_training(folder / EPISODES, RUN)
    blocks = read_training(packed(folder), RUN)
    ends = np.array([7 * 50, 7 * 100])
    there, here = (astuple(training_curve(log, ends)) for log in (single, blocks))
    np.testing.assert_allclose(np.stack(here), np.stack(there), rtol=1e-12)
    np.testing.assert_allclose(running_mean(blocks, blocks.cost, ends), running_mean(single, single.cost, ends))
    for limit in (0.0, 0.2, 0.29, 1.0):
        assert regret(blocks, limit) == pytest.approx(regret(single, limit), rel=1e-12)


def test_a_short_last_block_is_read_together_with_the_one_before(folder: Path):
    blocks = read_training(packed(folder), RUN)
    assert running_mean(blocks, blocks.return_, np.array([910.0]))[0] == pytest.approx(0.1 * np.arange(50, 130).mean())


def test_episodes_come_before_the_curve_and_an_old_curve_stays(folder: Path):
    write_curve(folder, RUN)
    before = (folder / CURVE).read_bytes()
    assert training_file(folder).name == EPISODES
    (folder / EPISODES).write_text("step,return,tight,loose\n")
    write_curve(folder, RUN)
    assert (folder / CURVE).read_bytes() == before


def test_no_episodes_make_an_empty_curve(tmp_path: Path):
    (tmp_path / EPISODES).write_text("step,return,cost,tight,loose\n")
    log = read_training(packed(tmp_path), RUN)
    assert len(log.step) == 0 and np.isnan(regret(log, 0.1))
    assert np.isnan(training_curve(log, np.array([10.0])).return_[0])


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("10,0,1.0,0.0,0.0,0.0,0,0,0", "episodes must be a whole number from 1"),
        ("10,5,1.0,0.0,0.0,0.0,0.5,0,0", "violations must be a whole number from 0"),
        ("10,5,1.0,inf,0.0,0.0,0,0,0", "a finite number is needed, got 'inf'"),
        ("10,5,1.0,0.0,0.0,0.0,0,6,0", "line 2 has more violations than episodes"),
    ],
)
def test_numbers_that_no_block_can_have_are_named(row: str, words: str, tmp_path: Path):
    path = tmp_path / CURVE
    path.write_text(f"{','.join(COLUMNS)}\n{row}\n")
    with pytest.raises(ResultsError, match=rf"curve\.csv:? {words}"):
        read_training(path, RUN)
