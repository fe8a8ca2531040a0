"""Observations by name: the parts that they are made of, and how users write them.

What each part holds is in `thalweg.env.spaces`; how it is made, in `thalweg.env.observer`.
"""

from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator

from thalweg.core.suggestion import did_you_mean

Part = Literal["rgb", "mask", "depth", "class", "proprioception", "privileged"]
"""A key of an observation that is a dictionary."""
Preset = Literal["rgb+mask", "rgb", "mask", "dict", "privileged", "none"]
"""An observation that one word names. `dict` is a dictionary, all others are one array."""
PARTS: tuple[Part, ...] = get_args(Part)
PRESETS: tuple[Preset, ...] = get_args(Preset)
DRAWN: tuple[Part, ...] = ("rgb", "mask", "depth", "class")
"""Parts that are drawn."""
BESIDE_FRAMES: tuple[Part, ...] = ("depth", "class")
"""Drawn parts that no frame has, see `thalweg.render.Renderer.render_layers`."""
PARTS_OF_PRESETS: dict[str, tuple[Part, ...]] = {
    "rgb+mask": ("rgb", "mask"),
    "rgb": ("rgb",),
    "mask": ("mask",),
    "dict": ("rgb", "mask"),
    "privileged": ("privileged",),
    "none": (),
}
ALLOWED = (
    f"must be one of {', '.join(map(repr, PRESETS))}, or a combination of {', '.join(map(repr, PARTS))} such as"
    " 'rgb,depth'"
)
"""What an observation may be, for messages."""


def read_observation(given: Any) -> Any:
    """Return an observation as a config holds it: a word of `PRESETS`, or a tuple of `PARTS` in their order.

    `given` may also be a list of parts, or a text of them such as "rgb,depth". Raises `ValueError` for anything else.
    """
    if isinstance(given, str) and given in PRESETS:
        return given
    parts = [part.strip() for part in given.split(",")] if isinstance(given, str) else given
    if not isinstance(parts, list | tuple) or not parts or not all(isinstance(part, str) for part in parts):
        raise ValueError(f"{ALLOWED}, got {given!r}")
    for part in parts:
        if part not in PARTS:
            known = (*PRESETS, *PARTS) if len(parts) == 1 else PARTS
            raise ValueError(f"{ALLOWED}, got {part!r}{did_you_mean(part, known)}")
        if parts.count(part) > 1:
            raise ValueError(f"each part must be named once, got {part!r} {parts.count(part)} times")
    return tuple(part for part in PARTS if part in parts)


Observation = Annotated[Preset | tuple[Part, ...], BeforeValidator(read_observation)]
"""An observation in a config; `read_observation` says what may be given."""


def parts_of(observation: str | tuple[str, ...]) -> tuple[str, ...]:
    """Return the parts of an observation as a config holds it; empty for `none`, the pose alone."""
    return PARTS_OF_PRESETS[observation] if isinstance(observation, str) else observation
