"""The shield: it vetoes moves of a policy that would leave the water remembered from the masks of its camera.

It knows what a vehicle may know: its camera, the masks, its height above the water, and its own moves, which are exact.
It knows no map of the world. N vehicles are shielded side by side.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DEFAULT_CONFIG, ConfigError, EnvConfig, integer_at_least
from thalweg.env.moves import MOVE_OPTIONS, MOVES
from thalweg.env.shield.config import ShieldConfig
from thalweg.env.shield.moves import HEIGHT, PERMITTED, Bounds, Vehicles, advance, change_of, judge
from thalweg.env.shield.sight import Optics, look
from thalweg.env.shield.water_map import WaterMaps, empty_maps, enter_own_place, follow, forget
from thalweg.env.spaces import FORWARD, to_unit_actions
from thalweg.env.task.motion import Pose, UnitAction
from thalweg.render.records.appearance import HALF_H, HALF_W, PITCH, look_rows, look_values

MOVES_FLOAT64 = MOVES.astype(np.float64)
"""[M, 4] the moves that may replace a vetoed one, in the type that the kernel takes."""
DEFAULT_SHIELD = ShieldConfig()


class Screened(NamedTuple):
    """What the shield makes of the moves of K vehicles."""

    actions: np.ndarray
    """[K, 4] int64, the moves to make."""
    verdicts: np.ndarray
    """[K] int64, the verdicts on the moves that were proposed, see `thalweg.env.shield.moves.VERDICTS`."""


class Shield:
    """Shields of N vehicles, each with its own map.

    Call `begin` for each vehicle whose episode begins, then `screen` once in each step, and make exactly the moves that
    it returns: odometry follows them.
    """

    def __init__(self, count: int, config: EnvConfig = DEFAULT_CONFIG, settings: ShieldConfig = DEFAULT_SHIELD) -> None:
        """Create the shields of `count` vehicles at their starts; `config`: the task.

        Raises `ConfigError` for continuous actions, a camera with a lens, or a count below one.
        """
        if config.action != "multidiscrete":
            raise ConfigError(f"the shield judges moves of four branches (multidiscrete), not {config.action} actions")
        if config.camera.lens is not None:
            raise ConfigError(
                "the shield reads masks of a pinhole, not of a camera with a lens: leave config.camera.lens out"
            )
        self.count = integer_at_least("count", count, 1)
        self.config, self.settings, self.limits = config, settings, config.limits
        self.bounds = Bounds(
            float(settings.margin_m),
            int(settings.lookahead),
            int(settings.unknown_is_water),
            int(settings.patience),
            config.min_height_m + settings.spare_m,
            config.max_height_m - settings.spare_m,
            float(settings.floor_m),
            math.radians(settings.max_turn_deg),
        )
        self.maps: WaterMaps = empty_maps(self.count)
        self.vehicles = Vehicles(np.zeros((self.count, 4)), np.zeros((self.count, 2)), np.zeros(self.count, np.int64))
        self.optics = Optics(*(np.zeros(self.count) for _ in Optics._fields))
        self.set_looks(None)

    def set_looks(self, looks: np.ndarray | None) -> None:
        """Set what the cameras are like: looks [N, P], of which only pitch and field of view matter; None: all as the
        task's.

        Raises `RenderError` for another number of looks, or a value out of its range.
        """
        rows = look_rows(look_values(looks, self.count), self.config.camera)
        self.optics.pitch[:] = rows[:, PITCH]
        self.optics.half_width[:], self.optics.half_height[:] = rows[:, HALF_W], rows[:, HALF_H]

    def begin(self, rows: np.ndarray) -> None:
        """Forget everything about the vehicles `rows` [K], which are at their starts.

        Raises `ConfigError` for rows that are not different whole numbers from 0 to N - 1.
        """
        for row in self._checked(rows):
            forget(self.maps, int(row))
            self.vehicles.pose[row], self.vehicles.tail[row], self.vehicles.held[row] = 0.0, 0.0, 0

    def screen(
        self,
        rows: np.ndarray,
        masks: np.ndarray,
        heights: np.ndarray,
        actions: np.ndarray,
        log_probs: np.ndarray | None = None,
    ) -> Screened:
        """Return the moves that the vehicles `rows` [K] make in place of their proposed `actions` [K, 4].

        A permitted move is kept. One that is vetoed for its height is kept but for its vertical option, if another one
        is permitted: level rather than a climb, a climb rather than a descent. Any other is replaced by the permitted
        one that is most probable under `log_probs` [K, 4, 3], the policy's logarithmic probability of each option of
        each branch, or for None by the one that changes the move least. The vehicles' odometry follows the moves.

        Args:
            rows: Vehicles that fly; each is in a call once.
            masks: [K, H, W] uint8, the water masks that they see now.
            heights: [K] float64, their heights above the water in metres.
            actions: [K, 4] integers, their proposed moves.
            log_probs: [K, 4, 3] float64, or None.

        Raises `ConfigError` for rows as in `begin`, masks, heights or log_probs of another shape, or a height that is
        not finite, and `ActionError` for a bad action.
        """
        rows = self._checked(rows)
        count = len(rows)
        if masks.ndim != 3 or len(masks) != count or masks.dtype != np.uint8 or np.shape(heights) != (count,):
            raise ConfigError(
                f"{count} vehicles need masks uint8 [{count}, H, W] and heights [{count}], got {masks.dtype}"
                f" {list(masks.shape)} and {list(np.shape(heights))}"
            )
        heights = np.ascontiguousarray(heights, np.float64)
        if not np.isfinite(heights).all():
            raise ConfigError(f"heights must be finite, not {heights.tolist()}")
        if log_probs is not None and np.shape(log_probs) != (count, 4, 3):
            raise ConfigError(f"{count} vehicles need log_probs [{count}, 4, 3], got {list(np.shape(log_probs))}")
        proposed = to_unit_actions("multidiscrete", actions, count)
        worths = np.zeros((count, len(MOVES_FLOAT64)))
        if log_probs is not None:
            merged = self._with_dead_option_merged(log_probs)
            worths[:] = merged[:, np.arange(MOVE_OPTIONS.shape[1]), MOVE_OPTIONS].sum(-1)
        made, verdicts = np.empty((count, 4)), np.empty(count, np.int64)
        _screen_all(
            (self.maps, self.vehicles, self.optics),
            rows,
            np.ascontiguousarray(masks),
            np.empty(masks.shape[1:], np.uint8),
            heights,
            (self.bounds, self.limits),
            (MOVES_FLOAT64, worths, log_probs is not None),
            proposed,
            (made, verdicts),
        )
        # What is not vetoed stays as it was proposed, backward moves included.
        kept = (verdicts == PERMITTED)[:, None]
        return Screened(np.where(kept, actions, (1 - made).astype(np.int64)), verdicts)

    def _checked(self, rows: np.ndarray) -> np.ndarray:
        """Return rows [K] as int64, in which kernels index without a check; raises `ConfigError`."""
        found = np.asarray(rows)
        if found.ndim != 1 or (found.dtype.kind not in "iu" and found.size):
            raise ConfigError(
                f"rows must be indices of vehicles, whole numbers [K], not {found.dtype} {list(found.shape)}"
                + (": give np.flatnonzero(mask) for a mask" if found.dtype == np.bool_ else "")
            )
        outside = (found < 0) | (found >= self.count)
        if outside.any() or len(np.unique(found)) != len(found):
            raise ConfigError(f"rows must be different numbers from 0 to {self.count - 1}, not {found.tolist()}")
        return np.ascontiguousarray(found, np.int64)

    def _with_dead_option_merged(self, log_probs: np.ndarray) -> np.ndarray:
        """Return logarithmic probabilities [K, 4, 3] in which, where the third option forward is dead, the second one,
        which does the same, has the probability of both."""
        found = np.array(log_probs, np.float64)
        if not (self.config.allow_backward or self.config.task_record.fast_step_m):
            found[:, FORWARD, 1] = np.logaddexp(found[:, FORWARD, 1], found[:, FORWARD, 2])
        return found


@kernel(fastmath=False, allocates=False)
def _screen_all(vehicle, rows, masks, scratch, heights, limits, moves, proposed, results):
    """Fill the moves to make [K, 4] and the verdicts [K] of `Shield.screen`, and fly on."""
    maps, vehicles, optics = vehicle
    made, verdicts = results
    bounds, task = limits
    for k in range(len(rows)):
        row = rows[k]
        vehicles.pose[row, 2] = heights[k]
        pose = Pose(vehicles.pose[row, 0], vehicles.pose[row, 1], heights[k], vehicles.pose[row, 3])
        follow(maps, row, pose.x, pose.y)
        look(maps, row, pose, optics, masks[k], scratch)
        enter_own_place(maps, row, pose.x, pose.y)
        wanted = UnitAction(proposed[k, 0], proposed[k, 1], proposed[k, 2], proposed[k, 3])
        verdicts[k] = judge(maps, vehicles, row, bounds, task, wanted)
        action = wanted
        if verdicts[k] != PERMITTED:
            action = _substitute(maps, vehicles, row, bounds, task, moves, k, wanted)
        if verdicts[k] == HEIGHT:
            # Its turn and what lies ahead have not been judged yet. The last one that is permitted is made.
            for up in (-1.0, 1.0, 0.0):
                other = UnitAction(up, wanted.turn, wanted.forward, wanted.left)
                if up != wanted.up and judge(maps, vehicles, row, bounds, task, other) == PERMITTED:
                    action = other
        made[k, 0], made[k, 1], made[k, 2], made[k, 3] = action
        advance(vehicles, row, task, wanted, verdicts[k], action)


@kernel(fastmath=False, allocates=False)
def _substitute(maps, vehicles, row, bounds, limits, moves, k, action):
    """Return the `UnitAction` in place of a vetoed one: there is one, for to stay is always permitted."""
    choices, worths, worths_known = moves
    best = UnitAction(0.0, 0.0, 0.0, 0.0)
    best_worth = -1e30
    for m in range(len(choices)):
        other = UnitAction(choices[m, 0], choices[m, 1], choices[m, 2], choices[m, 3])
        worth = worths[k, m] if worths_known else -change_of(vehicles, row, limits, action, other)
        # Judging takes longer than comparing.
        if worth > best_worth and judge(maps, vehicles, row, bounds, limits, other) == PERMITTED:
            best, best_worth = other, worth
    return best
