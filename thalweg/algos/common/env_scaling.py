"""How do settings follow the number of environments?

The defaults are for `USUAL_ENVS` at most. Of f times as many, each still takes as many steps between two updates as 64
do, and a gradient step learns from f times as many of them: a round has as many gradient steps as before, each of which
keeps a GPU busier instead of asking it more often.
"""

import dataclasses
import math
from typing import Any

USUAL_ENVS = 64
"""Environments up to which the defaults stay as they are."""
GROWING = ("steps_per_update", "steps_per_collection", "random_steps", "refit_steps", "minibatch")
"""Settings that are multiplied by f."""
SHRINKING = ("updates_per_step",)
"""Settings that are divided by f."""


def following(config: type, num_envs: int) -> dict[str, Any]:
    """The settings of a config that differ from its defaults with so many environments; none up to `USUAL_ENVS`."""
    factor = num_envs / USUAL_ENVS
    fields = dataclasses.fields(config) if factor > 1 else ()
    defaults: dict[str, Any] = {field.name: field.default for field in fields}
    grown = {name: math.ceil(defaults[name] * factor) for name in GROWING if name in defaults}
    return grown | {name: defaults[name] / factor for name in SHRINKING if name in defaults}
