"""Tests of the options for cameras, quality, looks and actions, from the command line to what is flown."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from tests.cli.calibration import LENS
from tests.image_policies import image_policy
from thalweg.bench.evaluate.evaluation import Step, observation_function
from thalweg.bench.suite.views import TrainingViews
from thalweg.cli.main import main
from thalweg.cli.options import UsageError
from thalweg.cli.views import TrainedViews, camera_from
from thalweg.datasets.recordings import read_recordings
from thalweg.env import EnvConfig
from thalweg.render import Camera, Randomisation, Renderer
from thalweg.train import load_policy
from thalweg.train.observations import action_of, camera_of
from thalweg.world import World

SMALL = ["--level", "easy", "--num-envs", "2", "--steps", "160", "--set", "steps_per_update=32"]


def test_the_options_become_rules():
    views = TrainedViews(("fov_deg=75", "height_px=64", "width_px=96"), "fast", True, "continuous")
    rules = views.applied(EnvConfig(), drawn=True)
    assert rules.camera == Camera(64, 96, 75.0)
    assert (rules.quality, rules.randomisation, rules.action) == ("fast", Randomisation(), "continuous")
    assert TrainedViews().applied(EnvConfig(task="Nests"), drawn=False) == EnvConfig(task="Nests")


def test_options_replace_the_views_of_a_suite_where_they_are_given():
    usual = TrainingViews(quality="fast", randomise=True)
    assert TrainedViews().replacing(usual) == usual
    assert TrainedViews(quality="full").replacing(usual) == TrainingViews(quality="full", randomise=True)


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        (("fov=75",), "--camera has no setting 'fov' \\(did you mean 'fov_deg'\\?\\); known: height_px, width_px"),
        (("a.yaml", "b.yaml"), "one file of a calibration, not a.yaml and b.yaml"),
    ],
)
def test_settings_of_cameras_that_do_not_exist_are_refused(texts: tuple[str, ...], told: str):
    with pytest.raises(UsageError, match=told):
        camera_from(texts)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--camera", "fov_deg=200"], "fov_deg must be a number from 5 to 150, got 200"),
        (["--camera", "none.yaml"], "none.yaml cannot be read as a calibration"),
        (["--camera", "height_px=96"], "the camera draws frames of 96 x 128 pixels"),
        (["--observation", "privileged", "--randomise"], "draws no frames: leave --randomise out"),
        (["--observation", "privileged", "--quality", "full"], "draws no frames: leave --quality out"),
        (["--dynamics", "inertial", "--action", "multidiscrete"], "leave --action multidiscrete out"),
    ],
)
def test_what_does_not_go_together_is_refused_before_anything_is_trained(
    options: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture
):
    assert main(["train", "--out", str(tmp_path / "run"), "--level", "easy", *options]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_policy_is_shown_frames_of_the_camera_that_it_was_trained_with(easy_world: World):
    camera = {"height_px": 32, "width_px": 32, "fov_deg": 80.0, "pitch_deg": 5.0}
    policy = image_policy("rgb+mask", 32, env={"camera": camera})
    pose = np.array([[*easy_world.river.position_m[3], easy_world.river.level_m[3] + 4.0, 1.0]])
    step = Step(np.array([0]), pose, np.zeros(1), np.zeros(1), None, None)
    for quality in ("full", "fast"):
        observe = observation_function(policy, easy_world, None, quality=quality)
        assert observe is not None
        wanted = Renderer([easy_world], Camera(**camera), quality).render(pose)
        np.testing.assert_array_equal(observe(step), wanted)


def test_views_are_drawn_by_a_chosen_camera_under_varied_looks(tmp_path: Path, easy_world: World):
    poses = np.array([[*easy_world.river.position_m[3], easy_world.river.level_m[3] + 4.0, 1.0]])
    command = ["render", "--level", "easy", "--pose", *map(str, poses[0]), "--out", str(tmp_path / "a.png")]
    frames: dict[str, np.ndarray] = {}
    for name, options in {"usual": [], "varied": ["--randomise", "--poses-seed", "2"]}.items():
        folder = tmp_path / name
        views = ["--camera", "height_px=32", "width_px=48", "fov_deg=75", *options]
        assert main([*command, *views, "--frames", str(folder)]) == 0
        frames[name] = np.asarray(Image.open(folder / "0000.png"))
    wanted = Renderer([easy_world], Camera(32, 48, 75.0)).render(poses)[0, ..., :3]
    np.testing.assert_array_equal(frames["usual"], wanted)
    assert frames["varied"].shape == wanted.shape and np.abs(frames["varied"].astype(int) - wanted).mean() > 2


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--camera", "fov_deg=75", "--size", "64"], "--size goes without --camera, which has height_px and width_px"),
        (["--gallery", "--randomise"], "leave out --frames, --quality and --randomise"),
        (["--camera", "height_px=4"], "height_px must be"),
        (["--gallery", "--task", "Swimmers"], "--gallery draws one view without objects: leave out --task and --count"),
        (["--gallery", "--count", "3"], "leave out --task and --count"),
        (["--task", "Swimers"], "did you mean 'Swimmers'?"),
    ],
)
def test_views_that_do_not_go_together_are_refused(options: list[str], told: str, capsys: pytest.CaptureFixture):
    assert main(["render", "--level", "easy", *options]) == 2
    assert told in capsys.readouterr().err


def test_a_run_through_another_camera_trains_is_evaluated_and_exported(tmp_path: Path, easy_world: World, capsys):
    run, out = tmp_path / "run", tmp_path / "policy.onnx"
    small = ["policy=cnn", "filters=[4,4,4,4]", "features=8"]
    views = ["--camera", "height_px=32", "width_px=48", "fov_deg=75", "--quality", "fast"]
    assert main(["train", "--algorithm", "PPO", *SMALL, *small, *views, "--out", str(run)]) == 0
    env = yaml.safe_load((run / "config.yaml").read_text())["run"]["context"]["env"]
    assert (env["quality"], env["camera"]["width_px"], env["camera"]["fov_deg"]) == ("fast", 48, 75.0)
    assert camera_of(load_policy(run)) == Camera(32, 48, 75.0)
    assert main(["evaluate", str(run), "--levels", "easy", "--episodes", "1", "--quality", "fast"]) == 0
    assert "run (fast frames)" in capsys.readouterr().out
    assert main(["export", str(run), "--out", str(out)]) == 0
    assert "of 32 x 48 pixels, 75 degrees" in capsys.readouterr().out


def test_the_lens_of_a_calibration_is_drawn_trained_evaluated_and_exported(tmp_path: Path, easy_world: World, capsys):
    (tmp_path / "lens.yaml").write_text(LENS)
    views = ["--camera", str(tmp_path / "lens.yaml"), "height_px=36", "width_px=48"]
    camera = camera_from(tuple(views[1:]))
    pose = np.array([[*easy_world.river.position_m[3], easy_world.river.level_m[3] + 4.0, 1.0]])
    drawn = ["render", "--level", "easy", "--pose", *map(str, pose[0]), "--frames", str(tmp_path), *views]
    assert main([*drawn, "--out", str(tmp_path / "a.png")]) == 0
    seen = Renderer([easy_world], camera).render_layers(pose)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "0000.png")), seen.rgb[0])

    run, small = tmp_path / "run", ["policy=cnn", "filters=[4,4,4,4]", "features=8"]
    train = ["train", "--algorithm", "PPO", *SMALL, *small, "--quality", "fast", "--out", str(run)]
    assert main([*train, *views]) == 0
    env = yaml.safe_load((run / "config.yaml").read_text())["run"]["context"]["env"]
    assert env["camera"]["lens"]["coefficients"] == [-0.2, 0.04, 0.001, -0.001, 0.0]
    assert camera_of(load_policy(run)) == camera
    assert main(["evaluate", str(run), "--levels", "easy", "--episodes", "1"]) == 0
    assert main(["export", str(run), "--out", str(tmp_path / "policy.onnx")]) == 0
    assert "36 x 48 pixels, 72.8889 degrees behind a plumb_bob lens;" in " ".join(capsys.readouterr().out.split())
    # The same run behind another lens is another run.
    (tmp_path / "lens.yaml").write_text(LENS.replace("-0.2,", "-0.19,"))
    assert main([*train, *views]) == 2
    assert "lens" in capsys.readouterr().err


def test_a_run_of_continuous_actions_is_evaluated_and_filmed_with_them(
    tmp_path: Path, easy_world: World, capsys: pytest.CaptureFixture
):
    run = tmp_path / "run"
    train = ["train", "--algorithm", "PPO", *SMALL, "--observation", "privileged", "--action", "continuous"]
    assert main([*train, "--out", str(run)]) == 0
    assert action_of(load_policy(run)) == "continuous"
    assert main(["evaluate", str(run), "--levels", "easy", "--episodes", "1"]) == 0
    film = ["film", str(run), "--level", "easy", "--steps", "2", "--out", str(tmp_path / "a.mp4")]
    assert main([*film, "--action", "multidiscrete"]) == 2
    told = capsys.readouterr().err
    assert f"--action multidiscrete does not go with {run}, which has continuous actions: leave it out" in told
    assert not (tmp_path / "a.mp4").exists()
    assert main(film) == 0
    flown = ["record", str(run), "--level", "easy", "--episodes", "1", "--steps", "2", "--layers", "mask"]
    assert main([*flown, "--out", str(tmp_path / "flights")]) == 0
    (flight,) = read_recordings(tmp_path / "flights")[1]
    assert flight.options is None and flight.options_of_flight["action"] == "continuous"


@pytest.mark.parametrize("option", ["--no-hard", "--no-randomise", "--no-carried-by-current"])
def test_a_bench_offers_no_option_that_its_suite_would_overrule(option: str, capsys: pytest.CaptureFixture):
    with pytest.raises(SystemExit, match="2"):
        main(["bench", "quick", option, "--out", "x"])
    assert f"Unrecognized options: {option}" in capsys.readouterr().err
