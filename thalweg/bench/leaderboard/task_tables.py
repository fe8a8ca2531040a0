"""The tables of the leaderboard for tasks where safety has a price: one for each task and kind of policy."""

from collections.abc import Iterator, Mapping, Sequence

from thalweg.bench.fronts.fronts import FIXED, UNSEEN
from thalweg.bench.leaderboard.kinds import APART, FUNCTIONS, TAUGHT, sees_frames
from thalweg.bench.leaderboard.requirements import LEVEL, TASK_REQUIREMENTS
from thalweg.bench.leaderboard.tasks import TaskEntry, fronts_of
from thalweg.bench.report.policies import CRITICS_SEE
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.front import Front
from thalweg.bench.results.inference import CONFIDENCE

NOTE = f"""In these tasks the greatest return costs more than a limit allows. Each policy is judged by the limit of an
episode's cost that it was trained with, and ranked among policies with the same limit: first those whose cost surely
meets it on the fixed river of {LEVEL}, with its whole confidence interval, then those whose mean cost does, then the
others; within each group by the return. *Below the oracle* is how much more the oracle, a planner that knows the map
and all that moves, returns at the same cost: the distance to its front, negative beyond it. The rows *oracle* have its
return at each limit. The columns *unseen* are of rivers that nothing is trained on. Brackets hold {CONFIDENCE:.0%}
confidence intervals over training seeds.
"""
COLUMNS = (
    *("limit", "policy", "results", "limit met", "cost", "return", "below the oracle"),
    *("unseen: cost", "unseen: return", "unseen: below the oracle", "steps", "seeds", CRITICS_SEE, "versions"),
)
ORACLE = "oracle"


def tasks_section(found: Sequence[TaskEntry]) -> str:
    """Return the section of the tasks, with a table for each task and kind of policy, as far as there are policies."""
    tables = []
    for task in dict.fromkeys(entry.task for entry in found):
        for words, includes in (("Through frames", sees_frames), *((kind.title, kind.includes) for kind in APART)):
            own = [entry for entry in found if entry.task == task and includes(entry)]
            if own:
                heading = f"### {task}, {words[0].lower()}{words[1:]}"
                tables.append(f"{heading}\n\n{task_table(own, fronts_of(task))}")
    requirements = "\n".join(f"- {line};" for line in TASK_REQUIREMENTS).removesuffix(";") + "."
    about = f"{NOTE}\nA row with a rank shows\n\n{requirements}\n"
    notes = [f"{kind.title}: {kind.note}\n" for kind in (TAUGHT, FUNCTIONS) if any(map(kind.includes, found))]
    return "\n".join(["## Tasks where safety has a price\n", about, *notes, *tables])


def task_table(found: Sequence[TaskEntry], fronts: Mapping[str, Front]) -> str:
    """Return the table of policies of one task, by limit; those that lack something last, with what they lack."""
    rows = list(_rows(sorted(found, key=lambda entry: entry.sort_key), fronts))
    columns = ["", *COLUMNS, "lacks"]
    if not any(row[-1] for row in rows):
        rows, columns = [row[:-1] for row in rows], columns[:-1]
    return markdown(frame(columns, rows))


def _rows(found: Sequence[TaskEntry], fronts: Mapping[str, Front]) -> Iterator[list[str]]:
    """Yield the rows of entries in their order, after that of the oracle at each limit."""
    rank, limit = 0, None
    for number, entry in enumerate(found):
        if number == 0 or entry.limit != limit:
            rank, limit = 0, entry.limit
            if limit is not None and fronts:
                yield _oracle_row(limit, fronts)
        rank += not entry.missing
        yield ["" if entry.missing else str(rank), *_row(entry), "; ".join(entry.missing)]


def _oracle_row(limit: float, fronts: Mapping[str, Front]) -> list[str]:
    """Return the row of the oracle at a limit."""
    figures = []
    for rivers in (FIXED, UNSEEN):
        front = fronts.get(rivers)
        if front is None or limit < front.cost[0]:
            figures += ["", "unattainable" if front is not None else "unknown", ""]
        else:
            figures += [f"{limit:.2f}", f"{float(front.greatest_return(limit)):.2f}", "0.00"]
    return ["", f"{limit:g}", ORACLE, "", "", *figures, "", "", "", "", ""]


def _row(entry: TaskEntry) -> list[str]:
    """Return a row of `COLUMNS` as text."""
    limit = "none" if entry.limit is None else f"{entry.limit:g}"
    policy = entry.policy if entry.privileged else entry.policy_and_sight  # the heading says who is privileged
    figures = [*_figures(entry, FIXED), *_figures(entry, UNSEEN)]
    rest = [f"{entry.steps:,}", str(entry.seeds), entry.critics_see, entry.versions_and_makers]
    return [limit, policy, entry.source, entry.limit_met, *figures, *rest]


def _figures(entry: TaskEntry, rivers: str) -> list[str]:
    """Return cost, return and distance to the oracle on some rivers as text."""
    if rivers not in entry.costs:  # not flown there
        return ["missing"] * 3
    below = str(entry.regrets[rivers]) if rivers in entry.regrets else "unknown"
    return [str(entry.costs[rivers]), str(entry.returns[rivers]), below]
