"""The benchmark of the shield: its pairs of flights, what it counts as false, and its table."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.env.handmade import canal
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
    for name in ("any_river", "shield"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("shield")


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


def test_the_table_has_shares_of_vetoes(script: ModuleType):
    watch = script.Watch(steps=200)
    watch.vetoes.update({"land": 6, "dead end": 4})
    watch.false.update({"dead end": 3})
    good, idle = episode(10.0, 0.0, "Success"), episode(10.0, 0.2, "Idle")
    pair = script.Pair("random", "fixed", "Hard", 2)
    row = dict(zip(script.KEY, pair.key, strict=True)) | script.row_of(
        {"without": [good, good], "with": [good, idle]}, watch
    )
    table = script.page_tables([row])
    assert "| random | fixed, Hard | 2 | 10.00 → 10.00 | 0% → 50% | 0.00 → 0.10 | 0 | 1 | 5.0% | 30% |" in table
    assert "| random | fixed, Hard | 0 → 0 | 0 → 0 | 0 → 0 | 0 → 0 | 0 → 1 | 0 → 0 | 2 → 1 |" in table
    assert "random" not in script.page_tables([row | {"shield": "0"}])


def test_noise_is_a_share_of_the_moves(script: ModuleType):
    generator = script.torch.Generator().manual_seed(0)
    pilot = np.full((4000, 4), 7)
    moves = script.Noisy(0.2).act(pilot, deterministic=True, generator=generator)
    assert 0.18 < np.mean(moves[:, 0] != 7) < 0.22
