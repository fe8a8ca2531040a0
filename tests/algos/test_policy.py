import gymnasium as gym
import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from thalweg.algos import About, AlgorithmError, Policy
from thalweg.algos.actions import Actions, actions_of

SPACES = {
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 3, 3, 3]),
    "uneven": gym.spaces.MultiDiscrete([2, 5], start=[1, -2]),
    "Discrete": gym.spaces.Discrete(4, start=7),
    "Box": gym.spaces.Box(np.array([-2, 0], np.float32), np.array([2, 1], np.float32), dtype=np.float32),
    "unbounded": gym.spaces.Box(-np.inf, np.inf, (2, 2), np.float64),
}


def policy_for(space: gym.Space, **settings) -> Policy:
    return Policy(5, actions_of(space, **settings), (16,), generator=torch.Generator().manual_seed(1))


def observations(count: int = 64) -> np.ndarray:
    return np.random.default_rng(0).standard_normal((count, 5)).astype(np.float32)


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
def test_every_action_belongs_to_the_space(space: gym.Space):
    for action in policy_for(space).act(observations(), generator=torch.Generator().manual_seed(0)):
        assert space.contains(action if action.shape else np.int64(action))


def test_the_discretised_gaussian_gives_options_of_the_space():
    space = SPACES["uneven"]
    for affine in (False, True):
        policy = policy_for(space, head="gaussian_discretised", affine=affine)
        assert all(space.contains(action) for action in policy.act(observations()))


def test_a_fresh_policy_draws_every_option_alike():
    drawn = policy_for(SPACES["MultiDiscrete"]).act(observations(8000), generator=torch.Generator().manual_seed(0))
    for option in range(3):
        assert (drawn == option).mean(0) == pytest.approx([1 / 3] * 4, abs=0.02)


def test_minus_one_to_one_spans_a_bounded_box():
    actions = actions_of(SPACES["Box"])
    found = actions.to_env(torch.tensor([[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0], [9.0, 9.0]]))
    assert found.tolist() == [[-2, 0], [0, 0.5], [2, 1], [2, 1]]


def test_the_same_generator_state_draws_the_same_actions():
    policy = policy_for(SPACES["MultiDiscrete"])
    first, second = (policy.act(observations(), generator=torch.Generator().manual_seed(3)) for _ in range(2))
    assert np.array_equal(first, second)


def test_a_deterministic_action_is_the_most_probable_and_needs_no_draw():
    policy = policy_for(SPACES["MultiDiscrete"])
    log_p = policy.distribution(torch.from_numpy(observations())).log_p  # pyright: ignore[reportAttributeAccessIssue]
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


def test_the_wrong_number_of_observations_names_both():
    with pytest.raises(AlgorithmError, match=r"sees \[N, 5\] numbers, got an array of shape \(4, 16\)"):
        policy_for(SPACES["Discrete"]).act(np.zeros((4, 16), np.float32))


@pytest.mark.parametrize("space", [gym.spaces.MultiBinary(3), gym.spaces.Text(3), gym.spaces.Box(0, 9, (2,), np.int64)])
def test_an_unsupported_space_is_refused(space: gym.Space):
    with pytest.raises(AlgorithmError, match="must be Discrete, MultiDiscrete"):
        actions_of(space)


def test_a_discretised_head_on_a_box_is_refused():
    with pytest.raises(AlgorithmError, match="for discrete actions"):
        actions_of(SPACES["Box"], head="gaussian_discretised")


def test_files_that_are_no_policies_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    with pytest.raises(AlgorithmError, match="no policy file"):
        Policy.load(path)
    policy_for(SPACES["Discrete"]).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-10])
    with pytest.raises(AlgorithmError, match="not a whole policy file"):
        Policy.load(path)
    save_file({"x": np.zeros(1)}, path)
    with pytest.raises(AlgorithmError, match="of format none"):
        Policy.load(path)
    path.write_bytes(whole.replace(b": [16]", b": [99]"))
    with pytest.raises(AlgorithmError, match="shapes"):
        Policy.load(path)


def test_an_action_record_survives_its_plain_data():
    for space in SPACES.values():
        assert Actions.from_data(actions_of(space).as_data()) == actions_of(space)
