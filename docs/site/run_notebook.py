"""Runner of notebooks: runs the cells in order in one process, and stores what they print and show.

`python docs/site/run_notebook.py examples/first_flight.ipynb` writes the outputs into the file. Jupyter is not
needed, and magic commands are not supported.
"""

import argparse
import ast
import base64
import contextlib
import io
import json
from pathlib import Path
from typing import Any

from notebook_page import code_of

from thalweg.core.atomic_io import write_atomic


def shown(value: Any) -> list[dict[str, Any]]:
    """Return what a notebook shows of the value of a cell's last line: a picture if it has one, else its text."""
    if value is None:
        return []
    data: dict[str, str] = {"text/plain": repr(value)}
    if hasattr(value, "_repr_png_"):
        data = {"image/png": base64.b64encode(value._repr_png_()).decode(), "text/plain": type(value).__name__}
    return [{"output_type": "display_data", "metadata": {}, "data": data}]


def run_cell(code: str, names: dict[str, Any], label: str) -> list[dict[str, Any]]:
    """Run one cell with the names of those before it, to which it adds; returns its outputs."""
    body = ast.parse(code, label)
    last = body.body[-1] if body.body else None
    if isinstance(last, ast.Expr):
        body.body.pop()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(body, label, "exec"), names)
        value = eval(compile(ast.Expression(last.value), label, "eval"), names) if isinstance(last, ast.Expr) else None
    text = printed.getvalue()
    stream = [{"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)}] if text else []
    return stream + shown(value)


def run_notebook(path: Path) -> dict[str, Any]:
    """Return the notebook with the outputs of a new run; an error in a cell is raised as it is."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    codes = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(codes, start=1):
        cell["execution_count"] = number
        cell["outputs"] = run_cell(code_of(cell), names, f"{path.name}, cell {number}")
    return notebook


def main() -> None:
    """Run the notebook that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("notebook", type=Path)
    path = parser.parse_args().notebook
    write_atomic(path, (json.dumps(run_notebook(path), indent=1, ensure_ascii=False) + "\n").encode())


if __name__ == "__main__":
    main()
