"""Tests of the flights of an imitation: who acts, what is noted, and how stored steps are drawn again."""

from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from thalweg.algos.common.state import CPU
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.policy.vision import NO_OPTION
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.train.imitation import flights
from thalweg.train.imitation.flights import Flights, redraw
from thalweg.train.imitation.sequences import Sequences

N = 400
TAUGHT = 7
"""The move that the teacher values most."""
OWN = np.array([9, 8, 7, 6])
"""What the student does, which is no move, so that nobody else does it."""


class Student:
    """A player that always does the same, and keeps what it saw."""

    hidden = None

    def __init__(self, *_: Any) -> None:
        self.seen: list[tuple[np.ndarray, np.ndarray]] = []

    def raw(self, rows: torch.Tensor, fresh: torch.Tensor) -> torch.Tensor:
        self.seen.append((rows.numpy().copy(), fresh.numpy().copy()))
        return torch.from_numpy(np.tile(OWN, (len(rows), 1)))


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> Flights:
    """Flights of `N` environments that show one grey pixel."""
    worths = np.zeros((N, len(MOVE_OPTIONS)))
    worths[:, TAUGHT] = 1.0
    monkeypatch.setattr(flights, "NetworkPlayer", Student)
    monkeypatch.setattr(flights, "teacher_worths", lambda *_: worths)
    monkeypatch.setattr(flights, "open_water", lambda *_: np.zeros((N, 8), bool))
    state = {"pose": np.zeros((N, 4)), "time_s": np.zeros(N), "segment": np.zeros(N), "travel": np.zeros(N)}
    env: Any = SimpleNamespace(
        num_envs=N,
        courses=None,
        state=SimpleNamespace(**state),
        rivers=SimpleNamespace(state=lambda: {"river": np.zeros(N)}),
        ideal_eye=lambda: np.zeros((N, 2)),
    )
    student: Any = SimpleNamespace(config=ImitationConfig(sequence=4), policy=None, generator=None, device=CPU)
    made = Flights(env, student, 0)
    made.images = np.full((N, 1, 1, 1), 100, np.uint8)
    return made


def share_of(actions: np.ndarray, options: np.ndarray) -> float:
    """Share of the environments in which these options were taken."""
    return float((actions == options).all(axis=1).mean())


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_teacher_flies_its_share_of_the_episodes_and_the_student_the_others(flown: Flights, share: float):
    actions = flown.act(share, 0.0)
    taught = share_of(actions, MOVE_OPTIONS[TAUGHT])
    assert taught == pytest.approx(share, abs=0.08 * (0 < share < 1))
    assert share_of(actions, OWN) == 1.0 - taught


def test_who_flies_changes_with_episodes_alone(flown: Flights):
    flown.act(1.0, 0.0)
    fresh = np.arange(N) < N // 2
    flown.arrive(flown.images, fresh)
    actions = flown.act(0.0, 0.0)
    assert share_of(actions[fresh], OWN) == share_of(actions[~fresh], MOVE_OPTIONS[TAUGHT]) == 1.0


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_random_moves_are_their_share_of_all_and_of_every_kind(flown: Flights, share: float):
    taken = MOVE_OPTIONS[TAUGHT] if share else OWN
    some = flown.act(share, 0.25)
    assert share_of(some, taken) == pytest.approx(0.75 + share * 0.25 / len(MOVE_OPTIONS), abs=0.08)
    every = flown.act(share, 1.0)
    counts = (every[:, None] == MOVE_OPTIONS).all(axis=2).sum(axis=0)
    assert counts.sum() == N and (counts > 0).mean() > 0.9 and counts.max() < N / 8


def test_the_student_sees_what_was_done_before_and_nothing_before_an_episode(flown: Flights):
    flown.act(1.0, 0.0)
    flown.arrive(flown.images + np.uint8(1), np.arange(N) % 2 == 0)
    flown.act(1.0, 0.0)
    (before, begun), (after, fresh) = flown._player.seen  # pyright: ignore[reportAttributeAccessIssue]
    assert begun.all() and fresh.tolist() == [True, False] * (N // 2)
    assert before.tolist() == [[100, 0, 0, 0, 0]] * N  # rows hold options and 1
    done = [101, *(MOVE_OPTIONS[TAUGHT] + 1)]
    assert after.tolist() == [[101, 0, 0, 0, 0], done] * (N // 2)
    noted = flown.sequences()
    assert noted.last[1].tolist() == [[NO_OPTION] * 4, MOVE_OPTIONS[TAUGHT].tolist()] * (N // 2)
    assert np.array_equal(noted.fresh, [begun, fresh])


def test_stored_sequences_are_mirrored_and_corrupted_by_the_shares_of_the_settings(
    flown: Flights, monkeypatch: pytest.MonkeyPatch
):
    given: list[Any] = []
    monkeypatch.setattr(flights, "redraw", lambda *_: "images")
    monkeypatch.setattr(flights, "rows_of", lambda images, _: images)
    monkeypatch.setattr(flights, "lesson_of", lambda _, rows: rows)
    monkeypatch.setattr(flights, "mirror", lambda images, _, share, __: given.append((images, share)))
    monkeypatch.setattr(flights, "corrupt", lambda images, seen, share, _: given.append((images, seen, share)))
    flown.env.config = SimpleNamespace(observation="mask")  # pyright: ignore[reportAttributeAccessIssue]
    flown.student.config = ImitationConfig(mirrored=0.25, corrupted_masks=0.75)
    sequences: Any = SimpleNamespace(last=None)
    assert flown.drawn_again(sequences) == "images"  # pyright: ignore[reportGeneralTypeIssues]
    assert given == [("images", 0.25), ("images", "mask", 0.75)]


def test_each_episode_of_each_stored_sequence_has_a_look_of_its_own():
    numbers = count(1)
    randomisation = SimpleNamespace(draw=lambda _: (lambda each: (np.array([each]), 10 * each))(next(numbers)))
    drawn: list[Any] = []
    env: Any = SimpleNamespace(
        frames=SimpleNamespace(randomisation=randomisation),
        draw=lambda _, views: drawn.append(views) or np.zeros((6, 1, 1, 1), np.uint8),
    )
    values = {name: np.zeros((3, 2)) for name in Sequences._fields} | {"pose": np.zeros((3, 2, 4))}
    fresh = np.array([[True, False], [False, False], [False, True]])
    redraw(env, Sequences(**values | {"fresh": fresh}), np.random.default_rng(0))
    ((_, _, _, looks, suns, *_),) = drawn
    first, second = looks.reshape(3, 2).T.tolist()
    assert first[0] == first[1] == first[2] and second[0] == second[1] != second[2]
    assert len({first[0], second[0], second[2]}) == 3
    assert np.array_equal(suns, 10 * looks[:, 0])
