"""Tests of videos: what is read is what was written, and what ffmpeg does not say of its errors."""

import errno
import subprocess
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from thalweg.core.atomic_io import atomic_path
from thalweg.core.video import VideoError, comment_of, open_video, read_video, write_video

FRAMES = np.repeat(np.arange(6, dtype=np.uint8) * 40, 32 * 34 * 3).reshape(6, 32, 34, 3)


def test_frames_and_their_rate_are_read_as_they_were_written(tmp_path: Path):
    assert write_video(tmp_path / "a.mp4", iter(FRAMES), 12.5, crf=1, key_every=2) == 6
    with open_video(tmp_path / "a.mp4") as video:
        found = np.stack(list(video.frames))
    assert video.fps == 12.5 and found.shape == FRAMES.shape
    assert np.abs(found.astype(int) - FRAMES).max() <= 2  # rounding of luma and chroma


@pytest.mark.parametrize(("key_every", "keys"), [(None, 1), (2, 3), (3, 2)])
def test_reading_can_begin_at_every_key_frame(tmp_path: Path, key_every: int | None, keys: int):
    write_video(tmp_path / "a.mp4", np.zeros((6, 32, 34, 3), np.uint8), 4, crf=20, key_every=key_every)
    decode = ["-skip_frame", "nokey", "-i", str(tmp_path / "a.mp4"), "-fps_mode", "passthrough", "-f", "rawvideo", "-"]
    told = subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *decode], capture_output=True, check=True)
    assert len(told.stdout) == keys * 32 * 34 * 3 // 2  # yuv420p


def test_a_comment_is_kept_in_the_metadata_and_changes_no_frame(tmp_path: Path):
    write_video(tmp_path / "bare.mp4", FRAMES, 4, crf=20)
    write_video(tmp_path / "told.mp4", FRAMES, 4, crf=20, comment="thalweg film")
    assert [comment_of(tmp_path / name) for name in ("bare.mp4", "told.mp4", "absent.mp4")] == ["", "thalweg film", ""]
    write_video(tmp_path / "a.mp4", FRAMES, 4, crf=20, comment=r"a=b; c\d # e")
    assert comment_of(tmp_path / "a.mp4") == r"a=b; c\d # e"
    bare, told = (np.stack([*read_video(tmp_path / f"{name}.mp4")]) for name in ("bare", "told"))
    np.testing.assert_array_equal(bare, told)


def test_without_a_frame_nothing_is_written(tmp_path: Path):
    assert write_video(tmp_path / "a.mp4", [], 4, crf=20) == 0
    assert list(tmp_path.iterdir()) == []


def test_odd_sides_are_refused(tmp_path: Path):
    with pytest.raises(VideoError, match="an even height and width, not 32 x 33"):
        write_video(tmp_path / "a.mp4", FRAMES[:, :, :33], 4, crf=20)


def test_what_is_no_video_is_named(tmp_path: Path):
    path = tmp_path / "a.mp4"
    with pytest.raises(FileNotFoundError) as missing:
        list(read_video(path))
    assert missing.value.filename == str(path)
    path.write_bytes(b"no video")
    with pytest.raises(VideoError, match=r"a\.mp4 cannot be read as a video: "):
        list(read_video(path))


def test_a_rate_that_is_not_known_is_not_a_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "a.mp4").touch()
    monkeypatch.setattr("imageio_ffmpeg.read_frames", lambda _: (each for each in [{"size": (64, 64)}]))
    with open_video(tmp_path / "a.mp4") as video:
        assert np.isnan(video.fps) and list(video.frames) == []


def test_errors_in_drawing_frames_are_not_those_of_the_video(tmp_path: Path):
    def frames() -> Iterator[np.ndarray]:
        yield FRAMES[0]
        raise OSError("the scene is broken")

    with pytest.raises(OSError, match="the scene is broken"):
        write_video(tmp_path / "a.mp4", frames(), 4, crf=20)


def test_frames_of_another_size_are_refused(tmp_path: Path):
    frames = [FRAMES[0], FRAMES[1, :, :32]]
    with pytest.raises(VideoError, match=r"a\.mp4 needs .*: one of 32 x 32 came after those of 32 x 34"):
        write_video(tmp_path / "a.mp4", frames, 4, crf=20)


def test_what_ffmpeg_does_not_take_is_named_as_the_file_that_was_wanted(tmp_path: Path):
    path = tmp_path / "film.badext"
    frames = np.zeros((8, 512, 512, 3), np.uint8)  # each more than a pipe holds
    with pytest.raises(VideoError) as raised, atomic_path(path) as draft:
        write_video(draft, frames, 4, crf=20, name=path)
    start, reason = str(raised.value).split("video: ")
    assert start == f"{path} cannot be written as a "
    assert reason.startswith("[Errno ") and "FFMPEG" not in reason and "\n" not in reason
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["write_frames", "count_frames_and_secs"])
@pytest.mark.parametrize("free", [0, 10**9], ids=["full", "not full"])
def test_a_pipe_to_ffmpeg_that_breaks_on_a_full_disk_is_the_error_of_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, place: str
):
    said = {
        "write_frames": "[Errno 32] Broken pipe\n\nFFMPEG COMMAND:\nffmpeg ...\n\nFFMPEG STDERR OUTPUT:\n",
        "count_frames_and_secs": "FFMPEG call failed with 1:\nffmpeg version ...\n[Errno 32] Broken pipe\n",
    }

    def broken(*_: object, **__: object):
        raise OSError(said[place])

    monkeypatch.setattr(f"imageio_ffmpeg.{place}", broken)
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage(10**9, 10**9 - free, free))
    path = tmp_path / "film.mp4"
    with pytest.raises((OSError, VideoError)) as raised, atomic_path(path) as draft:
        write_video(draft, FRAMES, 4, crf=20, name=path)
    if free:
        assert isinstance(raised.value, VideoError)
        assert str(raised.value) == f"{path} cannot be written as a video: [Errno 32] Broken pipe"
    else:
        assert isinstance(raised.value, OSError)
        assert (raised.value.errno, raised.value.filename) == (errno.ENOSPC, str(path))
    assert list(tmp_path.iterdir()) == []
