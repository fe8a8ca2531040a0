"""Tests of runs whose encoder is from outside the package: what they bear, and what evaluation asks for."""

from pathlib import Path

import pytest
import yaml

from tests.encoder.test_plugin import SQUARES
from tests.plugins import no_plugins  # noqa: F401  (a fixture)
from thalweg.bench.results.run_versions import current_sources, current_versions
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite
from thalweg.core.plugins.lookup import VARIABLE, add_files
from thalweg.core.plugins.record import PluginWarning
from thalweg.encoder import PluginEncoder
from thalweg.train import TrainingError, load_policy
from thalweg.train.encoder_of_run import encoder_of
from thalweg.train.observations import check_policy_fits
from thalweg.train.river import RiverTraining, load_compatible_encoder

pytestmark = pytest.mark.usefixtures("no_plugins")
SMALL = {"steps_per_update": 16, "minibatch": 16, "passes": 1, "hidden": (8,)}


def write(file: Path, text: str = SQUARES) -> Path:
    file.write_text(text)
    add_files([file])
    return file


def train(folder: Path) -> None:
    encoder = load_compatible_encoder("squares")
    assert isinstance(encoder, PluginEncoder)
    RiverTraining("Easy", 2).train("PPO", encoder, steps=32, seed=0, folder=folder, settings=SMALL)


@pytest.mark.slow
def test_a_policy_knows_its_encoder_by_name_and_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = write(tmp_path / "squares.py")
    train(tmp_path / "run")
    context = yaml.safe_load((tmp_path / "run" / "config.yaml").read_text())["run"]["context"]
    assert context["encoder"] == "squares 1"
    assert context["encoder_plugin"] == {"version": 1, "source": current_sources(["squares"])["squares"]}
    policy = load_policy(tmp_path / "run")
    assert encoder_of(policy) == Path("squares")
    check_policy_fits(policy, load_compatible_encoder("squares"))
    write(file, SQUARES + "CHANGED = 1\n")
    with pytest.warns(PluginWarning, match="the source of squares has changed"):
        train(tmp_path / "run")
    write(file, SQUARES.replace("version=1", "version=2"))
    with pytest.raises(TrainingError, match="on the codes of the encoder 'squares' of a plug-in, version 1, but"):
        check_policy_fits(policy, load_compatible_encoder("squares"))
    monkeypatch.setenv(VARIABLE, "")
    with pytest.raises(
        TrainingError, match="the encoder 'squares' of a plug-in, version 1, which is not here: give its"
    ):
        encoder_of(policy)


def test_a_suite_depends_on_the_version_of_the_encoder_that_it_names(tmp_path: Path):
    with pytest.raises(ValueError, match="unknown encoder 'squares'; known: default, geometry"):
        Suite("mine", (Arm("PPO"),), encoder="squares")
    write(tmp_path / "squares.py")
    suite = Suite("mine", (Arm("PPO"),), encoder="squares")
    assert suite.plugins_of(Run("train", "PPO", 0)) == ["PPO", "squares", "River"]
    assert set(current_sources(suite.plugins_of(Run("train", "PPO", 0)))) == {"squares"}
    assert current_versions("train", ["PPO"], encoder="squares")["squares"] == 1
