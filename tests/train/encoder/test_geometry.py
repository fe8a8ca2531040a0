"""Training of an encoder of geometry on rivers: its views, what is true of them, and what a run writes and refuses."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.cli.main import main
from thalweg.core import versions
from thalweg.core.compute import device
from thalweg.encoder import EncoderFileError, EncoderInputError, load_encoder
from thalweg.encoder.checkpoint import require_same_run
from thalweg.encoder.files import FORMAT, write_tensors
from thalweg.encoder.geometry import GeometryNetwork
from thalweg.encoder.geometry_training import GEOMETRY_FOLDER, KIND, write_geometry
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.privileged_state import privileged_state
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import RENDER_VERSION, Camera, Renderer
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.encoder import geometry
from thalweg.train.encoder.geometry import GeometryTraining, RiverLessons, geometry_config, half_mirrored
from thalweg.train.encoder.probe_table import probe_table
from thalweg.train.encoder.targets import targets_of
from thalweg.train.encoder.views import STRIDE, TARGETS, draw_views, flight_views, start_views
from thalweg.train.encoder_of_run import camera_of_encoder
from thalweg.world import World


@pytest.fixture(scope="module")
def rivers(easy_world: World, medium_world: World) -> RiverList:
    return RiverList([easy_world, medium_world])


def test_views_of_flights_are_of_all_rivers_in_turn_and_true(rivers: RiverList, medium_world: World):
    views = flight_views(rivers, 5, seed=3)
    assert views.river.tolist() == [0, 1] * 5 and views.truths.shape == (10, len(TARGETS))
    here = views.rows(views.river == 1)
    usual = np.abs(here.truths[:, FEATURES.index("heading error")]) < 1.3  # who looks across might fly either way
    assert usual.sum() >= 3
    np.testing.assert_allclose(privileged_state(medium_world, here.pose[usual]), here.truths[usual], atol=1e-4)
    moved = np.linalg.norm(np.diff(here.pose[:, :2], axis=0), axis=1)
    assert (moved > 0).all() and (moved <= STRIDE * 1.2).all(), "the first views are of one flight"
    for again, first in zip(flight_views(rivers, 5, seed=3), views, strict=True):
        assert np.array_equal(again, first)
    assert not np.array_equal(flight_views(rivers, 5, seed=4).pose, views.pose)


def test_views_of_starts_are_those_of_new_episodes(rivers: RiverList):
    views = start_views(rivers, 3, seed=3)
    assert views.river.tolist() == [0, 1] * 3
    assert len(np.unique(views.pose[:, 0])) == 6 and (views.time_s >= 0).all()
    assert np.degrees(np.abs(views.truths[:, FEATURES.index("heading error")])).max() <= 80.0 + 1e-3
    assert np.array_equal(flight_views(rivers, 1, seed=3).pose, views.rows(slice(2)).pose), "flights begin at starts"


@pytest.mark.slow
def test_views_are_drawn_as_the_renderer_draws_them(rivers: RiverList, easy_world: World, medium_world: World):
    views = start_views(rivers, 1, seed=3)
    env = RiverVectorEnv(rivers, 1, EnvConfig(randomisation=Randomisation.only(haze=(1.0, 1.0))))
    frames = draw_views(env, views, np.random.default_rng(0))
    env.close()
    plain = Renderer([easy_world, medium_world]).render(views.pose, views.river, views.time_s)
    assert np.array_equal(frames, plain)


def test_mirrored_frames_have_mirrored_truths():
    frames = np.arange(8 * 2 * 2 * 4, dtype=np.uint8).reshape(8, 2, 2, 4)
    truths = np.arange(8 * len(FEATURES), dtype=np.float32).reshape(8, -1)
    found = half_mirrored(frames, truths, np.random.default_rng(0))
    turned = (found.frames == frames[:, :, ::-1]).all(axis=(1, 2, 3))
    assert 0 < turned.sum() < 8
    left, right, error = (FEATURES.index(name) for name in ("left bank", "right bank", "heading error"))
    for row in range(8):
        same = not turned[row]
        assert np.array_equal(found.frames[row], frames[row] if same else frames[row, :, ::-1])
        assert found.truths[row, left] == truths[row, left if same else right]
        assert found.truths[row, error] == (1 if same else -1) * truths[row, error]


def run(folder: Path, **options: Any) -> GeometryTraining:
    given = {
        "config": geometry_config(hidden=8, latent=4, batch=8),
        "levels": ("Easy",),
        "world_seeds": (1,),
        "held_out_seeds": (2,),
        "views": 32,
        "images": 16,
        "passes": 1,
        "held_out": 16,
        "epochs": 2,
        "precision": "float32",
    }
    return GeometryTraining(folder, **(given | options))


@pytest.mark.slow
def test_a_run_writes_an_encoder_and_what_is_read_from_its_codes(tmp_path: Path):
    result = run(tmp_path).run(progress=False)
    encoder = load_encoder(result.path)
    assert encoder.render_version == RENDER_VERSION and encoder.latent == 4
    assert encoder.about["r_squared"]["flights"].keys() == set(TARGETS)
    with (tmp_path / "probe.csv").open() as file:
        rows = list(csv.DictReader(file))
    expected = [(name, kind) for name in ("geometry", "default") for kind in ("flights", "starts")]
    assert [(row["encoder"], row["views"]) for row in rows] == expected
    assert float(rows[0]["height"]) == pytest.approx(encoder.about["r_squared"]["flights"]["height"], abs=1e-4)
    assert len(result.lines) == 4 and result.lines[0].startswith("geometry, flights: left bank ")
    with pytest.raises(EncoderFileError, match="belongs to another geometry encoder training: passes is 1 there"):
        run(tmp_path, passes=2).run()


@pytest.mark.slow
def test_a_run_learns_the_frames_of_another_camera(tmp_path: Path):
    camera = Camera(48, 80, fov_deg=75.0)
    config = geometry_config(hidden=8, latent=4, batch=8, size_px=(48, 80))
    training = run(tmp_path, config=config, camera=camera)
    result = training.run(progress=False)
    encoder = load_encoder(result.path)
    assert encoder(np.zeros((1, 48, 80, 4), np.uint8)).shape == (1, 4)
    assert camera_of_encoder(encoder) == camera
    assert {name for name, _ in result.scores} == {"geometry"}, "the packaged encoder takes other frames"
    with pytest.raises(EncoderFileError, match=r"camera\.fov_deg is 75.0 there and 60.0 here"):
        replace(training, camera=Camera(48, 80)).run()


def test_what_is_in_view_depends_on_the_camera(rivers: RiverList):
    usual = flight_views(rivers, 6, 3, ("Swimmers",))
    wide = flight_views(rivers, 6, 3, ("Swimmers",), Camera(fov_deg=120.0))
    np.testing.assert_array_equal(usual.pose, wide.pose)
    row = targets_of(("Swimmers",)).index("swimmer in view distance")
    assert (wide.truths[:, row] <= usual.truths[:, row]).all() and (wide.truths != usual.truths).any()


SCORES = {("geometry", kind): np.linspace(0, 1, len(TARGETS)) for kind in ("flights", "starts")} | {
    ("default", "starts"): np.full(len(TARGETS), np.nan)
}


@pytest.fixture
def finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a finished training without its checkpoint, where nothing can be drawn."""
    training = run(tmp_path)
    write_geometry(tmp_path / "encoder.safetensors", GeometryNetwork(training.config), training._about)
    (tmp_path / "probe.csv").write_text(probe_table(SCORES))
    monkeypatch.setattr(GeometryTraining, "drawn", None)
    return tmp_path


def test_a_finished_run_is_read_and_nothing_is_drawn(finished: Path):
    result = run(finished).run()
    assert result.already_finished and list(result.scores) == list(SCORES)
    for key, wanted in SCORES.items():
        np.testing.assert_allclose(result.scores[key], wanted, atol=5e-5)


def test_a_finished_run_needs_no_device(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(device, "cuda_unavailable_reason", lambda index=0: "no GPU here")
    assert run(finished, device="cuda").run().already_finished
    with pytest.raises(device.DeviceError, match="no GPU here"):
        run(tmp_path / "new", device="cuda").run()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"passes": 2}, "passes is 1 there and 2 here"),
        ({"seed": 7}, "seed is 0 there and 7 here"),
        ({"config": geometry_config(hidden=8, latent=5, batch=8)}, "config.latent is 4 there and 5 here"),
        ({"camera": Camera(pitch_deg=10.0)}, "camera is absent there and present here"),
        ({"quality": "full"}, "quality is 'fast' there and 'full' here"),
    ],
)
def test_a_finished_folder_without_its_checkpoint_is_refused_for_other_settings(
    options: dict[str, Any], told: str, finished: Path
):
    with pytest.raises(EncoderFileError, match=f"belongs to another geometry encoder training: {told}"):
        replace(run(finished), **options).run()


@pytest.mark.parametrize("raised", ["ENCODER", "STEADY", "PRIVILEGED", "RULES", "WORLD"])
def test_a_folder_of_another_version_is_refused(raised: str, finished: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(versions, raised, getattr(versions, raised) + 1)
    with pytest.raises(EncoderFileError, match=rf"{raised.lower()}_version is \d there and \d here"):
        run(finished).run()


def test_a_training_is_refused_on_another_kind_of_device_and_with_another_precision(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    training = run(tmp_path)
    monkeypatch.setattr(GeometryTraining, "drawn", None)
    begun = {**training._run, "precision": "float32", "device": "cuda"}
    write_tensors(tmp_path / "checkpoint.safetensors", {}, {"kind": KIND, "format": FORMAT, "run": begun, "rows": []})
    with pytest.raises(EncoderFileError, match="device is 'cuda' there and 'cpu' here"):
        training.run()
    training._check_folder(tmp_path / "encoder.safetensors")  # as that of a finished training, which needs no device
    resume = {"folder": tmp_path, "kind": GEOMETRY_FOLDER, "recorded": begun}
    require_same_run(run={**training._run, **training._learns("cuda"), "precision": "float32"}, **resume)
    begun.pop("device")
    write_tensors(tmp_path / "checkpoint.safetensors", {}, {"kind": KIND, "format": FORMAT, "run": begun, "rows": []})
    with pytest.raises(EncoderFileError, match="precision is 'float32' there and 'bfloat16' here"):
        replace(training, precision="bfloat16").run()


@pytest.mark.parametrize(("count", "sizes"), [(16, [8, 8]), (17, [8, 9]), (18, [8, 8, 2])])
def test_no_frame_is_drawn_alone(count: int, sizes: list[int], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(geometry, "CHUNK", 8)
    taken: list[int] = []

    class Views:
        river = np.zeros(5)

        def rows(self, chosen: np.ndarray) -> "Views":
            taken.append(len(chosen))
            return self

    lessons = object.__new__(RiverLessons)
    lessons.views = Views()  # pyright: ignore[reportAttributeAccessIssue]
    assert len(list(lessons._chosen(count, np.random.default_rng(0)))) == len(sizes) and taken == sizes


def test_damaged_files_of_a_finished_run_are_named(finished: Path):
    (finished / "probe.csv").write_text("encoder,views\ngeometry,flights\n")
    with pytest.raises(EncoderFileError, match=r"probe\.csv: not the table of a training of geometry"):
        run(finished).run()
    (finished / "encoder.safetensors").write_bytes(b"")
    with pytest.raises(EncoderFileError, match=r"encoder\.safetensors: truncated, damaged or not a safetensors file"):
        run(finished).run()


def test_the_command_says_that_a_run_was_finished_before(finished: Path, capsys: pytest.CaptureFixture):
    training = run(finished, views=96, images=4096, passes=4, held_out=1024, epochs=16)
    training = replace(training, config=geometry_config())
    write_geometry(finished / "encoder.safetensors", GeometryNetwork(training.config), training._about)
    given = ["--level", "Easy", "--world-seeds", "1", "--held-out-seeds", "2", "--out", str(finished)]
    assert main(["encoder", "train", "--target", "geometry", *given]) == 0
    printed = capsys.readouterr()
    assert printed.err == f"{finished} was finished before; nothing was trained.\n"
    assert printed.out.startswith(f"{finished / 'encoder.safetensors'}, judged on rivers held out")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"held_out_seeds": "1:3"}, "world_seeds and held_out_seeds share 1: codes are judged on other rivers"),
        ({"levels": ("Easy", "easy")}, "levels must be at least one, each once, not Easy, Easy"),
        ({"camera": Camera(96, 160)}, "frames of 96 x 160 pixels .*, but the encoder that is trained takes 128 x 128"),
        ({"images": 8}, "images must be at least 16, not 8"),
        ({"epochs": 0}, "epochs must be at least 1, not 0"),
        ({"seed": -1}, "seed must be 0 or more, not -1"),
        ({"world_seeds": ()}, "world_seeds needs at least one seed"),
        ({"held_out_seeds": ""}, "held_out_seeds needs at least one seed"),
        ({"world_seeds": "5:5"}, "world_seeds: 5:5 holds no seed"),
    ],
)
def test_wrong_settings_are_refused_before_anything_is_drawn(
    options: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(GeometryTraining, "drawn", None)
    with pytest.raises(EncoderInputError, match=message):
        run(tmp_path / "new", **options).run()
    assert not (tmp_path / "new").exists()


def test_a_folder_in_which_another_process_trains_is_refused(tmp_path: Path):
    with GEOMETRY_FOLDER.locked(tmp_path), pytest.raises(EncoderFileError, match="another command is writing to"):
        run(tmp_path).run(progress=False)
    assert list(tmp_path.iterdir()) == []
