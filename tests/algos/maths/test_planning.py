"""The formulas of planning by hand and by loops that leave nothing out."""

import pytest
import torch

from thalweg.algos.maths import planning

F64 = torch.float64


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, dtype=F64, generator=torch.Generator().manual_seed(seed))


def test_survival_by_hand():
    assert planning.survival(torch.tensor([0.5, 0.0, 0.2, 1.0])).tolist() == pytest.approx([1, 0.5, 0.5, 0.4, 0])


def test_an_imagined_return_is_that_of_a_loop_over_steps():
    rewards, ends, final = random(4, 3, 2) - 0.5, random(4, 3, 2, seed=1), random(3, 2, seed=2)
    found = planning.imagined_return(rewards, planning.survival(ends), 0.9, final)
    for row in range(3):
        for column in range(2):
            total, alive, power = 0.0, 1.0, 1.0
            for step in range(4):
                total += power * alive * float(rewards[step, row, column])
                alive *= 1.0 - float(ends[step, row, column])
                power *= 0.9
            total += power * alive * float(final[row, column])
            assert float(found[row, column]) == pytest.approx(total, rel=1e-12)


def test_an_imagined_cost_counts_as_far_as_it_is_reached_and_is_not_discounted():
    ends, costs = torch.tensor([0.0, 0.25, 0.5], dtype=F64), torch.ones(3, 2, dtype=F64)
    found = planning.imagined_cost(costs, planning.survival(ends))
    assert found.tolist() == [[1, 1], [1, 1], [0.75, 0.75]]


def test_a_certain_end_hides_what_comes_after_it_but_not_what_comes_with_it():
    alive = planning.survival(torch.tensor([1.0, 0.0]))
    assert float(planning.imagined_return(torch.tensor([2.0, 5.0]), alive, 1.0, torch.tensor(7.0))) == 2.0
    assert float(planning.imagined_cost(torch.tensor([[1.0], [1.0]]), alive).sum()) == 1.0


@pytest.mark.parametrize(("length", "share"), [(70, 0.01), (7, 0.1), (3, 0.1)])
def test_a_budget_is_the_horizons_share_of_the_limit(length, share):
    assert planning.budget(0.1, 7, length) == pytest.approx(share)


@pytest.mark.parametrize(("ending", "wanted"), [(1.0, 0.1), (0.5, 0.055), (0.0, 0.01)])
def test_costs_that_end_an_episode_may_take_the_whole_limit(ending, wanted):
    assert planning.budget(0.1, 7, 70, ending) == pytest.approx(wanted)


RETURNS = torch.tensor([[5.0, 4.0, 3.0, 2.0], [5.0, 4.0, 3.0, 2.0]])
COSTS = torch.tensor([[0.9, 0.1, 0.2, 0.0], [0.9, 0.8, 0.2, 0.7]]).unsqueeze(-1)
"""With a budget of 0.5, three candidates of the first environment are feasible, and one of the second."""


def test_elites_are_the_feasible_of_most_return_and_else_the_cheapest():
    weights = planning.elites(RETURNS, COSTS, torch.tensor([0.5]), 2)
    assert weights.tolist() == [[0, 0.5, 0.5, 0], [0, 0, 0.5, 0.5]]


@pytest.mark.parametrize("cheapest", range(4))
def test_too_few_feasible_candidates_are_joined_by_the_cheapest_of_the_others(cheapest):
    costs = torch.full((1, 4, 1), 0.9)
    feasible = (cheapest + 1) % 4
    costs[0, cheapest], costs[0, feasible] = 0.6, 0.1
    weights = planning.elites(RETURNS[:1], costs, torch.tensor([0.5]), 2)
    assert torch.nonzero(weights[0]).flatten().tolist() == sorted([cheapest, feasible])


def test_a_candidate_is_feasible_only_within_every_budget():
    costs = torch.tensor([[[0.1, 0.9], [0.1, 0.1], [0.9, 0.1], [0.2, 0.2]]])
    weights = planning.elites(RETURNS[:1], costs, torch.tensor([0.5, 0.5]), 2)
    assert weights.tolist() == [[0, 0.5, 0, 0.5]]


def test_the_cheapest_of_several_costs_is_counted_in_budgets():
    costs = torch.tensor([[[0.9, 0.0], [0.6, 0.06], [0.0, 0.6], [0.8, 0.0]]])  # 9, 6.6, 6, 8 budgets of 0.1 each
    tight, loose = torch.tensor([0.1, 0.1]), torch.tensor([0.1, 0.01])  # with the second: 9, 12, 60, 8
    assert planning.elites(RETURNS[:1], costs, tight, 1).argmax() == 2
    assert planning.elites(RETURNS[:1], costs, loose, 1).argmax() == 3


def test_safearc_weighs_the_feasible_by_return_and_else_all_by_cost():
    feasible = (COSTS <= 0.5).squeeze(-1)
    weights = planning.feasible_softmax(RETURNS, COSTS.squeeze(-1), feasible, 2, 1.0, 10.0)
    among = torch.tensor([4.0, 3.0, 2.0]).softmax(-1)
    assert weights[0].tolist() == pytest.approx([0, *among.tolist()])
    assert weights[1].tolist() == pytest.approx(torch.tensor([-9.0, -8.0, -2.0, -7.0]).softmax(-1).tolist())


def test_rows_are_standardised_over_those_that_count():
    values, mask = torch.tensor([[1.0, 3.0, 100.0]]), torch.tensor([[True, True, False]])
    assert planning.standardised_rows(values, mask)[0, :2].tolist() == pytest.approx([-1, 1])


def test_a_categorical_step_by_hand():
    plan = torch.tensor([[[[0.5, 0.5, 0.0], [0.2, 0.3, 0.5]]]], dtype=F64)  # N = H = 1, two branches, of 2 and 3
    exists = torch.tensor([[True, True, False], [True, True, True]])
    samples = torch.tensor([[[[0, 2]], [[1, 2]], [[1, 0]]]])
    weights = torch.tensor([[0.5, 0.25, 0.25]], dtype=F64)
    found = planning.categorical_step(plan, samples, weights, exists, 0.1, 0.02)
    shares = [[0.5, 0.5, 0.0], [0.25, 0.0, 0.75]]
    for branch, (options, count) in enumerate(zip(shares, (2, 3), strict=True)):
        for option, share in enumerate(options):
            mixed = 0.1 * float(plan[0, 0, branch, option]) + 0.9 * share
            wanted = ((1 - count * 0.02) * mixed + 0.02) if exists[branch, option] else 0.0
            assert float(found[0, 0, branch, option]) == pytest.approx(wanted, rel=1e-12)
    assert found.sum(-1).flatten().tolist() == pytest.approx([1, 1])


def test_a_gaussian_step_by_hand():
    mean, variance = torch.tensor([[[0.5]]], dtype=F64), torch.tensor([[[1.0]]], dtype=F64)
    samples, weights = torch.tensor([[[[-1.0]], [[1.0]]]], dtype=F64), torch.tensor([[0.25, 0.75]], dtype=F64)
    # μ' = 0.5, σ'² = 0.25·2.25 + 0.75·0.25 = 0.75
    found = planning.gaussian_step(mean, variance, samples, weights, 0.1, 0.2, 9.0)
    assert [float(x) for x in found] == pytest.approx([0.2 * 0.5 + 0.8 * 0.5, 0.1 * 1.0 + 0.9 * 0.75])
    assert float(planning.gaussian_step(mean, variance, samples, weights, 0.1, 0.2, 0.5)[1]) == 0.5


def test_arrays_that_would_broadcast_are_refused():
    with pytest.raises(ValueError, match="same shape"):
        planning.elites(RETURNS, COSTS.transpose(0, 1), torch.tensor([0.5]), 2)
    with pytest.raises(ValueError, match="same shape"):
        planning.imagined_return(torch.zeros(3, 2), torch.ones(4, 1), 1.0)
