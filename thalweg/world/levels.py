"""What is asked of a river? The three levels as data, and the record for levels of one's own.

The paper's scenes are not public; these follow its order of difficulty and its stated features.
"""

import hashlib
from dataclasses import astuple, dataclass

from thalweg.world.errors import WorldError


@dataclass(frozen=True)
class Level:
    """Everything the generator may choose from; two levels with the same data give the same rivers."""

    name: str
    """What it is called in files and tables."""
    samples: int
    """Exact number of river samples and, the course being closed, of segments."""
    length_m: float
    """Length of the loop; a river differs from it by at most one percent."""
    bends: tuple[int, int]
    """Fewest and most bends over 30 degrees, as `geometry.bend_count` counts them."""
    width_m: tuple[float, float]
    """Narrowest and widest place; each river comes near both."""
    bridges: int
    """Number of arch bridges."""
    islands: int
    """Number of sand islands."""
    tributaries: int
    """Number of side channels that leave the course."""
    depth_m: float
    """Mean depth on the centre line."""
    depth_variation: float
    """Half the range of the depth as a share of its mean."""
    fall_m: float
    """How far the water level falls round the loop before it is regained in one rapid."""
    cut_banks: float
    """0..1, how steep the outer banks of bends are cut."""
    hills_m: float
    """Height of the hills above the flood plain, far from the river."""
    ponds: int
    """Still water inside the loop, beside the course."""
    plant_density: float
    """Plants per area relative to a dense forest."""
    default_seed: int
    """The seed of the fixed river that stands for this level."""

    @property
    def key(self) -> int:
        """A 64-bit number that depends on all the data except the default seed."""
        data = repr(astuple(self)[:-1]).encode()
        return int.from_bytes(hashlib.sha256(data).digest()[:8], "little")


LEVELS: dict[str, Level] = {
    level.name: level
    for level in (
        Level(
            name="Easy",
            samples=216,
            length_m=280.0,
            bends=(3, 3),
            width_m=(7.0, 12.0),
            bridges=1,
            islands=0,
            tributaries=0,
            depth_m=1.1,
            depth_variation=0.08,
            fall_m=0.0,
            cut_banks=0.0,
            hills_m=6.0,
            ponds=0,
            plant_density=1.0,
            default_seed=1,
        ),
        Level(
            name="Medium",
            samples=288,
            length_m=374.0,
            bends=(5, 6),
            width_m=(4.0, 16.0),
            bridges=2,
            islands=2,
            tributaries=1,
            depth_m=1.1,
            depth_variation=0.4,
            fall_m=0.0,
            cut_banks=0.6,
            hills_m=8.0,
            ponds=0,
            plant_density=1.0,
            default_seed=1,
        ),
        Level(
            name="Hard",
            samples=328,
            length_m=425.0,
            bends=(8, 12),
            width_m=(3.3, 20.0),
            bridges=4,
            islands=4,
            tributaries=2,
            depth_m=1.2,
            depth_variation=0.75,
            fall_m=3.0,
            cut_banks=1.0,
            hills_m=11.0,
            ponds=1,
            plant_density=1.0,
            default_seed=1,
        ),
    )
}


def level_named(name: str) -> Level:
    """The level of that name, whatever its case; raises `WorldError` that lists the known ones."""
    for known, level in LEVELS.items():
        if known.lower() == name.lower():
            return level
    raise WorldError(f"unknown level {name!r}; known: {', '.join(LEVELS)}")
