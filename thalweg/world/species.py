"""The kinds of plants and rocks as data: one entry per drawable model, a species in one of its variants.

The world places kinds and bakes their shadows from the outline given here; the renderer grows and paints them. How a
plant is grown into leaves and branches is in `thalweg.render.bake.trees`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

Colour = tuple[float, float, float]
Profile = tuple[tuple[float, float], ...]

GROUPS = ("tree", "shrub", "reed", "rock")


@dataclass(frozen=True)
class Kind:
    """A model of a plant or a rock. Shares are relative to its height, so that one model serves all sizes."""

    name: str
    """Species and variant, such as `pine-2`."""
    species: str
    """The name without the variant."""
    group: str
    """One of `GROUPS`."""
    form: str
    """Growth form: `pine`, `cone`, `round`, `slender`, `bush`, `blades` or `stone`."""
    height_m: tuple[float, float]
    """Minimum and maximum height."""
    aspect: float
    """Full width of the crown over the height."""
    clear_trunk: float
    """Share of the height below the crown, where there is only the trunk."""
    profile: Profile
    """Outline of the crown: pairs of (share of the crown's own height, share of the half width), from its foot up."""
    density_per_m: float
    """Extinction of light in the crown: the transmitted share is exp(-density * path in metres)."""
    leaf_reflectance: Colour
    """Linear reflectance of a leaf (or of the stone) in red, green, blue."""
    leaf_transmittance: Colour
    """Linear transmittance of a leaf; greener and yellower than its reflectance."""
    bark_reflectance: Colour
    """Linear reflectance of trunk and branches (of the lichen, for a stone)."""
    trunk_radius: float
    """Radius of the trunk at the foot, as a share of the height."""
    clumps: int
    """Leaf clumps of a crown; blades of a reed; facets of a stone."""
    clump_radius: float
    """Radius of a clump as a share of the half width of the crown."""
    leaf_size: float
    """Radius of one drawn leaf or needle tuft as a share of the height."""
    seed: int
    """Seed of the growth."""

    def crown_radius(self, share_of_height: ArrayLike) -> np.ndarray:
        """Return the crown's radius [...] at a share of the height [...] (0 foot, 1 top), relative to the half width.

        It is 0 below the crown and above the top.
        """
        share = np.asarray(share_of_height, dtype=np.float64)
        along, radius = np.array(self.profile).T
        inside = (share - self.clear_trunk) / (1.0 - self.clear_trunk)
        return np.interp(inside, along, radius, left=0.0, right=0.0)


PINE_CROWN: Profile = ((0.0, 0.30), (0.12, 0.62), (0.35, 0.92), (0.55, 1.0), (0.75, 0.86), (0.9, 0.56), (1.0, 0.12))
FIR_CROWN: Profile = ((0.0, 0.72), (0.08, 1.0), (0.3, 0.78), (0.6, 0.43), (0.85, 0.17), (1.0, 0.02))
OAK_CROWN: Profile = ((0.0, 0.35), (0.12, 0.75), (0.3, 0.96), (0.5, 1.0), (0.7, 0.90), (0.87, 0.62), (1.0, 0.18))
BIRCH_CROWN: Profile = ((0.0, 0.40), (0.15, 0.85), (0.35, 1.0), (0.6, 0.82), (0.82, 0.50), (1.0, 0.10))
BUSH_CROWN: Profile = ((0.0, 0.78), (0.2, 0.97), (0.45, 1.0), (0.7, 0.82), (0.88, 0.52), (1.0, 0.15))
REED_CROWN: Profile = ((0.0, 0.85), (0.3, 0.95), (0.5, 1.0), (0.7, 0.78), (0.9, 0.28), (1.0, 0.1))
STONE_CROWN: Profile = ((0.0, 0.95), (0.2, 1.0), (0.5, 0.87), (0.75, 0.65), (0.9, 0.42), (1.0, 0.15))

PINE = Kind(
    name="pine-1",
    species="pine",
    group="tree",
    form="pine",
    height_m=(8.5, 12.0),
    aspect=0.44,
    clear_trunk=0.36,
    profile=PINE_CROWN,
    density_per_m=0.43,
    leaf_reflectance=(0.063, 0.071, 0.018),
    leaf_transmittance=(0.025, 0.032, 0.004),
    bark_reflectance=(0.150, 0.092, 0.060),
    trunk_radius=0.014,
    clumps=60,
    clump_radius=0.23,
    leaf_size=0.0085,
    seed=101,
)
FIR = Kind(
    name="fir-1",
    species="fir",
    group="tree",
    form="cone",
    height_m=(7.5, 11.5),
    aspect=0.48,
    clear_trunk=0.07,
    profile=FIR_CROWN,
    density_per_m=0.70,
    leaf_reflectance=(0.043, 0.055, 0.020),
    leaf_transmittance=(0.016, 0.021, 0.003),
    bark_reflectance=(0.085, 0.068, 0.052),
    trunk_radius=0.012,
    clumps=70,
    clump_radius=0.20,
    leaf_size=0.0070,
    seed=201,
)
OAK = Kind(
    name="oak-1",
    species="oak",
    group="tree",
    form="round",
    height_m=(7.0, 10.0),
    aspect=0.74,
    clear_trunk=0.14,
    profile=OAK_CROWN,
    density_per_m=0.37,
    leaf_reflectance=(0.079, 0.089, 0.018),
    leaf_transmittance=(0.052, 0.066, 0.006),
    bark_reflectance=(0.090, 0.074, 0.055),
    trunk_radius=0.021,
    clumps=84,
    clump_radius=0.18,
    leaf_size=0.0095,
    seed=301,
)
BIRCH = Kind(
    name="birch-1",
    species="birch",
    group="tree",
    form="slender",
    height_m=(7.5, 10.5),
    aspect=0.42,
    clear_trunk=0.18,
    profile=BIRCH_CROWN,
    density_per_m=0.63,
    leaf_reflectance=(0.095, 0.104, 0.022),
    leaf_transmittance=(0.064, 0.081, 0.007),
    bark_reflectance=(0.300, 0.280, 0.240),
    trunk_radius=0.010,
    clumps=62,
    clump_radius=0.22,
    leaf_size=0.0080,
    seed=401,
)
BUSH = Kind(
    name="bush-1",
    species="bush",
    group="shrub",
    form="bush",
    height_m=(0.9, 2.4),
    aspect=1.15,
    clear_trunk=0.0,
    profile=BUSH_CROWN,
    density_per_m=1.05,
    leaf_reflectance=(0.083, 0.092, 0.020),
    leaf_transmittance=(0.050, 0.063, 0.007),
    bark_reflectance=(0.100, 0.080, 0.060),
    trunk_radius=0.020,
    clumps=34,
    clump_radius=0.26,
    leaf_size=0.022,
    seed=501,
)
REED = Kind(
    name="reed-1",
    species="reed",
    group="reed",
    form="blades",
    height_m=(0.8, 1.8),
    aspect=0.70,
    clear_trunk=0.0,
    profile=REED_CROWN,
    density_per_m=1.75,
    leaf_reflectance=(0.160, 0.160, 0.040),
    leaf_transmittance=(0.056, 0.068, 0.018),
    bark_reflectance=(0.190, 0.150, 0.085),
    trunk_radius=0.010,
    clumps=110,
    clump_radius=0.10,
    leaf_size=0.011,
    seed=601,
)
STONE = Kind(
    name="rock-1",
    species="rock",
    group="rock",
    form="stone",
    height_m=(0.3, 1.1),
    aspect=1.8,
    clear_trunk=0.0,
    profile=STONE_CROWN,
    density_per_m=50.0,
    leaf_reflectance=(0.240, 0.220, 0.190),
    leaf_transmittance=(0.0, 0.0, 0.0),
    bark_reflectance=(0.200, 0.205, 0.120),
    trunk_radius=0.0,
    clumps=16,
    clump_radius=0.5,
    leaf_size=0.02,
    seed=701,
)

KINDS: tuple[Kind, ...] = (
    PINE,
    replace(
        PINE, name="pine-2", aspect=0.38, clear_trunk=0.48, clumps=48, leaf_reflectance=(0.055, 0.065, 0.020), seed=102
    ),
    replace(
        PINE, name="pine-3", aspect=0.50, clear_trunk=0.28, clumps=70, leaf_reflectance=(0.071, 0.076, 0.016), seed=103
    ),
    FIR,
    replace(FIR, name="fir-2", aspect=0.42, clumps=64, leaf_reflectance=(0.048, 0.057, 0.020), seed=202),
    replace(FIR, name="fir-3", aspect=0.55, clear_trunk=0.12, leaf_reflectance=(0.038, 0.050, 0.018), seed=203),
    OAK,
    replace(
        OAK, name="oak-2", aspect=0.64, clear_trunk=0.20, clumps=74, leaf_reflectance=(0.069, 0.082, 0.018), seed=302
    ),
    replace(
        OAK, name="oak-3", aspect=0.82, clear_trunk=0.10, clumps=96, leaf_reflectance=(0.084, 0.096, 0.019), seed=303
    ),
    BIRCH,
    replace(BIRCH, name="birch-2", aspect=0.36, clumps=54, leaf_reflectance=(0.096, 0.107, 0.021), seed=402),
    replace(
        BIRCH,
        name="birch-3",
        aspect=0.48,
        clear_trunk=0.12,
        clumps=70,
        leaf_reflectance=(0.084, 0.097, 0.022),
        seed=403,
    ),
    BUSH,
    replace(BUSH, name="bush-2", aspect=1.4, height_m=(0.7, 1.8), leaf_reflectance=(0.101, 0.104, 0.025), seed=502),
    replace(BUSH, name="bush-3", aspect=0.9, height_m=(1.4, 3.2), leaf_reflectance=(0.063, 0.076, 0.018), seed=503),
    REED,
    replace(
        REED, name="grass-1", species="grass", aspect=1.2, height_m=(0.4, 0.9), clumps=140, leaf_size=0.014, seed=602
    ),
    STONE,
    replace(STONE, name="rock-2", aspect=2.4, height_m=(0.25, 0.8), leaf_reflectance=(0.190, 0.175, 0.155), seed=702),
    replace(STONE, name="rock-3", aspect=1.5, height_m=(0.4, 1.4), leaf_reflectance=(0.285, 0.255, 0.205), seed=703),
)


def kinds_of(group: str) -> tuple[int, ...]:
    """Return the indices into `KINDS` of all kinds of a group; raises `KeyError` for an unknown group."""
    if group not in GROUPS:
        raise KeyError(f"unknown group of plants {group!r}; known: {', '.join(GROUPS)}")
    return tuple(index for index, kind in enumerate(KINDS) if kind.group == group)
