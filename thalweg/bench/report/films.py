"""Copies of films and their posters beside the page of a report, under the names that they have in the results."""

import re
from collections.abc import Sequence

from thalweg.bench.results.results import FILMS, KINDS, MAIN_FILM, POSTER, Results

FILM = re.compile(rf"({MAIN_FILM}|{FILMS}/[^/]+-({'|'.join(KINDS)}))(\.mp4|{re.escape(POSTER)})")
"""The name of a film's file, or of its poster's, relative to the results or to a report."""


def film_files(results: Results, names: Sequence[str]) -> dict[str, bytes]:
    """Return name and content of the films with some of the names in the results, and of their posters."""
    files: dict[str, bytes] = {}
    for name in names:
        if (film := results.films.get(name)) is not None:
            files |= {
                f"{name}{path.suffix}": path.read_bytes() for path in (film.path, film.poster) if path is not None
            }
    return files


def is_film(name: str) -> bool:
    """Return whether a file of this name, relative to a report, is a film of it or a poster."""
    return FILM.fullmatch(name) is not None
