"""Source of a plug-in: its file and the modules beside it that it imports, and their hash."""

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path

from thalweg.core.plugins.record import PluginError

PACKAGE = "thalweg"


def source_files(file: Path, root: Path, top: str | None = None) -> dict[str, Path]:
    """Return the files of a plug-in by their paths relative to `root`, the folder that its imports start from.

    These are its `file` and all modules under `root` that it imports, directly or through others; with `top` only those
    of that top-level package. Imports are read, not executed. Raises `PluginError` for a syntax error.
    """
    found: dict[str, Path] = {}
    pending = [file]
    while pending:
        path = pending.pop()
        name = path.relative_to(root).as_posix()
        if name in found:
            continue
        found[name] = path
        for module in _imported(path, root):
            first = module.partition(".")[0]
            if first != PACKAGE and top in (None, first):
                pending += _files_of(module, root)
    return dict(sorted(found.items()))


def text_hash(text: str) -> str:
    """Return the hash of a text, of 16 hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def source_hash(files: dict[str, Path]) -> str:
    """Return the hash of files by their relative paths, of 16 hexadecimal digits, whatever their line ends are."""
    digest = hashlib.sha256()
    for name, path in files.items():
        content = path.read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()[:16]


def assignments(file: Path) -> dict[str, int]:
    """Return the variables that are assigned at the top level of a file, and the line of the first assignment."""
    found: dict[str, int] = {}
    for node in _parsed(file).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            if isinstance(target, ast.Name):
                found.setdefault(target.id, node.lineno)
    return found


def assignments_and_functions(file: Path) -> list[str]:
    """Return the names that a file assigns or defines at its top level, in order."""
    assigned = assignments(file)
    found: list[str] = []
    for node in _parsed(file).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.append(node.name)
        found += [name for name, line in assigned.items() if line == node.lineno]
    return found


def _parsed(file: Path) -> ast.Module:
    try:
        return ast.parse(file.read_bytes(), str(file))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # the last two: nested too deep
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""
        what = error.msg if isinstance(error, SyntaxError) else str(error)
        raise PluginError(f"{file}{line}: {what}; a plug-in is a file of Python that can be imported") from error


def _imported(file: Path, root: Path) -> Iterator[str]:
    """Yield the full names of all modules that a file may import."""
    parts = file.relative_to(root).with_suffix("").parts
    package = parts[:-1]
    for node in ast.walk(_parsed(file)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*base, *([node.module] if node.module else [])))
            yield module
            yield from (f"{module}.{alias.name}".lstrip(".") for alias in node.names)


def _files_of(module: str, root: Path) -> Iterator[Path]:
    """Yield the files under a root that the import of a module executes."""
    parts = module.split(".")
    for count in range(1, len(parts) + 1):
        path = root.joinpath(*parts[:count])
        for candidate in (path / "__init__.py", path.with_suffix(".py")):
            if candidate.is_file():
                yield candidate
                break
