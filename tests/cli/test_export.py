"""Tests of `thalweg export` on the command line."""

from pathlib import Path

import pytest

from thalweg.cli.main import main
from thalweg.deploy.onnx_policy import OnnxPolicy


def test_the_packaged_policy_is_exported(tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "policy.onnx"
    assert main(["export", "--out", str(out)]) == 0
    told = capsys.readouterr()
    assert "takes image, mask, fresh, memory, last_action of 128 x 128 pixels, 60 degrees" in told.out
    assert told.err == ""
    assert OnnxPolicy.load(out).about["name"] == "packaged"


def test_the_packaged_policy_of_the_image_alone_is_exported_without_a_mask(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    out = tmp_path / "policy.onnx"
    assert main(["export", "packaged-rgb", "--out", str(out)]) == 0
    assert "takes image, fresh, memory, last_action of 128 x 128 pixels" in capsys.readouterr().out
    assert OnnxPolicy.load(out).about["name"] == "packaged-rgb"


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--out", "policy.pt"], "--out must end in .onnx, not 'policy.pt'"),
        (["pilot"], "Pilot is no trained network: only networks can be exported"),
        (["missing"], "a policy file, or one of: packaged, packaged-rgb"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    options: list[str], error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(tmp_path)
    assert main(["export", *options]) == 2
    assert error in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
