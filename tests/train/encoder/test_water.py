"""Tests of the training of the finder of water."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.cli.main import main
from thalweg.core import versions
from thalweg.encoder import EncoderFileError, EncoderInputError
from thalweg.encoder.files import read_tensors, write_tensors
from thalweg.encoder.water import load_segmenter
from thalweg.render import Camera
from thalweg.train.encoder import grounds, water
from thalweg.train.encoder.water import WATER_FOLDER, WaterTraining, varied


def training(folder: Path, epochs: int = 2, **changes: int) -> WaterTraining:
    settings: dict[str, Any] = {"images": 8, "held_out": 4, **changes}
    settings |= {"world_seeds": (1000,), "held_out_seeds": (1001,)}
    return WaterTraining(folder, levels=("Easy",), epochs=epochs, **settings)


def test_the_row_that_a_killed_process_did_not_write_is_written_after_resuming(tmp_path: Path, drawn: list[int]):
    training(tmp_path).run(progress=False)
    whole = (tmp_path / "metrics.csv").read_text()
    (tmp_path / "metrics.csv").write_text("".join(whole.splitlines(keepends=True)[:-1]))
    training(tmp_path).run(progress=False)
    assert (tmp_path / "metrics.csv").read_text() == whole


def test_varied_frames_keep_water_under_its_colours():
    frames = np.zeros((6, 32, 32, 4), np.uint8)
    frames[:, 16:, :, 2:] = 255  # blue where there is water
    colours, water = varied(frames, np.random.default_rng(0))
    assert colours.shape == (6, 3, 32, 32) and 0.1 < float(water.mean()) < 0.9
    inner = (colours[:, 2] < 0.2) | (colours[:, 2] > 0.7)  # edges are mixed
    np.testing.assert_array_equal(np.asarray(colours[:, 2] > 0.5)[inner], np.asarray(water > 0)[inner])


def test_the_learning_rate_falls_along_a_half_cosine_to_its_least(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: list[int]
):
    real, found = water._State.epoch, []

    def epoch(self: Any, *given: Any) -> Any:
        row = real(self, *given)
        found.append((row["learning_rate"], self.optimizer.param_groups[0]["lr"]))
        return row

    monkeypatch.setattr(water._State, "epoch", epoch)
    training(tmp_path, epochs=12, images=4).run()
    shares = 0.5 * (1.0 + np.cos(np.pi * np.arange(12) / 12))
    expected = water.RATE * np.maximum(shares, water.LEAST_RATE)
    assert shares[-1] < water.LEAST_RATE < shares[-2]
    assert np.array(found) == pytest.approx(np.stack([expected, expected], -1))


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Frames without a river in place of those of the renderer, and the seeds by which they are drawn."""
    seeds: list[int] = []

    def noise(_: object, count: int, seed: int) -> np.ndarray:
        seeds.append(seed)
        frames = np.random.default_rng(seed).integers(256, size=(count, 32, 32, 4), dtype=np.uint8)
        frames[..., 3] = np.where(frames[..., 2] > 127, 255, 0)
        return frames

    monkeypatch.setattr(grounds, "load_or_build", lambda *_: None)
    monkeypatch.setattr(water, "Renderer", lambda worlds, camera, quality: worlds)
    monkeypatch.setattr(water, "draw", noise)
    return seeds


def interrupt_in_epoch(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    real = water._State.epoch

    def epoch(self: Any, frames: np.ndarray, held_out: np.ndarray, epoch: int, epochs: int) -> Any:
        if epoch == number:
            raise KeyboardInterrupt
        return real(self, frames, held_out, epoch, epochs)

    monkeypatch.setattr(water._State, "epoch", epoch)


def test_a_training_that_was_interrupted_ends_with_the_same_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: list[int]
):
    whole = training(tmp_path / "whole").run(progress=False)
    assert 0.0 <= whole.iou <= 1.0 and load_segmenter(whole.path) is not None
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        interrupt_in_epoch(1, patched)
        training(tmp_path / "cut").run(progress=False)
    resumed = training(tmp_path / "cut").run(progress=False)
    assert resumed.iou == whole.iou and resumed.path.read_bytes() == whole.path.read_bytes()
    with pytest.raises(EncoderFileError, match=r"camera is absent there and present here"):
        replace(training(tmp_path / "cut"), camera=Camera(fov_deg=75)).run(progress=False)
    with pytest.raises(EncoderFileError, match="quality is absent there and 'fast' here"):
        replace(training(tmp_path / "cut"), quality="fast").run(progress=False)
    with pytest.raises(EncoderFileError, match="seed is 0 there and 1 here"):
        training(tmp_path / "cut", seed=1).run(progress=False)


@pytest.mark.parametrize("lost", [False, True], ids=["complete", "without its file"])
def test_a_finished_training_is_read_and_nothing_is_drawn(lost: bool, tmp_path: Path, drawn: list[int]):
    first = training(tmp_path / "run").run(progress=False)
    content, time = first.path.read_bytes(), first.path.stat().st_mtime_ns
    assert len(drawn) == 3  # those held out, and those of two epochs
    drawn.clear()
    if lost:  # as if it had been killed after its last epoch
        first.path.unlink()
    again = training(tmp_path / "run").run(progress=False)
    assert drawn == [] and again.iou == first.iou
    assert again.already_finished is not lost and again.path.read_bytes() == content
    assert lost or again.path.stat().st_mtime_ns == time


@pytest.mark.parametrize("raised", ["ENCODER", "WORLD"])
def test_a_training_of_another_version_is_not_resumed(
    raised: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: list[int]
):
    training(tmp_path).run(progress=False)
    monkeypatch.setattr(versions, raised, getattr(versions, raised) + 1)
    with pytest.raises(EncoderFileError, match=rf"{raised.lower()}_version is \d there and \d here"):
        training(tmp_path).run(progress=False)


def test_a_checkpoint_of_another_run_that_came_while_the_lock_was_waited_for_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: list[int]
):
    training(tmp_path, epochs=1).run(progress=False)
    monkeypatch.setattr(water, "check_folder", lambda *_: None)  # the folder was new when it was looked at
    with pytest.raises(EncoderFileError, match="epochs is 1 there and 2 here"):
        training(tmp_path).run(progress=False)


def test_a_checkpoint_whose_last_epoch_has_no_measurement_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: list[int]
):
    training(tmp_path / "run").run(progress=False)
    path = tmp_path / "run" / "checkpoint.safetensors"
    tensors, about = read_tensors(path, water.KIND)
    about["rows"][-1]["held_out_iou"] = None
    write_tensors(path, tensors, about)
    with pytest.raises(EncoderFileError, match=r"checkpoint\.safetensors: its last epoch has no held_out_iou"):
        training(tmp_path / "run").run(progress=False)


def test_the_command_trains_and_says_from_where_it_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, drawn: list[int]
):
    numbers = ["--images", "8", "--held-out", "4", "--epochs", "2", "--level", "easy", "--world-seeds", "5"]
    command = ["encoder", "train", "--target", "water", *numbers, "--out", str(tmp_path / "run")]
    with monkeypatch.context() as patched:
        interrupt_in_epoch(1, patched)
        assert main(command) == 130
    assert "The same command resumes from the last checkpoint." in capsys.readouterr().err
    for told in ("resumes after epoch 1 of 2.", "was finished before; nothing was trained."):
        assert main(command) == 0
        printed = capsys.readouterr()
        assert f"{tmp_path / 'run'} {told}" in printed.err.splitlines()  # with the bar of progress among them
        (line,) = printed.out.splitlines()
        assert line.startswith(f"{tmp_path / 'run' / 'water.safetensors'}: IoU of water 0.")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--architecture", "paper"], "--architecture does not go with --target water"),
        (["--inputs", "mask"], "--inputs does not go with --target water"),
        (["--river", "a.gpx"], "a.gpx: "),
        (["--river", "a.gpx", "--level", "easy"], "give --level or --river, not both: easy and a.gpx"),
        (["--start-m", "5"], "--start-m goes with --river"),
        (["--banks", "meadow"], "give levels with their banks, such as --level Medium+meadow"),
        (["--randomise"], "--target water is learnt under varied looks in any case: leave --randomise out"),
        (["--camera", "height_px=100"], "multiples of 16 for a finder of water, not 100 and 128"),
        (["--latent", "8"], "--latent does not go with --target water"),
        (["--world-seeds", ""], "--world-seeds needs at least one seed"),
        (["--level", "medum"], "unknown level 'medum' (did you mean 'Medium'?)"),
        (["--epochs", "0"], "--epochs must be at least 1, not 0"),
    ],
)
def test_options_that_do_not_fit_are_refused_by_name(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture
):
    assert main(["encoder", "train", "--target", "water", "--out", str(tmp_path / "run"), *options]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_numbers_and_seeds_that_do_not_fit_are_refused(tmp_path: Path):
    with pytest.raises(EncoderInputError, match="images must be at least 1, not 0"):
        training(tmp_path / "run", images=0).run()
    with pytest.raises(EncoderInputError, match="seed must be 0 or more, not -1"):
        training(tmp_path / "run", seed=-1).run()
    with pytest.raises(EncoderInputError, match="1000 is in both"):
        WaterTraining(tmp_path / "run", held_out_seeds=(1000,)).run()
    assert not (tmp_path / "run").exists()


def test_a_folder_in_which_another_process_trains_is_refused(tmp_path: Path, drawn: list[int]):
    with WATER_FOLDER.locked(tmp_path), pytest.raises(EncoderFileError, match="another command is writing to"):
        training(tmp_path).run(progress=False)
    assert drawn == []


def test_each_epoch_has_frames_of_its_own_and_so_has_the_judging(tmp_path: Path, drawn: list[int]):
    training(tmp_path, epochs=3, images=4).run(progress=False)
    assert len(set(drawn)) == 4
