"""The benchmark of the shield: its cells and their keys, its pairs of flights, what it counts as false, its tables."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.env.handmade import canal
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.shielded import FlightShield, Screening
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.shield.moves import HEIGHT, LAND, PERMITTED


def episode(returned: float, cost: float, reason: str) -> Episode:
    fields: dict[str, Any] = dict.fromkeys(Episode.__dataclass_fields__, 0)
    return Episode(**(fields | {"return_": returned, "cost": cost, "reason": reason}))


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    for name in ("any_river", "shield_arms", "shield_page", "shield"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("shield")


@pytest.fixture
def arms(script: ModuleType) -> ModuleType:
    return sys.modules["shield_arms"]


@pytest.fixture
def page(script: ModuleType) -> ModuleType:
    return sys.modules["shield_page"]


@pytest.fixture
def student(arms: ModuleType, tmp_path: Path) -> Any:
    file = tmp_path / "student.safetensors"
    file.write_bytes(b"first")
    return arms.Arm("student", ("fixed",), ("Hard",), path=file)


def row(script: ModuleType, arm: Any, episodes: int = 4, kind: str = "fixed", level: str = "Hard") -> dict[str, str]:
    """A row of an arm: all flights succeed without the shield, and the last ends idle with it."""
    watch = script.Watch(steps=200)
    watch.vetoes.update({"land": 6, "dead end": 4})
    watch.false.update({"dead end": 3})
    good, idle = episode(10.0, 0.0, "Success"), episode(10.0, 0.2, "Idle")
    pair = script.Pair(arm, arm.made_by, kind, level, episodes)
    flights = {"without": [good] * episodes, "with": [good] * (episodes - 1) + [idle]}
    key = dict(zip(script.KEY, pair.key, strict=True))
    return {"policy": arm.policy} | key | script.row_of(flights, watch) | {"ms_a_step": "0.127"}


def cells(pairs: list[Any]) -> list[tuple[str, str, str, str]]:
    return [(pair.arm.policy, pair.kind, pair.level, " ".join(pair.arm.settings)) for pair in pairs]


def test_the_default_plan_has_the_cells_of_the_table(script: ModuleType, arms: ModuleType):
    both = ("Medium", "Hard")
    expected = {("packaged", kind, level, "") for kind in ("fixed", "unseen", "varied") for level in both}
    names = ("noise20", "noise50", "random")
    expected |= {(name, kind, level, "") for name in names for kind in ("fixed", "unseen") for level in both}
    expected |= {("random", "fixed", "Hard", "unknown_is_water=false")}
    pairs = arms.planned(arms.chosen_arms(None, [], None), arms.KINDS, arms.LEVELS, arms.EPISODES)
    assert len(pairs) == 19 and set(cells(pairs)) == expected
    assert {pair.episodes for pair in pairs} == {100}
    assert len({pair.key for pair in pairs}) == 19


def test_options_select_among_the_cells(arms: ModuleType, student: Any):
    chosen = arms.chosen_arms(["random"], [], None)
    assert cells(arms.planned(chosen, ["fixed"], ["Hard"], 4)) == [
        ("random", "fixed", "Hard", ""),
        ("random", "fixed", "Hard", "unknown_is_water=false"),
    ]
    assert arms.planned(arms.chosen_arms(["noise20"], [], None), ["varied"], arms.LEVELS, 4) == []
    assert arms.chosen_arms(None, [student], None) == (student,)
    assert [arm.policy for arm in arms.chosen_arms(["noise50"], [student], None)] == ["noise50", "student"]


def test_given_settings_replace_those_of_the_arms(arms: ModuleType):
    chosen = arms.chosen_arms(["random"], [], ["margin_m=1", "lookahead=0"])
    pairs = arms.planned(chosen, ["fixed"], ["Hard"], 4)
    assert cells(pairs) == [("random", "fixed", "Hard", "lookahead=0 margin_m=1")]


def test_the_key_changes_with_the_content_of_the_file_and_not_with_its_name(arms: ModuleType, student: Any):
    (first,) = arms.planned([student], arms.KINDS, arms.LEVELS, 4)
    (renamed,) = arms.planned([replace(student, policy="other")], arms.KINDS, arms.LEVELS, 4)
    student.path.write_bytes(b"second")
    (second,) = arms.planned([student], arms.KINDS, arms.LEVELS, 4)
    assert first.key == renamed.key != second.key


def test_pilots_are_known_by_their_versions(arms: ModuleType, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(arms.versions, "STEADY", 71)
    monkeypatch.setattr(arms.versions, "EVALUATION", 72)
    made_by = [arms.Arm(name).made_by for name in ("noise20", "noise50", "random")]
    assert made_by == ["noise20/71", "noise50/71", "random/72"]


def test_a_file_that_changes_after_planning_is_not_flown(
    arms: ModuleType, student: Any, monkeypatch: pytest.MonkeyPatch
):
    (pair,) = arms.planned([student], arms.KINDS, arms.LEVELS, 4)
    monkeypatch.setattr(arms, "load_policy", lambda path: path.read_bytes())
    assert pair.policy() == b"first"
    student.path.write_bytes(b"second")
    with pytest.raises(ResultsError, match="has changed since its flights were planned"):
        pair.policy()


@pytest.mark.parametrize(
    ("text", "message"),
    [("student", "NAME=PATH"), ("=a", "NAME=PATH"), ("packaged=a", "name of another policy")],
)
def test_a_policy_that_is_not_named_anew_is_refused(arms: ModuleType, text: str, message: str):
    with pytest.raises(ValueError, match=message):
        arms.arm_of_file(text)


def test_only_cells_without_a_row_of_the_same_content_are_flown(
    script: ModuleType, student: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    table = tmp_path / "table.csv"
    found = row(script, student, 2)
    table.write_text(",".join(script.COLUMNS) + "\n" + ",".join(found[name] for name in script.COLUMNS) + "\n")
    flown: list[dict] = []
    monkeypatch.setattr(script, "fly_cells", lambda cells, *_: flown.append(cells) or [])
    options = ["--policy", f"student={student.path}", "--kinds", "fixed", "--levels", "Hard", "--episodes", "2"]
    assert script.main([*options, "--out", str(table)]) is None and flown[-1] == {}
    student.path.write_bytes(b"second")
    assert script.main([*options, "--out", str(table)]) is None and len(flown[-1]) == 1
    assert capsys.readouterr().out == "0 of 1 cells are to be flown\n1 of 1 cells are to be flown\n"


def test_options_that_select_nothing_are_refused(script: ModuleType, capsys: pytest.CaptureFixture):
    with pytest.raises(SystemExit):
        script.main(["--policies", "noise20", "--kinds", "varied"])
    assert "none of the policies is flown in the chosen kinds" in capsys.readouterr().err


def test_a_veto_is_false_where_the_rules_permit_the_move(script: ModuleType):
    env = RiverVectorEnv([canal(60.0, width_m=6.0)], 3, EnvConfig(observation="none"))
    env.reset(seed=0, options={"pose": np.array([[10.0, 2.8, 5.0, 0.0], [20.0, 0.0, 5.0, 0.0], [30.0, 0.0, 0.6, 0.0]])})
    watch, shield = script.Watch(), FlightShield()
    shield.begin(env, None)
    watch.shield = shield
    before = env.state.pose.copy()
    aside, descend = [1, 1, 1, 0], [2, 1, 1, 1]
    proposed = np.array([aside, aside, descend])
    watch(Screening(np.arange(3), proposed, proposed, np.array([LAND, LAND, HEIGHT])))
    assert watch.steps == 3 and watch.vetoes == {"land": 2, "height": 1}
    assert watch.false["land"] == 1 and watch.false["height"] == 0
    watch(Screening(np.array([1]), proposed[1:2], proposed[1:2], np.array([PERMITTED])))
    assert watch.steps == 4 and sum(watch.vetoes.values()) == 3
    assert np.array_equal(env.state.pose, before)


def test_a_row_by_hand(script: ModuleType):
    good, bad = episode(10.0, 0.0, "Success"), episode(2.0, 1.0, "OutOfVolumeHorizontal")
    idle = episode(4.0, 0.2, "Idle")
    watch = script.Watch(steps=200)
    watch.vetoes.update({"land": 6, "dead end": 4})
    watch.false.update({"dead end": 3})
    row = script.row_of({"without": [good, bad, bad, good], "with": [good, good, idle, idle]}, watch)
    assert (row["return_without"], row["return_with"]) == ("6.000", "7.000")
    assert (row["violations_without"], row["violations_with"]) == ("0.5000", "0.5000")
    assert (row["helped"], row["harmed"]) == ("1", "1")
    assert row["reasons_with"] == "Idle=2 Success=2"
    assert (row["dead_end"], row["false_dead_end"], row["false_land"], row["turn"]) == ("4", "3", "0", "0")


def test_flights_from_different_starts_are_no_pairs(script: ModuleType):
    flights = [replace(episode(10.0, 0.0, "Success"), episode=place) for place in range(3)]
    with pytest.raises(ValueError, match=r"a flight with the shield starts from .*, and without it from"):
        script.row_of({"without": flights, "with": flights[::-1]}, script.Watch(steps=1))


def test_the_tables_have_a_line_of_each_row(script: ModuleType, arms: ModuleType, page: ModuleType):
    arm = arms.Arm("random", settings=("lookahead=0",))
    table = page.page_tables([row(script, arm, 2)], {arm.made_by: "random"})
    # Wilson: none in 2 reaches up to 0.6576, one in 2 from 0.0945 to 0.9055; 0.5 - √(0.4055² + 0.6576²) = -0.273.
    figures = "2 | 10.00 → 10.00 | 0% → 50% | 50.0 [-27.3, 90.5] | 0.00 → 0.10 | 0 | 1 | 5.0% | 30% | 0.13"
    assert f"| random, lookahead=0 | fixed, Hard | {figures} |" in table
    assert "| random, lookahead=0 | fixed, Hard | 0 → 0 | 0 → 0 | 0 → 0 | 0 → 0 | 0 → 1 | 0 → 0 | 2 → 1 |" in table


def test_rows_of_other_content_or_versions_are_not_shown(
    script: ModuleType, arms: ModuleType, page: ModuleType, student: Any
):
    found = row(script, student)
    assert "| student | fixed, Hard |" in page.page_tables([found], arms.names_of([student]))
    assert "student" not in page.page_tables([found | {"shield": "0"}], arms.names_of([student]))
    student.path.write_bytes(b"second")
    assert "student" not in page.page_tables([found], arms.names_of([student]))


def test_of_the_same_flights_the_row_of_the_most_counts_and_rows_are_in_order(
    script: ModuleType, arms: ModuleType, page: ModuleType, student: Any
):
    noise = arms.Arm("noise20")
    small, large, small_again = row(script, noise, 2), row(script, noise, 4), row(script, noise, 3)
    medium, last = row(script, noise, 4, level="Medium"), row(script, student, 4)
    rows = page.current_rows([last, small, large, small_again, medium], arms.names_of([noise, student]))
    assert rows == [medium, large, last]


def test_the_difference_of_equal_shares_by_hand(page: ModuleType):
    # Wilson's interval of none in 100 reaches up to z² / (100 + z²) = 3.8415 / 103.8415.
    found = page.paired_difference_of_shares(0, 0, 0, 100)
    assert (found.value, found.low, found.high) == pytest.approx((0.0, -0.036994, 0.036994), abs=1e-6)


def test_the_difference_of_opposite_shares_by_hand(page: ModuleType):
    # None in 4 against all 4: Wilson's intervals are 0 to w and 1 - w to 1 with w = z² / (4 + z²) = 0.489891.
    found = page.paired_difference_of_shares(0, 0, 4, 0)
    assert (found.value, found.low, found.high) == pytest.approx((-1.0, -1.0, -1.0 + 2**0.5 * 0.489891), abs=1e-5)


@pytest.mark.parametrize(
    ("counts", "value", "low", "high"),
    [((59, 6, 16, 80), -0.0621, -0.1186, -0.0046), ((1, 1, 7, 12), -0.2857, -0.5069, -0.0256)],
    ids=["correlated", "less than the correction"],
)
def test_the_difference_of_published_tables(page: ModuleType, counts: tuple, value: float, low: float, high: float):
    # The first has these ends in the tests of the R package contingencytables; the second, of airway
    # hyper-responsiveness, in Fagerland, Lydersen and Laake, Statistics in Medicine 33, 2014.
    found = page.paired_difference_of_shares(*counts)
    assert (found.value, found.low, found.high) == pytest.approx((value, low, high), abs=5e-5)


def test_the_difference_of_a_row_is_negative_where_the_shield_helps(page: ModuleType):
    counts = {"episodes": "161", "helped": "16", "harmed": "6", "violations_without": f"{75 / 161:.4f}"}
    found = page.violations_difference(counts)
    assert (found.value, found.low, found.high) == pytest.approx((-0.0621, -0.1186, -0.0046), abs=5e-5)


def test_the_page_has_the_committed_tables(script: ModuleType, arms: ModuleType):
    rows = script.rows_of(script.TABLE, script.COLUMNS)
    text, tables = script.PAGE.read_text(encoding="utf-8"), script.page_tables(rows, arms.names_of(arms.ARMS))
    assert script.replace_section(text, script.SECTION, f"{tables}\n") == text


def test_noise_is_a_share_of_the_moves(arms: ModuleType):
    generator = arms.torch.Generator().manual_seed(0)
    pilot = np.full((4000, 4), 7)
    moves = arms.Noisy(0.2).act(pilot, deterministic=True, generator=generator)
    assert 0.18 < np.mean(moves[:, 0] != 7) < 0.22
