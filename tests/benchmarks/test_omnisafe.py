"""Tests of the comparison with OmniSafe: the requests to both sides, the arithmetic and the page."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.omnisafe import compare, plot, write
from benchmarks.omnisafe.compare import HALF, OURS, PEER
from benchmarks.omnisafe.contests import (
    ACTION_REPEAT,
    CONTESTS,
    LIMIT,
    MENDED,
    RESETS,
    Contest,
    Work,
    contest_named,
    merged,
)
from thalweg.algos.registry import ALGORITHMS
from thalweg.core import versions

CURVES = f"""algorithm,side,version,seed,step,return,cost,episodes
PPO,OmniSafe,,0,50,1.0,0.5,4
PPO,OmniSafe,,0,90,2.0,0.0,1
PPO,OmniSafe,,0,100,4.0,0.2,3
PPO,OmniSafe,,1,50,3.0,0.1,4
PPO,OmniSafe,,1,100,8.0,0.6,1
PPO,Thalweg,{versions.ALGORITHMS["PPO"]},0,100,5.0,0.1,2
"""


@pytest.fixture
def curves(tmp_path: Path) -> Path:
    file = tmp_path / "curves.csv"
    file.write_text(CURVES)
    return file


def speeds() -> dict:
    """Figures as `compare.py` writes them."""
    rates = {"PPO": ([100.0, 200.0, 100.0], [900.0, 1000.0, 1200.0]), "SafeLOOP": ([4.0, 4.0, 5.0], [12.0, 16.0, 15.0])}
    lines = [
        {"algorithm": name, "side": side, "unit": contest_named(name).unit, "rates": each, "threads": 1, "steps": 20000}
        | {"by_processor": [rate * (2 if side == OURS else 1) for rate in each] if name == "PPO" else []}
        | {"gradient_steps": {"actor_optimizer": 12520}, "environment_s": 1.0}
        | ({"version": versions.ALGORITHMS[name]} if side == OURS else {})
        for name, both in rates.items()
        for side, each in zip(compare.SIDES, both, strict=True)
    ]
    return {
        "machine": {"cpu": "Abacus", "cores": 2, "memory_gib": 1, "system": "Linux"},
        "versions": {"python": "3.11"},
        "load_before": 0.1,
        "peer": {"python": "3.11", "omnisafe": "0.5.0"},
        "lines": lines,
    }


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """`write.py` with figures and a page in a folder of the test."""
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- omnisafe -->\nold\n<!-- /omnisafe -->\nafter\n")
    for name, file in (("PAGE", page), ("SPEED", tmp_path / "speed.json"), ("CURVES", tmp_path / "curves.csv")):
        monkeypatch.setattr(write, name, file)
    return page


def test_every_algorithm_of_the_paper_has_a_row():
    names = ["PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "DDPGLag", "TD3Lag", "SACLag", "SafeLOOP", "CCEPETS"]
    assert [contest.algorithm for contest in CONTESTS] == names


def ours(contest: Contest, kind: str) -> tuple[Work, Any]:
    """A run, and the config of Thalweg's side."""
    work = getattr(contest.works, kind)
    return work, ALGORITHMS[contest.algorithm].configure(json.loads(json.dumps(work.ours)), "paper")


@pytest.mark.parametrize("contest", CONTESTS, ids=lambda c: c.algorithm)
@pytest.mark.parametrize("kind", ["speed", "curves"])
def test_our_settings_are_valid_for_the_algorithm_and_the_toy(contest: Contest, kind: str):
    work, config = ours(contest, kind)
    assert config.adapter == "native" and work.peer["train_cfgs"]["total_steps"] == work.steps
    if hasattr(config, "cost_limit"):
        # A planner gets OmniSafe's episode length, 1,000 decisions, and the limit of such an episode.
        episodes = config.episode_length / 100 if contest.unit == "decisions" else 1
        assert config.cost_limit == pytest.approx(LIMIT * episodes)


@pytest.mark.parametrize("contest", CONTESTS, ids=lambda c: c.algorithm)
def test_corrections_differ_from_the_preset_and_are_described(contest: Contest):
    mended, paper = MENDED[contest.algorithm], ALGORITHMS[contest.algorithm].configure({}, "paper")
    assert all(getattr(paper, key) != value for key, value in mended.items())
    assert contest.differs.startswith(RESETS) or mended
    assert all(mended.items() <= dict(work.ours).items() for work in contest.works)


@pytest.mark.parametrize(
    "contest", [contest_named(name) for name in ("PPO", "PPOLag", "FOCOPS")], ids=lambda c: c.algorithm
)
@pytest.mark.parametrize("kind", ["speed", "curves"])
def test_our_settings_are_the_same_as_the_peers(contest: Contest, kind: str):
    work, config = ours(contest, kind)
    theirs = work.peer["algo_cfgs"]
    assert config.steps_per_update == theirs["steps_per_epoch"]
    assert config.learning_rate == work.peer["model_cfgs"]["actor"]["lr"]
    assert config.critic_learning_rate == work.peer["model_cfgs"]["critic"]["lr"]
    assert (config.passes, config.minibatch) == (theirs["update_iters"], theirs["batch_size"])
    assert (config.target_kl == float("inf")) == (not theirs["kl_early_stop"])
    if contest.algorithm == "FOCOPS":
        lagrange = {"lambda_lr": 0.035, "lagrangian_upper_bound": 2.0, **work.peer["lagrange_cfgs"]}
        assert config.cost_limit == lagrange["cost_limit"]
        assert (config.multiplier_rate, config.multiplier_max) == (
            lagrange["lambda_lr"],
            lagrange["lagrangian_upper_bound"],
        )


def test_merging_is_deep_and_leaves_its_arguments_unchanged():
    first, second = {"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"c": 4, "e": {"f": 5}}}
    assert merged(first, second) == {"a": {"b": 1, "c": 4, "e": {"f": 5}}, "d": 3}
    assert first == {"a": {"b": 1, "c": 2}, "d": 3}
    merged(first, second)["a"]["e"]["f"] = 6
    assert second["a"]["e"]["f"] == 5


def test_requests_have_the_seed_and_the_threads_of_their_side():
    contest = contest_named("SafeLOOP")
    theirs = compare.request_for(contest, contest.works.speed, PEER, 7)
    assert theirs["settings"]["seed"] == 7 and theirs["settings"]["train_cfgs"]["torch_threads"] == 2
    assert theirs["settings"]["train_cfgs"]["total_steps"] == contest.works.speed.steps
    assert "seed" not in contest.works.speed.peer
    ours = compare.request_for(contest, contest.works.speed, OURS, 7)
    assert (ours["seed"], ours["threads"], ours["steps"]) == (7, 2, contest.works.speed.steps)


def test_the_rate_of_steps_excludes_random_ones():
    contest = contest_named("SACLag")
    work = contest.works.speed
    after = [(0, 3.0, 2.0), (500, 8.0, 3.0), (1000, 23.0, 7.0)]
    stamps = [[0, 0.0, 0.0], *([work.start + steps, *clocks] for steps, *clocks in after)]
    assert compare.rates(contest, work, {"stamps": stamps}) == (1000 / 20.0, 1000 / 5.0)


def test_the_rate_of_decisions_counts_their_own_time_only():
    contest = contest_named("SafeLOOP")
    work = contest.works.speed
    assert compare.rates(contest, work, {"decisions": [0.5, 0.25, 0.25]}) == (3.0, None)
    # 200 steps are 40 decisions; the acting until the end of the steps at random is left out.
    acting = [[work.start, 7.0], [work.start + 100, 6.0], [work.start + 200, 10.0]]
    assert compare.rates(contest, work, {"acting": acting})[0] == pytest.approx(2.5)


def test_an_episode_counts_in_the_interval_in_which_it_ends():
    episodes = [[1, 1.0, 0.0, 1], [50, 3.0, 1.0, 49], [51, 5.0, 0.0, 1], [100, 7.0, 0.0, 49]]
    assert compare.binned(episodes, 100, bins=2) == [(50, 2.0, 0.5, 2), (100, 6.0, 0.0, 2)]
    assert [row[0] for row in compare.binned(episodes, 100, bins=4)] == [25, 50, 75, 100]
    assert [row[0] for row in compare.binned(episodes, 200, bins=4)] == [50, 100]


def test_every_second_turn_is_reversed():
    first = compare.in_turns(CONTESTS[:2], 0, compare.sides_of)
    assert [(contest.algorithm, side) for contest, side in first] == [
        *(("PPO", PEER), ("PPO", OURS)),
        *(("PPOLag", PEER), ("PPOLag", OURS)),
    ]
    assert compare.in_turns(CONTESTS[:2], 1, compare.sides_of) == first[::-1]


def test_planners_are_also_measured_in_bfloat16():
    contest = contest_named("CCEPETS")
    assert compare.sides_of(contest) == (PEER, OURS, HALF) and compare.sides_of(contest_named("PPO")) == (PEER, OURS)
    full, half = (compare.request_for(contest, contest.works.speed, side, 0) for side in (OURS, HALF))
    assert half == full | {"config": full["config"] | {"precision": "bfloat16"}}
    assert ALGORITHMS["CCEPETS"].configure(full["config"], "paper").precision == "float32"


@pytest.mark.parametrize("name", ["SafeLOOP", "CCEPETS"])
def test_both_planners_have_the_same_limit_for_an_episode(name: str):
    work = contest_named(name).works.speed
    # OmniSafe's limit is one of 1,000 decisions, the toy's episodes have 100 steps.
    limit, decisions = work.peer["algo_cfgs"]["cost_limit"], 100 / ACTION_REPEAT
    assert limit / 1000 * decisions == pytest.approx(LIMIT)
    assert (work.ours["cost_limit"], work.ours["episode_length"]) == (limit, 1000 * ACTION_REPEAT)


def test_measuring_some_algorithms_keeps_the_lines_of_the_others(tmp_path: Path):
    here, file = {"machine": "one", "versions": "two"}, tmp_path / "speed.json"
    assert compare.lines_of_others(file, CONTESTS[:1], here) == []
    lines = [{"algorithm": "PPO"}, {"algorithm": "FOCOPS"}]
    file.write_text(json.dumps(here | {"lines": lines}))
    assert compare.lines_of_others(file, CONTESTS[:1], here) == lines[1:]
    assert compare.lines_of_others(file, CONTESTS[:1], here | {"versions": "three"}) == []


def test_a_run_is_carried_out_only_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "RUNS", tmp_path)
    orders = []
    monkeypatch.setattr(compare, "run_side", lambda *given: orders.append(given) or {"episodes": [len(orders)]})
    contest = contest_named("PPO")
    found = [compare.cached_answer(Path("python"), contest, PEER, seed) for seed in (0, 1, 0)]
    assert [answer["episodes"] for answer in found] == [[1], [2], [1]]
    monkeypatch.setattr(compare, "TOY", compare.TOY + 1)
    assert compare.cached_answer(Path("python"), contest, PEER, 0)["episodes"] == [3]


def test_our_run_is_repeated_for_another_version_of_its_algorithm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "RUNS", tmp_path)
    orders = []
    monkeypatch.setattr(compare, "run_side", lambda *given: orders.append(given) or {"episodes": [len(orders)]})

    def runs() -> list[int]:
        sides = ((OURS, "PPO"), (OURS, "FOCOPS"), (PEER, "PPO"))
        found = [compare.cached_answer(Path("python"), contest_named(name), side, 0) for side, name in sides]
        return [answer["episodes"][0] for answer in found]

    assert runs() == runs() == [1, 2, 3]
    monkeypatch.setitem(compare.ALGORITHMS, "PPO", compare.ALGORITHMS["PPO"] + 1)
    assert runs() == [4, 2, 3]


def test_the_error_of_a_failed_side_has_its_last_output(tmp_path: Path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho no such thing >&2\nexit 3\n")
    python.chmod(0o755)
    with pytest.raises(RuntimeError, match="OmniSafe's PPO failed:\nno such thing"):
        compare.run_side(python, PEER, {"algorithm": "PPO"})


def test_a_row_of_speed_has_medians_and_the_ratios_of_each_repetition():
    assert write.speed_rows(speeds()) == [
        ["steps", "PPO", str(versions.ALGORITHMS["PPO"]), "100", "1,000", "9.00", "5.00", "12.0", "18.0", ""],
        [
            "decisions",
            "SafeLOOP",
            str(versions.ALGORITHMS["SafeLOOP"]),
            "4.00",
            "15.0",
            "3.00",
            "3.00",
            "4.00",
            "",
            "3",
        ],
    ]


def test_a_row_of_another_version_names_todays(curves: Path):
    found = speeds()
    found["lines"][1]["version"] = 2
    today = versions.ALGORITHMS["PPO"]
    assert write.speed_rows(found)[0][2] == f"2 (today {today})"
    curves.write_text(CURVES.replace(f"Thalweg,{today},", "Thalweg,2,"))
    assert write.final_rows(plot.read(curves), plot.read_versions(curves))[0][1] == f"2 (today {today})"


def test_new_rows_have_the_version_of_our_algorithm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "CURVES", tmp_path / "curves.csv")
    monkeypatch.setattr(compare, "FIGURE", tmp_path / "curves.png")
    monkeypatch.setattr(compare, "cached_answer", lambda *_: {"episodes": [[1, 2.0, 0.0, 1]]})
    compare.draw_curves(Path("python"), [contest_named("PPO")], seeds=1)
    found = [row.split(",")[1:3] for row in compare.CURVES.read_text().splitlines()[1:]]
    assert found == [[PEER, ""], [OURS, str(versions.ALGORITHMS["PPO"])]]


def test_algorithms_that_were_measured_less_often_are_named():
    found = speeds()
    assert write.repetitions(found) == "3 repetitions"
    for line in found["lines"][2:]:
        line["rates"] = line["rates"][:1]
    assert write.repetitions(found) == "3 repetitions (SafeLOOP 1)"


def test_final_means_are_over_the_last_episodes_of_all_seeds(curves: Path):
    read = plot.read(curves)
    # (2 x 1 + 4 x 3 + 8 x 1) / 5 and (0 + 0.2 x 3 + 0.6) / 5: what ended after step 80.
    assert write.final_means(read, "PPO", PEER) == (pytest.approx(4.4), pytest.approx(0.24))
    row = write.final_rows(read, plot.read_versions(curves))[0]
    assert row == [
        "PPO",
        str(versions.ALGORITHMS["PPO"]),
        "1",
        "4.40",
        "5.00",
        "0.240",
        "0.100",
        contest_named("PPO").differs,
    ]


def test_a_band_has_the_steps_that_all_seeds_have(curves: Path):
    found = plot.band(plot.read(curves)["PPO", PEER], "return")
    assert found.tolist() == [[50, 100], [2, 6], [1, 4], [3, 8]]


def test_the_figure_is_drawn(curves: Path, tmp_path: Path):
    plot.draw(curves, tmp_path / "curves.png")
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_the_section_is_written_between_its_comments_and_writing_again_changes_nothing(page: Path, curves: Path):
    (page.parent / "speed.json").write_text(json.dumps(speeds()))
    assert write.main([]) == 0
    first = page.read_text()
    assert first.startswith("before\n<!-- omnisafe -->\n") and first.endswith("<!-- /omnisafe -->\nafter\n")
    assert (
        f"| steps | PPO | {versions.ALGORITHMS['PPO']} | 100 | 1,000 | 9.00 | 5.00 | 12.0 | 18.0 |  |" in first
        and f"| PPO | {versions.ALGORITHMS['PPO']} | 1 | 4.40 | 5.00 |" in first
    )
    assert "| PPO | 20,000 | 12,520 actor | 20,000 |" in first
    assert write.main(["--check"]) == 0
    assert write.main([]) == 0 and page.read_text() == first


def test_the_check_fails_for_an_outdated_page_and_leaves_it_unchanged(page: Path, curves: Path, capsys):
    old = page.read_text()
    assert write.main(["--check"]) == 1
    assert capsys.readouterr().err.endswith("writes it: README.md\n")
    assert page.read_text() == old


def test_a_page_without_figures_says_so(page: Path):
    assert write.main([]) == 0
    assert "<!-- omnisafe -->\nNot measured yet.\n<!-- /omnisafe -->" in page.read_text()


def test_the_committed_page_is_up_to_date():
    assert write.main(["--check"]) == 0
