"""Tests of the ensemble: losses by hand, fitting of a known system, and the frozen copy for imagined rollouts."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import softplus

from tests.algos.planning.planning_fixtures import BOX, OPTIONS, ensemble_for, generator, raw_actions
from thalweg.algos.planning.ccepets import CCEPETSConfig
from thalweg.algos.planning.model.ensemble import Ensemble, FrozenEnsemble, action_feature_count, action_features
from thalweg.algos.planning.model.fitting import Fitter, _decays
from thalweg.algos.planning.model.transitions import Batch, ReplayBuffer
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.mlp_autograd import layers_of


def batch_for(ensemble: Ensemble, count: int = 5, seed: int = 0, costs: int = 1) -> Batch:
    size = ensemble.frames * ensemble.layout.frame
    return Batch(
        torch.randn(count, size, generator=generator(seed)),
        raw_actions(ensemble.actions, count, seed=seed),
        torch.randn(count, generator=generator(seed + 1)),
        0.2 * (torch.rand(count, costs, generator=generator(seed + 2)) < 0.5).float(),
        torch.randn(count, ensemble.layout.frame, generator=generator(seed + 3)),
        torch.arange(count) % 3 == 1,
    )


def test_features_are_one_hot_or_the_executed_numbers():
    options = action_features(actions_of(OPTIONS), torch.tensor([[2, 0], [0, 1]]))
    assert options.tolist() == [[0, 0, 1, 1, 0], [1, 0, 0, 0, 1]]
    raw = torch.tensor([[0.4, -0.9]])
    literal, scaled = (action_features(actions_of(OPTIONS, a, "squashed"), raw) for a in ("box_literal", "box_scaled"))
    assert literal.tolist() == raw.tolist()
    assert scaled.tolist() == [[0, -1]]  # the middles of the bins
    assert [action_feature_count(actions_of(OPTIONS)), action_feature_count(actions_of(BOX))] == [5, 2]


def test_losses_equal_hand_computed_values():
    """One row at a time, with the soft clamps and cross-entropies written out in float64."""
    ensemble = ensemble_for(costs=2)
    batch = batch_for(ensemble, costs=2)
    ensemble.counts = torch.tensor([100.0, 20.0, 50.0, 5.0], dtype=torch.float64)  # w = 4, 1 and 10, of 19
    with torch.no_grad():
        found = ensemble.losses(batch, 10.0).double()
        x = torch.cat([ensemble.normalised(batch.obs), action_features(ensemble.actions, batch.actions)], -1)
        out = ensemble.stack.reference(x).double()
        low, high = ensemble.bounds.double()
    sums = torch.zeros(4, 4, dtype=torch.float64)
    for member in range(4):
        for row in range(5):
            o = out[member, row]
            if not batch.terminated[row]:
                target = (batch.next_frame[row] - batch.obs[row] - ensemble.change.mean) / ensemble.change.std
                raw = high - softplus(high - o[4:7])
                log_variance = low + softplus(raw - low)
                nll = 0.5 * ((target - o[:3]) ** 2 * torch.exp(-log_variance) + log_variance)
                sums[0, member] += nll.mean()
            wanted = (batch.rewards[row] - ensemble.reward.mean[0]) / ensemble.reward.std[0]
            sums[1, member] += 0.5 * (o[3] - wanted) ** 2
            shares = [float(batch.costs[row, 0]) / 0.2, float(batch.costs[row, 1]) / 0.2]
            for head, (y, w) in enumerate(zip([*shares, float(batch.terminated[row])], [4.0, 1.0, 10.0], strict=True)):
                p = torch.sigmoid(o[7 + head] + np.log(w))
                sums[2 if head < 2 else 3, member] += -(w * y * torch.log(p) + (1 - y) * torch.log(1 - p))
    assert torch.allclose(found, sums / 5, atol=1e-4)


def test_state_loss_ignores_frames_after_a_termination():
    ensemble = ensemble_for()
    batch = batch_for(ensemble)
    other = replace(batch, next_frame=torch.where(batch.terminated.unsqueeze(-1), 1e3, batch.next_frame))
    with torch.no_grad():
        assert torch.equal(ensemble.losses(batch, 10.0), ensemble.losses(other, 10.0))


@pytest.mark.parametrize("costs", [[0.0, 0.2], [0.0, 1.0, 0.2], [-1.0, 3.0], [0.5, 0.5]])
def test_cost_shares_span_the_range_of_costs(costs):
    ensemble = ensemble_for()
    ensemble.ranges, ensemble._cost_extremes = torch.tensor([[0.0], [1.0]]), torch.zeros(2, 1)
    batch = batch_for(ensemble, len(costs))
    ensemble.update_statistics(replace(batch, costs=torch.tensor(costs).unsqueeze(1)))
    low, high = ensemble.ranges
    assert (float(low), float(high)) == pytest.approx((min(0.0, *costs), max(costs)))
    back = low + (high - low) * ensemble.cost_shares(torch.tensor(costs).unsqueeze(1))
    assert back.flatten().tolist() == pytest.approx(costs)


def test_frozen_ensemble_equals_the_ensemble():
    ensemble = ensemble_for(costs=2)
    frozen, batch = FrozenEnsemble(ensemble), batch_for(ensemble, 6, costs=2)
    seen, features = ensemble.normalised(batch.obs), action_features(ensemble.actions, batch.actions)
    with torch.no_grad():
        plain = ensemble.stack.reference(torch.cat([seen, features], -1))
    fast = frozen.dense(torch.cat([seen, features], -1).expand(4, -1, -1).contiguous())
    mean, reward, raw, cost, end = ensemble.layout.slices
    deviation = (ensemble.observed.square / ensemble.observed.count).sqrt().float()
    change = (plain[..., mean] * ensemble.change.std + ensemble.change.mean) / deviation
    assert torch.allclose(fast[..., mean], change, atol=1e-4)
    assert torch.allclose(fast[..., reward], plain[..., reward] * ensemble.reward.std + ensemble.reward.mean, atol=1e-4)
    assert torch.allclose(fast[..., cost], plain[..., cost], atol=1e-4)
    assert torch.allclose(fast[..., end], plain[..., end], atol=1e-4)
    low, high = ensemble.bounds.detach()
    clamped = low + softplus(high - softplus(high - plain[..., raw]) - low)
    variance = clamped.exp() * (ensemble.change.std / deviation) ** 2
    assert torch.allclose(frozen.min_variance + frozen.variance_scale * fast[..., raw].sigmoid(), variance, rtol=1e-3)


def test_expected_costs_are_mean_probabilities_not_mean_logits():
    ensemble = ensemble_for(members=5)
    ensemble.stack.flat.data.zero_()
    *_, (_, bias) = ensemble.stack.layers
    _, reward, _, cost, end = ensemble.layout.slices
    logits = torch.tensor([-6.0, -6.0, -6.0, -6.0, 2.0]).view(5, 1, 1)
    bias[..., cost], bias[..., end], bias[..., reward] = logits, logits, torch.arange(5.0).view(5, 1, 1)
    expected, error = ensemble.expected(batch := batch_for(ensemble))
    # (4 / (1 + e⁶) + 1 / (1 + e⁻²)) / 5, of a cost whose range is 0 to 0.2
    assert expected[1:].tolist() == pytest.approx([0.2 * 0.17814, 0.17814], rel=1e-4)
    assert float(expected[0]) == pytest.approx(float(ensemble.reward.mean + 2.0 * ensemble.reward.std))
    change = (batch.next_frame - batch.obs - ensemble.change.mean) / ensemble.change.std
    assert float(error) == pytest.approx(float(change[~batch.terminated].square().mean()), rel=1e-5)


def test_variance_bounds_are_learned_unless_fixed():
    for fixed in (False, True):
        ensemble, replay = ensemble_for(), ReplayBuffer(100, 0.1)
        replay.add(batch_for(ensemble, 50))
        before = ensemble.bounds.detach().clone()
        config = CCEPETSConfig(fixed_variance_bounds=fixed, model_steps=3, minibatch=8)
        Fitter(ensemble, config, generator()).fit(replay, 1)
        assert torch.equal(ensemble.bounds, before) is fixed


def test_weight_decay_rises_towards_the_last_layer_and_is_zero_for_biases():
    ensemble = ensemble_for(hidden=(16, 16))
    parts = layers_of(_decays(ensemble, 0.4), ensemble.stack.count, ensemble.stack.sizes)
    assert [float(w.unique()) for w, _ in parts] == pytest.approx([0.1, 0.25, 0.4])
    assert all(float(b.abs().sum()) == 0 for _, b in parts)


def system(count: int, seed: int) -> Batch:
    """x' = 0.9 x + 0.2 a + N(0, 0.05²), r = x₀ - a₀, and a rare cost of 2 together with an end, more likely where x₁ is
    large."""
    gen = generator(seed)
    x, a = torch.randn(count, 2, generator=gen), 2 * torch.rand(count, 2, generator=gen) - 1
    after = 0.9 * x + 0.2 * a + 0.05 * torch.randn(count, 2, generator=gen)
    ended = torch.rand(count, generator=gen) < risk(x)
    return Batch(x, a, x[:, 0] - a[:, 0], 2.0 * ended.unsqueeze(1).float(), after, ended)


def risk(x: torch.Tensor) -> torch.Tensor:
    return 0.2 * torch.sigmoid(4.0 * (x[:, 1] - 1.0))


@pytest.mark.slow
def test_fits_a_linear_gaussian_system_with_a_terminal_cost():
    ensemble = Ensemble(2, 1, actions_of(BOX, "native", "squashed"), 1, 3, (48, 48), generator())
    replay, config = ReplayBuffer(20_000, 0.05), CCEPETSConfig(model_steps=2500, minibatch=256)
    train, test = system(8000, 1), system(4000, 2)
    ensemble.update_statistics(train)
    replay.add(train)
    Fitter(ensemble, config, generator()).fit(replay, 1)
    frozen = FrozenEnsemble(ensemble)
    x = torch.cat([ensemble.normalised(test.obs), test.actions], -1).expand(3, -1, -1).contiguous()
    out = frozen.dense(x)
    mean, reward, raw, cost, end = ensemble.layout.slices
    change = out[..., mean].mean(0) / ensemble.observed.scale
    exact = (0.9 * test.obs + 0.2 * test.actions) - test.obs
    assert float((change - exact).square().mean().sqrt()) < 0.02
    assert float((out[..., reward].mean(0).squeeze() - test.rewards).abs().mean()) < 0.03
    variance = (frozen.min_variance + frozen.variance_scale * out[..., raw].sigmoid()).mean(
        0
    ) / ensemble.observed.scale**2
    assert float(variance.mean().sqrt()) == pytest.approx(0.05, rel=0.1)
    probability = out[..., end].sigmoid().mean(0).squeeze()
    assert float(probability.mean()) == pytest.approx(float(risk(test.obs).mean()), rel=0.25)
    assert float((probability - risk(test.obs)).abs().mean()) < 0.015
    expected = frozen.cost_low + frozen.cost_range * out[..., cost].sigmoid().mean(0)
    assert float(expected.mean()) == pytest.approx(2 * float(risk(test.obs).mean()), rel=0.25)


def test_refit_waits_for_its_steps_and_stops_without_improvement():
    ensemble, replay = ensemble_for(), ReplayBuffer(100, 0.2)
    replay.add(batch_for(ensemble, 60))
    config = CCEPETSConfig(fitting="refit", refit_steps=10, refit_patience=2, model_learning_rate=0.0, minibatch=16)
    fitter = Fitter(ensemble, config, generator())
    assert fitter.fit(replay, 9) is None
    steps: list[int] = []
    before = fitter._step
    fitter._step = lambda *given: (steps.append(1), before(*given))[1]  # pyright: ignore
    losses = fitter.fit(replay, 1)
    assert losses is not None and losses.isfinite().all()
    assert len(steps) == 3 * 3  # the first epoch, which gains on nothing at all, and two more; 48 rows in threes
    assert fitter.fit(replay, 9) is None


def test_a_refit_with_one_transition_which_is_held_out_takes_no_step():
    ensemble, replay = ensemble_for(), ReplayBuffer(100, 0.2)
    replay.add(batch_for(ensemble, 1))
    before = ensemble.stack.flat.clone()
    assert Fitter(ensemble, CCEPETSConfig(fitting="refit", refit_steps=1), generator()).fit(replay, 1) is None
    assert torch.equal(ensemble.stack.flat, before)


def test_refit_interval_does_not_depend_on_collections():
    ensemble, replay = ensemble_for(), ReplayBuffer(100, 0.2)
    replay.add(batch_for(ensemble, 20))
    config = CCEPETSConfig(fitting="refit", refit_steps=10, refit_patience=1, model_learning_rate=0.0)
    fitter = Fitter(ensemble, config, generator())
    fitted = [fitter.fit(replay, 4) is not None for _ in range(10)]
    assert [4 * (number + 1) for number, so in enumerate(fitted) if so] == [12, 20, 32, 40]
    assert fitter.fit(replay, 35) is not None and fitter.fit(replay, 4) is None  # 75, 79: once, not thrice


def test_restored_ensemble_resumes_identically():
    one, two, replay = ensemble_for(), ensemble_for(), ReplayBuffer(100, 0.1)
    replay.add(batch_for(one, 50))
    config = CCEPETSConfig(model_steps=3, minibatch=8)
    fitters = [Fitter(ensemble, config, generator(9)) for ensemble in (one, two)]
    one.update_statistics(batch_for(one, 20, seed=8))
    fitters[0].fit(replay, 1)
    two.load_state(one.state())
    fitters[1].load_state(fitters[0].state())
    fitters[1].generator.set_state(fitters[0].generator.get_state())
    for fitter in fitters:
        fitter.fit(replay, 1)
    assert torch.equal(one.stack.flat, two.stack.flat) and torch.equal(one.bounds, two.bounds)
