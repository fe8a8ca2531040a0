"""No function has more lines or parameters than CONTRIBUTING.md allows, except those named here with a reason."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("thalweg", "tests", "benchmarks", "docs", "examples")
MOST_LINES, MOST_PARAMETERS = 60, 12
EXCEPTIONS = {
    "thalweg/render/gpu/pixel.py: tracer": "compiles the kernel of a pixel, which it holds, for some features",
    "thalweg/render/gpu/pixel.py: trace": "one thread's work on a pixel, which stays in its registers",
    "thalweg/render/kernels/shading/quay.py: shade_quays": "one loop over pixels that stays vectorised",
}
"""Kernels that must stay one compiled function, and why."""


def sizes(source: str) -> Iterator[tuple[str, int, int]]:
    """Name, number of lines without the docstring, and number of parameters besides self of each function.

    `*args` counts as one, and so does `**kwargs`.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = (node.end_lineno or 0) - node.lineno + 1
            if ast.get_docstring(node) is not None:
                lines -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            named = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            parameters = [*named, *filter(None, (node.args.vararg, node.args.kwarg))]
            yield node.name, lines, sum(each.arg not in ("self", "cls") for each in parameters)


def too_large(root: Path) -> list[str]:
    """Functions below a folder that exceed a limit, by file and name."""
    files = sorted(path for folder in FOLDERS for path in (root / folder).rglob("*.py"))
    return [
        f"{path.relative_to(root).as_posix()}: {name}"
        for path in files
        for name, lines, parameters in sizes(path.read_text(encoding="utf-8"))
        if lines > MOST_LINES or parameters > MOST_PARAMETERS
    ]


def test_functions_have_the_sizes_that_contributors_are_told():
    assert sorted(too_large(ROOT)) == sorted(EXCEPTIONS)


@pytest.mark.parametrize(
    ("lines", "parameters", "found"), [(60, 12, False), (61, 1, True), (3, 13, True)], ids=["allowed", "long", "wide"]
)
def test_a_function_above_a_limit_is_found(lines: int, parameters: int, found: bool, tmp_path: Path):
    names = ", ".join(f"a{number}" for number in range(parameters))
    body = ["        pass"] * (lines - 1)
    docstring = ['        """Two lines', '        of words."""']
    text = "\n".join(["class A:", f"    def grown(self, {names}):", *docstring, *body]) + "\n"
    (tmp_path / "thalweg").mkdir()
    (tmp_path / "thalweg" / "a.py").write_text(text)
    assert too_large(tmp_path) == (["thalweg/a.py: grown"] if found else [])


def test_contributors_are_told_the_limits():
    told = " ".join((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split())
    assert f"more than {MOST_LINES} lines, its docstring not counted, or more than {MOST_PARAMETERS} parameters" in told
