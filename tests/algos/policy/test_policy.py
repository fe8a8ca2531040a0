"""Tests of the policy: the actions it samples, and its deterministic ones."""

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from thalweg.algos import About, AlgorithmError, Policy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.vision import rows_of

SPACES = {
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 3, 3, 3]),
    "uneven": gym.spaces.MultiDiscrete([2, 5], start=[1, -2]),
    "Discrete": gym.spaces.Discrete(4, start=7),
    "Box": gym.spaces.Box(np.array([-2, 0], np.float32), np.array([2, 1], np.float32), dtype=np.float32),
    "unbounded": gym.spaces.Box(-np.inf, np.inf, (2, 2), np.float64),
}


def policy_for(space: gym.Space, adapter: Any = "native", **settings: Any) -> Policy:
    shape = NetworkShape((16,), memory=settings.pop("memory", 0))
    return Policy(5, actions_of(space, adapter), shape, generator=torch.Generator().manual_seed(1), **settings)


def observations(count: int = 64) -> np.ndarray:
    return np.random.default_rng(0).standard_normal((count, 5)).astype(np.float32)


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
def test_every_action_belongs_to_the_space(space: gym.Space):
    for action in policy_for(space).act(observations(), generator=torch.Generator().manual_seed(0)):
        assert space.contains(action if action.shape else np.int64(action))


@pytest.mark.parametrize("adapter", ["box_literal", "box_scaled"])
def test_an_adapter_gives_options_of_the_space(adapter: str):
    space = SPACES["uneven"]
    assert all(space.contains(action) for action in policy_for(space, adapter).act(observations()))


def test_an_untrained_policy_samples_every_option_with_equal_probability():
    drawn = policy_for(SPACES["MultiDiscrete"]).act(observations(8000), generator=torch.Generator().manual_seed(0))
    for option in range(3):
        assert (drawn == option).mean(0) == pytest.approx([1 / 3] * 4, abs=0.02)


def test_minus_one_to_one_spans_a_bounded_box():
    actions = actions_of(SPACES["Box"])
    found = actions.to_numpy(torch.tensor([[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0], [9.0, 9.0]]))
    assert found.tolist() == [[-2, 0], [0, 0.5], [2, 1], [2, 1]]


def test_the_same_generator_state_samples_the_same_actions():
    policy = policy_for(SPACES["MultiDiscrete"])
    first, second = (policy.act(observations(), generator=torch.Generator().manual_seed(3)) for _ in range(2))
    assert np.array_equal(first, second)


def test_a_deterministic_action_is_the_most_probable_and_needs_no_draw():
    policy = policy_for(SPACES["MultiDiscrete"])
    distribution: Any = policy.distribution(torch.from_numpy(observations()))
    log_p = distribution.log_p
    assert np.array_equal(policy.act(observations(), deterministic=True), log_p.argmax(-1).numpy())


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
def test_a_saved_policy_acts_as_before(space: gym.Space, tmp_path):
    policy = policy_for(space)
    policy.about = About("PPO", {"clip": 0.2}, {"encoder": "default", "render_version": 3})
    policy.normaliser.update(torch.from_numpy(observations() * 3 + 1))
    policy.save(tmp_path / "policy.safetensors")
    loaded = Policy.load(tmp_path / "policy.safetensors")
    assert loaded.about == policy.about and loaded.actions == policy.actions
    acts = [p.act(observations(), generator=torch.Generator().manual_seed(0)) for p in (policy, loaded)]
    assert np.array_equal(acts[0], acts[1])


def test_acting_does_not_change_the_normaliser():
    policy = policy_for(SPACES["Discrete"])
    policy.normaliser.update(torch.from_numpy(observations()))
    before = policy.normaliser.state()
    policy.act(observations() * 100)
    assert policy.normaliser.state()["count"] == before["count"]
    assert np.array_equal(policy.normaliser.mean, before["mean"])


def test_the_normaliser_has_the_moments_of_everything_it_saw():
    policy = policy_for(SPACES["Discrete"])
    parts = np.split(observations(300) * 4 + 2, [7, 100])
    for part in parts:
        policy.normaliser.update(torch.from_numpy(part))
    everything = np.concatenate(parts).astype(np.float64)
    assert policy.normaliser.mean == pytest.approx(everything.mean(0), rel=1e-9)
    assert policy.normaliser.square / 300 == pytest.approx(everything.var(0), rel=1e-9)
    out = policy.normaliser(torch.from_numpy(everything).float()).numpy()
    assert out.std(0) == pytest.approx(np.ones(5), abs=0.02)


def test_the_normaliser_tells_small_units_from_constants_and_rounding():
    normaliser = Normaliser(5)
    assert not normaliser.overlooked.any()
    seen = torch.tensor([0.1, 1e-6, 0.3, 0.0, 1.0]).repeat(1000, 1)
    seen[::2] = torch.tensor([0.1, 3e-6, 0.3, 0.0, 2.0])
    seen[::2, 2] += 3e-8  # the next number in float32
    for part in seen.split(7):
        normaliser.update(part)
    assert normaliser.overlooked.tolist() == [False, True, False, False, False]
    assert not Normaliser(5, enabled=False).overlooked.any()


def test_the_normaliser_ignores_a_number_that_has_never_varied():
    normaliser = Normaliser(3)
    normaliser.update(torch.tensor([[0.0, 7.0, 0.000], [1.0, 7.0, 0.002]]))
    found = normaliser(torch.tensor([[1.0, 7.5, 0.011], [1.0, -9.0, 0.001]]))
    # deviation 1/2; none; 0.001, which counts as 0.01
    assert found.flatten().tolist() == pytest.approx([1.0, 0.0, 1.0, 1.0, 0.0, 0.0], abs=1e-6)


def test_the_wrong_number_of_observations_names_both():
    with pytest.raises(AlgorithmError, match=r"takes observations \[N, 5\], got an array of shape \(4, 16\)"):
        policy_for(SPACES["Discrete"]).act(np.zeros((4, 16), np.float32))


REMEMBERING: dict[str, dict[str, int]] = {
    "frames": {"frames": 3},
    "recurrent": {"memory": 4},
    "both": {"frames": 2, "memory": 4},
}


def flight(policy: Policy, steps: int = 12) -> list[Any]:
    """Actions of two environments, of which the second begins anew in the midst."""
    player = policy.player(2, generator=torch.Generator().manual_seed(0))
    obs = np.random.default_rng(2).standard_normal((steps, 2, 5)).astype(np.float32)
    return [player(obs[step], np.array([step == 0, step in (0, 7)])).tolist() for step in range(steps)]


@pytest.mark.parametrize("settings", REMEMBERING.values(), ids=list(REMEMBERING))
def test_a_saved_policy_with_memory_acts_as_before(settings: dict[str, int], tmp_path):
    policy = policy_for(SPACES["Box"], **settings)
    policy.normaliser.update(torch.randn(50, len(policy.normaliser.mean)) * 3 + 1)
    policy.save(tmp_path / "policy.safetensors")
    loaded = Policy.load(tmp_path / "policy.safetensors")
    assert (loaded.frames, loaded.shape, loaded.obs_size) == (policy.frames, policy.shape, 5)
    assert flight(loaded) == flight(policy)


@pytest.mark.parametrize("settings", REMEMBERING.values(), ids=list(REMEMBERING))
def test_a_policy_with_memory_acts_through_its_player_only(settings: dict[str, int]):
    with pytest.raises(AlgorithmError, match=r"uses earlier observations or actions: use policy\.player"):
        policy_for(SPACES["Discrete"], **settings).act(observations())


def test_a_recurrent_policy_has_no_distribution_without_its_memory():
    with pytest.raises(AlgorithmError, match="has a recurrent memory: use policy"):
        policy_for(SPACES["Discrete"], memory=4).distribution(torch.zeros(1, 5))


@pytest.mark.parametrize("settings", REMEMBERING.values(), ids=list(REMEMBERING))
def test_a_player_clears_its_memory_at_the_start_of_an_episode_only(settings: dict[str, int]):
    policy, obs = policy_for(SPACES["Box"], **settings), observations(6).reshape(3, 2, 5)
    players = [policy.player(2, deterministic=True) for _ in range(2)]
    begun, on = np.ones(2, dtype=bool), np.zeros(2, dtype=bool)
    players[0](obs[0], begun)
    players[0](obs[1], on)
    found, alone = players[0](obs[2], np.array([True, False])), players[1](obs[2], begun)
    assert np.array_equal(found[0], alone[0]) and not np.array_equal(found[1], alone[1])


@pytest.mark.parametrize("settings", REMEMBERING.values(), ids=list(REMEMBERING))
def test_a_player_resumes_from_its_state(settings: dict[str, int]):
    policy, on = policy_for(SPACES["Box"], **settings), np.zeros(2, dtype=bool)
    one, other = (policy.player(2, deterministic=True) for _ in range(2))
    obs = observations(6).reshape(3, 2, 5)
    one(obs[0], ~on)
    one(obs[1], on)
    other.load_state(one.state())
    assert np.array_equal(one(obs[2], on), other(obs[2], on))


def test_frames_are_seen_side_by_side_the_newest_last():
    policy, on = policy_for(SPACES["Box"], frames=2), np.zeros(1, dtype=bool)
    first, second = observations(2)
    player = policy.player(1, deterministic=True)
    player(first[None], ~on)
    found = player(second[None], on)
    seen = torch.from_numpy(np.concatenate([first, second])[None])
    with torch.no_grad():
        assert np.allclose(found, policy.actions.to_numpy(policy.distribution(seen).mode()))


def test_a_policy_draws_at_its_temperature_and_keeps_it_in_its_file(tmp_path):
    policy = Policy(1, actions_of(gym.spaces.Discrete(2)), NetworkShape(), temperature=0.5)
    with torch.no_grad():
        policy.actor.stack.flat[-2:] = torch.tensor([0.0, 0.5 * math.log(3.0)])  # the last biases
    policy.save(tmp_path / "policy.safetensors")
    obs = np.zeros((20_000, 1), np.float32)
    for each in (policy, Policy.load(tmp_path / "policy.safetensors")):
        drawn = each.act(obs, generator=torch.Generator().manual_seed(0))
        assert drawn.mean() == pytest.approx(0.75, abs=0.01)  # odds of 3 instead of √3
        found: Any = each.distribution(torch.zeros(1, 1))
        assert found.log_p[0, 0].exp().tolist() == pytest.approx([0.25, 0.75])
        assert each.act(obs[:9], deterministic=True).tolist() == [1] * 9


@pytest.mark.parametrize(("mine", "others"), [(1.0, 0.5), (0.5, 1.0), (0.5, 2.0), (0.5, 0.5)])
@pytest.mark.parametrize("memory", [0, 4])
def test_a_policy_that_starts_from_one_with_another_temperature_draws_as_that_one(
    memory: int, mine: float, others: float
):
    space = SPACES["uneven"]
    first, then = (policy_for(space, temperature=temperature, memory=memory) for temperature in (others, mine))
    with torch.no_grad():
        for part in first.actor.parameters():
            part += torch.randn(part.shape, generator=torch.Generator().manual_seed(2))
    then.initialise_from(first)
    players = [policy.player(64) for policy in (first, then)]
    for player in players:
        player(observations(), np.ones(64, bool))
    said: list[Any] = [player.log_probs() for player in players]
    assert np.ptp(said[0][:, 0, :2]) > 1.0
    np.testing.assert_allclose(said[1], said[0], atol=1e-5)


@pytest.mark.parametrize(
    "settings",
    [{}, {"frames": 2}, {"memory": 4}, {"adapter": "box_scaled"}],
    ids=["plain", "frames", "gru", "gaussian"],
)
def test_a_number_that_the_first_run_never_saw_vary_changes_nothing_at_once_when_it_does(settings: dict[str, Any]):
    first, then = (policy_for(SPACES["MultiDiscrete"], **settings) for _ in range(2))
    with torch.no_grad():
        for part in first.actor.parameters():
            part += torch.randn(part.shape, generator=torch.Generator().manual_seed(2))
    constant, varying = (torch.from_numpy(np.tile(observations(512), first.frames)) for _ in range(2))
    constant[:, 3::5] = 0.25
    first.normaliser.update(constant)
    then.initialise_from(first)
    before = [said_of(policy, constant, varying) for policy in (first, then)]
    assert torch.equal(*before)  # to the bit, although the number is another one than before
    then.normaliser.update(varying)
    assert then.normaliser.scale[3] > 0.5
    after = said_of(then, constant, varying)
    assert (after - before[1]).abs().max() < 1e-5 < 1.0 < before[1].abs().max()


def said_of(policy: Policy, *observed: torch.Tensor) -> torch.Tensor:
    """Outputs of a policy's network at the first observations of an episode."""
    obs, actor = policy.normaliser(torch.cat(observed)), policy.actor
    with torch.no_grad():
        if actor.gru is None:
            return actor(obs)
        return actor.step(obs, actor.gru.start(len(obs)), torch.ones(len(obs), dtype=torch.bool))[0]


def test_a_greedy_policy_never_draws():
    greedy, drawing = (policy_for(SPACES["MultiDiscrete"], greedy=greedy) for greedy in (True, False))
    expected = drawing.act(observations(), deterministic=True)
    assert np.array_equal(greedy.act(observations()), expected)
    assert not np.array_equal(drawing.act(observations()), expected)


def test_a_greedy_policy_is_saved_as_one(tmp_path):
    policy_for(SPACES["MultiDiscrete"], greedy=True).save(tmp_path / "policy.safetensors")
    loaded = Policy.load(tmp_path / "policy.safetensors")
    assert loaded.greedy and np.array_equal(loaded.act(observations()), loaded.act(observations()))


def test_acting_uses_one_thread_of_pytorch_and_leaves_the_callers_number(monkeypatch):
    policy, seen = policy_for(SPACES["Box"]), []  # whose network is PyTorch's
    step = policy.actor.forward
    monkeypatch.setattr(policy.actor, "forward", lambda inputs: seen.append(torch.get_num_threads()) or step(inputs))
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(3)
        policy.act(observations())
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)
    assert seen == [1]


@pytest.mark.parametrize("memory", [0, 4], ids=["compiled", "recurrent"])
def test_a_player_says_how_probable_its_options_are(memory: int):
    shape = NetworkShape((8,), initial="kaiming", memory=memory)
    policy = Policy(5, actions_of(gym.spaces.MultiDiscrete([3, 3])), shape, generator=torch.Generator().manual_seed(1))
    player = policy.player(200, generator=torch.Generator().manual_seed(2))
    assert player.log_probs() is None  # it has seen nothing
    same = np.tile(observations(1)[:, :5], (200, 1))
    counts = np.zeros((2, 3))
    for _ in range(50):
        drawn = player(same, np.ones(200, bool))
        counts += [np.bincount(drawn[:, branch], minlength=3) for branch in (0, 1)]
    log_probs = player.log_probs()
    assert log_probs is not None and log_probs.shape == (200, 2, 3)
    assert np.allclose(np.exp(log_probs).sum(-1), 1.0, atol=1e-6)
    assert np.allclose(counts / 10_000, np.exp(log_probs[0]), atol=0.02)


def test_a_player_of_numbers_has_no_probabilities():
    policy = policy_for(gym.spaces.MultiDiscrete([3, 3]), "box_scaled")
    player = policy.player(2)
    player(observations(2), np.ones(2, bool))
    assert player.log_probs() is None


@pytest.mark.parametrize(
    ("count", "fresh", "told"),
    [
        (3, np.ones(3, bool), r"got 3 observations and fresh of shape \[3\]"),
        (2, np.ones(1, bool), r"got 2 observations and fresh of shape \[1\]"),
        (2, np.ones((2, 1), bool), r"got 2 observations and fresh of shape \[2, 1\]"),
        (2, True, r"got 2 observations and fresh of shape \[\]"),
    ],
)
@pytest.mark.parametrize("settings", [{}, {"frames": 3}], ids=["plain", "frames"])
def test_a_player_refuses_another_number_of_environments(count: int, fresh: Any, told: str, settings: dict):
    player = policy_for(gym.spaces.MultiDiscrete([3, 3]), **settings).player(2)
    with pytest.raises(AlgorithmError, match=f"this player acts in 2 environments, {told}"):
        player(observations(count), fresh)


def test_a_corrected_player_remembers_what_was_done_in_place_of_its_action():
    from tests.image_policies import image_policy

    policy, image = image_policy("mask", 8, memory=0), np.zeros((1, 8, 8, 1), np.uint8)
    begun, later, done = np.ones(1, bool), np.zeros(1, bool), np.array([[2, 0, 1, 2]])
    for actions in (None, done):
        player = policy.player(1, deterministic=True)
        first = player(image, begun)
        if actions is not None:
            player.correct(actions)
        player(image, later)
        expected = policy.distribution(torch.from_numpy(rows_of(image, first if actions is None else actions)))
        found = player.log_probs()
        assert found is not None and np.allclose(found, expected.log_p.detach())  # pyright: ignore[reportAttributeAccessIssue]
