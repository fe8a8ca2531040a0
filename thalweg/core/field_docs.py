"""Docstrings of the fields of dataclasses, from their source: the text on the lines after each field."""

import ast
import inspect
import textwrap


def field_docs(kind: type) -> dict[str, str]:
    """Return the docstring of each field of a class as one line, by its name, those of base classes first.

    Fields without one, and classes whose source cannot be read, are left out.
    """
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__[:-1]):
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
        except (OSError, TypeError, SyntaxError):
            continue
        found |= _docs_in(tree.body[0])
    return found


def _docs_in(node: ast.stmt) -> dict[str, str]:
    """Return the docstrings of the fields that a class statement has itself."""
    if not isinstance(node, ast.ClassDef):
        return {}
    found = {}
    for field, text in zip(node.body, node.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        ):
            found[field.target.id] = " ".join(text.value.value.split())
    return found
