"""Tests of benchmarks/gpu.py on the CPU."""

import sys
from pathlib import Path

import pytest

from benchmarks import gpu
from thalweg.bench.csv_files import read_csv
from thalweg.env.tasks import TASKS
from thalweg.world import World


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch, easy_world: World, tmp_path: Path) -> Path:
    """The script with little to do; where its table will be."""
    monkeypatch.setattr(gpu, "rivers", lambda count: [easy_world] * count)
    for name, value in {"SECONDS": 0.0, "REPEATS": 1}.items():
        monkeypatch.setattr(gpu, name, value)
    out = tmp_path / "gpu.csv"
    sizes = ["--cameras", "2", "--worlds", "1", "2", "--check", "2", "--check-steps", "40"]
    few = ["--set", "steps_per_update=8", "steps_per_collection=4", "random_steps=4", "samples=4", "elites=2"]
    monkeypatch.setattr(sys, "argv", ["gpu.py", "--device", "cpu", *sizes, *few, "--out", str(out)])
    return out


@pytest.mark.slow
def test_it_checks_and_times_everything(brief: Path):
    assert gpu.main() == 0
    rows = read_csv(brief, gpu.COLUMNS)
    checks = [(row["what"], row["quality"]) for row in rows if row["wanted"]]
    assert checks == [
        *[("pixels alike", "full"), ("masks alike", "full"), ("codes apart", "full")],
        *[("pixels alike", "fast"), ("masks alike", "fast"), ("steps alike", ""), ("poses apart", "")],
    ]
    assert {row["holds"] for row in rows if row["wanted"]} == {"yes"}
    for worlds in ("1", "2"):
        timed = [row for row in rows if not row["wanted"] and row["worlds"] == worlds]
        first = worlds == "1"
        flown = [f"fly {task}" for task in TASKS if first]
        trained = [f"train {name}" for name in (gpu.LEARNERS if first else gpu.LEARNERS[:1])]
        assert [row["what"] for row in timed] == ["render", "encode", "render", "step", *flown, *trained]
        assert all(float(row["figure"]) > 0 and row["cameras"] == "2" for row in timed)


@pytest.mark.slow
def test_a_failed_check_is_reported_and_sets_the_exit_status(brief: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gpu, "WITHIN", -1)
    assert gpu.main() == 1
    failed = [row["what"] for row in read_csv(brief, gpu.COLUMNS) if row["holds"] == "NO"]
    assert failed == ["pixels alike", "pixels alike"]


@pytest.mark.slow
def test_without_time_it_only_checks(brief: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--minutes", "0"])
    assert gpu.main() == 0
    assert all(row["wanted"] for row in read_csv(brief, gpu.COLUMNS))


def test_a_missing_gpu_is_an_error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr(sys, "argv", ["gpu.py", "--device", "cuda:99"])
    assert gpu.main() == 1 and "cuda:99" in capsys.readouterr().err
