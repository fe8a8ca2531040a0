"""Tests of the comparison of a run that was made again: to the bit, and by means."""

from dataclasses import replace
from pathlib import Path

import pytest

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.results.reproduction import (
    SEED_DEVIATIONS,
    TOLERANCES,
    Table,
    compare_means,
    compare_to_the_bit,
    other_conditions,
)

CURVE = Table("curve", "runs/{run}/episodes.csv", ("step", "return", "cost"), steps=100)
FLIGHTS = Table("Easy", "evaluation/{run}-Easy.csv", ("return", "cost", "success"))
MADE = {
    "machine": {
        "cpu": "A",
        "cpu_type": "znver5",
        "vector_bits": 512,
        "system": "Linux",
        "learning_threads": 1,
        "fast_path": True,
    },
    "versions": {"numpy": "2"},
    "device": "cpu",
}


def written(folder: Path, name: str, *rows: str, header: str = "step,return,cost") -> Path:
    path = folder / name
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_a_table_has_one_place_for_each_run():
    assert FLIGHTS.path(Path("results"), "PPO-1") == Path("results/evaluation/PPO-1-Easy.csv")


def test_equal_tables_have_no_difference(tmp_path: Path):
    there, here = (written(tmp_path, name, "10,1.5,0.0", "99,0.30000000000000004,0.2") for name in "ab")
    part = compare_to_the_bit(CURVE, there, here)
    assert (part.name, part.episodes, part.differences) == ("curve", 2, ())


def test_the_last_bit_of_a_number_is_found_and_named(tmp_path: Path):
    there = written(tmp_path, "a", "10,1.5,0.0", "99,0.30000000000000004,0.2")
    here = written(tmp_path, "b", "10,1.5,0.0", "99,0.3,0.2")
    part = compare_to_the_bit(CURVE, there, here)
    assert part.differences == ("line 3: return 0.30000000000000004 there, 0.3 here",)


def test_many_differences_are_counted(tmp_path: Path):
    there = written(tmp_path, "a", *(f"{step},1.0,0.0" for step in range(6)))
    here = written(tmp_path, "b", *(f"{step},2.0,0.0" for step in range(5)))
    part = compare_to_the_bit(CURVE, there, here)
    assert part.differences[:2] == ("6 rows there, 5 here", "line 2: return 1.0 there, 2.0 here")
    assert part.differences[-1] == "and 3 more"


def test_means_of_a_curve_are_those_of_its_last_tenth(tmp_path: Path):
    there = written(tmp_path, "a", "10,0.0,9.0", "91,8.0,0.0", "99,9.0,0.5")
    here = written(tmp_path, "b", "10,5.0,0.0", "95,9.0,0.25")
    part = compare_means(CURVE, [there], there, here)
    assert part.differences == ()
    expected = "return 8.50 there, 9.00 here (tolerance 1.00); cost 0.25 there, 0.25 here (tolerance 0.25)"
    assert part.means == expected


def test_a_block_of_a_curve_counts_as_often_as_it_has_episodes(tmp_path: Path):
    header = "step,episodes,return,cost"
    blocks = written(tmp_path, "a", "10,50,1.0,1.0", "95,50,8.0,0.0", "99,10,2.0,0.6", header=header)
    part = compare_means(CURVE, [blocks], blocks, blocks)
    assert part.means.startswith("return 7.00 there, 7.00 here")  # (50 * 8 + 10 * 2) / 60
    assert part.episodes == compare_to_the_bit(CURVE, blocks, blocks).episodes == 110


def test_a_block_with_an_impossible_number_of_episodes_is_refused(tmp_path: Path):
    path = written(tmp_path, "a", "95,inf,8.0,0.0", header="step,episodes,return,cost")
    for compare in (compare_to_the_bit, lambda *files: compare_means(files[0], [files[1]], *files[1:])):
        with pytest.raises(ResultsError, match=f"{path}: episodes: a finite number is needed, got 'inf'"):
            compare(CURVE, path, path)


def test_the_page_states_the_tolerances():
    page = " ".join((Path(__file__).resolve().parents[3] / "docs" / "bench.md").read_text().split())
    words = "return within {return:g} point, cost of an episode within {cost:g}, success within {success:g}"
    assert words.format(**TOLERANCES) in page
    assert f"or within {['zero', 'one', 'two', 'three'][int(SEED_DEVIATIONS)]} standard deviations" in page


@pytest.mark.parametrize(("seeds", "tolerance"), [((8.0,), "1.00"), ((8.0, 8.0), "1.00"), ((8.0, 6.0, 7.0), "3.00")])
def test_a_tolerance_is_three_standard_deviations_of_the_seeds_if_that_is_more(
    seeds: tuple[float, ...], tolerance: str, tmp_path: Path
):
    files = [written(tmp_path, f"{number}", f"99,{value},0.0") for number, value in enumerate(seeds)]
    part = compare_means(CURVE, files, files[0], written(tmp_path, "here", "99,6.5,0.0"))
    is_within = seeds == (8.0, 6.0, 7.0)
    assert part.differences == (() if is_within else (f"return 8.00 there, 6.50 here (tolerance {tolerance})",))
    assert f"(tolerance {tolerance})" in part.means


def test_flights_are_compared_by_all_of_them_and_by_success(tmp_path: Path):
    header = "return,cost,success"
    there = written(tmp_path, "a", "10.0,0.0,1", "10.0,0.0,1", header=header)
    here = written(tmp_path, "b", "10.0,0.0,1", "9.5,0.0,0", header=header)
    part = compare_means(FLIGHTS, [there], there, here)
    assert part.differences == ("success 1.00 there, 0.50 here (tolerance 0.20)",)


def test_a_mean_that_is_no_number_does_not_agree(tmp_path: Path):
    there, here = (written(tmp_path, name, f"99,{value},0.0") for name, value in (("a", "8.0"), ("b", "nan")))
    assert compare_means(CURVE, [there], there, here).differences


def test_a_curve_without_episodes_at_its_end_is_refused(tmp_path: Path):
    path = written(tmp_path, "a", "10,1.0,0.0")
    with pytest.raises(ResultsError, match=f"{path}: curve has no episodes to compare"):
        compare_means(CURVE, [path], path, path)


def test_a_file_without_a_column_that_the_recorded_one_has_is_refused(tmp_path: Path):
    there, here = written(tmp_path, "a", "99,8.0,0.0"), written(tmp_path, "b", "99,8.0", header="step,return")
    with pytest.raises(ResultsError, match=f"{here} lacks the column cost, which curve of the recorded run has"):
        compare_means(replace(CURVE, columns=("step",)), [there], there, here)


def test_a_value_that_is_no_number_is_refused_with_the_file(tmp_path: Path):
    path = written(tmp_path, "a", "99,high,0.0")
    with pytest.raises(ResultsError, match=f"{path}: could not convert string to float: 'high'"):
        compare_means(CURVE, [path], path, path)


def test_the_same_processor_packages_and_threads_leave_no_other_condition():
    other_cores = {**MADE, "machine": {**MADE["machine"], "cores": 64}, "versions": {"numpy": "2", "gymnasium": "9"}}
    assert other_conditions(MADE, other_cores) == []


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"machine": {**MADE["machine"], "cpu": "B"}}, "cpu A there, B here"),
        ({"machine": {**MADE["machine"], "cpu_type": "znver3"}}, "cpu type znver5 there, znver3 here"),
        ({"machine": {**MADE["machine"], "vector_bits": 256}}, "vector bits 512 there, 256 here"),
        ({"machine": {**MADE["machine"], "learning_threads": 2}}, "learning threads 1 there, 2 here"),
        ({"machine": {**MADE["machine"], "fast_path": False}}, "fast path True there, False here"),
        ({"versions": {"numpy": "3"}}, "numpy 2 there, 3 here"),
        ({"device": "cuda"}, "device cpu there, cuda here"),
    ],
)
def test_another_condition_is_named(changed: dict, said: str):
    assert other_conditions(MADE, {**MADE, **changed}) == [said]


def test_a_record_from_before_the_fast_path_was_recorded_is_no_other_condition():
    older = {**MADE, "machine": {name: value for name, value in MADE["machine"].items() if name != "fast_path"}}
    assert other_conditions(older, MADE) == other_conditions(MADE, older) == []
