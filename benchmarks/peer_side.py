"""One side of the comparison in its own process: it creates its environment, then steps it as ordered.

`peer.py` starts one for each line of its table. It also runs under the old Python that Safety-Gymnasium needs, so it
imports Thalweg only where it is needed. Orders are lines of JSON on standard input, answers lines of JSON
on standard output: `{"seconds": 4}` is answered by the units of work done and the seconds they took, `{"pictures":
path, "count": 5}` by the path once frames of so many starts, uint8 [count, size, size, 3], lie there. It ends with its
input.

Both sides are used as their own guides say: `make` for one environment, the vector environment for several, actions
drawn from the action space. A unit is a step of one environment, or of the kind `frame` a frame alone.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from typing import Any

import numpy as np

TASK = "SafetyPointGoal1Vision-v0"
LEVEL = "thalweg/Medium-v0"
NEVER = 10**9


class Side:
    """Common part of both sides; each creates its own `env` first."""

    env: Any

    def __init__(self, kind: str, count: int):
        self.kind, self.count = kind, count
        self.env.reset(seed=0)
        self.work = self.draw if kind == "frame" else self.step

    def step(self) -> None:
        *_, terminated, truncated, _ = self.env.step(self.env.action_space.sample())
        if self.kind != "vector" and (terminated or truncated):
            self.env.reset()

    def draw(self) -> None:
        """Draw one frame without a step."""
        raise NotImplementedError

    def picture(self, seed: int) -> np.ndarray:
        """Return the first frame of an episode, uint8 [..., size, size, 3]."""
        raise NotImplementedError


class Thalweg(Side):
    """Thalweg's Medium with its defaults: RGB and water mask."""

    def __init__(self, kind: str, count: int, size: int):
        import gymnasium

        import thalweg  # noqa: F401  registers its environments

        self.env = gymnasium.make_vec(LEVEL, num_envs=count) if kind == "vector" else gymnasium.make(LEVEL)
        if kind == "frame":
            from thalweg.env import sample_starts
            from thalweg.render import Camera, Renderer
            from thalweg.world import load_or_build

            world = load_or_build("Medium", 0)
            self.renderer = Renderer([world], Camera(height_px=size, width_px=size))
            self.poses, self.drawn = sample_starts(world, 64, 0), 0
        super().__init__(kind, count)

    def draw(self) -> None:
        self.renderer.render(self.poses[self.drawn % len(self.poses)][None])
        self.drawn += 1

    def picture(self, seed: int) -> np.ndarray:
        return self.env.reset(seed=seed)[0][..., :3]


class SafetyGymnasium(Side):
    """Safety-Gymnasium's vision task: RGB and some sensors, drawn by MuJoCo through OpenGL.

    Its episodes are endless here: a reset rebuilds the whole scene, which takes about a second, and would fall into a
    measurement by chance. So the time of its resets is not counted.
    """

    def __init__(self, kind: str, count: int, size: int):
        import gymnasium
        import safety_gymnasium  # pyright: ignore[reportMissingImports]

        config = {**gymnasium.spec(TASK).kwargs["config"], "vision_env_conf.vision_size": (size, size)}
        options = {"config": config, "max_episode_steps": NEVER}
        if kind == "vector":
            self.env = safety_gymnasium.vector.make(TASK, num_envs=count, wrappers=endless, **options)
        else:
            self.env = endless(safety_gymnasium.make(TASK, **options))
        super().__init__(kind, count)

    def draw(self) -> None:
        self.env.unwrapped.task._obs_vision()

    def picture(self, seed: int) -> np.ndarray:
        return self.env.reset(seed=seed)[0]["vision"]


def endless(env: Any) -> Any:
    """Return the environment of Safety-Gymnasium without its own step limit."""
    env.unwrapped.task.num_steps = NEVER
    return env


SIDES = {"Thalweg": Thalweg, "Safety-Gymnasium": SafetyGymnasium}


def opengl() -> str:
    """Return the renderer of MuJoCo with the current `MUJOCO_GL`, as OpenGL reports it."""
    import mujoco  # pyright: ignore[reportMissingImports]

    context = mujoco.GLContext(64, 64)
    context.make_current()
    from OpenGL import GL  # pyright: ignore[reportMissingImports]

    return f"{GL.glGetString(GL.GL_RENDERER).decode()}, OpenGL {GL.glGetString(GL.GL_VERSION).decode()}"


def answer(side: Side, order: dict) -> dict:
    """Carry out one order."""
    if "pictures" in order:
        np.save(order["pictures"], np.stack([side.picture(seed) for seed in range(order["count"])]))
        return {"saved": order["pictures"]}
    units, start = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - start) < order["seconds"]:
        side.work()
        units += side.count
    return {"units": units, "seconds": elapsed}


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of libraries must not mix with the answers
    if sys.argv[1] == "opengl":
        print(json.dumps(opengl()), file=answers, flush=True)
        return
    name, kind, count, size = sys.argv[1:]
    side = SIDES[name](kind, int(count), int(size))
    start = time.perf_counter()
    frame = side.picture(seed=1)
    ready = {"reset_s": time.perf_counter() - start, "frame": frame.shape[-3:], "python": platform.python_version()}
    side.work()
    print(json.dumps(ready), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(side, json.loads(line))), file=answers, flush=True)
    side.env.close()


if __name__ == "__main__":
    main()
