"""Costs by name, and limits that bind nothing."""

import pytest

from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError
from thalweg.algos.constraint.cost_limits import cost_suffixes, limit_warnings
from thalweg.algos.onpolicy.focops import FOCOPSConfig


def test_one_cost_has_no_name_two_are_tight_and_loose_and_more_are_counted():
    assert [cost_suffixes(count) for count in (1, 2, 3)] == [("",), ("_tight", "_loose"), ("_0", "_1", "_2")]


def test_a_limit_that_nothing_breaks_is_named_with_its_cost():
    found = limit_warnings((25.0, 0.5), feedback(0.5, 0.5))
    assert list(found) == ["limit_never_binds_tight"]
    said = "the tight cost limit 25 has not bound anything: none of 30 episodes cost more than 1"
    assert found["limit_never_binds_tight"].startswith(said)
    assert not limit_warnings((25.0, 0.5), feedback(0.5, 0.5, episodes=5))


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ((0.1,), r"cost_limits must be two, tight and loose, got \[0\.1\]"),
        ((0.1, 0.2, 0.3), r"cost_limits must be two, tight and loose, got \[0\.1, 0\.2, 0\.3\]"),
        ((0.1, -0.2), r"cost_limits\[1\] must be a finite number of at least 0, got -0\.2"),
    ],
)
def test_limits_of_separate_costs_must_be_two(limits: tuple[float, ...], words: str):
    with pytest.raises(AlgorithmError, match=words):
        FOCOPSConfig(cost_limits=limits)


def test_limits_of_separate_costs_replace_the_common_one():
    together, apart = FOCOPSConfig(cost_limit=0.3), FOCOPSConfig(cost_limit=0.3, cost_limits=(0.1, 0.2))
    assert (together.limits, together.separate_costs) == ((0.3,), False)
    assert (apart.limits, apart.separate_costs) == ((0.1, 0.2), True)
