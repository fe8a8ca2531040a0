"""Tests of `thalweg fly` on the command line: what it refuses before it serves, its port, and its end."""

import os
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from tests.deploy import policies
from tests.image_policies import image_policy
from thalweg.bench.packaged import PACKAGED_POLICIES
from thalweg.cli.flight_options import free_name
from thalweg.cli.fly import Fly
from thalweg.cli.main import main
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.looks import LOOKS
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.viewer.server import app
from thalweg.viewer.server.app import USUAL_PORT, bind
from thalweg.world import World

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--port", "70000"], "--port must be from 0 to 65535, not 70000"),
        (["--host", "0.0.0.0"], "--host 0.0.0.0 would serve on all addresses"),
        (["--level", "Eazy"], "'Eazy'"),
        (["--look", "autum"], "did you mean 'autumn'?"),
        (["--size", "20"], "--size must be a whole number from 32 to 768"),
        (["--task", "Nest"], "unknown task 'Nest' (did you mean 'Nests'?)"),
        (["--vehicle", "asv", "--task", "Nests"], "task must be River for the vehicle asv"),
        (["missing/policy"], "no policy at missing/policy"),
    ],
)
def test_a_wrong_option_is_refused_before_anything_is_served(
    options: list[str], error: str, capsys: pytest.CaptureFixture
):
    assert main(["fly", *options]) == 2
    told = capsys.readouterr()
    assert error in told.err and told.out == ""


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture):
    (tmp_path / "flights").write_text("")
    assert main(["fly", "--out", str(tmp_path / "flights")]) == 2
    assert "is not a folder" in capsys.readouterr().err
    assert main(["fly", "--out", str(tmp_path / "flights" / "below")]) == 2
    told = f"--out {tmp_path / 'flights' / 'below'}: {tmp_path / 'flights'} is not a folder"
    assert told in capsys.readouterr().err


def test_the_help_names_all_looks():
    help_text = (ROOT / "thalweg" / "cli" / "flight_options.py").read_text()
    (listed,) = re.findall(r'"""Appearance: (.*)\."""', help_text)
    assert re.split(", | or ", listed) == list(LOOKS)


def test_a_port_that_is_taken_is_named_unless_none_was_asked_for():
    with bind(0) as taken:
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ViewerError, match=f"port {port} of 127.0.0.1 cannot be used: another program has it"):
            bind(port)
    with socket.socket() as usual:
        usual.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            usual.bind(("127.0.0.1", USUAL_PORT))
            usual.listen()
        except OSError:  # something else has it, which serves as well
            pass
        with bind(None) as other:
            assert other.getsockname()[1] != USUAL_PORT


@pytest.mark.parametrize(("windows", "option"), [(False, "SO_REUSEADDR"), (True, "SO_EXCLUSIVEADDRUSE")])
def test_a_port_is_never_shared_with_another_program(windows: bool, option: str, monkeypatch: pytest.MonkeyPatch):
    asked: list[str] = []

    class Asked(socket.socket):
        def setsockopt(self, level: int, name: Any, value: Any) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
            asked.append(name)

    for name in ("SO_REUSEADDR", "SO_EXCLUSIVEADDRUSE"):
        monkeypatch.setattr(socket, name, name, raising=False)  # the second one is Windows's alone
    monkeypatch.setattr(app, "ON_WINDOWS", windows)
    monkeypatch.setattr(socket, "socket", Asked)
    bind(0).close()
    assert asked == [option]


def test_policies_of_one_name_are_told_apart():
    assert [free_name("policy", taken) for taken in ([], ["policy"], ["policy", "policy (2)"])] == [
        *("policy", "policy (2)", "policy (3)")
    ]
    assert list(Fly()._loaders()) == ["packaged", "packaged-rgb"]


def test_a_policy_does_not_stand_for_a_pilot_of_its_folders_name(tmp_path: Path):
    given = []
    for name in ("steady", "hand", "replay", "packaged"):
        (tmp_path / name).mkdir()
        image_policy("rgb", 32).save(tmp_path / name / "policy.safetensors")
        given.append(str(tmp_path / name))
    assert list(Fly(policies=tuple(given))._loaders()) == [
        *("steady (2)", "hand (2)", "replay (2)", "packaged (2)", "packaged", "packaged-rgb")
    ]
    both = ["packaged", "packaged-rgb"]
    assert list(Fly(policies=("packaged",))._loaders()) == both
    assert list(Fly(policies=("packaged-rgb",))._loaders()) == both[::-1]  # the first one flies first
    assert list(Fly(policies=("steady",))._loaders()) == both  # the pilot is on the page anyway


@pytest.fixture
def numbers(tmp_path: Path) -> Path:
    """The file of a policy of continuous actions."""
    policies.of_images_and_numbers().save(tmp_path / "numbers.safetensors")
    return tmp_path / "numbers.safetensors"


@pytest.mark.parametrize(
    ("given", "action"),
    [
        (["packaged"], "multidiscrete"),
        ([], "multidiscrete"),
        (["packaged", "NUMBERS"], "continuous"),
        (["steady", "NUMBERS"], "continuous"),
        (["packaged", "--action", "continuous"], "continuous"),
    ],
)
def test_flights_have_the_actions_of_the_policies(
    given: list[str], action: str, numbers: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    begun: list[Any] = []

    def make_shared(*_: Any, **settings: Any) -> Any:
        begun.append(settings["options"])
        raise ViewerError("enough")

    monkeypatch.setattr(app, "make_shared", make_shared)
    names = [str(numbers) if name == "NUMBERS" else name for name in given]
    assert main(["fly", *names, "--out", str(tmp_path / "flights")]) == 2
    assert [options.action for options in begun] == [action]


def test_other_actions_than_those_of_a_policy_are_refused(numbers: Path, capsys: pytest.CaptureFixture):
    assert main(["fly", "packaged", str(numbers), "--action", "multidiscrete"]) == 2
    told = f"--action multidiscrete does not go with {numbers}, which has continuous actions: leave it out"
    assert told in capsys.readouterr().err


def test_functions_are_watched_too(tmp_path: Path, easy_world: World):
    (tmp_path / "mine.py").write_text("def fly(image):\n    return 1, 1, 2, 1\n")
    name = f"{tmp_path}/mine.py:fly"
    loaders = Fly(policies=(name,))._loaders()
    assert list(loaders) == [name, *PACKAGED_POLICIES]
    cockpit = Cockpit(loaders, Folder(tmp_path), name)
    cockpit.start(easy_world, FlightOptions(level="Easy", size_px=32))
    assert cockpit.advance(2) and cockpit.flight is not None
    assert [action.tolist() for action in cockpit.flight.actions] == [[1, 1, 2, 1]] * 2


def heed_interrupts() -> None:
    """Let Ctrl-C end this process, also where the tests run in the background, which passes on that it is ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.slow
def test_the_server_answers_at_its_address_alone_and_ends_well_when_interrupted(tmp_path: Path):
    command = [sys.executable, "-m", "thalweg", "fly", "--port", "0", "--out", str(tmp_path / "flights")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=environment, cwd=tmp_path, preexec_fn=heed_interrupts, **pipes) as server:
        assert server.stdout is not None and server.stderr is not None
        address = server.stdout.readline().split()[-1]
        with urllib.request.urlopen(address) as answer:
            assert b"<title>Thalweg" in answer.read()
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"{address.rsplit('/', 2)[0]}/")
        assert refused.value.code == 404
        server.send_signal(signal.SIGINT)
        assert server.wait(30) == 0
        assert server.stderr.read() == "\nStopped.\n"
    assert list(tmp_path.iterdir()) == []
