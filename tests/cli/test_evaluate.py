"""Tests of the encoder that `thalweg evaluate` looks through, and of how it takes actions."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from thalweg.cli.evaluate import Evaluate, _encoder_for, load_named_policy, sampling
from thalweg.cli.main import main
from thalweg.cli.options import UsageError
from thalweg.core.cache import file_hash
from thalweg.env import EnvConfig


@pytest.mark.parametrize("given", [None, Path("other.safetensors")], ids=["that of the run", "another one"])
def test_a_run_flies_through_the_encoder_that_it_was_trained_with(
    given: Path | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    own = tmp_path / "own.safetensors"
    own.write_bytes(b"content")
    context = {"encoder": file_hash(own), "encoder_file": str(own)}
    policy: Any = SimpleNamespace(about=SimpleNamespace(context=context), obs_size=16)
    loaded: list[Path | None] = []
    monkeypatch.setattr("thalweg.bench.evaluate.baselines.sight_of", lambda _: "frames")
    monkeypatch.setattr("thalweg.train.river.load_compatible_encoder", lambda path, _: loaded.append(path))
    monkeypatch.setattr("thalweg.train.observations.check_policy_fits", lambda *_, **__: None)
    _encoder_for(policy, Evaluate("run", encoder=given), EnvConfig())
    assert loaded == [given or own]


def test_the_packaged_policy_samples_if_asked_to():
    policy: Any = load_named_policy("packaged")
    sampled: Any = sampling(policy, "packaged")
    assert policy.greedy and policy.player(1).deterministic
    assert not sampled.player(1).deterministic and sampled.player(1, deterministic=True).deterministic


def test_a_policy_that_gives_one_action_has_none_to_sample():
    point: Any = SimpleNamespace(greedy=True, actions=SimpleNamespace(kind="point"))
    with pytest.raises(UsageError, match="--sample is for policies with probabilities of actions; runs/ddpg has none"):
        sampling(point, "runs/ddpg")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["hover", "--sample"], "--sample is for policies with probabilities of actions; hover has none"),
        (["packaged", "--sample", "--deterministic"], "give --sample or --deterministic, not both"),
        (["hover", "--encoder", "none"], "hover sees no frames: leave --encoder none out"),
        (["steady", "--encoder", "geometry"], "steady sees no frames: leave --encoder geometry out"),
    ],
)
def test_options_that_a_policy_does_not_take_are_refused(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["evaluate", *arguments]) == 2
    assert capsys.readouterr().err == f"thalweg: {message}\n"
