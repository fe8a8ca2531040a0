"""Tests of policies over videos."""

from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from tests.deploy import policies
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.cli.main import main
from thalweg.core.video import VideoError, open_video, read_video, write_video
from thalweg.deploy.errors import ExportError
from thalweg.deploy.export import Exportable
from thalweg.deploy.follow import (
    BACKGROUND,
    MARGIN_PX,
    QUIET,
    VIEW_PX,
    WATER_RGB,
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

MOVES = moves_in_words("multidiscrete")


class Watched:
    """A stand-in for a `Follower` that calls a function."""

    moves = MOVES

    def __init__(self, see: Any, step_s: float = 0.25) -> None:
        self.see, self.step_s = see, step_s

    def __call__(self, frame: np.ndarray) -> Any:
        return self.see(frame)


def test_the_middle_of_a_frame_is_cut_to_the_shape_of_the_camera():
    frame = np.zeros((60, 100, 3), np.uint8)
    frame[:, 20:80] = np.arange(60)[None, :, None]
    found = cut_to(frame, (30, 30))
    assert found.shape == (30, 30, 3)
    np.testing.assert_allclose(found[7, :, 0], np.arange(30) * 2 + 0.5, atol=0.5)


@pytest.mark.parametrize(("step_s", "every", "shown"), [(0.25, 3, (8, 2.0)), (0.5, 6, (4, 2.0))])
def test_frames_that_are_a_step_apart_are_read(step_s: float, every: int, shown: tuple, tmp_path: Path):
    frames = np.repeat(np.arange(24, dtype=np.uint8)[:, None, None, None] * 10, 64, 1).repeat(64, 2).repeat(3, 3)
    write_video(tmp_path / "fast.mp4", frames, 12, crf=18)
    seen: list[float] = []

    def watcher(frame: np.ndarray) -> Any:
        seen.append(float(frame.mean()))
        return frame, np.ones(4, int), None

    follower: Any = Watched(watcher, step_s)
    follow(tmp_path / "fast.mp4", tmp_path / "out.mp4", follower, "watcher")
    np.testing.assert_allclose(seen, np.arange(0, 24, every) * 10, atol=3)
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "out.mp4")) == shown


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
        overlay(colours, np.array([1, 1, option, 1]), follower.moves, None, "mine", 1).astype(int) for option in (2, 1)
    )
    assert ((third != none).any(), (third > QUIET).all(-1).sum() > (none > QUIET).all(-1).sum()) == (bright, bright)


def test_a_policy_of_colours_alone_needs_no_segmenter():
    follower = Follower(policies.of_images("rgb"))
    colours, options, mask = follower(np.zeros((90, 160, 3), np.uint8))
    assert colours.shape == (128, 128, 3) and options.shape == (4,) and mask is None


def test_what_a_video_does_not_have_is_refused():
    with pytest.raises(ExportError, match=r"sees rgb\+mask: finding the water in a video needs a segmenter"):
        Follower(policies.of_images("rgb+mask"))
    with pytest.raises(ExportError, match="takes proprioception, which a video does not have"):
        Follower(policies.of_codes("default", felt=True)[0], load_segmenter())


def test_the_overlay_of_a_wide_frame_keeps_its_shape():
    colours = np.full((48, 96, 3), 200, np.uint8)
    drawn = overlay(colours, np.ones(4, int), MOVES, np.full((48, 96), 255, np.uint8), "mine", 1)
    shown = (drawn[:, MARGIN_PX : MARGIN_PX + VIEW_PX] != BACKGROUND).any(axis=(1, 2))
    rows = np.flatnonzero(shown)
    assert (len(rows), rows[0]) == (VIEW_PX // 2, MARGIN_PX + VIEW_PX // 4)


def test_the_overlay_shades_the_water_that_was_found():
    colours = np.zeros((128, 128, 3), np.uint8)
    mask = np.zeros((128, 128), np.uint8)
    mask[64:] = 255
    dry, wet = (overlay(colours, np.ones(4, int), MOVES, each, "mine", 1) for each in (np.zeros_like(mask), mask))
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


def test_sides_that_the_segmenter_does_not_take_are_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Exportable, "camera", Camera(height_px=120, width_px=128))
    with pytest.raises(ExportError, match=r"frames of 120 x 128 pixels .* multiples of 16"):
        Follower(policies.of_images("rgb+mask"), load_segmenter())


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
