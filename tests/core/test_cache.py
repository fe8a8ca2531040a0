"""The cache folder, and the hash that keeps stale things from being used."""

from thalweg.core import cache


def tree(root, **files: str):
    for name, text in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.with_suffix(".py").write_text(text)
    return root


def hash_of(monkeypatch, root, *parts: str) -> str:
    monkeypatch.setattr(cache, "PACKAGE", root)
    cache.source_hash.cache_clear()
    try:
        return cache.source_hash(*parts)
    finally:
        cache.source_hash.cache_clear()


def test_the_hash_changes_with_any_source_of_its_parts_and_with_no_other(tmp_path, monkeypatch):
    first = hash_of(monkeypatch, tree(tmp_path / "a", world__x="1", world__deep__y="2", env__z="3"), "world")
    inner = hash_of(monkeypatch, tree(tmp_path / "b", world__x="1", world__deep__y="20", env__z="3"), "world")
    moved = hash_of(monkeypatch, tree(tmp_path / "c", world__x="1", world__deeper__y="2", env__z="3"), "world")
    other = hash_of(monkeypatch, tree(tmp_path / "d", world__x="1", world__deep__y="2", env__z="30"), "world")
    assert len({first, inner, moved}) == 3
    assert other == first


def test_the_order_of_the_parts_does_not_matter(tmp_path, monkeypatch):
    root = tree(tmp_path, world__x="1", env__z="3", kernel="4")
    one = hash_of(monkeypatch, root, "world", "env", "kernel.py")
    assert one == hash_of(monkeypatch, root, "kernel.py", "env", "world")


def test_the_folder_is_chosen_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path / "mine"))
    assert cache.cache_dir() == tmp_path / "mine"
    monkeypatch.delenv("THALWEG_CACHE")
    assert cache.cache_dir().name == "thalweg"
