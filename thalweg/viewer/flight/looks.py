"""Looks that can be flown in by name, as ranges of domain randomisation with equal ends."""

from typing import Any

from thalweg.render.records.randomisation import Randomisation

USUAL, VARIED = "as trained", "random"


def _fixed(**values: float) -> Randomisation:
    """Return ranges that hold nothing but these values."""
    ranges: dict[str, Any] = {name: (value, value) for name, value in values.items()}
    return Randomisation.only(**ranges)


LOOKS: dict[str, Randomisation | None] = {
    USUAL: None,
    "autumn": _fixed(season=1.0, warmth=0.35, haze=1.5),
    "mist": _fixed(haze=12.0, warmth=-0.2, exposure_ev=-0.2),
    "overcast": _fixed(clouds=1.0, exposure_ev=-0.5, warmth=-0.25),
    "brown water": _fixed(water_tint=0.8, turbidity=3.0, ripple=1.6),
    "still water": _fixed(ripple=0.1, water_tint=-0.5, turbidity=0.5),
    "poor camera": _fixed(noise=8.0, exposure_ev=0.6, warmth=-0.5),
    VARIED: Randomisation(),
}
"""Randomisation of each look by its name. None: the appearance that the levels are tuned for; `random`: another one in
each flight, the sun included."""
