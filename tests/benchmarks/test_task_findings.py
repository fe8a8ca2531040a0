"""The page of findings on tasks: figures of made-up flights that are worked by hand, gaps, and the committed page."""

import importlib
import io
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from tests.bench.report.small_results import flights
from tests.benchmarks.made_up_tasks import FAST, SAFE, rows, suite_of
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Condition
from thalweg.bench.fronts import fronts
from thalweg.bench.results.results import Results, RunRow
from thalweg.bench.results.run_versions import current_versions
from thalweg.bench.suite.arms import Arm

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPTS = (
    "task_findings", "task_facts", "task_findings_picture", "task_outcomes", "task_risk", "task_training", "task_sight",
    "findings", "study_flights",
)  # fmt: skip
FRONT = [SAFE, FAST, replace(SAFE, rivers="unseen", cost=10.0), replace(FAST, rivers="unseen")]
"""On the fixed river the oracle returns 6 at no cost and a point more for a cost of 10; on unseen ones it costs 10."""
LIMITS = {"FOCOPS-8.2": 8.2, "FOCOPS-23": 23.0, "FOCOPS-65": 65.0, "P3O-65": 65.0, "CPO-23": 23.0}
SUITE = suite_of(LIMITS, Condition("unseen", unseen=True))


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in SCRIPTS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("task_findings")


@pytest.fixture
def outcomes(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    module = sys.modules["task_outcomes"]
    monkeypatch.setattr(fronts, "read_fronts", lambda: FRONT)
    return module


@pytest.fixture
def results() -> Results:
    """Two flights of each seed, of which the first costs nothing: PPO with three seeds, FOCOPS at three limits, of
    which the second has two seeds only, P3O with seeds of different costs, and CPO, which failed."""
    episodes = [
        *flights("PPO", 3, 5.0, 80.0),
        *flights("FOCOPS-8.2", 3, 4.0, 16.0),
        *flights("FOCOPS-23", 2, 5.0, 50.0),
        *flights("FOCOPS-65", 3, 5.5, 60.0),
        *(replace(row, cost=row.seed * row.cost) for row in flights("P3O-65", 3, 4.0, 80.0)),
    ]
    unseen = [*flights("FOCOPS-8.2", 3, 4.0, 20.0), *flights("P3O-65", 3, 4.0, 80.0)]
    runs = [RunRow(f"{name}-{seed}", "train", name, seed, 1000, "finished") for name, seed in
            dict.fromkeys((row.algorithm, row.seed) for row in episodes)]  # fmt: skip
    runs += [RunRow(f"CPO-23-{seed}", "train", "CPO-23", seed, 10, "failed", "no memory") for seed in range(3)]
    return Results(Path(), SUITE.as_data(), runs, episodes, [], [], condition_episodes={"unseen": unseen})


@pytest.fixture
def study(outcomes: ModuleType, results: Results) -> Any:
    return outcomes.study_of(SUITE, results)


def test_a_cell_has_return_cost_flights_above_and_regret(script: ModuleType, study: Any):
    found = rows(script.task_table(study, "fixed"))
    # Returns of the seeds are 5, 6 and 7, and Student's t for three is 4.30; at a cost of 8 the oracle returns 6.8.
    # Costs are 0 and 16, three times each: by Student's t for six, 2.57, their mean is 8 ± 9.2, and none is below 0.
    assert found["FOCOPS"][0] == "*6.00 ± 2.48 at 8.00 ± 9.20; 50%; 0.80*"
    assert found["FOCOPS"][1] == "6.50 at 25.0; 50%; 2.00; 2 of 3 seeds"
    # Costs of 0 and 60 are 30 ± 34.5 in the mean, below the limit of 65.
    assert found["FOCOPS"][2] == "**7.50 ± 2.48 at 30.0 ± 34.5; 0%; 1.50**"
    # Costs of the seeds are 0, 40 and 80: the mean is within the limit, and its interval, 40 ± 99.4, reaches beyond.
    assert found["P3O"][2] == "*6.00 ± 2.48 at 40.0 ± 99.4; 33%; 4.00*"


def test_a_policy_without_a_limit_stands_beside_each(script: ModuleType, study: Any):
    found = rows(script.task_table(study, "fixed"))
    assert found["PPO, without a limit"] == ["7.00 ± 2.48 at 40.0 ± 46.0; 50%; 3.00"] * 3
    assert found["oracle"] == ["6.82", "8.30", "10.00"]


def test_unseen_rivers_have_flights_and_a_front_of_their_own(script: ModuleType, study: Any):
    found = rows(script.task_table(study, "unseen"))
    assert found["oracle"] == ["unattainable; 6.00 at 10.0", "7.73", "10.00"]
    assert found["FOCOPS"] == ["6.00 ± 2.48 at 10.0 ± 11.5; 50%; 0.00", "missing", "missing"]


def test_what_is_missing_or_failed_is_named(script: ModuleType, study: Any):
    found = rows(script.task_table(study, "fixed"))
    assert found["CPO"] == ["missing", "failed", "missing"] and found["P3O"][:2] == ["missing", "missing"]
    assert script.missing_section({"Nests": study}) == "- Nests: FOCOPS (8 of 9 runs), CPO (0 of 3 runs)\n"


def test_holders_are_ordered_by_return_and_those_beyond_have_their_cost(script: ModuleType, study: Any):
    lines = script.holders_table({"Nests": study}).splitlines()[2:]
    assert lines == [
        "| Nests | 8.2 | 6.82 | FOCOPS (6.00) | nobody |",
        "| Nests | 23 | 8.30 | nobody | FOCOPS (25.0) |",
        "| Nests | 65 | 10.00 | **FOCOPS (7.50)**, P3O (6.00) | nobody |",
    ]


def test_facts_are_counted_over_all_policies_with_a_limit(script: ModuleType, study: Any):
    lines = script.facts({"Nests": study}).replace("\n", " ").split("**")[2::2]
    holds, price, limitless, rising, unseen, nobody, *_ = (line.strip() for line in lines)
    assert holds.startswith("3 of 4 mean costs are within the limit, 1 of them with the whole interval: P3O 1 of 1,")
    # Regrets are 0.80, 9 - 7.5 = 1.50, and 4.00.
    assert "0.80 (FOCOPS, Nests at 8.2) to 4.00 points (P3O, Nests at 65)" in price and "median of 1.50" in price
    assert limitless.startswith("PPO costs 1.7 times the middle limit of Nests and returns 7.00, 3.00 below")
    assert rising.startswith("Of 1 algorithm with policies") and "in 1, the cost in 1." in rising
    assert unseen.startswith(
        "1 of the 2 that hold the limit on the fixed river hold it too. Of all 2, 1 hold it there."
    )
    assert nobody.removesuffix(" 7.") == (
        "Limits that nobody holds: Nests at 23. At the others the best that hold it return 6.00 of 6.82 (FOCOPS, Nests"
        " at 8.2), 7.50 of 10.00 (FOCOPS, Nests at 65) of what the oracle does."
    )


def test_policies_that_return_more_than_the_oracle_are_told(script: ModuleType, outcomes: ModuleType, results: Results):
    better = [replace(row, return_=9.0) if row.algorithm == "FOCOPS-8.2" else row for row in results.episodes]
    told = script.facts({"Nests": outcomes.study_of(SUITE, replace(results, episodes=better))}).replace("\n", " ")
    assert "returns -2.20 (FOCOPS, Nests at 8.2) to" in told  # the oracle returns 6.8 at a cost of 8
    assert "1 of them return more than the oracle, on Nests." in told


def test_updates_at_the_bound_of_the_multiplier_are_told_by_whether_the_limit_is_held(
    script: ModuleType, outcomes: ModuleType, results: Results, tmp_path: Path
):
    # FOCOPS holds 8.2 and 65, and does not hold 23.
    for run, multipliers in {"FOCOPS-8.2-0": "2.0\n1.0", "FOCOPS-65-1": "1.0\n0.0", "FOCOPS-23-0": "2.0\n2.0"}.items():
        folder = tmp_path / "runs" / run
        folder.mkdir(parents=True)
        (folder / "metrics.csv").write_text(f"multiplier\n{multipliers}\n")
        (folder / "config.yaml").write_text("run:\n  config: {multiplier_max: 2.0}\n")
    study = outcomes.study_of(SUITE, replace(results, folder=tmp_path))
    told = script.facts({"Nests": study}).replace("\n", " ")
    assert (
        "in 100% of the updates of runs whose policies do not hold it (1), and in 25% of the updates of runs whose"
        in told
    )
    assert "policies hold it (2); these are FOCOPS." in told


def test_a_task_that_was_not_run_says_so(script: ModuleType, outcomes: ModuleType):
    study = outcomes.study_of(SUITE, None)
    assert script.task_section(study) == script.NOT_RUN
    assert script.missing_section({"Nests": study}) == "- Nests: everything\n"
    found = [write({"Nests": study}) for write in (script.facts, script.holders_table, script.frames_section)]
    assert found == ["Nothing has been run yet.\n"] * 3


def test_policies_of_one_algorithm_at_one_limit_are_told_apart(
    script: ModuleType, outcomes: ModuleType, results: Results
):
    names = ["FOCOPS-23", "FOCOPS-cnn-23"]
    arms = tuple(Arm("FOCOPS", settings={"cost_limit": 23.0}, name=name) for name in names)
    suite = replace(SUITE, name="nests-frames", arms=(Arm("PPO"), *arms))
    episodes = [*flights("FOCOPS-23", 3, 5.0, 20.0), *flights("FOCOPS-cnn-23", 3, 3.0, 20.0)]
    study = outcomes.study_of(suite, Results(Path(), suite.as_data(), [], episodes, [], []))
    section = script.frames_section({"Nests": study, "Portage": outcomes.study_of(SUITE, None)})
    found = rows(section[section.index("| algorithm") : section.index("On unseen")])
    assert section.startswith("### Nests") and "Portage" not in section
    assert found["FOCOPS"][0].startswith("**7.00") and found["FOCOPS-cnn"][0].startswith("**5.00")
    assert script.missing_section({"Nests": study}) == "- Nests: PPO (0 of 3 runs)\n"


def test_results_of_earlier_versions_are_told(script: ModuleType, outcomes: ModuleType, results: Results):
    now = current_versions("train", ["FOCOPS"], task="Nests")
    before = {name: version for name, version in now.items() if name != "deadlines"}
    for recorded, words in (
        (now, "All results are of today's versions.\n"),
        (before, "These results are of **earlier versions**: Nests (before deadlines 1).\n"),
        (
            before | {"FOCOPS": 0},
            f"These results are of **earlier versions**: Nests (FOCOPS 0 (today {now['FOCOPS']})).\n",
        ),
    ):
        study = outcomes.study_of(SUITE, replace(results, versions={"FOCOPS-8.2-0": recorded}))
        assert script.versions_note({"Nests": study}) == words


def test_results_of_other_tasks_than_the_front_are_refused(outcomes: ModuleType, results: Results):
    old = replace(results, folder=Path("nests"), versions={"PPO-0": {"tasks": 0}})
    with pytest.raises(ResultsError, match=r"nests: .*PPO-0 has 0"):
        outcomes.study_of(SUITE, old)


def test_a_front_of_other_tasks_is_refused(outcomes: ModuleType, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fronts, "read_fronts", lambda: [replace(point, tasks=0) for point in FRONT])
    with pytest.raises(ResultsError, match="no front of Nests on fixed rivers of Medium"):
        outcomes.study_of(SUITE, None)


def test_the_picture_has_a_panel_for_each_task(script: ModuleType, study: Any):
    studies = {name: replace(study, task=name) for name in ("A", "B", "C", "D")}
    figure = sys.modules["task_findings_picture"].figure_of(studies | {"D": replace(study, task="D", outcomes={})})
    assert [axis.get_title() for axis in figure.axes] == ["A", "B", "C", "D, not run yet"]
    picture = script.drawn_fronts(studies)
    assert Image.open(io.BytesIO(picture)).width > 1000 and len(picture) < 150_000


def test_the_picture_reaches_to_the_greatest_cost_at_any_limit(script: ModuleType, study: Any):
    key = "fixed", "FOCOPS", 8.2
    far = replace(study.outcomes[key], cost=replace(study.outcomes[key].cost, value=300.0))
    studies = dict.fromkeys("ABCD", replace(study, outcomes={**study.outcomes, key: far}))
    for axis in sys.modules["task_findings_picture"].figure_of(studies).axes:
        drawn = [cost for each in axis.get_lines() for cost in each.get_xdata()]
        assert max(drawn) == 300.0 < axis.get_xlim()[1]


SEEING = replace(
    SUITE,
    name="nests-frames",
    arms=(
        Arm("PPO"),
        Arm("FOCOPS", settings={"cost_limit": 23.0}, name="FOCOPS-23"),
        Arm("P3O", settings={"cost_limit": 23.0}, name="P3O-23"),
        Arm("P3O", settings={"cost_limit": 23.0}, name="P3O-cnn-23"),
        Arm("FOCOPS", settings={"cost_limit": 23.0}, name="FOCOPS-imitated-23"),
    ),
)


@pytest.fixture
def seen(outcomes: ModuleType) -> Any:
    """Policies through frames at the middle limit of Nests: FOCOPS, P3O, one of convolutions, one that was imitated."""
    episodes = [
        *flights("PPO", 3, 3.0, 60.0),
        *flights("FOCOPS-23", 3, 3.0, 30.0),
        *flights("P3O-23", 3, 2.0, 80.0),
        *flights("P3O-cnn-23", 3, 1.0, 20.0),
        *flights("FOCOPS-imitated-23", 3, 5.0, 40.0),
    ]
    runs = [RunRow(f"{name}-{seed}", "train", name, seed, 1000, "finished") for name, seed in
            dict.fromkeys((row.algorithm, row.seed) for row in episodes)]  # fmt: skip
    return outcomes.study_of(SEEING, Results(Path(), SEEING.as_data(), runs, episodes, [], []))


def test_frames_are_told_beside_the_ideal_eye(script: ModuleType, study: Any, seen: Any):
    """By the eye FOCOPS at 23 returns 6.5 in the mean at a cost of 25, through frames 5 at 15."""
    eyes = script.sight_table({"Nests": study}, {"Nests": seen}).splitlines()[2:]
    assert eyes == [
        "| Nests | 23 | FOCOPS | 6.50 at a cost of 25.0, above the limit | 5.00 at a cost of 15.0 | -1.50 |"
    ]
    lines = script.sight_facts({"Nests": study}, {"Nests": seen}).replace("\n", " ").split("**")
    told = dict(zip(lines[1::2], (line.strip() for line in lines[2::2]), strict=True))
    assert told["Who holds the limit."].startswith("3 of 4 mean costs are within the limit")
    assert "P3O-cnn 1 of 1" in told["Who holds the limit."]
    assert told["Without a limit"].startswith("PPO costs 1.3 times the middle limit of Nests")
    assert "nobody was run at all three limits" in told["Whether a greater limit is used"]
    # At a cost of 15 the oracle returns 7.5.
    assert told["The eye."].removesuffix(" 11.") == (
        "Of 1 pair of an algorithm and a limit, 0 hold the limit by the ideal eye and 1 through frames. Through frames"
        " the return differs by -1.50 points (the median). Who holds it there returns 2.50 points (the median) less"
        " than the oracle."
    )
    assert told["Convolutions of its own."].removesuffix(" 12.") == (
        "P3O-cnn (Nests at 23) returns 3.00 at a cost of 10.0, on codes 4.00 at a cost of 40.0, above the limit."
    )
    assert told["From the imitated policy."] == (
        "FOCOPS-imitated (Nests at 23) returns 7.00 at a cost of 20.0, on codes 5.00 at a cost of 15.0."
    )


def test_the_picture_of_frames_has_variants_dotted_and_limits_marked_as_by_the_ideal_eye(script: ModuleType, seen: Any):
    drawing = sys.modules["task_findings_picture"]
    assert (seen.middle_limit, seen.place(23.0)) == (23.0, 1)
    styles = [drawing.style_of(name) for name in ("P3O", "P3O-cnn")]
    assert styles[0]["color"] == styles[1]["color"] and styles[1]["linestyle"] == ":"
    figure = drawing.figure_of(dict.fromkeys("ABCD", seen))
    assert [text.get_text() for text in figure.legends[0].get_texts()][1:6] == [
        "PPO, without a limit", "FOCOPS", "FOCOPS-imitated", "P3O", "P3O-cnn",
    ]  # fmt: skip
    assert {text.get_text() for text in figure.axes[0].texts} == {"imitated", "cnn"}
    assert script.frames_picture({"Nests": seen}).startswith("![Mean return over mean cost through frames")


def test_without_runs_through_frames_the_page_says_so(script: ModuleType, outcomes: ModuleType, study: Any):
    nothing = {"Nests": outcomes.study_of(SEEING, None)}
    for text in (
        script.sight_facts({"Nests": study}, nothing),
        script.sight_table({"Nests": study}, nothing),
        script.frames_picture(nothing),
    ):
        assert text == "Nothing has been run yet.\n"


def test_the_committed_page_shows_the_committed_results(script: ModuleType):
    page = script.PAGE.read_text()
    seeing = script.read_studies(suite_of=script.seeing_suite_of)
    assert page == script.written_page(page, script.read_studies(), seeing), (
        "python benchmarks/task_findings.py writes it"
    )


def test_every_algorithm_keeps_its_colour_in_the_committed_picture(script: ModuleType):
    """A palette that is too small gives two algorithms the colour of one of them."""
    with Image.open(script.PICTURE) as picture:
        found = np.array(picture.convert("RGB")).reshape(-1, 3).astype(int)
    flown = {path.name.partition("-")[0] for path in (BENCHMARKS / "swimmers" / "runs").iterdir()} - {"PPO"}
    for name in sorted(flown):
        colour = 255 * np.array(to_rgb(sys.modules["task_findings_picture"].style_of(name)["color"]))
        assert np.abs(found - colour).max(axis=1).min() < 8, name
