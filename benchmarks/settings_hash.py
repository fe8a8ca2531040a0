"""Hash of all settings of a run, by which rows of benchmarks are told apart.

Other defaults give another hash, so that rows of earlier ones are dropped. A setting that was added later, and does
nothing by default, does not count while it has its default.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

ADDED: Mapping[str, Any] = {
    "policy": "mlp",
    "filters": [16, 32, 64, 64],
    "features": 256,
    "imitation_kl": 0.0,
    "imitation_kl_share": 0.5,
    "curvature_steps": 0,
}
"""Settings that were added after rows were committed, with the defaults with which they do nothing."""
ADDED_TO_PLANNERS: Mapping[str, Any] = {"return_bounds": []}
"""Settings that were added to planners only: rows of off-policy algorithms have counted them from the start."""
ADDED_OFF_POLICY: Mapping[str, Any] = {"cost_scale": "step"}
"""Settings that were added to off-policy algorithms after all of these, also after rows whose hash counts `ADDED`."""


def settings_hash(settings: Mapping[str, Any]) -> str:
    """Return eight digits that identify plain settings."""
    added = {**ADDED, **ADDED_TO_PLANNERS} if "planning_discount" in settings else ADDED
    counted = _without(added, without_latest(settings))
    return hashlib.sha256(json.dumps(counted, sort_keys=True).encode()).hexdigest()[:8]


def without_latest(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings without those of `ADDED_OFF_POLICY` that have their defaults."""
    return _without(ADDED_OFF_POLICY, settings)


def _without(added: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name not in added or value != added[name]}
