"""Defaults of `thalweg encoder train`, which differ by target: read from what trains each, when help is shown."""

from dataclasses import fields
from inspect import signature
from typing import Any

from tyro.conf import arg

PLURALS = {"level": "levels"}
"""Names of options that trainings on several levels have in the plural."""


def by_target(option: str) -> Any:
    """Return the annotation of an option whose help ends with its default for each target that has one."""
    return arg(help_behavior_hint=lambda _: f"(default: {default_words(option)})")


def default_words(option: str) -> str:
    """Return the default of an option for each target that has one, such as `16 for image, 32 for geometry`.

    Without PyTorch, which the trainings import, it only says that there are such defaults.
    """
    try:
        found = default_values(option)
    except ModuleNotFoundError:
        return "that of the target"
    return ", ".join(f"{_shown(value)} for {target}" for target, value in found.items())


def default_values(option: str) -> dict[str, Any]:
    """Return the default of an option by target, for those that have one.

    Raises `ModuleNotFoundError` without PyTorch.
    """
    from thalweg.encoder import VAEConfig
    from thalweg.encoder.geometry import GeometryConfig
    from thalweg.train.encoder.drawing import Drawing
    from thalweg.train.encoder.geometry import GeometryTraining
    from thalweg.train.encoder.training import collect_and_train
    from thalweg.train.encoder.water import WaterTraining

    image = {name: each.default for name, each in signature(collect_and_train).parameters.items()}
    image |= _defaults(Drawing)
    homes = {
        "image": image | _defaults(VAEConfig),
        "geometry": _defaults(GeometryTraining) | _defaults(GeometryConfig),
        "water": _defaults(WaterTraining),
    }
    found = {target: of.get(option, of.get(PLURALS.get(option, ""))) for target, of in homes.items()}
    return {target: value for target, value in found.items() if value not in (None, ())}


def _defaults(kind: Any) -> dict[str, Any]:
    return {field.name: field.default for field in fields(kind)}


def _shown(value: Any) -> str:
    """Return a default as it is typed: consecutive seeds as a range."""
    if not isinstance(value, tuple):
        return str(value)
    first, *rest = value
    if rest and isinstance(first, int) and value == tuple(range(first, first + len(value))):
        return f"{first}:{value[-1] + 1}"
    return " ".join(map(str, value))
