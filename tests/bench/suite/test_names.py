"""Tests that names which are too long for files are refused before anything runs."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.small_backend import SUITE
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.results.results import KINDS, FilmFiles, evaluation_path
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.names import FILM, TEMPORARY, refuse_long_names
from thalweg.core.atomic_io import atomic_path, write_atomic


def with_arm(name: str) -> Suite:
    return replace(SUITE, arms=(Arm("PPO", seeds=(0,), name=name),))


def test_the_longest_name_of_an_arm_can_be_that_of_all_files(tmp_path: Path):
    (run,) = (run for run in with_arm("a" * 198).runs() if run.kind == "train")
    for trial in with_arm("a" * 198).trials(run):
        write_atomic(evaluation_path(tmp_path, run.name, trial), "rows\n")
        assert evaluation_path(tmp_path, run.name, trial).read_text() == "rows\n"
    with pytest.raises(ResultsError, match="has a name of 201 characters, 200 are allowed: give it a shorter name"):
        with_arm("a" * 199)


@pytest.mark.parametrize("name", ["é" * 110, "河" * 75])
def test_letters_that_take_several_bytes_count_as_such(name: str):
    with pytest.raises(ResultsError, match=r"need a file with a name of \d+ bytes, 255 are allowed"):
        with_arm(name)


def test_a_level_with_the_banks_of_many_reaches_is_refused_where_its_files_cannot_be_written(tmp_path: Path):
    run, reaches = Run("train", "PPO", 0), "Medium" + 40 * "+meadow"
    with pytest.raises(ValueError, match=r"^the results 'PPO-0-Medium\+meadow.*\.\.\.' need a file with a name of 319"):
        refuse_long_names([(run, [reaches])], [])
    longest = reaches[: 255 - len("PPO-0-" + TEMPORARY)]
    refuse_long_names([(run, [longest])], [])
    write_atomic(evaluation_path(tmp_path, run.name, Trial(longest)), "rows\n")
    with pytest.raises(ValueError, match="256 bytes"):
        refuse_long_names([(run, [longest + "+"])], [])


def test_a_condition_must_be_the_name_of_a_folder():
    refuse_long_names([], ["a" * 255])
    with pytest.raises(ResultsError, match=r"the name of the condition 'aaa.*\.\.\.' is too long"):
        replace(SUITE, conditions=({"name": "a" * 256},))  # pyright: ignore[reportArgumentType]


def test_a_name_grows_as_much_as_that_of_a_temporary_file(tmp_path: Path):
    with pytest.raises(RuntimeError), atomic_path(tmp_path / "name.csv") as draft:
        assert len(draft.name) == len("name" + TEMPORARY)
        raise RuntimeError


def test_no_file_of_a_film_has_a_longer_name():
    stems = [path.stem for kind in KINDS for path in FilmFiles.of(Path(), f"PPO-{kind}").paths]
    assert max(stems, key=len) == f"PPO{FILM}"
