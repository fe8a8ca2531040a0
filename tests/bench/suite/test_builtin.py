"""Suites by name and from YAML files, and the messages for invalid files."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import CONDITIONS, Condition
from thalweg.bench.suite.arms import Arm, Run, Stage
from thalweg.bench.suite.builtin import SUITES, SYMMETRIC, load_suite
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.record import training_steps
from thalweg.cli.main import main
from thalweg.core.config import to_plain
from thalweg.train.run import has_asymmetric_critics, too_short

ROOT = Path(__file__).resolve().parents[3]
MINE = """
arms:
  - {algorithm: FOCOPS, seeds: [0, 1], steps: 50000}
  - algorithm: PPOLag
    settings: {cost_limit: 0.05, hidden: [64, 64]}
    before: [{algorithm: PPO, level: Easy, steps: 1000}]
    name: strict
test_levels: [Easy]
episodes: 5
packaged: false
conditions: [real, {name: dusk, varied: [sun_elevation_deg], blind: false}]
"""


def written(folder: Path, text: str) -> str:
    (folder / "mine.yaml").write_text(text)
    return str(folder / "mine.yaml")


@pytest.mark.parametrize(("written", "film"), [("false", "none"), ("none", "none"), ("best", "best")])
def test_a_file_says_what_is_filmed(tmp_path: Path, written: str, film: str):
    (tmp_path / "mine.yaml").write_text(f"arms: [{{algorithm: PPO}}]\nfilm: {written}\n")
    assert load_suite(str(tmp_path / "mine.yaml")).film == film
    (tmp_path / "mine.yaml").write_text("arms: [{algorithm: PPO}]\nfilm: all\n")
    with pytest.raises(ResultsError, match="film must be one of 'packaged', 'best', 'none', got 'all'"):
        load_suite(str(tmp_path / "mine.yaml"))


def test_no_run_of_a_suite_is_too_short_to_learn():
    for suite in SUITES.values():
        for arm in suite.arms:
            config = ALGORITHMS[arm.algorithm].configure(dict(arm.settings), arm.preset, suite.num_envs)
            assert not too_short(config, arm.steps, suite.num_envs), arm.label


def test_a_file_gives_the_same_suite_as_the_constructor(tmp_path: Path):
    strict = Arm(
        "PPOLag",
        settings={"cost_limit": 0.05, "hidden": [64, 64]},
        before=(Stage("PPO", "Easy", 1000),),
        name="strict",
    )
    real = next(condition for condition in CONDITIONS if condition.name == "real")
    assert load_suite(written(tmp_path, MINE)) == Suite(
        "mine",
        (Arm("FOCOPS", seeds=(0, 1), steps=50_000), strict),
        test_levels=("Easy",),
        episodes=5,
        packaged=False,
        conditions=(real, Condition("dusk", varied=("sun_elevation_deg",), blind=False)),
    )


def test_the_privileged_suite_trains_every_algorithm_and_flies_on_unseen_rivers():
    suite = SUITES["privileged"]
    steps = dict.fromkeys(("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "CPO", "CUP"), 200_000)
    steps |= dict.fromkeys(("DDPGLag", "TD3Lag", "SACLag", "CCEPETS", "SafeLOOP"), 100_000)
    assert {arm.label: arm.steps for arm in suite.arms} == steps
    assert {(arm.seeds, arm.preset, suite.observation_of(Run("train", arm.label, 0))) for arm in suite.arms} == {
        ((0, 1, 2), "default", "privileged")
    }
    assert (suite.train_level, suite.baselines, suite.packaged) == ("Medium", SUITES["paper"].baselines, False)
    trials = [str(trial) for trial in suite.trials(Run("train", "PPO", 0))]
    assert trials == ["Easy", "Medium", "Hard", "Easy, unseen", "Medium, unseen", "Hard, unseen"]


ON_POLICY = ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "CPO", "CUP")


def test_the_suite_of_geometry_trains_what_the_paper_does_on_its_codes():
    suite = SUITES["geometry"]
    study = [arm.label for arm in SUITES["paper"].arms if arm.label == arm.algorithm]
    assert [arm.label for arm in suite.arms] == study
    assert {arm.label: arm.seeds for arm in suite.arms} == {
        name: (0, 1, 2) if name in ON_POLICY else (0,) for name in study
    }
    assert {(arm.steps, arm.preset, suite.level_of(arm)) for arm in suite.arms} == {(200_000, "default", "Medium")}
    assert {suite.encoder_of(run) for run in suite.runs()} == {"geometry"}
    flown = {trial.condition.name for trial in suite.trials(Run("train", "PPO", 0))}
    assert flown == {"", "unseen", "all_at_once"}


def test_the_suite_of_imitation_trains_from_the_packaged_policy_on_images():
    suite = SUITES["imitated"]
    assert [arm.label for arm in suite.arms] == ["PPO-imitated", "PPOLag-imitated", "CPO-imitated"]
    assert {(arm.as_data()["begin_with"], arm.observation, arm.steps, arm.seeds) for arm in suite.arms} == {
        ("packaged", "rgb+mask", 100_000, (0, 1, 2))
    }
    assert {suite.seeds_of(arm, arm) for arm in suite.arms} == {tuple(range(1000, 1016))}
    assert "packaged-0" in {run.name for run in suite.runs()}


def test_open_choices_have_three_seeds_and_steps_by_the_kind_of_their_algorithm():
    arms = SUITES["open"].arms
    assert len(arms) == 16 and {arm.seeds for arm in arms} == {(0, 1, 2)}
    assert {(arm.algorithm, arm.steps) for arm in arms} == {
        ("FOCOPS", 200_000), *((name, 100_000) for name in ("DDPGLag", "SACLag", "SafeLOOP", "CCEPETS")),
    }  # fmt: skip


def config_of(stage: Arm | Stage) -> Any:
    return ALGORITHMS[stage.algorithm].configure(dict(stage.settings), stage.preset, 16)


def test_critics_of_the_reference_without_a_limit_see_what_those_of_algorithms_with_one_do():
    told = {arm.label for arm in SUITES["paper"].arms if has_asymmetric_critics(config_of(arm))}
    assert told == {"PPO"}
    reference = SUITES["paper"].arm(SYMMETRIC)
    assert to_plain(config_of(reference)) == to_plain(config_of(Arm("PPO"))) | {"asymmetric_critics": False}
    assert (reference.seeds, reference.steps) == ((0, 1, 2), 200_000)
    stages = [stage for arm in SUITES["protocols"].arms for stage in (*arm.before, arm)]
    assert not [stage for stage in stages if has_asymmetric_critics(config_of(stage))]


def test_protocols_have_the_same_number_of_steps_and_widen_the_limit_at_the_beginning_alone():
    arms = SUITES["protocols"].as_data()["arms"]
    assert [training_steps(arm) for arm in arms] == [200_000] * 4
    for arm in SUITES["protocols"].arms:
        first, *later = (*arm.before, arm)
        assert [config_of(stage).cost_limit_schedule for stage in later] == [()] * len(later)
        assert first.settings.keys() <= {"asymmetric_critics"}


def test_the_page_on_the_benchmark_counts_the_runs_of_the_complete_study():
    """The table of expected minutes has a column of runs for each suite."""
    page = (ROOT / "docs" / "bench.md").read_text().partition("| arms | training |")[2]
    rows = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in page.splitlines()]
    header, rows = [name.removeprefix("runs of `") for name in rows[0]], rows[2 : rows.index([""])]
    assert header[-4:] == ["paper", "geometry", "open", "protocols"]
    for column, suite in enumerate(header[-4:], start=-4):
        trained = [run for run in SUITES[suite].runs() if run.kind == "train"]
        assert sum(int(row[column] or 0) for row in rows[:-1]) == len(trained), suite


def test_an_arm_may_see_something_else_than_its_suite(tmp_path: Path):
    text = """
arms: [{algorithm: PPO}, {algorithm: PPO, observation: frames}, {algorithm: PPO, observation: privileged, name: eye}]
observation: privileged
conditions: [unseen, haze, deterministic]
"""
    suite = load_suite(written(tmp_path, text))
    seen = {run.name: suite.observation_of(run) for run in suite.runs() if run.seed == 0}
    assert seen == dict.fromkeys(("random-0", "hover-0", "forward-0", "pilot-0")) | {
        "packaged-0": "frames", "PPO-0": "privileged", "PPO-frames-0": "frames", "eye-0": "privileged",
    }  # fmt: skip
    flown = {run.name: {trial.condition.name for trial in suite.trials(run)} for run in suite.runs()}
    assert flown["PPO-0"] == flown["eye-2"] == {"", "unseen", "deterministic"}
    assert flown["PPO-frames-0"] == flown["packaged-0"] == {"", "unseen", "haze", "deterministic"}
    assert flown["hover-0"] == {"", "unseen"}


def test_suites_of_frames_are_recorded_as_before_there_was_another_observation():
    data = Suite("mine", (Arm("PPO"), Arm("CUP", observation="privileged"))).as_data()
    assert "observation" not in data and "observation" not in data["arms"][0]
    assert (data["arms"][1]["observation"], data["arms"][1]["name"]) == ("privileged", "CUP-privileged")
    assert SUITES["privileged"].as_data()["observation"] == "privileged"


def test_rivers_of_a_suite_are_given_as_ranges_and_recorded_as_such(tmp_path: Path):
    text = """
arms: [{algorithm: PPO, world_seeds: [3, 1:3], before: [{algorithm: PPO, level: Easy, steps: 1}]}, {algorithm: CUP}]
world_seeds: 1000:1256
"""
    suite = load_suite(written(tmp_path, text))
    assert (suite.arms[0].world_seeds, suite.world_seeds) == ((3, 1, 2), tuple(range(1000, 1256)))
    data = suite.as_data()
    assert (data["world_seeds"], data["arms"][0]["world_seeds"]) == (["1000:1256"], [3, 1, 2])
    assert "world_seeds" not in data["arms"][1] and "world_seeds" not in data["arms"][0]["before"][0]
    assert load_suite(written(tmp_path, yaml.safe_dump(data))).as_data() == data


@pytest.mark.parametrize("name", SUITES)
def test_each_builtin_suite_can_be_written_as_a_file(name: str, tmp_path: Path):
    data = SUITES[name].as_data()
    for condition in data["conditions"]:
        condition["rivers"] = list(condition["rivers"])
    assert load_suite(written(tmp_path, yaml.safe_dump(data))).as_data() == SUITES[name].as_data()


OBSERVATIONS = r"'frames', 'privileged', 'rgb\+mask', 'rgb', 'mask'"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ([], "holds no suite: a mapping with arms is needed, got list"),
        ({}, "arms is missing"),
        ({"arms": [{}]}, r"arms\[0\]\.algorithm is missing"),
        ({"arms": [], "epsiodes": 3}, r"Suite has no 'epsiodes' \(did you mean 'episodes'\?\); it has name, arms"),
        ({"arms": "PPO"}, "arms must be a list, got 'PPO'"),
        ({"arms": ["PPO"]}, r"arms\[0\] must be a mapping, got 'PPO'"),
        (
            {"arms": [{"algorithm": "PPO", "steps": 2.5}]},
            r"arms\[0\]\.steps must be a whole number .*, got 2.5",
        ),
        ({"arms": [{"algorithm": "PPO", "settings": {1: 2}}]}, r"settings: a key must be a string, got 1"),
        (
            {"arms": [{"algorithm": "PPO", "stpes": 3}]},
            r"arms\[0\] has no 'stpes' \(did you mean 'steps'\?\); it has",
        ),
        ({1: 2, "arms": []}, ": a key must be a string, got 1; it has name, arms, "),
        (
            {"arms": [{"algorithm": "PPO", 1: 2}]},
            r"arms\[0\]: a key must be a string, got 1; it has algorithm, ",
        ),
        (
            {"arms": [{"algorithm": "PPO", "seeds": [True]}]},
            r"seeds\[0\] must be a whole number .*, got True",
        ),
        ({"arms": [{"algorithm": "PPO", "settings": [1]}]}, r"settings must be a mapping, got \[1\]"),
        ({"arms": [], "observation": "eye"}, f"observation must be one of {OBSERVATIONS}, got 'eye'"),
        (
            {"arms": [{"algorithm": "PPO", "observation": 3}]},
            rf"arms\[0\]\.observation must be one of {OBSERVATIONS} or None, got 3",
        ),
        ({"arms": [], "world_seeds": "9:3"}, "world_seeds: seeds of rivers: 9:3 holds no seed; write 3:9"),
        (
            {"arms": [{"algorithm": "PPO", "world_seeds": [1, "1:3"]}]},
            r"arms\[0\]\.world_seeds: seeds of rivers: the seed 1 is given twice",
        ),
        ({"arms": [], "packaged": 1}, "packaged must be true or false, got 1"),
        (
            {"arms": [], "conditions": ["fog"]},
            r"conditions\[0\]: unknown condition 'fog'; known: deterministic, unseen",
        ),
    ],
)
def test_an_invalid_value_is_named_with_its_path(tmp_path: Path, data: Any, said: str):
    with pytest.raises(ResultsError, match=f"mine.yaml.*{said}"):
        load_suite(written(tmp_path, yaml.safe_dump(data)))


def test_an_arm_of_images_is_named_after_them():
    assert Arm("PPO", settings={"policy": "cnn"}, observation="rgb+mask").label == "PPO-rgb-mask"


CNN = {"algorithm": "PPO", "settings": {"policy": "cnn"}}


@pytest.mark.parametrize(
    ("arm", "said"),
    [
        (CNN, r"PPO: policy=cnn sees images: set observation to rgb\+mask or rgb or mask, not frames"),
        ({"algorithm": "PPO", "observation": "mask"}, "the observation mask is for policies with convolutions"),
        (CNN | {"observation": "rgb", "begin_with": "packaged"}, r"the policy packaged sees rgb\+mask, not rgb"),
        ({"algorithm": "PPO", "begin_with": "packaged"}, r"the policy packaged sees rgb\+mask, not frames"),
        ({"algorithm": "PPO", "begin_with": "mine"}, "begin_with: there is no policy at mine: give a run's folder or"),
        (CNN | {"observation": "rgb+mask", "begin_with": "packaged", "steps": 2048}, "critic_warmup_steps must be at"),
    ],
)
def test_an_arm_of_images_says_which_and_begins_with_a_policy_that_sees_them(
    tmp_path: Path, arm: dict[str, Any], said: str
):
    with pytest.raises(ResultsError, match=said):
        load_suite(written(tmp_path, yaml.safe_dump({"arms": [arm]})))


def test_numbers_may_be_written_with_an_exponent(tmp_path: Path):
    text = "arms: [{algorithm: PPO, steps: 2e5, settings: {learning_rate: 1e-4}}]"
    (arm,) = load_suite(written(tmp_path, text)).arms
    assert (arm.steps, type(arm.steps), arm.settings) == (200_000, int, {"learning_rate": 1e-4})


def test_a_duplicate_key_is_an_error(tmp_path: Path):
    with pytest.raises(ResultsError, match=r"is not YAML: duplicate key 'episodes'"):
        load_suite(written(tmp_path, "arms: []\nepisodes: 3\nepisodes: 4"))


def test_the_file_in_the_docs_is_a_valid_suite(tmp_path: Path):
    shown, *_ = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "bench.md").read_text(), flags=re.DOTALL)
    suite = load_suite(written(tmp_path, shown))
    assert [arm.label for arm in suite.arms] == ["FOCOPS", "FOCOPS-strict"]


def test_the_command_accepts_a_file(tmp_path: Path, capsys: pytest.CaptureFixture):
    file = written(tmp_path, "arms: [{algorithm: POP}]")
    assert main(["bench", file, "--out", str(tmp_path / "out")]) == 2
    assert "suite mine: unknown algorithm 'POP'; known: PPO" in capsys.readouterr().err
    file = written(tmp_path, "arms: [{algorithm: PPO, settings: {pases: 3}, name: mine}]")
    assert main(["bench", file, "--out", str(tmp_path / "out")]) == 2
    assert "suite mine, mine: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path):
    with pytest.raises(ResultsError, match=r"other\.yaml can't be read: No such file"):
        load_suite(str(tmp_path / "other.yaml"))
    with pytest.raises(ResultsError, match=r"mine\.yaml is not YAML: .*line 1"):
        load_suite(written(tmp_path, "arms: ["))
    with pytest.raises(ResultsError, match=r"mine\.yaml is empty: a suite is a mapping with arms"):
        load_suite(written(tmp_path, ""))


@pytest.mark.parametrize(
    ("arm", "most"),
    [
        (Arm("PPO", steps=4096, before=(Stage("PPO", "Easy", 1),), name="short"), 2048),
        (Arm("PPO", before=(Stage("PPO", "Easy", 1), Stage("TD3Lag", "Hard", 10_500)), name="short"), 9_496),
    ],
)
def test_stages_too_short_for_the_warmup_of_critics_are_refused_before_anything_runs(arm: Arm, most: int):
    with pytest.raises(ResultsError, match=f"short, stage 2: critic_warmup_steps must be at most {most} in a run"):
        Suite("mine", (arm,))
    first = replace(arm, before=(), steps=1)
    assert Suite("mine", (first,)).arm("short").steps == 1  # the first stage begins with no policy
