"""Tests that behaviour does not change without its version, and that failures say what to do."""

from dataclasses import replace

import numpy as np
import pytest

from tests.golden import store
from tests.golden.traces import CONSTRAINED, GOLDENS, LIMITS, OF_LIMITS
from thalweg.algos import ALGORITHMS
from thalweg.core import versions


@pytest.mark.parametrize("name", GOLDENS)
def test_behaviour_is_that_of_its_version(name: str):
    assert not store.problem(name, GOLDENS[name], store.load(name), GOLDENS[name].trace())


def test_every_algorithm_and_every_version_is_guarded():
    assert set(versions.ALGORITHMS) == set(ALGORITHMS)
    constants = {name for name in vars(versions) if name.isupper() and name != "ALGORITHMS"}
    assert constants == {golden.version_name for golden in GOLDENS.values() if "ALGORITHMS" not in golden.version_name}


@pytest.mark.parametrize("name", [f"{name} above {limits}" for name in CONSTRAINED for limits in LIMITS])
def test_limits_that_are_exceeded_are_at_work_in_the_kept_traces(name: str):
    """Where no multiplier is above 0 and no constraint binds, a trace does not depend on how costs are learnt from."""
    values = store.load(name)["values"]
    at_work = [values[metric] for metric in OF_LIMITS if metric in values]
    assert at_work and np.all(np.array(at_work) > 0)


@pytest.fixture
def kept() -> dict:
    values = {"poses": [[1.0, 2.0], [3.0, None]]}
    return {"version": 4, "exact": {}, "values": values}


RULES = replace(GOLDENS["rules"], version=4)
SAME = {"poses": np.array([[1.0, 2.0], [3.0, np.nan]])}
OTHER = {"poses": np.array([[1.0, 2.0], [3.03, np.nan]])}


def test_a_change_of_behaviour_says_which_version_to_raise(kept: dict):
    message = store.problem("rules", RULES, kept, OTHER)
    assert message.startswith("rules behaves differently (poses differs by up to 0.01 of its value), while RULES in")
    assert "is still 4" in message and message.endswith("python -m tests.golden.store --write rules")
    assert store.problem("rules", RULES, kept, SAME) == ""


def test_a_raised_version_asks_for_new_traces(kept: dict):
    message = store.problem("rules", replace(RULES, version=5), kept, OTHER)
    assert message.startswith("the golden trace of rules is of version 4, and RULES in thalweg/core/versions.py is 5")


def test_a_known_kind_of_machine_must_give_the_same_bits_and_another_the_same_numbers(kept: dict):
    nearly = {"poses": SAME["poses"] * (1 + 1e-12)}
    assert store.problem("rules", RULES, kept, nearly) == ""
    kept["exact"] = {store.machine_kind(): store.trace_hash(SAME)}
    assert "bits differ in a last digit" in store.problem("rules", RULES, kept, nearly)
    assert store.problem("rules", RULES, kept, SAME) == ""


@pytest.mark.parametrize(
    ("trace", "message"),
    [
        ({"poses": SAME["poses"][:1]}, r"poses had shape \[2, 2\] and has \[1, 2\]"),
        ({"routes": SAME["poses"]}, "its parts were poses and are routes"),
    ],
)
def test_a_trace_of_another_shape_is_no_match(kept: dict, trace: dict, message: str):
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(store.problem("rules", RULES, kept, trace))


def test_changed_behaviour_is_not_written_over_the_same_version(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(store, "FOLDER", tmp_path)
    traces = [SAME]
    monkeypatch.setattr(store, "GOLDENS", {"rules": replace(RULES, function=lambda: traces[-1])})
    assert store.main(["rules", "--write"]) is None
    before = store.path_of("rules").read_text()
    traces.append(OTHER)
    assert "behaves differently" in str(store.main(["rules", "--write"]))
    assert store.path_of("rules").read_text() == before
    monkeypatch.setattr(store, "GOLDENS", {"rules": replace(RULES, version=5, function=lambda: OTHER)})
    assert store.main(["rules", "--write"]) is None
    assert store.load("rules")["version"] == 5 and store.main([]) is None


def test_a_number_that_became_nan_is_a_change():
    kept = {"version": 4, "exact": {}, "values": {"poses": [0.0, 1.0]}}
    assert "NaN in other places" in store.problem("rules", RULES, kept, {"poses": np.array([np.nan, 1.0])})
