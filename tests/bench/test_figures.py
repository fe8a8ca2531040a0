from pathlib import Path

import numpy as np
import pytest

from thalweg.bench.episodes import REASONS
from thalweg.bench.figures import PANELS, failure_bars, training_curves
from thalweg.bench.results import read_results


def test_every_panel_has_a_curve_for_each_algorithm_and_a_band_over_seeds(tiny_results: Path):
    runs = tiny_results / "runs.csv"
    runs.write_text(runs.read_text() + "FOCOPS-0,train,FOCOPS,0,400,finished,,1.0,400.0\n")
    (tiny_results / "runs" / "FOCOPS-0").mkdir()
    (tiny_results / "runs" / "FOCOPS-0" / "episodes.csv").write_text("step,return,tight,loose\n400,7.0,0.0,0.0\n")
    figure = training_curves(read_results(tiny_results))
    assert figure is not None
    assert len(figure.axes) == len(PANELS)
    for axis in figure.axes:
        assert [line.get_label() for line in axis.lines] == ["PPO (2 seeds)", "FOCOPS (1 seed)"]
        assert len(axis.collections) == 1  # the band of PPO


def test_the_curves_end_at_values_computed_by_hand(tiny_results: Path):
    figure = training_curves(read_results(tiny_results))
    assert figure is not None
    last = [np.asarray(axis.lines[0].get_ydata())[-1] for axis in figure.axes]
    # Seed 0: returns 1, 3, 5 and two violations in 400 steps; seed 1: return 2 and one violation.
    np.testing.assert_allclose(last, [2.5, (2 / 400 + 1 / 400) / 2, 1 / 400, (1 / 400 + 0) / 2])


def test_the_bars_of_a_policy_fill_its_row(tiny_results: Path):
    figure = failure_bars(read_results(tiny_results))
    easy, medium = figure.axes
    assert (easy.get_title(), medium.get_title()) == ("Easy", "Medium")
    shares = {bars.get_label(): [bar.get_width() for bar in bars] for bars in easy.containers}
    assert list(shares) == list(REASONS)
    assert shares["Idle"] == [1, 0]
    assert shares["Success"] == [0, 0.5]
    assert np.sum(list(shares.values()), axis=0) == pytest.approx([1, 1])
    assert [len(bars) for bars in medium.containers] == [1] * len(REASONS)  # only PPO flew there
