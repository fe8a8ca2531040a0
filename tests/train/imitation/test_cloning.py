"""Tests of behaviour cloning: what is drawn of recordings, that it is learnt, and what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from tests.datasets import episodes
from tests.image_policies import image_policy
from tests.train.imitation.test_imitate import rows
from thalweg.algos.imitation.student import Student
from thalweg.algos.policy.vision import NO_OPTION
from thalweg.cli.main import main
from thalweg.core import versions
from thalweg.datasets.episode import About, RecordedEpisode
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.recordings import add_flight, recording
from thalweg.env.moves import MOVE_OPTIONS, MOVES
from thalweg.train import load_policy
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import read_config
from thalweg.train.imitation import frame_memory
from thalweg.train.imitation.cloning import Cloning, CloningTrainer
from thalweg.train.imitation.recorded_flights import RecordedFlights

CAMERA = {"height_px": 128, "width_px": 128, "fov_deg": 60.0, "pitch_deg": 20.0}
ABOUT = replace(episodes.ABOUT, camera=CAMERA, versions={"RENDER": versions.RENDER}, layers=("mask",))
SMALL = {"filters": [4, 8], "features": 16, "memory_size": 0, "hidden": [16], "sequence": 4, "mirrored": 0.0}


def flight(steps: int, seed: int = 0, **changes: Any) -> RecordedEpisode:
    """A flight in which the brightness of a frame tells whether to turn left or right."""
    made = episodes.flight(steps, seed)
    options = np.ones((steps, 4), np.int64)
    options[:, 1] = np.where(np.random.default_rng(seed).random(steps) < 0.5, 0, 2)
    rgb = np.full((steps + 1, 128, 128, 3), 60, np.uint8)
    rgb[:-1][options[:, 1] == 0] = 200
    mask = np.zeros((steps + 1, 128, 128), np.uint8)
    return replace(made, rgb=rgb, mask=mask, depth_m=None, class_id=None, options=options, **changes)


def recorded(folder: Path, *flights: RecordedEpisode, about: About = ABOUT) -> Path:
    with recording(folder, "lerobot", about) as writer:
        for each in flights:
            add_flight(writer, each)
    return folder


def description_of(folder: Path) -> dict[str, Any]:
    return read_config(folder) or {}


def test_sequences_are_the_recorded_steps_with_the_action_before_each(tmp_path: Path):
    first, second = flight(5), flight(4, seed=1)
    stream = RecordedFlights([recorded(tmp_path / "a", first, second)], "rgb+mask")
    assert stream.count == 2 and stream.first.tolist() == [True] + 4 * [False] + [True] + 3 * [False]
    images, sequences = stream.draw(9, 1, np.random.default_rng(0))
    assert first.options is not None and second.options is not None
    np.testing.assert_array_equal(images[:, 0, ..., :3], np.concatenate([first.rgb[:5], second.rgb[:4]]))
    wanted = np.concatenate([first.options, second.options])
    best = sequences.worths[:, 0].argmax(axis=1)
    np.testing.assert_array_equal(MOVE_OPTIONS[best], wanted)
    last = sequences.last[:, 0]
    assert (last[[0, 5]] == NO_OPTION).all()
    np.testing.assert_array_equal(last[1:5], wanted[0:4])
    assert sequences.worths.shape == (9, 1, len(MOVES))


def test_what_was_flown_is_learnt(tmp_path: Path):
    folder = recorded(tmp_path / "flights", flight(40), flight(30, seed=1))

    settings = {**SMALL, "learning_rate": 3e-3}
    Cloning(tmp_path / "run", [folder], steps=6000, sequences=16, settings=settings, threads=1).run()
    policy: Any = load_policy(tmp_path / "run")
    shown = flight(20, seed=7)
    assert shown.options is not None and shown.mask is not None
    player = policy.player(1, deterministic=True)
    found = [
        player(np.concatenate([rgb, mask[..., None]], axis=-1)[None], np.array([step == 0]))[0]
        for step, (rgb, mask) in enumerate(zip(shown.rgb[:-1], shown.mask[:-1], strict=True))
    ]
    np.testing.assert_array_equal(found, shown.options)
    assert policy.about.algorithm == "BC" and policy.about.context["recorded_steps"] == 70


def test_the_learning_rate_falls_to_its_least_at_the_end_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder, learn, rates = recorded(tmp_path / "flights", flight(9)), Student.learn, []
    monkeypatch.setattr(Student, "learn", lambda own, lesson: rates.append(own.optimiser.rate) or learn(own, lesson))
    settings = SMALL | {"learning_rate": 0.01}
    Cloning(tmp_path / "run", [folder], steps=32, sequences=2, settings=settings, threads=1).run()
    assert rates == pytest.approx([0.01 * (1.0 - 0.95 * share) for share in (0.25, 0.5, 0.75, 1.0)])


def test_a_student_begins_with_the_policy_of_another_run(tmp_path: Path):
    folder = recorded(tmp_path / "flights", flight(9))
    given: dict[str, Any] = {"steps": 16, "sequences": 2, "threads": 1}
    first = Cloning(tmp_path / "first", (folder,), settings=SMALL, **given).run().policy
    still = {"settings": SMALL | {"learning_rate": 1e-9}, "seed": 1, **given}
    second = Cloning(tmp_path / "second", (folder,), begin_with=tmp_path / "first", **still).run().policy
    for mine, others in zip(second.actor.parameters(), first.actor.parameters(), strict=True):
        torch.testing.assert_close(mine, others, rtol=0.0, atol=1e-6)
    assert description_of(tmp_path / "second")["run"]["begin_with"]["algorithm"] == "BC"


def test_a_student_does_not_begin_with_a_policy_that_has_fast_steps(tmp_path: Path):
    image_policy(env={"task": "RacingLine"}).save(tmp_path / "racing.safetensors")
    folder = recorded(tmp_path / "flights", flight(9))
    with pytest.raises(TrainingError, match="trained on RacingLine, which has fast steps, and River has none"):
        Cloning(tmp_path / "student", (folder,), 16, begin_with=tmp_path / "racing.safetensors", settings=SMALL).run()
    assert not (tmp_path / "student").exists()


def test_an_interrupted_run_resumes_to_the_same_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    folder = recorded(tmp_path / "flights", flight(20), flight(12, seed=1))
    settings = ["filters=[4]", "features=8", "memory_size=8", "hidden=[8]", "sequence=4", "corrupted_masks=0.5"]
    given = ["--recordings", str(folder), "--steps", "96", "--num-envs", "4", "--threads", "1", "--set", *settings]

    def clone(name: str) -> int:
        return main(["imitate", *given, "--out", str(tmp_path / name)])

    assert clone("whole") == 0
    update = CloningTrainer.update

    def interrupted(trainer: CloningTrainer) -> dict[str, float]:
        if trainer.updates == 3:
            raise KeyboardInterrupt
        return update(trainer)

    monkeypatch.setattr(CloningTrainer, "update", interrupted)
    assert clone("parts") == 130
    assert "resumes from step 16" in capsys.readouterr().err  # after the first of three updates; one a minute is kept
    monkeypatch.setattr(CloningTrainer, "update", update)
    assert clone("parts") == 0
    assert "parts resumes from step 16 of 96.\n" in capsys.readouterr().err
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole") and len(rows(tmp_path / "whole")) == 6
    flat = [load_policy(tmp_path / name).actor.stack.flat for name in ("whole", "parts")]
    assert torch.equal(*flat)


def test_a_run_is_known_by_the_content_of_its_recordings_and_not_by_the_names_of_their_folders(tmp_path: Path):
    folder = recorded(tmp_path / "flights", flight(20))
    began = Cloning(tmp_path / "run", [folder], steps=16, sequences=4, settings=SMALL, threads=1)
    began.run()
    moved = replace(began, recordings=[folder.rename(tmp_path / "elsewhere")])
    assert moved.run().already_finished
    assert description_of(tmp_path / "run")["run"]["context"]["recordings"] == ["flights"]
    other = replace(began, recordings=[recorded(tmp_path / "flights", flight(20, seed=1))])
    with pytest.raises(TrainingError, match="recorded_digest"):
        other.run()


def test_a_run_on_a_gpu_is_recorded_and_resumed_there_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    class Reached(Exception):
        """The student would learn."""

    folder = recorded(tmp_path / "flights", flight(20))
    on_cpu = Cloning(tmp_path / "cpu", [folder], steps=16, sequences=4, settings=SMALL, threads=1)
    on_cpu.run()
    assert "device" not in description_of(tmp_path / "cpu")["run"]
    monkeypatch.setattr(
        "thalweg.train.imitation.cloning.resolve_device", lambda name: f"{name}:1" if name == "cuda" else name
    )
    monkeypatch.setattr("thalweg.train.folder.run_record.gpu_info", lambda device: {"gpu": f"Card {device}"})
    monkeypatch.setattr("thalweg.train.imitation.cloning.Student", Mock())
    monkeypatch.setattr("thalweg.train.imitation.cloning.CloningTrainer", Mock(side_effect=Reached))
    with pytest.raises(TrainingError, match="device"):
        replace(on_cpu, device="cuda").run()
    on_gpu = replace(on_cpu, folder=tmp_path / "gpu", device="cuda")
    with pytest.raises(Reached):
        on_gpu.run()
    description = description_of(tmp_path / "gpu")
    assert (description["device"], description["run"]["device"]) == ("cuda", "cuda")
    assert description["machine"]["gpu"] == "Card cuda:1"
    with pytest.raises(TrainingError, match="device"):
        replace(on_gpu, device="cpu").run()


@pytest.mark.parametrize(
    ("about", "changes", "error"),
    [
        ({"camera": {**CAMERA, "fov_deg": 80.0}}, {}, "fov_deg 80.0; students see fov_deg 60.0"),
        ({"camera": {**CAMERA, "lens": {"model": "plumb_bob"}}}, {}, "recorded through a lens, {'model': 'plumb_bob'}"),
        ({"versions": {"RENDER": 1}}, {}, "has frames of version 1"),
        ({"layers": ()}, {"mask": None}, "has no water masks"),
        ({}, {"options": None}, "has continuous actions"),
        ({}, {"options_of_flight": {"vehicle": "asv"}}, "flights of the vehicle asv"),
        (
            {},
            {"options_of_flight": {"level": "Medium+meadow", "world_seed": 100_000}},
            "odd: world_seed: rivers from seed",
        ),
        ({}, {"task": "Swimmers"}, "the task Swimmers with fast steps"),
    ],
)
def test_recordings_that_do_not_fit_are_refused_by_name(
    about: dict[str, Any], changes: dict[str, Any], error: str, tmp_path: Path
):
    folder = recorded(tmp_path / "odd", replace(flight(5), **changes), about=replace(ABOUT, **about))
    with pytest.raises(TrainingError, match="odd") as raised:
        Cloning(tmp_path / "run", [folder], steps=10, settings=SMALL).run()
    assert error in str(raised.value)
    assert not (tmp_path / "run").exists()


def test_too_few_steps_and_predictions_are_refused(tmp_path: Path):
    folder = recorded(tmp_path / "short", flight(3))
    with pytest.raises(
        TrainingError, match="have 3 steps, fewer than the 4 of one sequence: record more, or set sequence=3"
    ):
        Cloning(tmp_path / "run", [folder], steps=10, settings=SMALL).run()
    with pytest.raises(TrainingError, match="auxiliary_weight must be 0"):
        Cloning(tmp_path / "run", [folder], steps=10, settings={"auxiliary_weight": 0.3}).run()
    with pytest.raises(DatasetError, match="holds no data set"):
        Cloning(tmp_path / "run", [tmp_path], steps=10).run()


def test_numbers_of_numpy_make_the_same_run(tmp_path: Path):
    folder = recorded(tmp_path / "recording", flight(16))
    whole = Cloning(tmp_path / "run", [folder], steps=16, sequences=4, settings=SMALL, threads=1)
    whole.run()
    numbers = {name: np.int64(getattr(whole, name)) for name in ("steps", "sequences", "threads", "seed")}
    assert replace(whole, **numbers).run().already_finished
    for number, words in ((0, "at least 1, got 0"), (10**6 + 1, "at most 1000000, got 1000001")):
        with pytest.raises(TrainingError, match=f"sequences must be {words}"):
            replace(whole, sequences=number).run()


def test_the_command_names_its_own_option_where_the_number_of_sequences_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    folder = recorded(tmp_path / "recording", flight(16))
    options = ["--recordings", str(folder), "--steps", "16", "--num-envs", "0", "--out", str(tmp_path / "run")]
    assert main(["imitate", *options]) == 2
    assert "--num-envs must be at least 1" in capsys.readouterr().err


def test_a_time_between_checkpoints_that_is_none_is_refused_before_the_folder_is_created(tmp_path: Path):
    wrong = Cloning(tmp_path / "run", (tmp_path,), steps=16, checkpoint_seconds=float("nan"))
    with pytest.raises(TrainingError, match="checkpoint_seconds must be a finite number of at least 0, got nan"):
        wrong.run()
    assert not (tmp_path / "run").exists()


def test_the_command_refuses_options_of_flights(tmp_path: Path, capsys: pytest.CaptureFixture):
    options = ["--recordings", str(tmp_path), "--out", str(tmp_path / "run")]
    assert main(["imitate", *options, "--levels", "Easy"]) == 2
    assert "--levels does not go with --recordings, where nothing is flown" in capsys.readouterr().err


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_share_of_what_is_drawn_is_mirrored_and_has_corrupted_masks(
    share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    learn, lessons = CloningTrainer.learn, []
    monkeypatch.setattr(CloningTrainer, "learn", lambda own, lesson: lessons.append(lesson) or learn(own, lesson))
    settings = SMALL | {"mirrored": share, "corrupted_masks": share}
    folder = recorded(tmp_path / "a", flight(20))
    Cloning(tmp_path / "run", [folder], 32, sequences=8, settings=settings, threads=1).run()
    (lesson,) = lessons
    pixels = lesson.rows[..., :-4].reshape(4, 8, 128, 128, 4).numpy()
    turns = MOVE_OPTIONS[lesson.worths.argmax(-1).numpy()][..., 1]
    assert np.array_equal(pixels[..., 0, 0, 0] == 200, turns == (2 if share else 0))  # bright frames turn left
    assert pixels[..., 3].any() == (share > 0)  # there is no water


def test_backward_is_learnt_as_no_step_along(tmp_path: Path):
    options = np.ones((4, 4), np.int64)
    options[:, 2] = [0, 2, 1, 2]
    stream = RecordedFlights([recorded(tmp_path / "a", replace(flight(4), options=options))], "rgb+mask")
    _, found = stream.draw(4, 1, np.random.default_rng(0))
    assert MOVE_OPTIONS[found.worths[:, 0].argmax(axis=1)][:, 2].tolist() == [0, 1, 1, 1]
    assert found.last[1:, 0, 2].tolist() == [0, 1, 1]


def test_sequences_that_do_not_fit_are_refused_by_the_name_of_the_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    folder = recorded(tmp_path / "flights", flight(20))
    # 4 steps in 4 channels, 2.5 times each: as read, as rows, and half of them mirrored
    each = 4 * 128 * 128 * 4 * 5 // 2
    given = ["--steps", "32", "--threads", "1", "--set", "filters=[4]", "features=8", "hidden=[8]", "sequence=4"]
    command = ["imitate", "--recordings", str(folder), "--out", str(tmp_path / "run"), *given, "--num-envs", "8"]
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: 8 * each - 1)
    assert main(command) == 2
    assert "thalweg: --num-envs must be at most 7, not 8, with a sequence of 4 steps" in capsys.readouterr().err
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: 8 * each)
    assert main(command) == 0
    monkeypatch.setattr(frame_memory, "free_bytes", lambda: 0)
    assert main(command) == 0  # it is finished
