"""`thalweg oracle`: the front of cost and return that a planner with the map attains, by price of cost."""

from dataclasses import dataclass
from pathlib import Path

from thalweg.cli.options import Plugins, UsageError, check_file, checked_task


@dataclass(frozen=True)
class FlyOracle:
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
    """Add the points to this .csv file; points of the same task, level and rivers are replaced."""
    plugin: Plugins = ()

    def run(self) -> int:
        from thalweg.bench.evaluate.course import EvaluationConfig
        from thalweg.bench.fronts.flights import PRICES, front_points
        from thalweg.bench.fronts.fronts import FIXED, UNSEEN, read_fronts, write_fronts
        from thalweg.env import EnvConfig
        from thalweg.world import level_named

        if self.out is not None:
            check_file("--out", self.out, ".csv")
        for price in self.prices:
            if not price >= 0:
                raise UsageError(f"--prices {price:g} is negative or no number; give prices such as 0 0.03 1")
        tasks = [checked_task(task) for task in self.tasks]
        if "River" in tasks:
            raise UsageError("--tasks River: its violations end the episode, so that cost has no price; leave it out")
        levels = [level_named(level).name for level in self.levels]
        for task in tasks:
            config = EvaluationConfig(self.episodes, env=EnvConfig(observation="none", task=task))
            for level in levels:
                rivers = UNSEEN if self.unseen else FIXED
                print(f"{task}, {level}, {rivers} rivers\n{'price':>8} {'return':>21} {'cost':>24}", flush=True)
                points = []
                for point in front_points(level, config, unseen=self.unseen, prices=self.prices or PRICES):
                    points.append(point)
                    returns = f"{point.return_:.2f} [{point.return_low:.2f}, {point.return_high:.2f}]"
                    costs = f"{point.cost:.2f} [{point.cost_low:.2f}, {point.cost_high:.2f}]"
                    print(f"{point.price:>8g} {returns:>21} {costs:>24}", flush=True)
                if self.out is not None:
                    known = read_fronts(self.out) if self.out.exists() else []
                    others = [each for each in known if (each.task, each.level, each.rivers) != (task, level, rivers)]
                    write_fronts(self.out, others + points)
        return 0
