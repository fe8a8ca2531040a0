"""Results on the terminal: the paper's table and the details beside it."""

from collections.abc import Sequence

from pandas import DataFrame
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Column, Table

from thalweg.bench.report.published import SOURCE
from thalweg.bench.report.result_tables import detail_table, paper_table
from thalweg.bench.report.table import PAPER, is_published
from thalweg.bench.results.results import Results

WIDTH = 120
"""Characters in a line of output where there is no terminal."""
UNLIMITED = 10_000


def make_console() -> Console:
    """Return a console for the terminal. A pipe has no width of its own, and a wrapped number is hard to read."""
    return Console() if Console().is_terminal else Console(width=WIDTH)


def _column(heading: str, index: int) -> Column:
    """Return a column wide enough for each word of its heading; numbers are to the right of the first column."""
    return Column(escape(heading), justify="right" if index else "left", min_width=max(map(len, heading.split())))


def print_tables(console: Console, results: Results, *, detail: bool = True, published: bool = True) -> None:
    """The paper's table, with the figures that it `published` where they can be compared, and with `detail` what it
    leaves out.

    Where there is no terminal, lines are as long as the widest table needs; a narrow terminal breaks cells.
    """
    texts = [paper_table(results, published=published).text] + ([detail_table(results).text] if detail else [])
    for text in texts:
        table = Table(*map(_column, text.columns, range(len(text.columns))))
        for row in text.itertuples(index=False, name=None):
            published = is_published(row[0])
            name = row[0].replace(f" ({PAPER})", ", published *")
            table.add_row(*map(escape, (name, *row[1:])), style="dim" if published else None)
        if not console.is_terminal:
            whole = Measurement.get(console, console.options.update(max_width=UNLIMITED), table).maximum
            console.width = max(console.width, whole)
        console.print(table)
    for line in _notes(texts):
        console.print(line, highlight=False, markup=False)


def _notes(texts: Sequence[DataFrame]) -> list[str]:
    """Return what the signs in tables mean, a line for each that is there."""
    cells = [cell for text in texts for column in text.columns for cell in (column, *text[column])]
    notes = {
        "±": "±: standard deviation over episodes",
        "[": "[ ]: 95 % confidence interval over training seeds",
        "IQM": "IQM: interquartile mean, the mean without the lowest and the highest quarter of episodes",
        PAPER: f"*: {SOURCE}, measured in another simulator, on other rivers",
    }
    return [note for sign, note in notes.items() if any(sign in cell for cell in cells)]
