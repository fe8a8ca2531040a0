"""The hash of settings by which rows of benchmarks are told apart."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

from thalweg.algos.offpolicy.td3lag import TD3LagConfig
from thalweg.algos.onpolicy.config import NaturalConfig
from thalweg.algos.planning.ccepets import CCEPETSConfig
from thalweg.core.config import to_plain


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    return importlib.import_module("settings_hash")


def test_other_values_give_another_hash_and_added_settings_count_once_they_are_changed(script: ModuleType):
    early = {"discount": 0.99}
    assert script.settings_hash(early) != script.settings_hash({"discount": 0.9})
    assert script.settings_hash(early | {"imitation_kl": 0.0}) == script.settings_hash(early)
    assert script.settings_hash(early | {"imitation_kl": 1.0}) != script.settings_hash(early)
    assert script.settings_hash(early | {"cost_scale": "step"}) == script.settings_hash(early)
    assert script.settings_hash(early | {"cost_scale": "limit"}) != script.settings_hash(early)


def test_the_added_settings_have_their_defaults(script: ModuleType):
    defaults = to_plain(NaturalConfig())
    assert {name: defaults[name] for name in script.ADDED} == dict(script.ADDED)
    planner = to_plain(CCEPETSConfig())
    assert {name: planner[name] for name in script.ADDED_TO_PLANNERS} == dict(script.ADDED_TO_PLANNERS)
    off_policy = to_plain(TD3LagConfig())
    assert {name: off_policy[name] for name in script.ADDED_OFF_POLICY} == dict(script.ADDED_OFF_POLICY)


def test_bounds_of_returns_were_added_to_planners_alone(script: ModuleType):
    early = {"planning_discount": 0.97}
    assert script.settings_hash(early | {"return_bounds": []}) == script.settings_hash(early)
    assert script.settings_hash(early | {"return_bounds": [0.0, 1.0]}) != script.settings_hash(early)
    assert script.settings_hash({"return_bounds": []}) != script.settings_hash({})
