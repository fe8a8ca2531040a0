"""A run from its folder on: what lies there, and that it can be repeated, broken off and resumed."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from tests.train.small_runs import SMALL, SMALL_REPLAY, STEPS, Stop, StopsAt, numbers, rows_of, small, train
from tests.train.toys import Walk
from thalweg.algos import ALGORITHMS, AlgorithmError, LimitWarning, NotFiniteError, Policy
from thalweg.core import versions
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.train import ResumeWarning, ShortRunWarning, TrainingError, load_policy
from thalweg.train.folder.checkpoint import load_checkpoint
from thalweg.train.folder.run_record import RUN_FOLDER
from thalweg.train.run import too_short


@pytest.fixture(scope="module", params=list(ALGORITHMS))
def finished(request, tmp_path_factory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp(request.param)
    train(folder, request.param)
    return request.param, folder


REMEMBERING: dict[str, dict[str, Any]] = {
    "gru": {"memory": "gru", "memory_size": 8, "sequence": 5, "adapter": "box_literal"},
    "frames": {"frame_stack": 3},
    "apart": {"cost_limits": [0.05, 0.1]},
    "pid": {"multiplier_derivative": 2.0, "multiplier_smoothing": 0.5, "multiplier_delay": 3, "cost_window": 60},
    "reset": {"reset_each_update": True, "memory": "gru", "memory_size": 8, "adapter": "box_scaled"},
}
"""Settings by which a run has more to remember; drawn numbers show a difference that drawn options might hide."""
EVERYTHING = {key: value for settings in REMEMBERING.values() for key, value in settings.items()} | {
    "reset_each_update": False
}


@pytest.fixture(scope="module", params=list(REMEMBERING))
def remembered(request, tmp_path_factory) -> tuple[dict[str, Any], Path]:
    folder = tmp_path_factory.mktemp(request.param)
    config = SMALL | REMEMBERING[request.param]
    train(folder, config=config)
    return config, folder


def test_the_folder_of_a_run(finished):
    algorithm, folder = finished
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert config["run"]["algorithm"] == algorithm and config["run"]["seed"] == 3
    assert config["run"]["config"]["minibatch"] == small(algorithm)["minibatch"]
    assert config["versions"]["torch"] == torch.__version__ and config["versions"]["numpy"] == np.__version__
    metrics, episodes = rows_of(folder, "metrics.csv"), rows_of(folder, "episodes.csv")
    assert len(metrics) == -(-STEPS // 128) and metrics[-1]["steps"] == str(STEPS)
    assert list(episodes[0]) == ["step", "env", "return", "cost", "tight", "loose", "length", "reason", "world"]
    assert int(metrics[-1]["episodes"]) == len(episodes)
    recent = [float(row["return"]) for row in episodes[-50:]]
    assert float(metrics[-1]["return_mean_50"]) == pytest.approx(np.mean(recent))
    violated = [row for row in episodes if float(row["cost"]) > 0]
    assert float(metrics[-1]["cost_rate"]) == len(violated) / STEPS
    assert list((folder / "tensorboard").glob("events.*"))
    status = json.loads((folder / "status.json").read_text())
    assert status["state"] == "finished" and status["steps"] == STEPS
    assert not list(folder.rglob("*.part"))


def explained(page: str) -> set[str]:
    """Columns that the table of a page has a row for, or that of a page which its section on metrics refers to."""
    docs = Path(__file__).parents[2] / "docs" / "algorithms"
    section = (docs / f"{page}.md").read_text().partition("## Metrics")[2].partition("\n## ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    others = [explained(other) for other in re.findall(r"\]\((\w+)\.md", section)]
    return {name.strip(" `") for cell in cells for name in cell.split(",")}.union(*others)


def test_every_column_is_explained_on_the_page_of_its_algorithm(finished):
    algorithm, folder = finished
    assert set(rows_of(folder, "metrics.csv")[0]) <= explained(algorithm.lower())


def test_the_same_seed_gives_the_same_numbers(finished, tmp_path):
    algorithm, folder = finished
    torch.manual_seed(99)  # nothing global matters
    np.random.seed(99)  # noqa: NPY002
    train(tmp_path, algorithm, checkpoint_seconds=1e9)
    assert numbers(tmp_path) == numbers(folder)


def test_a_run_starts_the_same_for_any_number_of_threads(tmp_path):
    """As kernels on OpenMP leave it with others; of 64 x 64 weights the last bits would differ."""
    for threads in (1, 2):
        with torch_threads(threads):
            train(tmp_path / str(threads), steps=1, config={"steps_per_update": 128, "hidden": (64, 64)})
    one, two = ((tmp_path / str(threads) / "policy.safetensors").read_bytes() for threads in (1, 2))
    assert one == two


def test_a_run_leaves_the_global_generators_alone(tmp_path):
    torch.manual_seed(1)
    before = torch.get_rng_state()
    train(tmp_path, steps=200)
    assert torch.equal(torch.get_rng_state(), before)


def test_another_seed_gives_other_numbers(finished, tmp_path):
    algorithm, folder = finished
    train(tmp_path, algorithm, seed=4)
    assert numbers(tmp_path)[0] != numbers(folder)[0]


@pytest.mark.parametrize("at", [20, 130, 200, 371])
def test_a_run_broken_off_by_an_error_and_resumed_ends_with_the_same_numbers(finished, tmp_path, at):
    algorithm, folder = finished
    with pytest.raises(Stop):
        train(tmp_path, algorithm, StopsAt(at))
    status = json.loads((tmp_path / "status.json").read_text())
    assert status["state"] == "failed" and status["error"].startswith("Stop")
    result = train(tmp_path, algorithm)
    assert result.resumed_from == ((at - 1) // 32 * 128 or None)
    assert numbers(tmp_path) == numbers(folder)


@pytest.mark.parametrize("at", [130, 371])
def test_a_run_with_more_to_remember_resumes_to_the_same_numbers(remembered, tmp_path, at):
    config, folder = remembered
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(at), config=config)
    assert train(tmp_path, config=config).resumed_from == (at - 1) // 32 * 128
    assert numbers(tmp_path) == numbers(folder)


SCRIPT = """
import json, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.train.small_runs import train
from tests.train.toys import Walk

class Slow(Walk):
    def step(self, actions):
        time.sleep(0.002)
        return super().step(actions)

train(Path(sys.argv[1]), sys.argv[3], Slow(), config=json.loads(sys.argv[4]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "settings"),
    [*((name, {}) for name in ALGORITHMS), ("FOCOPS", EVERYTHING)],
    ids=[*ALGORITHMS, "everything"],
)
def test_a_run_killed_at_any_moment_and_resumed_ends_with_the_same_numbers(tmp_path, algorithm, settings):
    config, whole, broken = small(algorithm) | settings, tmp_path / "whole", tmp_path / "broken"
    train(whole, algorithm, config=config)
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", SCRIPT, str(broken), str(root), algorithm, json.dumps(config)]
    # pytest shows this when the test fails; the delays are then the same, the machine's load is not.
    seed = int(os.environ.get("KILL_SEED", "") or np.random.SeedSequence().generate_state(1)[0])
    print(f"repeat these delays with KILL_SEED={seed}")
    killed, chance = 0, np.random.default_rng(seed)
    for _ in range(3):
        process = subprocess.Popen(command, stderr=subprocess.PIPE)
        deadline = time.monotonic() + 120
        # From the first row on, whatever it is doing: stepping, learning, writing a checkpoint.
        metrics = broken / "metrics.csv"
        size = metrics.stat().st_size if metrics.exists() else 0
        while process.poll() is None and time.monotonic() < deadline:
            if metrics.exists() and metrics.stat().st_size > size:
                break
            time.sleep(0.01)
        time.sleep(chance.uniform(0.0, 0.3))
        if process.poll() is None:
            os.kill(process.pid, signal.SIGKILL)
            killed += 1
        process.wait()
        assert process.returncode in (0, -signal.SIGKILL), process.stderr and process.stderr.read().decode()
    assert killed >= 1
    train(broken, algorithm, config=config)
    assert numbers(broken) == numbers(whole)


def test_a_finished_run_is_returned_at_once(finished):
    algorithm, folder = finished
    before = numbers(folder)
    result = train(folder, algorithm, StopsAt(1))
    assert result.already_finished and result.steps == STEPS and result.algorithm == algorithm
    assert numbers(folder) == before


@pytest.mark.parametrize("raised", ["training", "FOCOPS"])
def test_a_run_of_another_version_is_not_resumed(tmp_path, monkeypatch, raised):
    with pytest.raises(Stop):
        train(tmp_path, "FOCOPS", StopsAt(130))
    with monkeypatch.context() as later:
        later.setattr(versions, "TRAINING", versions.TRAINING + (raised == "training"))
        later.setitem(versions.ALGORITHMS, "FOCOPS", versions.ALGORITHMS["FOCOPS"] + (raised == "FOCOPS"))
        with pytest.raises(TrainingError, match=rf"made with {raised} \d, not \d: .*another folder"):
            train(tmp_path, "FOCOPS")
    assert train(tmp_path, "FOCOPS").resumed_from == 512
    monkeypatch.setattr(versions, "TRAINING", versions.TRAINING + 1)
    with pytest.warns(ResumeWarning, match="made with training"):
        assert train(tmp_path, "FOCOPS").already_finished


def test_a_run_from_before_versions_were_recorded_resumes(tmp_path):
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(130))
    config = yaml.safe_load((tmp_path / "config.yaml").read_text())
    del config["made_with"]
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    assert train(tmp_path).resumed_from == 512


def test_an_environment_that_can_not_be_brought_back_resumes_with_a_warning(tmp_path):
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(200, portable=False))
    with pytest.warns(ResumeWarning, match="no get_state"):
        result = train(tmp_path, env=Walk(portable=False))
    assert result.steps == STEPS
    steps = [int(row["step"]) for row in rows_of(tmp_path, "episodes.csv")]
    assert steps == sorted(steps)


@pytest.mark.parametrize("what", ["observation", "reward", "cost"])
def test_nan_from_the_environment_stops_the_run_and_leaves_the_last_good_checkpoint(tmp_path, what):
    with pytest.raises(NotFiniteError, match=what):
        train(tmp_path, env=Walk(poison=(what, 100)))
    status = json.loads((tmp_path / "status.json").read_text())
    assert status["state"] == "failed" and f"{what} is not finite" in status["error"]
    assert [path.name for path in (tmp_path / "checkpoints").iterdir()][-1:] and not (
        tmp_path / "policy.safetensors"
    ).exists()
    with pytest.raises(AlgorithmError, match=r"\(failed\)"):
        load_policy(tmp_path)
    result = train(tmp_path)
    assert result.resumed_from == 384


def test_nan_in_the_first_observation_is_a_failed_run_too(tmp_path):
    class Blind(Walk):
        def reset(self, **given):
            obs, info = super().reset(**given)
            return obs * np.nan, info

    with pytest.raises(
        NotFiniteError, match=r"observation is not finite in rows \[0, .* of the reset after vector step 0"
    ):
        train(tmp_path, env=Blind())
    status = json.loads((tmp_path / "status.json").read_text())
    assert (status["state"], status["steps"]) == ("failed", 0)
    assert train(tmp_path).resumed_from is None


def test_the_status_of_a_resumed_run_is_that_of_its_last_checkpoint(tmp_path):
    seen = []

    class Watched(Walk):
        def step(self, actions):
            if (tmp_path / "status.json").exists():
                seen.append(json.loads((tmp_path / "status.json").read_text()))
            return super().step(actions)

    train(tmp_path, env=Watched())
    assert {status["state"] for status in seen} == {"running"}
    assert sorted({status["steps"] for status in seen}) == [128 * k for k in range(STEPS // 128 + 1)]
    assert seen[0]["return_mean"] is None and seen[-1]["return_mean"] < 100  # no NaN, which JSON has not


def test_the_status_of_a_run_broken_off_tells_its_steps_its_checkpoint_and_the_time_of_both(tmp_path):
    """Between two rows of metrics, which this run has none of yet."""
    with pytest.raises(Stop):
        train(tmp_path, "TD3Lag", StopsAt(41), config=SMALL_REPLAY | {"steps_per_update": 10_000})
    status = json.loads((tmp_path / "status.json").read_text())
    found = load_checkpoint(tmp_path)
    assert found is not None and (status["state"], status["steps"], status["checkpoint"]) == ("failed", 160, found[0])
    assert found[0] == 128 and 0.0 < found[1]["seconds"] < status["seconds"]


def test_a_loss_that_turns_nan_stops_the_run_and_leaves_the_last_good_checkpoint(tmp_path):
    class Huge(Walk):
        def step(self, actions):
            obs, reward, *rest = super().step(actions)
            return obs, reward * (1e30 if self.total > 100 else 1.0), *rest

    with pytest.raises(NotFiniteError, match="has become"):
        train(tmp_path, env=Huge())
    assert json.loads((tmp_path / "status.json").read_text())["state"] == "failed"
    assert train(tmp_path).resumed_from == 384


def test_a_limit_that_never_binds_is_warned_of_once_and_stored(tmp_path):
    with pytest.warns(LimitWarning, match="has not bound anything") as caught:
        result = train(tmp_path, config=SMALL | {"cost_limit": 25.0})
    assert len([w for w in caught if w.category is LimitWarning]) == 1
    assert len(result.warnings) == 1
    assert json.loads((tmp_path / "status.json").read_text())["warnings"].keys() == {"limit_never_binds"}
    assert {row["limit_can_bind"] for row in rows_of(tmp_path, "metrics.csv")} == {"0.0"}


def test_a_limit_that_binds_is_no_warning(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error", LimitWarning)
        assert train(tmp_path, config=SMALL | {"cost_limit": 0.5}).warnings == ()
    assert rows_of(tmp_path, "metrics.csv")[-1]["limit_can_bind"] == "1.0"


@pytest.mark.parametrize(("steps", "few"), [(129, False), (128, True)])
def test_a_run_of_fewer_than_five_updates_is_warned_of(tmp_path, steps, few):
    config = SMALL | {"steps_per_update": 32, "minibatch": 16}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        train(tmp_path, steps=steps, config=config)
    said = [str(warning.message) for warning in caught if warning.category is ShortRunWarning]
    message = "128 steps are 4 updates of 32 steps each, from which hardly anything is learnt; take 160 steps or more"
    assert said == ([message] if few else [])


@pytest.mark.parametrize(("steps", "random"), [(256, True), (257, False)])
def test_a_run_of_random_actions_alone_is_warned_of(steps: int, random: bool):
    config = ALGORITHMS["SACLag"].configure({"random_steps": 256, "steps_per_collection": 16})
    said = (
        "all actions of a run of 256 steps are random, since random_steps is 256: nothing is learnt from what a policy"
        " does; take more steps, or set random_steps"
    )
    assert too_short(config, steps, 4) == (said if random else "")


def test_a_limit_that_is_never_met_is_a_warning(tmp_path):
    with pytest.warns(LimitWarning) as warned:
        train(tmp_path)
    episodes = rows_of(tmp_path, "episodes.csv")
    ends = [
        i + 1 for i, row in enumerate(episodes) if row["step"] not in {later["step"] for later in episodes[i + 1 :]}
    ]
    lowest = min(np.mean([float(row["cost"]) for row in episodes[end - 50 : end]]) for end in ends if end >= 50)
    (message,) = [str(warning.message) for warning in warned]
    assert "cost limit 0.1 has never been met" in message and f"never fell below {lowest:.3g};" in message


def test_the_policy_of_a_run_is_loaded_from_its_folder_or_its_file(finished):
    algorithm, folder = finished
    policy, again = load_policy(folder), load_policy(folder / "policy.safetensors")
    assert policy.about.algorithm == algorithm
    obs, fresh = np.full((2, 3), 0.3, np.float32), np.ones(2, dtype=bool)
    actions = [each.player(2, deterministic=True)(obs, fresh) for each in (policy, again)]
    assert np.array_equal(*actions)
    seen = policy.normaliser if isinstance(policy, Policy) else policy.ensemble.observed
    assert seen.count == STEPS


@pytest.mark.parametrize("adapter", ["native", "box_literal", "box_scaled"])
def test_every_adapter_trains(tmp_path, adapter):
    result = train(tmp_path, config=SMALL | {"adapter": adapter}, steps=300)
    assert (result.policy.actions.kind, result.policy.actions.adapter) == (
        "categorical" if adapter == "native" else "gaussian",
        adapter,
    )


def test_the_policy_of_a_run_has_the_memory_it_was_trained_with(tmp_path):
    result = train(tmp_path, config=SMALL | REMEMBERING["gru"] | REMEMBERING["frames"], steps=300)
    policy = result.policy
    assert (policy.frames, policy.shape.memory, policy.obs_size) == (3, 8, 3)
    with pytest.raises(AlgorithmError, match="uses earlier observations"):
        policy.act(np.zeros((2, 3), np.float32))


def test_costs_apart_have_columns_of_their_own(tmp_path):
    train(tmp_path, config=SMALL | REMEMBERING["apart"], steps=700)
    rows = rows_of(tmp_path, "metrics.csv")
    names = {"cost_mean", "multiplier", "multiplier_reach", "limit_can_bind"}
    assert {f"{name}{which}" for name in names for which in ("_tight", "_loose")} <= set(rows[0])
    assert not names & set(rows[0])
    episodes = rows_of(tmp_path, "episodes.csv")
    at = int(rows[-2]["steps"]), int(rows[-1]["steps"])
    tight = [float(row["tight"]) for row in episodes if int(row["step"]) <= at[1]]
    fresh = sum(int(row["step"]) > at[0] for row in episodes[: len(tight)])
    assert 0 < fresh < 30 < len(tight)
    assert float(rows[-1]["cost_mean_tight"]) == pytest.approx(np.mean(tight[-30:]))


def test_a_preset_is_resolved_and_written_down_and_settings_go_on_top(tmp_path):
    with pytest.warns(LimitWarning, match="25 has not bound"):
        train(tmp_path, preset="paper", config=SMALL, steps=300)
    described = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]
    config = described["config"]
    assert described["preset"] == "paper"
    assert (config["adapter"], config["mask"], config["cost_limit"]) == ("box_literal", "batch", 25.0)
    assert (config["minibatch"], config["passes"]) == (64, 2)


def test_the_bar_shows_the_algorithm_and_the_seed(tmp_path, capsys):
    train(tmp_path, progress=True, steps=300)
    assert "FOCOPS, seed 3" in capsys.readouterr().err


def test_a_run_that_another_process_trains_is_refused(tmp_path: Path):
    with RUN_FOLDER.locked(tmp_path), pytest.raises(TrainingError, match="another command is writing to"):
        train(tmp_path)
    assert not (tmp_path / "metrics.csv").exists()
    assert train(tmp_path).already_finished is False
