"""Tests of the tables of results on the terminal."""

import io
from dataclasses import replace
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
    assert "…" not in text


LONG = "FOCOPS-after-PPO-with-a-name-that-is-longer-than-others"


def printed_rows(console: Console, file: io.StringIO) -> list[str]:
    levels = ("Easy", "Medium", "Hard")
    rows = [
        replace(episode(9.5, 0.1, "Success", seed=seed, length=300), algorithm=LONG, level=level)
        for seed in range(3)
        for level in levels
    ]
    print_tables(console, Results(Path(), {}, [], rows, [], []))
    return file.getvalue().splitlines()


def test_a_line_in_a_pipe_is_as_long_as_its_table_needs():
    file = io.StringIO()
    lines = printed_rows(Console(width=WIDTH, file=file), file)
    ours = [line for line in lines if LONG in line]
    assert [line.count("│") for line in ours] == [9, *[12] * 3]  # whole cells: nothing is on a second line
    assert "…" not in "".join(lines)
    assert len([line for line in lines if line.startswith("│")]) == len(ours)


def test_brackets_in_a_name_are_shown():
    printed = io.StringIO()
    rows = [replace(episode(9.5, 0.1, "Success"), algorithm=f"FOCOPS[lr={rate}]", level="a [west]") for rate in "12"]
    print_tables(Console(width=WIDTH, file=printed), Results(Path(), {}, [], rows, [], []))
    text = printed.getvalue()
    assert "FOCOPS[lr=1]" in text and "FOCOPS[lr=2]" in text and "[west]" in text


def test_a_table_fits_a_narrow_terminal():
    file = io.StringIO()
    lines = printed_rows(Console(width=100, file=file, force_terminal=True, color_system=None), file)
    assert max(map(len, lines)) <= 100


def test_a_table_takes_the_room_that_a_wide_terminal_has():
    file = io.StringIO()
    lines = printed_rows(Console(width=250, file=file, force_terminal=True, color_system=None), file)
    assert len([line for line in lines if LONG in line]) == 4


def test_each_sign_is_explained_where_it_is():
    printed = io.StringIO()
    rows = [replace(episode(9.5, 0.1, "Success", seed=seed, length=300), algorithm="PPO") for seed in range(3)]
    print_tables(Console(width=WIDTH, file=printed), Results(Path(), {}, [], rows, [], []))
    text = printed.getvalue()
    assert "│ PPO, published * │" in text and "\n*: Wang and Mahmoudian 2024" in text
    assert "\n±: standard deviation over episodes" in text and "\n[ ]: 95 % confidence interval" in text
    one = io.StringIO()
    print_tables(Console(width=WIDTH, file=one), Results(Path(), {}, [], [replace(rows[0], algorithm="mine")], [], []))
    assert "[ ]" not in one.getvalue() and "*" not in one.getvalue() and "±: " in one.getvalue()
