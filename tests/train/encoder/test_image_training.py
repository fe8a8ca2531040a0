"""Training of an autoencoder on frames of a river: what is refused or read before a frame is rendered."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.core import versions
from thalweg.encoder import EncoderFileError, TrainingResult, VAEConfig
from thalweg.encoder.files import read_tensors, write_tensors
from thalweg.encoder.training import ENCODER_FOLDER, resolve_precision
from thalweg.render import Camera
from thalweg.train.encoder import frames as frame_collection
from thalweg.train.encoder.drawing import Drawing
from thalweg.train.encoder.training import collect_and_train
from thalweg.world import Reach

CONFIG = VAEConfig(latent=4, size_px=48)


def train(folder: Path, **options: Any) -> TrainingResult:
    given: dict[str, Any] = {"level": "Easy", "images": 6, "held_out": 2, "epochs": 1, "command": "the first"}
    return collect_and_train(folder, CONFIG, **(given | options))


@pytest.fixture
def collected(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Noise in place of frames, and how many of them were asked for."""
    counts: list[int] = []

    def noise(count: int, **_: object) -> np.ndarray:
        counts.append(count)
        return np.random.default_rng(0).integers(256, size=(count, 48, 48, 4), dtype=np.uint8)

    monkeypatch.setattr(frame_collection, "collect_frames", noise)
    monkeypatch.setattr("thalweg.train.encoder.training.check_size_fits", lambda *_: None)
    return counts


def test_a_finished_training_is_read_and_its_file_stays_as_it_is(tmp_path: Path, collected: list[int]):
    first = train(tmp_path)
    content = first.path.read_bytes()
    again = train(tmp_path, command="another")
    assert collected == [8] and again.already_finished and not first.already_finished
    assert again.path.read_bytes() == content
    assert (again.train_mse, again.held_out_mse, again.rows) == (first.train_mse, first.held_out_mse, first.rows)
    first.path.unlink()  # as if it had been killed after its last epoch
    assert not train(tmp_path).already_finished and collected == [8, 8]


def test_a_finished_training_is_read_on_a_processor_of_another_precision_and_an_unfinished_one_refused(
    tmp_path: Path, collected: list[int], monkeypatch: pytest.MonkeyPatch
):
    first = train(tmp_path)
    other = {"float32": "bfloat16", "bfloat16": "float32"}[resolve_precision("auto")]
    monkeypatch.setattr("thalweg.train.encoder.training.resolve_precision", lambda _: other)
    assert train(tmp_path).already_finished and collected == [8]
    first.path.unlink()
    with pytest.raises(EncoderFileError, match=rf"precision is '\w+' there and '{other}' here"):
        train(tmp_path)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"level": "Hard"}, "level is 'Easy' there and 'Hard' here"),
        ({"world_seeds": "3"}, "world_seeds is absent there and .3. here"),
        ({"seed": 4}, "seed is 0 there and 4 here"),
    ],
)
def test_the_folder_of_another_training_is_refused_before_a_frame_is_rendered(
    options: dict[str, Any], told: str, tmp_path: Path, collected: list[int]
):
    train(tmp_path)
    with pytest.raises(EncoderFileError, match=f"belongs to another encoder training: {told}"):
        train(tmp_path, **options)
    assert collected == [8]


def test_another_reach_of_a_file_is_another_training(tmp_path: Path, collected: list[int]):
    file = tmp_path / "brook.geojson"
    file.write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0008, 48], [9.0016, 48.0003]]}')
    train(tmp_path / "run", level=Reach(file, width_m=9.0))
    assert train(tmp_path / "run", level=Reach(file, width_m=9.0)).already_finished
    with pytest.raises(EncoderFileError, match=r"river\.width_m is 9.0 there and 8.0 here"):
        train(tmp_path / "run", level=Reach(file, width_m=8.0))
    file.write_text(file.read_text().replace("9.0008", "9.0009"))
    with pytest.raises(EncoderFileError, match=r"river\.content"):
        train(tmp_path / "run", level=Reach(file, width_m=9.0))
    assert collected == [8]


def test_a_training_of_another_version_is_not_resumed(
    tmp_path: Path, collected: list[int], monkeypatch: pytest.MonkeyPatch
):
    train(tmp_path)
    checkpoint = tmp_path / "checkpoint.safetensors"
    monkeypatch.setattr(versions, "ENCODER", versions.ENCODER + 1)
    with pytest.raises(EncoderFileError, match=r"encoder_version is \d there and \d here"):
        train(tmp_path)
    tensors, about = read_tensors(checkpoint, "encoder training")
    for name in ("encoder_version", "level", "render_version", "world_version"):  # which earlier trainings lack
        del about["run"][name]
    write_tensors(checkpoint, tensors, about)
    assert train(tmp_path).already_finished and collected == [8]


def test_a_folder_that_another_process_holds_is_refused_before_a_frame_is_rendered(
    tmp_path: Path, collected: list[int]
):
    with ENCODER_FOLDER.locked(tmp_path), pytest.raises(EncoderFileError, match="another command is writing to"):
        train(tmp_path)
    assert collected == []


def test_a_folder_that_cannot_be_made_is_refused_before_a_frame_is_rendered(tmp_path: Path, collected: list[int]):
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError):
        train(tmp_path / "file" / "below")
    with pytest.raises(EncoderFileError, match="file is not a folder"):
        train(tmp_path / "file")
    assert collected == []


def test_the_size_of_a_code_has_a_limit():
    assert VAEConfig(latent=4096).latent == 4096
    with pytest.raises(ValueError, match="latent must be a whole number from 1 to 4096, got 1000000000"):
        VAEConfig(latent=10**9)


def test_frames_are_collected_as_the_settings_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked: dict[str, Any] = {}

    def noise(count: int, **given: Any) -> np.ndarray:
        asked.update(given, count=count)
        return np.random.default_rng(0).integers(256, size=(count, 48, 48, 4), dtype=np.uint8)

    monkeypatch.setattr(frame_collection, "collect_frames", noise)
    drawing = Drawing(Camera(48, 48), "fast", randomise=True)
    given: dict[str, Any] = {"level": "easy", "world_seeds": "3:5", "seed": 4, "drawing": drawing}
    collect_and_train(tmp_path, VAEConfig(latent=4, size_px=48), images=6, held_out=2, epochs=1, **given)
    assert asked == {
        "count": 8, "level": "Easy", "seed": 4, "world_seeds": (3, 4),
        "camera": drawing.camera, "quality": "fast", "randomisation": drawing.randomisation,
    }  # fmt: skip
