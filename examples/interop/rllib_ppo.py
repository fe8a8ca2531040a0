"""PPO of RLlib with convolutions, on frames of the native vector environment; no adapter is needed.

pip install 'ray[rllib]'
python examples/interop/rllib_ppo.py
"""

import argparse
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv
from gymnasium.wrappers.vector import TransformObservation
from ray.rllib.algorithms.ppo import PPOConfig  # pyright: ignore[reportMissingImports]
from ray.rllib.core.rl_module.default_model_config import (  # pyright: ignore[reportMissingImports]
    DefaultModelConfig,
)
from ray.tune.registry import register_env  # pyright: ignore[reportMissingImports]

OPTIONS: dict[str, Any] = {"observation": "rgb", "action": "continuous", "quality": "fast", "max_steps": 200}


def rivers(config: dict[str, Any]) -> VectorEnv:
    """Return environments whose frames are float32 [N, 64, 64, 3] in 0..1, as RLlib's own networks take them.

    RLlib expects the first observation of an episode one step after the end of the last one: NEXT_STEP.
    """
    import thalweg  # noqa: F401  registers the ids, also in Ray's own processes
    from thalweg.render import Camera

    options = {**OPTIONS, "camera": Camera(64, 64), "autoreset_mode": "next_step"}
    envs = gymnasium.make_vec("thalweg/Easy-v0", num_envs=config["num_envs"], **options)
    floats = Box(0, 1, (64, 64, 3), np.float32)
    many = gymnasium.vector.utils.batch_space(floats, envs.num_envs)
    return TransformObservation(envs, lambda frames: np.float32(frames) / np.float32(255), many, floats)


def in_words(found: dict[str, Any]) -> str:
    """Return the number of episodes of an iteration, with the mean return and cost of the last 100 if one has ended."""
    if "episode_cost" not in found:  # what is logged at the end of an episode
        return "no episode ended"
    means = f"mean return {found['episode_return_mean']:.2f}, mean cost {found['episode_cost']:.2f}"
    return f"{found['num_episodes']:.0f} episodes, {means}"


def main() -> None:
    """Train a policy, and print the mean return and cost of the episodes of each iteration."""
    parser = argparse.ArgumentParser(description="PPO of RLlib on frames of a river")
    parser.add_argument("--iterations", type=int, default=100, help="number of iterations")
    parser.add_argument("--envs", type=int, default=16, help="number of environments")
    parser.add_argument("--length", type=int, default=128, help="steps of each environment in an iteration")
    arguments = parser.parse_args()

    def note_cost(episode: Any, metrics_logger: Any, **_: Any) -> None:
        cost = sum(info["cost"] for info in episode.get_infos()[1:])
        metrics_logger.log_value("episode_cost", cost, reduce="mean", window=100)

    batch = arguments.envs * arguments.length
    register_env("rivers", rivers)
    config = (
        PPOConfig()
        .environment("rivers")
        .env_runners(
            num_env_runners=0,  # frames are drawn in this process
            num_envs_per_env_runner=arguments.envs,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .callbacks(on_episode_end=note_cost)
        .rl_module(model_config=DefaultModelConfig(conv_filters=[(16, 8, 4), (32, 4, 2)], conv_activation="relu"))
        .training(train_batch_size_per_learner=batch, minibatch_size=min(256, batch), num_epochs=4, lr=3e-4)
        .debugging(seed=0)
    )
    algorithm = config.build_algo()
    for iteration in range(arguments.iterations):
        print(f"iteration {iteration}: {in_words(algorithm.train()['env_runners'])}")
    algorithm.stop()


if __name__ == "__main__":
    main()
