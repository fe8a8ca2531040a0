"""Policies with eyes: what they see, their memory of actions, their files, and what they refuse."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import module_state
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.memory import Sequences
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.vision import Convolutions, Eyes, LastOptions, rows_of

EYES = Eyes((16, 16, 3), (4, 6), 8)
ACTIONS = actions_of(gym.spaces.MultiDiscrete([3, 3, 3, 3]))


def policy(memory: int = 5, eyes: Eyes = EYES) -> Policy:
    shape = NetworkShape((7,), memory=memory, eyes=eyes)
    generator = torch.Generator().manual_seed(0)
    return Policy(eyes.pixels + ACTIONS.count, ACTIONS, shape, generator=generator)


def images(count: int, seed: int = 0, eyes: Eyes = EYES) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, *eyes.image), dtype=np.uint8)


def test_features_are_those_of_the_layers_by_hand():
    """One filter that copies the mean of each patch, and a linear layer that adds them: the image's mean."""
    eyes = Eyes((8, 8, 1), (1,), 1)
    convolutions = Convolutions(eyes, (3, 3), torch.Generator().manual_seed(0))
    first = convolutions.convolutions[0]
    with torch.no_grad():
        first.weight.fill_(1 / 16)
        first.bias.fill_(2.0)  # above the rectifier's corner
        convolutions.linear.weight.fill_(1 / 4)
        convolutions.linear.bias.zero_()
    image = images(1, eyes=eyes)
    found = convolutions(torch.from_numpy(rows_of(image, np.array([[-1, 2]]))))
    assert found[0, 0].item() == pytest.approx(image.mean() / 128 - 1 + 2, rel=1e-5)
    assert found[0, 1:].tolist() == [0.0, 1.0]  # no last action of the first branch, option 2 of the other


def test_making_and_loading_one_leaves_the_global_generator_alone(tmp_path: Path):
    before = torch.get_rng_state()
    policy().save(tmp_path / "policy.safetensors")
    Policy.load(tmp_path / "policy.safetensors")
    assert torch.equal(torch.get_rng_state(), before)


def test_initial_weights_are_those_that_the_generator_draws():
    """In the layout that convolutions compute with, in the order of the layers."""
    made, generator = policy(memory=0).actor.eyes, torch.Generator().manual_seed(0)
    assert made is not None
    for layer in (made.convolutions[0], made.convolutions[2], made.linear):
        bound = 1.0 / layer.weight[0].numel() ** 0.5  # pyright: ignore
        for part in (layer.weight, layer.bias):
            expected = torch.empty_like(part).uniform_(-bound, bound, generator=generator)  # pyright: ignore
            assert torch.equal(part, expected) and part.is_contiguous(  # pyright: ignore
                memory_format=torch.channels_last if part.dim() == 4 else torch.contiguous_format  # pyright: ignore
            )


def test_up_to_three_options_are_numbers_from_minus_one_and_none_is_zero():
    last = torch.tensor([[0, 0, 0], [1, 1, 1], [1, 2, 2], [1, 2, 3]], dtype=torch.uint8)
    plain = torch.where(last > 0, last.float() - 2.0, 0.0)
    assert torch.equal(LastOptions((1, 2, 3), torch.device("cpu"))(last), plain)


@pytest.mark.parametrize("size", [4, 5, 9, 255])
def test_many_options_are_numbers_up_to_one_and_none_is_another(size: int):
    options = LastOptions((3, size), torch.device("cpu"))
    found = options(torch.stack([torch.arange(size + 1).clamp(max=3), torch.arange(size + 1)], 1))
    assert found[:4, 0].tolist() == [0.0, -1.0, 0.0, 1.0]
    assert found[:, 1].tolist() == pytest.approx(np.linspace(-1.0, 1.0, size + 1).tolist(), abs=1e-6)


def many_options(path: Path) -> tuple[Policy, np.ndarray]:
    """A policy with a branch of nine options, saved, and rows in which each of them was the last."""
    actions = actions_of(gym.spaces.MultiDiscrete([3, 9]))
    shape = NetworkShape((7,), initial="kaiming", eyes=EYES)
    made = Policy(EYES.pixels + 2, actions, shape, generator=torch.Generator().manual_seed(0))
    made.save(path)
    last = np.stack([np.full(9, 1), np.arange(9)], 1)
    return made, rows_of(np.repeat(images(1), 9, 0), last)


def test_a_file_of_an_earlier_version_sees_many_options_as_it_learnt_to(tmp_path: Path):
    path = tmp_path / "policy.safetensors"
    made, rows = many_options(path)
    seen = torch.from_numpy(rows)
    loaded = Policy.load(path)
    with torch.no_grad():
        assert torch.equal(loaded.actor(seen), made.actor(seen))
        assert made.actor.seen(seen)[:, -1].abs().max() == 1.0  # pyright: ignore[reportIndexIssue]
        with safe_open(path, framework="numpy") as file:
            header = json.loads(file.metadata()["thalweg_policy"])
        del header["last_options"]
        save_file(load_file(path), path, {"thalweg_policy": json.dumps(header)})
        for _ in range(2):
            early = Policy.load(path)
            assert early.actor.seen(seen)[:, -1].tolist() == [-1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]  # pyright: ignore
            early.save(path)  # as it was read
    with pytest.raises(AlgorithmError, match="last_options is scaled here and plain there"):
        made.initialise_from(early)


def test_a_player_remembers_its_last_actions_until_the_episode_ends():
    player = policy(memory=0).player(3, deterministic=True)
    fresh = np.array([True, True, True])
    first = player(images(3), fresh)
    seen = []
    raw = player.raw
    player.raw = lambda obs, fresh: seen.append(obs.numpy()) or raw(obs, fresh)
    player(images(3, 1), np.array([False, True, False]))
    last = seen[0][:, EYES.pixels :]
    assert last[0].tolist() == (first[0] + 1).tolist() and last[2].tolist() == (first[2] + 1).tolist()
    assert last[1].tolist() == [0, 0, 0, 0]
    assert np.array_equal(seen[0][:, : EYES.pixels], images(3, 1).reshape(3, -1))


def test_sequences_give_what_steps_give():
    made = policy()
    rng = np.random.default_rng(1)
    length, count = 6, 3
    options = rng.integers(0, 3, (length, count, 4))
    rows = torch.from_numpy(np.stack([rows_of(images(count, step), options[step]) for step in range(length)]))
    fresh = torch.from_numpy(rng.random((length, count)) < 0.3)
    assert made.actor.gru is not None
    start = torch.randn(count, 5, generator=torch.Generator().manual_seed(2))
    whole = made.actor(Sequences(rows, fresh, {"actor": start}, torch.arange(length * count)))
    state, found = start, []
    for step in range(length):
        parameters, state = made.actor.step(rows[step], state, fresh[step])
        found.append(parameters)
    assert torch.allclose(whole, torch.cat(found), atol=1e-5)


@pytest.mark.parametrize("memory", [0, 5])
def test_a_file_gives_the_same_actions(memory: int, tmp_path: Path):
    made = policy(memory)
    made.save(tmp_path / "policy.safetensors")
    loaded = Policy.load(tmp_path / "policy.safetensors")
    assert loaded.shape == made.shape
    before, after = made.player(2, deterministic=True), loaded.player(2, deterministic=True)
    for step in range(4):
        fresh = np.full(2, step == 0)
        assert np.array_equal(before(images(2, step), fresh), after(images(2, step), fresh))


def test_a_player_keeps_no_image_also_not_of_an_older_state():
    made = policy(memory=4).player(2, deterministic=True)
    assert made.state()["frames"].size == 0
    made.load_state(made.state() | {"frames": np.zeros((2, 1, made.policy.obs_size), np.float32)})
    assert made.state()["frames"].size == 0


def test_a_player_resumes_from_its_state():
    made = policy()
    player, other = made.player(2, deterministic=True), made.player(2, deterministic=True)
    player(images(2), np.ones(2, bool))
    other.load_state(player.state())
    for step in range(1, 4):
        expected = player(images(2, step), np.zeros(2, bool))
        assert np.array_equal(other(images(2, step), np.zeros(2, bool)), expected)


@pytest.mark.parametrize("wrong", [images(2).astype(np.float32), images(2)[:, :8], images(2)[..., :1]])
def test_other_images_are_refused(wrong: np.ndarray):
    with pytest.raises(AlgorithmError, match=r"this policy takes images uint8 \[N, 16, 16, 3\], got"):
        policy().player(2)(wrong, np.ones(2, bool))


def test_a_file_has_no_statistics_of_pixels_and_one_that_has_them_is_read(tmp_path: Path):
    made, path = policy(), tmp_path / "policy.safetensors"
    made.save(path)
    tensors = load_file(path)
    assert set(tensors) == {f"actor.{name}" for name in module_state(made.actor)}
    moments = dict.fromkeys(("normaliser.mean", "normaliser.square"), np.zeros(made.obs_size))
    with safe_open(path, framework="numpy") as file:
        save_file(tensors | moments, path, file.metadata())
    assert np.array_equal(
        Policy.load(path).player(2, deterministic=True)(images(2), np.ones(2, bool)),
        made.player(2, deterministic=True)(images(2), np.ones(2, bool)),
    )


def test_a_policy_starts_only_from_one_with_the_same_eyes():
    other = policy(eyes=Eyes((16, 16, 3), (4, 8), 8))
    with pytest.raises(AlgorithmError, match=r"filters is \(4, 6\) here and \(4, 8\) there"):
        policy().initialise_from(other)
    policy().initialise_from(policy())


def test_a_policy_that_sees_other_channels_is_told_apart_by_the_observation():
    other = policy(eyes=Eyes((16, 16, 4), EYES.filters, EYES.features))
    with pytest.raises(AlgorithmError, match=r"images of rgb.mask have 4 channels, of rgb 3 and of mask 1: choose"):
        policy().initialise_from(other)


def test_a_corrected_player_counts_options_from_where_the_environment_counts():
    actions = actions_of(gym.spaces.MultiDiscrete([3, 3], start=[1, -2]))
    generator = torch.Generator().manual_seed(0)
    player = Policy(EYES.pixels + 2, actions, NetworkShape((7,), eyes=EYES), generator=generator).player(1)
    player(images(1), np.ones(1, bool))
    player.correct(np.array([[3, -2]]))
    assert player.state()["last"].tolist() == [[2, 0]]
