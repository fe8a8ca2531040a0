"""Attributes of vector environments, also of those in which Gymnasium wraps single environments."""

from typing import Any

from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv


def env_attribute(env: Any, name: str, default: Any = None) -> Any:
    """Return an attribute of the environment beneath all wrappers.

    A `SyncVectorEnv` or an `AsyncVectorEnv` that lacks it has that of its first single environment.
    """
    base: Any = getattr(env, "unwrapped", env)
    if hasattr(base, name) or not isinstance(base, SyncVectorEnv | AsyncVectorEnv):
        return getattr(base, name, default)
    # A process that is asked for an attribute that it does not have ends.
    return base.call(name)[0] if all(base.call("has_wrapper_attr", name)) else default
