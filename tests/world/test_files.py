"""A world goes to a file and back unchanged; a file that is not whole says what is wrong."""

import json
from dataclasses import fields

import numpy as np
import pytest

from tests.world.lines import circle, course
from thalweg.world import Plants, River, World, WorldFileError
from thalweg.world.record import FORMAT


@pytest.fixture(scope="module")
def world() -> World:
    return World.from_centerline(course(circle(10.0, 24), 4.0), plants=False, seed=4)


def assert_same(one: World, two: World) -> None:
    for field in fields(World):
        a, b = getattr(one, field.name), getattr(two, field.name)
        if isinstance(a, River | Plants):
            for inner in fields(a):
                np.testing.assert_array_equal(getattr(a, inner.name), getattr(b, inner.name), strict=True)
        elif isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, strict=True)
        else:
            assert a == b


def test_a_world_is_the_same_after_saving_and_loading(world, tmp_path):
    world.save(tmp_path / "new" / "w.npz")
    assert_same(World.load(tmp_path / "new" / "w.npz"), world)


def test_the_same_world_gives_the_same_bytes(world, tmp_path):
    world.save(tmp_path / "a.npz")
    world.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_an_interrupted_write_leaves_what_was_there(world, tmp_path, monkeypatch):
    path = tmp_path / "w.npz"
    path.write_bytes(b"before")

    def fail(file, **_):
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", fail)
    with pytest.raises(KeyboardInterrupt):
        world.save(path)
    assert path.read_bytes() == b"before"
    assert [each.name for each in tmp_path.iterdir()] == ["w.npz"]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_file_is_refused_by_name(world, tmp_path, share):
    path = tmp_path / "short.npz"
    world.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(WorldFileError, match=r"short\.npz: not a whole \.npz file"):
        World.load(path)


def test_a_flipped_byte_is_noticed(world, tmp_path):
    path = tmp_path / "bad.npz"
    world.save(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(WorldFileError, match=r"bad\.npz: not a whole"):
        World.load(path)


def change(path, **changes) -> None:
    """Write a file anew with some arrays replaced, or removed where None."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files} | changes
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})


def test_another_version_is_refused(world, tmp_path):
    path = tmp_path / "w.npz"
    world.save(path)
    with np.load(path) as stored:
        about = json.loads(str(stored["about"])) | {"format": FORMAT + 1}
    change(path, about=np.array(json.dumps(about)))
    with pytest.raises(WorldFileError, match=rf"format {FORMAT + 1}; this version reads format {FORMAT}"):
        World.load(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"about": None}, "an .npz file, but not of a world"),
        ({"about": np.array('{"kind": "cake", "format": 1}')}, "of kind 'cake'"),
        ({"about": np.array(json.dumps({"kind": "thalweg world", "format": FORMAT}))}, "description is incomplete"),
        ({"albedo": None}, "the array 'albedo' is missing"),
        ({"sun": np.zeros((3, 3), np.uint8)}, r"'sun' is uint8 \(3, 3\); expected uint8"),
        ({"river.width_m": np.zeros(5)}, r"'river.width_m' is float64 \(5,\); expected"),
        ({"plants.kind": np.zeros(0, np.int64)}, r"'plants.kind' is int64"),
    ],
)
def test_a_foreign_or_incomplete_file_says_what_is_wrong(world, tmp_path, changes, message):
    path = tmp_path / "w.npz"
    world.save(path)
    change(path, **changes)
    with pytest.raises(WorldFileError, match=message):
        World.load(path)


def test_pickled_objects_are_refused(world, tmp_path):
    path = tmp_path / "w.npz"
    world.save(path)
    change(path, islands=np.array([{}], dtype=object))
    with pytest.raises(WorldFileError, match=r"not a whole \.npz file"):
        World.load(path)


def test_a_missing_file_and_a_text_file_are_refused(tmp_path):
    with pytest.raises(WorldFileError, match=r"none\.npz: there is no such file"):
        World.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(WorldFileError, match=r"text\.npz: not a whole"):
        World.load(tmp_path / "text.npz")
