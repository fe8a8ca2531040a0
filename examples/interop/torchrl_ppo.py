"""PPO of TorchRL with convolutions, on frames of many environments; no adapter is needed.

pip install torchrl
python examples/interop/torchrl_ppo.py
"""

import argparse

import torch
from tensordict.nn import TensorDictModule, TensorDictSequential  # pyright: ignore[reportMissingImports]
from tensordict.nn.distributions import NormalParamExtractor  # pyright: ignore[reportMissingImports]
from torch import nn
from torchrl.envs import GymEnv  # pyright: ignore[reportMissingImports]
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator  # pyright: ignore[reportMissingImports]
from torchrl.objectives import ClipPPOLoss  # pyright: ignore[reportMissingImports]
from torchrl.objectives.value import GAE  # pyright: ignore[reportMissingImports]

import thalweg  # noqa: F401  registers the ids
from thalweg.render import Camera


class Eye(nn.Module):
    """Turns frames uint8 [..., 64, 64, 3] into features float32 [..., 1152] by two convolutions."""

    def __init__(self) -> None:
        super().__init__()
        self.convolutions = nn.Sequential(
            nn.Conv2d(3, 16, 8, 4), nn.ReLU(), nn.Conv2d(16, 32, 4, 2), nn.ReLU(), nn.Flatten()
        )

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        planes = frames.reshape(-1, *frames.shape[-3:]).movedim(-1, 1).float() / 255
        return self.convolutions(planes).reshape(*frames.shape[:-3], -1)


def main() -> None:
    """Train a policy and print the mean reward of each rollout."""
    parser = argparse.ArgumentParser(description="PPO of TorchRL on frames of a river")
    parser.add_argument("--steps", type=int, default=200_000, help="steps of all environments together")
    parser.add_argument("--envs", type=int, default=16, help="number of environments")
    parser.add_argument("--length", type=int, default=128, help="steps of each environment in a rollout")
    arguments = parser.parse_args()

    torch.manual_seed(0)
    options = {"observation": "rgb", "action": "continuous", "camera": Camera(64, 64), "quality": "fast"}
    env = GymEnv("thalweg/Easy-v0", num_envs=arguments.envs, max_steps=200, **options)
    env.set_seed(0)
    features = TensorDictModule(Eye(), in_keys=["pixels"], out_keys=["features"])
    mean = nn.Sequential(nn.LazyLinear(64), nn.Tanh(), nn.LazyLinear(8), NormalParamExtractor())
    actor = ProbabilisticActor(
        TensorDictSequential(features, TensorDictModule(mean, in_keys=["features"], out_keys=["loc", "scale"])),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    critic = TensorDictSequential(
        features, ValueOperator(nn.Sequential(nn.LazyLinear(64), nn.Tanh(), nn.LazyLinear(1)), in_keys=["features"])
    )
    with torch.no_grad():
        critic(actor(env.reset()))  # sizes of the layers
    loss, advantage = ClipPPOLoss(actor, critic), GAE(gamma=0.99, lmbda=0.95, value_network=critic)
    optimiser = torch.optim.Adam(loss.parameters(), lr=3e-4)
    for steps in range(0, arguments.steps, arguments.envs * arguments.length):
        with torch.no_grad():
            rollout = advantage(env.rollout(arguments.length, actor, break_when_any_done=False)).reshape(-1)
        for batch in rollout.split(256):
            losses = loss(batch)
            optimiser.zero_grad()
            (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
            optimiser.step()
        reward, cost = rollout["next", "reward"].mean(), rollout["next", "cost"].mean()
        print(f"step {steps}: mean reward {reward:.4f}, mean cost {cost:.4f}")


if __name__ == "__main__":
    main()
