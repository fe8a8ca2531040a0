"""Tests of the command line: help, error messages and exit codes."""

import csv
import errno
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.evaluate.course import UNSEEN
from thalweg.bench.suite.builtin import SUITES
from thalweg.cli.command import Command
from thalweg.cli.encoder import ENCODER_COMMANDS, EncoderTrain
from thalweg.cli.main import COMMANDS, _parse, main
from thalweg.cli.options import NO_FILE, RiverFile, UsageError, settings_from
from thalweg.cli.render import RenderFrames
from thalweg.train.encoder.water import WaterTraining
from thalweg.train.folder.checkpoint import save_checkpoint
from thalweg.world import World


def test_help_names_every_command_and_imports_nothing_heavy():
    heavy = ("torch", "numba", "matplotlib", "scipy")
    code = f"""
import sys
from thalweg.cli.main import main
try:
    main(["--help"])
except SystemExit:
    print("LOADED", [name for name in {heavy!r} if name in sys.modules])
"""
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "LOADED []" in output
    assert all(name in output for name in COMMANDS)


HELPS = [
    [],
    ["encoder"],
    *([name] for name in COMMANDS if name != "encoder"),
    *(["encoder", n] for n in ENCODER_COMMANDS),
]


def help_lines(command: list[str], columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit) as ended:
        main([*command, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("command", HELPS, ids=" ".join)
def test_no_line_of_a_help_is_wider_than_the_terminal(
    command: list[str], columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    lines = help_lines(command, columns, monkeypatch, capsys)
    assert [line for line in lines if len(line) > columns] == []


@pytest.mark.parametrize("command", [each for each in HELPS if each not in ([], ["encoder"])], ids=" ".join)
def test_the_help_of_an_option_is_broken_nowhere_but_at_the_width(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    lines = help_lines(command, 1000, monkeypatch, capsys)
    inside = [line.strip("│ ") for line in lines if line.startswith(("│ ", "  ")) and line.strip("│ ")]
    texts = [line for line in inside if ("  " in line or not line.startswith("-")) and not line.startswith("-h")]
    assert texts
    assert [text for text in texts if not text.endswith(")")] == []  # a text ends with its default, or (required)


def test_the_help_of_encoder_train_names_the_defaults_of_each_target(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setattr(WaterTraining.__dataclass_fields__["epochs"], "default", 77)
    text = " ".join(line.strip("│ ") for line in help_lines(["encoder", "train"], 1000, monkeypatch, capsys))
    for told in (
        "Size of a code. (default: 16 for image, 32 for geometry)",
        "several. (default: Medium for image, Easy Medium Hard for geometry, Easy Medium Hard for water)",
        "With --river geometry and water: 1000:1006. (default: 1000:1022 for geometry, 1000:1006 for water)",
        "for measurement only. (default: 3000:3006 for geometry, 3000:3002 for water)",
        "(default: 2000 for image, 4096 for geometry, 2048 for water)",
        "(default: 200 for image, 1024 for geometry, 384 for water)",
        "Epochs of training. (default: 100 for image, 16 for geometry, 77 for water)",
        "of flights. (default: 96 for geometry)",
        "or auto. (default: cpu for geometry)",
        "the ground. (default: full for image, fast for geometry, full for water)",
    ):
        assert told in text


def test_the_help_of_bench_names_every_suite(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    text = " ".join(help_lines(["bench"], 1000, monkeypatch, capsys))
    assert f"{', '.join(SUITES)}, or your own YAML file." in text


def test_the_help_of_train_names_every_algorithm(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    text = "\n".join(help_lines(["train"], 1000, monkeypatch, capsys))
    *names, last = ALGORITHMS
    assert f"{', '.join(names)} or {last}; also as `train PPO`." in text


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGPIPE")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["report", "nothing_here"]], ids=" ".join)
def test_a_closed_pipe_ends_a_command_quietly(arguments: list[str], unbuffered: str):
    read, write = os.pipe()
    os.close(read)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    command = [sys.executable, "-m", "thalweg", *arguments]
    both = arguments[0] == "report"  # its only line goes to stderr
    ended = subprocess.run(
        command, stdout=write, stderr=write if both else subprocess.PIPE, env=environment, text=True, check=False
    )
    os.close(write)
    assert (ended.returncode, ended.stderr or "") == (141, "")


def test_a_character_that_the_output_lacks_is_a_question_mark(monkeypatch: pytest.MonkeyPatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii", write_through=True))
    monkeypatch.setattr("thalweg.cli.report.Report.run", lambda _: print("R² of λ") or 0)
    assert main(["report", "x"]) == 0
    assert written.getvalue().decode("ascii").splitlines() == ["R? of ?"]


def test_a_character_that_the_stream_of_errors_lacks_is_its_number(monkeypatch: pytest.MonkeyPatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(written, encoding="ascii", write_through=True))
    assert main(["report", "läufe/rhône"]) == 2
    assert r"l\xe4ufe/rh\xf4ne" in written.getvalue().decode("ascii")


def test_a_pipe_that_breaks_elsewhere_is_an_error(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture):
    def broken(*_, **__):
        raise BrokenPipeError

    monkeypatch.setattr("thalweg.bench.report.report.write_report", broken)
    with pytest.raises(BrokenPipeError):
        main(["report", "x"])


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == "thalweg 0.1.0\n"


def test_the_package_runs_as_a_module():
    output = subprocess.run([sys.executable, "-m", "thalweg", "--version"], capture_output=True, text=True, check=True)
    assert output.stdout == "thalweg 0.1.0\n"


def test_an_unknown_width_of_vectors_ends_a_command_in_one_line():
    command = [sys.executable, "-m", "thalweg", "world"]
    environment = {**os.environ, "THALWEG_VECTOR_BITS": "128"}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (2, "thalweg: THALWEG_VECTOR_BITS = '128': choose one of 256, 512\n")


WRONG = [
    (["world", "--level", "medum"], "Easy, Medium, Hard"),
    (["render", "--level", "medum"], "Easy, Medium, Hard"),
    (["render", "--count", "-2"], "--count must be at least 1, not -2; such as --count 8"),
    (["render", "--size", "0"], "--size must be from 16 to 2048, not 0; such as --size 128"),
    (["render", "--level", "hrad"], "unknown level 'hrad' (did you mean 'Hard'?)"),
    (["render", "--gallery", "--quality", "fast"], "leave out --frames, --quality and --randomise"),
    (["render", "--gallery", "--frames", "x"], "leave out --frames, --quality and --randomise"),
    (["render", "--pose", "0", "0", "3", "0", "--poses", "pilot"], "give --pose or --poses pilot, not both"),
    (["train", "--algorithm", "FOCUPS", "--out", "x"], "PPO, PPOLag, FOCOPS"),
    (["train", "--algorithm", "FOCUPS", "--out", "x"], "(did you mean 'FOCOPS'?)"),
    (["train", "--algorithm", "FOCPOS", "--out", "x"], "there is no algorithm 'FOCPOS' (did you mean 'FOCOPS'?)"),
    (["bench", "quick", "--out", "x", "--only", "FOCPOS"], "has no 'FOCPOS' (did you mean 'FOCOPS'?)"),
    (["bench", "quick", "--out", "x", "--jobs", "0"], "--jobs must be at least 1, not 0; such as --jobs 2"),
    (["train", "--steps", "0", "--observation", "privileged", "--out", "x"], "--steps must be at least 1, got 0; such"),
    (["train", "--set", "learning_rate", "--out", "x"], "key=value"),
    (["evaluate", "nothing_here"], "packaged, packaged-rgb, random, hover, forward, pilot, steady"),
    (["evaluate", "pilto"], "(did you mean 'pilot'?)"),
    (["evaluate", "hover", "--levels", "medum"], "Easy, Medium, Hard"),
    (["evaluate", "hover", "--levels", "easy", "hard", "Easy"], "--levels names Easy twice; each level is flown once"),
    (
        ["evaluate", "hover", "--episodes", "0"],
        "--episodes must be a whole number of at least 1, got 0; such as --episodes 20",
    ),
    (["bench", "papr", "--out", "x"], "quick, easy, open, protocols, paper"),
    (["bench", "quick", "--out", "x", "--cpus", "2"], "--cpus goes with --cluster"),
    (["bench", "quick", "--out", "x", "--cluster", "ray://head:10001"], "Ray's client is not supported"),
    (["report", "nothing_here"], "no results folder nothing_here"),
    (["report", __file__], "is a file; name the folder"),
    (["encoder", "show", "--path", "nothing_here"], "nothing_here"),
    (["encoder", "train", "--architecture", "huge", "--out", "x"], "lean"),
    (["encoder", "train", "--epochs", "0", "--out", "x"], "--epochs must be at least 1, not 0; such as --epochs 100"),
    (["encoder", "train", "--images", "1", "--held-out", "0", "--out", "x"], "at least 2"),
    (["encoder", "train", "--held-out", "-1", "--out", "x"], "-1 can't be held out"),
    (["encoder", "train", "--level", "medum", "--out", "x"], "Easy, Medium, Hard"),
    (["encoder", "train", "--out", "/dev/null"], "/dev/null is not a folder"),
    (["encoder", "train", "--level", "easy", "hard", "--out", "x"], "--level takes one level for --target image"),
    (["encoder", "train", "--held-out-seeds", "5", "--out", "x"], "--held-out-seeds is for --target geometry"),
    (["encoder", "train", "--target", "geometry", "--randomise", "--out", "x"], "leave --randomise out"),
    (["encoder", "train", "--camera", "fov=75", "--out", "x"], "--camera has no setting 'fov'"),
    (["encoder", "train", "--target", "geometry", "--out", "/dev/null"], "/dev/null is not a folder"),
    (["encoder", "train", "--target", "geometry", "--river", "a.gpx", "--out", "x"], "a.gpx: "),
    (
        ["encoder", "train", "--target", "geometry", "--river", "a.gpx", "--level", "easy", "--out", "x"],
        "give --level or --river, not both: easy and a.gpx",
    ),
    (["encoder", "train", "--target", "geometry", "--banks", "meadow", "--out", "x"], "--banks is for --target image"),
    (["encoder", "train", "--level", "Medium", "--river", "a.gpx", "--out", "x"], "give --level or --river, not both"),
    (["encoder", "train", "--target", "geometry", "--level", "medum", "--out", "x"], "Easy, Medium, Hard"),
    (["encoder", "train", "--target", "geometry", "--world-seeds", "1:9", "--held-out-seeds", "8", "--out", "x"], "8"),
    (["train", "--set", "hidden=[64", "--out", "x"], "'hidden=[64' cannot be understood"),
    (
        ["train", "--set", "learning_rate=fast", "--out", "x"],
        "learning_rate must be a finite number of at least 0, got 'fast'; such as --set learning_rate=0.001",
    ),
    (
        ["train", "--set", "learing_rate=1", "passes=2", "--out", "x"],
        "--set learing_rate=1 passes=2: unknown setting of FOCOPS 'learing_rate' (did you mean 'learning_rate'?);"
        " known: steps_per_update, passes, minibatch, ",
    ),
    (["train", "--preset", "study", "--out", "x"], "no preset 'study'; there are default, paper"),
    (["train", "--num-envs", "0", "--out", "x"], "--num-envs must be at least 1, got 0; such as --num-envs 16"),
    (
        ["train", "--observation", "privileged", "--encoder", "mine.safetensors", "--out", "x"],
        "--observation privileged takes no encoder: leave --encoder mine.safetensors out",
    ),
    (
        ["train", "--set", "policy=cnn", "--encoder", "mine.safetensors", "--out", "x"],
        "policy=cnn takes no encoder: leave --encoder mine.safetensors out",
    ),
    (
        ["train", "--set", "policy=cnn", "--observation", "privileged", "--out", "x"],
        "policy=cnn sees images, rgb+mask or rgb or mask, not the privileged observation",
    ),
    (
        ["train", "--set", "policy=cnn", "--proprioception", "--out", "x"],
        "policy=cnn sees images alone: leave proprioception out, or use policy=mlp",
    ),
    (
        ["train", "--observation", "mask", "--out", "x"],
        "the observation mask is for policies with convolutions: --set policy=cnn",
    ),
    (
        ["train", "--algorithm", "SACLag", "--set", "policy=cnn", "--out", "x"],
        "policy is a setting of on-policy algorithms; SACLag sees numbers only",
    ),
    (["train", "--set", "policy=cnn", "frame_stack=2", "--out", "x"], "frame_stack must be 1 with policy=cnn, got 2"),
    (["world", "--seed", "-1"], "--seed must be 0 or more, not -1"),
    (["render", "--poses-seed", "-1"], "--poses-seed must be 0 or more, not -1"),
    (["train", "--seed", "-1", "--out", "x"], "--seed must be 0 or more, not -1; such as --seed 0"),
    (["train", "--world-seeds", "3", "-4", "--out", "x"], "--world-seeds: a seed must be 0 or more, not -4"),
    (["train", "--world-seeds", "16:3", "--out", "x"], "--world-seeds: 16:3 holds no seed; write 3:16"),
    (["train", "--world-seeds", "5", "0:9", "--out", "x"], "--world-seeds: the seed 5 is given twice"),
    (["train", "--world-seeds", "1-5", "--out", "x"], "ranges such as 1000:1016, whose end is excluded; not '1-5'"),
    (
        ["train", "--world-seeds", "0:4", "--num-envs", "4", "--rivers-in-memory", "9", "--out", "x"],
        "--rivers-in-memory is for rivers that change with each episode; these are fixed",
    ),
    (["encoder", "train", "--world-seeds", "2:2", "--out", "x"], "--world-seeds: 2:2 holds no seed"),
    (
        ["encoder", "train", "--world-seeds", "0:300", "--images", "200", "--held-out", "50", "--out", "x"],
        "250 images of 300 rivers: there must be one image of each",
    ),
    (["evaluate", "hover", "--seed", "-2"], "--seed must be 0 or more, not -2"),
    (["evaluate", "hover", "--starts-seed", "-2"], "--starts-seed must be 0 or more, not -2"),
    (["evaluate", "hover", "--starts-seed", str(2**64)], "--starts-seed must be at most 9223372036854775807, not 1844"),
    (["train", "--seed", str(2**63), "--out", "x"], "--seed must be at most 9223372036854775807, not 9223372036854775"),
    (
        ["train", "--world-seeds", "100000:100004", "--out", "x"],
        "--world-seeds: rivers from seed 100,000 on are kept for flights on unseen rivers, and nothing is trained on",
    ),
    (["imitate", "--world-seeds", "7", "200000", "--out", "x"], "--world-seeds: rivers from seed 100,000 on are kept"),
    (["encoder", "train", "--world-seeds", "100000", "--out", "x"], "--world-seeds: rivers from seed 100,000 on are"),
    (
        ["encoder", "train", "--target", "geometry", "--world-seeds", "99999:100001", "--out", "x"],
        "--world-seeds: rivers from seed 100,000 on are kept for flights on unseen rivers",
    ),
    (
        ["encoder", "train", "--target", "water", "--world-seeds", "100000", "--out", "x"],
        "--world-seeds: rivers from seed 100,000 on are kept for flights on unseen rivers",
    ),
    (["encoder", "train", "--seed", "-1", "--out", "x"], "--seed must be 0 or more, not -1; such as --seed 0"),
    (["encoder", "show", "--seed", "-1"], "--seed must be 0 or more, not -1; such as --seed 1"),
]


@pytest.fixture
def no_frames(monkeypatch: pytest.MonkeyPatch):
    """What is refused is refused before the first frame of thousands is drawn."""

    def drawn(*_: object, **__: object):
        raise AssertionError("frames were collected")

    monkeypatch.setattr("thalweg.train.encoder.frames.collect_frames", drawn)


@pytest.mark.usefixtures("no_frames")
@pytest.mark.parametrize(
    ("arguments", "message"), WRONG, ids=[" ".join(arguments).replace(__file__, "FILE") for arguments, _ in WRONG]
)
def test_a_wrong_value_is_one_line_that_names_the_known_ones(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("thalweg: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert "Traceback" not in captured.err
    assert list(tmp_path.iterdir()) == []


def test_debug_shows_where_an_error_came_from(capsys: pytest.CaptureFixture):
    assert main(["--debug", "report", "nothing_here"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_a_misspelt_option_points_to_the_help_of_its_command(capsys: pytest.CaptureFixture):
    for command in (["world"], ["encoder", "show"]):
        with pytest.raises(SystemExit):
            main([*command, "--levle", "easy"])
        assert f"thalweg {' '.join(command)} --help" in " ".join(capsys.readouterr().err.replace("│", " ").split())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ["evalute", "packaged"],
            "thalweg has no command 'evalute' (did you mean 'evaluate'?); there are world, render,",
        ),
        (["encoder", "trian"], "thalweg encoder has no command 'trian' (did you mean 'train'?); there are train,"),
    ],
)
def test_a_misspelt_command_suggests_the_nearest(arguments: list[str], told: str, capsys: pytest.CaptureFixture):
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith(f"thalweg: {told}")


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["world", "--sede", "1"],
        ["encoder", "train", "--inputs", "depth"],
        ["train", "--observation", "eye", "--out", "x"],
    ],
)
def test_an_unknown_word_ends_with_status_2(arguments: list[str], capsys: pytest.CaptureFixture):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2


def test_every_command_says_what_becomes_of_an_interrupted_one():
    kinds = {**COMMANDS, **{f"encoder {name}": kind for name, kind in ENCODER_COMMANDS.items()}}
    assert [name for name, kind in kinds.items() if not issubclass(kind, Command)] == []
    resuming = {name for name, kind in kinds.items() if kind.resumes}
    assert resuming == {"train", "imitate", "bench", "record", "oracle", "encoder train", "encoder study"}


def test_an_interrupt_explains_how_to_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("thalweg.bench.report.report.write_report", interrupted)
    monkeypatch.setattr("thalweg.cli.bench.run_and_print", interrupted)
    assert main(["report", "x"]) == 130
    assert capsys.readouterr().err == "\nInterrupted. Nothing was saved; the same command starts from the beginning.\n"
    monkeypatch.setattr("thalweg.train.imitation.imitate.Imitation.run", interrupted)
    out = str(tmp_path / "x")
    assert main(["bench", "quick", "--out", out]) == 130
    assert capsys.readouterr().err == "\nInterrupted. The same command resumes from the last checkpoint.\n"
    assert main(["imitate", "--out", out]) == 130
    none_yet = "There was no checkpoint yet; the same command starts from the beginning."
    assert capsys.readouterr().err == f"\nInterrupted. {none_yet}\n"
    save_checkpoint(tmp_path / "x", 24_576, {})
    assert main(["imitate", "--out", out]) == 130
    assert capsys.readouterr().err == "\nInterrupted. The same command resumes from step 24,576.\n"


def test_a_terminated_run_warns_and_ends_as_an_interrupted_one(tmp_path: Path):
    code = """
import os, signal, sys, warnings
from thalweg.cli import main as cli
def run(command):
    warnings.warn("the limit never binds", stacklevel=1)
    os.kill(os.getpid(), signal.SIGTERM)
    raise SystemExit("not ended")
cli.Train.run = run
sys.argv = ["thalweg", "train", "--out", sys.argv[1]]
sys.exit(cli.main())
"""
    save_checkpoint(tmp_path, 2048, {})
    command = [sys.executable, "-c", code, str(tmp_path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    message = "Warning: the limit never binds\n\nInterrupted. The same command resumes from step 2,048.\n"
    assert (ended.returncode, ended.stderr) == (130, message)


def test_errors_in_rendering_and_writing_are_one_line(tmp_path: Path, easy_world, capsys: pytest.CaptureFixture):
    render = ["render", "--level", "easy", "--out", str(tmp_path / "x.png")]
    file = tmp_path / "file"
    file.write_text("")
    for arguments, message in (
        ([*render, "--pose", "5000", "5000", "3", "0"], "x = 5000, y = 5000 is outside the map of Easy"),
        ([*render, "--pose", "nan", "0", "3", "0"], "is outside the map"),
        ([*render, "--size", "4"], "--size must be from 16 to 2048, not 4"),
        ([*render[:-1], str(file / "x.png"), "--size", "16"], f"{file} is not a folder"),
        (["world", "--level", "easy", "--out", str(tmp_path)], f"{tmp_path} is a folder; name a file in it, such as"),
    ):
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert message in error
        assert "Traceback" not in error


PRIVILEGED_RUN = ["--level", "easy", "--observation", "privileged", "--steps", "100"]
FROM_THE_START = ". There was no checkpoint yet; the same command starts from the beginning."


@pytest.mark.parametrize(
    ("arguments", "file", "resumes"),
    [
        (["world", "--level", "easy", "--out", "map.png"], "map.png", ""),
        (["render", "--level", "easy", "--size", "32", "--count", "1", "--out", "x.webp"], "x.webp", ""),
        (
            ["render", "--level", "easy", "--size", "32", "--count", "1", "--frames", "frames"],
            str(Path("frames", "0000.png")),
            "",
        ),
        (["evaluate", "hover", "--levels", "easy", "--episodes", "1", "--out", "x.csv"], "x.csv", ""),
        (["train", *PRIVILEGED_RUN, "--out", "run"], str(Path("run", "config.yaml")), FROM_THE_START),
        (
            ["bench", "quick", "--jobs", "1", "--out", "quick"],
            str(Path("quick", "suite.json")),
            ". The same command resumes from the last checkpoint.",
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_full_disk_is_one_line_that_names_the_file(
    arguments: list[str],
    file: str,
    resumes: str,
    tmp_path: Path,
    easy_world,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "fsync", full)
    assert main(arguments) == 2
    *_, last = capsys.readouterr().err.splitlines()
    assert last == f"thalweg: {file} cannot be written: No space left on device{resumes}"


def test_a_world_that_a_full_disk_does_not_take_is_named(
    tmp_path: Path, easy_world, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("thalweg.world.map_image.draw", lambda *_: None)
    monkeypatch.setattr(os, "fsync", full)
    save = tmp_path / "easy.npz"
    assert main(["world", "--level", "easy", "--out", str(tmp_path / "map.png"), "--save", str(save)]) == 2
    assert capsys.readouterr().err == f"thalweg: {save} cannot be written: No space left on device\n"
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_without_a_name_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("thalweg.bench.report.report.write_report", full)
    assert main(["report", "x"]) == 2
    assert capsys.readouterr().err == "thalweg: a file cannot be written: No space left on device\n"


def test_frames_are_drawn_from_a_given_pose(tmp_path: Path, easy_world, capsys: pytest.CaptureFixture):
    x, y = easy_world.river.position_m[0]
    out = tmp_path / "deep" / "frames.png"
    pose = [f"{value:.3f}" for value in (x, y, 6.0, 0.5)]
    assert main(["render", "--level", "easy", "--size", "32", "--pose", *pose, "--out", str(out)]) == 0
    picture = np.asarray(Image.open(out))
    assert picture.shape == (2 * 32 + 4, 32, 3)
    assert set(np.unique(picture[-32:])) <= {0, 255}
    assert f"--pose {' '.join(pose[:3])}" in capsys.readouterr().out


def test_a_pose_under_water_is_warned_of_and_drawn(
    tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    drawn = []
    monkeypatch.setattr(RenderFrames, "_write_frames", lambda _, __, poses: drawn.append(poses))
    x, y = easy_world.river.position_m[0]
    level = easy_world.river.level_m[0]
    given = ["render", "--level", "easy", "--out", str(tmp_path / "x.png"), "--pose", f"{x}", f"{y}"]
    assert main([*given, f"{level - 0.05}", "0"]) == 0
    assert f"z = {level - 0.05:g} is under water; there, z above " in capsys.readouterr().err
    assert main([*given, f"{level + 3}", "0"]) == 0
    assert capsys.readouterr().err == ""
    assert len(drawn) == 2


def test_a_world_is_drawn_and_saved(tmp_path: Path, easy_world):
    from thalweg.world import World

    out, saved = tmp_path / "map.png", tmp_path / "world.npz"
    assert main(["world", "--level", "easy", "--out", str(out), "--save", str(saved)]) == 0
    assert Image.open(out).size[1] == 1200
    np.testing.assert_array_equal(World.load(saved).river.position_m, easy_world.river.position_m)


def test_a_real_river_is_drawn_from_its_file(tmp_path: Path, capsys: pytest.CaptureFixture):
    from thalweg.world import World

    source, out, saved = tmp_path / "brook.geojson", tmp_path / "map.png", tmp_path / "brook.npz"
    source.write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}')
    options = ["--width-m", "6", "--start-m", "10", "--length-m", "60", "--smooth-m", "4", "--seed", "3"]
    given = ["world", "--geojson", str(source), *options, "--out", str(out), "--save", str(saved)]
    assert main(given) == 0
    assert f"{out}: brook, seed 3, a course of 60 m" in capsys.readouterr().out
    river = World.load(saved).river
    assert (set(river.width_m), round(river.length_m)) == ({6.0}, 60)


def test_a_river_on_other_banks_is_drawn_and_saved(tmp_path: Path, brook: Path, capsys: pytest.CaptureFixture):
    from thalweg.world import World
    from thalweg.world.banks import text_of

    out, saved = tmp_path / "map.png", tmp_path / "brook.npz"
    given = ["world", "--river", str(brook), "--width-m", "6", "--banks", "meadow", "quay_20-50_left"]
    assert main([*given, "--out", str(out), "--save", str(saved)]) == 0
    assert "brook.geojson: banks: meadow+quay_20-50_left" in capsys.readouterr().err
    assert text_of(World.load(saved).banks) == "meadow+quay_20-50_left"


@pytest.fixture
def brook(tmp_path: Path) -> Path:
    """A real river of 89 m in a file, without a width."""
    path = tmp_path / "brook.geojson"
    path.write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}')
    return path


@pytest.mark.slow
def test_frames_are_drawn_of_a_real_river(tmp_path: Path, brook: Path, capsys: pytest.CaptureFixture):
    from thalweg.env import sample_starts
    from thalweg.render import Camera, Renderer
    from thalweg.world import World

    out = tmp_path / "frames.png"
    options = ["--geojson", str(brook), "--width-m", "6", "--seed", "3"]
    assert main(["render", *options, "--count", "2", "--size", "32", "--out", str(out)]) == 0
    assert f"{out}: 2 frames of brook, seed 3" in capsys.readouterr().out
    world = World.from_file(brook, width_m=6.0, seed=3)
    frames = Renderer([world], Camera(32, 32)).render(sample_starts(world, 2, 0))
    np.testing.assert_array_equal(np.asarray(Image.open(out))[:32, :32], frames[0, ..., :3])


def test_policies_are_evaluated_on_a_real_river(tmp_path: Path, brook: Path, capsys: pytest.CaptureFixture):
    from thalweg.bench.evaluate.episodes import read_episodes

    out = tmp_path / "rows.csv"
    options = ["--geojson", str(brook), "--width-m", "6", "--world-seed", "3"]
    assert main(["evaluate", "hover", *options, "--episodes", "3", "--out", str(out)]) == 0
    rows = read_episodes(out)
    assert [(row.level, row.world_seed, row.episode, row.reason) for row in rows] == [
        ("brook.geojson", 3, place, "Idle") for place in range(3)
    ]
    assert len({row.x for row in rows}) == 3
    assert "brook.geojson return" in capsys.readouterr().out


def test_a_policy_is_trained_on_a_real_river(
    tmp_path: Path, brook: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    from thalweg.train import river
    from thalweg.train.run_in_folder import RunResult
    from thalweg.world import Reach

    told = {}

    def run(_: str, env: Any, **given: Any) -> RunResult:
        told.update(given, worlds=env.env.worlds)
        return RunResult(given["folder"], "PPO", 5, 1, 0.0, 0.0, 0.0, 1.0, None, False, ())

    monkeypatch.setattr(river, "run", run)
    options = ["--river", str(brook), "--width-m", "6", "--length-m", "60", "--smooth-m", "4"]
    given = ["train", *options, "--world-seeds", "3", "4", "--num-envs", "2", "--out", str(tmp_path / "run")]
    assert main(given) == 0
    context, worlds = told["context"], told["worlds"]
    assert [(world.name, world.seed, round(world.river.length_m)) for world in worlds] == [
        ("brook", 3, 60),
        ("brook", 4, 60),
    ]
    assert context["river"] == Reach(brook, width_m=6.0, length_m=60.0, smooth_m=4.0).as_data()
    advised = " ".join([*options, "--world-seed", "3"])
    assert f"Evaluate it: thalweg evaluate {tmp_path / 'run'} {advised}\n" in capsys.readouterr().out


def test_training_begins_with_a_policy_of_the_package_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from thalweg.bench.packaged import PACKAGED_POLICY
    from thalweg.train import river
    from thalweg.train.run_in_folder import RunResult

    begun = []

    def run(*_: Any, **given: Any) -> RunResult:
        begun.append(given["begin_with"])
        return RunResult(given["folder"], "PPO", 5, 1, 0.0, 0.0, 0.0, 1.0, None, False, ())

    monkeypatch.setattr(river, "run", run)
    given = ["train", "--level", "easy", "--num-envs", "2", "--observation", "rgb+mask", "--set", "policy=cnn"]
    assert main([*given, "--begin-with", "packaged", "--out", str(tmp_path / "run")]) == 0
    assert begun == [PACKAGED_POLICY]


@pytest.mark.slow
def test_a_policy_of_images_is_trained_and_evaluated_without_an_encoder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    import yaml

    def loaded(*_: object, **__: object):
        raise AssertionError("an encoder was loaded")

    monkeypatch.setattr("thalweg.encoder.load_encoder", loaded)
    shape = ["filters=[4,4]", "features=8", "memory=gru", "memory_size=4", "steps_per_update=64", "passes=1"]
    given = ["train", "--algorithm", "ppo", "--level", "easy", "--num-envs", "2", "--steps", "64"]
    first, then, out = tmp_path / "first", tmp_path / "then", tmp_path / "rows.csv"
    assert main([*given, "--observation", "mask", "--set", "policy=cnn", *shape, "--out", str(first)]) == 0
    shorter = ["policy=cnn", "steps_per_update=64", "passes=1", "critic_warmup_steps=0", "imitation_kl=1.0"]
    assert main([*given, "--begin-with", str(first), "--set", *shorter, "--out", str(then)]) == 0
    said = yaml.safe_load((then / "config.yaml").read_text())["run"]
    assert said["context"]["observation"] == "mask" and said["image"] == [128, 128, 1]
    assert said["config"]["memory_size"] == 4 and said["critic_size"] > 30
    assert f"Evaluate it: thalweg evaluate {then} --levels easy\n" in capsys.readouterr().out
    assert main(["evaluate", str(then), "--levels", "easy", "--episodes", "1", "--out", str(out)]) == 0
    assert len(out.read_text().splitlines()) == 2


@pytest.mark.slow
def test_a_policy_is_trained_on_the_codes_of_geometry_and_evaluated_through_the_same_encoder(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    from thalweg.core.cache import file_hash
    from thalweg.encoder import PACKAGED
    from thalweg.train import load_policy

    run, out = tmp_path / "run", tmp_path / "rows.csv"
    settings = ["--set", "steps_per_update=64", "passes=1", "--steps", "64", "--num-envs", "2"]
    given = ["train", "--encoder", "geometry", "--algorithm", "ppo", "--level", "easy", *settings]
    assert main([*given, "--out", str(run)]) == 0
    assert f"thalweg evaluate {run} --levels easy --encoder geometry\n" in capsys.readouterr().out
    policy = load_policy(run)
    assert (policy.obs_size, policy.about.context["encoder"]) == (32, file_hash(PACKAGED["geometry"]))
    flown = ["evaluate", str(run), "--levels", "easy", "--episodes", "1", "--out", str(out)]
    assert main(flown) == 0, "the packaged encoder of a policy is found without --encoder"
    assert len(out.read_text().splitlines()) == 2
    assert main([*flown, "--encoder", "default"]) == 2
    assert "the policy takes 32 numbers, but the encoder returns 16" in capsys.readouterr().err


@pytest.mark.parametrize("felt", [False, True], ids=["alone", "with proprioception"])
def test_a_policy_of_the_privileged_observation_is_trained_and_evaluated_without_an_encoder(
    felt: bool, tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    from thalweg.bench.evaluate.episodes import read_episodes
    from thalweg.env import EnvConfig, RiverVectorEnv
    from thalweg.train import load_policy
    from thalweg.train.numbers import NumbersVectorEnv

    def drawn(*_: object, **__: object):
        raise AssertionError("frames were drawn, or an encoder was loaded")

    for name in ("thalweg.render.compilation.begin", "thalweg.encoder.load_encoder", "thalweg.render.Renderer"):
        monkeypatch.setattr(name, drawn)
    run, out = tmp_path / "run", tmp_path / "rows.csv"
    settings = ["--set", "steps_per_update=64", "passes=1", "--steps", "64", "--num-envs", "2"]
    given = ["train", "--observation", "privileged", "--algorithm", "ppo", "--level", "easy", *settings]
    assert main([*given, *["--proprioception"] * felt, "--out", str(run)]) == 0
    assert f"Evaluate it: thalweg evaluate {run} --levels easy\n" in capsys.readouterr().out
    flown = ["evaluate", str(run), "--levels", "easy", "--episodes", "2", "--deterministic"]
    assert main([*flown, "--out", str(out)]) == 0
    parts: Any = ("privileged", "proprioception") if felt else "privileged"
    env: Any = RiverVectorEnv([easy_world], 1, EnvConfig(observation=parts))
    env = NumbersVectorEnv(env) if felt else env
    for row in read_episodes(out):
        obs, _ = env.reset(seed=0, options={"pose": [row.x, row.y, row.z, row.yaw]})
        policy, return_, ended, length = load_policy(run), 0.0, np.zeros(1, bool), 0
        while not ended[0]:
            obs, reward, terminated, truncated, _ = env.step(policy.act(obs, deterministic=True))
            return_, ended, length = return_ + float(reward[0]), terminated | truncated, length + 1
        assert (row.return_, row.length) == (return_, length)
    assert main([*flown, "--encoder", "mine.safetensors"]) == 2
    message = f"{run} sees the privileged observation, not frames: leave --encoder mine.safetensors out"
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("place", ["policy.safetensors", ""], ids=["file", "folder"])
def test_a_policy_of_images_is_evaluated_without_an_encoder(
    place: str, tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    from tests.image_policies import image_policy
    from thalweg.bench.evaluate.episodes import read_episodes
    from thalweg.env import EnvConfig, RiverVectorEnv

    def loaded(*_: object, **__: object):
        raise AssertionError("an encoder was loaded")

    monkeypatch.setattr("thalweg.train.river.load_encoder", loaded)
    policy, out = image_policy("mask"), tmp_path / "rows.csv"
    policy.save(tmp_path / "policy.safetensors")
    given = ["evaluate", str(tmp_path / place), "--levels", "easy", "--episodes", "2", "--deterministic"]
    assert main([*given, "--out", str(out)]) == 0
    env = RiverVectorEnv([easy_world], 1, EnvConfig(observation="mask"))
    for row in read_episodes(out):
        obs, _ = env.reset(seed=0, options={"pose": [row.x, row.y, row.z, row.yaw]})
        player, return_, ended, length = policy.player(1, deterministic=True), 0.0, np.zeros(1, bool), 0
        while not ended[0]:
            obs, reward, terminated, truncated, _ = env.step(player(obs, np.array([length == 0])))
            return_, ended, length = return_ + float(reward[0]), terminated | truncated, length + 1
        assert (row.return_, row.length) == (return_, length)
    capsys.readouterr()
    assert main([*given, "--encoder", "mine.safetensors"]) == 2
    message = f"{tmp_path / place} sees images (mask), not codes of an encoder: leave --encoder mine.safetensors out"
    assert message in capsys.readouterr().err


def test_a_shielded_evaluation_says_so(tmp_path: Path, capsys: pytest.CaptureFixture):
    from thalweg.bench.evaluate.episodes import read_episodes
    from thalweg.core import versions

    out = tmp_path / "rows.csv"
    given = ["evaluate", "random", "--levels", "easy", "--episodes", "2", "--shield", "--out", str(out)]
    assert main(given) == 0
    rows, told = read_episodes(out), capsys.readouterr().out
    assert [(row.algorithm, row.shield) for row in rows] == [("random (shield)", versions.SHIELD)] * 2
    assert "random (shield)" in told
    vetoes, steps = sum(row.vetoes for row in rows), sum(row.length for row in rows)
    assert 0 < vetoes < steps and f"The shield replaced {vetoes} of {steps} moves." in told


def test_a_shield_is_refused_to_a_policy_without_masks(tmp_path: Path, capsys: pytest.CaptureFixture):
    from tests.image_policies import image_policy

    image_policy("rgb").save(tmp_path / "policy.safetensors")
    assert main(["evaluate", str(tmp_path / "policy.safetensors"), "--shield"]) == 2
    assert "the shield reads water masks, but this policy sees images (rgb)" in capsys.readouterr().err


def test_options_of_a_river_are_typed_again_as_they_were_given():
    options = RiverFile(Path("a river.geojson"), width_m=6.0, start_m=1234.5678, length_m=1e6, smooth_m=0.1)
    typed = ["--width-m", "6", "--start-m", "1234.5678", "--length-m", "1000000", "--smooth-m", "0.1"]
    assert options.words() == ["--river", "a river.geojson", *typed]
    named = RiverFile(Path("b.kml"), crs="EPSG:32632", river_name="River Cam", reverse=True)
    assert named.words() == ["--river", "b.kml", "--crs", "EPSG:32632", "--river-name", "River Cam", "--reverse"]
    on_banks = RiverFile(Path("b.kml"), banks=("meadow", "quay_120-180_left"))
    assert on_banks.words() == ["--river", "b.kml", "--banks", "meadow+quay_120-180_left"]
    assert RiverFile(banks=("meadow", "quay_1-2")).on_banks("medium") == "Medium+meadow+quay_1-2"
    assert NO_FILE.on_banks("medium") == "medium"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            ["render", "--geojson", "none.geojson", "--level", "easy"],
            "give --level or --river, not both: easy and none.",
        ),
        (["render", "--geojson", "none.geojson"], "none.geojson: there is no such file"),
        (["render", "--width-m", "9"], "--width-m goes with --river"),
        (
            ["train", "--geojson", "none.geojson", "--level", "easy", "--out", "x"],
            "give --level or --river, not both",
        ),
        (["train", "--geojson", "none.geojson", "--out", "x"], "none.geojson: there is no such file"),
        (["train", "--smooth-m", "9", "--out", "x"], "--smooth-m goes with --river"),
        (["render", "--banks", "lawn"], "unknown kind 'lawn'; known: forest, meadow, reeds, quay"),
        (["train", "--banks", "meadow", "quay_9", "--out", "x"], "'9' in 'quay_9' is neither a span such as 120-180"),
        (["evaluate", "hover", "--banks", "medow"], "unknown kind 'medow' (did you mean 'meadow'?)"),
        (["bench", "quick", "--banks", "meadow", "--out", "x"], "--banks goes with --river"),
        (["world", "--level", "easy", "--banks", "quay_0-999"], "quay_0-999 is not on the course, which is 27"),
        (
            ["evaluate", "hover", "--geojson", "none.geojson", "--levels", "easy", "hard"],
            "not both: easy hard and none.",
        ),
        (["evaluate", "hover", "--geojson", "none.geojson"], "none.geojson: there is no such file"),
        (
            ["evaluate", "hover", "--world-seed", "3"],
            "--world-seed goes with --river; rivers of the levels are chosen",
        ),
        (["evaluate", "hover", "--unseen", "--world-seeds", "3"], "--world-seeds does not go with --unseen"),
        (["evaluate", "hover", "--world-seeds", "3:3"], "--world-seeds: 3:3"),
        (["evaluate", "hover", "--geojson", "none.geojson", "--unseen"], "--unseen goes with --levels"),
        (
            ["evaluate", "hover", "--geojson", "none.geojson", "--world-seeds", "3"],
            "--world-seeds does not go with --river, whose plants and hills --world-seed chooses",
        ),
        (["evaluate", "hover", "--geojson", "none.geojson", "--world-seed", "-3"], "--world-seed must be 0 or more"),
    ],
    ids=" ".join,
)
def test_a_real_river_and_a_level_are_not_mixed(
    given: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(tmp_path)
    assert main(given) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", [["train", "--out", "run"], ["evaluate", "hover"]], ids=" ".join)
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "brook.geojson: not JSON"),
        ('{"type": "LineString", "coordinates": [[9, 48]]}', "line of 1 positions; at least 2 are needed"),
        (
            '{"type": "LineString", "coordinates": [[9, 48], [9.0008, 48], [9.0008, 48.00002], [9, 48.00002]]}',
            "the banks of two arms overlap",
        ),
    ],
)
def test_a_file_without_a_river_is_refused_before_a_river_is_announced(
    command: list[str],
    text: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("thalweg.render.compilation.begin", lambda: None)
    monkeypatch.setattr("thalweg.train.river.print_once", print)
    Path("brook.geojson").write_text(text)
    assert main([*command, "--geojson", "brook.geojson", "--width-m", "6"]) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert (output.out, output.err.count("\n")) == ("", 1)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--geojson", "none.geojson"], "thalweg: none.geojson: there is no such file"),
        (["--geojson", "none.geojson", "--level", "easy"], "thalweg: give --level or --river, not both"),
        (["--width-m", "9"], "thalweg: --width-m goes with --river"),
        (["--level", "easy", "--start-m", "0"], "thalweg: --start-m goes with --river"),
    ],
)
def test_options_of_a_real_river_that_cannot_be_are_refused(
    given: list[str], message: str, capsys: pytest.CaptureFixture
):
    assert main(["world", *given]) == 2
    assert message in capsys.readouterr().err


def test_policies_are_evaluated_on_rivers_that_nothing_is_trained_on(tmp_path: Path):
    out = tmp_path / "rows.csv"
    options = ["--levels", "easy", "--unseen", "--episodes", "2", "--out", str(out)]
    assert main(["evaluate", "hover", *options]) == 0
    with open(out) as file:
        rows = list(csv.DictReader(file))
    assert [(row["world_seed"], row["episode"], row["level"]) for row in rows] == [
        (str(UNSEEN), "0", "Easy"),
        (str(UNSEEN + 1), "1", "Easy"),
    ]


def test_policies_are_evaluated_on_chosen_rivers(tmp_path: Path, capsys: pytest.CaptureFixture):
    from thalweg.bench.evaluate.episodes import read_episodes

    out = tmp_path / "rows.csv"
    options = ["--levels", "easy", "hard", "--world-seeds", "7", "12:14", "--episodes", "2", "--out", str(out)]
    assert main(["evaluate", "hover", *options]) == 0
    assert [(row.level, row.world_seed, row.episode) for row in read_episodes(out)] == [
        (level, seed, start) for level in ("Easy", "Hard") for seed in (7, 12, 13) for start in range(2)
    ]
    printed = capsys.readouterr()
    assert "hover on Easy, river 12" in printed.err and "river 12" not in printed.out  # the bar of progress


@pytest.mark.parametrize(
    ("given", "where"),
    [
        ([], []),
        (["--world-seeds", "7"], ["--levels", "Medium", "--world-seeds", "7"]),
        (["--level", "easy", "hard", "--world-seeds", "7"], ["--levels", "easy", "hard", "--world-seeds", "7"]),
        (["--world-seeds", "7:9"], ["--unseen"]),
        (["--level", "hard"], ["--levels", "hard"]),
        (["--level", "hard", "--world-seeds", "7:9"], ["--levels", "hard", "--unseen"]),
    ],
)
def test_the_evaluation_that_a_run_advises_is_where_its_policy_flies(
    given: list[str], where: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    from thalweg.train.river import RiverTraining
    from thalweg.train.run_in_folder import RunResult

    result = RunResult(Path("run"), "PPO", 5, 1, 0.0, 0.0, 0.0, 1.0, None, False, ())
    monkeypatch.setattr(RiverTraining, "train", lambda *_, **__: result)
    assert main(["train", *given, "--observation", "privileged", "--out", "run"]) == 0
    assert capsys.readouterr().out.endswith(f"Evaluate it: {' '.join(['thalweg', 'evaluate', 'run', *where])}\n")


def test_baselines_are_evaluated_and_their_rows_written(tmp_path: Path, capsys: pytest.CaptureFixture):
    from thalweg.bench.evaluate.episodes import read_episodes

    out = tmp_path / "rows.csv"
    assert main(["evaluate", "hover", "--levels", "easy", "--episodes", "3", "--out", str(out)]) == 0
    rows = read_episodes(out)
    assert [(row.algorithm, row.level, row.episode, row.reason) for row in rows] == [
        ("hover", "Easy", place, "Idle") for place in range(3)
    ]
    assert "0.20 ± 0.00" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "field", "value"),
    [
        (["train", "--out", "x", "--steps", "1e5"], "steps", 100_000),
        (["train", "--out", "x", "--steps", "200_000"], "steps", 200_000),
        (["world", "--seed", "340282366920938463463374607431768211456"], "seed", 2**128),
        (["world"], "seed", None),
        (["render", "--pose", "1", "-2", "3e0", "-0.5"], "pose", (1.0, -2.0, 3.0, -0.5)),
    ],
    ids=str,
)
def test_a_number_is_read_as_people_write_it(given: list[str], field: str, value: object):
    assert getattr(_parse(given), field) == value


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["train", "--out", "x", "--steps", "1e5.5"], "--steps: '1e5.5' is not a whole number; write one such as"),
        (["train", "--out", "x", "--steps", "2.5"], "--steps: '2.5' is not a whole number"),
        (["train", "--out", "x", "--steps", "nan"], "--steps: 'nan' is not a whole number"),
        (["train", "--out", "x", "--steps", "1e999999999"], "--steps: '1e999999999' is not a whole number"),
        (
            ["train", "--out", "x", "--seed", "x"],
            "--seed: 'x' is not a whole number; write one such as 0, 200000 or 2e5",
        ),
        (["world", "--seed", "x"], "--seed: 'x' is not a whole number"),
        (["world", "--width-m", "wide"], "--width-m: 'wide' is not a number; write one such as 12, 0.5 or 1e-4"),
        (["render", "--pose", "1", "2", "3", "north"], "--pose: 'north' is not a number"),
        (["render", "--pose", "1", "2", "3"], "'--pose'. Expected 4 values"),
    ],
    ids=str,
)
def test_what_is_no_number_is_named_with_what_would_be_one(
    given: list[str], message: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "160")
    with pytest.raises(SystemExit) as ended:
        main(given)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_pictures_are_replaced_and_worlds_only_when_asked(tmp_path: Path, easy_world, capsys: pytest.CaptureFixture):
    from thalweg.world import World

    out, saved = tmp_path / "map.png", tmp_path / "world.npz"
    for file in (out, saved):
        file.write_text("old")
    given = ["world", "--level", "easy", "--out", str(out), "--save", str(saved)]
    assert main(given) == 2
    assert f"--save {saved} exists already; name a new file, or add --overwrite" in capsys.readouterr().err
    assert (out.read_text(), saved.read_text()) == ("old", "old")
    assert main([*given, "--overwrite"]) == 0
    assert Image.open(out).size[1] == 1200
    assert World.load(saved).seed == easy_world.seed


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            ["world", "--geojson", "brook.geojson", "--out", "brook.geojson"],
            "--out must end in .png, not 'brook.geojson'",
        ),
        (["world", "--save", "world.json"], "--save must end in .npz, not 'world.json'"),
        (["render", "--out", "frames"], "--out must end in .png or .jpg or .jpeg or .webp, not 'frames'"),
        (["render", "--gallery", "--out", "frames.tex"], "--out must end in .png or .jpg"),
        (["encoder", "show", "--out", "brook.geojson"], "--out must end in .png, not 'brook.geojson'"),
    ],
    ids=" ".join,
)
def test_no_image_replaces_another_kind_of_file(
    given: list[str], message: str, brook: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(brook.parent)
    before = brook.read_bytes()
    assert main(given) == 2
    assert message in capsys.readouterr().err
    assert [file.name for file in brook.parent.iterdir()] == ["brook.geojson"]
    assert brook.read_bytes() == before


WRITES_ONE_FILE = [
    (["world"], "--out", ".png"),
    (["world"], "--save", ".npz"),
    (["render"], "--out", ".png"),
    (["encoder", "show"], "--out", ".png"),
    (["evaluate", "hover"], "--out", ".csv"),
    (["leaderboard", "results"], "--out", ".md"),
    (["speed"], "--out", ".json"),
]


@pytest.fixture
def nothing_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """An empty folder to be in, and commands that must not begin with what takes time."""

    def done(*_: object, **__: object):
        raise AssertionError("the work began before the place of its file was looked at")

    for name in (
        "thalweg.world.load_or_build",
        "thalweg.encoder.load_encoder",
        "thalweg.cli.evaluate.evaluate_and_print",
        "thalweg.bench.leaderboard.leaderboard",
        "thalweg.bench.speed.speed_table.measure",
    ):
        monkeypatch.setattr(name, done)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("nothing_done")
@pytest.mark.parametrize(("given", "option", "ending"), WRITES_ONE_FILE, ids=str)
def test_a_file_that_cannot_be_written_is_named_before_anything_is_done(
    given: list[str], option: str, ending: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    here = Path.cwd()
    (here / "folder").mkdir()
    (here / "file").write_text("")
    for target, message in (
        ("folder", f"{option} folder is a folder; name a file in it, such as folder/new{ending}"),
        (f"file/new{ending}", f"{option} file/new{ending} cannot be written: {here / 'file'} is not a folder"),
        ("new.tex", f"{option} must end in {ending}"),
    ):
        assert main([*given, option, target]) == 2
        assert capsys.readouterr().err.startswith(f"thalweg: {message}")
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != here / "folder")
    assert main([*given, option, f"folder/a/new{ending}"]) == 2
    message = f"{option} folder/a/new{ending} cannot be written: no permission to write into {here / 'folder'}"
    assert capsys.readouterr().err == f"thalweg: {message}\n"
    assert sorted(path.name for path in here.rglob("*")) == ["file", "folder"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-4", 1e-4),
        ("-2E+3", -2000.0),
        ("1.5", 1.5),
        ("+.5e-1", 0.05),
        ("64", 64),
        ("[64, 1e2]", [64, 100.0]),
        ("true", True),
        ("native", "native"),
        ("1e4x", "1e4x"),
    ],
)
def test_a_setting_is_read_as_people_write_it(text: str, value: object):
    (found,) = settings_from([f"rate={text}"]).values()
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize("option", ["--set", "--camera", "--wind"])
def test_a_setting_that_is_given_twice_is_refused(option: str):
    with pytest.raises(UsageError, match=f"^{option} gives a twice: leave one of them out"):
        settings_from(["a=1", "b=1", "a=2"], option)


def test_a_small_learning_rate_reaches_the_algorithm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from thalweg.algos import algorithm_named
    from thalweg.train import river
    from thalweg.train.errors import TrainingError

    told = {}

    def run(*_: object, **given: object):
        told.update(given)
        raise TrainingError("enough")

    monkeypatch.setattr(river, "run", run)
    given = ["train", "--level", "easy", "--num-envs", "1", "--out", str(tmp_path)]
    assert main([*given, "--set", "learning_rate=1e-4", "hidden=[8, 4]"]) == 2
    config = algorithm_named("FOCOPS").configure(told["config"], told["preset"])
    assert (config.learning_rate, config.hidden, told["preset"]) == (1e-4, (8, 4), "default")
    assert main([*given, "--preset", "paper", "--set", "cost_limit=0.3"]) == 2
    assert told["config"] == {"cost_limit": 0.3} and told["preset"] == "paper"


@pytest.mark.usefixtures("no_frames")
def test_the_folder_of_another_encoder_is_refused_before_frames_are_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    from tests.encoder.synthetic_frames import synthetic_frames
    from thalweg.encoder import VAEConfig, train_encoder

    options: dict[str, Any] = {"epochs": 1, "seed": 0, "held_out": 2, "identity": {"level": "Medium"}}
    train_encoder(synthetic_frames(8, 128), VAEConfig(), tmp_path, progress=False, **options)
    given = ["encoder", "train", "--out", str(tmp_path), "--images", "6", "--held-out", "2", "--epochs", "1"]
    for change, message in (
        (["--latent", "8"], "config"),
        (["--epochs", "3"], "epochs is 1 there and 3 here"),
        (["--seed", "4"], "seed is 0 there and 4 here"),
        (["--images", "7"], "images is 8 there and 9 here"),
        (["--level", "hard"], "level is 'Medium' there and 'Hard' here"),
    ):
        assert main([*given, *change]) == 2
        assert message in capsys.readouterr().err
    (tmp_path / "encoder.safetensors").unlink()  # as if it had been killed before it was written
    with pytest.raises(AssertionError, match="frames were collected"):
        EncoderTrain(tmp_path, images=6, held_out=2, epochs=1).run()
