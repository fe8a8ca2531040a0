"""Tests that rules do not depend on the kinds of banks, and that environments take them as an option."""

import json
from dataclasses import asdict

import gymnasium
import numpy as np
import pytest

import thalweg
from thalweg.env import ConfigError, EnvConfig, RiverVectorEnv
from thalweg.env.rivers.bare_river import plan_bare
from thalweg.env.rivers.build_ahead import _tuple
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.rivers.sounded_river import sound
from thalweg.env.task.course_arrays import step_limit
from thalweg.world import Level, WorldError, build, level_named
from thalweg.world.species import kinds_of

NO_FRAMES = EnvConfig(observation="privileged")


@pytest.mark.parametrize("make", [plan_bare, sound, build])
def test_banks_beyond_the_course_are_refused_however_much_of_a_river_is_made(make):
    with pytest.raises(WorldError, match="900"):
        make(level_named("Easy+quay_900-950"), 1)


def test_a_flight_pays_the_same_on_every_kind_of_bank():
    flights = []
    for level in ("Easy", "Easy+meadow", "Easy+quay_0-100+reeds_100-"):
        env = RiverVectorEnv([plan_bare(level_named(level), 1)], 4, NO_FRAMES)
        seen, _ = env.reset(seed=2)
        rows = [np.asarray(seen)]
        for step in range(40):
            seen, reward, ended, cut, info = env.step(np.full((4, 4), 1 + step % 2, np.int64))
            rows += [np.asarray(seen), reward, ended, cut, info["cost"]]
        flights.append(np.concatenate([np.ravel(row) for row in rows]))
    np.testing.assert_array_equal(flights[0], flights[1])
    np.testing.assert_array_equal(flights[0], flights[2])


def test_the_step_limit_is_that_of_the_level():
    for level in ("Easy", "Easy+meadow"):
        assert step_limit(plan_bare(level_named(level), 1), NO_FRAMES) == 500


def test_banks_are_an_option_of_environments():
    env = gymnasium.make("thalweg/Easy-v0", banks="meadow", observation="none")
    assert env.unwrapped.vector.worlds[0].name == "Easy+meadow"  # pyright: ignore[reportAttributeAccessIssue]
    many = gymnasium.make_vec("thalweg/Easy-v0", num_envs=2, banks="quay_0-50", observation="none")
    assert many.worlds[0].name == "Easy+quay_0-50"  # pyright: ignore[reportAttributeAccessIssue]
    for each in (env, many):
        each.close()


def test_bad_banks_of_an_environment_are_refused():
    with pytest.raises(WorldError, match="unknown kind 'lawn'"):
        gymnasium.make("thalweg/Easy-v0", banks="lawn", observation="none")
    with pytest.raises(ConfigError, match="give either worlds or banks, not both"):
        thalweg.make_torch("Easy", worlds=plan_bare(level_named("Easy"), 1), banks="meadow", observation="none")


def test_a_list_of_rivers_tells_banks_apart():
    forest, meadow = (RiverList.of_levels([(level, [3])]) for level in ("Easy", "Easy+meadow"))
    assert meadow.names == ["Easy+meadow-3"]
    assert forest.identity() != meadow.identity()


@pytest.mark.slow
def test_a_boat_finds_the_bed_and_the_rocks_of_the_whole_river():
    level = level_named("Easy+quay_0-150+meadow_150-_left")
    whole, sounded = build(level, 5), sound(level, 5)
    column, row = (
        round((getattr(sounded.grid, name) - getattr(whole.grid, name)) / whole.grid.cell_m)
        for name in ("origin_x_m", "origin_y_m")
    )
    rows, columns = sounded.ground_m.shape
    np.testing.assert_array_equal(sounded.ground_m, whole.ground_m[row : row + rows, column : column + columns])
    rocks = [each.plants.position_m[np.isin(each.plants.kind, kinds_of("rock"))] for each in (whole, sounded)]
    near = {tuple(foot) for foot in rocks[1].tolist()}
    assert near and near <= {tuple(foot) for foot in rocks[0].tolist()}


def test_a_level_with_banks_passes_to_the_process_that_builds_ahead():
    level = level_named("Easy+reeds_left")
    line = json.loads(json.dumps({"level": asdict(level)}))
    assert Level(**{name: _tuple(value) for name, value in line["level"].items()}) == level
