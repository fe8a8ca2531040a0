"""Tests of fast exp, log2 and floor, against their stated errors."""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels import fast_math


@kernel
def tabulate(xs, exps, logs):
    for i in range(len(xs)):
        exps[i] = fast_math.exp(np.float32(math.log(xs[i])))
        logs[i] = fast_math.log2(xs[i])


def test_exp_and_log_are_within_their_stated_errors():
    xs = np.geomspace(1e-20, 1e20, 20001).astype(np.float32)
    exps, logs = np.empty_like(xs), np.empty_like(xs)
    tabulate(xs, exps, logs)
    assert np.abs(logs - np.log2(xs.astype(float))).max() < 0.009
    exact = np.exp(np.log(xs.astype(np.float64)).astype(np.float32).astype(np.float64))
    # The argument itself is rounded to float32, which near 46 is worth 2e-6 of the result.
    assert np.abs(exps / exact - 1).max() < 2e-4


@kernel
def round_down(xs, floors):
    for i in range(len(xs)):
        floors[i] = fast_math.floor(xs[i])


def test_floor_is_exact_below_zero_and_on_whole_numbers_too():
    xs = np.concatenate([np.arange(-5, 6), np.linspace(-1e6, 1e6, 4001), [-1e-7, 1e-7, -2.0000002]]).astype(np.float32)
    floors = np.empty_like(xs)
    round_down(xs, floors)
    np.testing.assert_array_equal(floors, np.floor(xs))
