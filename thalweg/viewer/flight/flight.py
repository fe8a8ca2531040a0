"""One flight: an episode in an environment of one, with everything that is told of it and kept for its file."""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from thalweg.bench.evaluate.episodes import ALL_REASONS, REASON_TEXT, share_ahead
from thalweg.env import DoneReason, RiverVectorEnv
from thalweg.env.frame_renderer import Views
from thalweg.env.task.motion import wrap_angle
from thalweg.viewer.flight.course_map import props_on_map
from thalweg.viewer.flight.options import FlightOptions
from thalweg.world import World

RUNNING = int(DoneReason.RUNNING)


def env_of(world: World, options: FlightOptions) -> RiverVectorEnv:
    """Return the environment of flights with these options; raises `ConfigError` for options that do not go
    together, and `UnsafePoseError` where there is no safe start.

    It takes a step first: the kernels are compiled while the page says that it prepares, not in the midst of a flight.
    """
    env = RiverVectorEnv([world], 1, options.rules, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=options.seed)
    env.step(env.pilot_actions())
    return env


class Flight:
    """An episode from the start that its seed chooses."""

    def __init__(self, env: RiverVectorEnv, options: FlightOptions) -> None:
        """Start the episode in an environment of `env_of`; raises `UnsafePoseError` where there is no safe start."""
        self.env, self.options = env, options
        self.world = env.worlds[0]
        _, info = env.reset(seed=options.seed)
        self.ahead = float(share_ahead(env)[0])
        """Share of an open course that lies ahead of the start, see `share_ahead`; NaN on a loop."""
        self.info: dict[str, Any] = info
        """Of the last step, or of the start."""
        self.terminated = False
        """Whether the rules ended it; the step limit of the paper's task does not."""
        self.actions: list[np.ndarray] = []
        """[4] of each step, as the environment took them."""
        self.pilots: list[str] = []
        """Who flew each step."""
        self.rewards: list[float] = []
        self.costs: list[np.ndarray] = []
        """[K] of each step."""
        self.poses = [info["pose"][0].copy()]
        """[4] at the start, and after each step."""
        self.times_s = [float(env.state.time_s[0])]
        """Clock of the water at the start, and after each step."""

    @property
    def steps(self) -> int:
        """Number of steps that were flown."""
        return len(self.actions)

    @property
    def reason(self) -> int:
        """Code of `thalweg.env.DoneReason`, -1 while the flight goes on."""
        return int(self.info["done_reason"][0]) if self.actions else RUNNING

    @property
    def ended(self) -> bool:
        """Whether the episode has ended."""
        return self.reason != RUNNING

    def step(self, action: np.ndarray, pilot: str) -> None:
        """Take an action [4] of the environment's space; raises `ActionError` for another one."""
        _, reward, terminated, _, self.info = self.env.step(np.asarray(action)[None])
        self.terminated = bool(terminated[0])
        self.actions.append(np.array(action))
        self.pilots.append(pilot)
        self.rewards.append(float(reward[0]))
        self.costs.append(self.info["costs"][0].copy())
        self.poses.append(self.info["pose"][0].copy())
        self.times_s.append(float(self.env.state.time_s[0]))

    def views(self, share: float = 1.0) -> Views:
        """Return what is seen when a share of the last step is behind the camera; at 1 it is the current state."""
        views = self.env.frames.views(self.env.state)
        if share >= 1.0 or not self.actions:
            return views
        before, now = self.poses[-2:]
        pose = before + share * (now - before)
        pose[3] = before[3] + share * wrap_angle(now[3] - before[3])
        time_s = self.times_s[-2] + share * (self.times_s[-1] - self.times_s[-2])
        return views._replace(pose=pose[None], time_s=np.array([time_s]))

    def status(self) -> dict[str, Any]:
        """Return the numbers of the current state as plain data."""
        state, limits = self.env.state, self.env.config
        totals = np.sum(self.costs, axis=0) if self.costs else np.zeros(len(self.env.cost_kinds))
        return {
            "step": self.steps,
            "max_steps": int(self.env.courses.max_steps[0]),
            "pose": [round(float(value), 3) for value in self.poses[-1]],
            "height_m": round(self._height_m(), 2),
            "reward": self.rewards[-1] if self.rewards else 0.0,
            "return": float(np.cumsum(self.rewards)[-1]) if self.rewards else 0.0,
            "cost": float(self.costs[-1].sum()) if self.costs else 0.0,
            "costs": dict(zip(self.env.cost_kinds, map(float, totals), strict=True)),
            "progress": float(self.info["progress"][0]),
            "idle": int(state.idle[0]),
            "max_idle": int(limits.max_idle_steps),
            "action": [] if not self.actions else [round(float(value), 3) for value in self.actions[-1]],
            "pilot": self.pilots[-1] if self.pilots else "",
            "wind": self._wind(),
            "ended": REASON_TEXT[ALL_REASONS[self.reason]] if self.ended else "",
            "props": props_on_map(self.env.props()),
        }

    def _height_m(self) -> float:
        """Height above the water level of the nearest sample of the course."""
        river, pose = self.world.river, self.poses[-1]
        nearest = np.argmin(((river.position_m - pose[:2]) ** 2).sum(axis=1))
        return float(pose[2] - river.level_m[nearest])

    def _wind(self) -> list[float]:
        """Wind of the next step towards east and north in m/s; empty without any."""
        return [round(float(value), 2) for value in self.info["wind"][0, :2]] if "wind" in self.info else []
