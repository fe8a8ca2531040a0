"""Tests of the encoder that `thalweg evaluate` looks through, and of how it takes actions."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.cli.calibration import LENS
from tests.env.handmade import ring
from tests.image_policies import image_policy
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import Episode, read_episodes
from thalweg.bench.evaluate.evaluation import Label
from thalweg.bench.evaluate.functions import FunctionPolicy
from thalweg.bench.report.result_tables import paper_table
from thalweg.bench.results.results import Results
from thalweg.cli.evaluate import Evaluate, _encoder_for, _is_papers_study, load_named_policy, sampling
from thalweg.cli.flown_camera import camera_in_words, flown_camera
from thalweg.cli.main import main
from thalweg.cli.options import UsageError
from thalweg.core.cache import file_hash
from thalweg.env import ConfigError, EnvConfig
from thalweg.env.physics.wind import Wind
from thalweg.render import Camera, Renderer
from thalweg.render.records import calibration
from thalweg.render.records.calibration import camera_of_calibration
from thalweg.world import World


@pytest.mark.parametrize("given", [None, Path("other.safetensors")], ids=["that of the run", "another one"])
def test_a_run_flies_through_the_encoder_that_it_was_trained_with(
    given: Path | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    own = tmp_path / "own.safetensors"
    own.write_bytes(b"content")
    context = {"encoder": file_hash(own), "encoder_file": str(own)}
    policy: Any = SimpleNamespace(about=SimpleNamespace(context=context), obs_size=16)
    loaded: list[Path | None] = []
    monkeypatch.setattr("thalweg.bench.evaluate.baselines.sight_of", lambda _: "frames")
    monkeypatch.setattr("thalweg.train.river.load_compatible_encoder", lambda path, _: loaded.append(path))
    monkeypatch.setattr("thalweg.train.observations.check_policy_fits", lambda *_, **__: None)
    _encoder_for(policy, Evaluate("run", encoder=given), EnvConfig())
    assert loaded == [given or own]


@pytest.mark.parametrize(
    ("trained", "given", "hard"),
    [
        ({"task": "Nests", "hard": True}, {}, True),
        ({"task": "Nests", "hard": True}, {"no_hard": True}, False),
        ({"task": "Nests", "hard": False}, {}, False),
        ({"task": "Nests"}, {"hard": True}, True),
        ({"task": "Nests", "hard": True}, {"task": "Swimmers"}, True),
        ({"task": "Nests", "hard": True}, {"task": "River"}, False),
        ({}, {}, False),
    ],
)
def test_a_policy_flies_in_the_mode_that_it_was_trained_in_unless_another_is_chosen(
    trained: dict[str, Any], given: dict[str, Any], hard: bool
):
    policy: Any = SimpleNamespace(about=SimpleNamespace(context={"env": trained}), obs_size=16)
    assert Evaluate("run", **given).config_for(policy).env.hard is hard


@pytest.mark.parametrize(
    ("given", "levels"),
    [(None, ["Easy", "Medium-Deep", "Hard-Deep"]), ("uav", ["Easy", "Medium", "Hard"])],
)
def test_a_policy_of_a_boat_is_flown_as_a_boat_without_an_option(
    given: Any, levels: list[str], monkeypatch: pytest.MonkeyPatch
):
    flown: list[tuple[str, str]] = []
    policy = image_policy(env={"vehicle": "asv"})

    def courses(_: Any, config: Any, river: str, **__: Any):
        flown.append((river, config.env.vehicle))
        return [], river

    monkeypatch.setattr("thalweg.cli.evaluate.load_named_policy", lambda *_: policy)
    monkeypatch.setattr("thalweg.cli.evaluate._encoder_for", lambda *_: None)
    monkeypatch.setattr("thalweg.cli.evaluate._courses", courses)
    monkeypatch.setattr("thalweg.cli.tables.print_tables", lambda *_, **__: None)
    Evaluate("run", vehicle=given).run()
    assert flown == [(level, given or "asv") for level in levels]


def test_the_hard_mode_of_the_papers_task_is_refused():
    policy: Any = SimpleNamespace(about=SimpleNamespace(context={}), obs_size=16)
    with pytest.raises(ConfigError, match="hard must be False in the task River"):
        Evaluate("run", hard=True).config_for(policy)


def test_only_for_trained_policies_it_is_told_that_a_task_has_other_steps(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("thalweg.cli.evaluate._encoder_for", lambda *_: sys.exit("loads encoders"))
    racing = image_policy(env={"task": "RacingLine"})
    for policy, task, told in (
        (racing, "River", "RacingLine, which has fast steps; River has none"),
        (racing, "Swimmers", ""),
        (image_policy(env={}), "Swimmers", "River, which has no fast step; in Swimmers its third option"),
        (FunctionPolicy(lambda image: (1, 1, 0, 1), name="mine"), "Swimmers", ""),
        (BASELINES["hover"], "Swimmers", ""),
    ):
        monkeypatch.setattr("thalweg.cli.evaluate.load_named_policy", lambda *_, policy=policy: policy)
        with pytest.raises(SystemExit, match="loads encoders"):
            Evaluate("run", task=task).run()
        found = capsys.readouterr().err
        assert told in found if told else found == ""


def test_the_packaged_policy_samples_if_asked_to():
    policy: Any = load_named_policy("packaged")
    sampled: Any = sampling(policy, "packaged")
    assert policy.greedy and policy.player(1).deterministic
    assert not sampled.player(1).deterministic and sampled.player(1, deterministic=True).deterministic


def test_a_policy_that_gives_one_action_has_none_to_sample():
    point: Any = SimpleNamespace(greedy=True, actions=SimpleNamespace(kind="point"))
    with pytest.raises(UsageError, match="--sample is for policies with probabilities of actions; runs/ddpg has none"):
        sampling(point, "runs/ddpg")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["hover", "--sample"], "--sample is for policies with probabilities of actions; hover has none"),
        (["packaged", "--sample", "--deterministic"], "give --sample or --deterministic, not both"),
        (["hover", "--task", "Nests", "--hard", "--no-hard"], "give --hard or --no-hard, not both"),
        (["hover", "--encoder", "none"], "hover sees no frames: leave --encoder none out"),
        (["hover", "--camera", "fov_deg=75"], "hover sees no frames: leave --camera fov_deg=75 out"),
        (
            ["packaged", "--camera", "height_px=96", "fov_deg=75"],
            "packaged sees frames of 128 x 128 pixels (height x width), not 96 x 128: leave height_px and width_px out"
            " of --camera",
        ),
        (["packaged", "--camera", "fov_deg=200"], "fov_deg must be a number from 5 to 150, got 200"),
        (["steady", "--encoder", "geometry"], "steady sees no frames: leave --encoder geometry out"),
    ],
)
def test_options_that_a_policy_does_not_take_are_refused(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["evaluate", *arguments]) == 2
    assert capsys.readouterr().err == f"thalweg: {message}\n"


def test_a_device_that_is_not_there_is_refused_before_a_river_is_built(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("thalweg.cli.evaluate._courses", lambda *_, **__: sys.exit("builds rivers"))
    for policy in ("hover", "packaged"):
        assert main(["evaluate", policy, "--unseen", "--device", "gpu"]) == 2
        assert "gpu" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("policy", "options", "published"),
    [
        (image_policy(env={}), {}, True),
        (image_policy(env={}), {"task": "Swimmers"}, False),
        (image_policy(env={}), {"vehicle": "asv"}, False),
        (image_policy(env={}), {"wind": "3"}, False),
        (SimpleNamespace(sees="privileged"), {}, False),
    ],
    ids=["as the paper", "another task", "a boat", "wind", "the ideal eye"],
)
def test_published_figures_stand_beside_flights_as_the_papers_alone(policy: Any, options: dict, published: bool):
    rules = EnvConfig(
        task=options.get("task", "River"),
        vehicle=options.get("vehicle", "uav"),
        wind=Wind((3.0, 3.0)) if "wind" in options else None,
    )
    assert _is_papers_study(policy, rules) is published
    flown = [Episode("PPO", 0, "Medium", 1, 0, 0.0, 0.0, 5.0, 0.0, 9.0, 0.0, 0.0, 0.0, 99, "Success", True, 0.5)]
    names = paper_table(Results(Path(), {}, [], flown, [], []), published=published).text["policy"].tolist()
    assert names == ["PPO", "PPO (paper, another simulator)"][: 1 + published]


def test_another_camera_keeps_what_is_not_given():
    told = {"height_px": 32, "width_px": 32, "fov_deg": 80.0, "pitch_deg": 5.0}
    policy = image_policy("rgb+mask", 32, env={"camera": told})
    trained = Camera(32, 32, 80.0, 5.0)
    assert flown_camera(policy, "run", ()) == trained
    assert flown_camera(policy, "run", ("pitch_deg=30",)) == Camera(32, 32, 80.0, 30.0)
    assert flown_camera(policy, "run", ("height_px=32",)) == trained
    assert camera_in_words(policy, trained, ("height_px=32", "fov_deg=80")) == ""
    assert camera_in_words(policy, replace(trained, fov_deg=75.0), ("fov_deg=75",)) == "camera fov_deg=75"
    with pytest.raises(UsageError, match=r"run sees frames of 32 x 32 pixels \(height x width\), not 32 x 64"):
        flown_camera(policy, "run", ("width_px=64",))


def test_a_calibration_is_cut_to_the_frames_of_the_policy(tmp_path: Path):
    file = tmp_path / "lens.yaml"
    file.write_text(LENS)
    policy = image_policy("rgb+mask", 32, env={"camera": {"height_px": 32, "width_px": 32, "pitch_deg": 5.0}})
    wanted = camera_of_calibration(file, height_px=32, width_px=32, pitch_deg=5.0)
    assert flown_camera(policy, "run", (str(file),)) == wanted and wanted.lens is not None
    told = camera_in_words(policy, replace(wanted, pitch_deg=9.0, near_m=0.2), (str(file), "pitch_deg=9", "near_m=0.2"))
    assert told == f"camera lens.yaml {file_hash(file)[:8]} near_m=0.2 pitch_deg=9"
    behind = image_policy("rgb+mask", 32, env={"camera": wanted.as_data()})
    assert flown_camera(behind, "run", ("pitch_deg=9",)) == replace(wanted, pitch_deg=9.0)
    with pytest.raises(UsageError, match=r"run was trained behind a lens, .*: leave fov_deg=75 out of --camera"):
        flown_camera(behind, "run", ("fov_deg=75",))


def test_a_policy_is_evaluated_through_another_camera_and_its_rows_say_so(
    tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "lens.yaml").write_text(LENS)
    policy = image_policy("rgb+mask", 32, env={"camera": {"height_px": 32, "width_px": 32}})
    policy.save(tmp_path / "run.safetensors")
    drawn: list[Camera] = []

    class Watched(Renderer):
        def __init__(self, worlds: Any, camera: Camera, *others: Any, **options: Any) -> None:
            drawn.append(camera)
            super().__init__(worlds, camera, *others, **options)

    parsed: list[Path] = []
    parse = calibration._calibration
    monkeypatch.setattr(calibration, "_calibration", lambda file: parsed.append(file) or parse(file))
    monkeypatch.setattr("thalweg.bench.evaluate.evaluation.Renderer", Watched)
    command = ["evaluate", str(tmp_path / "run.safetensors"), "--levels", "easy", "--episodes", "1"]
    command += ["--out", str(tmp_path / "rows.csv"), "--quality", "fast", "--camera", str(tmp_path / "lens.yaml")]
    assert main(command) == 0
    assert len(parsed) == 1
    assert drawn == [camera_of_calibration(tmp_path / "lens.yaml", height_px=32, width_px=32)]
    (row,) = read_episodes(tmp_path / "rows.csv")
    content = file_hash(tmp_path / "lens.yaml")[:8]
    assert row.algorithm == f"run.safetensors (fast frames) (camera lens.yaml {content})"


def test_a_function_is_shown_frames_of_any_size(tmp_path: Path, easy_world: World):
    seen = "import numpy as np\n\n\ndef fly(image):\n    assert image.shape == (24, 48, 4)\n    return 1, 1, 1, 1\n"
    (tmp_path / "mine.py").write_text(seen)
    command = ["evaluate", f"{tmp_path}/mine.py:fly", "--levels", "easy", "--episodes", "1"]
    assert main([*command, "--camera", "height_px=24", "width_px=48"]) == 0


def test_options_of_evaluations_are_obeyed(monkeypatch: pytest.MonkeyPatch):
    policy = SimpleNamespace(sees="nothing", greedy=True, about=SimpleNamespace(context={}))
    told: list[Any] = []

    def evaluate(policy: Any, course: Course, label: Label, config: EvaluationConfig, **_: Any) -> list[Episode]:
        told.append((policy.greedy, course.looks is not None, label.seed, config.starts_seed))
        return []

    monkeypatch.setattr("thalweg.cli.evaluate.load_named_policy", lambda *_: policy)
    monkeypatch.setattr("thalweg.cli.evaluate._encoder_for", lambda *_: None)
    monkeypatch.setattr(
        "thalweg.cli.evaluate._courses", lambda _, config, river, drawn: ([Course.on(ring(), config)], river)
    )
    monkeypatch.setattr(Course, "varied", lambda course, *_: replace(course, looks=np.zeros(len(course.starts))))
    monkeypatch.setattr("thalweg.bench.evaluate.evaluation.observation_function", lambda *_, **__: None)
    monkeypatch.setattr("thalweg.bench.evaluate.evaluation.evaluate", evaluate)
    monkeypatch.setattr("thalweg.cli.tables.print_tables", lambda *_, **__: None)
    assert main(["evaluate", "mine", "--levels", "Easy"]) == 0
    options = ["--seed", "7", "--starts-seed", "5", "--sample", "--randomise"]
    assert main(["evaluate", "mine", "--levels", "Easy", *options]) == 0
    assert told == [(True, False, 0, 0), (False, True, 7, 5)]
