"""Tests of the filters of gusts against matrix exponentials, and of their statistics against closed forms."""

import numpy as np
import pytest
import scipy

from thalweg.core.compute.jit import kernel
from thalweg.env.physics.gusts import chain_output, first_chain, step_chain, step_single

CHAIN = np.array([[-1.0, 0.0], [1.0, -1.0]])
"""The chain of two lags, in units of its time constant; the noise acts on the first."""


@kernel(fastmath=False)
def _series(h, noise, single, double):
    """Fill gusts [T] of both filters from noise [T, 3] at steps of h time constants."""
    x = noise[0, 0]
    x1, x2 = first_chain(noise[0, 1], noise[0, 2])
    for k in range(len(noise)):
        if k > 0:
            x = step_single(x, h, noise[k, 0])
            x1, x2 = step_chain(x1, x2, h, noise[k, 1], noise[k, 2])
        single[k] = x
        double[k] = chain_output(x1, x2)


def series(h: float, steps: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Gusts [T] of the longitudinal and the lateral filter."""
    single, double = np.empty(steps), np.empty(steps)
    _series(h, np.random.default_rng(seed).standard_normal((steps, 3)), single, double)
    return single, double


def correlation(x: np.ndarray, lag: int) -> float:
    """Mean product of a series of unit variance with itself, `lag` steps apart."""
    return float(np.mean(x[lag:] * x[: len(x) - lag]))


@pytest.mark.parametrize("h", [1e-3, 0.05, 0.7, 4.0])
def test_a_step_of_the_chain_is_the_exact_one(h: float):
    # Van Loan, "Computing integrals involving the matrix exponential", 1978.
    noise = np.array([[2.0, 0.0], [0.0, 0.0]])
    block = scipy.linalg.expm(h * np.block([[-CHAIN, noise], [np.zeros((2, 2)), CHAIN.T]]))
    transition = block[2:, 2:].T
    covariance = transition @ block[:2, 2:]
    moved = np.array([step_chain(*start, h, 0.0, 0.0) for start in np.eye(2)]).T
    np.testing.assert_allclose(moved, transition, atol=1e-14)
    factor = np.array([step_chain(0.0, 0.0, h, *each) for each in np.eye(2)]).T
    np.testing.assert_allclose(factor @ factor.T, covariance, atol=1e-12)


def test_the_first_gust_is_drawn_from_the_stationary_distribution():
    stationary = scipy.linalg.solve_continuous_lyapunov(CHAIN, -np.diag([2.0, 0.0]))
    factor = np.array([first_chain(*each) for each in np.eye(2)]).T
    np.testing.assert_allclose(factor @ factor.T, stationary, atol=1e-15)
    output = np.array([chain_output(*each) for each in np.eye(2)])
    assert output @ stationary @ output == pytest.approx(1.0)


def test_gusts_have_the_variance_and_autocorrelation_of_the_model():
    h, steps = 0.1, 400_000
    single, double = series(h, steps)
    for lag in (0, 1, 5, 10, 20, 40):
        t = lag * h
        # The estimate's standard error is about sqrt(2 T / (steps h)) = 0.007.
        assert correlation(single, lag) == pytest.approx(np.exp(-t), abs=0.03)
        assert correlation(double, lag) == pytest.approx((1 - t / 2) * np.exp(-t), abs=0.03)


def test_gusts_have_the_spectrum_of_the_model():
    h = 0.1
    for x, form in zip(
        series(h, 400_000, seed=1),
        (lambda w: 1 / (1 + w * w), lambda w: (1 + 3 * w * w) / (1 + w * w) ** 2 / 2),
        strict=True,
    ):
        frequency, power = scipy.signal.welch(x, fs=1 / h, nperseg=4096)
        for low, high in ((0.05, 0.2), (0.5, 1.0), (2.0, 3.0)):  # radians per time constant
            band = (2 * np.pi * frequency > low) & (2 * np.pi * frequency < high)
            # One-sided per hertz: four times the two-sided one per radian, whose integral is the variance times pi.
            wanted = np.mean([4 * form(2 * np.pi * f) for f in frequency[band]])
            assert power[band].mean() == pytest.approx(wanted, rel=0.08)


def test_no_time_changes_nothing():
    assert step_single(0.3, 0.0, 5.0) == 0.3
    assert step_chain(0.3, -0.7, 0.0, 5.0, 5.0) == (0.3, -0.7)
