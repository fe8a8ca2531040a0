"""The levels as data, and how they are found by name."""

from dataclasses import replace

import pytest

from thalweg.world import LEVELS, WorldError, level_named


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
