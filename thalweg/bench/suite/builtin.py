"""The suites that come with the package, and loading of a suite by its name or from a YAML file.

`docs/bench.md` shows such a file; its keys are the fields of `Suite`.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import CONDITIONS, Condition
from thalweg.bench.packaged import PACKAGED, PACKAGED_SEES
from thalweg.bench.suite.arms import Arm, Stage
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.bench.suite.priced import PRICED_SUITES, TRAINED_ON
from thalweg.core.config import parse_config
from thalweg.core.suggestion import did_you_mean
from thalweg.core.yaml12 import load

SUFFIXES = (".yaml", ".yml")
STUDIED = ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "DDPGLag", "TD3Lag", "SACLag", "SafeLOOP", "CCEPETS")
"""Algorithms of the paper, in its order."""
BESIDE = ("CPO", "CUP")
"""Algorithms that the study trains beside those of the paper."""
AS_PUBLISHED = ("PPO", "FOCOPS", "TD3Lag", "SafeLOOP")
"""Algorithms that the study also trains with the preset `paper`: two on-policy ones, and of the off-policy ones and of
the planners the one that takes the least time with it."""

SYMMETRIC = "PPO-symmetric"
"""PPO whose critics see what the policy sees, as those of the algorithms with a limit do."""
_SEEN_BY_THE_POLICY = {"asymmetric_critics": False}
_FINAL_LIMIT = {"cost_limit_schedule": []}
"""Settings of a stage that begins with a policy: a wider limit is for beginners, which cannot meet the final one."""


def _learns_on_policy(algorithm: str) -> bool:
    """Return whether an algorithm learns from its newest steps alone."""
    return issubclass(ALGORITHMS[algorithm].config, OnPolicyConfig)


def _steps(algorithm: str) -> int:
    """Return the steps of a run: half as many for those that learn from a replay or a model."""
    return 200_000 if _learns_on_policy(algorithm) else 100_000


def _named(*conditions: str) -> tuple[Condition, ...]:
    """Return conditions by their names."""
    return tuple(condition for condition in CONDITIONS if condition.name in conditions)


def _variants(algorithm: str, **settings: Mapping[str, Any]) -> tuple[Arm, ...]:
    """Return an arm of the algorithm with its defaults, and one for each of the settings, named after it."""
    default = Arm(algorithm, steps=_steps(algorithm))
    return default, *(replace(default, settings=each, name=f"{algorithm}-{name}") for name, each in settings.items())


_ACTIONS = {"box_scaled": {"adapter": "box_scaled"}, "box_literal": {"adapter": "box_literal"}}
_OPEN = (
    *_variants("DDPGLag", **_ACTIONS),
    *_variants(
        "FOCOPS",
        broken_mask={"mask": "batch"},
        ascent={"multiplier_gain": 0.0},
        adam={"multiplier_gain": 0.0, "multiplier_rule": "adam", "multiplier_rate": 0.035},
        pid={"multiplier_derivative": 1.0, "multiplier_smoothing": 0.5},
    ),
    *_variants("SACLag", **_ACTIONS),
    *_variants("SafeLOOP", drop_terminal={"drop_terminal": True}),
    *_variants("CCEPETS", **_ACTIONS),
)
"""Choices that the paper leaves open: the actions, the mask and the multiplier, and whether planners see what ends an
episode."""
_PROTOCOLS = (
    Arm("FOCOPS", level="Hard", name="FOCOPS-Hard"),
    Arm(
        "FOCOPS",
        settings=_FINAL_LIMIT,
        level="Hard",
        steps=80_000,
        before=(Stage("FOCOPS", "Easy", 60_000), Stage("FOCOPS", "Medium", 60_000, settings=_FINAL_LIMIT)),
        name="FOCOPS-curriculum",
    ),
    Arm(
        "FOCOPS",
        settings=_FINAL_LIMIT,
        steps=100_000,
        before=(Stage("PPO", "Medium", 100_000, settings=_SEEN_BY_THE_POLICY),),
        name="FOCOPS-after-PPO",
    ),
    Arm("FOCOPS"),
)
"""Ways of training with the same number of steps each."""

_PAPER = (
    Arm("PPO"),
    Arm("PPO", settings=_SEEN_BY_THE_POLICY, name=SYMMETRIC),
    *map(Arm, (*STUDIED[1:], *BESIDE)),
    *(Arm(name, "paper") for name in AS_PUBLISHED),
)
"""The paper's comparison, and what the study trains beside it."""
_GEOMETRY = tuple(Arm(name, seeds=(0, 1, 2) if _learns_on_policy(name) else (0,)) for name in (*STUDIED, *BESIDE))
"""The same algorithms on other codes; those that learn from a replay or a model have one seed."""
_IMITATED = tuple(
    Arm(
        name,
        settings={"policy": "cnn", "imitation_kl": 1.0, "imitation_kl_share": 0.5},
        steps=100_000,
        observation=PACKAGED_SEES,
        begin_with=PolicyFile.of(PACKAGED),
        name=f"{name}-imitated",
    )
    for name in ("PPO", "PPOLag", "CPO")
)
"""Algorithms that begin with the packaged policy, which was imitated, and stay near it for half of their run."""
_PRIVILEGED = tuple(Arm(name, steps=_steps(name)) for name in ALGORITHMS)

SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("quick", tuple(Arm(name, seeds=(0,), steps=10_240) for name in ("PPO", "FOCOPS"))),
        Suite("easy", (Arm("PPO"), Arm("FOCOPS")), train_level="Easy", test_levels=("Easy",), packaged=False),
        Suite("open", _OPEN, baselines=(), packaged=False),
        Suite("protocols", _PROTOCOLS, baselines=(), packaged=False),
        Suite("paper", _PAPER, conditions=CONDITIONS),
        Suite(
            "geometry",
            _GEOMETRY,
            baselines=(),
            packaged=False,
            conditions=_named("unseen", "all_at_once"),
            encoder="geometry",
        ),
        Suite(
            "imitated",
            _IMITATED,
            baselines=("pilot", "steady"),
            conditions=_named("deterministic", "unseen", "real", "all_at_once"),
            world_seeds=TRAINED_ON,
        ),
        Suite(
            "privileged",
            _PRIVILEGED,
            packaged=False,
            conditions=_named("unseen"),
            observation="privileged",
            world_seeds=TRAINED_ON,
        ),
        *PRICED_SUITES,
    )
}


def load_suite(name: str) -> Suite:
    """Return the suite with a name, or that of a YAML file; raises `ResultsError` that says what is wrong."""
    if not name.endswith(SUFFIXES):
        return suite_named(name)
    path = Path(name)
    try:
        data = load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultsError(f"{path} can't be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split()).replace('in "<unicode string>", ', "at ")
        raise ResultsError(f"{path} is not YAML: {reason}") from error
    if data is None:
        raise ResultsError(f"{path} is empty: a suite is a mapping with arms")
    if not isinstance(data, Mapping):
        raise ResultsError(f"{path} holds no suite: a mapping with arms is needed, got {type(data).__name__}")
    return parse_config(Suite, {"name": path.stem, **data}, str(path))


def suite_named(name: str) -> Suite:
    """Return the suite with a name; raises `ResultsError` that lists the known ones."""
    if name.lower() not in SUITES:
        raise ResultsError(
            f"unknown suite {name!r}{did_you_mean(name, SUITES)}; known: {', '.join(SUITES)}, or a YAML file such as"
            " my.yaml"
        )
    return SUITES[name.lower()]
