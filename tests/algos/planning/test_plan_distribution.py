"""Tests of plan distributions: initial plans, samples, shifts between decisions, and updates by weights."""

import pytest
import torch

from tests.algos.planning.planning_fixtures import BOX, OPTIONS, generator
from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.planning.ccepets import CCEPETSConfig
from thalweg.algos.planning.plan_distribution import CategoricalPlans, GaussianPlans, plan_distribution_of
from thalweg.algos.policy.actions import actions_of

CONFIG = CCEPETSConfig(horizon=3, carry_over=0.5, initial_std=0.5, floor=0.02, momentum=0.1)


def test_distribution_matches_the_action_space():
    spaces = [actions_of(OPTIONS), actions_of(OPTIONS, "box_scaled", "squashed"), actions_of(BOX, "native", "squashed")]
    assert [type(plan_distribution_of(actions, CONFIG, 0.0)) for actions in spaces] == [
        CategoricalPlans,
        GaussianPlans,
        GaussianPlans,
    ]


def test_initial_categorical_plan_is_uniform_over_existing_options():
    search = CategoricalPlans((3, 2), CONFIG)
    plan = search.first(2)
    assert plan[1, 2].tolist() == [pytest.approx([1 / 3] * 3), [0.5, 0.5, 0.0]]
    drawn = search.samples(plan, 4000, generator())
    assert drawn.shape == (2, 4000, 3, 2)
    shares = [[float((drawn[..., branch] == k).float().mean()) for k in range(3)] for branch in range(2)]
    assert shares[0] == pytest.approx([1 / 3] * 3, abs=0.02) and shares[1] == pytest.approx([0.5, 0.5, 0], abs=0.02)


def test_samples_follow_the_probabilities_of_each_environment_and_step():
    search = CategoricalPlans((3,), CONFIG)
    plan = torch.rand(2, 3, 1, 3, generator=generator())
    plan = plan / plan.sum(-1, keepdim=True)
    drawn = search.samples(plan, 20_000, generator(1))
    for option in range(3):
        assert torch.allclose((drawn == option).float().mean(1), plan[..., option], atol=0.02)
    first = torch.stack([search.draw(plan, generator(seed)) for seed in range(3000)])
    assert torch.allclose((first == 2).float().mean(0), plan[:, 0, :, 2], atol=0.03)
    assert torch.equal(search.mode(plan), plan[:, 0].argmax(-1))


def test_shifted_categorical_plan_is_mixed_with_the_uniform_one():
    search = CategoricalPlans((2,), CONFIG)
    plan = torch.tensor([[1.0, 0.0], [0.2, 0.8], [0.0, 1.0]]).view(1, 3, 1, 2)
    assert search.shifted(plan).flatten().tolist() == pytest.approx([0.35, 0.65, 0.25, 0.75, 0.5, 0.5])


def test_updated_categorical_plan_keeps_the_floor():
    search = CategoricalPlans((3, 2), CONFIG)
    samples = torch.zeros(1, 4, 3, 2, dtype=torch.int64)
    plan = search.first(1)
    for _ in range(20):
        plan = search.updated(plan, samples, torch.full((1, 4), 0.25))
    assert float(plan[0, 0, 0, 1]) == pytest.approx(0.02 / (1 - 0.1 * (1 - 0.06)), rel=1e-3)
    assert float(plan[0, 0, 1, 2]) == 0
    assert plan.sum(-1).flatten().tolist() == pytest.approx([1.0] * 6)


def test_too_large_a_floor_is_refused():
    with pytest.raises(AlgorithmError, match=r"floor must be less than 1/4 where a choice has 4 options, got 0\.25"):
        CategoricalPlans((3, 4), CCEPETSConfig(floor=0.25))
    assert CategoricalPlans((3, 3), CCEPETSConfig(floor=0.25)).config.floor == 0.25


def test_initial_gaussian_plan_has_its_standard_deviation_and_samples_within_bounds():
    search = GaussianPlans(2, CONFIG, 0.0)
    plan = search.first(1)
    plan[0, 0, 0, 0] = 0.9
    drawn = search.samples(plan, 20_000, generator())
    assert float(drawn.abs().max()) == 1.0
    assert float(drawn[0, :, 1].std()) == pytest.approx(0.47, abs=0.01)  # 0.5, clipped at two deviations
    assert search.mode(plan)[0].tolist() == pytest.approx([0.9, 0.0])


def test_shifted_gaussian_plan_keeps_means_and_resets_variances():
    search = GaussianPlans(1, CONFIG, 0.0)
    plan = torch.tensor([[0.1, 0.01], [0.2, 0.01], [0.3, 0.01]]).view(1, 3, 1, 2)
    assert search.shifted(plan)[..., 0].flatten().tolist() == pytest.approx([0.2, 0.3, 0.0])
    assert search.shifted(plan)[..., 1].flatten().tolist() == pytest.approx([0.25] * 3)


def test_proposals_replace_a_share_of_a_plan():
    search = CategoricalPlans((3, 2), CONFIG)
    proposals = torch.tensor([[[[0, 0]] * 3, [[2, 0]] * 3]])
    plan = search.drawn_to(search.first(1), proposals, 0.6)
    wanted = [0.4 / 3 + 0.3, 0.4 / 3, 0.4 / 3 + 0.3]
    assert plan[0, 2, 0].tolist() == pytest.approx([(1 - 3 * 0.02) * p + 0.02 for p in wanted])
    assert plan[0, 2, 1].tolist() == pytest.approx([(1 - 2 * 0.02) * 0.8 + 0.02, (1 - 2 * 0.02) * 0.2 + 0.02, 0])


def test_proposals_move_the_means_of_numbers_and_leave_their_variances():
    search = GaussianPlans(2, CONFIG, 0.0)
    proposals = torch.tensor([0.5, 1.0]).view(1, 2, 1, 1).expand(1, 2, 3, 2)
    plan = search.drawn_to(search.first(1), proposals, 0.6)
    assert plan[0, 1].tolist() == [pytest.approx([0.45, 0.25])] * 2
