"""Views of tasks beside the paper's, and a training on them: what is true of each, and frames with its objects."""

import csv
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.env.handmade import canal, ring
from thalweg.cli.main import main
from thalweg.core import versions
from thalweg.encoder import EncoderInputError, load_encoder
from thalweg.encoder.geometry import GeometryConfig
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers import river_list
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.tasks import PAPER_TASK, TASKS
from thalweg.render.records.props import KIND, YAW, PropKind, X, Y
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.encoder import geometry
from thalweg.train.encoder import views as views_module
from thalweg.train.encoder.geometry import GeometryTraining, geometry_config, half_mirrored
from thalweg.train.encoder.targets import TASK_TARGETS, targets_of
from thalweg.train.encoder.views import (
    FLIGHT_STEPS,
    STATION_AHEAD_M,
    STRIDE,
    KnownViews,
    draw_views,
    flight_views,
    start_views,
)
from thalweg.train.flip import flipped
from thalweg.world import World

ALL = tuple(TASKS)
NAMES = targets_of(ALL)


@pytest.fixture(scope="module")
def rivers() -> RiverList:
    return RiverList([ring(30.0, 200), canal(150.0)])


@pytest.fixture(scope="module")
def flights(rivers: RiverList) -> KnownViews:
    return flight_views(rivers, 48, 3, ALL)


def of(views: KnownViews, task: str, name: str) -> np.ndarray:
    """A quantity [K] of the views of a task."""
    return views.truths[views.task == ALL.index(task), NAMES.index(name)]


def test_quantities_of_other_tasks_are_not_defined(flights: KnownViews):
    assert flights.task.tolist() == sorted(list(range(5)) * 96) and flights.truths.shape == (480, len(NAMES))
    for number, task in enumerate(ALL):
        known = np.isfinite(flights.truths[flights.task == number])
        wanted = [name in FEATURES or name in TASK_TARGETS[task] for name in NAMES]
        assert (known == wanted).all(), task


def test_views_of_a_task_do_not_depend_on_the_others(rivers: RiverList, flights: KnownViews):
    for views_of, whole in ((flight_views, flights), (start_views, start_views(rivers, 3, 3, ALL))):
        each = int((whole.task == 0).sum()) // 2
        for number, task in enumerate(ALL):
            part, alone = whole.rows(whole.task == number), views_of(rivers, each, 3, (task,))
            for name in ("river", "pose", "time_s", "segment", "travel", "steps", "scene", "station"):
                assert np.array_equal(getattr(part, name), getattr(alone, name)), (task, name)
            mine = [NAMES.index(name) for name in targets_of((task,))]
            assert np.array_equal(part.truths[:, mine], alone.truths)
            most = TASKS[task].props
            assert np.array_equal(part.props[:, :most], alone.props) and not part.props[:, most:].any()
    paper = flight_views(rivers, 8, 3)
    assert paper.props.shape == (16, 0, 6) and np.array_equal(paper.truths, flights.truths[:16, : len(FEATURES)])
    assert not np.array_equal(flights.pose[flights.task == 1], flights.pose[flights.task == 2])


def test_moves_of_pilots_are_disturbed_by_random_ones(rivers: RiverList, monkeypatch: pytest.MonkeyPatch):
    each = 3 * FLIGHT_STEPS // STRIDE  # of three flights
    disturbed = flight_views(rivers, each, 3).pose.reshape(each, 2, 4)
    monkeypatch.setattr(views_module, "MOST_NOISE", 0.0)
    calm = flight_views(rivers, each, 3).pose.reshape(each, 2, 4)
    differ = (disturbed != calm).any(-1)
    assert not differ[0].any() and differ.any(0).all()
    env = RiverVectorEnv([rivers.course(0), rivers.course(1)], 2, EnvConfig(observation="none"))
    env.reset(seed=views_module._seeds(3, 2, PAPER_TASK))
    for step in range(FLIGHT_STEPS):
        if step % STRIDE == 0:
            assert np.array_equal(env.state.pose, calm[step // STRIDE])
        env.step(env.pilot_actions("scripted"))


def test_the_nearest_swimmer_in_view_is_that_of_a_slow_search(flights: KnownViews):
    views = flights.rows(flights.task == ALL.index("Swimmers"))
    half, pitch, found = math.tan(math.radians(30)), math.radians(20), 0
    for row, pose in enumerate(views.pose):
        best = (40.0, 0.0, 0.0)
        for prop in views.props[row]:
            if prop[KIND] not in (PropKind.SWIMMER, PropKind.KAYAK):
                continue
            turned = (prop[X] - pose[0] + 1j * (prop[Y] - pose[1])) * np.exp(-1j * pose[3])
            ends = (0.0, -2.0, 0.7) if prop[KIND] == PropKind.SWIMMER else (0.0, -2.1, 2.1)
            points = [turned + along * np.exp(1j * (prop[YAW] - pose[3])) for along in ends]
            below = pose[2] - prop[3]
            depths = [point.real * math.cos(pitch) + below * math.sin(pitch) for point in points]
            downs = [below * math.cos(pitch) - point.real * math.sin(pitch) for point in points]
            pixels = zip(depths, downs, (point.imag for point in points), strict=True)
            shown = any(depth > 0.3 and max(abs(down), abs(left)) <= half * depth for depth, down, left in pixels)
            if shown and abs(turned) < best[0]:
                best, found = (abs(turned), turned.real, turned.imag), found + 1
        told = [of(flights, "Swimmers", f"swimmer in view {what}")[row] for what in ("distance", "ahead", "left")]
        assert told == pytest.approx(best, abs=1e-3)
    assert found > 20


def test_views_of_a_portage_show_land_below_and_stations(flights: KnownViews):
    land, distance = of(flights, "Portage", "over land"), of(flights, "Portage", "station in view distance")
    assert set(np.unique(land)) == {0.0, 1.0} and land.mean() > 0.1
    assert (distance < 40).mean() > 0.1
    views = flights.rows((flights.task == ALL.index("Portage")) & (flights.river == 1))
    on_canal = views.station[views.travel > 0]
    near = np.abs(on_canal - 148.0) > 1e-6
    assert 0.2 < near.mean() < 0.8 and (views.station >= 2.0).all() and (views.station <= 148.0).all()
    ahead = (on_canal - views.pose[views.travel > 0, 0])[near]
    assert (ahead > -2.0).all() and (ahead <= STATION_AHEAD_M + 1.0).all(), "a canal runs along x"


def test_reserves_and_clearances_vary(flights: KnownViews):
    inside, begins = of(flights, "Nests", "in a reserve"), of(flights, "Nests", "reserve begins")
    assert 0.1 < inside.mean() < 0.6 and (begins[inside > 0] == 0).all() and (begins[inside == 0] > 0).all()
    assert np.ptp(of(flights, "RacingLine", "clearance")) > 1.0


def test_mirrored_views_of_tasks_have_mirrored_truths():
    truths = np.arange(8 * len(NAMES), dtype=np.float32).reshape(8, -1)
    truths[:, NAMES.index("clearance")] = np.nan
    frames = np.arange(8 * 2 * 2 * 4, dtype=np.uint8).reshape(8, 2, 2, 4)
    found = half_mirrored(frames, truths, np.random.default_rng(0), NAMES)
    turned = (found.frames == frames[:, :, ::-1]).all(axis=(1, 2, 3))
    left, ahead = (NAMES.index(f"station in view {what}") for what in ("left", "ahead"))
    assert np.array_equal(found.truths[:, left], np.where(turned, -1, 1) * truths[:, left]) and turned.any()
    assert np.array_equal(found.truths[:, ahead], truths[:, ahead])
    assert np.isnan(found.truths[:, NAMES.index("clearance")]).all()


@pytest.mark.slow
def test_one_environment_draws_each_view_as_its_own_task_does(easy_world: World):
    rivers = RiverList([easy_world])
    views, plain = flight_views(rivers, 8, 3, ALL), Randomisation.only(haze=(1.0, 1.0))
    drawn = {}
    for task in ("River", *ALL):
        env = RiverVectorEnv(rivers, 1, EnvConfig(task=task, randomisation=plain, quality="fast"))
        given = views if not drawn else views.rows(views.task == ALL.index(task))
        own = given if not drawn else given._replace(props=given.props[:, :0])
        drawn["all" if not drawn else task] = draw_views(env, own, np.random.default_rng(0))
        env.close()
    shown = np.where(views.props[:, :1, KIND] > 0, 1, 0)[:, 0]
    assert set(views.task[shown > 0]) >= {1, 2}
    for number, task in enumerate(ALL):
        assert np.array_equal(drawn["all"][views.task == number], drawn[task]), task
    bare = draw_without_objects(rivers, views, plain)
    assert np.array_equal(bare[shown == 0], drawn["all"][shown == 0])
    assert (bare[views.task == 1] != drawn["all"][views.task == 1]).any()


def draw_without_objects(rivers: RiverList, views: KnownViews, looks: Randomisation) -> np.ndarray:
    env = RiverVectorEnv(rivers, 1, EnvConfig(randomisation=looks, quality="fast"))
    frames = draw_views(env, views._replace(props=views.props[:, :0]), np.random.default_rng(0))
    env.close()
    return frames


TOY = {
    "levels": ("Easy",),
    "world_seeds": (1,),
    "held_out_seeds": (2,),
    "views": 24,
    "images": 80,
    "passes": 1,
    "held_out": 16,
    "epochs": 2,
    "precision": "float32",
}


def toy(folder: Path, tasks: tuple[str, ...] = ALL, **options: Any) -> GeometryTraining:
    return GeometryTraining(
        folder, geometry_config(tasks, hidden=8, latent=4, batch=16), tasks=tasks, **(TOY | options)
    )


@pytest.fixture
def painted(monkeypatch: pytest.MonkeyPatch) -> None:
    """All rivers are rings made by hand, and frames are noise."""

    def noise(env: Any, views: KnownViews, generator: np.random.Generator) -> np.ndarray:
        return generator.integers(0, 255, (len(views.river), 128, 128, 4), np.uint8)

    monkeypatch.setattr(river_list, "load_or_plan", lambda *_: ring())
    monkeypatch.setattr(GeometryTraining, "drawn", lambda *_: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(geometry, "draw_views", noise)


def test_a_training_on_tasks_resumes_to_the_bit_and_is_judged_on_each(
    painted: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    whole = toy(tmp_path / "whole").run(progress=False)
    draw = geometry.RiverLessons.draw

    def stopped(self: Any, epoch: int) -> Any:
        if epoch == 1:
            raise KeyboardInterrupt
        return draw(self, epoch)

    with monkeypatch.context() as broken, pytest.raises(KeyboardInterrupt):
        broken.setattr(geometry.RiverLessons, "draw", stopped)
        toy(tmp_path / "parts").run(progress=False)
    parts = toy(tmp_path / "parts").run(progress=False)
    assert parts.path.read_bytes() == whole.path.read_bytes()
    encoder = load_encoder(parts.path)
    assert isinstance(encoder.config, GeometryConfig) and encoder.config.targets == NAMES
    assert encoder.about["tasks"] == list(ALL)
    with (tmp_path / "parts" / "probe.csv").open() as file:
        rows = list(csv.DictReader(file))
    labels = [f"{kind} in {task}" for kind in ("flights", "starts") for task in ALL]
    assert [(row["encoder"], row["views"]) for row in rows] == [(e, v) for e in ("geometry", "default") for v in labels]
    row = rows[labels.index("flights in RacingLine")]
    assert row["clearance"] and row["height"] and not row["reserve_begins"]
    again = toy(tmp_path / "parts").run()
    assert again.already_finished and list(again.scores) == list(parts.scores)
    line = next(line for line in again.lines if line.startswith("geometry, flights in Nests: "))
    assert "reserve begins" in line and "clearance" not in line
    with pytest.raises(ValueError, match="belongs to another geometry encoder training"):
        toy(tmp_path / "parts", ("River", "Nests")).run()


def test_a_training_without_tasks_has_the_identity_it_always_had(tmp_path: Path):
    plain = GeometryTraining(tmp_path, geometry_config())
    assert "tasks" not in plain._identity and plain._labels("starts") == ("starts",)
    assert plain.config.targets == FEATURES
    assert toy(tmp_path, ("River", "Nests"))._identity["tasks"] == ["River", "Nests"]


def test_a_training_on_other_banks_has_their_version(tmp_path: Path):
    assert toy(tmp_path, levels=("Easy", "Easy+meadow"))._identity["banks_version"] == versions.BANKS
    assert "banks_version" not in toy(tmp_path)._identity


def test_tasks_are_refused_before_anything_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture):
    with pytest.raises(EncoderInputError, match=r"config predicts 37 quantities, but views of River, Nests have 40"):
        GeometryTraining(tmp_path / "new", geometry_config(), tasks=("River", "Nests")).run()
    for given, told in (
        (["--target", "geometry", "--tasks", "River", "Swimers"], "unknown task 'Swimers' (did you mean 'Swimmers'?)"),
        (["--target", "geometry", "--tasks", "Nests", "Nests"], "each once, not Nests, Nests"),
        (["--tasks", "Nests"], "--tasks is for --target geometry"),
        (["--target", "water", "--tasks", "Nests"], "--tasks does not go with --target water"),
    ):
        assert main(["encoder", "train", "--out", str(tmp_path / "new"), *given]) != 0
        assert told in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "new").exists()


def test_each_epoch_is_drawn_anew_and_learnt_from_in_every_pass(painted: None, tmp_path: Path):
    lessons = geometry.RiverLessons(toy(tmp_path, ("River",), passes=3))
    first, again, other = (list(lessons.draw(epoch)) for epoch in (0, 0, 1))
    assert len(first) == len(other) == 3
    for one, same in zip(first, again, strict=True):
        assert np.array_equal(one.frames, same.frames) and np.array_equal(one.truths, same.truths)
    turned = []
    for each in first[1:]:
        here, there = (
            (each.frames == frames).all(axis=(1, 2, 3)) for frames in (first[0].frames, flipped(first[0].frames))
        )
        assert (here | there).all()
        turned.append(there.mean())
    assert all(0.2 < share < 0.8 for share in turned) and turned[0] != turned[1]
    assert not np.array_equal(first[0].truths, other[0].truths)
    assert not (other[0].frames == first[0].frames).all(axis=(1, 2, 3)).any()
