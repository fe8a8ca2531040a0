"""Frames are those that were looked at, on any machine; the command that replaces them does not do so in silence."""

import json

import numpy as np
import pytest

from tests.render import golden
from thalweg.render import RENDER_VERSION, Look
from thalweg.world import World

AGAIN = "after a change that is meant to be seen: python tests/render/golden.py --write"


@pytest.fixture(scope="module")
def worlds(easy_world: World, medium_world: World, hard_world: World) -> list[World]:
    return [easy_world, medium_world, hard_world]


@pytest.fixture(scope="module")
def frames(worlds: list[World]) -> np.ndarray:
    """[K, H, W, 4] drawn now, where the kept ones were drawn from."""
    return golden.draw(worlds, golden.poses_of(golden.load()[0]))


def test_the_golden_frames_are_of_this_version():
    assert golden.load()[0]["render_version"] == RENDER_VERSION, AGAIN


@pytest.mark.parametrize("name", golden.names())
def test_a_frame_is_near_the_golden_one(name: str, frames: np.ndarray):
    place = golden.names().index(name)
    apart = golden.difference(frames[place], golden.load()[1][place])
    assert apart.near, f"{apart}; {AGAIN}"


def test_a_slightly_other_exposure_is_not_near_in_any_frame(worlds: list[World]):
    about, kept = golden.load()
    brighter = golden.draw(worlds, golden.poses_of(about), Look(exposure_ev=float(np.log2(1.03))))
    assert len(golden.far_off(brighter, kept)) == len(kept) == 6


def test_the_golden_frames_show_water_and_are_small_files():
    kept = golden.load()[1]
    assert kept.shape == (6, 128, 128, 4)
    share = (kept[..., 3] == 255).mean(axis=(1, 2))
    assert (share > 0.1).sum() >= 4
    assert set(np.unique(kept[..., 3])) == {0, 255}
    assert sum(file.stat().st_size for file in golden.FOLDER.iterdir()) < 400_000


def test_differences_by_hand():
    kept = np.full((10, 20, 4), 100, np.uint8)
    frame = kept.copy()
    frame[0, :4, 0] = 112  # at the limit: not off
    frame[1, :2, 1] = 87
    frame[2:4, 0, 3] = 255
    apart = golden.difference(frame, kept)
    assert apart.mean == pytest.approx((4 * 12 + 2 * 13) / 600)
    assert apart.bias == pytest.approx(4 * 12 / 200)
    assert apart.off == pytest.approx(2 / 200)
    assert apart.mask == pytest.approx(2 / 200)
    assert not apart.near
    assert golden.difference(kept, kept).near


@pytest.mark.parametrize("field", ["mean", "bias", "off", "mask"])
def test_each_limit_counts_by_itself(field: str):
    far = golden.Difference(**{**dict.fromkeys(("mean", "bias", "off", "mask"), 0.0), field: 0.2})
    assert not far.near


def test_a_changed_picture_of_the_same_version_is_not_written(worlds: list[World]):
    about, kept = golden.load()
    changed = kept.copy()
    changed[2, ..., 0] ^= 8
    said = golden.refusal(about, worlds, changed, kept)
    assert said is not None
    assert said.startswith("medium-0: mean difference 2.667 of 255")
    assert said.endswith(f"RENDER_VERSION is still {RENDER_VERSION}: raise it first")
    assert golden.refusal({**about, "render_version": RENDER_VERSION - 1}, worlds, changed, kept) is None


def test_frames_of_other_rivers_may_be_written_and_near_ones_need_not(worlds: list[World]):
    about, kept = golden.load()
    assert "nothing to write" in str(golden.refusal(about, worlds, kept, kept))
    assert golden.other_rivers(about, [worlds[0], worlds[2], worlds[2]]) == ["Medium"]
    assert golden.refusal(about, [worlds[0], worlds[2], worlds[2]], kept, kept) is None


def test_what_is_written_is_what_is_read(worlds: list[World], monkeypatch, tmp_path):
    about, kept = golden.load()
    monkeypatch.setattr(golden, "FOLDER", tmp_path)
    golden.write(worlds, golden.poses_of(about), kept)
    again, frames = golden.load()
    np.testing.assert_array_equal(frames, kept)
    assert golden.poses_of(again) == golden.poses_of(about)
    assert golden.other_rivers(again, worlds) == []
    assert json.loads((tmp_path / "about.json").read_text())["render_version"] == RENDER_VERSION
