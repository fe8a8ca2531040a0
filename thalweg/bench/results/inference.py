"""How sure may one be? Intervals of what is said of evaluated episodes.

What is to be known is how an algorithm does with any training seed. All flights of a seed are of one training, and do
well or badly together, so that it is seeds that count and not episodes: intervals are those of Student's t over the
figures of the seeds, and there is none of fewer than `LEAST_SEEDS`. (A bootstrap that draws among the seeds of each
start by itself, or takes all episodes for independent, is far too sure: of 3 seeds that differ as much as episodes do,
such an interval of 95 % holds the truth in fewer than half of the cases. `bootstrapped_return` gives it nevertheless,
for comparison with studies that do.)

Letters: L starts, M seeds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from thalweg.bench.evaluate.episodes import Episode
from thalweg.env.task.reward_cost import WHOLE_COURSE

LEAST_SEEDS = 3
"""Of which an interval is given."""
CONFIDENCE = 0.95
"""How often an interval holds the truth."""
RESAMPLES = 2000
"""Of a bootstrap."""
POSSIBLE = {"return_": (0.0, WHOLE_COURSE), "cost": (0.0, 1.0)}
"""What an episode can return and cost as the paper pays for them, which all suites do; no interval of their means goes
beyond."""
SAME = 1e-9
"""Returns that differ by no more are the same: a return is a sum, and its last digits depend on the steps that paid."""
Statistic = Callable[..., np.ndarray]
"""Of numbers along an `axis`."""


@dataclass(frozen=True)
class Estimate:
    """A figure and its interval of `CONFIDENCE`; NaN at both ends where none can be given."""

    value: float
    low: float = float("nan")
    high: float = float("nan")

    def __str__(self) -> str:
        return f"{self.value:.2f}" if np.isnan(self.low) else f"{self.value:.2f} [{self.low:.2f}, {self.high:.2f}]"

    def as_percent(self) -> str:
        """Of a share: the same in whole percent."""
        if np.isnan(self.low):
            return f"{self.value:.0%}"
        return f"{self.value:.0%} [{100 * self.low:.0f}, {100 * self.high:.0f}]"


def table_of(rows: Sequence[Episode], field: str = "return_") -> np.ndarray:
    """[L, M] a field of episodes by start and seed.

    Raises `ValueError` unless every seed flew every start of every level once.
    """
    seeds = sorted({row.seed for row in rows})
    starts = sorted({(row.level, row.world_seed, row.episode) for row in rows})
    found = {(row.level, row.world_seed, row.episode, row.seed): float(getattr(row, field)) for row in rows}
    if len(found) != len(rows) or len(found) != len(starts) * len(seeds):
        raise ValueError(f"{len(rows)} episodes are not those of {len(seeds)} seeds from {len(starts)} starts each")
    return np.array([[found[(*start, seed)] for seed in seeds] for start in starts])


def iqm(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """The interquartile mean along an axis: of the middle half of the numbers (Agarwal et al. 2021, "Deep Reinforcement
    Learning at the Edge of the Statistical Precipice")."""
    return stats.trim_mean(values, 0.25, axis=axis)


def over_seeds(table: np.ndarray, statistic: Statistic = iqm) -> Estimate:
    """A statistic of all episodes [L, M], such as `iqm` or `numpy.mean`, and its interval, from the statistic of each
    seed's episodes."""
    return student(float(statistic(table.ravel(), axis=-1)), statistic(table, axis=0))


def student(value: float, each: np.ndarray) -> Estimate:
    """A figure with Student's interval over those of the seeds [M], around their mean; it is stretched to hold the
    figure, which need not be that mean."""
    if len(each) < LEAST_SEEDS:
        return Estimate(value)
    middle = float(np.mean(each))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, len(each) - 1) * stats.sem(each))
    return Estimate(value, min(middle - half, value), max(middle + half, value))


def wilson(value: float, count: int) -> tuple[float, float]:
    """The ends of Wilson's interval of a share that was found in so many independent cases."""
    z = float(stats.norm.ppf(0.5 + CONFIDENCE / 2))
    middle, weight = value + z**2 / (2 * count), 1 + z**2 / count
    half = z * float(np.sqrt(value * (1 - value) / count + z**2 / (4 * count**2)))
    return (middle - half) / weight, (middle + half) / weight


def middle_return(rows: Sequence[Episode]) -> Estimate:
    """The interquartile mean of some episodes' returns; without an interval where a seed did not fly every start, and
    where those of all seeds are the same, which is no certainty."""
    try:
        table = table_of(rows)
    except ValueError:
        table = np.array([[row.return_] for row in rows])
    found = _possible(over_seeds(table), "return_")
    return Estimate(found.value) if np.ptp(iqm(table, axis=0)) <= SAME else found


def bootstrapped_return(rows: Sequence[Episode]) -> Estimate:
    """The same with the stratified bootstrap of Agarwal et al. (2021): starts are the strata, in each of which seeds
    are drawn with replacement, `RESAMPLES` times; the interval is that of the percentiles."""
    try:
        table = table_of(rows)
    except ValueError:
        return middle_return(rows)
    value = float(iqm(table.ravel()))
    if table.shape[1] < LEAST_SEEDS:
        return Estimate(value)
    found = stats.bootstrap(
        tuple(table),
        lambda *strata, axis: iqm(np.concatenate(strata, axis), axis),
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Estimate(value, float(found.low), float(found.high))


def mean_of(rows: Sequence[Episode], field: str) -> Estimate:
    """The mean over episodes; without an interval where a seed did not fly every start.

    The interval is no narrower than `of_flights`, since seeds whose means are the same are no certainty.
    """
    try:
        table = table_of(rows, field)
    except ValueError:
        return Estimate(float(np.mean([getattr(row, field) for row in rows])))
    return _possible(no_narrower(over_seeds(table, np.mean), of_flights(table, field)), field)


def of_flights(table: np.ndarray, field: str) -> Estimate:
    """The mean of a field of flights [L, M] with the interval of so many independent ones: Student's, and Wilson's
    where all are equal, which is no certainty either."""
    found = student(float(table.mean()), table.ravel())
    if field not in POSSIBLE or np.ptp(table) > SAME:
        return found
    least, most = POSSIBLE[field]
    ends = wilson(float(np.clip((found.value - least) / (most - least), 0.0, 1.0)), table.size)
    return Estimate(found.value, *(least + (most - least) * end for end in ends))


def no_narrower(found: Estimate, other: Estimate) -> Estimate:
    """An estimate whose interval, if it has one, also holds another's."""
    if np.isnan(found.low) or np.isnan(other.low):
        return found
    return Estimate(found.value, min(found.low, other.low), max(found.high, other.high))


def _possible(found: Estimate, field: str) -> Estimate:
    """The estimate with the part of its interval that is possible for a mean of the field."""
    return clipped(found, *POSSIBLE.get(field, (-np.inf, np.inf)))


def clipped(found: Estimate, least: float, most: float) -> Estimate:
    """The estimate with the part of its interval that lies within bounds."""
    return Estimate(found.value, *(float(np.clip(end, least, most)) for end in (found.low, found.high)))


def span(field: str) -> float:
    """By how much two means of a field can differ."""
    least, most = POSSIBLE.get(field, (-np.inf, np.inf))
    return most - least


def share(rows: Sequence[Episode], holds: Callable[[Episode], bool]) -> Estimate:
    """Of how many episodes something holds, such as a violation.

    The interval is that over seeds, but no narrower than Wilson's, since equal shares of three seeds are no certainty.
    """
    held = np.array([holds(row) for row in rows])
    seeds = np.array([row.seed for row in rows])
    each = np.array([held[seeds == seed].mean() for seed in np.unique(seeds)])
    return no_surer(student(float(held.mean()), each), len(held))


def no_surer(found: Estimate, count: int) -> Estimate:
    """The estimate of a share whose interval, if it has one, lies within 0..1 and is no narrower than Wilson's of so
    many cases."""
    return clipped(no_narrower(found, Estimate(found.value, *wilson(found.value, count))), 0.0, 1.0)
