"""Tests that a world survives saving and loading, and that an invalid file is refused with the reason."""

import json
import zipfile
from dataclasses import fields, replace

import numpy as np
import pytest

from tests.world.lines import circle, course
from thalweg.world import Plants, River, World, WorldFileError
from thalweg.world.banks import read_banks
from thalweg.world.record import FORMAT
from thalweg.world.species import KINDS
from thalweg.world.store import npz
from thalweg.world.store.npz import MAPS, RIVER

PLANT = {
    "position_m": np.array([[3.0, 1.0, 0.5]], np.float32),
    "height_m": np.array([8.0], np.float32),
    "width_m": np.array([3.0], np.float32),
    "kind": np.array([0], np.int16),
    "turn": np.array([0.2], np.float32),
    "tint": np.ones((1, 3), np.float32),
    "light": np.ones((1, 2), np.float32),
}
"""One plant of a world that has no other."""


def test_arrays_that_no_world_has_are_not_read_and_too_large_files_are_refused(world, tmp_path, monkeypatch):
    path = tmp_path / "world.npz"
    world.save(path)
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("other.npy", b"no array")
    assert_same(World.load(path), world)
    monkeypatch.setattr(npz, "MOST_BYTES", 1_000)
    with pytest.raises(WorldFileError, match=r"GB unpacked; limit 0 GB"):
        World.load(path)


@pytest.fixture(scope="module")
def world() -> World:
    bare = World.from_centerline(course(circle(10.0, 24), 4.0), plants=False, seed=4)
    return replace(bare, plants=Plants(**PLANT))


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


def test_banks_survive_and_a_world_of_forest_has_none_in_its_file(world, tmp_path):
    banks = read_banks("meadow+quay_1-2_left")
    replace(world, banks=banks).save(tmp_path / "banks.npz")
    world.save(tmp_path / "forest.npz")
    assert World.load(tmp_path / "banks.npz").banks == banks
    assert World.load(tmp_path / "forest.npz").banks == ()
    with np.load(tmp_path / "forest.npz") as stored:
        assert "banks" not in json.loads(str(stored["about"]))
        assert not any("banks" in name for name in stored.files)


def test_unknown_banks_in_a_file_are_refused_by_path(world, tmp_path):
    world.save(tmp_path / "w.npz")
    with np.load(tmp_path / "w.npz") as stored:
        arrays = {name: stored[name] for name in stored.files}
    arrays["about"] = np.array(json.dumps(json.loads(str(arrays["about"])) | {"banks": [{"kind": "lawn"}]}))
    np.savez(tmp_path / "w.npz", **arrays)
    with pytest.raises(WorldFileError, match=r"w\.npz: banks: unknown kind 'lawn'"):
        World.load(tmp_path / "w.npz")


def test_an_interrupted_write_keeps_the_old_file(world, tmp_path, monkeypatch):
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
def test_a_truncated_file_is_refused_by_path(world, tmp_path, share):
    path = tmp_path / "short.npz"
    world.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(WorldFileError, match=r"short\.npz: not a complete \.npz file"):
        World.load(path)


def test_a_flipped_byte_is_detected(world, tmp_path):
    path = tmp_path / "bad.npz"
    world.save(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(WorldFileError, match=r"bad\.npz: not a complete"):
        World.load(path)


def change(path, **changes) -> None:
    """Write a file anew with some arrays replaced, or removed where None."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files} | changes
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})


def test_another_format_version_is_refused(world, tmp_path):
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
        ({"plants.kind": np.zeros(1, np.int64)}, r"'plants.kind' is int64"),
    ],
)
def test_a_foreign_or_incomplete_file_is_refused_with_the_reason(world, tmp_path, changes, message):
    path = tmp_path / "w.npz"
    world.save(path)
    change(path, **changes)
    with pytest.raises(WorldFileError, match=message):
        World.load(path)


def plants(**changes) -> dict[str, np.ndarray]:
    """The arrays of one plant in a file, some of them changed."""
    return {f"plants.{name}": np.asarray(changes.get(name, values), values.dtype) for name, values in PLANT.items()}


FLAT = {name: np.zeros((1, 9), kind) for name, kind in (("ground_m", "f4"), ("water_m", "f4"), ("canopy_m", "f4"))}
LINE = {"position_m": np.zeros((1, 2)), "tangent": np.ones((1, 2))}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (plants(kind=[3000]), rf"'plants.kind' holds 3000; the kinds are 0 to {len(KINDS) - 1}"),
        (plants(kind=[-1]), r"'plants.kind' holds -1"),
        (plants(height_m=[np.nan]), r"'plants.height_m' holds nan, which is not a finite number"),
        (plants(width_m=[0.0]), r"'plants.width_m' holds 0\.0; limit > 0"),
        (plants(position_m=[[1e30, 0, 0]]), r"a plant stands at \(1e\+30, 0\) m, off the map"),
        ({"islands": np.array([[0, 0, np.inf, 1, 0.0]])}, r"'islands' holds inf"),
        ({"islands": np.array([[0, 0, 1, 0, 0.0]])}, r"'islands' holds a size of 0\.0 m; limit > 0"),
        ({"bridges": np.array([[0, 0, 0, 0, 2, 6, 0.5, 2, 4, 0.2, 1.0]])}, r"'bridges' holds a size of 0\.0 m"),
        ({"length_m": 1.0}, r"a course of 1\.0 m with a sample at \d+"),
        ({"bridges": np.full((1, 11), np.nan)}, r"'bridges' holds nan"),
        ({"grid": [0.0, 0.0, 0.0]}, r"a cell size of 0\.0 m; limit > 0"),
        ({"grid": [np.nan, 0.0, 0.25]}, r"description holds nan"),
        ({"sun": [0.0, np.inf]}, r"description holds inf"),
        ({"length_m": np.inf}, r"description holds inf"),
        ({"length_m": -4.0}, r"a course of -4\.0 m"),
        ({"seed": -4}, r"the seed -4"),
        ({"seed": 1.5}, r"description is incomplete \(TypeError"),
        ({"closed": "yes"}, r"description is incomplete \(TypeError\(\"closed must be true or false"),
        ({"length_m": 10**400}, r"description is incomplete \(OverflowError"),
        ({"name": "half \ud800"}, r"the name 'half \\ud800', which is not Unicode"),
        ({"river.arc_m": np.array(1.0)}, r"'river\.arc_m' is float64 \(\); expected"),
        ({"plants.kind": np.array(0, np.int16)}, r"'plants\.kind' is int16 \(\); expected"),
        ({"ground_m": np.zeros(4, np.float32)}, r"'ground_m' is float32 \(4,\); expected"),
        ({"grid": [500.0, 0.0, 0.25]}, r"the course runs at \(.*off the map"),
        (
            FLAT
            | {name: np.zeros((1, 9), np.uint8) for name in ("sun", "sky")}
            | {"albedo": np.zeros((1, 9, 3), np.uint8)},
            r"a map of 1 x 9 nodes; at least 2 x 2",
        ),
        (
            {f"river.{name}": LINE.get(name, np.ones(1)) for name in RIVER},
            r"a course of 1 samples; at least 2",
        ),
        ({"kinds": ["oak", "elm"]}, r"made for the kinds of plants oak, elm; this version draws pine-1, "),
        ({"kinds": None}, r"description is incomplete \(KeyError\('kinds'\)\)"),
    ],
)
def test_invalid_values_are_refused(world, tmp_path, changes, message):
    path = tmp_path / "w.npz"
    world.save(path)
    arrays = {name: values for name, values in changes.items() if isinstance(values, np.ndarray)}
    with np.load(path) as stored:
        about = json.loads(str(stored["about"])) | {k: v for k, v in changes.items() if k not in arrays}
    about = {name: value for name, value in about.items() if value is not None}
    change(path, about=np.array(json.dumps(about)), **arrays)
    with pytest.raises(WorldFileError, match=rf"w\.npz: .*{message}"):
        World.load(path)


def test_a_description_that_is_nested_too_deep_is_refused(world, tmp_path):
    path = tmp_path / "w.npz"
    world.save(path)
    change(path, about=np.array("[" * 50_000))
    with pytest.raises(WorldFileError, match=r"an \.npz file, but not of a world"):
        World.load(path)


def test_a_file_with_any_byte_flipped_is_read_unchanged_or_refused(world, tmp_path):
    path = tmp_path / "w.npz"
    small = replace(
        world,
        grid=replace(world.grid, cell_m=16.0),
        **{name: getattr(world, name)[::64, ::64] for name in (*MAPS, "albedo")},
    )
    small.save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    places = np.concatenate([np.arange(len(whole) - 1800, len(whole), 5), rng.integers(0, len(whole), 200)])
    for place in places:
        data = bytearray(whole)
        data[place] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        try:
            assert_same(World.load(path), small)
        except WorldFileError:
            refused += 1
    assert refused > 0.5 * len(places)


def test_pickled_objects_are_refused(world, tmp_path):
    path = tmp_path / "w.npz"
    world.save(path)
    change(path, islands=np.array([{}], dtype=object))
    with pytest.raises(WorldFileError, match=r"not a complete \.npz file"):
        World.load(path)


def test_a_missing_file_and_a_text_file_are_refused(tmp_path):
    with pytest.raises(WorldFileError, match=r"none\.npz: there is no such file"):
        World.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(WorldFileError, match=r"text\.npz: not a complete"):
        World.load(tmp_path / "text.npz")
