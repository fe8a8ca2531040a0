"""Props of the reference renderer: solids met by small steps along each ray, without estimates of what a pixel covers.

The models themselves, which are data, are shared with the kernels; how they are placed, met and lit is not.
"""

from dataclasses import dataclass

import numpy as np

from thalweg.render.bake import ripples
from thalweg.render.kernels.props import models, paint, water
from thalweg.render.kernels.props.pose import LEAST_LAND_M
from thalweg.render.records import appearance, layout
from thalweg.render.records.props import CLASS_OFFSET, PropKind
from thalweg.render.reference.materials import Materials, bilinear, repeating

STEPS = 160
"""Steps along the stretch of a ray in the ball around a solid."""


def about_z(angle: float) -> np.ndarray:
    """Return the matrix [3, 3] of a turn about z."""
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def about_y(angle: float) -> np.ndarray:
    """Return the matrix [3, 3] of a turn about y; positive is down ahead."""
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def about_x(angle: float) -> np.ndarray:
    """Return the matrix [3, 3] of a turn about x."""
    return np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])


def joint_turn(joint: int, phase: float) -> np.ndarray:
    """Return the matrix [3, 3] of a joint at a phase."""
    if joint in (models.LEFT_ARM, models.RIGHT_ARM):
        return about_y(phase + (np.pi if joint == models.RIGHT_ARM else 0.0))
    if joint == models.PADDLE:
        return about_z(0.45 * np.sin(phase)) @ about_x(0.55 * np.cos(phase))
    return np.eye(3)


@dataclass(frozen=True)
class PlacedPart:
    """A part of a prop in the world."""

    model: np.ndarray
    """[MODEL_COLUMNS], a row of `models.PARTS`."""
    to_solid: np.ndarray
    """[3, 3], from metres in the world to the coordinates of the solid."""
    middle: np.ndarray
    """[3], metres."""
    class_id: int
    level: float
    sunlit: float
    mirrored: bool
    """Whether water mirrors it."""


def place(materials: Materials, prop: np.ndarray) -> list[PlacedPart]:
    """Return the parts of a row [6] of props."""
    kind, x, y, z, yaw, phase = prop.tolist()
    if kind == PropKind.NONE:
        return []
    numbers = models.KINDS[int(kind)].astype(float)
    first, last = int(numbers[models.FIRST]), int(numbers[models.LAST])
    body = about_z(yaw) @ about_y(numbers[models.ROCK_PITCH] * np.cos(phase))
    body = body @ about_x(numbers[models.ROCK_ROLL] * np.sin(phase))
    back = -models.HUT_M if kind == PropKind.STATION else 0.0
    ground = materials.node(np.array([x + body[0, 0] * back]), np.array([y + body[1, 0] * back]))
    lift = max(float(bilinear(materials.surface, *ground)[0]) - z, LEAST_LAND_M)
    sunlit = float(np.clip(bilinear(materials.share, *ground)[0], 0, 1))
    at = np.array([x, y, z + numbers[models.BOB] * np.sin(phase)])
    placed = []
    for number, model in enumerate(models.PARTS[first:last].astype(float)):
        joint = joint_turn(int(model[models.JOINT]), phase)
        offset = joint @ model[models.OFFSET_X : models.OFFSET_Z + 1]
        offset[2] += lift if model[models.JOINT] == models.ON_LAND else 0.0
        own = model[models.TURN : models.TURN + 9].reshape(3, 3).T
        to_world = body @ joint @ own @ np.diag(model[models.HALF_X : models.HALF_Z + 1])
        middle = at + body @ (offset + model[models.PIVOT_X : models.PIVOT_Z + 1])
        placed.append(
            PlacedPart(
                model,
                np.linalg.inv(to_world),
                middle,
                int(kind) + CLASS_OFFSET,
                z,
                sunlit,
                number < numbers[models.MAIN],
            )
        )
    return placed


def outside(model: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return a number for each point [..., 3] of a solid's coordinates: above zero outside the solid, below inside."""
    x, y, z = np.moveaxis(p, -1, 0)
    if model[models.SHAPE] == models.SPHERE:
        return np.sqrt(x * x + y * y + z * z) - 1
    if model[models.SHAPE] == models.CUBE:
        return np.max(np.abs(p), axis=-1) - 1
    radius = 1 + (model[models.TAPER] - 1) * (z + 1) / 2
    return np.maximum(np.hypot(x, y) - radius, np.abs(z) - 1)


def meet(part: PlacedPart, origin: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Return the t [K] at which rays [K, 3] from origins [3] or [K, 3] enter a part; inf for a miss."""
    o = np.broadcast_to((origin - part.middle) @ part.to_solid.T, ray.shape)
    d = ray @ part.to_solid.T
    # All solids lie in the ball of radius √3.
    a, b, c = (d * d).sum(-1), (o * d).sum(-1), (o * o).sum(-1) - 3
    reach = b * b - a * c
    found = np.full(len(ray), np.inf)
    near = np.flatnonzero(reach > 0)
    if not len(near):
        return found
    root = np.sqrt(reach[near])
    low, high = (-b[near] - root) / a[near], (-b[near] + root) / a[near]
    steps = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, STEPS)
    inside = outside(part.model, o[near, None] + d[near, None] * steps[..., None]) <= 0
    hit = inside.any(axis=1)
    first = np.argmax(inside, axis=1)[hit]
    near, steps = near[hit], steps[hit]
    before, after = steps[np.arange(len(near)), np.maximum(first - 1, 0)], steps[np.arange(len(near)), first]
    for _ in range(30):
        middle = (before + after) / 2
        within = outside(part.model, o[near] + d[near] * middle[:, None]) <= 0
        before, after = np.where(within, before, middle), np.where(within, middle, after)
    found[near] = np.where(after > 1e-6, after, np.inf)
    return found


def radiance(materials: Materials, part: PlacedPart, at: np.ndarray, sight: np.ndarray) -> np.ndarray:
    """Return the radiance [K, 3] of a part at points [K, 3] (metres) in unit directions of sight, without haze."""
    model, local = part.model, (at - part.middle) @ part.to_solid.T
    # The normal is the slope of the function that is zero on the surface.
    small = 1e-5
    slope = np.stack(
        [outside(model, local + small * e) - outside(model, local - small * e) for e in np.eye(3)], axis=-1
    )
    normal = slope @ part.to_solid
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True) + 1e-12
    colour = model[models.RED : models.BLUE + 1]
    if model[models.STRIPES]:
        period = (local[:, int(model[models.AXIS])] + 1) / 2 * model[models.STRIPES] + model[models.SHIFT]
        striped = (period % 1 < model[models.DUTY])[:, None]
        colour = np.where(striped, model[models.STRIPE_R : models.STRIPE_B + 1], colour)
    tone = paint.WET + (1 - paint.WET) * np.clip((at[:, 2] - part.level) / paint.WET_M, 0, 1)
    gloss = model[models.GLOSS]
    if gloss == 0:
        size = ripples.SIZE / paint.GRAIN_M
        grain = repeating(materials.tile, (at[:, 0] + 0.6 * at[:, 2]) * size, (at[:, 1] + 0.7 * at[:, 2]) * size)
        tone = tone * (1 + paint.GRAIN * (grain[..., 3] - 0.5) / ripples.GRAIN_SPREAD)
    direct = np.maximum(normal @ materials.sun, 0) * part.sunlit
    open_sky = 0.55 + 0.45 * normal[:, 2]
    half = materials.sun - sight
    shine = np.maximum((normal * half).sum(-1) / np.linalg.norm(half, axis=-1), 0) ** 32
    graze = 1 - np.clip(-(normal * sight).sum(-1), 0, 1)
    shine = gloss * (shine * part.sunlit + 0.5 * graze**3 * np.maximum(normal[:, 2], 0))
    light = direct[:, None] * layout.SUN_RADIANCE + open_sky[:, None] * layout.SKY_RADIANCE + paint.BOUNCE
    return colour * tone[:, None] * light + shine[:, None]


class Props:
    """The props of one frame."""

    def __init__(self, materials: Materials, rows: np.ndarray) -> None:
        """Place the props of rows [P, 6]."""
        self.materials = materials
        self.rows = [row for row in np.asarray(rows, np.float64) if row[0] != PropKind.NONE]
        self.parts = [part for row in self.rows for part in place(materials, row)]

    def before(
        self, origin: np.ndarray, ray: np.ndarray, near: float, behind: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the radiance [R, C, 3] of props and the light [R, C] that they let through, and the depth and class of
        those that stop half of it (inf and 0 where none does); behind [R, C]: depth of what is behind them."""
        flat, limit = ray.reshape(-1, 3), behind.ravel()
        met = np.array([meet(part, origin, flat) for part in self.parts]).reshape(len(self.parts), -1)
        met = np.where((met > near) & (met < limit), met, np.inf)
        added, light = np.zeros((len(flat), 3)), np.ones(len(flat))
        depth, kind = np.full(len(flat), np.inf), np.zeros(len(flat), np.uint8)
        order = np.argsort(met, axis=0, kind="stable")
        for rank in range(len(self.parts)):
            for number, part in enumerate(self.parts):
                here = np.flatnonzero((order[rank] == number) & np.isfinite(met[number]))
                if not len(here):
                    continue
                far = met[number, here]
                length = np.linalg.norm(flat[here], axis=-1)
                seen = radiance(self.materials, part, origin + flat[here] * far[:, None], flat[here] / length[:, None])
                clear = np.exp(-far * length * self.materials.look[appearance.HAZE_PER_M])[:, None]
                share = light[here] * part.model[models.OPACITY]
                added[here] += share[:, None] * (seen * clear + self.materials.fog * (1 - clear))
                rest = light[here] - share
                half = (light[here] > 0.5) & (rest <= 0.5)
                depth[here] = np.where(half, far, depth[here])
                kind[here] = np.where(half, part.class_id, kind[here])
                light[here] = rest
        shape = ray.shape[:2]
        return added.reshape(*shape, 3), light.reshape(shape), depth.reshape(shape), kind.reshape(shape)

    def slopes(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the slopes [K, 2] of the waves around all props, at metres from the map's origin."""
        grid = self.materials.world.grid
        total = np.zeros((len(x), 2))
        for row in self.rows:
            numbers = models.KINDS[int(row[0])].astype(float)
            dx, dy = x - (row[1] - grid.origin_x_m), y - (row[2] - grid.origin_y_m)
            along = dx * np.cos(row[4]) + dy * np.sin(row[4])
            near = np.clip(along, -numbers[models.HULL_LENGTH], numbers[models.HULL_LENGTH])
            away = np.stack([dx - near * np.cos(row[4]), dy - near * np.sin(row[4])], axis=-1)
            distance = np.linalg.norm(away, axis=-1) + 1e-9
            far = distance - numbers[models.HULL_WIDTH]
            steep = numbers[models.WAVE] * min(self.materials.look[appearance.RIPPLE] / appearance.RIPPLE_1, 1.5)
            size = steep * (1 - far / numbers[models.WAVE_REACH]) * np.minimum(far / water.WAVE_START_M, 1)
            size = np.where((far > 0) & (far < numbers[models.WAVE_REACH]), size, 0.0)
            wave = size * np.sin(2 * np.pi / water.WAVE_M * far - water.WAVE_RATE * row[5])
            total += (wave / distance)[:, None] * away
        return total

    def mirrored(self, point: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the radiance [K, 3] of props that rays [K, 3] from points of the water meet, and the light [K] that
        they let through."""
        parts = [part for part in self.parts if part.mirrored]
        above, passing = np.zeros((len(point), 3)), np.ones(len(point))
        if not parts:
            return above, passing
        met = np.array([meet(part, point, ray) for part in parts])
        for number, part in enumerate(parts):
            here = np.flatnonzero(np.isfinite(met[number]) & (met[number] <= met.min(axis=0)))
            far = met[number, here][:, None]
            clear = np.exp(-far * self.materials.look[appearance.HAZE_PER_M])
            seen = radiance(self.materials, part, point[here] + ray[here] * far, ray[here])
            above[here] = seen * clear + self.materials.fog * (1 - clear)
            passing[here] = 0.0
        return above, passing
