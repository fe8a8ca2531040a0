"""The table of domains and methods, made of the registry."""

from pathlib import Path

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.report.algorithm_table import domain, keeps_by, methods
from thalweg.bench.results.results import Results
from thalweg.bench.suite.suites import Arm, Suite

ON_POLICY = ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "CPO", "CUP")


def test_every_algorithm_is_of_its_papers_domain():
    expected = dict.fromkeys(ON_POLICY, "on-policy") | dict.fromkeys(("DDPGLag", "TD3Lag", "SACLag"), "off-policy")
    expected |= dict.fromkeys(("CCEPETS", "SafeLOOP"), "model-based")
    assert {name: domain(entry) for name, entry in ALGORITHMS.items()} == expected


def test_how_a_limit_is_kept_is_told_by_the_settings():
    found = {name: keeps_by(entry) for name, entry in ALGORITHMS.items()}
    assert found["PPO"] == "not at all"
    assert {name for name, by in found.items() if by == "a multiplier"} == {
        "PPOLag", "FOCOPS", "CUP", "DDPGLag", "TD3Lag", "SACLag",
    }  # fmt: skip


def test_each_arm_has_a_row_and_an_algorithm_that_is_gone_says_so():
    suite = Suite("it", (Arm("FOCOPS", "paper"), Arm("Gone")), packaged=False)
    _, rows = methods(Results(Path(), suite.as_data(), [], [], [], [])).grid
    assert rows == [
        ["FOCOPS-paper", "on-policy", "a multiplier", ALGORITHMS["FOCOPS"].about],
        ["Gone", "unknown", "unknown", "unknown"],
    ]
