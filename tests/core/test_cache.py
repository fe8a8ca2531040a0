"""Tests of the cache folder and of the code hashes that keep stale files from being used."""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from thalweg.core import cache

CODE = """def area(radius):
    return 3.14 * radius**2
"""


@pytest.fixture(autouse=True)
def temporary_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path / "cache"))


def hash_of(folder: Path, *texts: str) -> str:
    folder.mkdir()
    for number, text in enumerate(texts):
        (folder / f"{number}.py").write_text(text)
    return cache.code_hash(folder.glob("*.py"))


def test_comments_docstrings_layout_and_file_names_do_not_change_the_hash(tmp_path: Path):
    described = '''"""Areas."""
def area( radius ):  # of a disk
    """In square metres."""
    return 3.14*radius ** 2
'''
    (tmp_path / "disk.py").write_text(described)
    assert cache.code_hash([tmp_path / "disk.py"]) == hash_of(tmp_path / "plain", CODE)


@pytest.mark.parametrize("changed", [CODE.replace("3.14", "3.15"), CODE.replace("radius", "r"), CODE + "PI = 3.14\n"])
def test_any_code_change_changes_the_hash(tmp_path: Path, changed: str):
    assert hash_of(tmp_path / "a", CODE) != hash_of(tmp_path / "b", changed)


def test_the_hash_covers_every_file(tmp_path: Path):
    assert len({hash_of(tmp_path / str(n), CODE, *more) for n, more in enumerate([(), ("x = 1",), ("x = 2",)])}) == 3


def test_a_stored_hash_is_reused_for_the_same_bytes(tmp_path: Path):
    first = hash_of(tmp_path / "a", CODE)
    assert len(list((tmp_path / "cache" / "code").iterdir())) == 1
    assert hash_of(tmp_path / "b", CODE) == first
    assert len(list((tmp_path / "cache" / "code").iterdir())) == 1


@pytest.mark.parametrize("content", [b"", b"0123", b"\xff" * 16, b"0123456789abcdef\n"])
def test_a_stored_file_that_holds_no_hash_is_replaced(tmp_path: Path, content: bytes):
    first = hash_of(tmp_path / "a", CODE)
    (stored,) = (tmp_path / "cache" / "code").iterdir()
    stored.write_bytes(content)
    assert hash_of(tmp_path / "b", CODE) == first == stored.read_text()


def test_an_unwritable_cache_folder_does_not_change_the_hash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    first = hash_of(tmp_path / "a", CODE)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path / "file" / "below"))
    assert hash_of(tmp_path / "b", CODE) == first


def test_the_environment_variable_chooses_the_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path / "mine"))
    assert cache.cache_dir() == tmp_path / "mine"
    monkeypatch.delenv("THALWEG_CACHE")
    assert cache.cache_dir().name == "thalweg"


def test_a_folder_of_the_home_may_be_chosen(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("THALWEG_CACHE", "~/mine")
    assert cache.cache_dir() == tmp_path / "mine"


def unused(path: Path, days: float, folder: bool = False) -> Path:
    """A file, or a folder with a file in a folder, last used so many days ago."""
    if folder:
        (path / "below").mkdir(parents=True)
        (path / "below" / "kernel").write_text("code")
    else:
        path.write_text("atlas")
    used_s = time.time() - days * 86400
    os.utime(path, (used_s, used_s))
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_folders_of_other_versions_are_removed_once_they_were_not_used_for_a_month(tmp_path: Path):
    own = unused(tmp_path / "own", 100, folder=True)
    unused(tmp_path / "unused", 31, folder=True)
    unused(tmp_path / "recent", 29, folder=True)
    cache.keep_in_use(own, "*")
    assert names(tmp_path) == ["own", "recent"]
    assert (own / "below" / "kernel").read_text() == "code"
    assert time.time() - own.stat().st_mtime < 60


def test_only_files_of_the_pattern_are_removed(tmp_path: Path):
    own = unused(tmp_path / "atlas-new.npz", 0)
    for name in ("atlas-old.npz", "river.npz"):
        unused(tmp_path / name, 100)
    cache.keep_in_use(own, "atlas-*.npz")
    assert names(tmp_path) == ["atlas-new.npz", "river.npz"]


def test_what_a_killed_process_has_not_removed_is_removed_by_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    own = unused(tmp_path / "own", 0, folder=True)
    unused(tmp_path / "old", 100, folder=True)
    with monkeypatch.context() as killed:
        killed.setattr("shutil.rmtree", lambda path, ignore_errors: None)
        cache.keep_in_use(own, "*")
    assert names(tmp_path) == ["old.removed", "own"]
    cache.keep_in_use(own, "*")
    assert names(tmp_path) == ["own"]


def test_several_may_remove_the_same_folders_at_once(tmp_path: Path):
    own = unused(tmp_path / "own", 0, folder=True)
    for number in range(40):
        unused(tmp_path / str(number), 100, folder=True)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: cache.keep_in_use(own, "*"), range(4)))
    assert names(tmp_path) == ["own"]


def test_a_cache_that_is_not_there_is_left_alone(tmp_path: Path):
    cache.keep_in_use(tmp_path / "none" / "own", "*")
    assert names(tmp_path) == []


@pytest.mark.parametrize("trim", ["keep_in_use", "keep_most_recent", "code_hash"])
def test_temporary_files_of_killed_processes_are_removed_after_a_day(tmp_path: Path, trim: str):
    folder = tmp_path / "cache" / "code"
    folder.mkdir(parents=True)
    unused(folder / ".atlas.0123456789abcdef.part.npz", 2)
    unused(folder / ".other.0123456789abcdef.part", 0.5)
    if trim == "keep_in_use":
        cache.keep_in_use(unused(folder / "atlas.npz", 0), "atlas*.npz")
    elif trim == "keep_most_recent":
        cache.keep_most_recent(folder, 1_000_000)
    else:
        hash_of(tmp_path / "a", CODE)
    assert [name for name in names(folder) if ".part" in name] == [".other.0123456789abcdef.part"]


def test_a_file_that_is_being_written_makes_no_room(tmp_path: Path):
    unused(tmp_path / ".river.0123456789abcdef.part.npz", 0)
    unused(tmp_path / "old.npz", 1)
    cache.keep_most_recent(tmp_path, 1)
    assert names(tmp_path) == [".river.0123456789abcdef.part.npz"]


def test_in_a_folder_that_may_not_be_entered_nothing_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "river.npz").touch()
    assert cache.is_stored(tmp_path / "river.npz")
    refuse(tmp_path, monkeypatch)
    assert not cache.is_stored(tmp_path / "river.npz")


def refuse(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse all looks at the files below a folder, which root would be allowed."""
    stat = os.stat

    def refused(path: Any, *args: Any, **options: Any) -> os.stat_result:
        if isinstance(path, str | Path) and folder in Path(path).parents:
            raise PermissionError(13, "Permission denied", str(path))
        return stat(path, *args, **options)

    monkeypatch.setattr(os, "stat", refused)
