"""The benchmark of policies that fly any river: its rows, its cells that are flown once, and its table."""

import csv
import importlib
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.policy import Policy
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.episodes import Episode
from thalweg.core import versions
from thalweg.env.spaces import action_space


def episode(returned: float, cost: float, reason: str) -> Episode:
    fields: dict[str, Any] = dict.fromkeys(Episode.__dataclass_fields__, 0)
    return Episode(**(fields | {"return_": returned, "cost": cost, "reason": reason}))


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "any_river", raising=False)
    return importlib.import_module("any_river")


@pytest.fixture
def cell(script: ModuleType) -> Any:
    return script.Cell("mask", 9, 1, "unseen", "Hard", 4)


def test_a_row_by_hand(script: ModuleType, cell: Any):
    flights = [episode(10.0, 0.0, "Success")] * 2 + [episode(2.0, 1.0, "Collision"), episode(6.0, 0.2, "Idle")]
    row = script.row_of(cell, flights)
    assert row["return"] == "7.000" and row["violations"] == "0.5000" and row["cost"] == "0.3000"
    assert row["return_error"] == "1.915"  # deviation sqrt((9 + 9 + 25 + 1) / 3) = 3.830, halved
    assert row["reasons"] == "Collision=1 Idle=1 Success=2"
    assert (row["imitation"], row["render"]) == (str(versions.IMITATION), str(versions.RENDER))


def test_a_training_that_ends_now_gets_a_row(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    pool = SimpleNamespace(submit=lambda *_: SimpleNamespace(result=lambda: (61.25, 7.5)))
    monkeypatch.setattr(script, "ProcessPoolExecutor", lambda *_: nullcontext(pool))
    student, table = script.Cell("rgb+mask", 9, 1, "unseen", "Hard", 4), tmp_path / "trainings.csv"
    folder = script.trained(tmp_path, student, table)
    (row,) = csv.DictReader(table.open())
    assert (row["policy"], row["steps"], row["seed"]) == ("rgb+mask", "9", "1")
    assert (row["minutes"], row["peak_gib"]) == ("61.2", "7.50")
    folder.mkdir()
    (folder / "policy.safetensors").touch()  # trained before: no second row
    script.trained(tmp_path, student, table)
    assert len(list(csv.DictReader(table.open()))) == 1


def test_a_student_of_the_image_alone_learns_last_from_full_frames(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    learnt: list[Any] = []

    def submit(_: Any, imitation: Any) -> Any:
        imitation.folder.mkdir(exist_ok=True)
        (imitation.folder / "policy.safetensors").touch()
        learnt.append(imitation)
        return SimpleNamespace(result=lambda: (1.0, 1.0))

    monkeypatch.setattr(script, "ProcessPoolExecutor", lambda *_: nullcontext(SimpleNamespace(submit=submit)))
    student, table = script.Cell("rgb", 10, 1, "unseen", "Hard", 4), tmp_path / "trainings.csv"
    folder = script.trained(tmp_path, student, table)
    first, last = learnt
    assert (first.steps, first.begin_with, first.settings) == (8, None, {"observation": "rgb"})
    assert (last.steps, last.begin_with, last.folder) == (2, first.folder, folder)
    assert last.settings == {"observation": "rgb", **script.FULL} and last.settings["quality"] == "full"
    assert [row["steps"] for row in csv.DictReader(table.open())] == ["8", "10"]
    assert first.folder == script.student_folder(tmp_path, student, 1)
    assert first.folder != script.student_folder(tmp_path, script.Cell("rgb", 8, 1, "fixed", "Easy", 4))
    (folder / "policy.safetensors").unlink()
    script.trained(tmp_path, student, table)
    assert learnt[2:] == [last]  # the first training is not repeated


def test_a_training_is_timed_with_the_memory_of_its_process(script: ModuleType):
    minutes, peak = script.timed(SimpleNamespace(run=lambda progress: SimpleNamespace(seconds=90.0)))
    assert minutes == 1.5 and 0.05 < peak < 64


def test_cells_differ_by_all_that_they_are(script: ModuleType, cell: Any):
    others = [
        script.Cell("rgb", 9, 1, "unseen", "Hard", 4),
        script.Cell("mask", 8, 1, "unseen", "Hard", 4),
        script.Cell("mask", 9, 2, "unseen", "Hard", 4),
        script.Cell("mask", 9, 1, "fixed", "Hard", 4),
        script.Cell("mask", 9, 1, "unseen", "Easy", 4),
        script.Cell("mask", 9, 1, "unseen", "Hard", 5),
    ]
    assert len({cell.key for cell in [cell, *others]}) == 7


def test_unseen_flights_are_on_as_many_rivers(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    of_seeds = script.Course.of_seeds
    monkeypatch.setattr(script.Course, "of_seeds", lambda *given, drawn: of_seeds(*given, drawn=False))
    flights = script.Cell("steady", 0, 0, "unseen", "Easy", 3).fly(BASELINES["steady"])
    assert [flight.reason for flight in flights] == ["Success"] * 3
    assert len({flight.world_seed for flight in flights}) == 3


def test_the_teacher_flies_real_rivers(script: ModuleType):
    flights = script.Cell(script.TEACHER, 0, 0, "real", "Wear", 3).fly(BASELINES["steady"])
    assert [(flight.reason, flight.cost) for flight in flights] == [("Success", 0.0)] * 3


def test_levels_select_cells_but_real_rivers_are_always_flown(script: ModuleType):
    cells = script.planned_cells(("mask", 9, 0), ["fixed", "varied", "real"], ["Hard"], 4)
    found = [(cell.kind, cell.level) for cell in cells]
    rivers = [("real", "Cam"), ("real", "Wear"), ("real", "Cherwell")]
    assert found == [("fixed", "Hard"), ("varied", "Hard"), *rivers]
    teacher = script.planned_cells((script.TEACHER, 0, 0), ["fixed", "varied", "real"], ["Hard"], 4)
    assert [(cell.kind, cell.level) for cell in teacher] == [("fixed", "Hard"), *rivers]


def test_varied_flights_have_a_look_each(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    of_seeds = script.Course.of_seeds
    monkeypatch.setattr(script.Course, "of_seeds", lambda *given, drawn: of_seeds(*given, drawn=False))
    monkeypatch.setattr("thalweg.bench.evaluate.course.relit", lambda world, azimuth, elevation: world)
    looks = [course.looks for course in script.Cell("rgb", 9, 0, "varied", "Easy", 3).courses()]
    assert all(look.shape[0] == 1 for look in looks)
    assert len({look.tobytes() for look in looks}) == 3


def test_a_cell_that_has_a_row_is_not_flown_again(
    script: ModuleType, cell: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    table = tmp_path / "table.csv"
    script.append(table, script.COLUMNS, script.row_of(cell, [episode(10.0, 0.0, "Success")] * 2))
    arguments = [
        "--observations",
        "rgb",
        "--seeds",
        "0",
        "--kinds",
        "fixed",
        "--levels",
        "Easy",
        "--episodes",
        "4",
        "--steps",
        "9",
    ]
    flown = script.Cell("rgb", 9, 0, "fixed", "Easy", 4)
    script.append(table, script.COLUMNS, script.row_of(flown, [episode(1.0, 0, "Idle")] * 2))
    monkeypatch.setattr(sys, "argv", ["any_river.py", *arguments, "--out", str(table)])
    assert script.main() is None
    assert capsys.readouterr().out == "rgb 9 0: 0 of 1 cells are to be flown\n"
    with open(table, newline="") as file:
        assert len(list(csv.DictReader(file))) == 2


def test_a_cell_that_fails_is_named_and_the_rows_of_the_others_are_written(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    flights = sys.modules["river_flights"]
    monkeypatch.setattr(flights, "ProcessPoolExecutor", lambda jobs, *_: ThreadPoolExecutor(jobs))
    cells: Any = {str(place): partial(divmod, 7, place) for place in (2, 0, 3)}
    monkeypatch.setattr(flights, "append", lambda table, columns, row: table.open("a").write(f"{row}\n"))
    failed = flights.fly_cells(cells, 1, tmp_path / "table", ())
    assert failed == ["0 failed: ZeroDivisionError: integer division or modulo by zero"]
    assert (tmp_path / "table").read_text() == "(3, 1)\n(2, 1)\n"


def test_students_of_other_versions_or_rivers_have_folders_of_their_own(
    script: ModuleType, cell: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folders = [script.student_folder(tmp_path, cell)]
    monkeypatch.setitem(script.VERSIONS, "imitation", 0)
    folders.append(script.student_folder(tmp_path, cell))
    monkeypatch.setattr(script, "WORLD_SEEDS", "1:3")
    folders.append(script.student_folder(tmp_path, cell))
    assert len(set(folders)) == 3 and folders[-1] == script.student_folder(tmp_path, cell)


def test_the_table_has_means_and_intervals_over_seeds(script: ModuleType):
    rows = []
    for seed, returned in ((0, 9.0), (1, 10.0), (2, 8.0)):
        cell = script.Cell("rgb+mask", 9, seed, "unseen", "Easy", 2)
        rows.append(script.row_of(cell, [episode(returned, float(seed == 1), "Success")] * 2))
    real = script.Cell("rgb+mask", 9, 0, "real", "Cherwell", 2)
    rows.append(script.row_of(real, [episode(7.0, 0.0, "Success")] * 2))
    lines = [" ".join(line.split()) for line in script.page_table(rows).splitlines()]
    # 9 ± 4.303 x 1 / sqrt(3), held within 0 and 10; shares of 0, 1 and 0 tell nothing; Wilson's of none in two.
    assert "| rgb+mask | unseen | Easy | 3 | 9.00 [6.52, 10.00] | 33.3% [0.0, 100.0] |" in lines
    assert "| rgb+mask | real | Cherwell | 1 | 7.00 | 0.0% [0.0, 65.8] |" in lines


def test_a_cell_that_two_commands_flew_is_one_seed_with_its_last_row(script: ModuleType):
    cell = script.Cell("rgb+mask", 9, 0, "unseen", "Easy", 2)
    rows = [script.row_of(cell, [episode(returned, 0.0, "Success")] * 2) for returned in (9.0, 7.0)]
    assert script.cells_of(rows, "rgb+mask", "unseen", "Easy") == rows[1:]


@pytest.mark.parametrize(
    "ignored", [["--seeds", "1"], ["--observations", "rgb"], ["--steps", "9"], ["--device", "cuda"], ["--runs", "b"]]
)
def test_options_of_students_are_refused_beside_a_policy(
    script: ModuleType, ignored: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(sys, "argv", ["any_river.py", "--policy", "none", *ignored])
    with pytest.raises(SystemExit, match="2"):
        script.main()
    assert f"--policy trains no students; leave out {ignored[0]}\n" in capsys.readouterr().err


def test_a_policy_that_sees_no_frames_is_refused_before_any_cell_is_flown(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(script, "fly_cells", lambda *_: pytest.fail("cells are flown"))
    out, policy, generator = tmp_path / "out.csv", tmp_path / "policy.safetensors", torch.Generator()
    Policy(16, actions_of(action_space("multidiscrete")), NetworkShape((4,)), generator=generator).save(policy)
    for file, told in ((policy, f"{policy} sees no frames"), (tmp_path / "none", "there is no policy at")):
        monkeypatch.setattr(sys, "argv", ["any_river.py", "--policy", str(file), "--out", str(out)])
        with pytest.raises(SystemExit, match="2"):
            script.main()
        assert told in capsys.readouterr().err


def test_equal_shares_of_seeds_are_as_uncertain_as_their_flights(script: ModuleType):
    rows = [
        script.row_of(script.Cell("rgb", 9, seed, "fixed", "Hard", 2), [episode(9.0, 0.0, "Success")] * 2)
        for seed in range(3)
    ]
    assert "0.0% [0.0, 39.0]" in script.page_table(rows)  # Wilson's interval of none in six


def test_the_table_of_the_packaged_policies_has_seed_0_of_todays_versions(script: ModuleType):
    def row(policy: str, kind: str, level: str, seed: int = 0) -> dict[str, str]:
        cell = script.Cell(policy, 9, seed, kind, level, 4)
        return script.row_of(cell, [episode(10.0, 0.0, "Success")] * 3 + [episode(6.0, 1.0, "Collision")])

    levels = ("Easy", "Medium", "Hard")
    rows = [row(policy, "unseen", level) for policy in ("rgb+mask", "rgb") for level in levels]
    rows += [row("rgb", "unseen", "Easy", seed=1) | {"return": "0.000"}, rows[0] | {"render": "0", "return": "0.000"}]
    rows += [rows[1] | {"steps": "8", "return": "0.000"}, rows[2] | {"episodes": "3", "return": "0.000"}]
    lines = [" ".join(line.split()) for line in script.packaged_table(rows).splitlines()[2:]]
    cells = " | ".join(["9.00 ± 1.00, 25.0 %"] * 3)
    assert lines == [f"| packaged | unseen rivers | {cells} |", f"| packaged-rgb | unseen rivers | {cells} |"]


def test_the_pages_have_the_committed_tables(script: ModuleType):
    rows = script.rows_of(script.TABLE, script.COLUMNS)
    for (page, section), table in script.SECTIONS.items():
        text = page.read_text(encoding="utf-8")
        assert script.replace_section(text, section, f"{table(rows)}\n") == text


def test_of_one_seed_the_longest_training_and_the_most_episodes_count(script: ModuleType):
    rows = []
    for steps, episodes, returned in ((9, 3, 8.0), (9, 2, 7.0), (5, 4, 1.0)):
        cell = script.Cell("rgb", steps, 0, "fixed", "Hard", episodes)
        rows.append(script.row_of(cell, [episode(returned, 0.0, "Success")] * 2))
    lines = [" ".join(line.split()) for line in script.page_table(rows).splitlines()]
    assert [line for line in lines if "Hard" in line] == ["| rgb | fixed | Hard | 1 | 8.00 | 0.0% [0.0, 56.1] |"]


def test_a_trial_with_another_seed_leaves_a_line_as_it_is(script: ModuleType):
    def row(steps: int, seed: int, returned: float) -> dict[str, str]:
        cell = script.Cell("rgb", steps, seed, "fixed", "Hard", 2)
        return script.row_of(cell, [episode(returned, 0.0, "Success")] * 2)

    whole = [row(9, seed, 8.0) for seed in range(3)]
    assert script.page_table([*whole, row(5, 3, 1.0)]) == script.page_table(whole)


def test_a_training_is_found_again_whatever_the_version_of_its_flights(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    cell = script.Cell("rgb", 9, 0, "fixed", "Hard", 2)
    folder = script.student_folder(tmp_path, cell)
    monkeypatch.setitem(script.VERSIONS, "evaluation", 99)
    assert script.student_folder(tmp_path, cell) == folder
    monkeypatch.setitem(script.VERSIONS, "rules", 99)
    assert script.student_folder(tmp_path, cell) != folder


def flown(script: ModuleType, returned: float, failed: int, *of: Any) -> dict[str, str]:
    """Return the row of ten flights with a mean return, of which some end in a violation; `of`: policy, seed, kind, and
    level or river."""
    policy, seed, kind, level = of
    flights = [episode(returned, float(index < failed), "Success") for index in range(10)]
    return script.row_of(script.Cell(policy, 9, seed, kind, level, 10), flights)


def test_the_aims_of_the_packaged_policies_are_judged_by_seed_0(script: ModuleType):
    rows = [
        flown(script, 9.8, 1, "rgb+mask", 0, "fixed", "Easy"),  # 9.8 is enough, and 10 % are not
        flown(script, 9.2, 0, "rgb", 0, "fixed", "Easy"),  # 0.6 less than with the mask
        flown(script, 1.0, 9, "rgb+mask", 1, "fixed", "Easy"),
        flown(script, 4.0, 0, "teacher", 0, "real", "Wear"),
        flown(script, 3.87, 0, "rgb+mask", 0, "real", "Wear"),  # the teacher's less 3 % is 3.88
        flown(script, 3.4, 0, "rgb", 0, "real", "Wear"),
        flown(script, 9.9, 0, "rgb+mask", 0, "unseen", "Hard"),  # the image alone has not flown there
    ]
    table = script.SECTIONS[script.DOCS / "packaged-policy.md", "aims"](rows)
    assert [" ".join(line.split()) for line in table.splitlines()[2:] if line] == [
        "| fixed | Easy | 9.80 | 9.80, met | 1% | 10.0%, missed | 9.30 | 9.20, missed |",
        "| real | Wear | 3.88 | 3.87, missed | 3% | 0.0%, met | 3.37 | 3.40, met |",
        "`packaged` meets 2 of 4 aims, and `packaged-rgb` 1 of 2.",
    ]


def test_the_aims_of_students_are_met_by_some_of_them(script: ModuleType):
    flights = ((0, 9.0, 1), (1, 9.5, 0), (2, 10.0, 0))
    rows = [flown(script, returned, failed, "rgb+mask", seed, "unseen", "Hard") for seed, returned, failed in flights]
    table = script.SECTIONS[script.DOCS / "imitation-findings.md", "student aims"](rows)
    assert [" ".join(line.split()) for line in table.splitlines()[2:]] == [
        "| unseen | Hard | 9.50 | 9.50 | 2 of 3 | 3% | 3.3% | 2 of 3 |"
    ]


def rows_of_seeds(*figures: tuple[float, float, int]) -> list[dict[str, str]]:
    return [{"return": str(mean), "return_error": str(error), "episodes": str(count)} for mean, error, count in figures]


def test_an_interval_over_seeds_is_as_wide_as_that_of_independent_flights(script: ModuleType):
    scores = [np.random.default_rng(seed).uniform(8.0, 9.0, 50) for seed in range(3)]
    scores = [each - each.mean() + 8.5 for each in scores]  # equal means of seeds
    rows = rows_of_seeds(*((each.mean(), each.std(ddof=1) / np.sqrt(50), 50) for each in scores))
    independent = script.t_interval(8.5, np.concatenate(scores))
    found = script.mean_return(rows)
    assert (found.value, found.low, found.high) == pytest.approx((8.5, independent.low, independent.high))


def test_an_interval_over_seeds_that_differ_is_student_s(script: ModuleType):
    found = script.mean_return(rows_of_seeds((5.0, 0.01, 50), (6.0, 0.01, 50), (7.0, 0.01, 50)))
    assert (found.value, found.low, found.high) == pytest.approx((6.0, 6.0 - 2.4841, 6.0 + 2.4841), abs=1e-3)
    one = script.mean_return(rows_of_seeds((5.0, 0.1, 50)))
    assert one.value == 5.0 and np.isnan(one.low)


def test_flights_that_all_return_the_same_have_wilson_s_interval(script: ModuleType):
    found = script.mean_return(rows_of_seeds(*[(10.0, 0.0, 50)] * 3))
    assert (found.low, found.high) == pytest.approx(
        (10 * script.wilson_interval(1.0, 150)[0], 10.0)
    ) and found.low > 9.7
