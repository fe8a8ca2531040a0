"""PPOLag of OmniSafe on codes of frames, or on the privileged observation.

docs/other-libraries.md says how to install OmniSafe.

python examples/interop/omnisafe_ppolag.py
"""

import argparse

import omnisafe  # pyright: ignore[reportMissingImports]

import thalweg.interop.omnisafe  # noqa: F401  registers the ids with OmniSafe


def main() -> None:
    """Train a policy and print how its last epoch went."""
    parser = argparse.ArgumentParser(description="PPOLag of OmniSafe on a river")
    parser.add_argument("--steps", type=int, default=200_000, help="steps of all environments together")
    parser.add_argument("--envs", type=int, default=16, help="number of environments")
    parser.add_argument("--encoder", help="encoder of frames, such as default; none: the privileged observation")
    arguments = parser.parse_args()

    epoch = min(arguments.steps, 256 * arguments.envs)
    settings = {
        "train_cfgs": {"total_steps": arguments.steps, "vector_env_nums": arguments.envs, "device": "cpu"},
        "algo_cfgs": {"steps_per_epoch": epoch, "update_iters": 10, "batch_size": 256},
        "lagrange_cfgs": {"cost_limit": 0.1},
        "logger_cfgs": {"use_wandb": False},
        "env_cfgs": {"max_steps": 200} | ({"encoder": arguments.encoder} if arguments.encoder else {}),
    }
    returned, cost, length = omnisafe.Agent("PPOLag", "thalweg/Easy-v0", custom_cfgs=settings).learn()
    print(f"mean return {returned:.2f}, cost {cost:.2f}, {length:.0f} steps")


if __name__ == "__main__":
    main()
