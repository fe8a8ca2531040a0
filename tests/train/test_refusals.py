"""Tests of runs that are refused before they have begun, by name, and of what stays as it was."""

import datetime
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.train.small_runs import SMALL, Stop, StopsAt, numbers, train
from tests.train.toys import Walk
from thalweg.algos import AlgorithmError
from thalweg.core import run_folder
from thalweg.core.compute.device import DeviceError
from thalweg.train import TrainingError, load_policy
from thalweg.train.folder.run_record import read_config
from thalweg.train.run_in_folder import open_folder


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"algorithm": "PPO"}, "algorithm is 'FOCOPS' there and 'PPO' here"),
        ({"config": SMALL | {"cost_limit": 0.3}}, "config.cost_limit is 0.1 there and 0.3 here"),
        ({"env": Walk(6)}, "num_envs is 4 there and 6 here"),
        ({"seed": 5}, "seed is 3 there and 5 here"),
        ({"context": {"encoder": "mine"}}, "context.encoder is absent there and 'mine' here"),
    ],
)
def test_the_folder_of_another_run_is_refused_before_anything_happens(tmp_path, changes, words):
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(200))
    kept = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(TrainingError, match=words):
        train(tmp_path, **changes)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == kept


def test_of_many_differences_the_first_are_named_and_the_others_counted(tmp_path):
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(200))
    changes = {f"key_{k}": k for k in range(9)}
    with pytest.raises(TrainingError, match=r"context\.key_3 is absent there and 3 here; and 5 more\. Choose"):
        train(tmp_path, context=changes)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (
            ["thesis.tex"],
            r"home holds thesis.tex, but no config.yaml: it is not the folder of a run\. Give a new or empty",
        ),
        (["metrics.csv", "checkpoints"], "home holds checkpoints, metrics.csv, but no config.yaml"),
        (list("fedcba"), r"home holds a, b, c, d and 2 more, .* such as .*home.NAME$"),
    ],
)
def test_a_folder_of_something_else_is_refused_and_left_as_it_was(tmp_path, names, said):
    home = tmp_path / "home"
    for name in names:
        (home / name).mkdir(parents=True)
    with pytest.raises(TrainingError, match=said):
        train(home)
    assert sorted(path.name for path in home.iterdir()) == sorted(names)


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("kept")
    with pytest.raises(TrainingError, match="file is not a folder; give a new folder for the run"):
        train(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "kept"


def test_hidden_files_are_in_no_runs_way(tmp_path):
    (tmp_path / ".config.0123456789abcdef.part.yaml").write_text("run:")
    assert train(tmp_path, steps=200).steps >= 200


def test_one_environment_alone_is_refused_by_name(tmp_path):
    import gymnasium

    with pytest.raises(TrainingError, match=r"takes a Gymnasium VectorEnv, .*, not "):
        train(tmp_path, env=gymnasium.make("CartPole-v1"))  # pyright: ignore


def test_the_folder_of_another_run_is_refused_before_its_first_checkpoint_too(tmp_path):
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(5))
    with pytest.raises(TrainingError, match="seed is 3 there and 5 here"):
        train(tmp_path, seed=5)


@pytest.mark.parametrize("attempt", range(5))
def test_of_two_runs_that_begin_in_one_folder_at_once_one_is_refused(tmp_path, attempt, monkeypatch):
    monkeypatch.setattr(run_folder, "WAIT_S", 60.0)  # of a slow disk
    ready, outcomes = threading.Barrier(2), {}

    def begin(seed: int) -> None:
        identity = {"algorithm": "FOCOPS", "config": {}, "seed": seed}
        ready.wait()
        try:
            outcomes[seed] = open_folder(tmp_path / "run", identity, 1)
        except TrainingError as error:
            outcomes[seed] = str(error)

    threads = [threading.Thread(target=begin, args=(seed,)) for seed in (1, 2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    (first,) = [seed for seed, found in outcomes.items() if found == {}]
    other = 3 - first
    assert f"seed is {first} there and {other} here" in outcomes[other]
    assert (read_config(tmp_path / "run") or {})["run"]["seed"] == first


def test_wrong_arguments_leave_no_folder(tmp_path):
    folder = tmp_path / "new"
    wrong: list[dict[str, Any]] = [
        {"algorithm": "ABC"},
        {"config": {"clipp": 0.1}},
        {"config": {"cost_limits": [0.1]}},
        {"preset": "study"},
        {"steps": 0},
    ]
    for changes in wrong:
        with pytest.raises((AlgorithmError, TrainingError)):
            train(folder, **changes)
    with pytest.raises(TrainingError, match="plain data only"):
        train(folder, context={"path": object()})
    assert not folder.exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"steps": 0}, "steps must be at least 1, got 0"),
        ({"steps": -100}, "steps must be at least 1, got -100"),
        ({"threads": 0}, "threads must be at least 1, got 0"),
        ({"seed": -1}, "seed must not be negative, got -1"),
        ({"seed": 2**63}, "seed must be at most 9223372036854775807, got 9223372036854775808"),
        ({"seed": 1.0}, "seed must be a whole number, got 1.0"),
        ({"seed": True}, "seed must be a whole number, got True"),
        ({"steps": float("nan")}, "steps must be a whole number, got nan"),
        ({"steps": "1500"}, "steps must be a whole number, got '1500'"),
        ({"threads": 1.5}, "threads must be a whole number, got 1.5"),
        ({"seed": None}, "seed must be a whole number, got None"),
        ({"checkpoint_seconds": None}, "checkpoint_seconds must be a finite number of at least 0, got None"),
        ({"checkpoint_seconds": "a"}, "checkpoint_seconds must be a finite number of at least 0, got 'a'"),
        ({"checkpoint_seconds": True}, "checkpoint_seconds must be a finite number of at least 0, got True"),
        ({"checkpoint_seconds": float("nan")}, "checkpoint_seconds must be a finite number of at least 0, got nan"),
        ({"checkpoint_seconds": float("inf")}, "checkpoint_seconds must be a finite number of at least 0, got inf"),
        ({"checkpoint_seconds": -1.0}, "checkpoint_seconds must be a finite number of at least 0, got -1.0"),
        ({"context": "Danube"}, "context must be a mapping, or None for an empty one, got 'Danube'"),
        ({"context": ["river"]}, r"context must be a mapping, or None for an empty one, got \['river'\]"),
        ({"context": {"river": "Danube"}}, "context.river must be a mapping or left out, got 'Danube'"),
        ({"context": {"env": "CartPole-v1"}}, "context.env must be a mapping or left out, got 'CartPole-v1'"),
        ({"context": {"env": None}}, "context.env must be a mapping or left out, got None"),
        ({"context": {"rate": float("nan")}}, "context holds plain data only, as JSON has it: Out of range float"),
        ({"context": {"name": "half \ud800"}}, "context cannot be read back from config.yaml: "),
        ({"context": {"levels": {1: "easy"}}}, "keys of context must be strings without '/', got 1"),
        ({"context": {"levels": [{"a/b": 1}]}}, "keys of context must be strings without '/', got 'a/b'"),
        ({"context": {"day": datetime.date(2026, 1, 2)}}, "context holds plain data only, as JSON has it: .* date"),
    ],
)
def test_values_that_no_run_can_have_are_named_before_the_folder_is_created(tmp_path, changes, words):
    with pytest.raises(TrainingError, match=words):
        train(tmp_path / "new", **changes)
    assert not (tmp_path / "new").exists()


def test_numbers_of_numpy_are_the_same_run(tmp_path):
    kinds: dict[str, Any] = {"steps": np.int64(256), "seed": np.uint32(3), "threads": np.int32(1)}
    train(tmp_path / "numpy", **kinds)
    train(tmp_path / "python", steps=256, seed=3)
    described = [(read_config(tmp_path / name) or {})["run"] for name in ("numpy", "python")]
    assert described[0] == described[1]
    assert numbers(tmp_path / "numpy") == numbers(tmp_path / "python")


def test_a_folder_without_a_policy_is_refused(tmp_path):
    with pytest.raises(AlgorithmError, match=r"is not the folder of a run: it holds no policy\.safetensors"):
        load_policy(tmp_path)
    (tmp_path / "status.json").write_text('{"state": "running"}')
    words = r"no policy\.safetensors in .* \(running\): it is written when the run finishes, and the command that began"
    with pytest.raises(AlgorithmError, match=words):
        load_policy(tmp_path)


def test_separate_limits_without_separate_costs_are_refused(tmp_path):
    class Together(Walk):
        def step(self, actions):
            *rest, info = super().step(actions)
            del info["costs"]
            return *rest, info

    with pytest.raises(TrainingError, match=r"cost_limits are limits of tight and loose costs, but the environment"):
        train(tmp_path, env=Together(), config=SMALL | {"cost_limits": [0.1, 0.2]})
    assert train(tmp_path / "together", env=Together(), steps=200).steps == 200


def test_another_preset_is_another_run(tmp_path):
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(200))
    with pytest.raises(TrainingError, match="preset is 'default' there and 'paper' here"):
        train(tmp_path, preset="paper")


def test_graphs_are_refused_where_none_could_be_recorded(tmp_path: Path):
    with pytest.raises(AlgorithmError, match="graphs are for DDPGLag, TD3Lag and SACLag; steps of FOCOPS are not"):
        train(tmp_path / "new", graphs=True)
    with pytest.raises(DeviceError, match="graphs are recorded on a GPU only, not on cpu"):
        train(tmp_path / "new", "SACLag", graphs=True)
    assert not (tmp_path / "new").exists()
