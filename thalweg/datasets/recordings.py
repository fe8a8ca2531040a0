"""Writing of recordings in a chosen format, and reading in any of them."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, get_args

from thalweg.core.suggestion import did_you_mean
from thalweg.datasets.draft import check_new, draft_of
from thalweg.datasets.episode import About, RecordedEpisode, episode_error
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.lerobot_reader import is_lerobot, read_lerobot
from thalweg.datasets.lerobot_writer import LeRobotWriter
from thalweg.datasets.minari_layout import check_name
from thalweg.datasets.minari_reader import is_minari, read_minari
from thalweg.datasets.minari_writer import MinariWriter
from thalweg.datasets.steps import DataSetWriter, write_flight

Format = Literal["lerobot", "minari"]
FORMATS: tuple[Format, ...] = get_args(Format)
NO_OPTIONS: Mapping[str, Any] = {}
NO_FILES: Mapping[str, Mapping[str, str]] = {}


def check_recording(path: Path, form: str, *, video: bool) -> None:
    """Raise `DatasetError` for a folder or a format that cannot be written, before anything is flown."""
    if form not in FORMATS:
        raise DatasetError(f"unknown format {form!r}{did_you_mean(form, FORMATS)}; known: {', '.join(FORMATS)}")
    if form == "minari":
        if video:
            raise DatasetError("Minari keeps no videos: its frames are lossless; leave out --video")
        check_name(path.absolute())
    check_new(path)


@contextmanager
def recording(
    path: Path,
    form: Format,
    about: About,
    *,
    video: bool = False,
    options: Mapping[str, Any] = NO_OPTIONS,
    files: Mapping[str, Mapping[str, str]] = NO_FILES,
) -> Iterator[DataSetWriter]:
    """Yield a writer of flights; the folder appears when the block ends without an error.

    Each flight that is finished is kept, whatever happens after it: the same recording, begun again, has it already.

    Args:
        path: Folder of the data set.
        form: Its format.
        about: What all flights have in common.
        video: Keep the colours as H.264 instead of lossless frames.
        options: What says which flights are recorded, as plain data; one that was interrupted resumes only if it is
            the same.
        files: `file`, the name, and `content`, its hash, of each file that decides what is recorded, by what it is
            for; one that has changed since then is refused by its name.

    Raises the errors of `check_recording` and `draft_of`, and `DatasetError` if no flight was added.
    """
    check_recording(path, form, video=video)
    # A draft from before `moves` was recorded has -1 for fast steps, and for options that do nothing.
    how = {"format": form, "video": video, "moves": "plain steps"}
    told = {**how, "about": asdict(about), "options": dict(options), "files": dict(files)}
    with draft_of(path, told) as draft:
        writer = LeRobotWriter(draft, about, video=video) if form == "lerobot" else MinariWriter(draft, about)
        yield writer
        if not writer.finished:
            raise DatasetError("nothing was recorded")
        writer.close()


def add_flight(writer: DataSetWriter, episode: RecordedEpisode) -> None:
    """Write a flight that is in memory.

    Raises `DatasetError` for one that could not be read again, and the errors of `FlightWriter.step`.
    """
    if wrong := episode_error(episode, writer.about):
        raise DatasetError(f"the flight cannot be recorded: {wrong}")
    with writer.flight(episode.task, episode.options_of_flight) as flight:
        write_flight(flight, episode)


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
