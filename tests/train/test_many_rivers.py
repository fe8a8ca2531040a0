"""Tests of training on many rivers: which are chosen, what is recorded, and runs that are killed."""

import csv
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.env.handmade import hairpin, ring
from tests.world.real.drawn_files import line, write
from thalweg.core import versions
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.assignment import DrawnRivers
from thalweg.env.rivers.river_list import RiverList
from thalweg.train import river, run
from thalweg.train.errors import TrainingError
from thalweg.train.folder.checkpoint import newest_step
from thalweg.train.river import RiverTraining
from thalweg.world import Reach

SETTINGS = {"steps_per_update": 64, "minibatch": 32, "passes": 1, "hidden": [8]}
NAMES = [f"river {index}-0" for index in range(7)]


class Stop(Exception):
    pass


class Handmade(RiverVectorEnv):
    """Environments that change between seven small courses, of which four and the next two are in memory."""

    at, stop = 0, -1

    def __init__(self, *_: Any) -> None:
        worlds = [(ring, hairpin)[index % 2](20.0 + index, name=f"river {index}") for index in range(7)]
        super().__init__(RiverList(worlds, in_memory=6), 2, EnvConfig(observation="privileged", max_steps=11))

    def step(self, actions: Any) -> Any:
        self.at += 1
        if self.at == self.stop:
            raise Stop
        return super().step(actions)


def stopping_at(step: int) -> type[Handmade]:
    return type("Stopping", (Handmade,), {"stop": step})


@pytest.mark.parametrize("stop", [33, 70, 143])
def test_a_run_on_changing_rivers_resumes_to_the_same_numbers(
    stop: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(river, "run", partial(run, checkpoint_seconds=0.0))
    rivers = RiverTraining("Easy", 2, range(7))  # pyright: ignore[reportArgumentType]

    def train(kind: type[Handmade], folder: str) -> Any:
        monkeypatch.setattr(river, "RiverVectorEnv", kind)
        return rivers.train("PPO", None, steps=320, seed=1, folder=tmp_path / folder, settings=SETTINGS)

    train(Handmade, "whole")
    with pytest.raises(Stop):
        train(stopping_at(stop), "broken")
    assert train(Handmade, "broken").resumed_from == (stop - 1) * 2 // 64 * 64
    for name in ("episodes.csv", "policy.safetensors"):
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    with open(tmp_path / "whole" / "episodes.csv") as file:
        rows = list(csv.DictReader(file))
    assert len({row["world"] for row in rows}) > 4
    assert {row["world"] for row in rows} <= set(NAMES)


def test_an_episode_is_recorded_with_the_river_in_which_it_was_flown(tmp_path: Path):
    env = Handmade()
    flown: list[list[str]] = [[], []]
    step = env.step

    def watched(actions: Any) -> Any:
        result = step(actions)
        for row in range(2):
            if result[2][row] or result[3][row]:
                flown[row].append(env.river_names[result[4]["river"][row]])
        return result

    env.step = watched
    run("PPO", env, steps=320, seed=0, folder=tmp_path, config=SETTINGS)
    with open(tmp_path / "episodes.csv") as file:
        rows = list(csv.DictReader(file))
    for row in range(2):
        assert [each["world"] for each in rows if each["env"] == str(row)] == flown[row]
        assert len(flown[row]) > 5


@pytest.mark.parametrize(
    ("options", "changes"),
    [
        ({"num_envs": 4, "world_seeds": "0:4"}, False),
        ({"num_envs": 4, "world_seeds": "0:5"}, True),
        ({"num_envs": 4, "world_seeds": "0:4", "rivers": "fixed"}, False),
        ({"num_envs": 4, "river": ("Easy", "Medium"), "world_seeds": "0:3"}, True),
        ({"num_envs": 4, "river": ("Easy", "Medium"), "world_seeds": "0:2"}, False),
        ({"num_envs": 4, "world_seeds": "0:2", "rivers": "episode"}, True),
        ({"num_envs": 4}, False),
    ],
)
def test_rivers_change_if_there_are_more_than_environments(options: dict, changes: bool):
    training = RiverTraining(**{"river": "Easy", **options})
    assert training.changes_river is changes
    env = training._envs(None, "cpu")
    assert isinstance(env.unwrapped.rivers, DrawnRivers) is changes
    env.close()


def test_many_rivers_are_recorded_as_a_range_and_few_as_before():
    many = RiverTraining("Medium", 16, ("3", "1000:1256")).about()  # pyright: ignore[reportArgumentType]
    assert many == {"level": "Medium", "world_seeds": [3, "1000:1256"], "rivers": "episode"}
    assert yaml.safe_load(yaml.safe_dump(many)) == many
    assert RiverTraining("Medium", 2, (3, 5)).about() == {"level": "Medium", "world_seeds": [3, 5]}


def test_rivers_of_several_levels_are_flown_in_one_run():
    training = RiverTraining(("easy", "Hard"), 3, (3, 5))
    assert training.about() == {"levels": ["Easy", "Hard"], "world_seeds": [3, 5], "rivers": "episode"}
    env = training._envs(None, "cpu")
    assert env.river_names == ["Easy-3", "Easy-5", "Hard-3", "Hard-5"]
    env.close()
    few = RiverTraining(("easy", "Hard"), 4, (3, 5))
    assert [world.name for world in few._envs(None, "cpu").worlds] == ["Easy", "Easy", "Hard", "Hard"]
    assert RiverTraining(("easy",), 4).about() == RiverTraining("Easy", 4).about() == {
        "level": "Easy", "world_seeds": [1],
    }  # fmt: skip


def test_a_run_on_other_banks_names_them_and_their_version():
    assert RiverTraining("easy+meadow", 2, (3,)).about() == {
        "level": "Easy+meadow",
        "banks_version": versions.BANKS,
        "world_seeds": [3],
    }
    assert "banks_version" not in RiverTraining("Easy+forest", 2, (3,)).about()


@pytest.mark.parametrize(
    ("told", "banks", "found"), [("", "", 0), ("meadow", "", 1), ("", "quay", 1), ("quay", "forest", 0)]
)
def test_a_run_on_a_file_has_the_version_of_its_banks(told: str, banks: str, found: int, tmp_path: Path):
    way = line([(10.0 * x, 0.0) for x in range(17)], width=8, **({"banks": told} if told else {}))
    about = RiverTraining(Reach(write(tmp_path, way), banks=banks), 2).about()
    assert about.get("banks_version", 0) == found * versions.BANKS


def test_the_rivers_in_memory_are_announced(capsys: pytest.CaptureFixture):
    river.print_once.cache_clear()
    RiverTraining("Easy", 1, range(900, 909), rivers_in_memory=3)._envs(None, "cpu").close()  # pyright: ignore
    assert capsys.readouterr().err == "9 rivers, another one in each episode; 2 of them in memory, 0.0 MB\n"
    RiverTraining("Easy", 1, (900,), rivers="episode")._envs(None, "cpu").close()  # pyright: ignore
    assert capsys.readouterr().err == "1 river, 0.0 MB in memory\n"


def test_numbers_of_numpy_become_pythons():
    training = RiverTraining("Easy", np.int64(4), "0:9", rivers_in_memory=np.int64(3))  # pyright: ignore[reportArgumentType]
    assert [type(each) for each in (training.num_envs, training.rivers_in_memory)] == [int, int]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"world_seeds": "9:3"}, "world_seeds: 9:3 holds no seed; write 3:9"),
        (
            {"world_seeds": "0:5", "rivers": "fixed"},
            "of 5 fixed rivers, 4 environments would fly in 4 only; give as many",
        ),
        ({"river": ("Easy", "easy")}, "levels must be at least one, each once, not Easy, Easy"),
        ({"river": ()}, "levels must be at least one, each once, not none"),
        ({"rivers": "often"}, "rivers must be one of auto, fixed, episode, not 'often'"),
        ({"rivers_in_memory": 9}, "rivers_in_memory is for rivers that change"),
        ({"rivers_in_memory": -1}, "rivers_in_memory must be at least 1, got -1"),
        ({"rivers_in_memory": 2.0}, r"rivers_in_memory must be a whole number, got 2\.0"),
        ({"num_envs": 0}, "num_envs must be at least 1, got 0"),
        ({"num_envs": 2.5}, r"num_envs must be a whole number, got 2\.5"),
        ({"num_envs": float("nan")}, "num_envs must be a whole number, got nan"),
        ({"num_envs": True}, "num_envs must be a whole number, got True"),
        ({"num_envs": 100_000_000}, "num_envs must be at most 1000000, got 100000000"),
        ({"river": Reach(Path("brook.geojson")), "world_seeds": "0:5"}, "5 seeds of brook.geojson for 4 environments"),
    ],
)
def test_wrong_rivers_are_refused(options: dict, message: str):
    with pytest.raises(TrainingError, match=message):
        RiverTraining(**{"river": "Easy", "num_envs": 4, **options})


def test_environments_of_tensors_do_not_change_river():
    with pytest.raises(TrainingError, match="on a GPU, rivers do not change: 5 rivers for 4 environments"):
        RiverTraining("Easy", 4, range(5))._envs(None, "cuda")  # pyright: ignore[reportArgumentType]


@pytest.mark.slow
def test_a_run_that_is_killed_again_and_again_ends_with_the_same_policy(tmp_path: Path):
    def command(folder: str) -> list[str]:
        words = ["train", "--algorithm", "PPO", "--level", "easy", "--world-seeds", "900:909", "--num-envs", "4"]
        words += ["--observation", "privileged", "--steps", "60000", "--out", str(tmp_path / folder)]
        return [sys.executable, "-m", "thalweg", *words]

    subprocess.run(command("whole"), check=True, capture_output=True)
    resumed = []
    for _ in range(3):
        before = newest_step(tmp_path / "killed")
        process = subprocess.Popen(command("killed"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        until = time.monotonic() + 300
        while newest_step(tmp_path / "killed") == before and time.monotonic() < until:
            time.sleep(0.05)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        resumed.append(newest_step(tmp_path / "killed"))
    steps = [step for step in resumed if step is not None]
    assert len({*steps}) == 3 and steps == sorted(steps) and steps[-1] < 60_000
    subprocess.run(command("killed"), check=True, capture_output=True)
    for name in ("episodes.csv", "policy.safetensors"):
        assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
