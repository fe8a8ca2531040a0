"""The ladder of rivers and the ablations: planned arms, rows, cells that are flown once, and the page."""

import csv
import importlib
import sys
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from thalweg.bench.csv_files import read_csv
from thalweg.bench.evaluate.episodes import Episode
from thalweg.core import versions
from thalweg.encoder.encoder import encoder_path

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPTS = ("any_river", "ladder_arms", "ladder_page", "ladder", "river_flights")
FIGURES = {"return": "9.000", "return_error": "0.100", "violations": "0.0200", "cost": "0.01", "reasons": "Success=2"}


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in SCRIPTS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("ladder")


@pytest.fixture
def arms(script: ModuleType) -> ModuleType:
    return sys.modules["ladder_arms"]


@pytest.fixture
def page(script: ModuleType) -> ModuleType:
    return sys.modules["ladder_page"]


@pytest.fixture
def student(arms: ModuleType) -> Any:
    return arms.Arm("student", arms.STUDENT, 4, "fixed", 0, 400_000)


def labels(found: list[Any], name: str) -> list[str]:
    return [arm.label for arm in found if arm.name == name]


def test_the_ladder_has_three_seeds_on_two_rungs(arms: ModuleType):
    found = arms.ladder_arms()
    fixed = [label for label in labels(found, "FOCOPS") if "fixed" in label]
    assert fixed == [
        "FOCOPS-1-fixed-0",
        "FOCOPS-4-fixed-0",
        *(f"FOCOPS-16-fixed-{seed}" for seed in range(3)),
        *(f"FOCOPS-64-fixed-{seed}" for seed in range(3)),
        "FOCOPS-256-fixed-0",
    ]
    assert labels(found, "FOCOPS")[:3] == ["FOCOPS-1-fixed-0", "FOCOPS-1-varied-0", "FOCOPS-4-fixed-0"]
    assert len(found) == 36 and len({arm.label for arm in found}) == 36
    assert {(arm.name, arm.steps) for arm in found} == {("student", 400_000), ("FOCOPS", 200_000)}


def test_the_last_rung_of_a_climber_on_three_levels_is_bounded_by_memory(arms: ModuleType):
    most = max((arm for arm in arms.ladder_arms() if arm.name == "student"), key=lambda arm: arm.rivers)
    assert (most.rivers, most.rivers * len(most.levels), most.seeds) == (128, 384, range(1000, 1128))


def test_ablations_differ_from_the_whole_student_in_one_setting(arms: ModuleType):
    whole = arms.whole_student()
    assert whole.label in [arm.label for arm in arms.ladder_arms()]
    differing = {
        arm.name: [name for name, value in arm.resolved.items() if value != whole.resolved[name]]
        for arm in arms.ablation_arms()
    }
    assert differing == {
        "scripted-teacher": ["teacher"],
        "no-memory": ["memory_size"],
        "no-dagger": ["teacher_steps"],
        "no-auxiliary-heads": ["auxiliary_weight"],
        "no-mask": ["observation"],
        "no-new-starts": ["start_share"],
    }
    assert {(arm.rivers, arm.looks, arm.seed, arm.steps) for arm in arms.ablation_arms()} == {
        (64, "varied", 0, 400_000)
    }


def test_focops_on_other_codes_and_end_to_end_stands_beside_the_climber_that_sees_geometry(arms: ModuleType):
    found = arms.compared_arms()
    names = ("FOCOPS-vae-16", "FOCOPS-cnn-16", "FOCOPS-hard-64")
    assert [arm.label for arm in found] == [f"{name}-fixed-{seed}" for name in names for seed in range(3)]
    beside = next(arm for arm in arms.ladder_arms() if arm.label == "FOCOPS-16-fixed-0")
    vae, cnn, hard = found[::3]
    assert {(arm.algorithm, arm.steps) for arm in (*found, beside)} == {("FOCOPS", 200_000)}
    assert [(arm.levels, arm.further) for arm in (vae, cnn, hard)] == [
        (("Medium",), ("Hard",)),
        (("Medium",), ("Hard",)),
        (("Hard",), ("Medium",)),
    ]
    assert hard.key[8] == beside.key[8]
    assert [arm.sees_images for arm in (vae, cnn, beside)] == [False, True, False]
    assert len({vae.key[8], beside.key[8], "none"}) == 3
    assert encoder_path(beside.encoder) == encoder_path("geometry")
    assert cnn.resolved["policy"] == "cnn" and cnn.key[8] == "none" and "privileged" in cnn.training_versions


def test_looks_reach_a_student_by_its_settings(student: Any):
    assert student.resolved["varied_looks"] is False
    assert replace(student, looks="varied").resolved["varied_looks"] is True


def test_students_are_flown_on_their_levels_and_focops_on_hard_too(arms: ModuleType, student: Any):
    assert [(cell.kind, cell.level) for cell in student.cells(5, ["varied"])] == [
        ("varied", "Easy"),
        ("varied", "Medium"),
        ("varied", "Hard"),
    ]
    focops = next(arm for arm in arms.ladder_arms() if arm.name == "FOCOPS")
    assert [(cell.kind, cell.level) for cell in focops.cells(5)] == [
        ("seen", "Medium"),
        ("unseen", "Medium"),
        ("unseen", "Hard"),
        ("varied", "Medium"),
        ("varied", "Hard"),
    ]


def test_arms_and_folders_differ_by_all_that_they_depend_on(
    arms: ModuleType, student: Any, monkeypatch: pytest.MonkeyPatch
):
    others = [
        replace(student, rivers=1),
        replace(student, levels=("Hard",)),
        replace(student, first_river=7),
        replace(student, looks="varied"),
        replace(student, seed=1),
        replace(student, steps=8),
        replace(student, settings={"memory_size": 0}),
        arms.Arm("student", "FOCOPS", 4, "fixed", 0, 400_000),
    ]
    found = [student, *others]
    assert len({arm.key for arm in found}) == len({arm.folder for arm in found}) == 9
    before = student.key, student.folder
    monkeypatch.setattr(versions, "RULES", versions.RULES + 1)
    assert student.key != before[0] and student.folder != before[1]


def test_another_evaluation_flies_again_but_does_not_train(student: Any, monkeypatch: pytest.MonkeyPatch):
    before = student.key, student.folder
    monkeypatch.setattr(versions, "EVALUATION", versions.EVALUATION + 1)
    assert student.key != before[0] and student.folder == before[1]


def test_another_encoder_is_another_arm_of_focops(arms: ModuleType, student: Any, monkeypatch: pytest.MonkeyPatch):
    focops = replace(student, algorithm="FOCOPS")
    before = focops.key, student.key
    monkeypatch.setattr(arms, "hash_of_encoder", lambda encoder: f"other {encoder}")
    assert focops.key != before[0] and focops.key[8] == "other None" and student.key == before[1]


@pytest.mark.parametrize(
    ("rivers", "expected"),
    [
        (1, [(1000, [0, 1, 2, 3, 4])]),
        (2, [(1000, [0, 2, 4]), (1001, [1, 3])]),
        (9, [(1000 + i, [i]) for i in range(5)]),
    ],
)
def test_seen_flights_are_spread_over_the_rivers_of_training(arms: ModuleType, student: Any, rivers: int, expected):
    cell = arms.Cell(replace(student, rivers=rivers), "seen", "Easy", 5)
    assert [(course.world.seed, course.indices.tolist()) for course in cell.courses(drawn=False)] == expected


def test_unseen_flights_are_on_other_rivers(arms: ModuleType, student: Any):
    cell = arms.Cell(student, "unseen", "Easy", 3)
    found = [(course.world.seed, course.indices.tolist(), course.looks) for course in cell.courses(drawn=False)]
    assert found == [(100_000, [0], None), (100_001, [1], None), (100_002, [2], None)]


def test_varied_flights_have_a_look_each(arms: ModuleType, student: Any, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.bench.evaluate.course.relit", lambda world, azimuth, elevation: world)
    looks = [course.looks for course in arms.Cell(student, "varied", "Easy", 3).courses(drawn=False)]
    assert [look.shape[0] for look in looks] == [1, 1, 1] and len({look.tobytes() for look in looks}) == 3


def test_students_act_by_their_most_probable_options_and_others_sample(arms: ModuleType, student: Any):
    assert arms.Cell(student, "seen", "Easy", 3).config.deterministic
    assert not arms.Cell(replace(student, algorithm="FOCOPS"), "seen", "Easy", 3).config.deterministic


def test_a_row_by_hand(script: ModuleType, student: Any):
    fields: dict[str, Any] = dict.fromkeys(Episode.__dataclass_fields__, 0)
    flights = [
        Episode(**(fields | {"return_": value, "cost": cost, "reason": reason}))
        for value, cost, reason in ((10.0, 0.0, "Success"), (4.0, 1.0, "Collision"))
    ]
    row = script.row_of(script.Cell(student, "seen", "Hard", 2), script.figures_of(flights))
    made_with = f"imitation={versions.IMITATION} render={versions.RENDER} rules={versions.RULES} world={versions.WORLD}"
    config = row.pop("config")
    assert len(config) == 8 and row == {
        "arm": "student",
        "levels": "Easy Medium Hard",
        "rivers": "4",
        "first_river": "1000",
        "looks": "fixed",
        "seed": "0",
        "steps": "400000",
        "encoder": "none",
        "versions": f"{made_with} evaluation={versions.EVALUATION}",
        "kind": "seen",
        "level": "Hard",
        "episodes": "2",
        "return": "7.000",
        "return_error": "3.000",  # deviation sqrt(18) by the root of 2
        "violations": "0.5000",
        "cost": "0.5000",
        "reasons": "Collision=1 Success=1",
    }
    assert tuple(row) == tuple(name for name in script.COLUMNS if name != "config")


def run_here(monkeypatch: pytest.MonkeyPatch, script: ModuleType) -> None:
    """Run tasks in this process, one at a time."""

    class Pool:
        def __init__(self, jobs: int, context: Any, initializer: Any) -> None:
            pass

        def __enter__(self) -> "Pool":
            return self

        def __exit__(self, *error: object) -> None:
            pass

        def submit(self, task: Any) -> Any:
            future = script.Future()
            try:
                future.set_result(task())
            except Exception as error:
                future.set_exception(error)
            return future

    monkeypatch.setattr(script, "ProcessPoolExecutor", Pool)


@pytest.fixture
def flown(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What would have been trained and flown."""
    run_here(monkeypatch, script)
    done: list[str] = []

    def train(arm: Any, folder: Path, threads: int | None, device: str) -> None:
        done.append(f"train {arm.label}")
        if arm.name == "no-mask":
            raise ValueError("no")

    def measure(cell: Any, folder: Path) -> dict[str, str]:
        done.append(f"fly {cell.kind} {cell.level}")
        return script.row_of(cell, FIGURES)

    monkeypatch.setattr(script, "train", train)
    monkeypatch.setattr(script, "measure", measure)
    return done


def test_each_arm_is_trained_and_its_cells_that_have_no_row_are_flown(
    script: ModuleType, arms: ModuleType, flown: list[str], tmp_path: Path, capsys
):
    table = tmp_path / "table.csv"
    arguments = ["--only", "student-1-*-0", "--kinds", "unseen", "--episodes", "4", "--out", str(table)]
    first = next(arm for arm in arms.ladder_arms() if arm.label == "student-1-fixed-0")
    for level in ("Easy", "Hard"):
        script.append(table, script.COLUMNS, script.row_of(script.Cell(first, "unseen", level, 4), FIGURES))
    assert script.main(arguments) == 0
    varied = ["fly unseen Easy", "fly unseen Medium", "fly unseen Hard"]
    assert flown == ["train student-1-fixed-0", "fly unseen Medium", "train student-1-varied-0", *varied]
    assert "student-1-fixed-0: 1 of 3 cells are to be flown" in capsys.readouterr().out
    assert len(read_csv(table, script.COLUMNS)) == 6
    flown.clear()
    assert script.main(arguments) == 0 and flown == []


def test_an_arm_that_fails_is_named_and_the_others_go_on(script: ModuleType, flown: list[str], tmp_path: Path, capsys):
    table = tmp_path / "table.csv"
    chosen = ["--only", "no-m*", "--kinds", "seen", "--out", str(table)]
    assert script.main(chosen) == 1
    assert flown == [
        "train no-memory-64-varied-0",
        *(f"fly seen {level}" for level in ("Easy", "Medium", "Hard")),
        "train no-mask-64-varied-0",
    ]
    assert capsys.readouterr().err.endswith("failed: no-mask-64-varied-0: ValueError: no\n")
    with open(table, newline="") as file:
        assert {row["arm"] for row in csv.DictReader(file)} == {"no-memory"}


def test_nothing_else_is_begun_after_a_process_was_killed(
    script: ModuleType, flown: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    def killed(arm: Any, folder: Path, threads: int | None, device: str) -> None:
        flown.append(arm.label)
        raise BrokenProcessPool("killed")

    monkeypatch.setattr(script, "train", killed)
    assert script.main(["--only", "no-m*", "--out", str(tmp_path / "table.csv")]) == 1
    assert flown == ["no-memory-64-varied-0"]
    assert "failed: no-memory-64-varied-0: BrokenProcessPool: killed" in capsys.readouterr().err


def test_other_steps_are_other_cells(script: ModuleType, flown: list[str], tmp_path: Path):
    arguments = ["--only", "FOCOPS-4-fixed-0", "--kinds", "seen", "--out", str(tmp_path / "table.csv")]
    assert script.main(arguments) == script.main([*arguments, "--steps", "7"]) == 0
    assert flown == ["train FOCOPS-4-fixed-0", "fly seen Medium"] * 2
    assert [row["steps"] for row in read_csv(tmp_path / "table.csv", script.COLUMNS)] == ["200000", "7"]


def test_arms_are_listed_without_training(script: ModuleType, flown: list[str], tmp_path: Path, capsys):
    assert script.main(["--list", "--out", str(tmp_path / "table.csv"), "--only", "*-256-*"]) == 0
    assert capsys.readouterr().out == (
        "FOCOPS-256-fixed-0: 5 of 5 cells are to be flown\nFOCOPS-256-varied-0: 5 of 5 cells are to be flown\n"
    )
    assert flown == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "student-2-*"], "--only student-2-* matches no arm; --list shows their labels"),
        (["--episodes", "1"], "--episodes must be at least 2, --jobs and --steps at least 1"),
        (["--steps", "0"], "--jobs and --steps at least 1"),
    ],
)
def test_wrong_arguments_are_refused(script: ModuleType, arguments: list[str], message: str, capsys):
    with pytest.raises(SystemExit):
        script.main(arguments)
    assert message in capsys.readouterr().err


def row(script: ModuleType, arm: Any, kind: str, level: str, returned: float, episodes: int = 50) -> dict[str, str]:
    return script.row_of(script.Cell(arm, kind, level, episodes), FIGURES | {"return": str(returned)})


def test_the_table_of_the_ladder_has_intervals_over_three_seeds(
    script: ModuleType, arms: ModuleType, page: ModuleType, student: Any
):
    rows = [row(script, replace(student, rivers=16, seed=seed), "unseen", "Medium", 7.0 + seed) for seed in range(3)]
    rows += [row(script, student, "unseen", "Medium", 6.5), row(script, student, "seen", "Medium", 9.0)]
    focops = replace(arms.CLIMBERS[1], rivers=256, looks="varied")
    rows.append(row(script, focops, "varied", "Hard", 3.0))
    table = " ".join(page.ladder_table(page.current_rows(rows)).split())
    # Student's t of two degrees of freedom, 4.303, times 1 / sqrt(3), is 2.48; the interval ends at 10.
    assert "| student | fixed | 16 | 400,000 | 3 | | 8.00 [5.52, 10.00], 2.0% | | | |" in table
    assert "| student | fixed | 4 | 400,000 | 1 | 9.00, 2.0% | 6.50, 2.0% | | | |" in table
    assert "| FOCOPS | varied | 256 | 200,000 | 1 | | | | | 3.00, 2.0% |" in table


def test_only_rows_of_today_are_shown_and_of_those_the_longest_training(
    script: ModuleType, page: ModuleType, student: Any
):
    def given(steps: int, episodes: int) -> dict[str, str]:
        return row(script, replace(student, steps=steps), "unseen", "Easy", steps + episodes, episodes)

    rows = [given(8, 4), given(9, 2), given(9, 3), given(7, 9)]
    outdated = given(20, 4) | {"versions": "imitation=0"}
    other = given(30, 4) | {"config": "00000000"}
    assert page.current_rows([*rows, outdated, other]) == [rows[2]]


def test_the_table_of_ablations_compares_with_the_whole_student(script: ModuleType, arms: ModuleType, page: ModuleType):
    whole = arms.whole_student()
    blind = next(arm for arm in arms.ablation_arms() if arm.name == "no-memory")
    rows = [row(script, arm, "unseen", "Hard", value) for arm, value in ((blind, 4.0), (whole, 9.0))]
    rows.append(row(script, replace(whole, seed=1), "unseen", "Hard", 1.0))
    table = " ".join(page.ablation_table(page.current_rows(rows)).split())
    assert table.endswith(
        "| the whole student | unseen | 400,000 | | | 9.00, 2.0% | | no memory | unseen | 400,000 | | | 4.00, 2.0% |"
    )


MARKS = "before\n<!-- ladder -->\nold\n<!-- /ladder -->\nbetween\n<!-- ablations -->\nold\n<!-- /ablations -->\nafter\n"


def test_the_page_says_what_has_not_been_measured(script: ModuleType, page: ModuleType, student: Any):
    empty = page.written_page(MARKS, [])
    assert empty.count("This has not been measured yet.") == 2 and "old" not in empty
    written = page.written_page(MARKS, [row(script, student, "seen", "Medium", 9.0)])
    assert "![Return over the number of rivers](images/ladder.png)" in written
    assert written.count("This has not been measured yet.") == 1


def test_the_plot_has_a_line_for_each_climber_and_kind(script: ModuleType, page: ModuleType, student: Any, monkeypatch):
    rows = [row(script, replace(student, rivers=rivers), "unseen", "Medium", rivers / 8) for rivers in (1, 4)]
    rows += [row(script, replace(student, rivers=16, seed=seed), "unseen", "Medium", 5.0 + seed) for seed in range(3)]
    rows.append(row(script, student, "seen", "Medium", 9.0))
    figures = []
    monkeypatch.setattr(page, "png", lambda figure: figures.append(figure) or b"png")
    assert page.drawn_ladder([]) is None and page.drawn_ladder(rows) == b"png"
    fixed, varied = figures[0].axes
    drawn = {container.get_label(): container.lines[0] for container in fixed.containers}
    assert set(drawn) == {"student, seen", "student, unseen"} and not varied.containers
    assert drawn["student, unseen"].get_xydata() == pytest.approx(np.array([[1.08, 0.125], [4.32, 0.5], [17.28, 6.0]]))
    assert drawn["student, seen"].get_xydata() == pytest.approx(np.array([[4 / 1.08, 9.0]]))
    (bars,) = fixed.containers[1].lines[2]
    lengths = [segment[1, 1] - segment[0, 1] for segment in bars.get_segments()]
    assert lengths == pytest.approx([0.0, 0.0, 2 * 2.4841], abs=1e-3)


SMALL = {
    "sequence": 4,
    "sequences_per_batch": 2,
    "filters": [4, 4, 4, 4],
    "features": 8,
    "memory_size": 8,
    "hidden": [8],
    "capacity": 64,
}


@pytest.mark.slow
def test_a_small_student_is_trained_flown_and_resumed(script: ModuleType, student: Any, tmp_path: Path):
    arm = replace(student, rivers=1, steps=128, levels=("Easy",), settings=SMALL)
    tasks = [script.Task(arm, tmp_path / arm.folder, 1, "cpu", tuple(arm.cells(2, ["seen", "unseen"])))]
    assert script.work_through(tasks, 1, tmp_path / "table.csv") == []
    rows = read_csv(tmp_path / "table.csv", script.COLUMNS)
    assert [(row["kind"], row["level"], row["steps"]) for row in rows] == [
        ("seen", "Easy", "128"),
        ("unseen", "Easy", "128"),
    ]
    assert all(sum(int(count.split("=")[1]) for count in row["reasons"].split()) == 2 for row in rows)
    assert script.missing_cells(arm, rows, 2, ["seen", "unseen"]) == []
    finished = (tmp_path / arm.folder / "metrics.csv").read_bytes()
    assert script.work_through(tasks, 1, tmp_path / "again.csv") == []
    assert read_csv(tmp_path / "again.csv", script.COLUMNS) == rows
    assert (tmp_path / arm.folder / "metrics.csv").read_bytes() == finished
