"""Tests of the kills: what is compared and what is not, on a command that takes a moment."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from thalweg.bench.csv_files import csv_text, read_csv

PROGRAM = """
import sys, time
from pathlib import Path
folder = Path("run")
folder.mkdir(exist_ok=True)
log = folder / "episodes.csv"
done = log.read_text().splitlines() if log.exists() else []
for line in range(len(done), 6):
    until = time.process_time() + 0.02
    while time.process_time() < until:
        pass
    with open(log, "a") as file:
        file.write(f"{line},{line * FACTOR}\\n" if line else "step,return\\n")
if not (folder / "policy.safetensors").exists() or AGAIN:
    (folder / "policy.safetensors").write_bytes(b"policy")
time.sleep(0.3)
"""


@pytest.fixture
def kills(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("kills")


def program(kills: ModuleType, monkeypatch: pytest.MonkeyPatch, factor: str = "2", again: bool = False) -> None:
    """Let every command be the program above."""
    text = PROGRAM.replace("FACTOR", factor).replace("AGAIN", str(again))

    def start(name: str, folder: Path) -> subprocess.Popen:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "output.txt").touch()
        return subprocess.Popen([sys.executable, "-c", text], cwd=folder, process_group=0)

    monkeypatch.setattr(kills, "start", start)


def test_a_command_that_resumes_has_no_fault(kills: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    program(kills, monkeypatch)
    usual = kills.undisturbed("train", tmp_path / "undisturbed")
    assert usual.contents["episodes.csv"].splitlines()[-1] == "5,10"
    rows = list(kills.trial("train", 2, tmp_path / "trial", usual))
    assert rows and [row["kill"] for row in rows] == list(range(len(rows)))
    assert {row["faults"] for row in rows} == {0}
    assert not (tmp_path / "trial").exists()


def test_another_number_after_a_kill_is_a_fault(kills: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    program(kills, monkeypatch)
    usual = kills.undisturbed("train", tmp_path / "undisturbed")
    program(kills, monkeypatch, factor="3")
    (row, *_) = kills.trial("train", 0, tmp_path / "trial", usual)
    assert row["faults"] == 1 and row["first"] == "episodes.csv differs from that of the undisturbed run"
    assert (tmp_path / "trial").exists()


def test_what_was_finished_must_stay_the_same_file(kills: ModuleType, tmp_path: Path):
    policy = tmp_path / "runs" / "PPO-0" / "policy.safetensors"
    policy.parent.mkdir(parents=True)
    policy.write_bytes(b"policy")
    before = kills.lasting(tmp_path)
    assert list(before) == ["runs/PPO-0/policy.safetensors"]
    assert kills.lasting(tmp_path) == before
    policy.unlink()
    policy.write_bytes(b"policy")
    assert kills.lasting(tmp_path) != before


def write_checkpoints(folder: Path, *steps: int) -> None:
    for step in steps:
        (folder / "checkpoints" / f"{step:012d}").mkdir(parents=True, exist_ok=True)
        (folder / "checkpoints" / f"{step:012d}" / "state.json").write_text("{}")


def test_a_checkpoint_may_neither_be_lost_nor_written_again(kills: ModuleType, tmp_path: Path):
    write_checkpoints(tmp_path / "runs" / "a", 256, 512)
    before = kills.Secured.of(tmp_path)
    assert list(before.undone(kills.Secured.of(tmp_path))) == []
    write_checkpoints(tmp_path / "runs" / "a", 768)
    shutil.rmtree(tmp_path / "runs" / "a" / "checkpoints" / f"{256:012d}")  # the two newest are kept
    assert list(before.undone(kills.Secured.of(tmp_path))) == []
    (tmp_path / "runs" / "a" / "checkpoints" / f"{512:012d}" / "state.json").unlink()
    write_checkpoints(tmp_path / "runs" / "a", 512)
    assert list(before.undone(kills.Secured.of(tmp_path))) == ["checkpoint 512 of runs/a was written again"]
    shutil.rmtree(tmp_path / "runs" / "a" / "checkpoints")
    write_checkpoints(tmp_path / "runs" / "a", 128)
    lost = list(before.undone(kills.Secured.of(tmp_path)))
    assert lost == ["checkpoint 512 of runs/a is lost"]
    (tmp_path / "runs" / "a" / "policy.safetensors").write_text("")  # a finished run needs none
    assert list(before.undone(kills.Secured.of(tmp_path))) == []


def test_a_run_in_the_folder_itself_is_told_from_others(kills: ModuleType, tmp_path: Path):
    write_checkpoints(tmp_path, 512)
    before = kills.Secured.of(tmp_path)
    assert list(before.checkpoints) == ["."]
    shutil.rmtree(tmp_path / "checkpoints")
    assert list(before.undone(kills.Secured.of(tmp_path))) == ["checkpoint 512 of . is lost"]
    (tmp_path / "policy.safetensors").write_text("")
    assert list(before.undone(kills.Secured.of(tmp_path))) == []


def test_finished_epochs_of_an_encoder_may_not_be_lost(kills: ModuleType, tmp_path: Path):
    (tmp_path / "metrics.csv").write_text("epoch\n1\n2\n3\n")
    before = kills.Secured.of(tmp_path)
    (tmp_path / "metrics.csv").write_text("epoch\n1\n")
    assert list(before.undone(kills.Secured.of(tmp_path))) == ["3 epochs were finished, and 1 are now"]


def test_times_checkpoints_and_pictures_are_not_compared(kills: ModuleType, tmp_path: Path):
    (tmp_path / "metrics.csv").write_text("steps,seconds,return,time_act,steps_per_s\n1,2,3,4,5\n")
    (tmp_path / "status.json").write_text('{"seconds": 1.5, "steps": [1, {"time": 2}]}')
    changing = "checkpoints/1/state.json", "logs/a.txt", "report/page.html", "events.out.1", "checkpoint.safetensors"
    changing += "report/limits.md", "report/limits.tex", ".runs.f7e06d74783257f0.part.csv"
    for name in changing:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("changes")
    (tmp_path / "report" / "limits.csv").write_text("policy,minutes,cost\nPPO,5,1\n")
    assert kills.contents(tmp_path) == {
        "metrics.csv": "steps,return\n1,3",
        "report/limits.csv": "policy,cost\nPPO,1",
        "status.json": '{"steps": [1, {}]}',
    }


def test_the_newest_checkpoint_of_each_run_is_named(kills: ModuleType, tmp_path: Path):
    write_checkpoints(tmp_path / "runs" / "a", 256, 512)
    assert kills.newest_checkpoint(tmp_path) == "512"


def test_finished_trials_are_skipped(kills: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    tried: list[int] = []

    def trial(name: str, number: int, folder: Path, usual: object):
        tried.append(number)
        identity = dict(zip(kills.KEY, (name, number, 0), strict=True))
        left = {"after_s": "1.0", "finished": 0, "checkpoint": "", "faults": 0, "first": ""}
        yield identity | left | {"made_with": kills.MADE_BY[name]}

    monkeypatch.setattr(kills, "trial", trial)
    monkeypatch.setattr(kills, "undisturbed", lambda name, folder: None)
    command = ["kills.py", "--commands", "bench", "--kills", "2", "--out", str(tmp_path / "kills.csv")]
    monkeypatch.setattr("sys.argv", command)
    assert kills.main() == 0
    monkeypatch.setattr("sys.argv", [*command[:4], "3", *command[5:]])
    assert kills.main() == 0
    assert tried == [0, 1, 2]


def rows_of_trial(kills: ModuleType, *numbers: object, made_with: str | None = None, faults: int = 0) -> list[dict]:
    """Rows of the first trial of `bench`, a row for each kill."""
    left = {"after_s": "1.0", "finished": 0, "checkpoint": "", "faults": faults, "first": ""}
    rows = [dict(zip(kills.KEY, ("bench", 0, number), strict=True)) | left for number in numbers]
    return [row | {"made_with": made_with or kills.MADE_BY["bench"]} for row in rows]


def run_again(kills: ModuleType, monkeypatch: pytest.MonkeyPatch, table: Path, *before: dict) -> list[dict[str, str]]:
    """Run the first trial of `bench`, killed once, where a table has these rows; returns those it has then."""
    table.write_text(csv_text(list(before[0]), ([*row.values()] for row in before)))
    monkeypatch.setattr(kills, "trial", lambda *_: rows_of_trial(kills, 0))
    monkeypatch.setattr(kills, "undisturbed", lambda name, folder: None)
    monkeypatch.setattr("sys.argv", ["kills.py", "--commands", "bench", "--kills", "1", "--out", str(table)])
    assert kills.main() == 0
    return read_csv(table, kills.KEY)


def test_a_trial_that_is_run_again_replaces_all_of_its_rows(
    kills: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    failed = rows_of_trial(kills, 0, 1, faults=2)
    (row,) = run_again(kills, monkeypatch, tmp_path / "kills.csv", *failed)
    assert (row["kill"], row["faults"]) == ("0", "0")


def test_a_trial_of_other_versions_is_run_again(kills: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (row,) = run_again(kills, monkeypatch, tmp_path / "kills.csv", *rows_of_trial(kills, 0, made_with="PPO 0"))
    assert row["made_with"] == kills.MADE_BY["bench"]


def test_a_command_that_fails_before_it_is_killed_is_a_row_and_no_other_trial_begins(
    kills: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    ended = SimpleNamespace(returncode=3)
    monkeypatch.setattr(kills, "start", lambda *_: ended)
    monkeypatch.setattr(kills, "watch", lambda *_: (None, False))
    monkeypatch.setattr(kills, "finish", lambda *_: None)
    monkeypatch.setattr(kills, "undisturbed", lambda *_: kills.Undisturbed(0.1, 1.0, {}))
    table = tmp_path / "kills.csv"
    monkeypatch.setattr("sys.argv", ["kills.py", "--commands", "bench", "--kills", "9", "--out", str(table)])
    assert kills.main() == 1
    (row,) = read_csv(table, kills.KEY)
    assert (row["trial"], row["kill"], row["faults"], row["first"]) == ("0", "none", "1", "resumed: ended with 3")


def test_no_trial_begins_after_the_given_minutes(kills: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(kills, "trial", lambda *arguments: pytest.fail("a trial began"))
    monkeypatch.setattr("sys.argv", ["kills.py", "--minutes", "0", "--out", str(tmp_path / "kills.csv")])
    assert kills.main() == 0
