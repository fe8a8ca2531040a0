"""Tests of the suggestion for a misspelt name."""

from thalweg.core.suggestion import did_you_mean


def test_the_closest_known_name_is_suggested_in_its_own_case():
    assert did_you_mean("foocops", ("PPO", "FOCOPS")) == " (did you mean 'FOCOPS'?)"


def test_nothing_is_suggested_where_no_name_is_close():
    assert did_you_mean("swamp", ("Easy", "Medium", "Hard")) == ""
