"""Tests of the suite runner: interruption, failed runs and resumption."""

import errno
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bench import small_backend
from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.episodes import REASON_TEXT, read_episodes, write_episodes
from thalweg.bench.execute import backend, runner
from thalweg.bench.execute.backend import installed_versions
from thalweg.bench.execute.filming import best_of_all, policy_shots
from thalweg.bench.execute.runner import RESULTS_FOLDER, claim, run_suite, selected_runs
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import evaluation_path, read_runs
from thalweg.bench.suite.arms import Arm, Run, Stage
from thalweg.bench.suite.builtin import STUDIED, SUITES, suite_named
from thalweg.cli.main import main

pytestmark = pytest.mark.usefixtures("no_pictures")

FILMS = 1 + 2 * 2
"""The best flight of all, and two of each algorithm."""
WHOLE = 4 + 5 * 3 + FILMS
"""Calls of the whole small suite: four trainings, three levels of five runs, and the films."""


def tables(folder: Path) -> dict[str, str]:
    """Everything of a results folder that is a result, by name."""
    files = [*folder.glob("evaluation/*.csv"), folder / "report" / "table.csv", folder / "report" / "table.md"]
    return {file.name: file.read_text() for file in files}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("undisturbed")
    place = SmallBackend()
    run_suite(SUITE, folder, place)
    assert len(place.calls) == WHOLE
    return tables(folder)


def test_a_finished_suite_is_not_repeated(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    again = SmallBackend()
    outcome = run_suite(SUITE, tmp_path, again)
    assert again.calls == []
    assert [row.status for row in outcome.runs] == ["finished"] * 5


@pytest.mark.slow
@pytest.mark.parametrize("die_at", [0, 3, 8, 18, WHOLE - 1])
def test_killed_at_any_point_the_same_command_ends_with_the_same_tables(
    tmp_path: Path, die_at: int, undisturbed: dict[str, str], capsys: pytest.CaptureFixture
):
    command = [sys.executable, small_backend.__file__, str(tmp_path), str(die_at)]
    assert subprocess.run(command, capture_output=True).returncode == 9
    rest = SmallBackend()
    run_suite(SUITE, tmp_path, rest)
    assert tables(tmp_path) == undisturbed
    assert len(rest.calls) == WHOLE - die_at  # nothing that was finished was done again


def test_a_failed_run_is_a_row_with_its_error_and_the_others_continue(tmp_path: Path):
    outcome = run_suite(SUITE, tmp_path, SmallBackend(broken=("PPO-1",)))
    rows = {row.run: row for row in read_runs(tmp_path)}
    assert list(rows) == ["hover-0", "PPO-0", "PPO-1", "FOCOPS-0", "FOCOPS-1"]
    assert rows["PPO-1"].status == "failed"
    assert rows["PPO-1"].error == "ArithmeticError: the loss is NaN in line two"
    assert [row.run for row in outcome.failed] == ["PPO-1"]
    assert "ArithmeticError" in (tmp_path / "runs" / "PPO-1" / "error.txt").read_text()
    assert {row.algorithm for row in read_results(tmp_path).episodes} == {"hover", "PPO", "FOCOPS"}


def test_a_failed_run_is_tried_again_and_nothing_else(tmp_path: Path, undisturbed: dict[str, str]):
    run_suite(SUITE, tmp_path, SmallBackend(broken=("PPO-1",)))
    again = SmallBackend()
    run_suite(SUITE, tmp_path, again)
    assert again.calls[:4] == ["train PPO-1"] + [f"evaluate PPO-1 {level}" for level in SUITE.test_levels]
    assert [call.split()[0] for call in again.calls[4:]] == ["film"] * 3  # their captions count more flights now
    assert tables(tmp_path) == undisturbed
    assert not (tmp_path / "runs" / "PPO-1" / "error.txt").exists()


def test_a_run_that_is_tried_again_starts_without_the_old_error_file(tmp_path: Path):
    """A trainer refuses a folder that holds anything but its own run."""
    run_suite(SUITE, tmp_path, SmallBackend(broken=("PPO-1",)))
    found: list[str] = []

    class Looks(SmallBackend):
        def train(self, run: Run, folder: Path) -> None:
            found.extend(path.name for path in folder.iterdir())
            super().train(run, folder)

    run_suite(SUITE, tmp_path, Looks())
    assert found == ["episodes.csv"]


def test_a_half_written_evaluation_is_flown_again(tmp_path: Path, undisturbed: dict[str, str]):
    run_suite(SUITE, tmp_path, SmallBackend())
    file = tmp_path / "evaluation" / "FOCOPS-1-Hard.csv"
    file.write_text(file.read_text()[:-30])
    again = SmallBackend()
    run_suite(SUITE, tmp_path, again)
    assert again.calls == ["evaluate FOCOPS-1 Hard"]
    assert tables(tmp_path) == undisturbed


def test_a_full_disk_stops_the_suite_and_keeps_what_was_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    place = SmallBackend()
    monkeypatch.setattr(place, "train", full)
    with pytest.raises(OSError, match="No space"):
        run_suite(SUITE, tmp_path, place)
    assert [row.run for row in read_runs(tmp_path)] == ["hover-0"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"arms": (Arm("PPO"), Arm("FOCUPS"))},
            r"unknown algorithm 'FOCUPS' \(did you mean 'FOCOPS'\?\); known: PPO, PPOLag, FOCOPS",
        ),
        (
            {"test_levels": ("Easy", "Meduim")},
            r"unknown level 'Meduim' \(did you mean 'Medium'\?\); known: Easy, Medium, Hard",
        ),
        (
            {"baselines": ("hoover",)},
            r"unknown baseline 'hoover' \(did you mean 'hover'\?\); known: random, hover, forward, pilot, steady",
        ),
        (
            {"arms": ({"algorithm": "PPO", "steps": 0},)},
            r"arms\[0\]\.steps must be .* of at least 1, got 0",
        ),
        ({"test_levels": ("Easy", "Hard", "Easy")}, "level 'Easy' is named twice in test_levels"),
        ({"arms": ({"algorithm": "PPO", "seeds": []},)}, "PPO has no seeds; give at least one, such as 0"),
        ({"arms": ({"algorithm": "PPO", "seeds": [2, 1, 1]},)}, "seed 1 is named twice in seeds of PPO"),
        (
            {"conditions": ({"name": "fog", "levels": ["Hard", "Hard"]},)},
            "level 'Hard' is named twice in levels of condition fog",
        ),
        (
            {"conditions": ({"name": "away", "rivers": ["Cam", "Cam"]},)},
            "river 'Cam' is named twice in rivers of condition away",
        ),
        ({"arms": (Arm("PPO"), Arm("FOCOPS", name="PPO"))}, "named twice"),
        ({"arms": (Arm("PPO"), Arm("FOCOPS", name="ppo"))}, "PPO and ppo differ in capitals alone"),
        ({"conditions": ({"name": "fog"}, {"name": "Fog"})}, "condition fog and Fog differ in capitals alone"),
        ({"arms": (Arm("PPO", seeds=(0,)), Arm("PPO", seeds=(1,), settings={"passes": 3}))}, "PPO is named twice"),
        ({"arms": (Arm("PPO", seeds=(1,), name="hover"),)}, "hover is named twice"),
        ({"arms": (Arm("PPO", seeds=(1,), name="packaged"),)}, "packaged is named twice"),
        (
            {"arms": ({"algorithm": "PPO", "name": "my arm"},)},
            "called 'my arm'; letters, digits, - and . will do",
        ),
        (
            {"arms": ({"algorithm": "PPO", "seeds": [0, -1]},)},
            r"seeds\[1\] must be a whole number from 0 to \d+, got -1",
        ),
        ({"arms": (Arm("PPO", settings={"pases": 3}),)}, "unknown setting of PPO 'pases' .did you mean 'passes'"),
        ({"arms": (Arm("PPO", preset="papr"),)}, "no preset 'papr'; there are default, paper"),
        ({"arms": (Arm("PPO", level="Esay"),)}, "unknown level 'Esay'"),
        ({"arms": (Arm("PPO", before=(Stage("PPO", "Haard", 9),)),)}, "unknown level 'Haard'"),
        ({"arms": (Arm("PPO", before=(Stage("POP", "Hard", 9),)),)}, "unknown algorithm 'POP'"),
        (
            {"arms": ({"algorithm": "PPO", "before": [{"algorithm": "PPO", "level": "Hard", "steps": 0}]},)},
            r"before\[0\]\.steps must be a whole number of at least 1, got 0",
        ),
        ({"arms": (Arm("PPO", before=(Stage("PPO", "Hard", 9, "papr"),)),)}, "no preset 'papr'"),
        ({"starts_seed": -3}, r"starts_seed must be a whole number from 0 to \d+, got -3"),
        (
            {
                "files": {"Foo": {"file": "a.geojson"}},
                "conditions": ({"name": "fog", "rivers": ["Foo"], "files": [1]},),
            },
            r"conditions\[0\].* must be a mapping",
        ),
        ({"starts_seed": 2**63}, r"starts_seed must be a whole number from 0 to \d+, got 9223372036854775808"),
        ({"world_seeds": "99998:100002"}, "world_seeds: rivers from seed 100,000 on .* give lower seeds, not 100,001"),
    ],
)
def test_an_invalid_suite_is_refused_before_anything_runs(tmp_path: Path, change: dict, message: str):
    place = SmallBackend()
    with pytest.raises(ResultsError, match=message):
        run_suite(replace(SUITE, **change), tmp_path / "new", place)
    assert place.calls == []
    assert not (tmp_path / "new").exists()


def test_a_folder_of_another_suite_is_refused_with_the_difference(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    longer = Arm("FOCOPS", seeds=(0, 1), steps=200)
    with pytest.raises(
        ResultsError, match=r"belongs to another suite: arms\.FOCOPS\.steps is 100 there and 200 here\. Choose"
    ):
        run_suite(replace(SUITE, arms=(SUITE.arms[0], longer)), tmp_path, SmallBackend())
    with pytest.raises(
        ResultsError, match=r"arms\.FOCOPS is present there and absent here; episodes is 3 there and 4 here"
    ):
        run_suite(replace(SUITE, arms=SUITE.arms[:1], episodes=4), tmp_path, SmallBackend())


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"world_seeds": (7, 8)}, r"world_seeds is \[7, 8\] there and \[\] here"),
        ({"observation": "privileged"}, "observation is 'privileged' there and 'frames' here"),
        ({"encoder": "geometry"}, "encoder is 'geometry' there and 'default' here"),
    ],
)
def test_a_setting_that_is_left_out_again_is_a_difference(given: dict[str, Any], told: str, tmp_path: Path):
    claim(tmp_path, replace(SUITE, **given))
    with pytest.raises(ResultsError, match=told):
        claim(tmp_path, SUITE)


def test_a_copy_without_a_packaged_policy_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    before = installed_versions()
    monkeypatch.setattr(backend, "PACKAGED_POLICY", tmp_path / "policy.safetensors")
    assert installed_versions() == before | {"packaged": None}
    (tmp_path / "policy.safetensors").write_bytes(b"flies well")
    assert installed_versions() == before


def test_a_folder_with_something_else_in_it_is_refused(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(
        ResultsError,
        match=r"holds thesis\.tex, but no suite\.json: it is not the folder of a suite\. Give a new or empty one",
    ):
        run_suite(SUITE, tmp_path, SmallBackend())


def test_without_a_packaged_policy_the_other_runs_are_executed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setattr("thalweg.bench.execute.executors.PACKAGED_POLICY", tmp_path / "nothing")
    outcome = run_suite(replace(SUITE, packaged=True), tmp_path / "out", SmallBackend())
    assert [row.run for row in outcome.runs if row.status == "absent"] == ["packaged-0"]
    assert outcome.failed == []
    assert "comes without a trained policy" in capsys.readouterr().out
    assert "packaged-0 absent" in outcome.report.page.read_text()


def test_the_film_shows_the_best_flight_of_a_trained_policy_and_says_so(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    found = best_of_all(SUITE, read_results(tmp_path))
    assert found is not None
    rows = [row for row in read_results(tmp_path).episodes if row.level == "Medium" and row.algorithm != "hover"]
    best = max(rows, key=lambda row: row.return_)
    assert (found.run.name, found.episode) == (f"{best.algorithm}-{best.seed}", best)
    returns = [row.return_ for row in rows if row.algorithm == best.algorithm]
    assert (tmp_path / "film.txt").read_text() == (
        f"{found.run.name} on Medium, start {best.episode} of the list: {best.length} steps, "
        f"return {best.return_:.2f}, cost {best.cost:.1f}, {REASON_TEXT[best.reason]}. "
        f"The best of 12 flights of trained policies there. The 6 flights of "
        f"{best.algorithm} have a mean return of {np.mean(returns):.2f} ± {np.std(returns):.2f}.\n"
    )


def test_a_suite_without_films_makes_none_and_may_be_filmed_later(tmp_path: Path):
    first, later = SmallBackend(), SmallBackend()
    outcome = run_suite(replace(SUITE, film="none"), tmp_path, first)
    assert outcome.report.film is None and not any(call.startswith("film") for call in first.calls)
    assert not (tmp_path / "films").exists() and "film" not in json.loads((tmp_path / "suite.json").read_text())
    run_suite(SUITE, tmp_path, later)
    assert [call.split()[0] for call in later.calls] == ["film"] * FILMS


@pytest.mark.parametrize(("film", "whose"), [("packaged", "packaged-0"), ("best", "FOCOPS-0")])
def test_the_main_film_is_that_of_the_packaged_policy_or_of_the_best_trained_one(tmp_path: Path, film: Any, whose: str):
    suite = replace(SUITE, packaged=True, film=film)
    run_suite(SUITE, tmp_path, SmallBackend())
    results = read_results(tmp_path)
    row = next(row for row in results.episodes if row.level == "Medium" and row.algorithm == "FOCOPS" and row.seed == 0)
    trained = replace(row, return_=9.0)
    packaged = replace(row, algorithm="packaged", return_=9.9)
    found = best_of_all(suite, replace(results, episodes=[trained, packaged]))
    assert found is not None and found.run.name == whose


def test_of_flights_of_the_same_return_that_with_the_least_cost_is_the_best_and_of_those_the_first(tmp_path: Path):
    run_suite(replace(SUITE, film="none"), tmp_path, SmallBackend())
    results = read_results(tmp_path)
    flown = [row for row in results.episodes if (row.algorithm, row.seed, row.level) == ("PPO", 0, "Medium")]
    alike = [
        replace(row, return_=6.0, cost=cost, episode=place)
        for row, cost, place in zip(flown, (0.2, 0.0, 0.0), (0, 2, 1), strict=True)
    ]
    best, *_ = policy_shots(SUITE, replace(results, episodes=alike))
    assert (best.episode.cost, best.episode.episode) == (0.0, 1)


def test_another_best_flight_is_filmed_again(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend(broken=("PPO-0", "PPO-1", "FOCOPS-1")))
    assert "The best of 3 flights" in (tmp_path / "film.txt").read_text()
    again = SmallBackend()
    run_suite(SUITE, tmp_path, again)
    assert len([call for call in again.calls if call.startswith("film ")]) == FILMS
    assert "The best of 12 flights" in (tmp_path / "film.txt").read_text()


def test_a_film_that_fails_does_not_lose_the_report_and_is_tried_again(tmp_path: Path):
    outcome = run_suite(SUITE, tmp_path, SmallBackend(broken=("film",)))
    assert outcome.failed == []
    for name in ("", " films/PPO-failure"):
        assert f"<li>No film{name}: RuntimeError: ffmpeg is not there</li>" in outcome.report.page.read_text()
    again = SmallBackend()
    outcome = run_suite(SUITE, tmp_path, again)
    assert [call.split()[0] for call in again.calls] == ["film"] * FILMS
    assert "No film" not in outcome.report.page.read_text()
    assert outcome.report.film is not None


def test_a_film_that_fails_leaves_none_of_another_flight(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend(broken=("PPO-0", "PPO-1", "FOCOPS-1")))
    assert run_suite(SUITE, tmp_path, SmallBackend(broken=("film",))).report.film is None


def fly(folder: Path, run: str, ends: list[tuple[str, float]]) -> None:
    """Let a run's flights on Medium end so, each with a return."""
    path = evaluation_path(folder, run, Trial("Medium"))
    rows = read_episodes(path)
    flown = zip(rows, ends, strict=True)
    write_episodes(path, [replace(row, reason=why, success=why == "Success", return_=got) for row, (why, got) in flown])


def test_each_policy_is_filmed_at_its_best_and_in_its_typical_failure(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    fly(tmp_path, "PPO-0", [("Collision", 1.0), ("Idle", 5.0), ("Collision", 6.0)])
    fly(tmp_path, "PPO-1", [("Collision", 2.0), ("Idle", 4.0), ("Success", 5.5)])
    run_suite(SUITE, tmp_path, SmallBackend())
    best, failure, *_ = policy_shots(SUITE, read_results(tmp_path))
    assert (best.name, best.run.name, best.episode.return_) == ("films/PPO-best", "PPO-0", 6.0)
    assert (failure.name, failure.run.name, failure.episode.return_) == ("films/PPO-failure", "PPO-1", 2.0)
    assert best.why == "The best of PPO's 6 flights there, of which 1 succeeded."
    assert (tmp_path / "films" / "PPO-failure.txt").read_text() == failure.caption("PPO-1")
    assert failure.why == "5 of PPO's 6 flights there failed, 3 of them like this one, whose return is in their middle."


def test_of_a_policy_that_flew_elsewhere_than_it_was_trained_there_is_no_film(tmp_path: Path):
    suite = replace(SUITE, arms=(replace(SUITE.arms[0], level="Easy"), SUITE.arms[1]), test_levels=("Medium",))
    run_suite(suite, tmp_path, SmallBackend())
    assert {path.stem for path in (tmp_path / "films").glob("*.mp4")} == {"FOCOPS-best", "FOCOPS-failure"}


def test_an_evaluation_that_cannot_be_used_stops_neither_films_nor_the_report(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    (tmp_path / "evaluation" / "PPO-0-Medium.csv").write_text("algorithm,see")
    outcome = run_suite(SUITE, tmp_path, SmallBackend(), only=("FOCOPS",))
    assert any(line.startswith("Not used: evaluation/PPO-0-Medium.csv") for line in outcome.report.problems)
    assert "of PPO's 3 flights" in (tmp_path / "films" / "PPO-best.txt").read_text()


def test_films_that_show_nothing_of_the_results_any_more_go(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    for run in ("PPO-0", "PPO-1"):
        path = tmp_path / "evaluation" / f"{run}-Medium.csv"
        write_episodes(path, [replace(row, reason="Success", success=True) for row in read_episodes(path)])
    (tmp_path / "films" / "PPO-notes.txt").write_text("mine")
    run_suite(SUITE, tmp_path, SmallBackend())
    left = sorted(path.name for path in (tmp_path / "films").iterdir())
    assert left == [
        "FOCOPS-best.mp4", "FOCOPS-best.txt", "FOCOPS-failure.mp4", "FOCOPS-failure.txt",
        "PPO-best.mp4", "PPO-best.txt", "PPO-notes.txt",
    ]  # fmt: skip


def test_a_full_disk_is_not_taken_for_a_film_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    place = SmallBackend()
    monkeypatch.setattr(place, "film", full)
    with pytest.raises(OSError, match="No space"):
        run_suite(SUITE, tmp_path, place)


def test_the_record_of_a_suite_names_versions_and_machine(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    record = json.loads((tmp_path / "suite.json").read_text())
    assert [arm["name"] for arm in record["arms"]] == ["PPO", "FOCOPS"] and record["arms"][0]["steps"] == 100
    assert record["machine"]["cores"] >= 1
    assert set(record["versions"]) == {"thalweg", "python", "numpy", "scipy", "numba", "torch", "gymnasium"}
    assert (record["env"]["max_height_m"], record["env"]["camera"]["fov_deg"]) == (15.0, 60.0)


def test_the_suites_are_found_by_name_and_an_unknown_one_lists_them():
    assert suite_named("Quick") is SUITES["quick"]
    arms = SUITES["paper"].arms
    published = ("PPO-paper", "FOCOPS-paper", "TD3Lag-paper", "SafeLOOP-paper")
    assert [arm.label for arm in arms] == ["PPO", "PPO-symmetric", *STUDIED[1:], "CPO", "CUP", *published]
    assert {(arm.steps, arm.seeds) for arm in arms} == {(200_000, (0, 1, 2))}
    with pytest.raises(
        ResultsError, match=r"unknown suite 'papr' .did you mean 'paper'.*; known: quick, easy, open, protocols, paper"
    ):
        suite_named("papr")


@pytest.mark.parametrize(("name", "meant"), [("hovr", "hover"), ("FOCOPS-9", "FOCOPS-"), ("pakaged", "packaged")])
def test_an_unknown_name_in_only_is_refused_with_a_suggestion_and_the_known_names(name: str, meant: str):
    known = "name one of random, hover, forward, pilot, packaged, PPO, FOCOPS, or one run, such as FOCOPS-0"
    with pytest.raises(ResultsError, match=f"suite quick has no '{name}' .did you mean '{meant}.*'.*; {known}"):
        selected_runs(SUITES["quick"], (name,))


@pytest.mark.parametrize("name", SUITES)
def test_a_builtin_suite_can_be_started(name: str, tmp_path: Path):
    """Nothing runs: `only` is checked first, and holds an unknown name."""
    with pytest.raises(ResultsError, match=f"suite {name} has no 'nobody'; name one of "):
        run_suite(SUITES[name], tmp_path / "new", SmallBackend(), only=("nobody",))


def test_each_protocol_takes_as_many_steps():
    totals = [arm.steps + sum(stage.steps for stage in arm.before) for arm in SUITES["protocols"].arms]
    assert totals == [200_000] * 4


def test_the_help_says_what_may_be_done_alone_and_its_examples_can_be(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setenv("COLUMNS", "160")
    with pytest.raises(SystemExit):
        main(["bench", "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "Policies (FOCOPS, hover), with all their seeds, or runs (PPO-0)" in said
    assert "such as --only FOCOPS PPO-0" in said
    for name in ("FOCOPS", "FOCOPS-paper", "hover", "packaged"):
        assert {run.algorithm for run in selected_runs(SUITES["paper"], (name,))} == {name}
    runs = selected_runs(SUITES["paper"], ("FOCOPS", "PPO-0"))
    assert [run.name for run in runs] == ["PPO-0", "FOCOPS-0", "FOCOPS-1", "FOCOPS-2"]


def test_a_folder_is_held_until_its_report_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A second suite that begins in the same new folder neither writes its record nor films."""
    refused, folder = [], tmp_path / "new"

    def also_begun(name: str) -> Callable[..., Any]:
        before = getattr(runner, name)

        def called(*given: Any, **options: Any) -> Any:
            with pytest.raises(ResultsError, match="another command is writing to"):
                run_suite(replace(SUITE, name="second"), folder, SmallBackend())
            refused.append(name)
            return before(*given, **options)

        return called

    for name in ("execute_runs", "film_flights", "write_report"):
        monkeypatch.setattr(runner, name, also_begun(name))
    run_suite(SUITE, folder, SmallBackend())
    assert refused == ["execute_runs", "film_flights", "write_report"]
    assert json.loads((folder / "suite.json").read_text())["name"] == "small"


def test_a_foreign_folder_is_refused_without_a_trace(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(ResultsError, match=r"holds thesis\.tex, but no suite\.json"):
        run_suite(SUITE, tmp_path, SmallBackend())
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_suite_that_another_process_executes_is_refused(tmp_path: Path):
    backend_ = SmallBackend()
    with RESULTS_FOLDER.locked(tmp_path), pytest.raises(ResultsError, match="another command is writing to"):
        run_suite(SUITE, tmp_path, backend_)
    assert backend_.calls == []
