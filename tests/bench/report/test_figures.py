"""Tests of the figures: which curves, bands and bars they draw."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from thalweg.bench.evaluate.episodes import REASON_TEXT, REASONS
from thalweg.bench.report.figures import COLOURS, MOST_TOGETHER, PANELS, failure_bars, line_style, pdf, training_curves
from thalweg.bench.results.reading import read_results


def test_every_panel_has_a_curve_for_each_algorithm_and_a_band_over_seeds(tiny_results: Path):
    runs = tiny_results / "runs.csv"
    runs.write_text(runs.read_text() + "FOCOPS-0,train,FOCOPS,0,400,finished,,1.0,400.0\n")
    (tiny_results / "runs" / "FOCOPS-0").mkdir()
    (tiny_results / "runs" / "FOCOPS-0" / "episodes.csv").write_text("step,return,tight,loose\n400,7.0,0.0,0.0\n")
    figure = training_curves(read_results(tiny_results))
    assert figure is not None
    assert len(figure.axes) == len(PANELS)
    for axis in figure.axes:
        assert [line.get_label() for line in axis.lines] == ["PPO (2 seeds, 1 of them failed)", "FOCOPS (1 seed)"]
        assert len(axis.collections) == 1  # the band of PPO
        assert axis.get_legend() is None
    assert len(figure.legends) == 1


def test_a_run_that_failed_before_its_first_episode_is_missing_and_not_one_of_those_drawn(tiny_results: Path):
    suite, runs = tiny_results / "suite.json", tiny_results / "runs.csv"
    suite.write_text(suite.read_text().replace('"seeds": [0, 1]', '"seeds": [0, 1, 2]'))
    runs.write_text(runs.read_text() + "PPO-2,train,PPO,2,0,failed,no encoder,1.0,0.0\n")
    figure = training_curves(read_results(tiny_results))
    assert figure is not None
    assert figure.axes[0].lines[0].get_label() == "PPO (2 of 3 seeds, 1 of them failed)"
    runs.write_text(runs.read_text().replace("300,failed", "300,finished"))
    figure = training_curves(read_results(tiny_results))
    assert figure is not None and figure.axes[0].lines[0].get_label() == "PPO (2 of 3 seeds)"


def test_the_curve_of_a_last_stage_ends_where_it_ends(tiny_results: Path):
    """Both stages together are as long as the axis; the last one has 100 of 400 steps."""
    suite = tiny_results / "suite.json"
    arm = {"name": "PPO", "algorithm": "PPO", "seeds": [0, 1], "steps": 100}
    arm["before"] = [{"algorithm": "PPO", "level": "Easy", "steps": 300}]
    whole = {"name": "FOCOPS", "algorithm": "FOCOPS", "seeds": [0], "steps": 400}
    suite.write_text(json.dumps(json.loads(suite.read_text()) | {"arms": [arm, whole]}))
    (tiny_results / "runs" / "PPO-0" / "episodes.csv").write_text("step,return,tight,loose\n60,2.0,1.0,0.0\n")
    (tiny_results / "runs" / "PPO-1" / "episodes.csv").unlink()
    (log,) = read_results(tiny_results).training
    assert log.last_step == 100
    figure = training_curves(read_results(tiny_results))
    assert figure is not None
    curve = np.asarray(figure.axes[0].lines[0].get_ydata())
    assert curve[49] == 2.0 and np.isnan(curve[50:]).all()  # of 200 points up to 400 steps


def test_many_policies_have_a_row_each_with_the_others_in_grey(tiny_results: Path):
    results = read_results(tiny_results)
    (first, *_) = results.training
    names = [f"P{number}" for number in range(MOST_TOGETHER + 1)]
    figure = training_curves(replace(results, training=[replace(first, algorithm=name) for name in names]))
    assert figure is not None
    panels = np.reshape(np.array(figure.axes, dtype=object), (len(names), len(PANELS)))
    assert [row[0].get_ylabel() for row in panels] == [f"{name}\n(1 seed)" for name in names]
    for row, name in zip(panels, names, strict=True):
        for axis in row:
            *others, own = axis.lines
            assert len(others) == len(names) and own.get_label() == name
            assert own.get_color() == COLOURS[0] and {line.get_color() for line in others} == {"#c9cdd1"}
            assert axis.get_ylim() == panels[0][list(row).index(axis)].get_ylim()


def test_the_first_twenty_policies_have_lines_of_their_own():
    assert len({tuple(line_style(index).values()) for index in range(20)}) == 20


def test_the_curves_end_at_values_computed_by_hand(tiny_results: Path):
    figure = training_curves(read_results(tiny_results))
    assert figure is not None
    lines = [np.asarray(axis.lines[0].get_ydata()) for axis in figure.axes]
    # At 300 steps: returns 1, 3, 5 and two violations of seed 0; return 2 and one violation of seed 1, which failed.
    third = [line[149] for line in lines]
    np.testing.assert_allclose(third, [2.5, (2 / 300 + 1 / 300) / 2, 1 / 300, (1 / 300 + 0) / 2])
    np.testing.assert_allclose([line[-1] for line in lines], [3, 2 / 400, 1 / 400, 1 / 400])  # of seed 0 alone


def test_the_bars_of_a_policy_fill_its_row(tiny_results: Path):
    figure = failure_bars(read_results(tiny_results))
    easy, medium = figure.axes
    assert (easy.get_title(), medium.get_title()) == ("Easy", "Medium")
    shares = {bars.get_label(): [bar.get_width() for bar in bars] for bars in easy.containers}
    assert list(shares) == [REASON_TEXT[reason] for reason in REASONS]
    assert list(shares)[1:4] == ["left the river", "too low or high", "faced backwards"]
    assert shares["idle"] == [1, 0]
    assert shares["success"] == [0, 0.5]
    assert np.sum(list(shares.values()), axis=0) == pytest.approx([1, 1])


def test_a_gap_among_the_bars_is_named(tiny_results: Path):
    runs = tiny_results / "runs.csv"
    runs.write_text(runs.read_text() + "FOCOPS-0,train,FOCOPS,0,90,failed,NaN,1.0,90.0\n")
    figure = failure_bars(read_results(tiny_results))
    easy, medium = figure.axes
    assert [label.get_text() for label in easy.get_yticklabels()] == ["hover", "PPO", "FOCOPS"]
    assert [(words.get_position()[1], words.get_text()) for words in easy.texts] == [(1, "1 of 2 seeds"), (2, "failed")]
    assert [words.get_text() for words in medium.texts] == ["missing", "1 of 2 seeds", "failed"]
    widths = np.array([[bar.get_width() for bar in bars] for bars in medium.containers])
    np.testing.assert_allclose(widths.sum(axis=0), [0, 1, 0])


def test_numbers_of_steps_do_not_run_into_one_another(tiny_results: Path):
    suite = tiny_results / "suite.json"
    suite.write_text(suite.read_text().replace('"steps": 400', '"steps": 200000'))
    figure = training_curves(read_results(tiny_results))
    assert figure is not None
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in figure.axes[2].get_xticklabels()]
    assert len(boxes) > 2
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_a_figure_as_pdf_is_the_same_each_time_and_keeps_its_letters_as_fonts(tiny_results: Path):
    results = read_results(tiny_results)
    once, again = (pdf(failure_bars(results)) for _ in range(2))
    assert once[:5] == b"%PDF-"
    assert once == again and b"CreationDate" not in once
    assert b"/TrueType" in once or b"/CIDFontType2" in once
    assert b"/Type3" not in once
