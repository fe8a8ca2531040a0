"""Writing of recordings in a chosen format, and reading in any of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, Protocol, get_args

from thalweg.core.suggestion import did_you_mean
from thalweg.datasets.episode import About, RecordedEpisode
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.lerobot_reader import is_lerobot, read_lerobot
from thalweg.datasets.lerobot_writer import LeRobotWriter
from thalweg.datasets.minari_files import MinariWriter, check_name, is_minari, read_minari
from thalweg.datasets.new_folder import check_new, new_folder

Format = Literal["lerobot", "minari"]
FORMATS: tuple[Format, ...] = get_args(Format)


class Writer(Protocol):
    """Takes flights one after the other."""

    def add(self, episode: RecordedEpisode) -> None:
        """Write a flight.

        Raises `DatasetError` if it has other actions or another size than those before it, or makes no video, and
        `OSError` for a full disk.
        """
        ...


def check_recording(path: Path, form: str, *, video: bool) -> None:
    """Raise `DatasetError` for a folder or a format that cannot be written, before anything is flown."""
    if form not in FORMATS:
        raise DatasetError(f"unknown format {form!r}{did_you_mean(form, FORMATS)}; known: {', '.join(FORMATS)}")
    if form == "minari":
        if video:
            raise DatasetError("Minari keeps no videos: its frames are lossless; leave out --video")
        check_name(path)
    check_new(path)


@contextmanager
def recording(path: Path, form: Format, about: About, *, video: bool = False) -> Iterator[Writer]:
    """Yield a writer of flights; the folder appears when all of them are written.

    `video`: keep the colours as H.264 instead of lossless frames. Raises the errors of `check_recording`,
    `DatasetError` if no flight was added, and `OSError`, which names a file, for a disk that takes no more.
    """
    check_recording(path, form, video=video)
    with new_folder(path) as draft:
        if form == "lerobot":
            writer = LeRobotWriter(draft, about, video=video, name=path)
        else:
            writer = MinariWriter(draft, path.name, about)
        yield writer
        writer.close()
        if not any(draft.iterdir()):
            raise DatasetError("nothing was recorded")


def read_recordings(folder: Path) -> tuple[About, Iterator[RecordedEpisode]]:
    """Return the description of the data set in a folder, and an iterator that reads its flights one after the other.

    Raises `DatasetError` for a folder without a data set, and for one that Thalweg did not record; so does the iterator
    for a flight that cannot be read whole.
    """
    if is_lerobot(folder):
        return read_lerobot(folder)
    if is_minari(folder):
        return read_minari(folder)
    what = "is no folder" if not folder.is_dir() else "holds no data set of LeRobot or Minari"
    raise DatasetError(f"{folder} {what}: give one that thalweg record wrote")
