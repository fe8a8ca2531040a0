"""Tests of runs of algorithms from outside the package: what they bear, and what a changed source means."""

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.plugins import EXAMPLE, no_plugins  # noqa: F401  (a fixture)
from tests.train.small_runs import Stop, StopsAt, numbers
from tests.train.toys import Walk
from thalweg.algos import AlgorithmError
from thalweg.algos.policy.policy_file import LOADERS, About, save_policy
from thalweg.algos.registry import plugin_named
from thalweg.core.plugins.lookup import VARIABLE, add_files
from thalweg.core.plugins.record import PluginWarning
from thalweg.train import TrainingError, load_policy, run

pytestmark = pytest.mark.usefixtures("no_plugins")
SMALL = {"steps_per_update": 128, "minibatch": 64, "passes": 2, "hidden": (16,)}


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A copy of the example, which is used."""
    file = Path(shutil.copy(EXAMPLE, tmp_path / "mine.py"))
    add_files([file])
    return file


def train(folder: Path, env: Walk | None = None, algorithm: str = "PricedPG") -> Any:
    given: dict[str, Any] = {"steps": 600, "seed": 1, "config": SMALL, "checkpoint_seconds": 0.0}
    return run(algorithm, env or Walk(), folder=folder, **given)


def test_config_and_policy_bear_version_and_source(mine: Path, tmp_path: Path):
    result = train(tmp_path / "run")
    plugin = plugin_named("PricedPG")
    assert plugin is not None
    bears = {"version": 1, "source": plugin.source}
    assert result.steps == 600 and result.algorithm == "PricedPG"
    assert yaml.safe_load((tmp_path / "run" / "config.yaml").read_text())["run"]["context"]["plugin"] == bears
    assert load_policy(tmp_path / "run").about.context["plugin"] == bears
    train(tmp_path / "ppo", algorithm="PPO")
    assert "plugin" not in load_policy(tmp_path / "ppo").about.context


def test_a_resumed_run_of_the_same_source_ends_with_the_same_numbers(mine: Path, tmp_path: Path):
    train(tmp_path / "whole")
    with pytest.raises(Stop):
        train(tmp_path / "parts", StopsAt(100))
    assert train(tmp_path / "parts").resumed_from
    assert numbers(tmp_path / "parts") == numbers(tmp_path / "whole")


def test_a_changed_source_under_the_same_version_is_a_warning_and_a_new_version_is_another_run(
    mine: Path, tmp_path: Path
):
    with pytest.raises(Stop):
        train(tmp_path / "run", StopsAt(100))
    mine.write_text(mine.read_text() + "CHANGED = True\n")
    words = (
        r"the source of PricedPG has changed since .*run was made \(its hash was \w{16}, and is \w{16} now\), but its"
    )
    with pytest.warns(PluginWarning, match=words):
        assert train(tmp_path / "run").resumed_from
    mine.write_text(mine.read_text().replace("version=1", "version=2"))
    with pytest.raises(TrainingError, match=re.escape("context.plugin.version is 1 there and 2 here")):
        train(tmp_path / "run")


def test_a_policy_of_a_kind_of_its_own_is_loaded_by_its_plugin_alone(
    mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    loader = 'LOADERS["tabular"] = lambda header, tensors, about, generator: (about.algorithm, len(tensors))\n'
    mine.write_text(f"{mine.read_text()}from thalweg.algos.policy.policy_file import LOADERS\n{loader}")
    monkeypatch.delitem(LOADERS, "tabular", raising=False)
    file = tmp_path / "policy.safetensors"
    save_policy(file, {"kind": "tabular"}, {"table": np.zeros(3)}, About("PricedPG"))
    monkeypatch.setenv(VARIABLE, "")
    with pytest.raises(AlgorithmError, match="of the kind 'tabular', of the algorithm 'PricedPG', which does not come"):
        load_policy(file)
    add_files([mine])
    assert load_policy(file) == ("PricedPG", 1)
    LOADERS.pop("tabular")
