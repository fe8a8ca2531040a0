"""`Lens`: how a camera's image differs from that of a pinhole with square pixels and its axis in the middle.

Points are on the plane at distance one from the camera: x to the right and y down, as shares of the depth. Source of
the models: Brown, "Close-Range Camera Calibration", 1971, and Kannala and Brandt, "A Generic Camera Model", 2006, as
OpenCV writes them, https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html and
https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html
"""

import math
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from thalweg.core.config import FiniteNumber, TupleOf, frozen_config
from thalweg.render.errors import RenderError

DistortionModel = Literal["plumb_bob", "rational_polynomial", "equidistant"]
"""Names as in ROS. OpenCV's function for the first two is `projectPoints`, for the third `fisheye::projectPoints`."""
MODELS: tuple[DistortionModel, ...] = get_args(DistortionModel)
COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "rational_polynomial": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "equidistant": ("k1", "k2", "k3", "k4"),
}
"""Names of the coefficients of each model, in OpenCV's order."""
ORDERS: dict[str, int] = {"k1": 2, "k2": 4, "k3": 6, "k4": 2, "k5": 4, "k6": 6, "p1": 1, "p2": 1}
"""Power of a length on the plane at distance one that each coefficient of the first two models is divided by."""
MOST_ANGLE_DEG = 80.0
"""Greatest angle between a ray and the optical axis that is drawn."""
ANGLES = 4001
"""Number of angles at which a model is looked up where it is inverted."""
NEWTON_STEPS = 12
CLOSE = 1e-9
"""Greatest error of an inverted point, on the plane at distance one."""
MOST_COEFFICIENT = 1e9
"""Greatest coefficient of a model; those of real lenses are below a thousand."""
STEP = 1e-6
"""Distance of the points that derivatives are taken between."""


def _from_array(value: Any) -> Any:
    """Return the tuple of an array of numbers [D], and anything else unchanged."""
    return tuple(value.tolist()) if isinstance(value, np.ndarray) and value.ndim == 1 else value


@frozen_config(RenderError, numpy_scalars=True)
class Lens:
    """Distortion, shape of the pixels, and place of the optical axis in the image."""

    model: DistortionModel = "plumb_bob"
    """Model of the distortion; `equidistant` is that of OpenCV's fisheye cameras."""
    coefficients: Annotated[TupleOf[FiniteNumber], BeforeValidator(_from_array)] = ()
    """Those of the model in OpenCV's order; the rest are zero."""
    focal_ratio: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    """Focal length along a row as a share of that along a column, both in pixels."""
    offset_x_px: FiniteNumber = 0.0
    """How far the optical axis is to the right of the image's middle."""
    offset_y_px: FiniteNumber = 0.0
    """How far the optical axis is below the image's middle."""

    @model_validator(mode="after")
    def _has_known_coefficients(self) -> Self:
        names = COEFFICIENTS[self.model]
        if len(self.coefficients) > len(names):
            raise ValueError(
                f"{self.model} has the coefficients {', '.join(names)}; got {len(self.coefficients)} numbers"
            )
        for name, value in zip(names, self.coefficients, strict=False):
            if abs(value) > MOST_COEFFICIENT:
                raise ValueError(f"{name} must be within {MOST_COEFFICIENT:g} of 0, got {value:g}")
        return self

    def scaled(self, factor: float) -> np.ndarray:
        """Return the coefficients [D] of a lens whose rays are steeper by `factor`, on the plane at distance one.

        Raises `RenderError` for a factor other than 1 and `equidistant`, which is no polynomial of such points.
        """
        names = COEFFICIENTS[self.model]
        values = np.pad(np.array(self.coefficients, np.float64), (0, len(names) - len(self.coefficients)))
        if factor == 1.0:
            return values
        if self.model == "equidistant":
            raise RenderError(
                "a look changes the field of view, and an equidistant lens then has no coefficients of this model: use"
                " looks without fov_deg"
            )
        return values / factor ** np.array([ORDERS[name] for name in names])

    def adjust(self, matrix: Any) -> Any:
        """Return K [..., 3, 3], an array or a tensor, of a pinhole with square pixels and its axis in the middle,
        changed in place to that of this lens."""
        matrix[..., 0, 0] *= self.focal_ratio
        matrix[..., 0, 2] += self.offset_x_px
        matrix[..., 1, 2] += self.offset_y_px
        return matrix

    def distort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where the image has points (x, y), both [...], in shares of the focal lengths."""
        coefficient = dict(zip(COEFFICIENTS[self.model], self.scaled(1.0), strict=True))
        square = x**2 + y**2
        factor = self._radial(np.sqrt(square), coefficient)
        p1, p2 = coefficient.get("p1", 0.0), coefficient.get("p2", 0.0)
        return (
            x * factor + 2 * p1 * x * y + p2 * (square + 2 * x**2),
            y * factor + p1 * (square + 2 * y**2) + 2 * p2 * x * y,
        )

    def _radial(self, radius: np.ndarray, coefficient: dict[str, float]) -> np.ndarray:
        """Return the factor [...] by which points at a radius [...] move away from the axis."""
        of = coefficient.get
        if self.model == "equidistant":
            angle = np.arctan(radius)
            bent = angle * _series(angle**2, of("k1", 0), of("k2", 0), of("k3", 0), of("k4", 0))
            return np.where(radius > 0, bent / np.where(radius > 0, radius, 1.0), 1.0)
        above = _series(radius**2, of("k1", 0), of("k2", 0), of("k3", 0))
        return above / _series(radius**2, of("k4", 0), of("k5", 0), of("k6", 0))

    def radii(self) -> tuple[np.ndarray, np.ndarray]:
        """Return radii [A] on the plane at distance one and in the image, up to where the model folds.

        It folds where a ray further from the axis is shown nearer to it. The last radius is that of `MOST_ANGLE_DEG`
        for a model that does not fold before. Tangential coefficients are left out.
        """
        coefficient = dict(zip(COEFFICIENTS[self.model], self.scaled(1.0), strict=True))
        radius = np.tan(np.linspace(0.0, math.radians(MOST_ANGLE_DEG), ANGLES))
        with np.errstate(divide="ignore", invalid="ignore"):
            shown = radius * self._radial(radius, coefficient)
        folds = np.flatnonzero(~(np.diff(shown) > 0))
        last = int(folds[0]) + 1 if len(folds) else ANGLES
        return radius[:last], shown[:last]

    def undistort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points, both [...], that `distort` moves to (x, y); NaN where there is none before it folds.

        By Newton's method, from the inverse of the radial part.
        """
        radius, shown = self.radii()
        far = np.hypot(x, y)
        start = np.interp(far, shown, radius) / np.where(far > 0, far, 1.0)
        px, py = x * start, y * start
        if len(radius) < 2:
            return np.full_like(px, np.nan), np.full_like(py, np.nan)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                at_x, at_y = self.distort(px, py)
                a, b, c, d = self.slopes(px, py, at_x, at_y)
                off_x, off_y, size = at_x - x, at_y - y, a * d - b * c
                found = (np.hypot(off_x, off_y) <= CLOSE) & (size > 0) & (np.hypot(px, py) <= radius[-1] * (1 + CLOSE))
                if found.all():
                    break
                px, py = px - (off_x * d - off_y * b) / size, py - (off_y * a - off_x * c) / size
        return np.where(found, px, np.nan), np.where(found, py, np.nan)

    def slopes(
        self, x: np.ndarray, y: np.ndarray, at_x: np.ndarray, at_y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the derivatives of `distort`, each [...], at (x, y), which it moves to (at_x, at_y): those of its x by
        x and by y, and those of its y."""
        right, below = self.distort(x + STEP, y), self.distort(x, y + STEP)
        return (right[0] - at_x) / STEP, (below[0] - at_x) / STEP, (right[1] - at_y) / STEP, (below[1] - at_y) / STEP


def _series(value: np.ndarray, *factors: float) -> np.ndarray:
    """Return 1 + a v + b v² + ... [...] of values v [...] and factors a, b, ..."""
    return np.polynomial.polynomial.polyval(value, (1.0, *factors))
