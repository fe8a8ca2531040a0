"""Tests of recordings that are interrupted, and of the memory that a flight takes while it is recorded."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.datasets.episodes import ABOUT, SIZE, assert_same, flight
from thalweg.datasets.draft import check_new, draft_folder, finished_flights
from thalweg.datasets.episode import LAYERS
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.lerobot_flight import BLOCK
from thalweg.datasets.recordings import add_flight, read_recordings, recording
from thalweg.datasets.steps import DataSetWriter, FlightWriter, Sight, Step, write_flight

ROOT = Path(__file__).resolve().parents[2]
FLIGHTS = [flight(3), flight(2 * BLOCK + 5, seed=1), flight(BLOCK, seed=2, ended=False)]
FORMATS: list[tuple[Any, bool]] = [("lerobot", False), ("lerobot", True), ("minari", False)]
KILLED = """
import os, signal, sys
from pathlib import Path
from tests.datasets.episodes import ABOUT, flight
from tests.datasets.test_draft import FLIGHTS
from thalweg.datasets.recordings import add_flight, recording
from thalweg.datasets.steps import write_flight

class Killed:
    def __init__(self, writer):
        self.writer, self.see, self.end, self.steps = writer, writer.see, writer.end, 0
    def step(self, step, after):
        self.writer.step(step, after)
        self.steps += 1
        if self.steps == {after}:
            os.kill(os.getpid(), signal.SIGKILL)

with recording(Path(sys.argv[1]), {form!r}, ABOUT, video={video}) as writer:
    add_flight(writer, FLIGHTS[0])
    with writer.flight("River", {{}}) as second:
        write_flight(Killed(second), FLIGHTS[1])
"""


def killed(path: Path, form: str, video: bool, after: int) -> None:
    """Record a flight, and kill the process in the midst of the second one."""
    code = KILLED.format(form=form, video=video, after=after)
    ended = subprocess.run([sys.executable, "-c", code, str(path)], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == -signal.SIGKILL, ended.stderr


def assert_holds_all(path: Path, video: bool) -> None:
    """Assert that a data set holds `FLIGHTS`, and nothing of its draft."""
    found = list(read_recordings(path)[1])
    for one, wanted in zip(found, FLIGHTS, strict=True):
        if video:
            one = replace(one, rgb=wanted.rgb)  # lossy
        assert_same(one, wanted, frames=wanted.steps)
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    assert not any(each.name.startswith((".", "journal", "recording.json")) for each in path.rglob("*"))


@pytest.mark.parametrize(("form", "video"), FORMATS)
def test_a_killed_recording_keeps_what_it_has_finished_and_resumes(form: Any, video: bool, tmp_path: Path):
    path = tmp_path / "flights"
    killed(path, form, video, after=BLOCK + 7)
    assert not path.exists() and [each["steps"] for each in finished_flights(path)] == [3]
    assert list(draft_folder(path).rglob(".*.part*"))  # what was begun is there too
    with recording(path, form, ABOUT, video=video) as writer:
        assert writer.finished == 1
        for episode in FLIGHTS[1:]:
            add_flight(writer, episode)
    assert_holds_all(path, video)


def begun(path: Path, **options: Any) -> Path:
    """Record a flight, and fail in the second; returns the draft."""
    with pytest.raises(RuntimeError), recording(path, "lerobot", ABOUT, **options) as writer:
        add_flight(writer, FLIGHTS[0])
        raise RuntimeError
    return draft_folder(path)


REPLACES = """
import os, sys
from pathlib import Path
from tests.datasets.episodes import ABOUT
from tests.datasets.test_draft import FLIGHTS
from thalweg.datasets.recordings import add_flight, recording

done, replace = 0, os.replace

def replace_or_die(old, new):
    global done
    if sys.argv[2] in (str(done), Path(new).name):
        os._exit(9)
    done += 1
    replace(old, new)

os.replace = replace_or_die
with recording(Path(sys.argv[1]), "lerobot", ABOUT) as writer:
    for episode in FLIGHTS[writer.finished:]:
        add_flight(writer, episode)
"""


def record(path: Path, dies_at: object = None) -> int:
    """Record all flights in a process that ends at the replacing of a file, by number or name; returns its status."""
    return subprocess.run([sys.executable, "-c", REPLACES, str(path), str(dies_at)], cwd=ROOT).returncode


def test_a_recording_that_is_killed_while_it_notes_a_flight_resumes(tmp_path: Path):
    path = tmp_path / "flights"
    assert record(path, dies_at="000001.json") == 9
    (left,) = (draft_folder(path) / "journal").glob(".000001.*.part.json")
    assert left.read_text()
    assert len(finished_flights(path)) == 1
    assert record(path) == 0
    assert_holds_all(path, video=False)


@pytest.mark.slow
def test_a_recording_that_is_killed_at_any_replacing_of_a_file_resumes(tmp_path: Path):
    number = 0
    while record(tmp_path / str(number) / "flights", dies_at=number) == 9:
        assert record(tmp_path / str(number) / "flights") == 0, number
        assert_holds_all(tmp_path / str(number) / "flights", video=False)
        number += 1
    assert number >= 5  # the record, a note of each flight, and the name


@pytest.mark.parametrize("content", [b"", b'{"about": ', b"[]", b"\xff\xfe"])
@pytest.mark.parametrize("name", ["recording.json", "journal/000000.json"])
def test_a_damaged_file_of_a_draft_is_named_with_what_to_do(name: str, content: bytes, tmp_path: Path):
    draft = begun(tmp_path / "flights")
    (draft / name).write_bytes(content)
    told = f"{draft / name} is damaged .*remove the folder {draft}, .* to record anew, or name another --out"
    with pytest.raises(DatasetError, match=told.replace("damaged ", "damaged")):
        begun(tmp_path / "flights")


@pytest.mark.parametrize(
    ("before", "after"), [('"steps": 3', '"steps": 4'), ('"content"', '"conten"'), ('"flight"', '"f"')]
)
def test_a_note_of_another_content_is_damaged(before: str, after: str, tmp_path: Path):
    note = begun(tmp_path / "flights") / "journal/000000.json"
    text = note.read_text()
    assert text.count(before) == 1
    note.write_text(text.replace(before, after))
    with pytest.raises(
        DatasetError,
        match=r"000000\.json is damaged, or of an earlier version: .*: remove",
    ):
        finished_flights(tmp_path / "flights")


def test_a_draft_is_resumed_for_files_of_the_same_content_only(tmp_path: Path):
    path, river = tmp_path / "flights", {"file": "a.gpx", "content": "1"}
    draft = begun(path, files={"river": river})
    told = "a.gpx has changed since the recording in .* was started: its content was 1 and is 2 now"
    with pytest.raises(DatasetError, match=told):
        begun(path, files={"river": river | {"content": "2"}})
    with pytest.raises(DatasetError, match=r"files\.river\.file is 'a.gpx' there and 'b.gpx' here"):
        begun(path, files={"river": river | {"file": "b.gpx"}})
    with pytest.raises(DatasetError, match=r"files\.policy is absent there and present here"):
        begun(path, files={"river": river, "policy": river})
    assert begun(path, files={"river": river}) == draft and len(finished_flights(path)) == 2


@pytest.mark.parametrize("form", ["lerobot", "minari"])
def test_a_recording_that_fails_when_all_is_flown_is_finished_by_the_same_command(
    form: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "flights"
    with pytest.raises(RuntimeError, match="the power is off"), recording(path, form, ABOUT) as writer:
        for episode in FLIGHTS:
            add_flight(writer, episode)
        close = writer.close
        monkeypatch.setattr(writer, "close", lambda: (close(), fail()))
    with recording(path, form, ABOUT) as writer:
        assert writer.finished == len(FLIGHTS)
    assert_holds_all(path, video=False)


def fail(*_: Any, **__: Any) -> None:
    raise RuntimeError("the power is off")


@pytest.mark.parametrize("form", ["lerobot", "minari"])
def test_a_recording_without_a_finished_flight_leaves_nothing(form: Any, tmp_path: Path):
    with (
        pytest.raises(RuntimeError),
        recording(tmp_path / "flights", form, ABOUT) as writer,
        writer.flight("River", {}) as begun,
    ):
        write_flight(Stopped(begun), FLIGHTS[1])
    assert list(tmp_path.iterdir()) == []


class Stopped:
    """A writer that fails after a block of steps."""

    def __init__(self, writer: FlightWriter) -> None:
        self.see, self.end, self._step, self._count = writer.see, writer.end, writer.step, 0

    def step(self, step: Step, after: Sight) -> None:
        self._step(step, after)
        self._count += 1
        if self._count > BLOCK:
            fail()


def test_an_interrupted_recording_of_other_options_is_refused_by_their_names(tmp_path: Path):
    path = tmp_path / "flights"
    with pytest.raises(RuntimeError), recording(path, "minari", ABOUT, options={"seed": 3}) as writer:
        add_flight(writer, FLIGHTS[0])
        fail()
    told = r"\.flights\.part has flights of .* other options: .*options\.seed is 3 there and 4 here.*remove that folder"
    with pytest.raises(DatasetError, match=told), recording(path, "lerobot", ABOUT, options={"seed": 4}):
        pass
    assert [each["steps"] for each in finished_flights(path)] == [3]


def test_the_folder_that_a_command_stands_in_can_be_recorded_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path / "mine")
    check_new(Path("."))
    assert draft_folder(Path(".")) == tmp_path / ".mine.part" and finished_flights(Path(".")) == []
    with pytest.raises(DatasetError, match="/ is no folder for recordings: name a new one"):
        check_new(Path("/"))


def test_two_commands_do_not_record_to_one_folder(tmp_path: Path):
    path = tmp_path / "flights"
    with recording(path, "lerobot", ABOUT) as writer:
        with pytest.raises(DatasetError, match="another command is writing to"), recording(path, "lerobot", ABOUT):
            pass
        add_flight(writer, FLIGHTS[0])
    assert len(list(read_recordings(path)[1])) == 1


def test_no_other_command_takes_a_draft_that_is_being_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Another command waits for the lock while the draft takes its name."""
    path, errors, replace_ = tmp_path / "flights", [], os.replace

    def other() -> None:
        try:
            begun(path)
        except DatasetError as error:
            errors.append(str(error))

    waiting = threading.Thread(target=other)

    def slowly(source: Any, target: Any) -> None:
        if source == draft_folder(path) and not waiting.ident:
            waiting.start()
            time.sleep(0.2)
        replace_(source, target)

    monkeypatch.setattr(os, "replace", slowly)
    monkeypatch.setattr("thalweg.core.run_folder.WAIT_S", 60.0)
    with recording(path, "lerobot", ABOUT) as writer:
        for episode in FLIGHTS:
            add_flight(writer, episode)
    waiting.join()
    assert errors == [f"{path} is there already: name a new folder for the recordings"]
    assert_holds_all(path, video=False)


@pytest.mark.parametrize("form", ["lerobot", "minari"])
@pytest.mark.parametrize("first", [True, False])
def test_a_step_without_a_layer_of_the_data_set_is_refused(form: Any, first: bool, tmp_path: Path):
    whole, lacking = (
        Sight(images(*layers), np.zeros(2, np.float32), np.zeros(4), 0.0) for layers in (LAYERS, ("mask",))
    )
    step = Step(np.zeros(4, np.float32), np.ones(4, np.int64), 0.0, np.zeros(2), "pilot")
    told = "what is seen lacks depth and class, which every flight of the data set has"
    with recording(tmp_path / "flights", form, ABOUT) as writer:
        add_flight(writer, FLIGHTS[0])
        with pytest.raises(DatasetError, match=told), writer.flight("River", {}) as written:
            written.see(lacking if first else whole)
            written.step(step, whole if first else lacking)
    assert len(list(read_recordings(tmp_path / "flights")[1])) == 1


def images(*layers: str) -> dict[str, np.ndarray]:
    return {"rgb": np.zeros((*SIZE, 3), np.uint8), **{name: np.zeros(SIZE, np.uint8) for name in layers}}


@pytest.mark.parametrize(("form", "video"), FORMATS)
def test_the_images_in_memory_do_not_grow_with_the_flight(form: Any, video: bool, tmp_path: Path):
    living: list[weakref.ref[np.ndarray]] = []

    def sights() -> Iterator[Sight]:
        for t in range(4 * BLOCK):
            images = {"rgb": np.full((*SIZE, 3), t, np.uint8), "mask": np.zeros(SIZE, np.uint8)}
            living.append(weakref.ref(images["rgb"]))
            yield Sight(images, np.zeros(2, np.float32), np.zeros(4), float(t))

    most = 0
    with recording(tmp_path / "flights", form, replace(ABOUT, layers=("mask",)), video=video) as writer:
        most = flown(writer, sights(), living)
    assert most <= BLOCK + 3


def flown(writer: DataSetWriter, sights: Iterator[Sight], living: list["weakref.ref[np.ndarray]"]) -> int:
    """Write a flight of these sights, and return the greatest number of images that were alive at once."""
    most = 0
    move, option = np.zeros(4, np.float32), np.ones(4, np.int64)
    with writer.flight("River", {}) as written:
        written.see(next(sights))
        for sight in sights:
            written.step(Step(move, option, 0.0, np.zeros(2), "pilot"), sight)
            del sight
            most = max(most, sum(each() is not None for each in living))
        written.end(False, -1)
    return most


@pytest.mark.parametrize("form", ["lerobot", "minari"])
@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"pilots": ()}, "pilots must be a name for each step"),
        ({"reason": 9}, "the reason for its end is 9"),
        ({"rewards": np.array([0.0, np.nan, 0.0])}, "rewards holds what is no finite number"),
        ({"mask": np.zeros((4, *SIZE), bool)}, "mask are numbers of bool, not of uint8"),
    ],
)
def test_a_flight_that_could_not_be_read_again_is_not_written(form: Any, change: dict, error: str, tmp_path: Path):
    with (
        pytest.raises(DatasetError, match=f"the flight cannot be recorded: {error}"),
        recording(tmp_path / "data", form, ABOUT) as writer,
    ):
        add_flight(writer, replace(FLIGHTS[0], **change))
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("form", ["lerobot", "minari"])
def test_the_folder_that_one_is_in_may_be_named_by_a_dot(form: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "data").mkdir()
    monkeypatch.chdir(tmp_path / "data")
    with recording(Path(), form, ABOUT) as writer:
        add_flight(writer, FLIGHTS[0])
    assert_same(next(read_recordings(tmp_path / "data")[1]), FLIGHTS[0], frames=3)


def test_a_mount_point_is_refused_before_anything_is_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os.path, "ismount", lambda path: path == tmp_path / "disk")
    (tmp_path / "disk").mkdir()
    with pytest.raises(DatasetError, match="disk is a mount point"):
        check_new(tmp_path / "disk")


@pytest.mark.parametrize("form", ["lerobot", "minari"])
def test_features_of_one_number_are_kept(form: Any, tmp_path: Path):
    about = replace(ABOUT, proprioception=("height",), cost_kinds=("tight",))
    one = replace(FLIGHTS[0], proprioception=FLIGHTS[0].proprioception[:, :1], costs=FLIGHTS[0].costs[:, :1])
    with recording(tmp_path / "data", form, about) as writer:
        add_flight(writer, one)
    assert_same(next(read_recordings(tmp_path / "data")[1]), one, frames=3)


def test_a_draft_whose_moves_may_have_another_meaning_is_not_resumed(tmp_path: Path):
    record = begun(tmp_path / "flights") / "recording.json"
    told = json.loads(record.read_text())
    del told["moves"]
    record.write_text(json.dumps(told))
    with pytest.raises(DatasetError, match="moves is absent there and 'plain steps' here"):
        begun(tmp_path / "flights")
