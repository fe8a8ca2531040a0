"""Policies that were trained before, in suites: flown as they are, told by the content of files, and begun with."""

import json
import pickle
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.bench.small_backend import SUITE, SmallBackend
from tests.env import handmade
from tests.image_policies import image_policy
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import CONDITIONS, SHIELDED, Trial
from thalweg.bench.evaluate.course import Course
from thalweg.bench.execute.backend import RiverBackend, installed_versions
from thalweg.bench.execute.cluster.node_task import RunRequest, run_on_node
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.execute.verification import verify
from thalweg.bench.leaderboard import entries, leaderboard
from thalweg.bench.packaged import PACKAGED_POLICIES, PACKAGED_RGB
from thalweg.bench.report.report import problems
from thalweg.bench.report.result_tables import paper_table
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.run_versions import read_versions
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.builtin import load_suite
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.flown import Function, SavedPolicy, flown
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.core import versions
from thalweg.core.cache import file_hash
from thalweg.env import sample_starts
from thalweg.env.spaces import CHANNELS
from thalweg.train.encoder_of_run import context_of
from thalweg.train.folder.run_record import POLICY
from thalweg.train.river import RiverTraining

pytestmark = pytest.mark.usefixtures("no_pictures")
ROOT = Path(__file__).resolve().parents[3]
LEVELS = ("Easy", "Medium", "Hard")
TAUGHT = {"imitation_version": versions.IMITATION}


def saved(folder: Path, seed: int, **context: Any) -> Path:
    """Write a policy of images into a run's folder."""
    policy = image_policy("rgb")
    policy.about.context.update(context | {"drawn_by": seed})
    folder.mkdir()
    policy.save(folder / POLICY)
    return folder


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """Folders of three seeds of a student."""
    return [saved(tmp_path / f"student-{seed}", seed, **TAUGHT) for seed in range(3)]


def suite(*policies: SavedPolicy, **changes: Any) -> Suite:
    return replace(SUITE, **{"arms": (), "test_levels": LEVELS, "policies": policies, **changes})


def saved_policy(*runs: Path, name: str = "") -> SavedPolicy:
    return SavedPolicy(tuple(PolicyFile.of(str(run)) for run in runs), name)


def student(runs: list[Path]) -> SavedPolicy:
    return saved_policy(*runs, name="student")


def flights(backend: SmallBackend) -> list[str]:
    assert not [call for call in backend.calls if call.startswith("train")]
    return [call.removeprefix("evaluate ") for call in backend.calls if call.startswith("evaluate student")]


def test_each_file_is_a_seed_and_the_record_tells_its_content(runs: list[Path], tmp_path: Path):
    backend, planned = SmallBackend(), suite(student(runs))
    assert planned.runs() == (Run("baseline", "hover", 0), *(Run("policy", "student", seed) for seed in range(3)))
    assert {planned.observation_of(run) for run in planned.runs()[1:]} == {"rgb"}
    outcome = run_suite(planned, tmp_path / "results", backend)
    assert flights(backend) == [f"student-{seed} {level}" for seed in range(3) for level in LEVELS]
    made_with = read_versions(tmp_path / "results")
    assert made_with["student-2"] == {
        "world": versions.WORLD, "rules": versions.RULES, "evaluation": versions.EVALUATION, "render": versions.RENDER,
    }  # fmt: skip
    assert (problems(outcome.results), outcome.results.policies) == ([], ["hover", "student"])
    (recorded,) = json.loads((tmp_path / "results" / "suite.json").read_text())["policies"]
    files = [{"file": f"student-{seed}", "content": file_hash(run / POLICY)} for seed, run in enumerate(runs)]
    assert recorded == {"policy": files, "name": "student", "observation": "rgb", "taught": True}


def test_results_belong_to_the_content_wherever_the_files_are(runs: list[Path], tmp_path: Path):
    folder = tmp_path / "results"
    run_suite(suite(student(runs)), folder, SmallBackend())
    moved = (tmp_path / "moved").resolve()
    moved.mkdir()
    runs = [run.rename(moved / f"other-{run.name}") for run in runs]
    again = SmallBackend()
    run_suite(suite(student(runs)), folder, again)
    assert flights(again) == []
    image_policy("rgb").save(runs[1] / POLICY)
    with pytest.raises(ResultsError, match=r"is taught of .*student-0 is True, that of .*student-1 False"):
        student(runs)
    saved(moved / "other", 9, **TAUGHT).joinpath(POLICY).rename(runs[1] / POLICY)
    with pytest.raises(ResultsError, match="belongs to another suite: policies is "):
        run_suite(suite(student(runs)), folder, SmallBackend())


def test_the_report_needs_no_file_and_marks_outdated_flights(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = tmp_path / "results"
    run_suite(suite(student(runs)), folder, SmallBackend())
    for run in runs:
        (run / POLICY).unlink()
    assert (read_results(folder).outdated, problems(read_results(folder))) == ({}, [])
    monkeypatch.setattr(versions, "RENDER", versions.RENDER + 1)
    assert set(read_results(folder).outdated) == {f"student (render {versions.RENDER - 1})"}


def test_one_of_three_seeds_of_a_student_is_told_as_one_of_three(tmp_path: Path, runs: list[Path]):
    found = run_suite(suite(student(runs)), tmp_path / "results", SmallBackend(), only=("student-0",)).results
    assert paper_table(found).text["seeds"].tolist() == ["1 of 3"]


def test_the_leaderboard_counts_the_seeds_of_a_student_that_were_flown(tmp_path: Path, runs: list[Path]):
    run_suite(suite(student(runs)), tmp_path / "results", SmallBackend(), only=("student-0",))
    assert [entry.seeds for entry in entries(tmp_path / "results")] == [1]


def test_a_student_has_a_run_of_each_of_its_files(tmp_path: Path, runs: list[Path]):
    found = run_suite(suite(student(runs)), tmp_path / "results", SmallBackend()).results
    assert found.runs_of("student") == ["student-0", "student-1", "student-2"]


def test_the_leaderboard_ranks_three_seeds_of_a_student_with_an_interval(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("tests.bench.small_backend.SUITE", replace(SUITE, episodes=20))
    own = saved_policy(saved(tmp_path / "mine", 7))
    planned = suite(student(runs), own, episodes=20, conditions=("unseen",))
    run_suite(planned, tmp_path / "results", SmallBackend())
    taught, mine = entries(tmp_path / "results")
    assert (taught.seeds, taught.trained, taught.taught, taught.missing) == (3, False, True, ())
    assert (mine.policy, mine.seeds, mine.taught, mine.missing) == ("mine", 1, False, ())
    assert taught.returns["Medium"].low < taught.returns["Medium"].value
    assert np.isnan(mine.returns["Medium"].low)
    page = leaderboard([tmp_path / "results"])
    section = page.partition("## Imitated, and trained from an imitated policy")[2]
    assert "| 1 | student (rgb) | results |" in section.partition("## Not trained here")[0]
    assert "| 1 | mine (rgb) | results |" in section.partition("## Not trained here")[2]
    (tmp_path / "results" / "evaluation" / "student-1-Hard.csv").unlink()
    assert entries(tmp_path / "results")[0].missing == ("flights on Hard",)


def test_each_seed_flies_every_condition(runs: list[Path]):
    planned = suite(student(runs), conditions=CONDITIONS)
    trials = planned.trials(Run("policy", "student", 1))
    assert {trial.condition.name for trial in trials} == {"", *(each.name for each in planned.conditions)}
    results = Results(Path(), json.loads(json.dumps(planned.as_data())), [], [], [], [])
    asked = [
        (seed, level) for name, policy, seed, level in results.planned_flights if (name, policy) == ("", "student")
    ]
    assert sorted(asked) == sorted((seed, level) for seed in range(3) for level in LEVELS)


def test_it_is_flown_by_the_river_backend_as_the_file_says(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    ring = handmade.ring()
    course = Course(ring, sample_starts(ring, 2, 0), np.zeros(2), np.arange(2))
    monkeypatch.setattr(Course, "of_level", classmethod(lambda *_, drawn=True: course))
    planned = replace(SUITE, arms=(), policies=(student(runs),), episodes=2, test_levels=("Easy",))
    place = RiverBackend(planned)
    run = Run("policy", "student", 1)
    assert context_of(place.policy(run, tmp_path))["drawn_by"] == 1
    assert place.title(run, tmp_path) == "student, seed 1"
    black = np.zeros((2, 128, 128, CHANNELS["rgb"]), np.uint8)
    monkeypatch.setattr(place, "observer", lambda *_: lambda step: black[: len(step.flying)])
    rows = place.evaluate(run, tmp_path, Trial("Easy"), lambda _: None)
    assert [(row.algorithm, row.seed, row.episode) for row in rows] == [("student", 1, 0), ("student", 1, 1)]
    image_policy("rgb").save(runs[1] / POLICY)
    with pytest.raises(ResultsError, match=r"student-1 has changed since the suite was read"):
        place.policy(run, tmp_path)
    (runs[1] / POLICY).unlink()
    with pytest.raises(ResultsError, match="is gone now"):
        place.policy(run, tmp_path)


def test_a_verification_is_of_the_same_content(runs: list[Path], tmp_path: Path):
    folder, backend = tmp_path / "results", SmallBackend()
    run_suite(suite(student(runs)), folder, SmallBackend())
    saved(tmp_path / "other", 9, **TAUGHT).joinpath(POLICY).rename(runs[1] / POLICY)
    with pytest.raises(ResultsError, match="belongs to another suite: policies"):
        verify(suite(student(runs)), folder, tmp_path / "again", ("student-1",), backend)
    assert backend.calls == []
    (outcome,) = verify(suite(student(runs)), folder, tmp_path / "again", ("hover-0",), backend)
    assert outcome.reproduced


def test_a_node_with_another_policy_to_begin_with_trains_nothing(runs: list[Path]):
    sees: dict[str, Any] = {"settings": {"policy": "cnn"}, "observation": "rgb", "steps": 50_000}
    begun = Arm("PPO", begin_with=PolicyFile.of(str(runs[0])), **sees)
    planned = replace(SUITE, arms=(begun,))
    sent = RunRequest(Run("train", begun.label, 0), planned, SmallBackend(), {}, installed_versions(), 0.0)
    assert next(run_on_node(sent)).files is None
    (runs[0] / POLICY).unlink()
    with pytest.raises(
        ResultsError, match=r"of the cluster has another policy .*student-0 \(its content: no file there, "
    ):
        next(run_on_node(sent))


def test_another_process_reads_the_file_itself(runs: list[Path]):
    sent = pickle.loads(pickle.dumps(student(runs)))
    assert (sent.label, sent.seeds, sent.observation) == ("student", (0, 1, 2), "rgb")
    assert set(sent.policy[0].__dict__) == {"given", "content", "policy"}  # read when it was asked what it sees
    assert set(pickle.loads(pickle.dumps(sent.policy[0])).__dict__) == {"given", "content"}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"policy": "nowhere"}, "there is no policy at nowhere: give a run's folder or a policy file"),
        ({"policy": 3}, "must be a run's folder, a policy file, or one of packaged, packaged-rgb, got 3"),
        ({"policy": []}, "policy names no file"),
        ({"policy": "packaged"}, "the policy packaged is flown with packaged: true"),
        ({"policy": PACKAGED_RGB, "name": "a b"}, "a policy is called 'a b'"),
        ({"policy": [PACKAGED_RGB, PACKAGED_RGB]}, "packaged-rgb is named twice"),
        ({"policy": PACKAGED_RGB, "name": "hover"}, "hover is named twice"),
        ({"policy": PACKAGED_RGB, "seed": 3}, "SavedPolicy has no 'seed'; it has policy, name"),
        ({"function": "nowhere.py:fly"}, "there is no file .*nowhere.py"),
    ],
)
def test_what_is_no_policy_is_refused_before_anything_runs(given: dict[str, Any], words: str, tmp_path: Path):
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({"arms": [], "baselines": ["hover"], "policies": [given]}))
    with pytest.raises(ResultsError, match=words):
        load_suite(str(tmp_path / "mine.yaml"))


def test_a_policy_that_does_not_fit_the_flights_is_refused(tmp_path: Path):
    other = saved(tmp_path / "old", 0, render_version=versions.RENDER + 1)
    with pytest.raises(ResultsError, match="old: the policy was trained on images of renderer version"):
        suite(saved_policy(other))
    own = saved(tmp_path / "coded", 0, observation="frames", encoder="0123", encoder_file="")
    with pytest.raises(ResultsError, match="takes images, but does not say which"):
        saved_policy(own)


def test_a_policy_whose_frames_have_no_mask_is_not_shielded(runs: list[Path]):
    with pytest.raises(ResultsError, match=r"student-0: the shield reads water masks, but this policy sees images"):
        suite(student(runs), conditions=(SHIELDED,))


def test_a_policy_that_a_training_cannot_begin_with_is_refused_before_anything_runs(tmp_path: Path):
    sees: dict[str, Any] = {"settings": {"policy": "cnn"}, "observation": "rgb", "steps": 50_000}
    other = saved(tmp_path / "other", 0, env={"vehicle": "asv"})
    with pytest.raises(ResultsError, match=r"arm begun: .*other: the policy was trained for the vehicle asv, not uav"):
        replace(SUITE, arms=(Arm("PPO", begin_with=PolicyFile.of(str(other)), name="begun", **sees),))


def test_a_policy_whose_training_began_with_a_taught_one_is_taught(tmp_path: Path):
    assert PolicyFile.of(str(saved(tmp_path / "further", 0, taught=True))).is_taught
    assert not PolicyFile.of(str(saved(tmp_path / "own", 0))).is_taught
    assert PolicyFile.of("packaged").is_taught and PolicyFile.of(PACKAGED_RGB).is_taught


def test_a_text_names_a_function_or_a_policy(tmp_path: Path, runs: list[Path]):
    (tmp_path / "mine.py").write_text("def ahead(obs):\n    return [1, 1, 0, 1]\n")
    assert isinstance(flown(f"{tmp_path / 'mine.py'}:ahead"), Function)
    assert flown(str(runs[0])).label == "student-0"
    assert flown(PACKAGED_RGB).label == PACKAGED_RGB
    assert flown(str(PACKAGED_POLICIES[PACKAGED_RGB])).label == "flight_rgb"


def test_the_file_in_the_docs_is_a_valid_suite(runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    blocks = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "bench.md").read_text(), flags=re.DOTALL)
    (shown,) = (text for text in blocks if "packaged-rgb" in text)
    (tmp_path / "runs").mkdir()
    for run in runs:
        run.rename(tmp_path / "runs" / run.name)
    (tmp_path / "mine.py").write_text("def fly(obs):\n    return [1, 1, 0, 1]\n")
    (tmp_path / "students.yaml").write_text(shown)
    monkeypatch.chdir(tmp_path)
    planned = load_suite("students.yaml")
    assert [each.label for each in planned.policies] == ["student", PACKAGED_RGB, "fly"]
    assert [run.name for run in planned.runs() if run.kind == "policy"] == [
        *(f"student-{seed}" for seed in range(3)), f"{PACKAGED_RGB}-0",
    ]  # fmt: skip


def test_an_arm_may_begin_with_any_policy(runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    given: list[Any] = []
    monkeypatch.setattr(RiverTraining, "train", lambda *_, **options: given.append(options["begin_with"]))
    sees: dict[str, Any] = {"settings": {"policy": "cnn"}, "observation": "rgb", "steps": 50_000}
    arm = Arm("PPO", begin_with=str(runs[0]), name="begun", **sees)  # pyright: ignore[reportArgumentType]
    planned = replace(SUITE, arms=(arm,))
    RiverBackend(planned).train(Run("train", "begun", 0), tmp_path / "run")
    assert given == [runs[0] / POLICY]
    content = file_hash(runs[0] / POLICY)
    assert arm.as_data()["begin_with"] == {"file": "student-0", "content": content, "taught": True}
    with pytest.raises(ResultsError, match="student-0 sees rgb, not rgb\\+mask: leave begin_with out, or set policy="):
        replace(planned, arms=(replace(arm, observation="rgb+mask"),))
    image_policy("rgb").save(runs[0] / POLICY)
    with pytest.raises(ResultsError, match="has changed since the suite was read"):
        RiverBackend(planned).train(Run("train", "begun", 0), tmp_path / "run")


def test_an_arm_that_begins_with_a_policy_of_its_own_is_no_training_from_nothing(tmp_path: Path):
    sees: dict[str, Any] = {"settings": {"policy": "cnn"}, "observation": "rgb", "steps": 50_000, "seeds": (0, 1, 2)}
    mine, taught = saved(tmp_path / "mine", 0), saved(tmp_path / "taught", 1, **TAUGHT)
    arms = tuple(Arm("PPO", begin_with=PolicyFile.of(str(run)), name=run.name, **sees) for run in (mine, taught))
    folder = tmp_path / "results"
    run_suite(replace(SUITE, arms=arms, test_levels=LEVELS), folder, SmallBackend())
    rows = {entry.policy: entry for entry in entries(folder)}
    assert rows["taught"].taught and not rows["mine"].taught
    assert "training from weights drawn by the seed" in rows["mine"].missing
    assert "training from weights drawn by the seed" not in rows["taught"].missing
    assert "packaged" not in read_versions(folder)["taught-0"]
