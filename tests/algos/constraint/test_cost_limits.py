"""Costs by name, and limits that bind nothing."""

from tests.algos.rollouts import feedback
from thalweg.algos.constraint.cost_limits import cost_suffixes, limit_warnings


def test_one_cost_has_no_name_two_are_tight_and_loose_and_more_are_counted():
    assert [cost_suffixes(count) for count in (1, 2, 3)] == [("",), ("_tight", "_loose"), ("_0", "_1", "_2")]


def test_a_limit_that_nothing_breaks_is_named_with_its_cost():
    found = limit_warnings((25.0, 0.5), feedback(0.5, 0.5))
    assert list(found) == ["limit_never_binds_tight"]
    said = "the tight cost limit 25 has not bound anything: none of 30 episodes cost more than 1"
    assert found["limit_never_binds_tight"].startswith(said)
    assert not limit_warnings((25.0, 0.5), feedback(0.5, 0.5, episodes=5))
