"""Procedural models of plants and rocks: sets of small ellipses for leaves, needle tufts, bark, blades and stone.

Lengths are shares of the plant's height; the foot is at the origin, z is up. Growth is seeded by the kind alone.
`thalweg.render.bake.sprites` lights and draws models.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from thalweg.world.species import Colour, Kind

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
LEAF_SHINE = np.array([0.09, 0.095, 0.085])
"""What the waxy face of one leaf in ten adds to its reflectance: the grey-green specks of a sunlit crown."""


@dataclass(frozen=True)
class Model:
    """L ellipses in space, all float32: the points centre + s * along + t * across with s² + t² <= 1."""

    centre: np.ndarray
    """[L, 3]."""
    along: np.ndarray
    """[L, 3], one half axis."""
    across: np.ndarray
    """[L, 3], the other half axis."""
    normal: np.ndarray
    """[L, 3], unit vector for shading, turned outwards; it is rounder than the ellipse's own plane."""
    reflectance: np.ndarray
    """[L, 3], linear."""
    transmittance: np.ndarray
    """[L, 3], linear."""


def grow(kind: Kind) -> Model:
    """Return the model of a kind. The result is deterministic."""
    return GROWERS[kind.form](kind, np.random.default_rng(kind.seed))


def joined(*models: Model) -> Model:
    """Return one model with the ellipses of several."""
    return Model(*(np.concatenate([getattr(m, f.name) for m in models]) for f in fields(Model)))


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors [..., 3] normalised to length one."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def ellipses(
    centre: np.ndarray, along: np.ndarray, normal: np.ndarray, width: float, size: np.ndarray, colours: tuple
) -> Model:
    """Return ellipses at centre [L, 3] of half length size [L] in the direction `along` [L, 3], `width` times as wide.

    They lie as flat to `normal` [L, 3] as their direction allows. `colours`: reflectance and transmittance, each
    [L, 3] or [3].
    """
    along = unit(along)
    across = unit(np.cross(normal, along))
    arrays = (centre, along * size[:, None], across * (width * size)[:, None], unit(normal))
    painted = (np.broadcast_to(colour, centre.shape) for colour in colours)
    return Model(*(np.ascontiguousarray(a, dtype=np.float32) for a in (*arrays, *painted)))


def lobes(rng: np.random.Generator, strength: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return an irregular outline: a function from azimuth and share of the crown's height [...] to factors about 1."""
    around = np.array([1, 2, 3, 2, 3])
    upward = np.array([2.0, 3.0, 4.0, 7.0, 8.0])
    phase = rng.uniform(0, 2 * np.pi, (2, 5))
    weight = strength * rng.uniform(0.5, 1.0, 5) / np.sqrt(5)

    def factor(azimuth: np.ndarray, share: np.ndarray) -> np.ndarray:
        waves = np.cos(around * azimuth[..., None] + phase[0]) * np.cos(upward * share[..., None] + phase[1])
        return np.clip(1.0 + 1.6 * (waves * weight).sum(-1), 0.45, 1.15)

    return factor


def stem(path: np.ndarray, radius: np.ndarray, bark: Colour, rng: np.random.Generator) -> Model:
    """Return the bark round a path [P, 3] of radius [P]: rings of ellipses, overlapping along the path."""
    direction = np.gradient(path, axis=0)
    step = np.linalg.norm(direction, axis=1)
    direction = unit(direction)
    side = unit(np.cross(direction, np.array([0.31, 0.94, 0.14])))
    other = np.cross(direction, side)
    angle = np.linspace(0, 2 * np.pi, 7)[:-1]
    normal = side[:, None] * np.cos(angle)[:, None] + other[:, None] * np.sin(angle)[:, None]
    centre = path[:, None] + normal * radius[:, None, None] * 0.85
    shape = (-1, 3)
    tone = rng.uniform(0.65, 1.2, normal.shape[:2])[..., None] * np.array(bark)
    size = np.broadcast_to((0.9 * step)[:, None], normal.shape[:2]).ravel()
    along = np.broadcast_to(direction[:, None], normal.shape).reshape(shape)
    width = np.broadcast_to(radius[:, None], normal.shape[:2]).ravel() * 0.75
    model = ellipses(centre.reshape(shape), along, normal.reshape(shape), 1.0, size, (tone.reshape(shape), np.zeros(3)))
    across = unit(model.across.astype(np.float64)) * width[:, None]
    return Model(
        model.centre, model.along, across.astype(np.float32), model.normal, model.reflectance, model.transmittance
    )


def curve(start: np.ndarray, end: np.ndarray, sag: float, points: int) -> np.ndarray:
    """Return a branch [points, 3] from start to end [3] whose middle is `sag` lower (or, if negative, higher)."""
    t = np.linspace(0, 1, points)[:, None]
    return start * (1 - t) + end * t - np.array([0, 0, sag]) * (4 * t * (1 - t))


def trunk(kind: Kind, rng: np.random.Generator, top: float, sway: float) -> tuple[np.ndarray, Model]:
    """Return the trunk's path [P, 3] up to `top`, and its bark."""
    z = np.linspace(-0.01, top, 90)
    phase = rng.uniform(0, 2 * np.pi, 2)
    sideways = sway * (np.sin(3.1 * z[:, None] + phase) - np.sin(phase)) * np.minimum(z, 1)[:, None]
    path = np.column_stack([sideways, z])
    flare = 1 + 0.7 * np.exp(-z / 0.025)
    radius = kind.trunk_radius * flare * np.maximum(1 - 0.88 * z / top, 0.05)
    return path, stem(path, radius, kind.bark_reflectance, rng)


def clump_centres(kind: Kind, rng: np.random.Generator, strength: float) -> tuple[np.ndarray, np.ndarray]:
    """Return centres [clumps, 3] and radii [clumps] of the leaf clumps, spread evenly through the crown's envelope."""
    half_width = kind.aspect / 2
    share = np.linspace(0.02, 0.97, 400)
    outline = kind.crown_radius(kind.clear_trunk + (1 - kind.clear_trunk) * share)
    cumulative = np.cumsum(outline**1.4 + 0.03)
    order = (np.arange(kind.clumps) + rng.uniform(0.2, 0.8, kind.clumps)) / kind.clumps
    at = np.interp(order, cumulative / cumulative[-1], share)
    azimuth = np.arange(kind.clumps) * GOLDEN_ANGLE + rng.normal(0, 0.35, kind.clumps)
    radius = half_width * kind.clump_radius * rng.uniform(0.7, 1.2, kind.clumps)
    reach = np.interp(at, share, outline) * half_width * lobes(rng, strength)(azimuth, at)
    distance = np.maximum(reach - 0.85 * radius, 0) * np.sqrt(rng.uniform(0.25, 1.0, kind.clumps))
    crown_height = 1 - kind.clear_trunk
    z = kind.clear_trunk + crown_height * at
    z = np.clip(z, kind.clear_trunk + 0.5 * radius, 1 - 0.55 * radius)
    return np.column_stack([distance * np.cos(azimuth), distance * np.sin(azimuth), z]), radius


def leafy(
    kind: Kind,
    rng: np.random.Generator,
    centres: np.ndarray,
    radii: np.ndarray,
    *,
    leaves: int,
    flat: float,
    width: float,
    aligned: float,
) -> Model:
    """Return the leaves of all clumps, most of them near each clump's upper surface, which keeps its inside dark.

    `flat`: height over width of a clump; `width`: of a leaf over its length; `aligned`: 1 = leaves point outwards like
    needles, 0 = in random directions.
    """
    clump = np.repeat(np.arange(len(centres)), leaves)
    count = len(clump)
    direction = unit(rng.normal(size=(count, 3)) + np.array([0, 0, 0.35]))
    ragged = 1 + 0.22 * np.cos(3 * np.arctan2(direction[:, 1], direction[:, 0]) + 2.4 * clump)
    spread = 0.3 + 0.7 * np.sqrt(rng.uniform(size=count)) + np.abs(rng.normal(0, 0.2, count))
    distance = radii[clump] * ragged * spread
    centre = centres[clump] + direction * distance[:, None] * np.array([1, 1, flat])
    inside = np.array([0, 0, kind.clear_trunk + 0.4 * (1 - kind.clear_trunk)])
    outward = unit((centre - inside) * np.array([1, 1, 0.6]))
    loose = unit(rng.normal(size=(count, 3)))
    normal = unit(0.75 * direction + 0.45 * outward + 0.75 * loose)
    pointing = unit(aligned * (direction + 0.4 * outward) + (1 - aligned) * np.cross(normal, loose) + 0.35 * loose)
    size = kind.leaf_size * rng.uniform(0.7, 1.35, count)
    tone = np.exp(rng.normal(-0.06, 0.36, (count, 1))) * (1 + rng.normal(0, 0.15, (len(centres), 1)))[clump]
    yellow = (1 + rng.normal(0, 0.045, len(centres)))[clump, None] ** np.array([1.5, 0.2, -1.0])
    young = 0.85 + 0.3 * np.clip(distance / radii[clump], 0, 1.2)[:, None]
    paint = tone * yellow * young
    shine = LEAF_SHINE * (rng.uniform(size=(count, 1)) < 0.1)
    colours = (paint * np.array(kind.leaf_reflectance) + shine, paint * np.array(kind.leaf_transmittance))
    return ellipses(centre, pointing, normal, width, size, colours)


def branches(
    kind: Kind, rng: np.random.Generator, path: np.ndarray, centres: np.ndarray, sag: float, steep: float
) -> Model:
    """Return branches from the trunk's path [P, 3] to every clump; `steep`: its rise over its run."""
    models = []
    for centre in centres:
        away = np.hypot(centre[0], centre[1])
        root_z = np.clip(centre[2] - steep * away - 0.01, 0.6 * kind.clear_trunk + 0.02, path[-1, 2])
        root = np.array([np.interp(root_z, path[:, 2], path[:, axis]) for axis in range(3)])
        points = max(6, int(90 * np.linalg.norm(centre - root)))
        thick = kind.trunk_radius * (0.16 + 0.5 * away)
        line = curve(root, centre, sag * away, points)
        models.append(stem(line, np.linspace(thick, 0.3 * thick, points), kind.bark_reflectance, rng))
    return joined(*models)


def grow_pine(kind: Kind, rng: np.random.Generator) -> Model:
    """A Scots pine: a bare, slightly bent trunk, dead stubs, and flat cushions of needles in an irregular crown."""
    path, bark = trunk(kind, rng, 0.95, 0.025)
    centres, radii = clump_centres(kind, rng, 0.7)
    centres[:, :2] += path[np.searchsorted(path[:, 2], centres[:, 2]).clip(max=len(path) - 1), :2]
    needles = leafy(kind, rng, centres, radii, leaves=170, flat=0.6, width=0.42, aligned=0.7)
    stubs_z = rng.uniform(0.45, 1.0, 7) * kind.clear_trunk
    stub_angle = rng.uniform(0, 2 * np.pi, 7)
    reach = rng.uniform(0.2, 0.55, 7) * kind.aspect / 2
    stubs = np.column_stack([reach * np.cos(stub_angle), reach * np.sin(stub_angle), stubs_z])
    return joined(bark, branches(kind, rng, path, np.concatenate([centres, stubs]), 0.06, 0.35), needles)


def grow_cone(kind: Kind, rng: np.random.Generator) -> Model:
    """A spruce or fir: whorls of drooping branches that carry sprays of needles, shorter towards the top."""
    _, bark = trunk(kind, rng, 0.985, 0.004)
    count = 3 * kind.clumps
    share = np.sort(1 - rng.uniform(0.0, 1, count) ** 0.75 * 0.98)
    share += 0.006 * np.sin(share * 2 * np.pi * 13)  # gathers the branches into whorls
    share = np.clip(share, 0.0, 0.98)
    outline = kind.crown_radius(kind.clear_trunk + (1 - kind.clear_trunk) * share) * kind.aspect / 2
    azimuth = np.arange(count) * GOLDEN_ANGLE + rng.normal(0, 0.3, count)
    length = outline * np.clip(lobes(rng, 0.35)(azimuth, share), 0.6, 1.1) * rng.uniform(0.6, 1.0, count) + 0.014
    per_branch = 90
    t = np.sqrt(rng.uniform(0.02, 1, (count, per_branch)))
    spread = length[:, None] * 0.34 * (1.05 - t) * rng.normal(0, 1, t.shape) + rng.normal(0, 0.006, t.shape)
    out = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)[:, None]
    side = np.stack([-np.sin(azimuth), np.cos(azimuth)], -1)[:, None]
    along = (length[:, None] * t)[..., None]
    flat = out * along + side * spread[..., None]
    droop = length[:, None] * (0.55 * t - 0.22 * t**3) + 0.5 * np.abs(spread) + rng.uniform(0, 0.03, t.shape)
    z = kind.clear_trunk + (1 - kind.clear_trunk) * share[:, None] + 0.25 * length[:, None] - droop
    centre = np.concatenate([flat, np.clip(z, 0.005, 0.995)[..., None]], -1).reshape(-1, 3)
    total = len(centre)
    outward = np.concatenate([np.broadcast_to(out, flat.shape), np.full((*t.shape, 1), 0.9)], -1).reshape(-1, 3)
    loose = unit(rng.normal(size=(total, 3)))
    pointing = outward * np.array([1, 1, -0.35]) + 0.6 * loose
    tone = rng.uniform(0.72, 1.25, (total, 1)) * (0.75 + 0.45 * t.reshape(-1, 1))
    colours = (tone * np.array(kind.leaf_reflectance), tone * np.array(kind.leaf_transmittance))
    size = kind.leaf_size * rng.uniform(0.8, 1.4, total)
    needles = ellipses(centre, pointing, unit(unit(outward) + 0.75 * loose), 0.5, size, colours)
    return joined(bark, needles)


def grow_round(kind: Kind, rng: np.random.Generator) -> Model:
    """An oak-like tree: a stout trunk, spreading branches, a broad crown of full clumps with dark gaps between."""
    path, bark = trunk(kind, rng, 0.8, 0.02)
    centres, radii = clump_centres(kind, rng, 0.6)
    leaves = leafy(kind, rng, centres, radii, leaves=150, flat=0.78, width=0.68, aligned=0.15)
    return joined(bark, branches(kind, rng, path, centres, -0.03, 0.7), leaves)


def grow_slender(kind: Kind, rng: np.random.Generator) -> Model:
    """A birch-like tree: a thin light trunk seen through a loose crown of small hanging clumps."""
    path, bark = trunk(kind, rng, 0.95, 0.018)
    centres, radii = clump_centres(kind, rng, 0.6)
    leaves = leafy(kind, rng, centres, radii, leaves=145, flat=1.05, width=0.7, aligned=0.1)
    return joined(bark, branches(kind, rng, path, centres, -0.02, 1.1), leaves)


def grow_bush(kind: Kind, rng: np.random.Generator) -> Model:
    """A shrub: leaf clumps down to the ground on several thin stems."""
    path, _ = trunk(kind, rng, 0.25, 0.0)
    centres, radii = clump_centres(kind, rng, 0.4)
    leaves = leafy(kind, rng, centres, radii, leaves=110, flat=0.85, width=0.62, aligned=0.3)
    return joined(branches(kind, rng, path, centres, 0.0, 0.9), leaves)


def grow_blades(kind: Kind, rng: np.random.Generator) -> Model:
    """A tuft of reeds or grass: bent blades from one foot, straw-coloured at their tips."""
    count, points = 2 * kind.clumps, 26
    half_width = kind.aspect / 2
    azimuth = rng.uniform(0, 2 * np.pi, count)
    out = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], -1)
    foot = out * (half_width * 0.55 * np.sqrt(rng.uniform(size=count)))[:, None]
    height = rng.uniform(0.45, 1.0, count)
    lean = half_width * rng.uniform(0.05, 0.5, count)
    t = np.linspace(0, 1, points)
    bend = out[:, None] * (lean[:, None] * t**1.8)[..., None]
    z = (height[:, None] * (t - 0.16 * (lean / half_width)[:, None] * t**3))[..., None]
    path = foot[:, None] + bend + z * np.array([0, 0, 1.0])
    along = np.gradient(path, axis=1)
    step = np.linalg.norm(along, axis=-1)
    facing = unit(np.stack([-np.sin(azimuth + 1), np.cos(azimuth + 1), 0.6 * np.ones(count)], -1))
    normal = np.broadcast_to(facing[:, None], path.shape)
    shape = (-1, 3)
    blades = ellipses(path.reshape(shape), along.reshape(shape), normal.reshape(shape), 1.0, step.ravel(), (0.0, 0.0))
    width = kind.leaf_size * 0.62 * np.broadcast_to(1.0 - 0.75 * t**2, step.shape).ravel()
    dry = (rng.uniform(0, 1, (count, 1)) ** 2 * 0.6 + 0.5 * t**2)[..., None]
    tone = rng.uniform(0.7, 1.25, (count, 1, 1))
    green, straw = np.array(kind.leaf_reflectance), np.array(kind.bark_reflectance)
    paint = (tone * (green * (1 - dry) + straw * dry)).reshape(shape)
    through = (tone * np.array(kind.leaf_transmittance) * np.ones_like(dry)).reshape(shape)
    across = unit(blades.across.astype(np.float64)) * width[:, None]
    f32 = np.float32
    arrays = (blades.centre, blades.along, across.astype(f32), blades.normal, paint.astype(f32), through.astype(f32))
    return Model(*arrays)


def grow_stone(kind: Kind, rng: np.random.Generator) -> Model:
    """A boulder: a sphere cut by random planes into facets, roughened, with lichen on its upper sides."""
    count = 9000
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    angle = index * GOLDEN_ANGLE
    direction = np.column_stack(
        [np.sqrt(1 - height**2) * np.cos(angle), np.sqrt(1 - height**2) * np.sin(angle), height]
    )
    facing = unit(rng.normal(size=(kind.clumps, 3)))
    reach = (rng.uniform(0.62, 1.0, kind.clumps)) / np.maximum(direction @ facing.T, 0.05)
    facet = reach.argmin(1)
    radius = np.minimum(reach[np.arange(count), facet], 1.05)
    waves = rng.normal(size=(14, 3)) * np.geomspace(3, 16, 14)[:, None]
    rough = (np.cos(direction @ waves.T + rng.uniform(0, 6, 14)) / np.geomspace(3, 16, 14)).sum(1)
    shape = np.array([kind.aspect / 2, kind.aspect / 2 * 0.8, 0.85])
    centre = direction * (radius * (1 + 0.05 * rough))[:, None] * shape + np.array([0, 0, 0.15])
    grain = rng.normal(size=(count, 3))
    normal = unit((0.75 * facing[facet] + 0.35 * direction) / shape + 0.22 * grain)
    lichen = np.clip(1.5 * rough - 0.5 + 0.6 * normal[:, 2:3].ravel(), 0, 1)[:, None] * 0.7
    low = np.clip(1.25 * centre[:, 2:3] + 0.55, 0.5, 1.0)  # damp and dark where it meets the ground
    tone = (1 + 0.25 * rough[:, None]) * rng.uniform(0.85, 1.15, (count, 1)) * low
    paint = tone * (np.array(kind.leaf_reflectance) * (1 - lichen) + np.array(kind.bark_reflectance) * lichen)
    size = np.full(count, kind.leaf_size * max(1.0, kind.aspect))
    return ellipses(centre, np.cross(normal, grain), unit(direction / shape), 1.0, size, (paint, np.zeros(3)))


GROWERS: dict[str, Callable[[Kind, np.random.Generator], Model]] = {
    "pine": grow_pine,
    "cone": grow_cone,
    "round": grow_round,
    "slender": grow_slender,
    "bush": grow_bush,
    "blades": grow_blades,
    "stone": grow_stone,
}
