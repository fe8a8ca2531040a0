r"""How does a table get into a paper? As a booktabs `tabular` in a file of its own, for `\input` within any `table`."""

from thalweg.bench.report.tables import is_published, number_columns

ESCAPES = {
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
"""What a sign is in LaTeX, where it is not itself."""


def escaped(text: str) -> str:
    """The text as LaTeX shows it again."""
    plain = "".join(ESCAPES.get(sign, sign) for sign in text)
    # After the end of a row, LaTeX takes a bracket for a length and a star for a wish not to break the page.
    return f"{{{plain[0]}}}{plain[1:]}" if plain[:1] in ("[", "*") else plain


def latex(header: list[str], rows: list[list[str]]) -> str:
    r"""A `tabular` with the rules of booktabs: numbers to the right, words to the left, published rows in italics."""
    columns = "".join("r" if number else "l" for number in number_columns((header, rows)))
    lines = ["% Needs \\usepackage{booktabs}.", f"\\begin{{tabular}}{{{columns}}}", "\\toprule", _row(header)]
    lines += ["\\midrule", *(_published(row) if is_published(row) else _row(row) for row in rows)]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}\n"])


def _row(cells: list[str]) -> str:
    return " & ".join(escaped(cell) for cell in cells) + r" \\"


def _published(cells: list[str]) -> str:
    return "\\quad " + " & ".join(f"\\textit{{{escaped(cell)}}}" for cell in cells) + r" \\"
