"""What does a report consist of, and in which order? To add a table or a figure is to add one entry to `PARTS`.

Each part is a section of the page and files of its name beside it. What a table and a figure hold is made in
`tables.py`, `figures.py` and others, from the results alone.
"""

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from thalweg.bench.pictures.film_format import SMALL
from thalweg.bench.report import extra_figures as figures_beyond
from thalweg.bench.report import extra_tables as beyond
from thalweg.bench.report import failure_maps as maps
from thalweg.bench.report import figures, tables
from thalweg.bench.report.algorithm_table import methods
from thalweg.bench.report.published import SOURCE
from thalweg.bench.report.table import Sheet
from thalweg.bench.results.results import MAIN_FILE, MAIN_FILM, Results
from thalweg.world import LEVELS


@dataclass(frozen=True)
class Table:
    """A table: on the page, and beside it as Markdown, LaTeX and CSV."""

    name: str
    """Of its files."""
    title: str
    text: Callable[[Results], tables.Grid]
    """Header and rows as they are read. By columns headed `policy`, `run` or `level` the page filters."""
    csv: Callable[[Results], str]
    """The same at full precision."""
    note: str = ""
    otherwise: str = "There is nothing to show."
    """Stands in the place of a table without rows, which has no files; if empty there is no section either."""

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that it may have."""
        return tuple(f"{self.name}.{kind}" for kind in ("md", "tex", "csv"))


@dataclass(frozen=True)
class Picture:
    """A figure: on the page, and beside it as PNG and PDF."""

    name: str
    title: str
    draw: Callable[[Results], Figure | None]
    words: Callable[[Results], str]
    """What is said of it to those who don't see it."""
    note: str = ""
    otherwise: str = "There is nothing to draw."
    """Stands in the place of a figure that `draw` gives None for."""

    @property
    def files(self) -> tuple[str, ...]:
        """As for tables."""
        return tuple(f"{self.name}.{kind}" for kind in ("png", "pdf"))


@dataclass(frozen=True)
class Films:
    """Films of flights, beside one another; the files of `files` lie beside the page too."""

    title: str
    names: Callable[[str], bool]
    """Which of the results' films, by name."""
    note: str = ""
    otherwise: str = "These results hold no film."
    files: tuple[str, ...] = ()


def _trained(results: Results) -> str:
    names = ", ".join(dict.fromkeys(log.algorithm for log in results.training))
    return (
        f"Four curves over the steps of training for {names}: return, and violations per step in all, tight and loose."
    )


def _sheet(name: str, title: str, made: Callable[[Results], Sheet], note: str, otherwise: str = "") -> Table:
    return Table(name, title, lambda results: made(results).grid, lambda results: made(results).csv, note, otherwise)


PARTS: tuple[Table | Picture | Films, ...] = (
    Table(
        "table",
        "Return and cost",
        tables.paper_table,
        tables.table_csv,
        "Mean ± standard deviation over episodes. An episode pays at most 10 and costs at most 1. Every policy flew the"
        f" same list of starts, each once. Rows in italics are published figures ({SOURCE}), measured in another"
        " simulator on other rivers: they are here for orientation, not for comparison of values.",
    ),
    Picture(
        "levels",
        "The rivers",
        maps.levels_from_above,
        lambda results: f"The rivers from straight above: {', '.join(results.levels)}.",
        otherwise="",
    ),
    Films("A flight", lambda name: name == MAIN_FILM, files=(MAIN_FILE,)),
    Picture(
        "curves",
        "Training",
        figures.training_curves,
        _trained,
        "Bands: one standard deviation over seeds, where there is more than one. Violations per step: episodes ended by"
        " a violation so far, divided by steps so far.",
        "Nothing was trained in these results.",
    ),
    Picture(
        "failures",
        "Why episodes ended",
        figures.failure_bars,
        lambda _: "Bars: the share of episodes that ended for each reason, by policy and level.",
        "Shares of each policy's episodes. Red: tight violations, cost 1. Yellow to grey: loose ones, cost 0.2.",
    ),
    Table(
        "details",
        "In detail",
        tables.detail_table,
        tables.detail_csv,
        "In brackets: intervals of 95 % over training seeds, where there are three or more. IQM: mean of the middle"
        " half of the episodes, without an interval where it is the same for all seeds, which is no certainty; the"
        " stratified bootstrap, which is customary, is too sure where there are few.",
    ),
    _sheet(
        "limits",
        "Is the limit met?",
        beyond.limits,
        f"On the level that the suite trains on, of a mean cost of {beyond.LIMIT} an episode, whatever limit was given."
        " Met if the whole interval lies below, not met if it lies above, else unsure; of fewer than three seeds it is"
        " only said where the mean lies. Violations: share of flights with any cost. Regret: what blocks of 50 episodes"
        " cost beyond the limit, for each episode of the last stage of training. Minutes of training and steps a second"
        " are means over runs.",
    ),
    _sheet(
        "pairs",
        "In pairs",
        beyond.pairs,
        "On the level that the suite trains on, flights from the same starts: how often the first returns more than the"
        " second (ties count half), and by how much return and cost differ in the mean. Each interval is by itself: of"
        " twenty comparisons of equals one is expected to seem a difference.",
    ),
    Picture(
        "profiles",
        "Profiles",
        figures_beyond.profiles,
        lambda _: "Curves: the share of flights with at least a return of 0 to 10, by policy and level.",
        "Of up to four policies with intervals over seeds, each return by itself.",
        otherwise="",
    ),
    *(
        Picture(
            f"map_{level.lower()}",
            f"Where flights on {level} failed",
            maps.failures_on(level),
            lambda _: (
                "Maps, one for each policy: the river from above, with a dot where a flight ended without success."
            ),
            otherwise="",
        )
        for level in LEVELS
    ),
    Films(
        "Each policy's best flight and typical failure",
        lambda name: name != MAIN_FILM,
        f"On the level that it was trained on, one step in {SMALL.every}.",
        otherwise="",
    ),
    Picture(
        "conditions_grid",
        "Other conditions",
        figures_beyond.condition_grid,
        lambda _: "A grid: the mean return of each policy under each condition.",
        "On the level that the suite trains on; real, and what does not fly there, on a river of its own.",
        otherwise="",
    ),
    _sheet(
        "conditions",
        "Conditions one by one",
        beyond.conditions,
        "Change: of the return against sampled actions on the usual day, from the same starts.",
    ),
    _sheet("methods", "Domains and methods", methods, "Of the algorithms of the suite, trained or not."),
    Table("runs", "Runs", tables.runs_table, tables.runs_csv),
)
"""In the order of the page."""
