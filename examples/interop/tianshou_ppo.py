"""PPO of Tianshou with convolutions, on frames of single environments; no adapter is needed.

pip install tianshou
python examples/interop/tianshou_ppo.py
"""

import argparse
from typing import Any

import gymnasium
import torch
from tianshou.algorithm import PPO  # pyright: ignore[reportMissingImports]
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy  # pyright: ignore[reportMissingImports]
from tianshou.algorithm.optim import AdamOptimizerFactory  # pyright: ignore[reportMissingImports]
from tianshou.data import Collector, VectorReplayBuffer  # pyright: ignore[reportMissingImports]
from tianshou.env import DummyVectorEnv  # pyright: ignore[reportMissingImports]
from tianshou.trainer import OnPolicyTrainerParams  # pyright: ignore[reportMissingImports]
from tianshou.utils.net.common import ModuleWithVectorOutput  # pyright: ignore[reportMissingImports]
from tianshou.utils.net.continuous import ContinuousActorProbabilistic  # pyright: ignore[reportMissingImports]
from tianshou.utils.net.discrete import DiscreteCritic  # pyright: ignore[reportMissingImports]
from torch import nn
from torch.distributions import Independent, Normal

import thalweg  # noqa: F401  registers the ids
from thalweg.render import Camera

OPTIONS = {"observation": "rgb", "action": "continuous", "camera": Camera(64, 64), "quality": "fast"}


class Eye(ModuleWithVectorOutput):
    """Turns frames uint8 [N, 64, 64, 3] into features float32 [N, 1152] by two convolutions."""

    def __init__(self) -> None:
        super().__init__(1152)
        self.convolutions = nn.Sequential(
            nn.Conv2d(3, 16, 8, 4), nn.ReLU(), nn.Conv2d(16, 32, 4, 2), nn.ReLU(), nn.Flatten()
        )

    def forward(self, frames: Any, state: Any = None, info: Any = None) -> tuple[torch.Tensor, Any]:
        return self.convolutions(torch.as_tensor(frames).movedim(-1, 1).float() / 255), state


def in_words(episodes: list[tuple[float, float]]) -> str:
    """Return the number of episodes, and the means of their returns and costs if there are any."""
    if not episodes:
        return "no episode ended"
    means = [sum(values) / len(episodes) for values in zip(*episodes, strict=True)]
    return f"{len(episodes)} episodes, mean return {means[0]:.2f}, mean cost {means[1]:.2f}"


def main() -> None:
    """Train a policy, and print the mean return and cost of the episodes of each epoch."""
    parser = argparse.ArgumentParser(description="PPO of Tianshou on frames of a river")
    parser.add_argument("--epochs", type=int, default=20, help="number of epochs")
    parser.add_argument("--steps", type=int, default=10_000, help="steps of all environments together in an epoch")
    parser.add_argument("--envs", type=int, default=8, help="number of environments")
    parser.add_argument("--length", type=int, default=128, help="steps of each environment between updates")
    arguments = parser.parse_args()

    torch.manual_seed(0)
    envs = DummyVectorEnv(
        [lambda: gymnasium.make("thalweg/Easy-v0", max_steps=200, **OPTIONS) for _ in range(arguments.envs)]
    )
    envs.seed(0)
    space, eye = envs.action_space[0], Eye()
    actor = ContinuousActorProbabilistic(preprocess_net=eye, action_shape=space.shape)
    policy = ProbabilisticActorPolicy(
        actor=actor,
        dist_fn=lambda parameters: Independent(Normal(*parameters), 1),
        action_space=space,
    )
    critic = DiscreteCritic(preprocess_net=eye)  # the value of a state, without an action
    algorithm = PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=3e-4), gae_lambda=0.95)
    batch = arguments.envs * arguments.length
    episodes: list[tuple[float, float]] = []

    def note(episode: Any) -> None:
        episodes.append((episode.rew.sum(), episode.info["cost"].sum()))

    collector = Collector(algorithm, envs, VectorReplayBuffer(batch, arguments.envs), on_episode_done_hook=note)
    trainer = algorithm.create_trainer(
        OnPolicyTrainerParams(
            training_collector=collector,
            epoch_num_steps=arguments.steps,
            collection_step_num_env_steps=batch,
            batch_size=256,
            update_step_num_repetitions=4,
            verbose=False,
            show_progress=False,
        )
    )
    trainer.reset()
    for epoch in range(arguments.epochs):
        episodes.clear()
        trainer.execute_epoch()
        print(f"epoch {epoch}: {in_words(episodes)}")


if __name__ == "__main__":
    main()
