"""Records of versions for results that are written by hand."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.packaged import PACKAGED
from thalweg.bench.results.run_versions import current_versions, some_critics_are_asymmetric, write_versions
from thalweg.core.versions import ALGORITHMS


def record_current_versions(
    folder: Path,
    arms: Mapping[str, str] | None = None,
    seeds: int = 4,
    *,
    observation: str = "frames",
    **rules: Any,
) -> None:
    """Let the results of all policies have the current versions; `arms` are algorithms by the names of their
    arms, each with so many `seeds`, that see an `observation`; `rules` are those of `current_versions`."""
    made = {f"{name}-0": current_versions("baseline", [name], **rules) for name in BASELINES}
    made[f"{PACKAGED}-0"] = current_versions("packaged", (), **rules)
    for name, algorithm in ({name: name for name in ALGORITHMS} | dict(arms or {})).items():
        told = some_critics_are_asymmetric([(algorithm, {}, "default")])
        own = current_versions("train", [algorithm], observation=observation, asymmetric_critics=told, **rules)
        made |= {f"{name}-{seed}": own for seed in range(seeds)}
    write_versions(folder, made)
