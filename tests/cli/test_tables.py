"""Tests of the tables of results on the terminal."""

import io
from pathlib import Path

from rich.console import Console

from tests.bench.results.test_statistics import episode
from thalweg.bench.results.results import Results
from thalweg.cli.tables import WIDTH, print_tables


def test_no_heading_is_cut_where_there_is_no_terminal():
    rows = [episode(9.5, 0.1, "Success", seed=seed, length=300) for seed in range(3)]
    printed = io.StringIO()
    print_tables(Console(width=WIDTH, file=printed), Results(Path(), {}, [], rows, [], []))
    text = printed.getvalue()
    assert "(bootstrap)" in text and "violation" in text
    assert "…" not in text and max(map(len, text.splitlines())) <= WIDTH
