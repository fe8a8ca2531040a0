"""Encoders of geometry and finders of water that learn from a real river, and are judged under other plants."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.train.encoder.test_geometry import run
from thalweg.cli.main import main
from thalweg.encoder import EncoderFileError, EncoderInputError, load_encoder
from thalweg.encoder.files import read_tensors
from thalweg.encoder.geometry import GeometryNetwork
from thalweg.encoder.geometry_training import write_geometry
from thalweg.encoder.water import KIND as WATER
from thalweg.env.config import ConfigError
from thalweg.env.rivers.memory import SHARE, drawn_bytes
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.tasks import TASKS
from thalweg.train.encoder import geometry, grounds
from thalweg.train.encoder.geometry import GeometryTraining
from thalweg.train.encoder.grounds import REACH_SEEDS, Grounds
from thalweg.train.encoder.probe_table import probe_table
from thalweg.train.encoder.targets import targets_of
from thalweg.train.encoder.views import flight_views, start_views
from thalweg.train.encoder.water import WaterTraining
from thalweg.world import Reach, World, WorldFileError

LINE = '{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}'


@pytest.fixture
def brook(tmp_path: Path) -> Reach:
    (tmp_path / "brook.geojson").write_text(LINE)
    return Reach(tmp_path / "brook.geojson", width_m=9.0)


@pytest.fixture
def bare(brook: Reach) -> World:
    """The river of the file without plants, which is built at once."""
    return World.from_file(brook.path, width_m=9.0, plants=False)


def test_quantities_of_all_tasks_are_defined_on_an_open_course_up_to_its_end(bare: World):
    tasks = tuple(TASKS)
    views = flight_views(RiverList([bare]), 40, 3, tasks)
    names = targets_of(tasks)
    assert not bare.river.closed and len(views.pose) == 40 * len(tasks)
    for number, task in enumerate(tasks):
        truths = views.truths[views.task == number]
        defined = [name for column, name in enumerate(names) if np.isfinite(truths[:, column]).all()]
        assert defined == list(targets_of((task,)))
    ahead = views.truths[:, FEATURES.index("ahead at 24 m")]
    assert ahead.min() < 12.0, "past the end of the course, it is the end that lies ahead"


def test_a_real_river_is_identified_by_its_content_and_options(brook: Reach, tmp_path: Path):
    for training in (run(tmp_path, river=brook), WaterTraining(tmp_path, river=brook)):
        said = training._identity if isinstance(training, GeometryTraining) else training._identity()
        assert said["river"] == brook.as_data() and "levels" not in said and "banks_version" not in said
    assert "banks_version" in Grounds((), replace(brook, banks="meadow")).as_data()
    assert Grounds(("easy", "Medium")).as_data() == {"levels": ["Easy", "Medium"]}


def test_codes_are_judged_at_other_poses_than_those_of_training(
    tmp_path: Path, brook: Reach, bare: World, monkeypatch: pytest.MonkeyPatch
):
    asked: list[tuple[str, np.ndarray]] = []

    def noted(views_of: Any) -> Any:
        def views(*given: Any) -> Any:
            found = views_of(*given)
            asked.append((views_of.__name__, found.pose))
            return found

        return views

    monkeypatch.setattr(Grounds, "worlds", lambda _, seeds: [replace(bare, seed=seed) for seed in seeds])
    monkeypatch.setattr(geometry, "KINDS", {"flights": noted(flight_views), "starts": noted(start_views)})
    monkeypatch.setattr(geometry, "draw_views", lambda _, views, __: np.zeros((len(views.pose), 1, 1, 4), np.uint8))
    training = run(tmp_path, river=brook)
    training._judged()
    learnt = flight_views(training.rivers(training.seeds), 32, training.seed).pose
    assert [name for name, _ in asked] == ["flight_views", "start_views"]
    for _, judged in asked:
        apart = np.abs(judged[:, None] - learnt[None]).max(axis=2)
        assert apart.min() > 1e-6
    assert not set(REACH_SEEDS["world_seeds"]) & set(REACH_SEEDS["held_out_seeds"])


def test_what_does_not_go_with_a_real_river_is_refused(tmp_path: Path, brook: Reach):
    with pytest.raises(EncoderInputError, match=r"rivers_in_memory is for levels; all valleys of brook\.geojson are"):
        run(tmp_path / "run", river=brook, rivers_in_memory=2).run()
    missing = Reach(tmp_path / "none.gpx")
    for training in (run(tmp_path / "run", river=missing), WaterTraining(tmp_path / "run", river=missing)):
        with pytest.raises(WorldFileError, match=r"none\.gpx: "):
            training.run()
    assert not (tmp_path / "run").exists()


def test_valleys_of_training_and_judging_that_do_not_fit_together_are_refused_before_any_is_loaded(
    tmp_path: Path, brook: Reach, monkeypatch: pytest.MonkeyPatch
):
    three = int(3.5 * drawn_bytes(brook.build(1)) / SHARE)
    monkeypatch.setattr(grounds, "free_bytes", lambda: three)
    for name in ("worlds", "listed"):
        monkeypatch.setattr(Grounds, name, lambda *_: pytest.fail("rivers are loaded"))
    seeds: dict[str, Any] = {"world_seeds": (1, 2), "held_out_seeds": (3, 4)}
    Grounds((), brook).check_all_fit((1, 2))  # as each list does alone
    for training in (
        run(tmp_path / "geometry", river=brook, **seeds),
        WaterTraining(tmp_path / "water", river=brook, **seeds),
    ):
        with pytest.raises(ConfigError, match=r"^4 rivers of .* at most 3 fit$"):
            training.run(progress=False)


def test_the_command_takes_a_river_and_seeds_of_its_plants(
    tmp_path: Path, brook: Reach, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    out = tmp_path / "run"
    seeds: dict[str, Any] = dict(REACH_SEEDS)
    training = GeometryTraining(out, geometry.geometry_config(), river=brook, **seeds)
    scores = {("geometry", "flights"): np.linspace(0, 1, len(training.targets))}
    write_geometry(out / "encoder.safetensors", GeometryNetwork(training.config), training._about)
    (out / "probe.csv").write_text(probe_table(scores))
    monkeypatch.setattr(GeometryTraining, "drawn", None)
    river = ["--river", str(brook.path), "--width-m", "9"]
    command = ["encoder", "train", "--target", "geometry", "--out", str(out)]
    assert main([*command, *river]) == 0
    printed = capsys.readouterr()
    assert printed.err == f"{out} was finished before; nothing was trained.\n"
    assert "judged on the same course under other plants and hills, under all looks, by R²" in printed.out
    for options, told in (
        ([*river, "--held-out-seeds", "7"], "--held-out-seeds is [3000, 3001] there and [7] here"),
        (["--river", str(brook.path), "--width-m", "8"], "river.width_m is 9.0 there and 8.0 here"),
        ([], "levels is absent there and ['Easy', 'Medium', 'Hard'] here"),
    ):
        assert main([*command, *options]) == 2
        assert told in capsys.readouterr().err


@pytest.mark.slow
def test_geometry_is_learnt_from_a_real_river(tmp_path: Path, brook: Reach):
    result = run(tmp_path / "run", river=brook, epochs=1, images=16, views=16).run(progress=False)
    encoder = load_encoder(result.path)
    assert encoder.about["river"] == brook.as_data() and "levels" not in encoder.about
    assert {kind for _, kind in result.scores} == {"flights", "starts"}
    assert np.isfinite(result.scores["geometry", "flights"][result.targets.index("height")])
    brook.path.write_text(LINE.replace("9.0012", "9.0013"))
    with pytest.raises(EncoderFileError, match=r"river\.content is '\w+' there and '\w+' here"):
        run(tmp_path / "run", river=brook, epochs=1, images=16, views=16).run(progress=False)


@pytest.mark.slow
def test_water_is_learnt_from_a_real_river(tmp_path: Path, brook: Reach, capsys: pytest.CaptureFixture):
    numbers = ["--images", "8", "--held-out", "8", "--epochs", "1", "--world-seeds", "1", "--held-out-seeds", "2"]
    river = ["--river", str(brook.path), "--width-m", "9"]
    out = tmp_path / "run"
    assert main(["encoder", "train", "--target", "water", *numbers, *river, "--out", str(out)]) == 0
    assert "IoU of water 0." in (told := capsys.readouterr().out) and "same course under other plants" in told
    said = read_tensors(out / "water.safetensors", WATER)[1]["run"]
    assert (said["river"], said["world_seeds"], said["held_out_seeds"]) == (brook.as_data(), [1], [2])
