"""Tests of tables that resume from a damaged file."""

from pathlib import Path

import pytest

from thalweg.train.errors import TrainingError
from thalweg.train.folder.loggers import CsvTable


def test_a_table_resumes_at_its_checkpoint_under_the_columns_that_it_had(tmp_path: Path):
    path = tmp_path / "metrics.csv"
    path.write_text("steps,loss\n1,0.5\n2,0.25\n")
    table = CsvTable(path, keep_bytes=17)
    table.write({"loss": 0.125, "steps": 2, "new": 3})
    table.close()
    assert path.read_text() == "steps,loss\n1,0.5\n2,0.125\n"


def test_a_column_with_a_comma_in_its_name_goes_on_after_resuming(tmp_path: Path):
    table = CsvTable(tmp_path / "metrics.csv", keep_bytes=0)
    table.write({"steps": 1, "loss, mean": 0.5})
    kept = table.sync()
    table.close()
    table = CsvTable(tmp_path / "metrics.csv", keep_bytes=kept)
    table.write({"steps": 2, "loss, mean": 0.25})
    table.close()
    assert (tmp_path / "metrics.csv").read_text() == 'steps,"loss, mean"\n1,0.5\n2,0.25\n'


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"st\xffeps,loss\n1,0.5\n", "is damaged: its first line is not text"), (b"steps\n", "has 6 bytes, but had 17")],
)
def test_a_damaged_table_is_refused_by_name(content: bytes, words: str, tmp_path: Path):
    (tmp_path / "metrics.csv").write_bytes(content)
    with pytest.raises(TrainingError, match=rf"metrics\.csv {words}"):
        CsvTable(tmp_path / "metrics.csv", keep_bytes=17)
