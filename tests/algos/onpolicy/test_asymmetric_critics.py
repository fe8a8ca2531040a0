"""Critics that see more than the policy: what they see, what they learn from it, and that nothing else changes."""

import dataclasses
from typing import Any

import gymnasium as gym
import pytest
import torch

from tests.algos import rollouts
from tests.algos.onpolicy.test_learners import ON_POLICY
from tests.algos.rollouts import feedback
from thalweg.algos import ALGORITHMS, AlgorithmError
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.onpolicy.agent import Agent, cost_signals, reward_signal
from thalweg.algos.onpolicy.ppo import PPOConfig
from thalweg.algos.onpolicy.rollout_samples import Samples, Signal
from thalweg.algos.policy import fast_path
from thalweg.algos.policy.memory import Gru, Sequences

N, T, D, C, M = 3, 10, 2, 2, 4
GRU: dict[str, Any] = {"memory": "gru", "memory_size": M, "sequence": 4}


def numbers(*shape: int, seed: int) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def agent(critic_size: int = C, **settings: Any) -> Agent:
    usual: dict[str, Any] = {"hidden": (8,), "minibatch": 8, "asymmetric_critics": True}
    config = PPOConfig(**(usual | settings))
    task = Task(D, gym.spaces.Discrete(3), N, 0, {}, critic_size=critic_size)
    return Agent("Some", 2, config, task)


def rollout(seed: int, frames: int = 1, **changes: Any) -> Rollout:
    """Steps of which one was cut off, and another one only reset its environment."""
    truncated, valid = torch.zeros(T, N, dtype=torch.bool), torch.ones(T, N, dtype=torch.bool)
    truncated[4, 1], valid[5, 1] = True, False
    fresh = torch.zeros(T + 1, N, dtype=torch.bool)
    fresh[6, 1] = True
    fields = {
        "truncated": truncated,
        "valid": valid,
        "fresh": fresh,
        "final_index": torch.tensor([4 * N + 1]),
        "final_obs": numbers(1, frames * D, seed=seed + 1),
        "critic_obs": 5 * numbers(T + 1, N, C, seed=seed + 2) + 3,
        "final_critic_obs": numbers(1, C, seed=seed + 3),
        "rewards": numbers(T, N, seed=seed + 4),
    }
    return rollouts.rollout_of(numbers(T + 1, N, frames * D, seed=seed), **(fields | changes))


def samples(one: Agent, steps: Rollout) -> Samples:
    return one.samples(steps, [Signal(steps.rewards, 0.9, 0.0), Signal(steps.costs[..., 0], 0.9, 0.0)])


def standardised(rows: torch.Tensor, by: torch.Tensor) -> torch.Tensor:
    return ((rows - by.mean(0)) / by.std(0, correction=0)).clamp(-5, 5)


@pytest.mark.parametrize("frames", [1, 3])
def test_critics_see_the_stacked_observation_and_then_what_they_are_told(frames: int):
    """By statistics of their own, which are those of the first rollout in it, and of those before in later ones."""
    one, first, second = agent(frame_stack=frames), rollout(10, frames), rollout(20, frames)
    told = first.critic_obs[:-1][first.valid]  # pyright: ignore[reportOptionalSubscript]
    for steps in (first, second):
        found = samples(one, steps)
        assert isinstance(found.critic_inputs, torch.Tensor) and isinstance(found.inputs, torch.Tensor)
        assert found.critic_inputs.shape == (T * N - 1, frames * D + C)
        assert torch.equal(found.critic_inputs[:, : frames * D], found.inputs)
        rows = steps.critic_obs[:-1][steps.valid]  # pyright: ignore[reportOptionalSubscript]
        assert torch.allclose(found.critic_inputs[:, frames * D :], standardised(rows, told), atol=1e-4)
        with torch.no_grad():
            assert torch.allclose(found.values, one.critics(found.critic_inputs), atol=1e-6)
    assert one.critic_normaliser is not None and one.critic_normaliser.count == 2 * (T * N - 1)
    assert one.policy.actor.stack.sizes[0] == frames * D


@pytest.mark.parametrize("settings", [{"initial": "kaiming"}, {"activation": "relu"}], ids=str)
def test_statistics_of_what_only_critics_see_include_the_first_rollout_at_once(settings: dict[str, Any]):
    """Also where those of the observation do not, because the policy acted without them."""
    one, steps = agent(**settings), rollout(10)
    found = samples(one, steps)
    rows = steps.critic_obs[:-1][steps.valid]  # pyright: ignore[reportOptionalSubscript]
    expected = torch.cat([steps.obs[:-1][steps.valid], standardised(rows, rows)], 1)
    assert torch.allclose(found.critic_inputs, expected, atol=1e-4)  # pyright: ignore[reportArgumentType]


def test_without_normalisation_critics_see_the_numbers_themselves():
    steps = rollout(10)
    found = samples(agent(normalise_observations=False), steps)
    expected = torch.cat([steps.obs, steps.critic_obs], -1)[:-1][steps.valid]  # pyright: ignore
    assert torch.equal(found.critic_inputs, expected)  # pyright: ignore[reportArgumentType]


def test_a_truncated_step_is_worth_what_critics_see_at_its_end():
    one, steps = agent(normalise_observations=False), rollout(10)
    with torch.no_grad():
        final = torch.cat([steps.final_obs, steps.final_critic_obs], -1)  # pyright: ignore
        expected = steps.rewards[4, 1] + 0.9 * one.critics(final)[0, 0]
    row = 4 * N + 1
    assert samples(one, steps).targets[0, row].item() == pytest.approx(expected.item(), abs=1e-6)


def test_collectors_without_final_observations_give_none():
    steps = rollout(10, final_index=torch.zeros(0, dtype=torch.int64), final_obs=torch.zeros(0, D))
    given = dataclasses.replace(steps, final_critic_obs=torch.zeros(0, C))
    found, missing = (samples(agent(), each) for each in (given, dataclasses.replace(steps, final_critic_obs=None)))
    assert torch.equal(found.targets, missing.targets)


def walk(one: Agent, steps: Rollout, env: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Values [2, T] of one environment, step by step through the first rollout, and that of its final state [2]."""
    gru = one.critics.gru
    assert isinstance(gru, Gru) and steps.critic_obs is not None and steps.final_critic_obs is not None

    def after(seen: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        return torch.gru_cell(seen, state, gru.weight_in, gru.weight, gru.bias_in, gru.bias)

    def value(seen: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        return one.critics.stack.reference(torch.cat([seen, state], -1))[:, 0, 0]

    state, values, final = torch.zeros(1, M), [], torch.zeros(2)
    for t in range(T):
        seen = torch.cat([steps.obs[t, env], steps.critic_obs[t, env]])[None]
        state = after(seen, state * (~steps.fresh[t, env]))
        values.append(value(seen, state))
        if steps.truncated[t, env]:
            last = torch.cat([steps.final_obs, steps.final_critic_obs], -1)
            final = value(last, after(last, state))
    return torch.stack(values, 1), final


@torch.no_grad()
def test_with_a_memory_critics_see_what_they_are_told_in_their_recurrent_network_too():
    one, steps = agent(normalise_observations=False, **GRU), rollout(10)
    found = samples(one, steps)
    assert isinstance(found.inputs, Sequences) and isinstance(found.critic_inputs, Sequences)
    walks = [walk(one, steps, env) for env in range(N)]
    length, columns = found.inputs.fresh.shape
    rows = found.inputs.keep
    at, env = rows // columns + rows % columns // N * length, rows % columns % N
    expected = torch.stack([walks[n][0][:, t] for t, n in zip(at.tolist(), env.tolist(), strict=True)], 1)
    assert torch.allclose(found.values, expected, atol=1e-6)
    assert torch.allclose(one.critics(found.critic_inputs), expected, atol=1e-6)
    cut = int(((at == 4) & (env == 1)).nonzero())
    assert found.targets[0, cut].item() == pytest.approx(float(steps.rewards[4, 1] + 0.9 * walks[1][1][0]), abs=1e-5)
    # The policy sees the observation alone, as without the setting.
    alone = samples(agent(asymmetric_critics=False, normalise_observations=False, **GRU), steps)
    assert isinstance(alone.inputs, Sequences) and alone.critic_inputs is alone.inputs
    assert torch.equal(found.inputs.obs, alone.inputs.obs)
    assert torch.equal(found.inputs.starts["actor"], alone.inputs.starts["actor"])


def test_minibatches_of_critics_keep_rows_together():
    steps = rollout(10)
    steps.critic_obs[:-1, :, 0] = torch.arange(T * N).view(T, N)  # pyright: ignore[reportOptionalSubscript]
    found = samples(agent(normalise_observations=False), steps)
    number = steps.critic_obs[:-1, :, 0][steps.valid]  # pyright: ignore[reportOptionalSubscript]
    batches = list(found.of_critics.minibatches((number, found.actions), 8, torch.Generator().manual_seed(0)))
    for inputs, (rows, _) in batches:
        assert isinstance(inputs, torch.Tensor) and torch.equal(inputs[:, D], rows)
    assert torch.cat([rows for _, (rows, _) in batches]).sort().values.tolist() == number.tolist()


@pytest.mark.parametrize("settings", [{}, GRU], ids=["perceptrons", "gru"])
def test_critics_learn_by_compiled_loops_what_autograd_defines(settings: dict[str, Any]):
    """The same weights and losses after four passes."""
    both = []
    for on in (True, False):
        with fast_path.switched(on):
            one = agent(critic_learning_rate=0.01, max_grad_norm=0.3, critic_decay=0.01, **settings)
            assert one.critics.compiled == (on and not settings)
            found = samples(one, rollout(10))
            before = weights(one.critics)
            with one.critics_learning(found, 4):
                pass
            assert float((weights(one.critics) - before).abs().max()) > 0.02
            both.append((weights(one.critics), one.critic_losses()))
    assert torch.allclose(both[0][0], both[1][0], atol=2e-5) and torch.allclose(both[0][1], both[1][1], rtol=1e-4)


def weights(module: torch.nn.Module) -> torch.Tensor:
    return torch.cat([value.detach().flatten() for value in module.parameters()])


def learner_for(name: str, critic_size: int, **settings: Any) -> Any:
    entry = ALGORITHMS[name]
    config = entry.config(**({"steps_per_update": 256, "minibatch": 64, "hidden": (16,)} | settings))
    return entry.make(config, Task(D, gym.spaces.Discrete(3), 4, 0, {}, critic_size=critic_size))


def hidden_returns(learner: Any, seed: int) -> Rollout:
    """Episodes of two steps that pay a number z that only critics see, and cost z²; the second z is half the first.

    Critics also see which step it is, so that they can know the return, z + γ z / 2 or z; the observation is noise.
    """
    told = numbers(65, 4, 1, seed=seed)
    first = (torch.arange(65) % 2 == 0).view(-1, 1)
    told[1::2] = 0.5 * told[:-1:2]
    obs = numbers(65, 4, D, seed=seed + 1000)
    fresh = first.expand(-1, 4)
    actions = torch.stack([learner.act(obs[t], fresh[t]) for t in range(64)])
    return rollouts.rollout_of(
        obs,
        fresh=fresh,
        actions=actions,
        rewards=told[:-1, :, 0],
        costs=told[:-1].square(),
        terminated=~first[:-1].expand(-1, 4),
        critic_obs=torch.cat([told, first.float().expand(-1, 4)[..., None]], -1),
        final_critic_obs=torch.zeros(0, 2),
    )


@pytest.mark.parametrize(
    ("name", "settings", "updates"),
    [
        *(pytest.param(name, {}, 6, id=name) for name in ON_POLICY),
        pytest.param("CPO", GRU, 10, marks=pytest.mark.slow, id="CPO with a memory"),
    ],
)
def test_what_only_critics_see_explains_returns_that_depend_on_it(name: str, settings: dict[str, Any], updates: int):
    explained = {}
    for on in (True, False):
        learner = learner_for(name, 2, asymmetric_critics=on, critic_learning_rate=0.02, **settings)
        for seed in range(updates):
            metrics = learner.update(hidden_returns(learner, seed), feedback(0.5))
        explained[on] = {key: value for key, value in metrics.items() if "explained_variance" in key}
    assert len(explained[True]) == (1 if name == "PPO" else 2)
    assert min(explained[True].values()) > 0.95
    assert max(abs(value) for value in explained[False].values()) < 0.3


LIMIT, GAMMA = 8, 0.99


def values_before_a_limit(learner: Any, updates: int) -> list[list[float]]:
    """Values of reward and cost [2, LIMIT] by the step of an episode, after updates on episodes that pay and cost 0.2
    as the limit cuts them off."""
    for seed in range(updates):
        obs = numbers(65, 4, D, seed=seed)
        actions = torch.stack([learner.act(each, torch.zeros(4, dtype=torch.bool)) for each in obs[:-1]])
        learner.update(rollouts.cut_off(obs, LIMIT, actions=actions), feedback(0.2))
    agent, share = learner.agent, torch.arange(LIMIT).unsqueeze(1) / LIMIT
    seen = torch.zeros(LIMIT, 0) if learner.config.sees_images else torch.zeros(LIMIT, D)
    told = [] if agent.critic_normaliser is None else [agent.critic_normaliser(share)]
    with torch.no_grad():
        return agent.critics(torch.cat([seen, *told], 1)).tolist()


@pytest.mark.parametrize("name", [name for name in ON_POLICY if name != "PPO"])
def test_the_cost_of_critics_that_know_the_limit_ends_there_and_what_the_reward_is_worth_grows(name: str):
    """The cost of step t is worth 0.2 γ^(7 - t). The value of the reward at the limit is never trained, and what it is
    taken to be returns to it, towards 0.2 / (1 - γ) = 20."""
    settings = {"critic_learning_rate": 0.02, "discount": GAMMA, "cost_discount": GAMMA}
    short, long = (
        values_before_a_limit(learner_for(name, 1, asymmetric_critics=True, **settings), updates)
        for updates in (10, 30)
    )
    assert long[1] == pytest.approx([0.2 * GAMMA ** (LIMIT - 1 - t) for t in range(LIMIT)], abs=0.03)
    assert long[0][-1] > short[0][-1] + 0.2 > 0.6


def test_the_cost_of_critics_that_do_not_know_the_limit_goes_on_beyond_it():
    """They expect 0.2 in a step of eight, for ever, to the bit as of the reward."""
    learner = learner_for("PPOLag", 1, asymmetric_critics=False)
    rollout = rollouts.cut_off(numbers(65, 4, D, seed=0), LIMIT)
    assert [signal.ends_at_limit for signal in cost_signals(learner.config, rollout)] == [False]
    told = dataclasses.replace(learner.config, asymmetric_critics=True)
    assert [signal.ends_at_limit for signal in cost_signals(told, rollout)] == [True]
    silent = dataclasses.replace(rollout, critic_obs=None, final_critic_obs=None)
    assert [signal.ends_at_limit for signal in cost_signals(told, silent)] == [False]
    assert not reward_signal(told, rollout).ends_at_limit


def test_a_signal_that_ends_at_the_limit_is_worth_its_last_step_alone():
    one, steps = agent(normalise_observations=False), rollout(10)
    signals = [Signal(steps.rewards, 0.9, 0.0), Signal(steps.rewards, 0.9, 0.0, ends_at_limit=True)]
    on, over = one.samples(steps, signals).targets
    row = 4 * N + 1
    assert over[row].item() == pytest.approx(steps.rewards[4, 1].item()) and abs(float(on[row] - over[row])) > 1e-3


@pytest.mark.parametrize(("name", "memory"), [("FOCOPS", {}), ("OnCRPO", {}), ("CPO", GRU)])
def test_off_or_without_anything_more_to_see_every_number_is_the_same(name: str, memory: dict[str, Any]):
    """Switched off, although the rollouts have it; and switched on, although the environment tells nothing."""
    told = lambda rollout: rollout  # noqa: E731
    silent = lambda rollout: dataclasses.replace(rollout, critic_obs=None, final_critic_obs=None)  # noqa: E731
    results = []
    for on, size, seen in ((False, 0, silent), (False, 2, told), (True, 0, silent)):
        learner = learner_for(name, size, asymmetric_critics=on, **memory)
        metrics = [learner.update(seen(hidden_returns(learner, seed)), feedback(0.5)) for seed in range(2)]
        results.append((metrics, weights(learner.policy.actor), weights(learner.agent.critics), learner.state()))
    for metrics, actor, critics, state in results[1:]:
        assert str(metrics) == str(results[0][0])
        assert torch.equal(actor, results[0][1]) and torch.equal(critics, results[0][2])
        assert set(state) == set(results[0][3])


@pytest.mark.parametrize("name", ON_POLICY)
def test_the_policy_does_not_depend_on_what_only_critics_see(name: str):
    """It begins with the same weights."""
    learners = [learner_for(name, 2, asymmetric_critics=on) for on in (True, False)]
    assert torch.equal(*(weights(learner.policy.actor) for learner in learners))


def test_a_state_of_critics_that_see_something_else_is_refused():
    with pytest.raises(AlgorithmError, match="the network is another one"):
        agent().load_state(agent(asymmetric_critics=False).state())
