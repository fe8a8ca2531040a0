"""A run that travels is the same run, whoever is killed while it is unpacked."""

import shutil
from pathlib import Path

import pytest

from tests.train.small_runs import Stop, StopsAt, numbers, train
from thalweg.bench.evaluate.conditions import Condition, Trial
from thalweg.bench.execute.cluster import run_archive
from thalweg.bench.execute.cluster.run_archive import Files, archive_names, milestones, pack, unpack

UNSEEN = Condition("unseen", unseen=True)
RUN, TRIALS = "FOCOPS-3", (Trial("Easy"), Trial("Hard"), Trial("Hard", UNSEEN))


def home(folder: Path) -> Path:
    return folder / "runs" / RUN


def broken_off(folder: Path, *ats: int) -> Files:
    """A run that was broken off at some vector steps, packed."""
    for at in ats:
        with pytest.raises(Stop):
            train(home(folder), env=StopsAt(at))
    return pack(folder, RUN, TRIALS)


def test_what_is_packed_is_the_newest_checkpoint_first_and_nothing_hidden(tmp_path: Path):
    unseen, stage = "evaluation/unseen/FOCOPS-3-Hard.csv", f"runs/{RUN}/.before/0/policy.safetensors"
    for name in ("evaluation/FOCOPS-3-Hard.csv", "evaluation/FOCOPS-30-Hard.csv", unseen, "logs/FOCOPS-3.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    broken_off(tmp_path, 120)
    (tmp_path / stage).parent.mkdir(parents=True)
    (tmp_path / stage).write_text("the stage before")
    (home(tmp_path) / ".status.0123.part.json").write_text("half")
    (home(tmp_path) / "checkpoints" / ".000000000512.7.part").mkdir()
    kept = sorted(path.name for path in home(tmp_path).glob("checkpoints/[0-9]*"))
    names = archive_names(tmp_path, RUN, TRIALS)
    assert kept == ["000000000256", "000000000384"]
    start = f"runs/{RUN}"
    newest = [f"{start}/checkpoints/000000000384/{name}" for name in ("arrays.safetensors", "state.json")]
    beside = [f"{start}/{name}" for name in ("config.yaml", "episodes.csv", "metrics.csv", "status.json")]
    assert names[:6] == newest + beside
    assert names[6] == stage
    assert names[7].startswith(f"{start}/tensorboard/events")
    assert names[8:] == ["evaluation/FOCOPS-3-Hard.csv", unseen, "logs/FOCOPS-3.txt"]
    assert milestones(names) == {*newest, stage, "evaluation/FOCOPS-3-Hard.csv", unseen}


def test_what_comes_out_is_what_went_in_and_nothing_else(tmp_path: Path):
    files = broken_off(tmp_path / "there", 120)
    broken_off(tmp_path / "here", 60)
    (home(tmp_path / "here") / "error.txt").write_text("of an attempt before")
    unpack(files, tmp_path / "here", RUN)
    found = {path.relative_to(tmp_path / "here").as_posix() for path in home(tmp_path / "here").rglob("*.*")}
    assert found == set(files)
    assert pack(tmp_path / "here", RUN, TRIALS) == files


def test_an_interrupted_stage_resumes_elsewhere_from_its_checkpoint(tmp_path: Path):
    there, here = (home(tmp_path / name) for name in ("there", "here"))
    for folder, at in ((there / ".before" / "0", 120), (there / ".before" / "1", 60)):
        with pytest.raises(Stop):
            train(folder, env=StopsAt(at))
    files = pack(tmp_path / "there", RUN, TRIALS)
    start = f"runs/{RUN}/.before"
    checkpoints = [f"{start}/{name}" for name in ("0/checkpoints/000000000384", "1/checkpoints/000000000128")]
    first = [f"{folder}/{name}" for folder in checkpoints for name in ("arrays.safetensors", "state.json")]
    assert list(files)[:4] == first and set(first) <= milestones(files)
    unpack(files, tmp_path / "here", RUN)
    assert pack(tmp_path / "here", RUN, TRIALS) == files
    train(here / ".before" / "0")
    sent = [name for name in pack(tmp_path / "here", RUN, TRIALS) if "checkpoints" in name]
    assert sent == first[2:]  # that of the finished stage is not sent again
    train(tmp_path / "whole")
    assert numbers(here / ".before" / "0") == numbers(tmp_path / "whole")


@pytest.mark.slow
def test_a_run_killed_at_any_write_resumes_from_the_files_present(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    train(tmp_path / "whole")
    earlier = broken_off(tmp_path / "there", 60)
    train(home(tmp_path / "there"))
    later = pack(tmp_path / "there", RUN, TRIALS)
    for die_at in range(len(later)):
        here = tmp_path / f"here{die_at}"
        unpack(earlier, here, RUN)
        with monkeypatch.context() as patch:
            patch.setattr(run_archive, "write_atomic", dies_at(die_at))
            with pytest.raises(Stop):
                unpack(later, here, RUN)
        train(home(here))
        assert numbers(home(here)) == numbers(tmp_path / "whole")
        shutil.rmtree(here)


def dies_at(count: int):
    """`write_atomic`, but for the call of that number."""
    write, calls = run_archive.write_atomic, iter(range(count))

    def write_or_die(path: Path, content: bytes) -> None:
        if next(calls, None) is None:
            raise Stop
        write(path, content)

    return write_or_die
