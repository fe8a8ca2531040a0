"""Tests of the summary of the tables of reliability, by rows whose sums are known."""

from collections.abc import Callable
from types import ModuleType

import pytest

from thalweg.core import versions


@pytest.fixture
def summary(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("summary")


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in table.splitlines()]


def test_the_page_is_what_the_tables_have(summary: ModuleType):
    page = summary.PAGE.read_text()
    assert summary.written_page(page) == page


def test_files_are_counted_by_ending(summary: ModuleType):
    rows = [
        {"kind": kind, "piece": piece, "files": "1000", "read": "600", "refused": "399", "failed": "1", "commit": "a"}
        for kind, piece in (*((kind, "0") for kind in ("world", "flight", "cached maps")), ("world", "1"))
    ]
    found = cells(summary.fuzzed(rows))
    assert [".npz", "3", "4,000 of 300,000", "2,400", "1,596", "4"] in found
    assert [row for row in found if row[0] == ".gpx"] == [[".gpx", "1", "0 of 100,000", "0", "0", "0"]]


def test_the_page_names_the_first_and_the_last_commit_that_read_files(summary: ModuleType):
    row = {"kind": "world", "piece": "0", "files": "1000", "read": "600", "refused": "400", "failed": "0"}
    commits = ("2026-11-29 b", "2026-11-27 c", "2026-11-28 a")
    told = summary.fuzzed([row | {"commit": commit} for commit in commits])
    assert "by the code of commits of 2026-11-27 to 2026-11-29." in told


def test_pieces_of_other_versions_do_not_count(summary: ModuleType):
    today = {name: str(number) for name, number in summary.versions_of("steps").items()}
    assert today["vehicles"] == str(versions.VEHICLES) and "render" not in today
    piece = {"piece": "0", "rivers": "10", "amount": "1000000", "faults": "0"} | today
    rows = [piece | {"vehicles": "0", "faults": "3"}, piece, piece | {"piece": "1", "rules": "0"}]
    steps, frames = cells(summary.soaked(rows, []))[2:]
    assert steps == ["steps", "1,000,000 of 100,000,000", "10", "0"]
    assert frames == ["frames", "0 of 1,000,000", "0", "0"]


def test_kills_are_counted_by_command_and_faults_by_trial(summary: ModuleType):
    rows = [
        {"command": "bench", "trial": trial, "kill": kill, "finished": finished, "faults": faults}
        | {"made_with": summary.MADE_BY["bench"]}
        for trial, kill, finished, faults in (("0", "0", "0", "0"), ("1", "0", "1", "2"), ("1", "1", "3", "2"))
    ]
    today = summary.MADE_BY
    others = [[f"`{name}`", today[name], "0 of 50", "0", "0", "0"] for name in ("train", "imitate", "encoder")]
    own = ["`bench`", today["bench"]]
    assert sorted(cells(summary.killed(rows))[2:]) == sorted([[*own, "3 of 50", "2", "2", "1"], *others])
    failed = rows[0] | {"trial": "2", "kill": "none", "faults": "1"}
    assert [*own, "3 of 50", "2", "3", "2"] in cells(summary.killed([*rows, failed]))


def test_kills_of_other_versions_have_a_line_of_their_own(summary: ModuleType):
    row = {"command": "imitate", "trial": "0", "kill": "0", "finished": "0", "faults": "0", "made_with": "imitation 0"}
    found = [line for line in cells(summary.killed([row])) if line[0] == "`imitate`"]
    assert found == [
        ["`imitate`", summary.MADE_BY["imitate"], "0 of 50", "0", "0", "0"],
        ["`imitate`", "imitation 0", "1 of 50", "0", "1", "0"],
    ]


def test_without_a_table_there_is_nothing_yet(summary: ModuleType):
    assert {summary.fuzzed([]), summary.soaked([], []), summary.killed([])} == {summary.NOTHING}
