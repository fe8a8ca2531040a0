"""Tables as pandas data frames, and their rendering as text, CSV, Markdown and LaTeX.

The HTML page renders the text of a table with its template.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from thalweg.bench.results.inference import Estimate

PAPER = "paper, another simulator"
"""Label of published figures wherever they stand beside measured ones."""
NUMBER = re.compile(r"[<>≤≥≈~\s]*[-−+]?\.?\d")
"""The beginning of a cell that holds a number."""
LATEX_ESCAPES = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "±": r"$\pm$",
    "−": "$-$",
    "×": r"$\times$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "→": r"$\rightarrow$",
    "Δ": r"$\Delta$",
    "²": r"\textsuperscript{2}",
    "…": r"\ldots{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}
"""Characters that LaTeX would not print as they are, also those that pandas' own escaping leaves."""

Cell = str | float | Estimate


@dataclass(frozen=True)
class Table:
    """A table as people read it, and the same figures as programs read them."""

    text: pd.DataFrame
    """Strings only: numbers rounded, estimates with their intervals."""
    figures: pd.DataFrame
    """At full precision."""

    @property
    def csv(self) -> str:
        """The figures as CSV; missing values are empty."""
        return self.figures.to_csv(index=False, lineterminator="\n")


def frame(columns: Iterable[str], rows: Iterable[Sequence[object]]) -> pd.DataFrame:
    """Return a data frame of the rows that keeps each value as it is."""
    return pd.DataFrame(list(rows), columns=list(columns), dtype=object)


def table_from_cells(columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> Table:
    """Return a table whose text and figures both come from the same cells.

    Among the figures, a column that holds an estimate becomes three: `name`, `name, low` and `name, high`.
    """
    values = frame(columns, rows)
    figures: dict[str, Iterable[object]] = {}
    for name, column in values.items():
        if any(isinstance(cell, Estimate) for cell in column):
            split = zip(*map(estimate_figures, column), strict=True)
            figures |= zip((f"{name}", f"{name}, low", f"{name}, high"), split, strict=True)
        else:
            figures[f"{name}"] = column
    return Table(values.map(cell_text), pd.DataFrame(figures, dtype=object))


def cell_text(cell: object) -> str:
    """Return a cell as people read it: numbers with two decimal places."""
    return f"{cell:.2f}" if isinstance(cell, float) else str(cell)


def estimate_figures(cell: Cell) -> tuple[object, object, object]:
    """Return value, low end and high end of an estimate, with None for a missing end; words are a value."""
    if not isinstance(cell, Estimate):
        return cell, None, None
    low, high = (None if np.isnan(end) else end for end in (cell.low, cell.high))
    return cell.value, low, high


def is_published(first_cell: str) -> bool:
    """Return whether a row that begins with this cell holds published figures."""
    return PAPER in first_cell


def numeric_columns(text: pd.DataFrame) -> list[bool]:
    """Return for each column whether any of its cells begins with a number; the first column names the rows."""
    return [index > 0 and any(map(NUMBER.match, text.iloc[:, index])) for index in range(text.shape[1])]


def markdown(text: pd.DataFrame) -> str:
    """Return a table in Markdown."""
    lines = [list(text.columns), ["---"] * text.shape[1], *text.itertuples(index=False, name=None)]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def latex(text: pd.DataFrame) -> str:
    r"""Return a booktabs `tabular` for `\input`: numbers to the right, words to the left, published rows in italics."""
    alignment = "".join("r" if numeric else "l" for numeric in numeric_columns(text))
    body = frame(map(escape_latex, text.columns), map(_latex_row, text.itertuples(index=False, name=None)))
    return "% Needs \\usepackage{booktabs}.\n" + body.to_latex(index=False, escape=False, column_format=alignment)


def _latex_row(row: Sequence[str]) -> list[str]:
    values = [escape_latex(cell) for cell in row]
    if is_published(row[0]):
        values = [f"\\textit{{{cell}}}" for cell in values]
        values[0] = f"\\quad {values[0]}"
    return values


def escape_latex(text: str) -> str:
    """Return the LaTeX source that prints a text."""
    escaped = "".join(LATEX_ESCAPES.get(sign, sign) for sign in text)
    # After the end of a row, LaTeX reads a bracket as a length and a star as a wish not to break the page.
    return f"{{{escaped[0]}}}{escaped[1:]}" if escaped[:1] in ("[", "*") else escaped
