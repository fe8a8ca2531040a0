"""The leaderboard, on results made by hand: who comes first, and what is not ranked."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.versioned import record_current_versions
from tests.plugins import EXAMPLE, no_plugins  # noqa: F401  (a fixture)
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Condition, Trial
from thalweg.bench.evaluate.episodes import Episode, read_episodes, write_episodes
from thalweg.bench.leaderboard import RUN_FILES, UNSEEN, entries, leaderboard
from thalweg.bench.results.results import RunRow, evaluation_path, read_runs, write_runs
from thalweg.bench.results.run_versions import current_versions, some_critics_are_asymmetric, write_versions
from thalweg.bench.suite.arms import Arm, Stage
from thalweg.bench.suite.config import Suite
from thalweg.cli.main import main
from thalweg.env.forces.options import ForceOptions

AT_ONCE = {"critic_warmup_steps": 0}
"""Settings of a run so short that its policy must learn at once."""

ARMS = tuple(Arm(name, steps=1000) for name in ("PPO", "FOCOPS", "P3O"))
SUITE = Suite("small", ARMS, conditions=(UNSEEN,), baselines=(), packaged=False)
COSTS = {"PPO": (1.0, 0.9, 1.0), "FOCOPS": (0.0, 0.0, 0.0), "P3O": (0.0, 0.1, 0.2)}
RETURNS = {"PPO": 10.0, "FOCOPS": 5.0, "P3O": 9.0}


def flights(policy: str, seed: int, level: str, unseen: bool) -> list[Episode]:
    start, return_, cost = (0.0, 0.0, 5.0, 0.0), RETURNS[policy] - 2.0 * unseen, COSTS[policy][seed % 3]
    return [
        Episode(
            policy, seed, level, 1 + unseen * number, number, *start, return_, cost, cost, 0.0, 99, "Idle", False, 0.5
        )
        for number in range(20)
    ]


def write(folder: Path, suite: Suite = SUITE) -> Path:
    """Results of a suite whose policies return and cost always the same."""
    folder.mkdir()
    (folder / "suite.json").write_text(json.dumps(suite.as_data()))
    rows = []
    for run in suite.runs():
        rows.append(RunRow(run.name, run.kind, run.algorithm, run.seed, 1000, "finished"))
        (folder / "runs" / run.name).mkdir(parents=True)
        for name in RUN_FILES:
            (folder / "runs" / run.name / name).write_text("")
        log = "step,return,tight,loose\n10,1.5,0.6,0.0\n20,2.5,0.0,0.0\n"
        (folder / "runs" / run.name / "episodes.csv").write_text(log)
        for trial in suite.trials(run):
            path = evaluation_path(folder, run.name, trial)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_episodes(path, flights(run.algorithm, run.seed, trial.level, trial.condition.unseen))
    write_runs(folder, rows)
    arms = {arm.label: arm.algorithm for arm in suite.arms}
    record_current_versions(folder, arms, observation=suite.observation, task=suite.task, forces=suite.forces.push)
    return folder


def missing(folder: Path, policy: str = "PPO") -> tuple[str, ...]:
    (found,) = [entry for entry in entries(folder) if entry.policy == policy]
    return found.missing


def test_those_that_surely_keep_the_limit_come_first_then_the_greater_return(tmp_path: Path):
    lines = leaderboard([write(tmp_path / "mine")]).splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")]
    header, _, *ranked = rows
    by = [dict(zip(header, row, strict=True)) for row in ranked]
    assert [(row[""], row["policy"], row["limit met"]) for row in by] == [
        ("1", "FOCOPS", "yes"), ("2", "P3O", "unsure"), ("3", "PPO", "no"),
    ]  # fmt: skip
    assert by[0] == {
        "": "1", "policy": "FOCOPS", "results": "mine", "limit met": "yes", "cost": "0.00 [0.00, 0.06]",
        "Medium": "5.00 [3.77, 6.23]", "Easy": "5.00 [3.77, 6.23]", "Hard": "5.00 [3.77, 6.23]",
        "unseen": "3.00 [1.99, 4.25]", "regret": "0.20", "trained on": "Medium", "steps": "1,000",
        "seeds": "3", "critics see": "what the policy sees", "versions": "current",
    }  # fmt: skip
    assert by[2]["critics see"] == "the privileged state and progress too"
    assert by[1]["cost"] == "0.10 [0.00, 0.35]"  # 0, 0.1, 0.2: 4.303 * 0.1 / sqrt(3), but no less than 0
    assert "Not ranked" not in "".join(lines)


@pytest.mark.parametrize(
    ("suite", "words"),
    [
        (replace(SUITE, arms=(replace(ARMS[0], seeds=(0, 1)),)), ("3 seeds",)),
        (replace(SUITE, arms=(replace(ARMS[0], steps=200_001),)), ("no more than 200,000 steps",)),
        (
            replace(SUITE, arms=(replace(ARMS[0], before=(Stage("PPO", "Easy", 200_000),), settings=AT_ONCE),)),
            ("no more than 200,000 steps",),
        ),
        (replace(SUITE, forces=ForceOptions(current_m_per_s=(0.5, 0.5))), ("the paper's task in still air",)),
        (replace(SUITE, starts_seed=1), ("flights from the starts of `starts_seed` 0",)),
        (replace(SUITE, test_levels=("Medium", "Easy"), conditions=()),
         ("flights on Hard", "flights on Easy, Medium, Hard (unseen)")),
    ],
)  # fmt: skip
def test_what_a_suite_does_not_ask_for_is_lacking(tmp_path: Path, suite: Suite, words: tuple[str, ...]):
    folder = write(tmp_path / "mine", suite)
    assert missing(folder) == words
    page = leaderboard([folder])
    assert "No policy that sees frames has a complete row yet." in page
    assert f"| {'; '.join(words)} |" in page


def test_a_rare_failure_counts(tmp_path: Path):
    folder = write(tmp_path / "mine")
    for seed in range(3):
        path = evaluation_path(folder, f"PPO-{seed}", Trial("Medium"))
        first, *others = read_episodes(path)
        write_episodes(path, [replace(first, return_=0.0), *others])
    (found,) = [entry for entry in entries(folder) if entry.policy == "PPO"]
    assert str(found.returns["Medium"]) == "9.50 [8.93, 10.00]"


def test_a_seed_that_did_badly_cannot_be_left_out(tmp_path: Path):
    folder = write(tmp_path / "mine")
    assert missing(folder) == ()
    evaluation_path(folder, "PPO-1", Trial("Medium")).unlink()
    assert missing(folder) == ("flights on Medium",)
    lines = (folder / "runs.csv").read_text().splitlines(keepends=True)
    (folder / "runs.csv").write_text("".join(line for line in lines if not line.startswith("PPO-1")))
    assert missing(folder) == ("training seed 1", "flights on Medium")


def test_fewer_starts_are_lacking(tmp_path: Path):
    folder = write(tmp_path / "mine")
    for seed in range(3):
        path = evaluation_path(folder, f"PPO-{seed}", Trial("Hard", UNSEEN))
        write_episodes(path, flights("PPO", seed, "Hard", True)[:19])
    assert missing(folder) == ("flights on Hard (unseen)",)


def test_folders_that_cannot_be_used_are_errors(tmp_path: Path):
    with pytest.raises(ResultsError, match="at least one folder"):
        leaderboard([])
    with pytest.raises(ResultsError, match="no results folder"):
        leaderboard([tmp_path / "nothing"])
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with pytest.raises(ResultsError, match="two folders are named 'x'"):
        leaderboard([write(tmp_path / "a" / "x"), write(tmp_path / "b" / "x")])


def test_a_condition_that_only_bears_the_name_does_not_count(tmp_path: Path):
    for number, false in enumerate((Condition("unseen"), replace(UNSEEN, deterministic=True))):
        folder = write(tmp_path / str(number), replace(SUITE, conditions=(false,)))
        assert missing(folder) == ("flights on Easy, Medium, Hard (unseen)",)


def test_files_of_a_training_run_must_be_there(tmp_path: Path):
    folder = write(tmp_path / "mine")
    (folder / "runs" / "PPO-2" / "policy.safetensors").unlink()
    assert missing(folder) == ("policy.safetensors of seed 2",)
    (folder / "runs" / "PPO-1" / "episodes.csv").write_text("half a head")  # no regret can be computed from it
    assert missing(folder) == ("episodes.csv of seed 1", "policy.safetensors of seed 2")


def test_results_that_do_not_say_of_what_are_refused(tmp_path: Path):
    folder = write(tmp_path / "mine")
    (folder / "suite.json").write_text('{"name": "mine", "train_level": "Easy", "arms": null}')
    with pytest.raises(ResultsError, match=r"mine: .*suite\.json.*arms must be a list, got null"):
        leaderboard([folder])
    (folder / "suite.json").unlink()
    with pytest.raises(ResultsError, match=r"mine: .*suite\.json"):
        leaderboard([folder])


def test_only_the_first_starts_count(tmp_path: Path):
    folder = write(tmp_path / "mine")
    for seed in range(3):
        path = evaluation_path(folder, f"PPO-{seed}", Trial("Medium"))
        more = [replace(row, episode=20 + row.episode, return_=0.0) for row in flights("PPO", seed, "Medium", False)]
        write_episodes(path, [*flights("PPO", seed, "Medium", False), *more])
    (entry,) = [entry for entry in entries(folder) if entry.policy == "PPO"]
    assert (str(entry.returns["Medium"]), entry.missing) == ("10.00 [9.40, 10.00]", ())


def test_a_policy_whose_every_run_failed_is_named(tmp_path: Path):
    folder = write(tmp_path / "mine")
    for path in folder.glob("evaluation/**/P3O-*.csv"):
        path.unlink()
    write_runs(folder, [replace(row, status="failed", error="no") for row in read_runs(folder) if "P3O" in row.run])
    page = leaderboard([folder])
    assert "| P3O | mine | unknown | missing | missing |" in page
    assert "training seed 0; training seed 1; training seed 2; flights on Easy, Medium, Hard" in page


def test_policies_of_several_folders_and_levels_are_ranked_by_one_level(tmp_path: Path):
    easy = replace(SUITE, arms=(replace(ARMS[1], level="Easy", name="FOCOPS-easy"),))
    COSTS["FOCOPS-easy"], RETURNS["FOCOPS-easy"] = (0.0, 0.0, 0.0), 6.0
    first, second = write(tmp_path / "first"), write(tmp_path / "second", easy)
    lines = [line.strip("| ").split(" | ") for line in leaderboard([first, second]).splitlines() if line[:1] == "|"]
    assert [(line[1], line[2], line[-5]) for line in lines[2:4]] == [
        ("FOCOPS-easy", "second", "Easy"),
        ("FOCOPS", "first", "Medium"),
    ]


def test_policies_of_the_privileged_observation_are_ranked_among_themselves(tmp_path: Path):
    folders = [write(tmp_path / "mine"), write(tmp_path / "eye", replace(SUITE, observation="privileged"))]
    page = leaderboard(folders)
    of_frames, privileged = page.split("## With the privileged observation\n")
    rows = [
        [tuple(cell.strip() for cell in line.split("|")[1:4]) for line in part.splitlines() if line[:1] == "|"][2:]
        for part in (of_frames, privileged)
    ]
    assert rows == [
        [("1", "FOCOPS", "mine"), ("2", "P3O", "mine"), ("3", "PPO", "mine")],
        [("1", "FOCOPS (privileged)", "eye"), ("2", "P3O (privileged)", "eye"), ("3", "PPO (privileged)", "eye")],
    ]
    assert "## With the privileged observation" not in leaderboard(folders[:1])
    assert "No policy that sees frames has a complete row yet." in leaderboard(folders[1:])


def test_policies_of_images_are_ranked_with_those_of_frames_and_say_which_images(tmp_path: Path):
    folders = [write(tmp_path / "mine"), write(tmp_path / "eyes", replace(SUITE, arms=ARMS[1:2]))]
    suite = json.loads((folders[1] / "suite.json").read_text())
    (folders[1] / "suite.json").write_text(json.dumps(suite | {"observation": "rgb+mask"}))
    record_current_versions(folders[1], observation="rgb+mask")
    page = leaderboard(folders)
    assert "## With the privileged observation" not in page and "## Not ranked" not in page
    rows = [tuple(cell.strip() for cell in line.split("|")[1:4]) for line in page.splitlines() if line[:1] == "|"][2:]
    assert rows == [
        ("1", "FOCOPS", "mine"), ("2", "FOCOPS (rgb+mask)", "eyes"), ("3", "P3O", "mine"), ("4", "PPO", "mine"),
    ]  # fmt: skip


def test_the_packaged_policy_and_those_that_begin_with_it_are_ranked_among_themselves(tmp_path: Path):
    begun = replace(
        ARMS[1],
        name="FOCOPS-imitated",
        settings={"policy": "cnn"} | AT_ONCE,
        observation="rgb+mask",
        begin_with="packaged",
    )
    COSTS["packaged"], RETURNS["packaged"] = (0.0, 0.0, 0.0), 7.0
    COSTS["FOCOPS-imitated"], RETURNS["FOCOPS-imitated"] = (0.0, 0.0, 0.0), 9.5
    folder = write(tmp_path / "mine", replace(SUITE, arms=(*ARMS, begun), packaged=True))
    made = json.loads((folder / "versions.json").read_text())
    critics = some_critics_are_asymmetric([("FOCOPS", begun.settings, "default")])
    sees = {"observation": "rgb+mask", "asymmetric_critics": critics, "told_cost_critics": critics}
    own = current_versions("train", ["FOCOPS"], **sees, begins_with_packaged=True)
    write_versions(folder, made | {f"FOCOPS-imitated-{seed}": own for seed in range(3)})
    page = leaderboard([folder])
    assert "## Not ranked" not in page
    alone, taught = page.split("## Imitated, and trained from an imitated policy\n")
    rows = [
        [tuple(cell.strip() for cell in line.split("|")[1:4]) for line in part.splitlines() if line[:1] == "|"][2:]
        for part in (alone, taught)
    ]
    assert [policy for _, policy, _ in rows[0]] == ["FOCOPS", "P3O", "PPO"]
    assert rows[1] == [("1", "FOCOPS-imitated (rgb+mask)", "mine"), ("2", "packaged (rgb+mask)", "mine")]
    (packaged,) = [entry for entry in entries(folder) if entry.policy == "packaged"]
    assert (packaged.trained, packaged.taught, packaged.seeds, packaged.missing) == (False, True, 1, ())
    evaluation_path(folder, "packaged-0", Trial("Hard", UNSEEN)).unlink()
    assert missing(folder, "packaged") == ("flights on Hard (unseen)",)


def test_the_packaged_policy_has_no_rank_where_it_was_flown_in_a_current(tmp_path: Path):
    COSTS["packaged"], RETURNS["packaged"] = (0.0, 0.0, 0.0), 7.0
    suite = replace(SUITE, arms=(), packaged=True, forces=ForceOptions(current_m_per_s=(0.5, 0.5)))
    assert missing(write(tmp_path / "mine", suite), "packaged") == ("the paper's task in still air",)


def test_the_page_in_the_docs_is_what_its_command_writes(monkeypatch: pytest.MonkeyPatch):
    root = Path(__file__).resolve().parents[3]
    monkeypatch.chdir(root)
    said = (root / "docs" / "leaderboard.md").read_text()
    (command,) = re.findall(r"^thalweg leaderboard (.*)$", said, flags=re.MULTILINE)
    assert said == leaderboard([Path(folder) for folder in command.split()])


@pytest.mark.usefixtures("no_plugins")
def test_the_command_on_the_page_loads_the_plugins_that_it_was_made_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    folder = str(write(tmp_path / "mine"))
    assert main(["leaderboard", folder, "--plugin", str(EXAMPLE)]) == 0
    assert f"thalweg leaderboard {folder} --plugin {EXAMPLE}\n" in capsys.readouterr().out


def test_the_command_prints_the_page_or_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture):
    folder, out = str(write(tmp_path / "mine")), tmp_path / "board.md"
    assert main(["leaderboard", folder]) == 0
    printed = capsys.readouterr().out
    assert main(["leaderboard", folder, "--out", str(out)]) == 0
    assert out.read_text() == printed.removesuffix("\n")
    assert main(["leaderboard", folder, "--out", str(tmp_path / "board.html")]) == 2
    assert ".md" in capsys.readouterr().err
