"""Tests of data sets of LeRobot, against the layout of version 3.0 as LeRobot 0.4 documents and reads it.

LeRobot needs another version of torch than this project pins: tests/interop/test_lerobot.py reads data sets by itself.
"""

import errno
import io
import json
from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pandas
import pyarrow.parquet
import pytest
from PIL import Image

from tests.datasets.episodes import ABOUT, SIZE, assert_same, flight, without
from thalweg.datasets import lerobot_layout
from thalweg.datasets.episode import check_episode
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.lerobot_statistics import PictureCounts, of_numbers, together
from thalweg.datasets.recordings import add_flight, read_recordings, recording

FLIGHTS = [flight(3), flight(5, seed=1, ended=False)]
CAMERA = "observation.images.camera"


def write(folder: Path, *, video: bool = False) -> Path:
    with recording(folder, "lerobot", ABOUT, video=video) as writer:
        for episode in FLIGHTS:
            add_flight(writer, episode)
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("lerobot") / "flights")


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("lerobot") / "filmed", video=True)


def test_the_info_says_what_is_there_and_where(written: Path):
    info = json.loads((written / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    assert info["video_path"] is None
    numbers = ("total_episodes", "total_frames", "total_tasks", "fps", "chunks_size")
    assert [info[name] for name in numbers] == [2, 8, 1, 4, 1000]
    assert info["splits"] == {"train": "0:2"}
    features = info["features"]
    assert features[CAMERA] == {"dtype": "image", "shape": [*SIZE, 3], "names": ["height", "width", "channels"]}
    assert features["depth"]["shape"] == [*SIZE] and features["mask"]["shape"] == [*SIZE, 1]
    assert features["action"]["names"] == ["up", "turn left", "forward", "left"]
    indices = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
    assert indices <= set(features) and not any("/" in name for name in features)


def test_every_frame_is_a_row_with_its_pictures_as_png(written: Path):
    tables = [pyarrow.parquet.read_table(written / f"data/chunk-000/file-{number:03d}.parquet") for number in (0, 1)]
    rows = [row for table in tables for row in table.to_pylist()]
    assert [row["index"] for row in rows] == list(range(8))
    assert [row["episode_index"] for row in rows] == [0] * 3 + [1] * 5
    assert [row["timestamp"] for row in rows[3:]] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert [row["next.done"] for row in rows] == [False, False, True, False, False, False, False, True]
    assert [row["next.success"] for row in rows] == [False, False, True] + 5 * [False]
    assert [row["next.reason"] for row in rows] == [-1, -1, 1] + 5 * [-1]
    row, wanted = rows[4], FLIGHTS[1]
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(row[CAMERA]["bytes"]))), wanted.rgb[1])
    assert wanted.mask is not None and wanted.depth_m is not None
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(row["mask"]["bytes"]))), wanted.mask[1])
    np.testing.assert_array_equal(np.array(row["depth"], np.float32), wanted.depth_m[1])
    assert row["action"] == wanted.moves[1].tolist() and row["pose"] == wanted.poses[1].tolist()


def test_the_table_of_episodes_says_where_each_one_is(filmed: Path):
    table = pandas.read_parquet(filmed / "meta/episodes/chunk-000/file-000.parquet")
    assert table["length"].tolist() == [3, 5]
    assert table["dataset_from_index"].tolist() == [0, 3] and table["dataset_to_index"].tolist() == [3, 8]
    assert table["data/file_index"].tolist() == [0, 1] == table[f"videos/{CAMERA}/file_index"].tolist()
    assert table[f"videos/{CAMERA}/to_timestamp"].tolist() == [0.75, 1.25]
    assert table["stats/pose/count"].map(list).tolist() == [[3], [5]]
    for found, wanted in zip(table["stats/pose/mean"], FLIGHTS, strict=True):
        np.testing.assert_allclose(found, wanted.poses[:-1].mean(axis=0))
    assert [list(tasks) for tasks in table["tasks"]] == [["Follow the river to its end without touching anything."]] * 2
    tasks = pandas.read_parquet(filmed / "meta/tasks.parquet")
    assert tasks["task_index"].to_dict() == {"Follow the river to its end without touching anything.": 0}


def test_statistics_are_those_of_all_frames(written: Path):
    found = json.loads((written / "meta/stats.json").read_text())
    poses = np.concatenate([each.poses[:-1] for each in FLIGHTS])
    np.testing.assert_allclose(found["pose"]["mean"], poses.mean(axis=0))
    np.testing.assert_allclose(found["pose"]["std"], poses.std(axis=0))
    assert found["pose"]["count"] == [8]
    frames = np.concatenate([each.rgb[:-1] for each in FLIGHTS]) / 255.0
    assert np.shape(found[CAMERA]["mean"]) == (3, 1, 1)
    np.testing.assert_allclose(np.ravel(found[CAMERA]["mean"]), frames.mean(axis=(0, 1, 2)))


def test_statistics_of_several_flights_are_those_of_all_their_rows():
    flights = [np.random.default_rng(size).normal(size, size + 1.0, (size, 3)) for size in (4, 1, 9)]
    parts, rows = [of_numbers(values) for values in flights], np.concatenate(flights)
    for found, values in ((parts[2], flights[2]), (together(parts), rows)):
        for name in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(found[name], getattr(values, name)(axis=0), err_msg=name)
        assert found["count"].tolist() == [len(values)]
    for name, share in {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}.items():
        each = np.array([np.quantile(values, share, axis=0) for values in flights])
        np.testing.assert_allclose([part[name] for part in parts], each, err_msg=name)
        np.testing.assert_allclose(together(parts)[name], np.average(each, axis=0, weights=[4, 1, 9]), err_msg=name)


def test_flights_of_a_task_have_its_number(tmp_path: Path):
    with recording(tmp_path / "tasks", "lerobot", ABOUT) as writer:
        for task in ("River", "Swimmers", "River"):
            add_flight(writer, replace(flight(2), task=task))
    tables = [
        pyarrow.parquet.read_table(tmp_path / f"tasks/data/chunk-000/file-{number:03d}.parquet") for number in range(3)
    ]
    assert [table["task_index"].to_pylist() for table in tables] == [[0, 0], [1, 1], [0, 0]]
    assert pandas.read_parquet(tmp_path / "tasks/meta/tasks.parquet")["task_index"].tolist() == [0, 1]


def test_pictures_are_counted_as_numpy_computes_their_statistics():
    pictures = np.random.default_rng(0).integers(40, 201, size=(7, 5, 3, 2), dtype=np.uint8) // np.array(
        [1, 2], np.uint8
    )
    counts = PictureCounts(2)
    counts.add(pictures[:3])
    counts.add(pictures[3:])
    found, pixels = counts.statistics(), pictures.reshape(-1, 2) / 255.0
    assert found["count"].tolist() == [7] and found["mean"].shape == (2, 1, 1)
    for name, wanted in {
        "min": pixels.min(0),
        "max": pixels.max(0),
        "mean": pixels.mean(0),
        "std": pixels.std(0),
    }.items():
        np.testing.assert_allclose(found[name].ravel(), wanted, err_msg=name)
    for name, share in {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}.items():
        np.testing.assert_allclose(found[name].ravel(), np.quantile(pixels, share, axis=0), err_msg=name)


def test_a_video_has_a_frame_for_each_step_close_to_what_was_seen(filmed: Path):
    path = filmed / f"videos/{CAMERA}/chunk-000/file-001.mp4"
    assert imageio_ffmpeg.count_frames_and_secs(str(path)) == (5, 1.25)
    info = json.loads((filmed / "meta/info.json").read_text())
    assert info["features"][CAMERA]["dtype"] == "video" and info["features"][CAMERA]["info"]["video.fps"] == 4
    _, flights = read_recordings(filmed)
    for found, wanted in zip(flights, FLIGHTS, strict=True):
        assert_same(without(found, mask=None), without(wanted, mask=None), frames=0)
        assert found.rgb.shape == wanted.rgb.shape and np.abs(found.rgb.astype(int) - wanted.rgb).mean() < 60


def test_flights_are_read_as_they_were_recorded_but_for_the_last_sight(written: Path):
    about, flights = read_recordings(written)
    assert about == ABOUT
    for found, wanted in zip(flights, FLIGHTS, strict=True):
        assert_same(found, wanted, frames=wanted.steps)


@pytest.mark.parametrize("broken", ["thalweg.json", "info.json"])
def test_a_data_set_of_others_or_another_version_is_refused(tmp_path: Path, broken: str):
    folder = write(tmp_path / "flights")
    path = folder / "meta" / broken
    told = json.loads(path.read_text())
    path.write_text(json.dumps(told | {"format": 9, "codebase_version": "v9.0"}))
    with pytest.raises(DatasetError, match=r"this version reads v3\.0 and 1"):
        read_recordings(folder)
    path.write_text("[")
    with pytest.raises(DatasetError, match="cannot be read as a data set of LeRobot"):
        read_recordings(folder)
    (folder / "meta/thalweg.json").unlink()
    with pytest.raises(DatasetError, match="was not recorded by Thalweg"):
        read_recordings(folder)


def test_a_folder_without_a_data_set_is_refused(tmp_path: Path):
    with pytest.raises(DatasetError, match="holds no data set"):
        read_recordings(tmp_path)
    with pytest.raises(DatasetError, match="is no folder"):
        read_recordings(tmp_path / "missing")


def test_a_folder_with_something_in_it_is_never_written_to(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(DatasetError, match="is there already"),
        recording(tmp_path, "lerobot", ABOUT) as writer,
    ):
        add_flight(writer, flight(2))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("name", ["pose", "pilot", "next.reward"])
def test_a_missing_column_is_named(name: str, tmp_path: Path):
    path = write(tmp_path / "flights") / "data/chunk-000/file-000.parquet"
    pyarrow.parquet.write_table(pyarrow.parquet.read_table(path).drop_columns([name]), path)
    with pytest.raises(DatasetError, match=f"file-000.parquet lacks the column {name}"):
        list(read_recordings(tmp_path / "flights")[1])


def test_a_missing_layer_is_named(tmp_path: Path):
    path = write(tmp_path / "flights") / "data/chunk-000/file-000.parquet"
    pyarrow.parquet.write_table(pyarrow.parquet.read_table(path).drop_columns(["mask"]), path)
    with pytest.raises(DatasetError, match=r"file-000.parquet holds a flight .* the layer mask is missing"):
        list(read_recordings(tmp_path / "flights")[1])


def test_a_damaged_picture_is_named_with_its_column(tmp_path: Path):
    path = write(tmp_path / "flights") / "data/chunk-000/file-000.parquet"
    table = pyarrow.parquet.read_table(path)
    rows = table["mask"].to_pylist()
    rows[1]["bytes"] = rows[1]["bytes"][:40]
    at = table.column_names.index("mask")
    pyarrow.parquet.write_table(
        table.set_column(at, "mask", pyarrow.array(rows, table.schema.field("mask").type)), path
    )
    with pytest.raises(DatasetError, match=r"file-000.parquet has a damaged picture in the column mask"):
        list(read_recordings(tmp_path / "flights")[1])


def test_a_video_with_fewer_frames_than_rows_is_refused(tmp_path: Path):
    videos = write(tmp_path / "flights", video=True) / f"videos/{CAMERA}/chunk-000"
    (videos / "file-001.mp4").write_bytes((videos / "file-000.mp4").read_bytes())
    with pytest.raises(DatasetError, match=r"file-001\.mp4 has 3 frames that can be read, but its flight has 5 steps"):
        list(read_recordings(tmp_path / "flights")[1])


def test_a_video_that_was_cut_off_is_refused_and_not_read_short(tmp_path: Path):
    path = write(tmp_path / "flights", video=True) / f"videos/{CAMERA}/chunk-000/file-001.mp4"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])  # the table of its frames stands at the front
    with pytest.raises(DatasetError, match=r"file-001\.mp4 has [1-4] frames that can be read"):
        list(read_recordings(tmp_path / "flights")[1])


@pytest.mark.parametrize(("content", "told"), [(b"no video", "cannot be read as a video"), (None, "No such file")])
def test_a_video_that_is_none_or_missing_is_named(content: bytes | None, told: str, tmp_path: Path):
    path = write(tmp_path / "flights", video=True) / f"videos/{CAMERA}/chunk-000/file-000.mp4"
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DatasetError) as caught:
        list(read_recordings(tmp_path / "flights")[1])
    assert told in str(caught.value) and "file-000.mp4" in str(caught.value)


def test_descriptions_on_a_broken_disk_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = write(tmp_path / "flights")

    def broken(path: Path, *_: object, **__: object) -> str:
        raise OSError(errno.EIO, "Input/output error", str(path))

    monkeypatch.setattr(Path, "read_text", broken)
    with pytest.raises(DatasetError, match=r"flights cannot be read as a data set of LeRobot: .*Input/output error"):
        read_recordings(folder)


def test_frames_that_make_no_video_are_refused(tmp_path: Path):
    odd = flight(2)
    odd = without(replace(odd, rgb=odd.rgb[:, 1:]), mask=None, depth_m=None, class_id=None)
    with (
        pytest.raises(DatasetError, match="a video needs an even height and width, not 31 x 34"),
        recording(tmp_path / "flights", "lerobot", replace(ABOUT, layers=()), video=True) as writer,
    ):
        add_flight(writer, odd)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"end_state": [1.0]}, "end_state of flight 0 is"),
        ({"end_pose": [0.0, 1.0, float("inf"), 0.0]}, "poses holds what is no finite number"),
        ({"end_clock_s": "late"}, "end_clock_s of flight 0 is 'late'"),
        ({"terminated": 1}, "terminated must be true or false, got 1"),
        ({"options": [1]}, "task must be a name, and options a mapping"),
        ({"options": {"seed": 1e999}}, "its options must be plain and finite"),
    ],
)
def test_a_flight_whose_description_does_not_fit_is_refused(tmp_path: Path, change: dict, words: str):
    folder = write(tmp_path / "flights")
    path = folder / "meta/thalweg.json"
    told = json.loads(path.read_text())
    told["flights"][0] |= change
    path.write_text(json.dumps(told))
    with pytest.raises(DatasetError, match=words) as refused:
        list(read_recordings(folder)[1])
    assert str(folder) in str(refused.value)
    told["flights"][0] = 3
    path.write_text(json.dumps(told))
    with pytest.raises(DatasetError, match="describes flight 0 by 3, not by a mapping"):
        list(read_recordings(folder)[1])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fps": 0}, "fps is 0, but must be at least 1"),
        ({"cost_kinds": ["tight", 2]}, "cost_kinds must be names, got 2"),
        ({"layers": ["mask", "heat"]}, "layers must be among mask, depth, class, got 'heat'"),
        ({"camera": {"fov_deg": float("nan")}}, "camera and versions must be plain data with finite numbers"),
    ],
)
def test_a_data_set_that_is_not_described_is_refused(tmp_path: Path, change: dict, words: str):
    folder = write(tmp_path / "flights")
    path = folder / "meta/thalweg.json"
    told = json.loads(path.read_text())
    told["about"] |= change
    path.write_text(json.dumps(told))
    with pytest.raises(DatasetError, match=words):
        read_recordings(folder)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rewards": np.zeros(0)}, "it has no step"),
        ({"moves": np.zeros((2, 4))}, r"moves has the shape \(2, 4\), not \(3, 4\)"),
        ({"rgb": np.zeros((4, *SIZE, 3))}, "rgb are numbers of float64, not of uint8"),
        ({"costs": np.full((3, 2), np.nan)}, "costs holds what is no finite number"),
        ({"reason": 2}, "the reason for its end is 2; there are -1 to 1"),
        ({"pilots": ("hand",)}, "pilots must be a name for each step"),
    ],
)
def test_a_flight_whose_parts_do_not_fit_together_is_refused(changes: dict, words: str, tmp_path: Path):
    check_episode(FLIGHTS[0], ABOUT, tmp_path)
    with pytest.raises(DatasetError, match=words):
        check_episode(replace(FLIGHTS[0], **changes), ABOUT, tmp_path)


def test_a_full_folder_is_followed_by_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(lerobot_layout, "FILES_PER_CHUNK", 2)
    flights = [flight(2, seed) for seed in range(3)]
    with recording(tmp_path / "flights", "lerobot", ABOUT) as writer:
        for episode in flights:
            add_flight(writer, episode)
    for found, wanted in zip(read_recordings(tmp_path / "flights")[1], flights, strict=True):
        assert_same(found, wanted, frames=2)
    tables = [tmp_path / f"flights/meta/episodes/chunk-000/file-{number:03d}.parquet" for number in (0, 1)]
    episodes = pandas.concat(map(pandas.read_parquet, tables))
    assert episodes["data/chunk_index"].tolist() == [0, 0, 1] and episodes["data/file_index"].tolist() == [0, 1, 0]
    assert episodes["meta/episodes/file_index"].tolist() == [0, 0, 1]
    assert episodes["dataset_from_index"].tolist() == [0, 2, 4]
