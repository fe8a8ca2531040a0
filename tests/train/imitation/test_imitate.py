"""A run of an imitation: what it writes, how it resumes, and what it refuses."""

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import torch

from tests.image_policies import image_policy
from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.imitation.config import ImitationConfig, Teacher
from thalweg.algos.imitation.student import Lesson, Student
from thalweg.cli.main import main
from thalweg.core import versions
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import ConfigError
from thalweg.env.rivers.river_list import RiverList
from thalweg.render import Renderer
from thalweg.render.records.randomisation import Randomisation
from thalweg.train import load_policy
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import RUN_FOLDER
from thalweg.train.imitation import flights, frame_memory, gate, imitate
from thalweg.train.imitation.flights import Flights, redraw
from thalweg.train.imitation.imitate import Imitation
from thalweg.train.imitation.mirroring import ORDER
from thalweg.train.imitation.sequences import Sequences
from thalweg.train.imitation.trainer import ImitationTrainer
from thalweg.train.rollouts.episodes import Episode
from thalweg.world import Level, Reach, World, level_named

SETTINGS = {
    "sequence": 4,
    "sequences_per_batch": 2,
    "filters": [4, 4, 4, 4],
    "features": 8,
    "memory_size": 8,
    "hidden": [8],
    "capacity": 16,
    "gate_rivers": 1,
    "teacher_steps": 24,
}


def imitation(folder: Path, **options: Any) -> Imitation:
    given = {
        "steps": 48,
        "levels": ("Easy",),
        "world_seeds": (1,),
        "num_envs": 2,
        "settings": SETTINGS,
        "threads": 1,
        "checkpoint_seconds": 0.0,
    }
    return Imitation(folder, **(given | options))


class Stop(Exception):
    pass


def rows(folder: Path) -> list[dict[str, str]]:
    with open(folder / "metrics.csv", newline="") as file:
        found = list(csv.DictReader(file))
    timing = ("time_", "seconds", "steps_per_second")
    return [{name: value for name, value in row.items() if not name.startswith(timing)} for row in found]


@pytest.mark.parametrize("memory", [0, 8])
def test_an_interrupted_run_resumes_to_the_same_numbers(memory: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    given = {"settings": SETTINGS | {"memory_size": memory}}
    whole = imitation(tmp_path / "whole", **given).run()
    update, calls = ImitationTrainer.update, []

    def interrupted(trainer: ImitationTrainer) -> dict[str, float]:
        calls.append(trainer)
        if len(calls) == 4:
            raise Stop
        return update(trainer)

    monkeypatch.setattr(ImitationTrainer, "update", interrupted)
    with pytest.raises(Stop):
        imitation(tmp_path / "parts", **given).run()
    parts = imitation(tmp_path / "parts", **given).run()
    assert parts.resumed_from == 24 and parts.steps == whole.steps == 48
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole")
    flat = [load_policy(tmp_path / name).actor.stack.flat for name in ("whole", "parts")]
    assert torch.equal(*flat)
    assert imitation(tmp_path / "parts", **given).run().already_finished


def test_shares_and_rates_fall_and_steps_are_replayed_as_the_settings_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    act, learn, given, lessons = Flights.act, Student.learn, [], []

    def acting(flown: Flights, teacher_share: float, noise: float) -> np.ndarray:
        given.append((teacher_share, noise))
        return act(flown, teacher_share, noise)

    def learning(student: Student, lesson: Lesson) -> dict[str, float]:
        lessons.append((lesson.rows.shape[1], student.optimiser.rate, float(student.scale.count)))
        return learn(student, lesson)

    monkeypatch.setattr(Flights, "act", acting)
    monkeypatch.setattr(Student, "learn", learning)
    settings = SETTINGS | {"replay": 1.5, "noise": 0.25, "in_mirror": False, "learning_rate": 0.01, "capacity": 64}
    imitation(tmp_path / "run", steps=32, settings=settings).run()
    # Two environments take 16 steps each, and the teacher has 24 steps of both together.
    assert given == [(pytest.approx(max(1.0 - 2 * step / 24, 0.0)), 0.25) for step in range(16)]
    # Two sequences of 4 steps are flown, and from the second update three stored ones are drawn again.
    rates = [0.01 * (1.0 - 0.95 * share) for share in (0.25, 0.5, 0.75, 1.0)]
    expected = [
        [(2, rates[0], 8.0)],
        *([(2, rates[at], 8.0 * (at + 1)), (3, rates[at], 8.0 * (at + 1))] for at in (1, 2, 3)),
    ]
    assert lessons == [pytest.approx(each) for update in expected for each in update]
    found = rows(tmp_path / "run")
    assert [float(row["learning_rate"]) for row in found] == pytest.approx(rates)
    assert [float(row["stored_steps"]) for row in found] == [8.0, 16.0, 24.0, 32.0]
    assert [math.isnan(float(row["replayed_regret"] or "nan")) for row in found] == [True, False, False, False]


@pytest.mark.parametrize(("share", "restarted"), [(0.0, []), (0.5, [0]), (1.0, [0, 1])])
def test_a_share_of_the_flights_begins_anew_every_few_steps(
    share: float, restarted: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    step, found = ImitationTrainer.step, []

    def watched(trainer: ImitationTrainer) -> list[Episode]:
        before = trainer.env.state.pose.copy()
        poses: list[np.ndarray] = []
        act = trainer.flights.act

        def acting(*given: float) -> np.ndarray:
            poses.append(trainer.env.state.pose.copy())
            assert (trainer.env.observe() == trainer.flights.images).all()
            return act(*given)

        monkeypatch.setattr(trainer.flights, "act", acting)
        episodes = step(trainer)
        monkeypatch.setattr(trainer.flights, "act", act)
        moved = (poses[0] != before).any(axis=1)
        found.append(np.flatnonzero(moved).tolist())
        assert trainer.flights.sequences().fresh[-1][moved].all()
        return episodes

    monkeypatch.setattr(ImitationTrainer, "step", watched)
    imitation(tmp_path / "run", settings=SETTINGS | {"start_share": share, "start_steps": 2}).run()
    assert found == [restarted, []] * 12


@pytest.mark.parametrize("twice", [False, True])
def test_what_was_flown_is_learnt_from_again_in_a_mirror(twice: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    learn, lessons, trainers = ImitationTrainer.learn, [], []

    def watched(trainer: ImitationTrainer, lesson: Lesson) -> dict[str, float]:
        trainers.append(trainer)
        lessons.append(replace(lesson, rows=lesson.rows.clone()))
        return learn(trainer, lesson)

    monkeypatch.setattr(ImitationTrainer, "learn", watched)
    imitation(tmp_path / "run", steps=8, settings=SETTINGS | {"in_mirror": twice}).run()
    assert len(lessons) == 1 + twice
    kept = trainers[0].store.take(np.arange(2))
    assert np.array_equal(kept.worths, lessons[0].worths.numpy())
    if twice:
        plain, other = lessons
        images, mirrored = (lesson.rows[..., :-4].reshape(4, 2, 128, 128, 4) for lesson in lessons)
        assert torch.equal(mirrored, images.flip(3)) and not torch.equal(mirrored, images)
        assert torch.equal(other.worths, plain.worths[..., ORDER])
        assert other.fresh[0].all()


@pytest.mark.parametrize(("share", "flown"), [(0.0, {"0", "1"}), (0.5, {"1"}), (1.0, set())])
def test_flights_that_begin_anew_are_no_episodes(
    share: float, flown: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    step = ImitationTrainer.step

    def crashing(trainer: ImitationTrainer) -> list[Episode]:
        trainer.env.state.pose[:, 2] = 100.0
        return step(trainer)

    monkeypatch.setattr(ImitationTrainer, "step", crashing)
    imitation(tmp_path / "run", settings=SETTINGS | {"start_share": share}).run()
    with open(tmp_path / "run" / "episodes.csv", newline="") as file:
        assert {row["env"] for row in csv.DictReader(file)} == flown


def weights_of(folder: Path) -> torch.Tensor:
    return torch.cat([parameter.detach().flatten() for parameter in load_policy(folder).actor.parameters()])


def test_a_student_begins_with_the_weights_of_another(tmp_path: Path):
    imitation(tmp_path / "first").run()
    still = {"settings": SETTINGS | {"learning_rate": 1e-9}, "seed": 1}
    imitation(tmp_path / "second", begin_with=tmp_path / "first", **still).run()
    imitation(tmp_path / "anew", **still).run()
    torch.testing.assert_close(weights_of(tmp_path / "second"), weights_of(tmp_path / "first"), rtol=0.0, atol=1e-6)
    assert (weights_of(tmp_path / "anew") - weights_of(tmp_path / "first")).abs().max() > 1e-2
    imitation(tmp_path / "other", seed=2).run()
    with pytest.raises(TrainingError, match="begin_with"):
        imitation(tmp_path / "second", begin_with=tmp_path / "other", **still).run()


def test_a_student_does_not_begin_with_a_policy_that_has_fast_steps(tmp_path: Path):
    image_policy(env={"task": "RacingLine"}).save(tmp_path / "racing.safetensors")
    with pytest.raises(TrainingError, match="trained on RacingLine, which has fast steps, and River has none"):
        imitation(tmp_path / "student", begin_with=tmp_path / "racing.safetensors").run()
    assert not (tmp_path / "student").exists()


def test_a_student_does_not_begin_with_a_policy_of_another_kind(tmp_path: Path):
    imitation(tmp_path / "first").run()
    wider = {"settings": SETTINGS | {"hidden": [9]}}
    with pytest.raises(AlgorithmError, match=r"hidden is \(9,\) here and \(8,\) there"):
        imitation(tmp_path / "second", begin_with=tmp_path / "first", **wider).run()
    with pytest.raises(AlgorithmError, match="no policy"):
        imitation(tmp_path / "second", begin_with=tmp_path / "nowhere").run()
    assert not (tmp_path / "second").exists()


def test_a_policy_says_what_it_sees(tmp_path: Path):
    imitation(tmp_path / "run", steps=8, settings=SETTINGS | {"observation": "mask"}).run()
    policy = load_policy(tmp_path / "run")
    assert policy.about.algorithm == "DAgger" and policy.about.context["observation"] == "mask"
    assert policy.greedy and policy.shape.eyes.image == (128, 128, 1)


@pytest.fixture
def brook(tmp_path: Path) -> Path:
    file = tmp_path / "brook.geojson"
    file.write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0008, 48], [9.0016, 48.0003]]}')
    return file


def test_a_real_river_is_learnt_from_after_the_gate_and_known_by_its_content(brook: Path, tmp_path: Path):
    options = {"river": Reach(brook, width_m=9.0), "world_seeds": (0, 1), "steps": 8}
    imitation(tmp_path / "run", **options).run()
    context = load_policy(tmp_path / "run").about.context
    assert context["river"]["file"] == "brook.geojson" and context["world_seeds"] == [0, 1]
    assert "levels" not in context
    assert imitation(tmp_path / "run", **options).run().already_finished
    with pytest.raises(TrainingError, match=r"context\.river"):
        imitation(tmp_path / "run", steps=8).run()
    brook.write_text(brook.read_text().replace("9.0008", "9.0009"))
    with pytest.raises(TrainingError, match=r"brook\.geojson has changed since the run in .* was started"):
        imitation(tmp_path / "run", **options).run()


@pytest.mark.parametrize(
    ("on_river", "options", "first", "number"),
    [
        (True, [], 0, 1),
        (True, ["--world-seeds", "1000:1064"], 1000, 64),
        (False, [], 1000, 64),
        (False, ["--world-seeds", "3"], 3, 1),
    ],
)
def test_explicit_seeds_are_taken_on_a_real_river_though_they_are_the_default_of_levels(
    on_river: bool,
    options: list[str],
    first: int,
    number: int,
    brook: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    def interrupted(run: Imitation, progress: bool) -> None:
        assert (run.world_seeds[0], len(run.world_seeds)) == (first, number)
        raise KeyboardInterrupt

    monkeypatch.setattr(Imitation, "run", interrupted)
    ground = ["--river", str(brook)] if on_river else ["--levels", "Easy"]
    assert main(["imitate", "--out", str(tmp_path / "run"), *ground, *options]) == 130


def test_explicit_levels_beside_a_real_river_are_refused_though_they_are_the_default(
    brook: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    given = ["--river", str(brook), "--levels", "Easy", "Medium", "Hard"]
    assert main(["imitate", "--out", str(tmp_path / "run"), *given]) == 2
    assert "give --levels or --river, not both: Easy Medium Hard and " in capsys.readouterr().err


def test_valleys_of_a_real_river_that_do_not_fit_are_refused_once_one_is_built(
    brook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    built, build = [], Reach.build
    monkeypatch.setattr(Reach, "build", lambda reach, seed: built.append(seed) or build(reach, seed))
    monkeypatch.setattr(imitate, "free_bytes", lambda: 1_000_000)
    with pytest.raises(ConfigError, match=r"^1,000 rivers of .* MB need .* GB"):
        imitation(tmp_path / "run", river=Reach(brook, width_m=9.0), world_seeds=range(1000)).run()
    assert built == [0]


def test_frames_of_a_sequence_that_do_not_fit_are_refused_before_the_teacher_flies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    check_teacher = imitate.check_teacher
    monkeypatch.setattr(imitate, "check_teacher", lambda *_: pytest.fail("the teacher flies"))
    # 10 environments, 4 steps each, in 4 channels, 6 times: as flown, and 2.5 for each of two drawn anew, half mirrored
    needed = 10 * 4 * 128 * 128 * 4 * 6
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: needed - 1)
    flown = imitation(tmp_path / "run", steps=8, num_envs=10, settings={"sequence": 4, "replay": 2.0})
    words = r"num_envs must be at most 9, not 10, with a sequence of 4 steps: their frames take 0.02 GB, and 0.02"
    with pytest.raises(TrainingError, match=words):
        flown.run()
    assert not (tmp_path / "run").exists()
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: needed // 10 - 1)
    with pytest.raises(TrainingError, match="num_envs = 10 and a sequence of 4 steps are both too large: their frames"):
        flown.run()
    monkeypatch.setattr(imitate, "check_teacher", check_teacher)
    few = {"steps": 8, "num_envs": 1}
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: 4 * 128 * 128 * 4 * 4 - 1)
    with pytest.raises(TrainingError, match="sequence must be at most 3 steps, not 4: their frames take"):
        imitation(tmp_path / "run", **few).run()
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: 4 * 128 * 128 * 4 * 4)
    imitation(tmp_path / "run", **few).run()
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: 0)
    assert imitation(tmp_path / "run", **few).run().already_finished


def test_no_river_is_built_for_the_folder_of_another_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    imitation(tmp_path / "run", steps=8).run()
    (tmp_path / "brook.geojson").write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0008, 48]]}')
    monkeypatch.setattr(Reach, "build", lambda *_: pytest.fail("the river is built"))
    with pytest.raises(TrainingError, match=r"belongs to another run: .*context\.river"):
        imitation(tmp_path / "run", steps=8, river=Reach(tmp_path / "brook.geojson", width_m=9.0)).run()


def test_what_a_gate_refuses_can_be_corrected_in_the_same_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: Any) -> None:
        raise TrainingError("the teacher fails")

    with monkeypatch.context() as strict, pytest.raises(TrainingError, match="the teacher fails"):
        strict.setattr(imitate, "check_teacher", refuse)
        imitation(tmp_path / "run").run()
    assert not (tmp_path / "run" / "config.yaml").exists()
    monkeypatch.setattr(imitate, "check_teacher", lambda *_: None)
    assert imitation(tmp_path / "run", steps=8, seed=3).run().steps == 8


def test_a_folder_that_cannot_be_written_is_refused_before_the_teacher_flies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def fly(*_: Any) -> None:
        pytest.fail("the teacher flew")

    monkeypatch.setattr(imitate, "check_teacher", fly)
    (tmp_path / "file").touch()
    with pytest.raises(TrainingError, match="file is not a folder"):
        imitation(tmp_path / "file" / "run").run()
    with RUN_FOLDER.locked(tmp_path / "held"), pytest.raises(TrainingError, match="another command is writing to"):
        imitation(tmp_path / "held").run()


def test_kinds_of_banks_are_known_by_their_version(tmp_path: Path):
    one, other = (imitation(tmp_path, levels=(name,)) for name in ("Easy", "Easy+meadow"))
    found = [
        each._identity(ImitationConfig(), each._rules(ImitationConfig()), [level_named(each.levels[0])], (1,))[
            "context"
        ]
        for each in (one, other)
    ]
    assert "banks_version" not in found[0] and found[1]["banks_version"] == versions.BANKS


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--levels", "Hard", "--river", "a.gpx"], "give --levels or --river, not both: Hard and a.gpx"),
        (["--width-m", "9"], "--width-m goes with --river"),
        (["--recordings", "flights", "--river", "a.gpx"], "--river does not go with --recordings"),
        (["--recordings", "flights", "--levels", "Easy", "Medium", "Hard"], "--levels does not go with --recordings"),
        (["--recordings", "flights", "--world-seeds", "1000:1064"], "--world-seeds does not go with --recordings"),
        (["--river", "none.gpx"], "none.gpx"),
    ],
)
def test_options_of_rivers_that_do_not_fit_are_refused(options: list[str], told: str, tmp_path: Path, capsys):
    assert main(["imitate", "--out", str(tmp_path / "run"), *options]) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()


def test_a_teacher_that_fails_stops_the_run_before_anything_is_learnt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def hover(env: RiverVectorEnv) -> np.ndarray:
        return np.ones((env.num_envs, 4), np.int64)

    def check(level: Level, seeds: Sequence[int], rules: EnvConfig, act: gate.Act) -> None:
        gate.check_teacher(level, seeds, rules, hover)

    monkeypatch.setattr(imitate, "check_teacher", check)
    with pytest.raises(TrainingError, match="the teacher fails its gate on Easy-1"):
        imitation(tmp_path / "run").run()
    assert not (tmp_path / "run" / "metrics.csv").exists()


@pytest.mark.parametrize("teacher", ["steady", "scripted"])
def test_the_chosen_teacher_is_flown_through_the_gate_and_learnt_from(
    teacher: Literal["steady", "scripted"], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    asked: list[tuple[str, str]] = []
    pilot_actions, worths = RiverVectorEnv.pilot_actions, flights.teacher_worths

    def flown(env: RiverVectorEnv, pilot: str = "scripted") -> np.ndarray:
        asked.append(("gate", pilot))
        return pilot_actions(env, pilot)

    def judged(env: RiverVectorEnv, named: Teacher) -> np.ndarray:
        monkeypatch.setattr(RiverVectorEnv, "pilot_actions", pilot_actions)
        asked.append(("lesson", named))
        return worths(env, named)

    monkeypatch.setattr(RiverVectorEnv, "pilot_actions", flown)
    monkeypatch.setattr(flights, "teacher_worths", judged)
    imitation(tmp_path / "run", steps=8, settings=SETTINGS | {"teacher": teacher}).run()
    assert set(asked) == {("gate", teacher), ("lesson", teacher)}


def test_numbers_of_numpy_make_the_same_run(tmp_path: Path):
    imitation(tmp_path / "run", steps=8).run()
    numbers = {name: np.int64(getattr(imitation(tmp_path), name)) for name in ("seed", "num_envs", "threads")}
    assert (
        imitation(tmp_path / "run", steps=np.int64(8), rivers_in_memory=np.int64(1), **numbers).run().already_finished
    )


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"steps": 0}, TrainingError, "steps must be at least 1, got 0"),
        ({"seed": 1.5}, TrainingError, "seed must be a whole number, got 1.5"),
        ({"rivers_in_memory": 0}, TrainingError, "rivers_in_memory must be at least 1, got 0"),
        ({"num_envs": 0}, TrainingError, "num_envs must be at least 1, got 0"),
        ({"threads": 0}, TrainingError, "threads must be at least 1, got 0"),
        (
            {"checkpoint_seconds": -1.0},
            TrainingError,
            "checkpoint_seconds must be a finite number of at least 0, got -1",
        ),
        ({"levels": ()}, TrainingError, "at least one, each once, not none"),
        ({"levels": ("easy", "Easy")}, TrainingError, "each once, not Easy, Easy"),
        ({"settings": {"sequense": 4}}, AlgorithmError, "sequense"),
        (
            {"settings": {"teacher": "forward"}},
            AlgorithmError,
            "teacher must be one of 'steady', 'scripted', got 'forward'",
        ),
        ({"levels": ("Medum",)}, ValueError, "Medum"),
        ({"world_seeds": "1:30", "rivers_in_memory": 2}, ConfigError, "in_memory must be at least 6"),
    ],
)
def test_wrong_arguments_are_refused_by_name(options: dict, error: type[Exception], message: str, tmp_path: Path):
    with pytest.raises(error, match=message):
        imitation(tmp_path / "run", **options).run()


def test_no_seeds_are_refused_before_the_folder_is_created(tmp_path: Path):
    with pytest.raises(TrainingError, match="world_seeds must be at least one seed, such as 1000:1064"):
        imitation(tmp_path / "run", world_seeds=()).run()
    assert not (tmp_path / "run").exists()


def test_too_few_rivers_in_memory_are_refused_before_the_folder_is_created(tmp_path: Path):
    with pytest.raises(ConfigError, match="in_memory must be at least 6 for 58 rivers and 2 environments, not 5"):
        imitation(tmp_path / "run", levels=("Easy", "Hard"), world_seeds="1:30", rivers_in_memory=5).run()
    assert not (tmp_path / "run").exists()


def test_a_folder_of_another_run_is_refused(tmp_path: Path):
    imitation(tmp_path / "run", steps=8).run()
    with pytest.raises(TrainingError, match="seed"):
        imitation(tmp_path / "run", steps=8, seed=1).run()


def stored(env: RiverVectorEnv) -> Sequences:
    """One sequence of two steps of each environment, at its current pose."""
    state, count = env.state, env.num_envs
    twice = {name: np.stack([np.array(getattr(state, name))] * 2) for name in ("pose", "time_s", "segment", "travel")}
    empty = np.zeros((2, count, 1), np.uint8)
    return Sequences(
        river=np.stack([env.rivers.state()["river"]] * 2),
        last=np.full((2, count, 4), -1, np.int8),
        fresh=np.zeros((2, count), bool),
        start=np.zeros((count, 0), np.float32),
        worths=empty,
        privileged=empty,
        maps=empty,
        **twice,
    )


def test_stored_sequences_are_drawn_as_they_were_seen():
    env = RiverVectorEnv(RiverList.of_levels([("Easy", (1,))]), 2, EnvConfig())
    seen, _ = env.reset(seed=0)
    again = redraw(env, stored(env), np.random.default_rng(0))
    assert again.shape == (2, 2, 128, 128, 4)
    assert np.array_equal(again[0], seen) and np.array_equal(again[1], seen)
    env.close()


def test_stored_sequences_are_drawn_under_new_looks():
    env = RiverVectorEnv(RiverList.of_levels([("Easy", (1,))]), 2, EnvConfig(randomisation=Randomisation(suns=0)))
    seen, _ = env.reset(seed=0)
    again = redraw(env, stored(env), np.random.default_rng(0))
    assert not np.array_equal(again[0], seen)
    assert np.array_equal(again[0], again[1])  # the look stays within an episode
    env.close()


def test_only_environments_of_images_that_change_river_draw_any_views(easy_world: World):
    rivers = RiverList([easy_world])
    env = RiverVectorEnv(rivers, 1, EnvConfig(observation="none"))
    env.reset(seed=0)
    with pytest.raises(ConfigError, match="images, rgb\\+mask, rgb, mask, not 'none'"):
        env.draw(np.zeros(1, int), env.frames.views(env.state))
    fixed = RiverVectorEnv([easy_world], 1)
    fixed.reset(seed=0)
    with pytest.raises(ConfigError, match="needs rivers that change"):
        fixed.draw(np.zeros(1, int), fixed.frames.views(fixed.state))
    env.close()


def test_more_rivers_than_there_is_room_for_are_drawn_in_parts(easy_world: World):
    """Seven suns over the same valley, of which two are in memory besides the environment's own."""
    worlds = [replace(easy_world, seed=index, sun_azimuth=0.5 * index) for index in range(7)]
    env = RiverVectorEnv(RiverList(worlds, in_memory=4), 1, render_mode="rgb_array")
    _, info = env.reset(seed=0)
    pose = np.repeat(info["pose"], 7, axis=0)
    views = env.frames.views(env.state).rows(np.zeros(7, int))
    shown = np.array(env.render())
    found = env.draw(np.arange(7)[::-1].copy(), views)
    expected = Renderer(worlds).render(pose, np.arange(7)[::-1].copy(), views.time_s)
    assert np.array_equal(found, expected)
    assert env.rivers.pool.slots == 3  # pyright: ignore[reportAttributeAccessIssue]
    assert np.array_equal(np.array(env.render()), shown)
    for _ in range(3):
        env.step(env.pilot_actions())
    env.close()
