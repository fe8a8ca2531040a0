"""The findings at the top of the page: numbers of made-up flights that are worked by hand, and the committed pages."""

import importlib
import io
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image

from tests.bench.report.small_results import flights
from thalweg.bench.evaluate.conditions import Condition
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.results import Results
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.builtin import SUITES, SYMMETRIC
from thalweg.bench.suite.config import Suite

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPTS = (
    *("headline", "study_flights", "headlines", "headline_pictures", "headline_page", "findings"),
    *("task_findings", "task_facts", "task_findings_picture", "task_outcomes", "task_risk", "task_training"),
)
PRICED = ("swimmers", "racingline", "portage")
ARMS = (
    Arm("PPO"), SUITES["paper"].arm(SYMMETRIC), Arm("PPOLag"), Arm("FOCOPS"), Arm("CCEPETS"), Arm("PPO", "paper"),
)  # fmt: skip
SUITE = Suite(
    "study",
    ARMS,
    test_levels=("Medium",),
    baselines=(),
    packaged=False,
    conditions=(Condition("unseen", unseen=True), Condition("all_at_once", levels=("Medium",), varied=("haze",))),
)
RETURNS = {"PPO": 6.5, "PPO-symmetric": 6.0, "PPOLag": 5.0, "FOCOPS": 1.0, "CCEPETS": 4.0, "PPO-paper": 2.5}
"""Of the first start of the first seed: the mean of three seeds and two starts is 2 more."""


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in SCRIPTS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("headlines")


def study(change: float = 0.0, seeds: int = 3, costs: dict[str, float] | None = None) -> Results:
    """Results whose policies return `RETURNS` and cost 0.2 (the mean of starts of 0 and 0.4) or what `costs` says."""
    cost = dict.fromkeys(RETURNS, 0.4) | (costs or {})
    own = [row for name, value in RETURNS.items() for row in flights(name, seeds, value + change, cost[name])]
    away = [replace(row, world_seed=100_000 + row.episode, return_=row.return_ - 1 - row.seed) for row in own]
    looks = [replace(row, return_=row.return_ - 2) for row in own]
    conditions: dict[str, list[Episode]] = {"unseen": away, "all_at_once": looks}
    return Results(Path(), SUITE.as_data(), [], own, [], [], condition_episodes=conditions)


def test_those_fly_that_return_8_and_planners_that_return_6(script: ModuleType):
    found = script.who_flies(study())
    flies = "learn to fly, that is, return at least 8 of 10 on Medium, or 6 if they are planners"
    assert found.sentence.startswith(f"Of the 4 algorithms flown, 2 {flies}: ")
    assert "and CCEPETS 6.00" in found.sentence and "PPOLag" not in found.sentence.partition("In the paper")[0]
    assert "none of 10 did; the most was 6.30 (FOCOPS)." in found.sentence
    assert "Not flown yet: P3O, OnCRPO, DDPGLag, TD3Lag, SACLag, SafeLOOP, CPO and CUP. In training" in found.sentence
    told = "critics saw what the policy sees, but those of PPO saw the privileged state and progress too."
    assert found.sentence.endswith(f"In training, {told}")
    few = script.who_flies(study(seeds=2)).sentence
    assert "Fewer than three seeds: PPO, PPOLag, FOCOPS and CCEPETS. Not flown yet: P3O," in few
    here, theirs = found.series.values()
    assert [each.value for each in here] == [8.5, 7.0, 3.0, 6.0]
    assert [each.value for each in theirs] == [5.22, 3.81, 6.30, 0.05]


def test_what_settings_add_is_the_difference_from_the_same_starts(script: ModuleType):
    found = script.settings(study())
    assert found.labels == ("PPO",) and "greater by: PPO 4.00 [" in found.sentence  # 8.5 and 4.5
    assert (
        script.settings(replace(study(), episodes=[row for row in study().episodes if row.algorithm == "PPO"])) is None
    )


def test_the_eye_is_left_out_until_it_has_been_flown(script: ModuleType):
    assert script.eye(study(), None) is None
    other = study(change=1.0)
    found = script.eye(study(), other)
    assert found.labels == ("PPO", "PPOLag", "FOCOPS", "CCEPETS")
    assert "PPO 1.00 [" in found.sentence and "orders of these 4 algorithms is 1.00 (no interval)." in found.sentence
    one = replace(other, episodes=[row for row in other.episodes if row.seed == 0])
    assert "no algorithm has three seeds of both" in script.eye(study(), one).sentence


def test_orders_are_compared_of_algorithms_with_every_seed_of_both_alone(script: ModuleType):
    """CCEPETS, the third by three seeds, would be the last by one."""
    other = [row for row in study(change=1.0).episodes if row.algorithm != "CCEPETS" or not row.seed]
    other = [replace(row, return_=-9.0) if row.algorithm == "CCEPETS" else row for row in other]
    found = script.eye(study(), replace(study(), episodes=other))
    assert found.labels == ("PPO", "PPOLag", "FOCOPS", "CCEPETS")
    told = "orders of these 3 algorithms is 1.00 (no interval). Fewer than three seeds of both: CCEPETS."
    assert found.sentence.endswith(told) and "CCEPETS -" not in found.sentence


def test_eyes_are_not_compared_on_other_rivers(script: ModuleType):
    """Folders of other versions have other starts, which would be an error."""
    made = {run.name: {"world": 1, "encoder": 1, run.algorithm: 3} for run in SUITE.runs()}
    before = replace(study(), versions=made)
    moved = [replace(row, x=row.x + 1.0) for row in study().episodes]
    later = {run: of | {"world": 2} for run, of in made.items()}
    assert script.eye(before, replace(study(), episodes=moved, versions=later)) is None
    assert script.eye(before, replace(study(), episodes=moved)) is None  # no versions are recorded
    other_encoder = {run: of | {"encoder": 2} for run, of in made.items()}
    part = other_encoder | {"PPO-2": later["PPO-2"]}
    assert script.eye(before, replace(study(), versions=part)) is None
    geometry = {run: {name: each for name, each in of.items() if name != "encoder"} for run, of in made.items()}
    assert script.eye(before, replace(study(), versions=geometry | {"new-0": {"geometry": 2}})) is not None


def test_the_limit_is_judged_by_whole_intervals(script: ModuleType):
    found = script.limit(study(costs={"PPO-symmetric": 1.0, "PPOLag": 0.0}))
    assert found.labels == ("PPO-symmetric", "PPOLag", "FOCOPS", "CCEPETS")
    assert [round(each.value, 9) for each in found.series["cost"]] == [0.5, 0.0, 0.2, 0.2]
    assert "of the 3 algorithms that have the cost limit of 0.1 and three seeds, none certainly" in found.sentence
    assert "and none certainly exceed it." in found.sentence
    sure = replace(study(), episodes=[replace(row, cost=0.5) for row in study().episodes])
    told = "and PPOLag, FOCOPS and CCEPETS certainly exceed it. PPO-symmetric, which has no limit, costs 0.50"
    assert told in script.limit(sure).sentence
    told = "; none of them costs significantly less. In training, critics saw what the policy sees."
    assert script.limit(sure).sentence.endswith(told)


def test_costs_are_compared_with_those_of_ppo_whose_critics_see_what_the_others_do(script: ModuleType):
    """PPO, whose critics see more, costs nothing here, and so would hide that PPOLag costs less."""
    cheap = {"PPO": 0.0, "PPO-symmetric": 1.0, "PPOLag": 0.0}
    rows = [replace(row, cost=cheap.get(row.algorithm, 1.0)) for row in study().episodes]
    found = script.limit(replace(study(), episodes=rows))
    assert "PPO-symmetric, which has no limit, costs 1.00 [" in found.sentence
    assert "; PPOLag costs significantly less. In training" in found.sentence
    older = {run.name: {run.algorithm: 1} for run in SUITE.runs()}  # versions in which critics saw no more
    assert script.limit(replace(study(), versions=older)).labels == ("PPO", "PPOLag", "FOCOPS", "CCEPETS")


def test_without_every_seed_of_the_policy_without_a_limit_no_costs_are_compared(script: ModuleType):
    assert script.limit(study(seeds=2)) is None
    one = [row for row in study().episodes if row.algorithm != "PPO-symmetric" or not row.seed]
    for rows in (one, [row for row in one if row.algorithm != "PPO-symmetric"]):
        found = script.limit(replace(study(), episodes=rows))
        assert found.labels == ("PPOLag", "FOCOPS", "CCEPETS")
        assert "PPO-symmetric, which has no limit, does not have three seeds, so that" in found.sentence
        assert "significantly" not in found.sentence


def test_the_readme_says_what_critics_saw_and_has_ppo_twice_where_they_saw_more(script: ModuleType):
    text = importlib.import_module("headline_page").readme_section([script.who_flies(study())], study())
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    assert rows[0][-1] == "critics see"
    assert {row[0]: row[-1] for row in rows[2:]} == {
        "PPO": "the privileged state and progress too",
        **dict.fromkeys(("PPO-symmetric", "PPOLag", "FOCOPS", "CCEPETS"), "what the policy sees"),
    }
    assert [row[0] for row in rows[2:4]] == ["PPO", "PPO-symmetric"]


def test_losses_are_paired_by_start_or_by_seed(script: ModuleType):
    found = script.elsewhere(study())
    assert found.labels == ("PPO", "CCEPETS")
    away, looks = found.sentence.split("every look at once")
    assert "changes by: PPO -2.00 [-4.48, 0.48]" in away  # -1, -2 and -3: 4.303 / √3
    assert "by: PPO -2.00 [" in looks and "CCEPETS -2.00 [" in looks  # 2 less from every start
    change = script.by_seed_change(study().condition_episodes["unseen"][:6], study().episodes[:6])
    assert (change.value, round(change.high - change.value, 2)) == (-2.0, 2.48)


def test_imitated_students_stand_beside_those_that_learnt_by_reward(script: ModuleType):
    beside = script.Student(Estimate(9.7, 9.6, 9.8), Estimate(9.6, 9.5, 9.7), Estimate(9.5, 9.4, 9.6), 2_000_000)
    found = script.elsewhere(study(), beside)
    assert found.labels == ("PPO", "CCEPETS", "imitated student")
    assert [values[-1] for values in found.series.values()] == [beside.fixed, beside.unseen, None, beside.varied]
    assert [*found.series.values()][-1] == (None, None, beside.varied)
    assert "in 2,000,000 steps on 64 rivers of each level" in found.sentence
    assert found.sentence.endswith(
        "returns 9.70 [9.60, 9.80] on the fixed river of Medium, which is new to it, 9.60 [9.50, 9.70] on unseen"
        " rivers and 9.50 [9.40, 9.60] there under varied looks."
    )
    for lacking in (script.Student(beside.fixed, None, None), None):
        assert script.elsewhere(study(), lacking) == script.elsewhere(study())


def test_students_are_those_of_image_and_mask_of_today(script: ModuleType, tmp_path: Path):
    any_river = importlib.import_module("any_river")
    columns = any_river.COLUMNS
    today = {name: str(version) for name, version in any_river.VERSIONS.items()}

    def row(policy: str, kind: str, seed: int, returned: str, **changed: str) -> str:
        known = {"policy": policy, "kind": kind, "level": "Medium", "seed": str(seed), "steps": "9", "episodes": "4"}
        every = known | today | {"return": returned, "return_error": "0.1", "violations": "0"} | changed
        return ",".join(every.get(name, "0") for name in columns)

    lines = [
        *(row("rgb+mask", "unseen", seed, value) for seed, value in enumerate(("9.0", "9.3", "9.6"))),
        row("rgb+mask", "varied", 0, "8.0"),
        row("rgb+mask", "fixed", 0, "5.0", imitation="1"),
        row("rgb", "fixed", 0, "4.0"),
    ]
    table = tmp_path / "any_river.csv"
    table.write_text("\n".join([",".join(columns), *lines]) + "\n")
    found = script.student("Medium", table)
    assert (round(found.unseen.value, 9), found.varied.value, found.fixed, found.steps) == (9.3, 8.0, None, 9)
    assert script.student("Hard", table).unseen is None
    (tmp_path / "killed.csv").touch()
    for name in ("none.csv", "killed.csv"):
        assert script.student("Medium", tmp_path / name) == script.Student(None, None, None)


def test_a_loss_on_unseen_rivers_is_no_more_certain_than_the_rivers_are_many(script: ModuleType):
    """Seeds that agree: 8 on the one river, and 0 or 8 on four others: 4 less, ± 3.182 * √(16 * 4 / 3 / 4)."""
    rows = [row for row in study().episodes if row.algorithm == "PPO"][:2]
    home = [replace(rows[0], seed=seed, episode=k, return_=8.0) for seed in range(3) for k in range(4)]
    away = [replace(row, world_seed=100_000 + row.episode, return_=8.0 * (row.episode % 2)) for row in home]
    change = script.by_seed_change(away, home)
    assert (change.value, change.low) == (-4.0, -10.0)
    assert round(change.high, 2) == round(-4.0 + 3.18245 * (16 * 4 / 3 / 4) ** 0.5, 2)
    lacking = script.by_seed_change(away[:-1], home)
    assert str(lacking) == f"{8 * 5 / 11 - 8:.2f}"  # without an interval


def test_what_has_not_been_run_gives_no_finding(script: ModuleType, tmp_path: Path):
    assert script.price(tmp_path) is None
    alone = replace(study(), condition_episodes={})
    assert script.elsewhere(alone) is None


def test_versions_of_every_arm_are_compared_with_those_of_today(script: ModuleType):
    flights_of = importlib.import_module("study_flights")
    today = flights_of.versions_today(SUITE.as_data(), "PPOLag", {})
    assert flights_of.earlier_versions(replace(study(), versions={"PPOLag-1": today})) == []
    older = {"PPOLag-1": today | {"PPOLag": 0}, "hover-0": {"world": 0}}
    told = f"PPOLag 0 (today {today['PPOLag']})"
    assert flights_of.earlier_versions(replace(study(), versions=older)) == [told]


def test_versions_that_differ_stand_beside_todays_and_else_those_that_are_missing(script: ModuleType):
    flights_of = importlib.import_module("study_flights")
    today = {"render": 3, "PPO": 2, "deadlines": 1}
    assert flights_of.beside_todays({"render": 2, "PPO": 2}, today) == ["render 2 (today 3)"]
    assert flights_of.beside_todays({"render": 3, "PPO": 2}, today) == ["before deadlines 1"]
    assert flights_of.beside_todays({"render": 3, "gone": 1}, today) == ["gone 1 (today None)"]
    assert flights_of.beside_todays(today, today) == flights_of.beside_todays({}, today) == []


NUMBERS = ("No", "One", "Two", "Three", "Four", "Five", "Six")


def test_the_page_counts_the_findings_that_the_repository_has_today(script: ModuleType):
    found = script.headlines()
    assert len({each.name for each in found}) == len(found)
    page = importlib.import_module("headline_page").PAGE.read_text()
    assert page.startswith(f"# What the benchmark shows\n\n{NUMBERS[len(found)]} findings, each computed ")


def test_the_pages_are_what_the_results_have(script: ModuleType):
    for page, text in importlib.import_module("headline_page").written_pages().items():
        assert page.read_text() == text
    pictures = importlib.import_module("headline_page").PICTURES
    assert {path.stem for path in pictures.glob("*.png")} == {each.name for each in script.headlines()}


SCREEN = 1200
"""Height of a screen in pixels. A column is 900 wide, and a line of text 24 high."""


def height(text: str, pictures: list[int]) -> int:
    """Height in pixels of a text with pictures of these heights."""
    return sum(24 for line in text.splitlines() if line and not line.startswith("![")) + sum(pictures)


def test_findings_take_half_a_screen_on_average(script: ModuleType):
    page = importlib.import_module("headline_page")
    text = page.PAGE.read_text().partition("## The results")[0]
    pictures = [Image.open(page.PICTURES / f"{each.name}.png").height for each in script.headlines()]
    assert height(text, pictures) < len(pictures) * SCREEN / 2


def test_findings_of_the_whole_study_would_take_half_a_screen_on_average(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """All arms of the suites, all of which fly."""
    page, pictures = importlib.import_module("headline_page"), importlib.import_module("headline_pictures")
    made: dict[str, Results] = {}
    for name in ("paper", "geometry"):
        arms = SUITES[name].arms
        rows = [row for k, arm in enumerate(arms) for row in flights(arm.label, len(arm.seeds), 6.5 + 0.01 * k, 0.4)]
        away = [replace(row, world_seed=100_000 + row.episode) for row in rows]
        conditions = {"unseen": away, "all_at_once": rows}
        made[name] = Results(Path(), SUITES[name].as_data(), [], rows, [], [], condition_episodes=conditions)
    for name in PRICED:
        (tmp_path / name).symlink_to(BENCHMARKS / name)
    (tmp_path / "geometry").mkdir()
    monkeypatch.setattr(script, "results_of", lambda folder: made[folder.name])
    read = page.results_of
    monkeypatch.setattr(page, "results_of", lambda folder: made.get(folder.name) or read(folder))
    every = script.headlines(tmp_path)
    assert [each.name for each in every] == ["who-flies", "settings", "eye", "limit", "price", "elsewhere"]
    drawn = [Image.open(io.BytesIO(pictures.drawn(each))).height for each in every]
    assert height(page.findings_section(every), drawn) < len(every) * SCREEN / 2


def test_a_picture_has_a_point_for_each_value_and_a_line_for_each_interval(script: ModuleType):
    pictures = importlib.import_module("headline_pictures")
    series = {"a": (Estimate(1.0, 0.5, 1.5), Estimate(2.0)), "b": (None, Estimate(3.0, 2.5, 3.5))}
    found = script.Headline("name", "Title", "", ("one", "two"), series, "what", line=8.0)
    axis = pictures.figure_of(found).axes[0]
    drawn = [line for line in axis.lines if len(line.get_xdata())]
    ends = sorted(len(line.get_xdata()) for line in drawn)
    assert ends == [1, 1, 1, 2, 2, 2]  # three points, two intervals, the line
    assert [label.get_text() for label in axis.get_yticklabels()] == ["one", "two"]
    assert Image.open(io.BytesIO(pictures.drawn(found))).size[0] == 900
