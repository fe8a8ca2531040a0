"""Folders that appear when they are complete: an interrupted recording leaves nothing behind."""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from thalweg.core.atomic_io import disk_errors_name
from thalweg.datasets.errors import DatasetError


def check_new(path: Path) -> None:
    """Raise `DatasetError` unless `path` is free or an empty folder."""
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise DatasetError(f"{path} is there already: name a new folder for the recordings")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder to write to; when the block ends without an error, it becomes `path`.

    Raises `DatasetError` unless `path` is free or an empty folder, and `OSError` that names it.
    """
    check_new(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    draft.mkdir()
    try:
        with disk_errors_name(path):
            yield draft
        if path.exists():
            path.rmdir()
        os.replace(draft, path)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
