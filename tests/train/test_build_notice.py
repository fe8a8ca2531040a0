from pathlib import Path

import pytest

from thalweg.render import compilation
from thalweg.train import build_notice as announcing
from thalweg.train.build_notice import announce_build
from thalweg.world import LEVELS, Reach

BUILDING = "building the river Easy, seed 3: a few seconds\n"


def test_a_river_that_has_to_be_built_is_announced_once_and_compiling_begins(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
):
    world, begun = tmp_path / "world.npz", []
    monkeypatch.setattr(announcing, "cache_path", lambda level, seed: world)
    monkeypatch.setattr(compilation, "begin", lambda: begun.append(True))
    announcing._print_once.cache_clear()
    for _ in range(2):
        announce_build(LEVELS["Easy"], 3)
    assert capsys.readouterr().err == BUILDING
    announcing._print_once.cache_clear()
    world.write_bytes(b"")
    announce_build(LEVELS["Easy"], 3)
    assert capsys.readouterr().err == ""
    assert len(begun) == 3


def test_the_river_of_a_file_is_announced_since_it_is_built_each_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setattr(compilation, "begin", lambda: None)
    announcing._print_once.cache_clear()
    announce_build(Reach(Path("rivers/brook.geojson")), 5)
    assert capsys.readouterr().err == "building the river brook.geojson, seed 5: a few seconds\n"
