"""Tests of the levels as data and of finding them by name."""

from dataclasses import replace

import numpy as np
import pytest

from thalweg.world import LEVELS, WorldError, build, level_named
from thalweg.world.banks import text_of
from thalweg.world.levels import on_banks
from thalweg.world.store.world_cache import cache_path


def test_samples_are_those_of_the_table():
    assert {name: level.samples for name, level in LEVELS.items()} == {"Easy": 216, "Medium": 288, "Hard": 328}


@pytest.mark.parametrize("level", LEVELS.values(), ids=LEVELS)
def test_samples_lie_about_1_3_m_apart(level):
    assert level.length_m / level.samples == pytest.approx(1.3, abs=0.01)


def test_names_are_found_in_any_case():
    assert level_named("hARD") is LEVELS["Hard"]


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(WorldError, match="'Extreme'; known: Easy, Medium, Hard"):
        level_named("Extreme")


def test_the_key_depends_on_the_data_but_not_on_the_default_seed():
    easy = LEVELS["Easy"]
    assert replace(easy, default_seed=99).key == easy.key
    assert replace(easy, length_m=281.0).key != easy.key


def test_the_keys_of_the_built_in_levels_are_unchanged():
    keys = {name: level.key for name, level in LEVELS.items()}
    assert keys == {"Easy": 10865751102021860621, "Medium": 11291398378637665864, "Hard": 8057083718481944270}


def test_banks_stand_in_the_name_and_change_neither_course_nor_key():
    medium = LEVELS["Medium"]
    meadow = medium.with_banks("meadow")
    assert (meadow.name, meadow.base_name, text_of(meadow.banks)) == ("Medium+meadow", "Medium", "meadow")
    assert meadow.key == medium.key
    assert meadow != medium
    assert cache_path(meadow, 1) != cache_path(medium, 1)
    assert meadow.with_banks("quay 120-180 left").name == "Medium+quay_120-180_left"
    assert meadow.with_banks("forest") == medium
    assert replace(medium, banks="meadow") == meadow


def test_replaced_banks_take_the_place_of_the_old_ones_in_the_name():
    medium = LEVELS["Medium"]
    meadow = medium.with_banks("meadow")
    assert replace(meadow, banks=()) == medium
    quay = replace(meadow, banks="quay_0-10_left+reeds_20-")
    assert (quay.name, quay.key) == ("Medium+quay_0-10_left+reeds_20-", medium.key)
    mine = replace(medium, name="a+b")
    assert mine.base_name == "a+b" and mine.with_banks("reeds").with_banks("quay").name == "a+b+quay"


def test_a_name_with_banks_is_found_in_any_case():
    assert level_named("medium+Meadow + quay 120-180") == LEVELS["Medium"].with_banks("meadow+quay_120-180")
    assert level_named("Hard+forest") == LEVELS["Hard"]
    assert on_banks("Hard+meadow", "reeds") == "Hard+reeds"


def test_unknown_levels_and_banks_in_a_name_are_refused():
    with pytest.raises(WorldError, match=r"unknown level 'Mediun' \(did you mean 'Medium'"):
        level_named("Mediun+meadow")
    with pytest.raises(WorldError, match=r"unknown kind 'lawn'.*; known: forest, meadow, reeds, quay"):
        level_named("Medium+lawn")
    with pytest.raises(WorldError, match=r"'' is no reach; expected a kind"):
        level_named("Medium+")


def test_banks_off_the_course_are_refused_before_anything_is_built():
    with pytest.raises(WorldError, match=r"quay_0-500 is not on the course, which is 27\d\.\d m long"):
        build(level_named("Easy+quay_0-500"), 1)


def test_equal_numbers_of_different_types_give_equal_keys():
    easy = LEVELS["Easy"]
    other = replace(easy, length_m=280, samples=np.int64(216), bends=[3, np.int8(3)], width_m=np.array([7, 12]))
    assert other == easy
    assert other.key == easy.key
    assert type(other.length_m) is float
    assert type(other.bends) is tuple


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("name", "../x", r"name must be letters, digits, .* not '\.\./x'"),
        ("name", "", r"name must be .* not ''"),
        ("name", 3, r"name must be .* not 3"),
        ("samples", 0, r"samples must be a whole number from 24 to 8000, not 0"),
        ("samples", 2.5, r"samples must be a whole number from 24 to 8000, not 2\.5"),
        ("samples", 10**6, r"samples must be .* not 1000000"),
        ("samples", True, r"samples must be .* not True"),
        ("length_m", -280.0, r"length_m must be a number from 45 to 10000, not -280\.0"),
        ("length_m", np.nan, r"length_m must be .* not nan"),
        ("length_m", "280", r"length_m must be .* not '280'"),
        ("bends", (5, 3), r"bends must be two .* the smaller first, not \(5, 3\)"),
        ("bends", (0, 3), r"bends must be two whole numbers from 2 to 100"),
        ("bends", 3, r"bends must be two .* not 3"),
        ("bends", (3, 3, 3), r"bends must be two .* not \(3, 3, 3\)"),
        ("width_m", (12.0, 7.0), r"width_m must be two numbers from 2 to 100, the smaller first, not \(12\.0, 7\.0\)"),
        ("width_m", (1.0, 7.0), r"width_m must be two numbers from 2 to 100"),
        ("width_m", (7.0, 7.1), r"width_m must differ by at least 0\.3 m, not \(7\.0, 7\.1\)"),
        ("bridges", -1, r"bridges must be a whole number from 0 to 100, not -1"),
        ("islands", -1, "islands must be"),
        ("tributaries", 1.5, "tributaries must be"),
        ("ponds", -2, "ponds must be"),
        ("depth_m", 0.0, r"depth_m must be a number from 0\.05 to 100, not 0\.0"),
        ("depth_variation", 1.5, "depth_variation must be a number from 0 to 0.95"),
        ("fall_m", -1.0, "fall_m must be"),
        ("cut_banks", 1.1, "cut_banks must be a number from 0 to 1, not 1.1"),
        ("hills_m", -3.0, "hills_m must be"),
        ("plant_density", np.inf, "plant_density must be"),
        ("default_seed", -1, r"default_seed must be a whole number of at least 0, not -1"),
        ("default_seed", 1.0, r"default_seed must be a whole number"),
    ],
)
def test_an_invalid_field_is_refused_with_its_limits_and_value(field, value, message):
    with pytest.raises(WorldError, match=rf"^level .*: {message}"):
        replace(LEVELS["Easy"], **{field: value})


@pytest.mark.parametrize("level", [3, 3.7, None, b"Easy"])
def test_a_level_that_is_neither_a_name_nor_a_level_is_refused(level):
    with pytest.raises(WorldError, match=r"a level is a name or a Level, not .*known: Easy, Medium, Hard"):
        build(level, 0)
    with pytest.raises(WorldError, match=r"a level is a name"):
        level_named(level)


@pytest.mark.parametrize("seed", [1.7, np.float64(2), "1", -1, np.int64(-3)])
def test_a_seed_that_is_no_whole_number_of_at_least_0_is_refused(seed):
    with pytest.raises(WorldError, match=r"a seed is (a whole number|0 or more), not"):
        build("Easy", seed)
