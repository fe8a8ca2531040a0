"""Tests of the encoder that `thalweg evaluate` looks through."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from thalweg.cli.evaluate import Evaluate, _encoder_for
from thalweg.core.cache import file_hash


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
    monkeypatch.setattr("thalweg.train.river.check_policy_fits", lambda *_: None)
    _encoder_for(policy, Evaluate("run", encoder=given))
    assert loaded == [given or own]
