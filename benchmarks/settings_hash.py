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
    "cost_unit": "step",
}
"""Settings that were added after rows were committed, with the defaults with which they do nothing."""
ADDED_TO_PLANNERS: Mapping[str, Any] = {"return_bounds": []}
"""Settings that were added to planners only: rows of off-policy algorithms have counted them from the start."""


def settings_hash(settings: Mapping[str, Any]) -> str:
    """Return eight digits that identify plain settings."""
    added = {**ADDED, **ADDED_TO_PLANNERS} if "planning_discount" in settings else ADDED
    counted = {name: value for name, value in settings.items() if name not in added or value != added[name]}
    return hashlib.sha256(json.dumps(counted, sort_keys=True).encode()).hexdigest()[:8]
