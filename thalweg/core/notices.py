"""Notices: lines that say what happens. They go to stderr, since stdout is for results."""

import sys


def notice(line: str) -> None:
    """Print a line to stderr at once."""
    print(line, file=sys.stderr, flush=True)
