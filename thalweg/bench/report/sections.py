"""The sections of a report, in the order of the page; a new table or figure is a new entry in `SECTIONS`.

Each section stands on the page under its title, and as files of its name beside it. What a table or figure shows is
computed in the modules beside this one, from the results alone.
"""

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from thalweg.bench.pictures.film_format import SMALL
from thalweg.bench.report.comparison_figures import condition_grid, return_profiles
from thalweg.bench.report.comparison_tables import condition_table, limit_table, pairwise_table
from thalweg.bench.report.failure_maps import failures_on, levels_from_above
from thalweg.bench.report.figures import failure_bars, training_curves
from thalweg.bench.report.policies import COST_LIMIT, with_critics
from thalweg.bench.report.price_figures import front_figure, training_costs
from thalweg.bench.report.price_tables import area_table, price_table
from thalweg.bench.report.published import SOURCE
from thalweg.bench.report.result_tables import detail_table, paper_table
from thalweg.bench.report.suite_tables import algorithm_table, runs_table
from thalweg.bench.report.table import Table
from thalweg.bench.results.results import MAIN_FILM, Results
from thalweg.bench.suite.record import task_of
from thalweg.env.tasks import PAPER_TASK
from thalweg.world import LEVELS


@dataclass(frozen=True)
class TableSection:
    """A table: on the page, and beside it as Markdown, LaTeX and CSV."""

    name: str
    """Stem of its files."""
    title: str
    table: Callable[[Results], Table]
    """Computes the table. The page filters by columns headed `policy`, `run` or `level`."""
    note: str = ""
    fallback: str = "There is nothing to show."
    """Text in place of a table without rows, which has no files; if empty, the section is omitted instead."""

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that it may have."""
        return tuple(f"{self.name}.{suffix}" for suffix in ("md", "tex", "csv"))


@dataclass(frozen=True)
class FigureSection:
    """A figure: on the page, and beside it as PNG and PDF."""

    name: str
    title: str
    draw: Callable[[Results], Figure | None]
    description: Callable[[Results], str]
    """Computes the text alternative, for readers who do not see the figure."""
    note: str = ""
    fallback: str = "There is nothing to draw."
    """Text in place of a figure that `draw` returns None for; if empty, the section is omitted instead."""
    photographic: bool = False
    """Whether the page has it as a JPEG, as suits pictures without lines and text."""
    leads: bool = False
    """Whether it stands at the top of the page, beside the ranking, if no section before it does."""
    explain: Callable[[Results], str] | None = None
    """Computes what stands after the note, of a figure whose reading depends on the results."""

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that it may have."""
        return tuple(f"{self.name}.{suffix}" for suffix in ("png", "pdf"))


@dataclass(frozen=True)
class FilmSection:
    """Films of flights side by side, which lie beside the page."""

    title: str
    includes: Callable[[str], bool]
    """Whether a film of the results, by name, belongs to the section."""
    note: str = ""
    fallback: str = ""
    """Text in place of films where there are none; if empty, the section is omitted instead."""
    leads: bool = False
    """As of a figure; its first film then stands there."""


Section = TableSection | FigureSection | FilmSection


def _describe_training(results: Results) -> str:
    names = ", ".join(dict.fromkeys(log.algorithm for log in results.training))
    return f"Four curves over training steps for {names}: return, and violations per step: all, tight and loose."


def colours_in_words(results: Results) -> str:
    """Return what the colours of reasons say of costs, by the task and the mode of some results."""
    if task_of(results.suite) == PAPER_TASK:
        return "Red: tight violations, cost 1. Yellow to grey: loose ones, cost 0.2."
    ended = " Purple: ended by the first cost of the task." if results.hard else ""
    return (
        "Red: tight violations, cost 1. Yellow and beige: loose ones, cost 0.2. Grey: the deadline, which costs"
        f" nothing.{ended}"
    )


SECTIONS: tuple[Section, ...] = (
    TableSection(
        "table",
        "Return and cost",
        with_critics(paper_table),
        "Mean ± standard deviation over episodes. Every policy flew the same list of starts, each once. Rows in"
        f" italics, if there are any, are published figures ({SOURCE}), measured in another simulator on other rivers:"
        " they are here for orientation, not for comparison of values.",
    ),
    FilmSection("A flight", lambda name: name == MAIN_FILM, leads=True),
    FigureSection(
        "levels",
        "The rivers",
        levels_from_above,
        lambda results: f"The rivers from straight above: {', '.join(results.levels)}.",
        fallback="",
        photographic=True,
        leads=True,
    ),
    FigureSection(
        "curves",
        "Training",
        training_curves,
        _describe_training,
        "Shaded areas: one standard deviation over seeds, where there is more than one. Violations per step: the number"
        " of episodes that ended by a violation so far, divided by the number of steps so far.",
        "Nothing was trained in these results.",
    ),
    FigureSection(
        "failures",
        "Why episodes ended",
        failure_bars,
        lambda _: "Bars: the share of episodes that ended for each reason, by policy and level.",
        "Shares of each policy's episodes.",
        explain=colours_in_words,
    ),
    TableSection(
        "details",
        "In detail",
        with_critics(detail_table),
        "In brackets: 95 % confidence intervals over training seeds, where there are three or more. IQM: interquartile"
        " mean, the mean of the middle half of the episodes. It has no interval where it is the same for all seeds,"
        " since equal values are no evidence of certainty. The stratified bootstrap is customary, but its intervals are"
        " too narrow for few seeds.",
    ),
    TableSection(
        "limits",
        "Is the limit met?",
        with_critics(limit_table),
        f"On the training level of the suite. The limit is a mean cost of {COST_LIMIT} per episode, whatever limit a"
        " policy was trained with. It is met if the whole interval lies below it, not met if the whole interval lies"
        " above it, and otherwise unsure; with fewer than three seeds, the table only says on which side the mean lies."
        " Violations: share of episodes with any cost. Regret: the cost above the limit in blocks of 50 episodes, per"
        " episode of the last training stage. Minutes of training and steps per second are means over runs.",
        fallback="",
    ),
    FigureSection(
        "front",
        "Return against cost",
        front_figure,
        lambda _: "Points: mean cost and mean return of each policy, below the line of what an oracle attains.",
        "On the training level of the suite. Black: the oracle, a planner that knows the map, at several prices of"
        " cost; the line joins what it attains by drawing one of two prices for each episode. A cross has no limit;"
        " other markers differ by limit. Lines through a point: 95 % confidence intervals over training seeds."
        " Outdated runs are not drawn beside the oracle of today.",
        fallback="",
    ),
    TableSection(
        "price",
        "What the limit costs",
        with_critics(price_table),
        "On the training level of the suite, each policy beside the limit that it was trained with. Flights above:"
        " share of episodes that cost more than the limit. Worst tenth costs: mean cost of the tenth of the episodes"
        " that cost most (CVaR). Below the oracle: how much more return is attainable at the policy's mean cost, or at"
        " the oracle's least cost if the policy's is less.",
        fallback="",
    ),
    TableSection(
        "area",
        "All limits together",
        area_table,
        "Hypervolume: the area below an algorithm's policies at all their limits and the mixtures of these, from their"
        " least cost to the cost of the oracle without a price, in shares of the oracle's area.",
        fallback="",
    ),
    FigureSection(
        "training_costs",
        "Cost in training",
        training_costs,
        lambda _: "Curves: the cost of episodes over training steps, a panel for each algorithm.",
        "Dotted: limits. Shaded areas: one standard deviation over seeds, where there is more than one.",
        fallback="",
    ),
    TableSection(
        "pairs",
        "In pairs",
        pairwise_table,
        "On the training level of the suite, from the same starts: how often the first policy returns more than the"
        " second (ties count half), and the mean differences of return and cost. The intervals are not corrected for"
        " multiple comparisons: of twenty comparisons of equal policies, one is expected to show a difference.",
        fallback="",
    ),
    FigureSection(
        "profiles",
        "Profiles",
        return_profiles,
        lambda _: "Curves: the share of flights with at least a return of 0 to 10, by policy and level.",
        "Shaded areas are pointwise confidence intervals over seeds; they are left out with more than four policies.",
        fallback="",
    ),
    *(
        FigureSection(
            f"map_{level.lower()}",
            f"Where flights on {level} failed",
            failures_on(level),
            lambda _: (
                "Maps, one for each policy: the river from above, with a dot where a flight ended without success."
            ),
            fallback="",
        )
        for level in LEVELS
    ),
    FilmSection(
        "Each policy's best flight and typical failure",
        lambda name: name != MAIN_FILM,
        f"Each policy flies the level that it was trained on. The films show one step in {SMALL.every}.",
    ),
    FigureSection(
        "conditions_grid",
        "Other conditions",
        condition_grid,
        lambda _: "A grid: the mean return of each policy under each condition.",
        "On the training level of the suite; conditions without it, such as `real`, on the first of their own rivers or"
        " levels that was flown.",
        fallback="",
    ),
    TableSection(
        "conditions",
        "Conditions one by one",
        with_critics(condition_table),
        "Change: the difference in return from the main condition (sampled actions, default appearance), from the same"
        " starts.",
        fallback="",
    ),
    TableSection(
        "methods",
        "Domains and methods",
        algorithm_table,
        "The algorithms of the suite, whether trained yet or not.",
        fallback="",
    ),
    TableSection("runs", "Runs", runs_table),
)
"""In the order of the page."""
