from pathlib import Path

import pytest

from thalweg.train import announce as announcing
from thalweg.train.announce import announce
from thalweg.world import LEVELS

COMPILING = "compiling kernels: first start only, about a minute\n"
BUILDING = "building the river Easy, seed 3: a few seconds, then it is kept\n"


@pytest.fixture
def caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """A folder for kernels and a file for a world, neither there yet."""
    kernels, world = tmp_path / "kernels", tmp_path / "world.npz"
    kernels.mkdir()
    monkeypatch.setattr(announcing, "kernel_folder", lambda: kernels)
    monkeypatch.setattr(announcing, "place_of", lambda level, seed: world)
    announcing._say.cache_clear()
    return kernels, world


def test_the_first_start_says_what_takes_long_and_says_it_once(caches, capsys: pytest.CaptureFixture):
    for _ in range(2):
        announce(LEVELS["Easy"], 3)
    assert capsys.readouterr().err == COMPILING + BUILDING


def test_what_is_there_is_not_announced(caches: tuple[Path, Path], capsys: pytest.CaptureFixture):
    kernels, world = caches
    (kernels / "frame_1").mkdir()
    (kernels / "frame_1" / "shade.nbi").write_bytes(b"")
    announce(LEVELS["Easy"], 3)
    assert capsys.readouterr().err == BUILDING
    world.write_bytes(b"")
    announce(LEVELS["Easy"], 3)
    assert capsys.readouterr().err == ""


def test_kernels_that_cannot_be_kept_are_compiled_at_every_start(
    caches, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setattr(announcing, "kernel_folder", lambda: None)
    announce(LEVELS["Easy"], 3)
    assert COMPILING in capsys.readouterr().err
