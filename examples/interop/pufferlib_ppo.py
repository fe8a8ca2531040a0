"""PPO on the codes of an encoder, with environments and policies of PufferLib.

pip install '.[learn]'    # in a clone of Thalweg
pip install --no-deps -r tests/interop/locks/pufferlib.lock
python examples/interop/pufferlib_ppo.py

The second command leaves out what PufferLib pins, another PyTorch among it. The update stands here, since PufferLib's
own, `PuffeRL.train`, needs a compiled extension and CUDA's libraries.
"""

import argparse

import numpy as np
import torch
from pufferlib.models import Default  # pyright: ignore[reportMissingImports]
from pufferlib.pytorch import sample_logits  # pyright: ignore[reportMissingImports]

import thalweg  # noqa: F401  registers the ids
from thalweg.interop.pufferlib import RiverPufferEnv

GAMMA, LAMBDA, CLIP = 0.99, 0.95, 0.2


def advantages(rewards: torch.Tensor, values: torch.Tensor, ends: torch.Tensor, last: torch.Tensor) -> torch.Tensor:
    """Return generalised advantages [T, N] (Schulman et al. 2016, eq. 16) of rewards, values and ends [T, N], and the
    values [N] of the states after them. Time limits count as ends, as in PufferLib."""
    result, carried = torch.zeros_like(rewards), torch.zeros_like(last)
    for step in reversed(range(len(rewards))):
        goes_on = 1 - ends[step]
        error = rewards[step] + GAMMA * goes_on * last - values[step]
        carried = error + GAMMA * LAMBDA * goes_on * carried
        result[step], last = carried, values[step]
    return result


def in_words(episodes: list[dict[str, float]]) -> str:
    """Return the number of episodes, and their mean return and cost if there are any."""
    if not episodes:
        return "no episode ended"
    means = [np.mean([told[name] for told in episodes]) for name in ("episode_return", "episode_cost")]
    return f"{len(episodes)} episodes, mean return {means[0]:.2f}, mean cost {means[1]:.2f}"


def main() -> None:
    """Train a policy, and print the mean return and cost of the episodes of each rollout."""
    parser = argparse.ArgumentParser(description="PPO with PufferLib's policy on codes of a river's frames")
    parser.add_argument("--steps", type=int, default=200_000, help="steps of all environments together")
    parser.add_argument("--envs", type=int, default=16, help="number of environments")
    parser.add_argument("--length", type=int, default=128, help="steps of each environment in a rollout")
    arguments = parser.parse_args()

    torch.manual_seed(0)
    options = {"encoder": "default", "quality": "fast", "max_steps": 200}
    env = RiverPufferEnv("thalweg/Easy-v0", arguments.envs, seed=0, **options)
    policy = Default(env, hidden_size=64)
    optimiser = torch.optim.Adam(policy.parameters(), lr=3e-4)
    obs, _ = env.reset()
    for steps in range(0, arguments.steps, arguments.envs * arguments.length):
        rows, episodes = [], []
        for _ in range(arguments.length):
            seen = torch.as_tensor(obs.copy())  # `obs` is PufferLib's buffer, which the next step fills
            with torch.no_grad():
                logits, value = policy.forward_eval(seen)
                action, logprob, _ = sample_logits(logits)
            obs, reward, terminal, truncation, infos = env.step(action.numpy())
            end = torch.as_tensor(terminal | truncation).float()
            rows.append((seen, action, logprob, value.flatten(), torch.as_tensor(reward.copy()), end))
            episodes += infos
        seen, action, logprob, value, reward, end = (torch.stack(column) for column in zip(*rows, strict=True))
        with torch.no_grad():
            gain = advantages(reward, value, end, policy.forward_eval(torch.as_tensor(obs))[1].flatten())
        target, gain = (gain + value).flatten(), gain.flatten()
        gain = (gain - gain.mean()) / (gain.std() + 1e-8)
        seen, action, logprob = seen.flatten(0, 1), action.flatten(0, 1), logprob.flatten()
        for _ in range(4):
            for batch in torch.randperm(len(gain)).split(256):
                logits, estimate = policy(seen[batch])
                _, new, entropy = sample_logits(logits, action=action[batch])
                ratio = (new - logprob[batch]).exp()
                clipped = torch.minimum(ratio * gain[batch], ratio.clamp(1 - CLIP, 1 + CLIP) * gain[batch])
                error = (estimate.flatten() - target[batch]) ** 2
                optimiser.zero_grad()
                (-clipped + 0.5 * error - 0.01 * entropy).mean().backward()
                optimiser.step()
        print(f"step {steps}: {in_words(episodes)}")


if __name__ == "__main__":
    main()
