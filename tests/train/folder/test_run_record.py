"""Tests of the record of a run: what is no config or status is refused by name."""

import json
from pathlib import Path

import pytest

from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import read_config, read_context, read_status, write_config, write_status

FINISHED = {
    "state": "finished", "algorithm": "PPO", "steps": 100, "episodes": 3, "return_mean": 1.5, "cost_mean": 0.0,
    "cost_rate": 0.0, "seconds": 2.0, "warnings": {},
}  # fmt: skip


def test_config_and_status_are_read_as_they_were_written(tmp_path: Path):
    description = {"run": {"algorithm": "PPO", "note": "1e5", "rate": 1e-4}, "versions": {"numpy": "2"}}
    write_config(tmp_path, description)
    write_status(tmp_path, FINISHED | {"return_mean": float("nan")})
    assert read_config(tmp_path) == description
    assert read_status(tmp_path) == FINISHED | {"return_mean": None}
    assert read_status(tmp_path / "new") == {}


@pytest.mark.parametrize(
    ("content", "context"),
    [
        (b"run: {algorithm: PPO}", {}),
        (b"run: {algorithm: PPO, context: null}", {}),
        (b"run: {context: {river: {file: a}}}", {"river": {"file": "a"}}),
    ],
)
def test_the_context_of_a_run_is_a_mapping_whatever_its_config_says(content: bytes, context: dict, tmp_path: Path):
    assert read_context(tmp_path / "new") == {}
    (tmp_path / "config.yaml").write_bytes(content)
    assert read_context(tmp_path) == context


@pytest.mark.parametrize(
    "content",
    [
        b"run: \xff",
        b"[1, 2]",
        b"machine: {}",
        b"run: [1]",
        b"run: {context: 3}",
        b"run: {context: {env: 7}}",
        b"run: {context: {river: 7}}",
        b"run:",
        b"run: {}\nversions: 3",
        b"run: {}\nmachine: [a]",
        b"run: 2020-99-99",
        b"run: &a {b: *a}",
        b"[" * 5000,
    ],
)
def test_another_config_is_refused_by_name(content: bytes, tmp_path: Path):
    (tmp_path / "config.yaml").write_bytes(content)
    with pytest.raises(TrainingError, match=r"config\.yaml is not the config of a run"):
        read_config(tmp_path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "Expecting value"),
        (b'{"state": "\xff"}', "utf-8"),
        (b"[" * 50_000, "recursion"),
        (b"[1]", "it must be a mapping"),
        (json.dumps(FINISHED | {"seconds": "long"}).encode(), "seconds must be a number, got long"),
        (json.dumps(FINISHED | {"cost_rate": float("nan")}).encode(), "cost_rate must be a number, got nan"),
        (json.dumps(FINISHED).replace("1.5", "1e999").encode(), "return_mean must be a number, got inf"),
        (json.dumps(FINISHED | {"warnings": []}).encode(), "warnings must be a mapping"),
        (json.dumps(FINISHED | {"state": float("nan")}).encode(), "state must be a word, got nan"),
        (json.dumps(FINISHED | {"algorithm": 3}).encode(), "algorithm must be a word, got 3"),
        (json.dumps(FINISHED | {"new": {"a": [float("inf")]}}).encode(), "new holds a number that is not finite"),
        (b'{"state": "finished", "algorithm": "PPO", "steps": 1, "warnings": {}}', "it lacks cost_mean, cost_rate"),
    ],
)
def test_another_status_is_refused_by_name(content: bytes, words: str, tmp_path: Path):
    (tmp_path / "status.json").write_bytes(content)
    with pytest.raises(TrainingError, match=rf"status\.json is not the status of a run: .*{words}"):
        read_status(tmp_path)
