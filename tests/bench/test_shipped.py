"""Tests that all that comes with the package fits together, and that a suite on it survives a kill."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from thalweg.bench.packaged import PACKAGED, PACKAGED_POLICIES, PACKAGED_RGB, PACKAGED_SEES
from thalweg.bench.suite.priced import LIMITS
from thalweg.encoder import DEFAULT_PATH, GeometryConfig
from thalweg.encoder import PACKAGED as PACKAGED_ENCODERS
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import RENDER_VERSION
from thalweg.train import load_policy
from thalweg.train.encoder.targets import targets_of
from thalweg.train.observations import check_policy_fits, observation_of
from thalweg.train.river import load_compatible_encoder

ROOT = Path(__file__).resolve().parents[2]
NEVER = 1_000_000


def test_the_encoder_of_geometry_fits_the_renderer_and_the_ideal_eye():
    encoder = load_compatible_encoder("geometry")
    assert encoder.about["path"] == str(PACKAGED_ENCODERS["geometry"])
    assert isinstance(encoder.config, GeometryConfig) and encoder.config.targets == FEATURES
    assert (encoder.latent, encoder.inputs) == (32, "rgb+mask")
    assert PACKAGED_ENCODERS["geometry"].stat().st_size < 3.6e6


def test_the_encoder_of_geometry_of_the_tasks_predicts_what_they_show():
    encoder = load_compatible_encoder("geometry-tasks")
    assert isinstance(encoder.config, GeometryConfig) and encoder.config.targets == targets_of(("River", *LIMITS))
    assert (encoder.latent, encoder.inputs) == (32, "rgb+mask")
    assert PACKAGED_ENCODERS["geometry-tasks"].stat().st_size < 3.6e6


def test_the_encoder_of_the_package_fits_the_renderer():
    encoder = load_compatible_encoder()
    assert encoder.about["path"] == str(DEFAULT_PATH)
    assert (encoder.render_version, encoder.latent, encoder.inputs) == (RENDER_VERSION, 16, "rgb+mask")


@pytest.mark.parametrize(("name", "seen"), [(PACKAGED, PACKAGED_SEES), (PACKAGED_RGB, "rgb")])
def test_the_policies_of_the_package_see_images_of_the_renderer(name: str, seen: str):
    policy = load_policy(PACKAGED_POLICIES[name])
    check_policy_fits(policy, None)
    assert (observation_of(policy), policy.about.context["render_version"]) == (seen, RENDER_VERSION)


@pytest.mark.parametrize("name", PACKAGED_POLICIES)
def test_the_policies_of_the_package_name_the_command_that_made_them_and_their_scores(name: str):
    about = load_policy(PACKAGED_POLICIES[name]).about.context
    assert f" --observation {about['observation']} " in about["command"]
    assert about["command"].startswith("thalweg imitate ") and set(about["scores"]) == {"Easy", "Medium", "Hard"}


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not in a clone")
def test_of_results_what_is_large_is_not_committed_of_earlier_stages_either():
    runs = [f"benchmarks/protocols/runs/FOCOPS-curriculum-0{stage}" for stage in ("", "/.before/0", "/.before/1")]
    large = [f"{run}/{name}" for run in runs for name in ("checkpoints/1/state.json", "tensorboard/events")]
    kept = [f"{run}/{name}" for run in runs for name in ("config.yaml", "episodes.csv", "policy.safetensors")]
    asked = subprocess.run(["git", "check-ignore", *large, *kept], cwd=ROOT, capture_output=True, text=True)
    assert asked.stdout.split() == large


def suite(folder: Path, die_at: int) -> int:
    """Do the tiny suite in a process of its own; returns its exit status."""
    command = [sys.executable, "-m", "tests.bench.river_suite", str(folder), str(die_at)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, check=False).returncode


def tables(folder: Path) -> dict[str, str]:
    """Everything of a results folder that is a result, by name."""
    names = ("evaluation/FOCOPS-0-Easy.csv", "report/table.csv", "report/table.md", "runs/FOCOPS-0/episodes.csv")
    return {name: (folder / name).read_text() for name in (*names, "film.txt")}


@pytest.mark.slow
def test_a_suite_on_the_river_killed_in_the_midst_of_training_ends_with_the_same_tables(tmp_path: Path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert suite(whole, NEVER) == 0
    assert suite(broken, 3) == -9
    assert not (broken / "runs" / "FOCOPS-0" / "policy.safetensors").exists()
    assert len(list((broken / "runs" / "FOCOPS-0" / "checkpoints").glob("[0-9]*"))) == 1
    assert suite(broken, NEVER) == 0
    status = json.loads((broken / "runs" / "FOCOPS-0" / "status.json").read_text())
    assert (status["state"], status["steps"]) == ("finished", 512)
    assert tables(broken) == tables(whole)
    assert len(tables(whole)["evaluation/FOCOPS-0-Easy.csv"].splitlines()) == 3
