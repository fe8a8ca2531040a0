"""Tests of algorithms from outside the package: what is asked of them, and how they are looked up."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import pytest

from tests.plugins import EXAMPLE, install, no_plugins  # noqa: F401  (a fixture)
from thalweg.algos import ALGORITHMS, AlgorithmError, AlgorithmPlugin, algorithm_named
from thalweg.algos.onpolicy.ppo import PPO, PPOConfig
from thalweg.algos.registry import algorithm_names, installed_algorithm, plugin_named, version_of
from thalweg.core import versions
from thalweg.core.config import frozen_config
from thalweg.core.plugins.lookup import add_files
from thalweg.core.plugins.record import PluginError

pytestmark = pytest.mark.usefixtures("no_plugins")


@frozen_config(AlgorithmError)
class Bare:
    """A config that says nothing of rollouts."""

    steps: int = 1


@frozen_config(AlgorithmError)
class Needy(PPOConfig):
    """A config with a setting that has no default."""

    price: float = dataclasses.field(kw_only=True)


class NotChecked:
    """A class that is no config."""


def plugin(**changes: Any) -> AlgorithmPlugin:
    given = {"name": "Mine", "config": PPOConfig, "make": PPO, "about": "a test", "version": 1} | changes
    return AlgorithmPlugin(**given)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "ppo-2"}, "the name of the algorithm is 'ppo-2'; it must begin with a capital letter"),
        (
            {"name": "FOCOPs"},
            "the algorithm 'FOCOPS' comes with the package; give yours another name, such as MyFOCOPs",
        ),
        ({"version": 0}, "the algorithm Mine has the version 0; state version=1, and raise it when results change"),
        ({"config": NotChecked}, "it must be a class under @frozen_config(AlgorithmError)"),
        ({"config": PPOConfig()}, "it must be a class under @frozen_config(AlgorithmError)"),
        ({"config": Bare}, "Bare, the config of Mine, lacks frame_stack and rollout_steps; a run needs the field"),
        ({"config": Needy}, "Needy() fails (price is missing); give every setting of Mine a default"),
        ({"make": "PPO"}, "make of Mine is 'PPO'; it must be called as make(config, task)"),
    ],
)
def test_what_a_plugin_lacks_is_said(changes: dict[str, Any], words: str):
    assert plugin().version == 1
    with pytest.raises(PluginError, match=re.escape(words)):
        plugin(**changes)


def test_a_plugin_is_an_algorithm_with_the_version_that_it_states():
    with pytest.raises(AlgorithmError, match=r"there is no algorithm 'PricedPG'; there are PPO, .*, SafeLOOP$"):
        algorithm_named("PricedPG")
    assert (version_of("PricedPG"), installed_algorithm("PricedPG")) == (None, None)
    add_files([EXAMPLE])
    entry = algorithm_named("pricedpg")
    assert (entry.name, version_of("PricedPG"), version_of("pricedpg")) == ("PricedPG", 1, None)
    assert algorithm_names() == [*ALGORITHMS, "PricedPG"]
    assert entry.configure({"price": 3, "passes": 2}).price == 3.0
    with pytest.raises(AlgorithmError, match="unknown setting of PricedPG 'prize' \\(did you mean 'price'\\?\\)"):
        entry.configure({"prize": 3})
    with pytest.raises(AlgorithmError, match="PricedPG is not among the algorithms of the study"):
        entry.configure(None, "paper")
    found = plugin_named("PricedPG")
    assert found is not None and found.file == EXAMPLE


def test_algorithms_of_the_package_need_no_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    install(tmp_path, {"thalweg.algorithms": {"Broken": "nowhere_at_all:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert algorithm_named("PPO") is ALGORITHMS["PPO"]
    assert version_of("PPO") == versions.ALGORITHMS["PPO"]
    assert installed_algorithm("Broken") is None
    with pytest.raises(AlgorithmError, match=r"there are PPO, .*, SafeLOOP, Broken"):
        algorithm_named("Unknown")
    with pytest.raises(PluginError, match=r"the entry point 'Broken' of mine 1\.0"):
        algorithm_named("Broken")
