"""The page of the leaderboard in Markdown."""

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.leaderboard.entries import Entry, entries_of, read_folder
from thalweg.bench.leaderboard.kinds import APART, sees_frames
from thalweg.bench.leaderboard.requirements import LEVEL, REQUIREMENTS, UNSEEN
from thalweg.bench.leaderboard.task_tables import tasks_section
from thalweg.bench.leaderboard.tasks import task_entries
from thalweg.bench.report.policies import COST_LIMIT, CRITICS_SEE
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import CONFIDENCE, MIN_SEEDS
from thalweg.bench.suite.record import task_of
from thalweg.env.tasks import PAPER_TASK
from thalweg.train.observations import IMAGES
from thalweg.world import LEVELS

INTRODUCTION = f"""# Leaderboard

The command below computes this page from the files of results folders. A policy meets the cost limit (*yes*) if the
whole confidence interval of its mean cost per episode on {LEVEL} is within {COST_LIMIT}. These policies come first,
then those for which this is *unsure*, then the others. Within each group, policies are ranked by their return on
{LEVEL}. Returns are means, of at most 10. Brackets hold {CONFIDENCE:.0%} confidence intervals over training seeds. With
fewer than {MIN_SEEDS} seeds there is no interval, and *below, unsure* or *above, unsure* says on which side of the
limit the mean cost lies.

*Unseen* is the return on rivers of {LEVEL} that nothing is trained on. *Regret* is the cost of training above the
limit, per episode of the last stage. *Critics see* is about training: no policy is flown with critics. *Versions* is
*current* if the row was made with the current versions of everything that results depend on. Otherwise it names the
versions that differ, and the row is not ranked until it has been run again.

Policies see frames through an encoder, that of the autoencoder unless *(geometry)* follows the name. The name of one
that sees images itself is followed by their channels, {" or ".join(f"*({channels})*" for channels in IMAGES)}.
"""
OTHER_LEVELS = tuple(level for level in LEVELS if level != LEVEL)
COLUMNS = (
    "policy", "results", "limit met", "cost", LEVEL, *OTHER_LEVELS, "unseen", "regret",
    "trained on", "steps", "seeds", CRITICS_SEE, "versions",
)  # fmt: skip


def leaderboard(folders: Sequence[Path], plugins: Sequence[Path] = ()) -> str:
    """Return the leaderboard of some results folders as a page in Markdown: the paper's task, then others.

    The command that the page names also loads the files of `plugins`, which have been loaded.
    Raises `ResultsError` for no folder, for one that cannot be used, and for two with the same name.
    """
    _check_names(folders)
    every = [read_folder(folder) for folder in folders]
    papers = [results for results in every if task_of(results.suite) == PAPER_TASK]
    found = sorted((entry for results in papers for entry in entries_of(results)), key=lambda entry: entry.sort_key)
    of_tasks = [results for results in every if task_of(results.suite) != PAPER_TASK]
    loaded = [text for file in plugins for text in ("--plugin", str(file))]
    paragraphs = [
        INTRODUCTION,
        f"```sh\n{shlex.join(['thalweg', 'leaderboard', *map(str, folders), *loaded])}\n```\n",
        *(_papers_sections(found) if papers else []),
    ]
    if of_tasks:
        paragraphs.append(tasks_section([entry for results in of_tasks for entry in task_entries(results)]))
    return "\n".join(paragraphs)


def _check_names(folders: Sequence[Path]) -> None:
    """Raise `ResultsError` for no folder, and for two with the same name."""
    if not folders:
        raise ResultsError("give at least one folder that `thalweg bench` wrote")
    names = [folder.resolve().name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise ResultsError(
                f"two folders are named {name!r}; a row is identified by its policy and its folder's name"
            )


def _papers_sections(found: Sequence[Entry]) -> Iterable[str]:
    """Yield the paragraphs about policies of the paper's task, the best first."""
    complete = [entry for entry in found if not entry.missing]
    yield _ranked(list(filter(sees_frames, complete))) or "No policy that sees frames has a complete row yet.\n"
    requirements = "\n".join(f"- {line};" for line in REQUIREMENTS).removesuffix(";") + "."
    yield f"A row shows\n\n{requirements}\n"
    for kind in APART:
        if table := _ranked(list(filter(kind.includes, complete))):
            yield f"## {kind.title}\n\n{kind.note}\n\n{table}"
    if unranked := [[*_row(entry), "; ".join(entry.missing)] for entry in found if entry.missing]:
        table = markdown(frame([*COLUMNS, "lacks"], unranked))
        yield f"## Not ranked\n\nThe last column names what these rows lack.\n\n{table}"


def _ranked(complete: Sequence[Entry]) -> str:
    """Return the table of complete entries, the best first; empty without any."""
    rows = [[str(rank), *_row(entry)] for rank, entry in enumerate(complete, start=1)]
    return markdown(frame(["", *COLUMNS], rows)) if rows else ""


def _row(entry: Entry) -> list[str]:
    """Return a row of `COLUMNS` as text."""
    returns = [str(entry.returns.get(river, "missing")) for river in (LEVEL, *OTHER_LEVELS, UNSEEN.name)]
    cost = "missing" if entry.cost is None else str(entry.cost)
    regret = "unknown" if entry.regret is None else f"{entry.regret:.2f}"
    rest = [regret, entry.level, f"{entry.steps:,}", str(entry.seeds), entry.critics_see, entry.versions_and_makers]
    return [entry.policy_and_sight, entry.source, entry.limit_met, cost, *returns, *rest]
