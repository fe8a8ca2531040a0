"""PPO of Stable-Baselines3 with convolutions, on frames of many environments that are drawn in one call.

pip install '.[sb3]'    # in a clone of Thalweg
python examples/interop/stable_baselines3_ppo.py
"""

import argparse

from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.evaluation import evaluate_policy  # pyright: ignore[reportMissingImports]

import thalweg  # noqa: F401  registers the ids
from thalweg.interop.stable_baselines3 import make_vec_env
from thalweg.render import Camera


def main() -> None:
    """Train, evaluate and save a policy."""
    parser = argparse.ArgumentParser(description="PPO of Stable-Baselines3 on frames of a river")
    parser.add_argument("--steps", type=int, default=200_000, help="steps of all environments together")
    parser.add_argument("--envs", type=int, default=16, help="number of environments")
    parser.add_argument("--out", default="ppo_river", help="file of the policy, without .zip")
    arguments = parser.parse_args()

    options = {"world_seeds": "0:4", "camera": Camera(64, 64), "quality": "fast", "max_steps": 200}
    env = make_vec_env("thalweg/Easy-v0", arguments.envs, seed=0, **options)
    model = PPO("CnnPolicy", env, n_steps=128, batch_size=256, n_epochs=4, seed=0)
    model.learn(arguments.steps)
    mean, deviation = evaluate_policy(model, env, n_eval_episodes=2 * arguments.envs)
    print(f"mean return {mean:.2f} ± {deviation:.2f}")
    model.save(arguments.out)


if __name__ == "__main__":
    main()
