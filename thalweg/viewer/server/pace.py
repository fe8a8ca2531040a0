"""The pace of a flight: when its next step is due, and how far the camera is on its way through the last one."""

import math

MOST_STEPS = 4
"""Steps between two frames. A flight that lags further behind its pace slows down instead of catching up."""


class Pace:
    """Times of steps on a clock in seconds that the caller reads."""

    def __init__(self, step_s: float) -> None:
        """`step_s`: time that passes in one step."""
        self._step_s = step_s
        self.speed: float | None = 1.0
        """Times real time; None: a step for each frame."""
        self._last: float | None = None
        """When the last step began; None while the flight stands."""

    @property
    def moving(self) -> bool:
        """Whether the flight goes on."""
        return self._last is not None

    def go(self, now: float, speed: float | None) -> None:
        """Let the flight go on at a speed: its first step is due at once, unless it already moves."""
        self.speed = speed
        if self._last is None:
            self._last = now - self._period

    def stand(self) -> None:
        """Let the flight stand."""
        self._last = None

    def steps_due(self, now: float) -> int:
        """Return the number of steps that are due now, at most `MOST_STEPS`; they count as taken."""
        if self._last is None:
            return 0
        if not self._period:
            self._last = now
            return 1
        due = math.floor((now - self._last) / self._period + 1e-9)
        if due > MOST_STEPS:
            self._last, due = now, MOST_STEPS
        else:
            self._last += due * self._period
        return due

    def share(self, now: float) -> float:
        """Return the share of the last step, 0 to 1, that is behind the camera."""
        if self._last is None or not self._period:
            return 1.0
        return min(max((now - self._last) / self._period, 0.0), 1.0)

    @property
    def _period(self) -> float:
        """Seconds from one step to the next."""
        return 0.0 if self.speed is None else self._step_s / self.speed
