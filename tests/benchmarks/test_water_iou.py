"""The benchmark of the finder of water: its figures by hand, and its page."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    return importlib.import_module("water_iou")


def masks(*counts: int) -> np.ndarray:
    """Masks [K, 10, 10] whose first pixels, so many each, are water."""
    return np.array([np.arange(100).reshape(10, 10) < count for count in counts])


def test_figures_are_means_of_frames_and_that_of_all_pixels(script: ModuleType):
    found = script.figures_of(masks(40, 8, 2), masks(80, 2, 2))  # of which only the first has some water
    assert found == pytest.approx(
        {"mean_iou": (0.5 + 0.25 + 1.0) / 3, "mean_iou_some_water": 0.5, "pixels_iou": (40 + 2 + 2) / (80 + 8 + 2)}
    )


def test_the_page_shows_rows_of_todays_segmenter_alone(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    page, out, segmenter = tmp_path / "page.md", tmp_path / "iou.csv", tmp_path / "mine.safetensors"
    segmenter.write_bytes(b"one")
    page.write_text("<!-- water -->\n<!-- /water -->\n")
    monkeypatch.setattr(script, "PAGE", page)
    figures = {"mean_iou": "0.5", "mean_iou_some_water": "0.25", "pixels_iou": "0.75"}
    row = script.made_with(segmenter) | {"level": "Easy", "suns": "own", "frames": "200"} | figures
    other = row | {"suns": "others", "mean_iou_some_water": "0.1"}
    lines = ([each[name] for name in script.COLUMNS] for each in (row, other))
    out.write_text(script.csv_text(script.COLUMNS, lines))
    monkeypatch.setattr(sys, "argv", ["water_iou.py", "--write", "--out", str(out), "--segmenter", str(segmenter)])
    for content, shown in (
        (b"one", "| IoU of frames with at least 5% of water | 0.25 / 0.10 |"),
        (b"two", "Nothing was"),
    ):
        segmenter.write_bytes(content)
        script.main()
        assert shown in page.read_text()
