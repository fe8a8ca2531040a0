"""Tests of the cache folder and of the code hashes that keep stale files from being used."""

from pathlib import Path

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
