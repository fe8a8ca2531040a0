"""Tables of cost limits, pairwise comparisons and evaluation conditions.

All figures come from the evaluated episodes and training logs of the results. Intervals are over seeds; there is none
for fewer than three.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.policies import (
    evaluated_seeds,
    limit_met,
    seeds_text,
    train_level,
    trained_policies,
    training_regret,
)
from thalweg.bench.report.table import Cell, Table, table_from_cells
from thalweg.bench.results.comparison import (
    matched_scores,
    mean_difference,
    paired_difference,
    probability_of_improvement,
)
from thalweg.bench.results.inference import PAPERS, Bounds, Estimate, mean_estimate, proportion
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.record import bounds_of, task_of
from thalweg.env.tasks import PAPER_TASK


def limit_table(results: Results) -> Table:
    """Return whether each trained policy meets the cost limit on the training level: its cost in evaluation, and its
    cost in training; no row for tasks other than the paper's, which have limits of their own (`price_table`)."""
    level, groups = train_level(results), group_episodes(results.episodes)
    columns = ("policy", "seeds", "cost", "limit met", "violations", "regret in training", "minutes", "steps a second")
    rows: list[list[Cell]] = []
    for name in trained_policies(results) if task_of(results.suite) == PAPER_TASK else ():
        episodes = groups.get((name, level))
        if episodes is None:
            rows.append([name, seeds_text(results, name, 0), *[results.gap(name)] * (len(columns) - 2)])
            continue
        cost, regret = mean_estimate(episodes, "cost"), training_regret(results, name)
        runs = [row for row in results.runs if row.algorithm == name and row.status == "finished"]
        rows.append(
            [
                name,
                evaluated_seeds(results, name, episodes),
                cost,
                limit_met(cost),
                proportion(episodes, lambda row: row.cost > 0),
                "unknown" if regret is None else regret,
                float(np.mean([row.wall_s for row in runs]) / 60) if runs else "unknown",
                float(np.mean([row.steps_per_s for row in runs])) if runs else "unknown",
            ]
        )
    return table_from_cells(columns, rows)


def pairwise_table(results: Results) -> Table:
    """Return the comparison of each trained policy with each other on the training level, paired by start."""
    level, groups = train_level(results), group_episodes(results.episodes)
    columns = ("policy", "against", "seeds", "returns more", "return, difference", "cost, difference")
    rows: list[list[Cell]] = []
    current = [name for name in trained_policies(results) if name not in results.outdated]
    for one, other in combinations(current, 2):
        first_rows, second_rows = groups.get((one, level)), groups.get((other, level))
        if first_rows is None or second_rows is None:
            continue
        try:
            scores = {field: matched_scores(first_rows, second_rows, field) for field in ("return_", "cost")}
        except ValueError:
            rows.append([one, other, *["not the same starts"] * (len(columns) - 2)])
            continue
        seeds = f"{evaluated_seeds(results, one, first_rows)} and {evaluated_seeds(results, other, second_rows)}"
        both = [*first_rows, *second_rows]
        bounds = {field: bounds_of(results.suite, field, both) for field in scores}
        differences = (mean_difference(*matrices, field, bounds[field]) for field, matrices in scores.items())
        rows.append([one, other, seeds, probability_of_improvement(*scores["return_"]), *differences])
    return table_from_cells(columns, rows)


def condition_table(results: Results) -> Table:
    """Return how each policy does under each condition on each river, and how its return changes from the main
    condition where starts are the same."""
    main = group_episodes(results.episodes)
    columns = ("policy", "condition", "level", "seeds", "return", "cost", "success", "return, change")
    rows: list[list[Cell]] = []
    for name, condition_episodes in results.condition_episodes.items():
        for (algorithm, level), episodes in group_episodes(condition_episodes).items():
            bounds = bounds_of(results.suite, "return_", episodes)
            rows.append(
                [
                    algorithm,
                    name,
                    level,
                    evaluated_seeds(results, algorithm, episodes),
                    mean_estimate(episodes, "return_", bounds),
                    mean_estimate(episodes, "cost", bounds_of(results.suite, "cost")),
                    proportion(episodes, lambda row: row.success),
                    return_change(episodes, main.get((algorithm, level), []), bounds),
                ]
            )
    order = {name: index for index, name in enumerate(results.policies)}
    return table_from_cells(columns, sorted(rows, key=lambda row: order[str(row[0])]))


def return_change(after: Sequence[Episode], before: Sequence[Episode], bounds: Bounds = PAPERS) -> Estimate | str:
    """Return the mean change of the return between two conditions, over the seeds that flew under both; `bounds`: see
    `inference.field_bounds`.

    Returns `other starts` where the starts differ, and `other seeds` where no seed flew under both.
    """
    seeds = {row.seed for row in after} & {row.seed for row in before}
    if not seeds:
        return "other seeds" if before else "other starts"
    first_rows, second_rows = ([row for row in rows if row.seed in seeds] for rows in (after, before))
    try:
        return paired_difference(*matched_scores(first_rows, second_rows, "return_"), "return_", bounds)
    except ValueError:
        return "other starts"
