"""`thalweg oracle`: the front of cost and return that a planner with the map attains, by price of cost."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from thalweg.cli.command import Command
from thalweg.cli.options import Plugins, UsageError, check_file, checked_task

if TYPE_CHECKING:
    from thalweg.bench.fronts.fronts import FrontPoint


@dataclass(frozen=True)
class FlyOracle(Command):
    """Fly the oracle, which knows the map and all that moves, at several prices of cost."""

    tasks: tuple[str, ...] = ("Swimmers", "Nests", "RacingLine", "Portage")
    """Tasks to fly."""
    levels: tuple[str, ...] = ("Medium",)
    """Levels to fly on."""
    unseen: bool = False
    """Fly on unseen rivers of the levels, one start on each, instead of the fixed river."""
    episodes: int = 100
    """Number of starts, each flown once at each price."""
    prices: tuple[float, ...] = ()
    """Return that a cost of 1 is worth, such as 0 0.03 1; by default fourteen from 0 to 10."""
    out: Path | None = None
    """Add the points to this .csv file. Those of a front with other --episodes or of another version are replaced."""
    plugin: Plugins = ()

    resumes = True

    def after_interrupt(self) -> str:
        from thalweg.bench.csv_files import ResultsError
        from thalweg.world import WorldError

        try:
            kept = [price in self._known(*front) for front in self._fronts() for price in self._prices]
        except (UsageError, WorldError, ResultsError):  # it was interrupted before it said so
            kept = []
        if any(kept):
            return f"{self.out} has {sum(kept)} of {len(kept)} points. The same command flies the others."
        return "The same command starts from the beginning."

    def run(self) -> int:
        self._check()
        for task, level in self._fronts():
            self._fly(task, level)
        return 0

    def _check(self) -> None:
        """Raise `UsageError` for options that cannot be, and `ResultsError` for a file of another kind."""
        if self.out is not None:
            check_file("--out", self.out, ".csv")
        for price in self.prices:
            if not price >= 0:
                raise UsageError(f"--prices {price:g} is negative or no number; give prices such as 0 0.03 1")
        if "River" in (task for task, _ in self._fronts()):
            raise UsageError("--tasks River: its violations end the episode, so that cost has no price; leave it out")
        self._points()

    def _fronts(self) -> list[tuple[str, str]]:
        """Return task and level of each front; raises `UsageError` and `WorldError` for unknown ones."""
        from thalweg.world import level_named

        tasks, levels = [checked_task(task) for task in self.tasks], [level_named(level).name for level in self.levels]
        return [(task, level) for task in tasks for level in levels]

    @property
    def _prices(self) -> tuple[float, ...]:
        from thalweg.bench.fronts.flights import PRICES

        return tuple(dict.fromkeys(self.prices)) or PRICES

    @property
    def _rivers(self) -> str:
        from thalweg.bench.fronts.fronts import FIXED, UNSEEN

        return UNSEEN if self.unseen else FIXED

    def _points(self) -> "list[FrontPoint]":
        """Return all points of the file, none without one."""
        from thalweg.bench.fronts.fronts import read_fronts

        return read_fronts(self.out) if self.out is not None and self.out.exists() else []

    def _known(self, task: str, level: str) -> "dict[float, FrontPoint]":
        """Return the points of a front in the file that need not be flown again, by price; none of a plug-in's task,
        whose version the file does not have."""
        from thalweg.core import versions
        from thalweg.env.tasks import TASKS

        same = (task, level, self._rivers, self.episodes, versions.TASKS)
        return {
            point.price: point
            for point in self._points()
            if (point.task, point.level, point.rivers, point.episodes, point.tasks) == same and task in TASKS
        }

    def _fly(self, task: str, level: str) -> None:
        """Fly a front, print its points, and write each to the file when it is flown."""
        from thalweg.bench.evaluate.course import EvaluationConfig
        from thalweg.bench.fronts.flights import front_points
        from thalweg.env import EnvConfig

        known, rivers = self._known(task, level), self._rivers
        missing = [price for price in self._prices if price not in known]
        in_file = len(self._prices) - len(missing)
        kept = f", {in_file} of {len(self._prices)} points from {self.out}" if in_file else ""
        print(f"{task}, {level}, {rivers} rivers{kept}\n{'price':>8} {'return':>21} {'cost':>24}", flush=True)
        config = EvaluationConfig(self.episodes, env=EnvConfig(observation="none", task=task))
        flown = front_points(level, config, unseen=self.unseen, prices=missing)
        for price in self._prices:
            if price not in known:
                known[price] = next(flown)
                self._keep(known)
            point = known[price]
            returns = f"{point.return_:.2f} [{point.return_low:.2f}, {point.return_high:.2f}]"
            costs = f"{point.cost:.2f} [{point.cost_low:.2f}, {point.cost_high:.2f}]"
            print(f"{point.price:>8g} {returns:>21} {costs:>24}", flush=True)

    def _keep(self, known: "dict[float, FrontPoint]") -> None:
        """Write the points of a front to the file, beside those that another command has written there meanwhile."""
        from thalweg.bench.fronts.fronts import write_fronts
        from thalweg.core.file_lock import held

        if self.out is None:
            return
        point = next(iter(known.values()))
        front = (point.task, point.level, point.rivers)
        with held(self.out):
            known = self._known(point.task, point.level) | known
            others = [each for each in self._points() if (each.task, each.level, each.rivers) != front]
            write_fronts(self.out, [*others, *(known[price] for price in sorted(known))])
