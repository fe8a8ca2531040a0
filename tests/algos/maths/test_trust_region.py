"""Steps within a trust region, held against a general solver that knows nothing of duals."""

import math

import numpy as np
import pytest
import torch
from scipy.optimize import minimize

from thalweg.algos.maths.trust_region import conjugate_gradient, cpo_step, natural_step

RADIUS = 0.05


def positive(generator: np.random.Generator, size: int = 4) -> np.ndarray:
    """A positive definite matrix."""
    root = generator.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def test_as_many_iterations_as_numbers_solve_the_system():
    generator = np.random.default_rng(0)
    matrix, right = torch.from_numpy(positive(generator, 6)), torch.from_numpy(generator.normal(size=6))
    found = conjugate_gradient(lambda v: matrix @ v, right, 6, 0.0)
    assert found.numpy() == pytest.approx(torch.linalg.solve(matrix, right).numpy(), rel=1e-8)


def test_a_zero_gradient_needs_no_step():
    assert conjugate_gradient(lambda v: 2 * v, torch.zeros(3), 5).tolist() == [0.0, 0.0, 0.0]


def test_a_natural_step_reaches_the_edge_of_the_trust_region():
    generator = np.random.default_rng(1)
    matrix, gradient = positive(generator), generator.normal(size=4)
    along = np.linalg.solve(matrix, gradient)
    step = natural_step(float(gradient @ along), RADIUS) * along
    assert 0.5 * step @ matrix @ step == pytest.approx(RADIUS)


def programmes(count: int):
    """Random programmes: H, g, b, c."""
    generator = np.random.default_rng(2)
    for _ in range(count):
        spread = generator.choice([0.05, 0.3, 1.0])
        yield positive(generator), generator.normal(size=4), generator.normal(size=4), spread * generator.normal()


def solved(matrix: np.ndarray, g: np.ndarray, b: np.ndarray, c: float) -> float:
    """g'x of the best x with b'x + c ≤ 0 and ½ x'Hx ≤ δ, by sequential quadratic programming from a feasible point."""
    away = np.linalg.solve(matrix, b)
    limits = [
        {"type": "ineq", "fun": lambda x: -(b @ x + c), "jac": lambda x: -b},
        {"type": "ineq", "fun": lambda x: RADIUS - 0.5 * x @ matrix @ x, "jac": lambda x: -matrix @ x},
    ]
    start = -max(c, 0.0) * away / (b @ away)
    options = {"maxiter": 500, "ftol": 1e-12}
    found = minimize(lambda x: -g @ x, start, jac=lambda x: -g, constraints=limits, method="SLSQP", options=options)
    return -found.fun


def test_the_closed_form_solves_its_quadratic_programme():
    kinds = {"binding": 0, "free": 0, "infeasible": 0}
    for matrix, g, b, c in programmes(200):
        along_g, along_b = np.linalg.solve(matrix, g), np.linalg.solve(matrix, b)
        direction = cpo_step(float(g @ along_g), float(g @ along_b), float(b @ along_b), c, RADIUS)
        assert direction.feasible == (c <= 0 or c * c <= 2 * RADIUS * (b @ along_b))
        step = direction.along_reward * along_g + direction.along_cost * along_b
        assert 0.5 * step @ matrix @ step <= RADIUS * (1 + 1e-9)
        if direction.feasible:
            kinds["binding" if direction.along_cost else "free"] += 1
            assert b @ step + c <= 1e-7
            assert g @ step == pytest.approx(solved(matrix, g, b, c), rel=1e-6, abs=1e-6)
        else:
            kinds["infeasible"] += 1
            lowest = -math.sqrt(2 * RADIUS * (b @ along_b))  # of b'x over the trust region, by Cauchy and Schwarz
            assert b @ step == pytest.approx(lowest)
    assert min(kinds.values()) > 20, kinds


def test_a_cost_that_no_step_changes_leaves_the_natural_step():
    direction = cpo_step(2.0, 0.0, 0.0, 0.5, RADIUS)
    assert (direction.along_reward, direction.along_cost, direction.feasible) == (natural_step(2.0, RADIUS), 0.0, True)


@pytest.mark.parametrize("r", [-0.5, 0.5])
def test_exactly_at_the_limit_only_a_step_that_would_break_it_is_bent(r: float):
    direction = cpo_step(1.0, r, 1.0, 0.0, RADIUS)
    assert (direction.along_cost < 0) == (r > 0)
    assert direction.along_reward * r + direction.along_cost <= 1e-12
