"""Tests of the checkpoint files: exact contents, damage, and interrupted writes."""

import errno
import json
import os

import numpy as np
import pytest

from thalweg.train.errors import TrainingError
from thalweg.train.folder.checkpoint import load_checkpoint, newest_step, save_checkpoint
from thalweg.train.folder.loggers import CsvTable

STATE = {
    "learner": {"weights": np.arange(6, dtype=np.float32).reshape(2, 3).T, "count": 3, "none": np.zeros((0, 4))},
    "random": {"state": {"state": 2**100 + 1}, "flag": True},
    "scalar": np.array(0.1),
    "words": np.array([2**64 - 1], dtype=np.uint64),
    "rows": [{"cost": float("nan")}, {"cost": 0.1}],
}


def test_a_state_comes_back_to_the_bit(tmp_path):
    save_checkpoint(tmp_path, 7, STATE)
    step, state = load_checkpoint(tmp_path) or (None, {})
    assert step == 7
    assert np.array_equal(state["learner"]["weights"], STATE["learner"]["weights"])
    assert state["learner"]["weights"].dtype == np.float32 and state["learner"]["none"].shape == (0, 4)
    assert state["random"] == STATE["random"] and state["learner"]["count"] == 3
    assert state["scalar"].shape == () and state["scalar"] == STATE["scalar"]
    assert state["words"][0] == 2**64 - 1
    assert np.isnan(state["rows"][0]["cost"]) and state["rows"][1]["cost"] == 0.1


def test_the_newest_checkpoint_is_loaded_and_the_one_before_remains(tmp_path):
    for step in (5, 10, 200):
        save_checkpoint(tmp_path, step, {"at": step})
    assert load_checkpoint(tmp_path) == (200, {"at": 200})
    assert sorted(path.name for path in (tmp_path / "checkpoints").iterdir()) == ["000000000010", "000000000200"]


def test_a_half_written_checkpoint_is_not_seen_and_is_cleared_away(tmp_path):
    save_checkpoint(tmp_path, 5, {"at": 5})
    rest = tmp_path / "checkpoints" / ".000000000009.1.part"
    rest.mkdir()
    (rest / "arrays.safetensors").write_bytes(b"half")
    assert load_checkpoint(tmp_path) == (5, {"at": 5})
    save_checkpoint(tmp_path, 12, {"at": 12})
    assert not rest.exists()


def test_the_step_to_resume_from_is_that_of_the_newest(tmp_path):
    assert newest_step(tmp_path) is None
    for step in (9, 1024, 24576):
        save_checkpoint(tmp_path, step, {})
    assert newest_step(tmp_path) == 24576


def test_a_checkpoint_that_was_renamed_is_none(tmp_path):
    for step in (9, 1024):
        save_checkpoint(tmp_path, step, {"at": step})
    newest = tmp_path / "checkpoints" / "000000001024"
    newest.rename(newest.with_name("000000001024.bad"))
    assert newest_step(tmp_path) == 9 and (load_checkpoint(tmp_path) or (0,))[0] == 9
    for step in (2048, 4096):
        save_checkpoint(tmp_path, step, {})
    names = sorted(path.name for path in newest.parent.iterdir())
    assert names == ["000000001024.bad", "000000002048", "000000004096"]  # whose it is, stays


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that takes no more, which shows when a file is synced."""

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)


@pytest.mark.usefixtures("full_disk")
def test_a_checkpoint_on_a_full_disk_is_named_and_takes_no_space(tmp_path):
    with pytest.raises(OSError, match="No space") as raised:
        save_checkpoint(tmp_path, 5, {"at": 5})
    assert raised.value.filename == str(tmp_path / "checkpoints" / "000000000005")
    assert list((tmp_path / "checkpoints").iterdir()) == []


@pytest.mark.usefixtures("full_disk")
def test_a_table_on_a_full_disk_is_named(tmp_path):
    table = CsvTable(tmp_path / "table.csv", columns=["a"])
    with pytest.raises(OSError, match="No space") as raised:
        table.sync()
    assert raised.value.filename == str(tmp_path / "table.csv")
    table.close()


def test_no_checkpoint_is_none(tmp_path):
    assert load_checkpoint(tmp_path) is None


@pytest.mark.parametrize("value", [object(), {1, 2}, np.array(["a"]), np.array([None])])
def test_only_arrays_and_plain_data_are_taken_and_nothing_is_left(tmp_path, value):
    with pytest.raises(TrainingError):
        save_checkpoint(tmp_path, 1, {"x": value})
    assert load_checkpoint(tmp_path) is None


def test_damage_is_noticed(tmp_path):
    folder = save_checkpoint(tmp_path, 1, STATE)
    content = bytearray((folder / "arrays.safetensors").read_bytes())
    content[-1] ^= 1
    (folder / "arrays.safetensors").write_bytes(content)
    with pytest.raises(TrainingError, match="is damaged"):
        load_checkpoint(tmp_path)
    (folder / "state.json").write_text((folder / "state.json").read_text()[:50])
    with pytest.raises(TrainingError, match="not a complete checkpoint"):
        load_checkpoint(tmp_path)


def test_another_version_is_refused(tmp_path):
    folder = save_checkpoint(tmp_path, 1, {})
    plain = json.loads((folder / "state.json").read_text())
    (folder / "state.json").write_text(json.dumps(plain | {"format": 99}))
    with pytest.raises(TrainingError, match="format 99"):
        load_checkpoint(tmp_path)


def test_a_table_is_cut_back_to_its_checkpoint(tmp_path):
    table = CsvTable(tmp_path / "t.csv")
    table.write({"a": 1, "b": 0.1})
    kept = table.sync()
    table.write({"a": 2, "b": 0.2})
    table.write({"a": 22222222, "b": 0.2222222222222222})
    table.close()
    table = CsvTable(tmp_path / "t.csv", kept)
    table.write({"b": 1 / 3, "a": 3})
    table.close()
    assert (tmp_path / "t.csv").read_text() == "a,b\n1,0.1\n3,0.3333333333333333\n"


def test_a_table_shorter_than_its_checkpoint_is_refused(tmp_path):
    (tmp_path / "t.csv").write_text("a\n1\n")
    with pytest.raises(TrainingError, match="has 4 bytes, but had 9 when its checkpoint was written"):
        CsvTable(tmp_path / "t.csv", 9)


@pytest.mark.parametrize(
    "content",
    [b"[]", b"{}", b"\xff", b"[" * 50_000, b'{"format": 1, "step": "7", "state": {}, "sha256": ""}', b'{"format": 1}'],
)
def test_a_state_that_is_none_is_refused_by_name(content: bytes, tmp_path):
    folder = save_checkpoint(tmp_path, 7, STATE)
    (folder / "state.json").write_bytes(content)
    with pytest.raises(TrainingError, match=f"{folder} is not a (complete )?checkpoint"):
        load_checkpoint(tmp_path)
