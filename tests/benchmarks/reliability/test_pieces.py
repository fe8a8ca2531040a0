"""Tests of tables of finished pieces."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType


def test_two_commands_that_add_to_one_table_keep_each_others_rows(script: Callable[[str], ModuleType], tmp_path: Path):
    pieces = script("pieces")
    one, other = (pieces.Pieces(tmp_path / "table.csv", ("kind", "piece")) for _ in range(2))
    one.add({"kind": "world", "piece": 0, "failed": 1})
    other.add({"kind": "policy", "piece": 0, "failed": 0})
    one.add({"kind": "world", "piece": 0, "failed": 0})
    assert pieces.Pieces(one.path, one.key).rows == [
        {"kind": "policy", "piece": "0", "failed": "0"},
        {"kind": "world", "piece": "0", "failed": "0"},
    ]
