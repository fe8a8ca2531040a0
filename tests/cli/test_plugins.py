"""Tests of plug-ins on the command line: --plugin, what is said of broken ones, and --set help."""

import shlex
import shutil
from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import pytest

from tests.plugins import EXAMPLE, NESTS, SQUARES, install, no_plugins  # noqa: F401  (a fixture)
from thalweg.algos import ALGORITHMS
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.cli.encoder import ENCODER_COMMANDS
from thalweg.cli.evaluate import Evaluate
from thalweg.cli.main import COMMANDS, main
from thalweg.cli.options import Plugins
from thalweg.train import RunResult
from thalweg.train.river import RiverTraining

pytestmark = pytest.mark.usefixtures("no_plugins")


def settings_in(text: str) -> list[str]:
    return [line.partition("=")[0] for line in text.splitlines()[1:] if line and not line.startswith(" ")]


@pytest.mark.parametrize("algorithm", ["PPO", "SACLag", "SafeLOOP"])
def test_help_of_settings_lists_each_with_its_default_and_its_meaning(
    algorithm: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["train", algorithm, "--set", "help"]) == 0
    text = capsys.readouterr().out
    assert settings_in(text) == [field.name for field in fields(ALGORITHMS[algorithm].config)]
    assert "no docstring" not in text
    assert max(len(line) for line in text.splitlines() if line.startswith(" ")) <= 80


def test_defaults_in_the_help_are_those_of_preset_and_environments(capsys: pytest.CaptureFixture[str]):
    main(["train", "PPO", "--set", "help", "--preset", "paper"])
    assert "\nsteps_per_update=20000\n    Environment steps between two updates" in capsys.readouterr().out
    main(["train", "PPO", "--set", "help", "--num-envs", "128"])
    assert "\nsteps_per_update=4096\n" in capsys.readouterr().out


def test_help_of_a_plugin_and_of_imitation(capsys: pytest.CaptureFixture[str]):
    assert main(["train", "PricedPG", "--plugin", str(EXAMPLE), "--set", "help"]) == 0
    assert capsys.readouterr().out.endswith("\nprice=2.0\n    Reward that a cost of 1 takes away.\n")
    assert main(["imitate", "--set", "help"]) == 0
    assert settings_in(capsys.readouterr().out) == [
        field.name for field in fields(ImitationConfig) if field.name != "observation"
    ]


@pytest.mark.parametrize(("command", "name"), [("train", "FOCOPS"), ("imitate", "student")])
def test_a_run_without_a_folder_is_refused_with_one_to_try(command: str, name: str, capsys: pytest.CaptureFixture[str]):
    assert main([command]) == 2
    assert f"--out is missing: name the folder of the run, such as --out runs/{name}" in capsys.readouterr().err


NEEDED = {
    "evaluate": ["hover"],
    "bench": ["quick", "--out", "x"],
    "report": ["x"],
    "leaderboard": ["x"],
    "follow": ["x"],
}
"""What some commands need beside their options."""
USE_NONE = {"world", "speed", "imitate", "encoder train", "encoder study"}
"""Commands that use no algorithm, encoder, task or report section of a plug-in."""
EVERY = {**COMMANDS, **{f"encoder {name}": kind for name, kind in ENCODER_COMMANDS.items()}}
EVERY.pop("encoder")


def test_every_command_takes_plugins_in_one_way_or_uses_none():
    takes = {name for name, kind in EVERY.items() if get_type_hints(kind, include_extras=True).get("plugin") == Plugins}
    assert takes == set(EVERY) - USE_NONE
    assert [name for name in USE_NONE if "plugin" in {field.name for field in fields(EVERY[name])}] == []


@pytest.mark.parametrize("command", sorted(set(EVERY) - USE_NONE))
def test_the_help_of_plugins_is_the_same_in_every_command(command: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--plugin FILE Python file with algorithms, encoders, tasks or report sections of your own; may be" in shown


@pytest.mark.parametrize("command", sorted(set(EVERY) - USE_NONE))
def test_a_broken_plugin_is_named_with_its_line_by_every_command(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    good, broken = Path(shutil.copy(EXAMPLE, tmp_path / "good.py")), tmp_path / "broken.py"
    broken.write_text("x = 1\ny = x / 0\n")
    given = [*command.split(), *NEEDED.get(command, [])]
    assert main([*given, "--plugin", str(good), "--plugin", str(broken)]) == 2
    assert capsys.readouterr().err == f"thalweg: {broken}, line 2: ZeroDivisionError: division by zero\n"


@pytest.mark.parametrize("name", ["encoder", "task", "loader"])
def test_the_evaluation_that_a_run_advises_loads_its_plugins(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    file = tmp_path / "my plug-in.py"
    result = RunResult(tmp_path / "run", "PPO", 5, 1, 0.0, 0.0, 0.0, 1.0, None, False, ())
    source, given = {
        "encoder": (SQUARES, ["--encoder", "squares"]),
        "task": (NESTS, ["--task", "HighNests", "--observation", "privileged"]),
        "loader": (EXAMPLE.read_text(), ["PricedPG", "--observation", "privileged"]),
    }[name]
    file.write_text(source)
    monkeypatch.setattr(RiverTraining, "train", lambda *_, **__: result)
    assert main(["train", *given, "--plugin", str(file), "--level", "easy", "--out", str(result.folder)]) == 0
    line = capsys.readouterr().out.splitlines()[-1].removeprefix("Evaluate it: thalweg ")
    flown: list[Evaluate] = []
    monkeypatch.setattr("thalweg.cli.evaluate.evaluate_and_print", lambda command, _: flown.append(command))
    assert main(shlex.split(line)) == 0
    assert flown[0].plugin == (file,)


def test_a_broken_entry_point_stops_no_command_that_does_not_ask_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    install(tmp_path, {"thalweg.algorithms": {"Broken": "nowhere_at_all:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert main(["train", "PPO", "--set", "help"]) == 0
    assert main(["train", "Broken", "--set", "help"]) == 2
    assert "the entry point 'Broken' of mine 1.0 (nowhere_at_all:PLUGIN) cannot be loaded" in capsys.readouterr().err


def test_the_encoder_of_a_plugin_is_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "squares.py").write_text(SQUARES)
    given = ["--plugin", str(tmp_path / "squares.py"), "--out", str(tmp_path / "x.png")]
    assert main(["encoder", "show", "--path", "squares", *given]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {"name: squares", "about: shares of water in squares", "version: 1"} <= set(lines)
    assert not (tmp_path / "x.png").exists()
