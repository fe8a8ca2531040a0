"""Tests of policies over videos."""

from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from tests.deploy import policies
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.pictures.film_format import FILM_COMMENT
from thalweg.cli.main import main
from thalweg.core.video import VideoError, open_video, read_video, write_video
from thalweg.deploy.errors import ExportError
from thalweg.deploy.export import Exportable
from thalweg.deploy.follow import (
    BACKGROUND,
    MARGIN_PX,
    PANEL_PX,
    QUIET,
    VIEW_PX,
    WATER_RGB,
    Followed,
    Follower,
    cut_to,
    follow,
    frames_of_step,
    move_in_words,
    overlay,
)
from thalweg.encoder.water import load_segmenter, mean_iou, water_in
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.spaces import moves_in_words
from thalweg.render import Camera, Look, Renderer
from thalweg.train import load_policy
from thalweg.world import World

MOVES, NO_MOVE = moves_in_words("multidiscrete"), np.ones(4, int)
SEEN_AT = slice(VIEW_PX + 2 * MARGIN_PX, VIEW_PX + 2 * MARGIN_PX + PANEL_PX)
MASK_AT = slice(SEEN_AT.stop + MARGIN_PX, SEEN_AT.stop + MARGIN_PX + PANEL_PX)
LOW = slice(MARGIN_PX + VIEW_PX - PANEL_PX, MARGIN_PX + VIEW_PX)
"""Columns of what the policy sees and of the mask in an overlay, and their rows."""


def river_seen_by(camera: Camera, world: World) -> np.ndarray:
    """Return a frame [H, W, 3] uint8 with water ahead."""
    (x, y), (ahead_x, ahead_y) = world.river.position_m[3:5]
    pose = np.array([[x, y, world.river.level_m[3] + 5.0, np.arctan2(ahead_y - y, ahead_x - x)]])
    return Renderer([world], camera).render(pose)[0, ..., :3].copy()


class Watched:
    """A stand-in for a `Follower` that calls a function."""

    moves = MOVES

    def __init__(self, see: Any, step_s: float = 0.25) -> None:
        self.see, self.step_s = see, step_s

    def __call__(self, frame: np.ndarray) -> Any:
        return self.see(frame)


@pytest.mark.parametrize("tall", [False, True])
def test_the_middle_of_a_frame_is_cut_to_the_shape_of_the_camera(tall: bool):
    frame = np.zeros((60, 100, 3), np.uint8)
    frame[:, 20:80] = np.arange(60)[None, :, None]
    found = cut_to(frame.swapaxes(0, 1).copy() if tall else frame, (30, 30))
    assert found.shape == (30, 30, 3)
    line = found[:, 7, 0] if tall else found[7, :, 0]
    np.testing.assert_allclose(line, np.arange(30) * 2 + 0.5, atol=0.5)


@pytest.mark.parametrize(("camera", "frame"), [((100, 100), (247, 247)), ((1200, 1600), (33, 44))])
def test_rounding_cuts_no_frame_beyond_its_edge(camera: tuple[int, int], frame: tuple[int, int]):
    """A scale of 2.47 has no exact number, and 100 of it are a little more than 247."""
    found = cut_to(np.full((*frame, 3), 7, np.uint8), camera)
    assert found.shape == (*camera, 3) and (found == 7).all()


@pytest.mark.parametrize(("step_s", "every", "shown"), [(0.25, 3, (8, 2.0)), (0.5, 6, (4, 2.0))])
def test_frames_that_are_a_step_apart_are_read(step_s: float, every: int, shown: tuple, tmp_path: Path):
    frames = np.repeat(np.arange(24, dtype=np.uint8)[:, None, None, None] * 10, 64, 1).repeat(64, 2).repeat(3, 3)
    write_video(tmp_path / "fast.mp4", frames, 12, crf=18)
    seen: list[float] = []

    def watcher(frame: np.ndarray) -> Any:
        seen.append(float(frame.mean()))
        return Followed(frame, frame, np.ones(4, int), None)

    follower: Any = Watched(watcher, step_s)
    follow(tmp_path / "fast.mp4", tmp_path / "out.mp4", follower, "watcher")
    np.testing.assert_allclose(seen, np.arange(0, 24, every) * 10, atol=3)
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "out.mp4")) == shown


def test_a_film_is_refused_with_what_would_be_right(tmp_path: Path):
    write_video(tmp_path / "in.mp4", np.zeros((2, 64, 64, 3), np.uint8), 4, crf=18, comment=FILM_COMMENT)
    follower: Any = Watched(lambda frame: Followed(frame, frame, np.ones(4, int), None), 0.25)
    with pytest.raises(VideoError, match=r"in.mp4 is a film by thalweg film, .*`thalweg record steady --video"):
        follow(tmp_path / "in.mp4", tmp_path / "out.mp4", follower, "watcher")
    assert not (tmp_path / "out.mp4").exists()


def test_the_step_is_that_of_the_policys_training():
    trained = [Follower(policies.of_images("rgb", env=env)) for env in ({}, {"step_s": 0.5})]
    assert [follower.step_s for follower in trained] == [0.25, 0.5]


def test_a_policy_sees_the_frames_with_the_water_that_is_found_and_chooses_as_it_would(tmp_path: Path):
    frames = np.random.default_rng(0).integers(256, size=(4, 128, 128, 3), dtype=np.uint8)
    write_video(tmp_path / "in.mp4", frames, 4, crf=18)
    policy, segmenter = load_policy(PACKAGED_POLICY), load_segmenter()
    taken = follow(tmp_path / "in.mp4", tmp_path / "out.mp4", Follower(policy, segmenter), "packaged")
    player = policy.player(1, deterministic=True)
    for step, frame in enumerate(read_video(tmp_path / "in.mp4")):
        mask = water_in(segmenter, frame[None])[..., None].astype(np.uint8) * 255
        wanted = player(np.concatenate([frame[None], mask], axis=-1), np.array([step == 0]))
        np.testing.assert_array_equal(taken[step], wanted[0])
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "out.mp4")) == (4, 1.0)


def test_a_policy_of_numbers_is_shown_with_shares_of_a_step(tmp_path: Path):
    frames = np.random.default_rng(0).integers(256, size=(3, 128, 128, 3), dtype=np.uint8)
    write_video(tmp_path / "in.mp4", frames, 4, crf=18)
    policy, _ = policies.of_codes("default", actions=policies.numbers("gaussian"))
    taken = follow(tmp_path / "in.mp4", tmp_path / "out.mp4", Follower(policy, load_segmenter()), "mine")
    assert taken.shape == (3, 4) and taken.dtype == np.float32
    numbers = np.array([0.504, -0.004, -0.25, -1.0], np.float32)
    for backward, shown in ((True, "backward 25%"), (False, "none")):
        names = moves_in_words("continuous", allow_backward=backward).values()
        move = [move_in_words(*each) for each in zip(names, numbers, strict=True)]
        assert move == ["up 50%", "none", shown, "right 100%"]
    assert move_in_words(("up", "none", "down"), np.int64(2)) == "down"


@pytest.mark.parametrize(
    ("env", "bright"), [({}, False), ({"allow_backward": True}, True), ({"task": "RacingLine"}, True)]
)
def test_the_overlay_names_the_third_option_forward_by_the_training(env: dict[str, Any], bright: bool):
    follower = Follower(policies.of_images("rgb", env=env))
    colours = np.zeros((128, 128, 3), np.uint8)
    third, none = (
        overlay(Followed(colours, colours, np.array([1, 1, option, 1]), None), follower.moves, "mine", 1).astype(int)
        for option in (2, 1)
    )
    assert ((third != none).any(), (third > QUIET).all(-1).sum() > (none > QUIET).all(-1).sum()) == (bright, bright)


def test_a_policy_of_colours_alone_needs_no_segmenter():
    follower = Follower(policies.of_images("rgb"))
    followed = follower(np.zeros((90, 160, 3), np.uint8))
    assert followed.colours.shape == (128, 128, 3) and followed.move.shape == (4,) and followed.mask is None


def test_what_a_video_does_not_have_is_refused():
    with pytest.raises(ExportError, match=r"sees rgb\+mask: finding the water in a video needs a segmenter"):
        Follower(policies.of_images("rgb+mask"))
    with pytest.raises(ExportError, match="takes proprioception, which a video does not have"):
        Follower(policies.of_codes("default", felt=True)[0], load_segmenter())


def test_the_overlay_of_a_wide_frame_keeps_its_shape():
    colours = np.full((48, 96, 3), 200, np.uint8)
    drawn = overlay(Followed(colours, colours, NO_MOVE, np.full((48, 96), 255, np.uint8)), MOVES, "mine", 1)
    shown = (drawn[:, MARGIN_PX : MARGIN_PX + VIEW_PX] != BACKGROUND).any(axis=(1, 2))
    rows = np.flatnonzero(shown)
    assert (len(rows), rows[0]) == (VIEW_PX // 2, MARGIN_PX + VIEW_PX // 4)


def test_the_overlay_shades_the_water_that_was_found():
    colours = np.zeros((128, 128, 3), np.uint8)
    mask = np.zeros((128, 128), np.uint8)
    mask[64:] = 255
    dry, wet = (
        overlay(Followed(colours, colours, NO_MOVE, each), MOVES, "mine", 1) for each in (np.zeros_like(mask), mask)
    )
    changed = (dry != wet).any(axis=-1)
    assert changed[16 + 192 : 16 + 384, 16 : 16 + 384].mean() > 0.98 and not changed[16 : 16 + 180, 16 : 16 + 384].any()
    np.testing.assert_allclose(wet[16 + 300, 100], 0.45 * np.array(WATER_RGB), atol=1)


def test_the_packaged_finder_finds_water_in_a_look_and_a_river_of_its_own(easy_world: World):
    env = RiverVectorEnv([easy_world], 12, EnvConfig(observation="none"))
    env.reset(seed=11)
    camera, look = Camera(256, 256, fov_deg=75.0, pitch_deg=26.0), Look(haze=3.0, warmth=0.3, exposure_ev=0.3)
    frames = Renderer([easy_world], camera).render(env.state.pose, look=look)
    found = water_in(load_segmenter(), frames[..., :3])
    assert mean_iou(found, frames[..., 3] > 0) > 0.6


def test_another_file_is_refused_and_nothing_is_written(tmp_path: Path, capsys: pytest.CaptureFixture):
    (tmp_path / "in.mp4").write_bytes(b"no video")
    out = tmp_path / "out.mp4"
    assert main(["follow", str(tmp_path / "in.mp4"), "--out", str(out)]) == 2
    assert "cannot be read as a video" in capsys.readouterr().err
    assert main(["follow", str(tmp_path / "missing.mp4"), "--out", str(out)]) == 2
    assert "missing.mp4" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("sees", ["rgb", "mask", "rgb+mask"])
def test_the_picture_that_the_policy_sees_stands_unshaded_beside_the_mask(sees: str, easy_world: World):
    follower = Follower(policies.of_images(sees), load_segmenter())
    followed = follower(river_seen_by(Camera(), easy_world))
    assert followed.mask is not None and 0 < followed.mask.mean() < 255
    given = {"rgb": followed.colours, "mask": followed.mask[..., None]}
    np.testing.assert_array_equal(followed.seen, np.concatenate([given[each] for each in sees.split("+")], axis=-1))
    drawn = overlay(followed, follower.moves, "mine", 1)
    twice = followed.mask.repeat(2, 0).repeat(2, 1)[..., None].repeat(3, 2)
    np.testing.assert_array_equal(drawn[LOW, MASK_AT], twice)
    picture = twice if sees == "mask" else followed.colours.repeat(2, 0).repeat(2, 1)
    np.testing.assert_array_equal(drawn[LOW, SEEN_AT], picture)


def test_a_picture_that_is_larger_than_its_place_is_not_smoothed():
    colours = (np.indices((600, 300)).sum(0)[..., None].repeat(3, 2) % 2 * 255).astype(np.uint8)
    drawn = overlay(Followed(colours, colours, NO_MOVE, None), MOVES, "mine", 1)
    shown = drawn[LOW, SEEN_AT][:, PANEL_PX // 4 : PANEL_PX // 4 + PANEL_PX // 2]
    assert set(np.unique(shown)) == {0, 255}


@pytest.mark.parametrize("size", [(120, 128), (90, 161)])
def test_frames_of_any_size_are_padded_for_the_segmenter(
    size: tuple[int, int], easy_world: World, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Exportable, "camera", Camera(*size))
    segmenter, frame = load_segmenter(), river_seen_by(Camera(*size), easy_world)
    below, right = -size[0] % 16, -size[1] % 16
    padded = np.pad(frame, ((0, below), (0, right), (0, 0)), mode="edge")
    wanted = water_in(segmenter, padded[None])[0, : size[0], : size[1]]
    np.testing.assert_array_equal(water_in(segmenter, frame[None])[0], wanted)
    follower = Follower(policies.of_images("rgb"), segmenter)
    monkeypatch.setattr(follower, "_player", lambda seen, _: NO_MOVE[None])
    followed = follower(frame)
    assert followed.mask is not None and 0 < wanted.mean() < 1
    np.testing.assert_array_equal(followed.mask, wanted * np.uint8(255))


def test_a_video_that_does_not_say_its_rate_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "in.mp4"
    path.touch()
    monkeypatch.setattr(imageio_ffmpeg, "read_frames", lambda _: (each for each in [{"size": (64, 64), "fps": 0}]))
    with open_video(path) as video, pytest.raises(VideoError, match=r"in.mp4 does not say how many frames a second"):
        frames_of_step(video, path, 0.25)


def test_an_overlay_lasts_as_long_as_its_video_and_is_closed_on_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_video(tmp_path / "in.mp4", np.zeros((10, 128, 128, 3), np.uint8), 2, crf=18)
    follower = Follower(policies.of_images("rgb"))
    follow(tmp_path / "in.mp4", tmp_path / "out.mp4", follower, "slow")
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "out.mp4")) == (10, 5.0)
    closed, begin = [], imageio_ffmpeg.write_frames

    def watched(*args: Any, **settings: Any) -> Any:
        try:
            yield from begin(*args, **settings)
        finally:
            closed.append(True)

    def failing(*_: Any) -> Any:
        if steps:
            raise ValueError("broken")
        steps.append(True)
        return first

    steps: list[bool] = []
    first = follower(np.zeros((128, 128, 3), np.uint8))
    monkeypatch.setattr(imageio_ffmpeg, "write_frames", watched)
    failure: Any = Watched(failing)
    with pytest.raises(ValueError, match="broken") as caught:
        follow(tmp_path / "in.mp4", tmp_path / "bad.mp4", failure, "broken")
    assert closed and caught.value.args == ("broken",) and not (tmp_path / "bad.mp4").exists()
