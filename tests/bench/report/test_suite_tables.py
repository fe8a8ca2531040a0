"""Tests of the tables of algorithms and runs."""

from dataclasses import replace
from pathlib import Path

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.report.comparison_tables import condition_table
from thalweg.bench.report.policies import with_critics
from thalweg.bench.report.result_tables import paper_table
from thalweg.bench.report.suite_tables import algorithm_table, constraint_method, domain
from thalweg.bench.report.table import PAPER
from thalweg.bench.results.results import OutdatedPolicy, Results, RunRow
from thalweg.bench.results.run_versions import Versions
from thalweg.bench.suite.arms import Arm, Stage
from thalweg.bench.suite.config import Suite
from thalweg.core.versions import ALGORITHMS as ALGORITHMS_NOW

ON_POLICY = ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "CPO", "CUP")


def test_every_algorithm_has_the_domain_of_its_paper():
    expected = dict.fromkeys(ON_POLICY, "on-policy") | dict.fromkeys(("DDPGLag", "TD3Lag", "SACLag"), "off-policy")
    expected |= dict.fromkeys(("CCEPETS", "SafeLOOP"), "model-based")
    assert {name: domain(entry) for name, entry in ALGORITHMS.items()} == expected


def test_the_config_shows_how_a_limit_is_enforced():
    found = {name: constraint_method(entry) for name, entry in ALGORITHMS.items()}
    assert found["PPO"] == "not at all"
    assert {name for name, by in found.items() if by == "a multiplier"} == {
        "PPOLag", "FOCOPS", "CUP", "DDPGLag", "TD3Lag", "SACLag",
    }  # fmt: skip


def test_each_arm_has_a_row_also_where_its_algorithm_no_longer_exists():
    arms = [Arm(name, preset).as_data() for name, preset in (("FOCOPS", "paper"), ("Gone", "default"))]
    text = algorithm_table(Results(Path(), {"name": "it", "arms": arms}, [], [], [], [])).text
    assert text.to_numpy().tolist() == [
        ["FOCOPS-paper", "on-policy", "a multiplier", ALGORITHMS["FOCOPS"].about, "what the policy sees"],
        ["Gone", "unknown", "unknown", "unknown", "what the policy sees"],
    ]


def test_the_observation_is_a_column_where_it_is_not_frames_for_all():
    suite = Suite("it", (Arm("PPO"), Arm("CUP", observation="frames")), observation="privileged").as_data()
    table = algorithm_table(Results(Path(), suite, [], [], [], [])).text
    assert table["observation"].tolist() == ["privileged", "frames"]
    assert table["policy"].tolist() == ["PPO", "CUP-frames"]


def test_policies_that_see_images_are_told_from_those_that_see_codes_of_frames():
    arms = [Arm("PPO").as_data(), Arm("CUP").as_data() | {"observation": "rgb+mask"}]
    table = algorithm_table(Results(Path(), {"name": "it", "arms": arms}, [], [], [], [])).text
    assert table["observation"].tolist() == ["frames", "rgb+mask"]


def test_what_critics_see_is_a_column():
    told = Arm("CUP", settings={"asymmetric_critics": True}, name="told")
    suite = Suite("it", (Arm("PPO"), Arm("CUP"), Arm("PPO", "paper"), told)).as_data()
    results = Results(Path(), suite, [], [], [], [])
    more, same = "the privileged state and progress too", "what the policy sees"
    assert algorithm_table(results).text["critics see"].tolist() == [more, same, same, more]
    outdated = {"PPO (PPO 1)": OutdatedPolicy("PPO", "PPO 1")}
    assert replace(results, outdated=outdated).with_asymmetric_critics == ["told"]
    before = {"PPO-0": {"render": 1, "PPO": 1}, "told-0": {"render": 1, "CUP": 1, "privileged": 1}}
    assert replace(results, versions=before).with_asymmetric_critics == ["told"]
    eye = replace(results, suite=suite | {"observation": "privileged"})
    now = {"PPO-0": {"privileged": 1, "PPO": ALGORITHMS_NOW["PPO"]}, "told-0": {"privileged": 1, "CUP": 1}}
    assert replace(eye, versions=now).with_asymmetric_critics == [
        "PPO"
    ]  # today's settings say nothing of CUP as it was
    begun = Suite("it", (Arm("CUP", before=(Stage("PPO", "Easy", 1),)),)).as_data()
    assert Results(Path(), begun, [], [], [], []).with_asymmetric_critics == ["CUP"]


def test_what_critics_of_outdated_policies_saw_is_what_their_runs_recorded():
    suite = Suite("it", (Arm("PPO"), Arm("CUP"))).as_data()
    outdated = {f"{name} (render 1)": OutdatedPolicy(name, "render 1") for name in ("PPO", "CUP")}
    told: Versions = {"render": 1, "CUP": 1, "privileged": 1}
    recorded: dict[str, Versions] = {"PPO-0 (render 1)": {"render": 1, "PPO": 1}, "CUP-0 (render 1)": told}
    results = Results(Path(), suite, [], [], [], [], outdated=outdated, versions=recorded)
    more, same = "the privileged state and progress too", "what the policy sees"
    assert [results.critics_see(name) for name in (*outdated, "hover")] == [same, more, "none"]
    repeated: Versions = {"render": 3, "PPO": ALGORITHMS_NOW["PPO"], "privileged": 2}
    runs = [RunRow("PPO-0", "train", "PPO", 0, 9, "finished")]
    again = replace(results, runs=runs, versions=recorded | {"PPO-0": repeated})
    assert [again.critics_see(name) for name in ("PPO", "PPO (render 1)")] == [more, same], "each by its own records"
    eye = replace(results, suite=suite | {"observation": "privileged"})
    assert eye.critics_see("CUP (render 1)") == "unknown", "the privileged observation says nothing of its critics"
    assert algorithm_table(results).text["critics see"].tolist() == [same, more], "an arm has been run as these alone"
    assert replace(results, versions={}).critics_see("PPO (render 1)") == "unknown", "nothing is recorded"


def test_tables_of_policies_say_last_what_critics_see(results: Results):
    more, same = "the privileged state and progress too", "what the policy sees"
    found = with_critics(condition_table)(results)
    assert found.text["critics see"].tolist() == [more, same]
    assert list(found.text) == [*condition_table(results).text, "critics see"]
    paper = with_critics(paper_table)(results)
    assert dict(zip(paper.text["policy"], paper.text["critics see"], strict=True)) == {
        "hover": "none", "PPO": more, "PPO (paper, another simulator)": same, "FOCOPS": same,
        "FOCOPS (paper, another simulator)": same, "P3O": same, "P3O (paper, another simulator)": same,
    }  # fmt: skip
    figures = paper.figures
    assert figures.columns[-1] == "critics see"
    assert figures.loc[figures["policy"] == "PPO", ["source", "critics see"]].to_numpy().tolist() == [
        ["thalweg", more],
        [PAPER, same],
    ]
    untrained = replace(results, suite=results.suite | {"arms": []})
    assert "critics see" not in with_critics(condition_table)(untrained).text
