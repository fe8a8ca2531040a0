"""The gate stops a teacher that fails, with the river and the start, and lets the pilots pass."""

import json
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.train.errors import TrainingError
from thalweg.train.imitation import gate
from thalweg.train.imitation.gate import check_teacher, flown_by
from thalweg.world import Reach, level_named

LEVEL = level_named("Easy")


@pytest.mark.parametrize("teacher", ["steady", "scripted"])
def test_pilots_pass(teacher: Literal["steady", "scripted"]):
    flown: list[int] = []
    check_teacher(LEVEL, range(3), EnvConfig(), flown_by(teacher), on_flown=flown.append)
    assert flown == [3]


def hover(env: RiverVectorEnv) -> np.ndarray:
    return np.ones((env.num_envs, 4), np.int64)


def test_a_teacher_that_fails_is_named_with_its_river_and_start():
    with pytest.raises(
        TrainingError, match=r"fails its gate on Easy-5 from x -?\d+\.\d\d, y .* m, yaw .*: it returns"
    ) as error:
        check_teacher(LEVEL, [5, 6], EnvConfig(), hover)
    assert "ends by Idle; nothing is learnt from it" in str(error.value)


@pytest.fixture
def brook(tmp_path: Path) -> Reach:
    file, line = tmp_path / "brook.geojson", [[9, 48], [9.0008, 48], [9.0016, 48.0003]]
    file.write_text(json.dumps({"type": "LineString", "coordinates": line}))
    return Reach(file, width_m=9.0)


def test_starts_on_a_real_river_are_flown(brook: Reach):
    flown: list[int] = []
    assert not brook.build().river.closed
    check_teacher(brook, range(4), EnvConfig(), flown_by("steady"), on_flown=flown.append)
    assert flown == [4]
    with pytest.raises(TrainingError, match=r"fails its gate on brook\.geojson from x .* ends by Idle"):
        check_teacher(brook, range(2), EnvConfig(), hover)


def late(env: RiverVectorEnv) -> np.ndarray:
    """Return the pilot's actions, but fly straight ahead in the second environment after a while."""
    actions = env.pilot_actions("steady")
    if env.state.steps[1] > 60:
        actions[1] = (1, 1, 0, 1)
    return actions


def test_one_failure_among_many_is_found():
    with pytest.raises(TrainingError, match="fails its gate on Easy-8"):
        check_teacher(LEVEL, [7, 8, 9], EnvConfig(), late)


def test_a_return_below_10_fails_the_gate_on_a_loop_alone(brook: Reach, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gate, "_flown", lambda *_: (np.array([9.99]), np.array([int(DoneReason.SUCCESS)])))
    with pytest.raises(TrainingError, match=r"it returns 9\.99 of 10 and ends by Success"):
        check_teacher(LEVEL, [5], EnvConfig(), hover)
    check_teacher(brook, [5], EnvConfig(), hover)  # an open course: what is missing lies behind the start
    monkeypatch.setattr(gate, "_flown", lambda *_: (np.array([10.0]), np.array([int(DoneReason.SUCCESS)])))
    check_teacher(LEVEL, [5], EnvConfig(), hover)
