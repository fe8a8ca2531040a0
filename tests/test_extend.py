"""The algorithm of docs/extend.md, installed and given as a file, comes to a row of results."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.plugins import EXAMPLE, install
from thalweg.bench.evaluate.episodes import read_episodes
from thalweg.bench.results.run_versions import read_sources, read_versions

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "extend.md").read_text()
SUITE = """
arms: [{algorithm: PricedPG, seeds: [0], steps: 2048, settings: {steps_per_update: 512}}]
train_level: Easy
test_levels: [Easy]
episodes: 2
baselines: []
packaged: false
observation: privileged
film: false
"""


def thalweg(*words: str, cwd: Path, path: str = "") -> subprocess.CompletedProcess:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), path])), "THALWEG_PLUGINS": ""}
    command = [sys.executable, "-m", "thalweg", *words]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def test_the_example_is_as_long_as_its_page_says():
    assert "in 60 lines" in PAGE
    assert len(EXAMPLE.read_text().splitlines()) == 60


@pytest.mark.slow
def test_the_example_is_installed_and_comes_to_a_row(tmp_path: Path):
    installed = tmp_path / "site"
    (points,) = re.findall(r'\[project.entry-points."thalweg.algorithms"\]\nPricedPG = "(.*)"', PAGE)
    install(installed, {"thalweg.algorithms": {"PricedPG": points}}, name="my-algorithm")
    shutil.copy(EXAMPLE, installed)
    (tmp_path / "mine.yaml").write_text(SUITE)
    done = thalweg("bench", "mine.yaml", "--out", "results", "--jobs", "2", cwd=tmp_path, path=str(installed))
    assert done.returncode == 0, done.stdout + done.stderr
    results = tmp_path / "results"
    rows = read_episodes(results / "evaluation" / "PricedPG-0-Easy.csv")
    source = read_sources(results)["PricedPG-0"]["PricedPG"]
    assert [(row.algorithm, row.version, row.source) for row in rows] == [("PricedPG", 1, source)] * 2
    assert read_versions(results)["PricedPG-0"]["PricedPG"] == 1
    assert f"PricedPG 1 ({source})" in (results / "report" / "methods.md").read_text()
    assert "PricedPG" in done.stdout

    board = thalweg("leaderboard", "results", cwd=tmp_path, path=str(installed))
    shown = rf"\| PricedPG \(privileged\) \| results \|.*\| current; PricedPG 1 \({source}\) \| 3 seeds"
    assert re.search(shown, board.stdout), board.stdout
    again = thalweg("report", "results", cwd=tmp_path)  # without the plug-in
    assert again.returncode == 0 and "Note:   Not compared: PricedPG is a plug-in that is not here" in again.stderr
    flown = thalweg(
        *("evaluate", "results/runs/PricedPG-0", "--levels", "easy", "--episodes", "1", "--out", "rows.csv"),
        cwd=tmp_path,
    )
    assert flown.returncode == 0, flown.stderr
    assert [(row.version, row.source) for row in read_episodes(tmp_path / "rows.csv")] == [(1, source)]


@pytest.mark.slow
def test_the_example_is_trained_from_its_file(tmp_path: Path):
    words = ("--observation", "privileged", "--level", "easy", "--steps", "2048", "--set", "price=1.5", "--out", "run")
    done = thalweg("train", "PricedPG", "--plugin", str(EXAMPLE), *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "run: PricedPG, 2,048 steps" in done.stdout
    assert "price: 1.5" in (tmp_path / "run" / "config.yaml").read_text()
