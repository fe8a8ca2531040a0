"""Tests of the words for moves against the moves themselves."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from thalweg.env import ActionError, EnvConfig, RiverVectorEnv
from thalweg.env.spaces import BRANCHES, batch_of_one, moves_in_words, to_unit_actions
from thalweg.world import World

MOVES = {
    "none": (0.0, 0.0, 0.0, 0.0),
    "up": (0.0, 0.0, 1.0, 0.0),
    "down": (0.0, 0.0, -1.0, 0.0),
    "turn left": (0.0, 0.0, 0.0, 10.0),
    "turn right": (0.0, 0.0, 0.0, -10.0),
    "forward": (1.0, 0.0, 0.0, 0.0),
    "backward": (-1.0, 0.0, 0.0, 0.0),
    "fast forward": (2.0, 0.0, 0.0, 0.0),
    "left": (0.0, 0.5, 0.0, 0.0),
    "right": (0.0, -0.5, 0.0, 0.0),
}
"""Metres forward, left and up, and degrees to the left, of each word."""


def test_rows_of_different_lengths_are_refused_as_actions():
    with pytest.raises(ActionError, match=r"actions are no array.*needed: \[2, 4\]"):
        to_unit_actions("multidiscrete", [[0, 0, 0, 0], [0, 0, 0]], 2)


@pytest.mark.parametrize("tensor", [torch.zeros(4, requires_grad=True), torch.zeros(4, dtype=torch.bfloat16)])
@pytest.mark.parametrize(
    "read", [batch_of_one, lambda given: to_unit_actions("continuous", given[None], 1)], ids=["one", "many"]
)
def test_tensors_that_numpy_cannot_read_are_refused_as_actions(read: Callable, tensor: torch.Tensor):
    with pytest.raises(ActionError, match=r"no array, .*(requires grad|BFloat16)"):
        read(tensor)


@pytest.mark.parametrize(("kind", "dtype"), [("multidiscrete", np.int64), ("continuous", np.float64)])
def test_actions_in_any_layout_become_the_layout_that_kernels_are_compiled_for(kind: str, dtype: type):
    rows = np.array([[0, 1, 1, 0], [1, 0, 0, 1], [1, 1, 0, 0]], dtype)
    for given in (np.asfortranarray(rows), rows.T.copy().T, np.tile(rows, 2)[:, ::2], rows[::-1][::-1]):
        units = to_unit_actions(kind, given, 3)
        assert units.flags.c_contiguous and units.dtype == np.float64
    assert to_unit_actions(kind, np.asfortranarray(rows), 3).tolist() == to_unit_actions(kind, rows, 3).tolist()


@pytest.mark.parametrize("kind", ["multidiscrete", "continuous"])
@pytest.mark.parametrize("options", [{}, {"allow_backward": True}, {"task": "RacingLine"}, {"vehicle": "asv"}], ids=str)
def test_each_option_moves_as_its_word_says(kind: str, options: dict, easy_world: World):
    config = EnvConfig(observation="none", action=kind, **options)  # pyright: ignore[reportArgumentType]
    chosen = {name: value for name, value in options.items() if name != "task"}
    words = moves_in_words(kind, fast_step="task" in options, **chosen)
    assert tuple(words) == BRANCHES
    rest, ends = ([1] * 4, (0, 1, 2)) if kind == "multidiscrete" else ([0.0] * 4, (1.0, 0.0, -1.0))
    for branch, names in enumerate(words.values()):
        for name, value in zip(names, ends, strict=True):
            env = RiverVectorEnv([easy_world], 1, config)
            _, info = env.reset(seed=1)
            action = np.array([rest])
            action[0, branch] = value
            before, after = info["pose"][0], env.step(action)[4]["pose"][0]
            (x, y, z), turn = after[:3] - before[:3], math.remainder(after[3] - before[3], 2 * math.pi)
            cos, sin = math.cos(after[3]), math.sin(after[3])
            ahead, left, up, degrees = MOVES[name]
            found = x * cos + y * sin, y * cos - x * sin, math.degrees(turn)
            np.testing.assert_allclose(found, (ahead, left, degrees), atol=1e-9, err_msg=f"{name} of {options}")
            assert z == pytest.approx(up, abs=0.05 if "vehicle" in options else 1e-9)  # a boat's water has a slope
