"""Tests of the suggestion for a misspelt name."""

import pytest

from thalweg.core.suggestion import did_you_mean


def test_the_closest_known_name_is_suggested_in_its_own_case():
    assert did_you_mean("foocops", ("PPO", "FOCOPS")) == " (did you mean 'FOCOPS'?)"


def test_nothing_is_suggested_where_no_name_is_close():
    assert did_you_mean("swamp", ("Easy", "Medium", "Hard")) == ""


def test_a_name_that_shares_only_an_ending_is_not_suggested():
    assert did_you_mean("TRPO", ("PPO", "OnCRPO", "CPO", "P3O", "SACLag")) == ""


@pytest.mark.parametrize(("name", "meant"), [("hrad", "Hard"), ("Esay", "Easy"), ("mediums", "Medium")])
def test_swapped_and_added_letters_are_near(name: str, meant: str):
    assert did_you_mean(name, ("Easy", "Medium", "Hard")) == f" (did you mean {meant!r}?)"


def test_a_part_of_one_name_suggests_the_whole_and_a_part_of_several_nothing():
    known = ("DDPGLag", "TD3Lag", "SACLag", "SafeLOOP")
    assert did_you_mean("sac", known) == " (did you mean 'SACLag'?)"
    assert did_you_mean("loop", known) == " (did you mean 'SafeLOOP'?)"
    assert did_you_mean("lag", known) == ""


def test_one_wrong_letter_of_three_is_near_to_just_one_name():
    known = ("PPO", "P3O", "CPO", "CUP")
    assert did_you_mean("PP0", known) == " (did you mean 'PPO'?)"
    assert did_you_mean("PXO", known) == ""
