"""Conversion of longitude and latitude on the WGS84 ellipsoid to local metres.

Other datums and projections are left out on purpose. A library such as pyproj knows thousands, with a database and a
binary of its own; a river of a few kilometres needs one, in closed form. Height above the ellipsoid is ignored: a line
at 1,000 m above sea level becomes 0.016 % too short.
"""

import numpy as np

SEMI_MAJOR_M = 6378137.0
"""Radius of the WGS84 ellipsoid at the equator."""
FLATTENING = 1 / 298.257223563
"""Flattening of the WGS84 ellipsoid."""


def earth_centred(degrees: np.ndarray) -> np.ndarray:
    """Return [K, 3] metres from the Earth's centre for points [K, 2] of longitude and latitude in degrees.

    Hofmann-Wellenhof et al., 2001, equation 10.1, at height 0; defined everywhere, also at the poles.
    """
    longitude, latitude = np.radians(degrees).T
    squared = FLATTENING * (2 - FLATTENING)
    normal = SEMI_MAJOR_M / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    equatorial = normal * np.cos(latitude)
    return np.stack(
        [equatorial * np.cos(longitude), equatorial * np.sin(longitude), normal * (1 - squared) * np.sin(latitude)],
        axis=1,
    )


def chord_lengths(degrees: np.ndarray) -> np.ndarray:
    """Return [K - 1] metres, the straight distance from each point [K, 2] to the next; 1 mm short over 10 km."""
    return np.linalg.norm(np.diff(earth_centred(degrees), axis=0), axis=1)


def local_metres(degrees: np.ndarray, origin_deg: np.ndarray) -> np.ndarray:
    """Return [K, 2] metres east and north of `origin_deg` [2] on the plane tangent to the ellipsoid there.

    Angles at the origin are exact; a point at distance d appears d³ / 6R² too near (orthographic projection): 0.5 mm at
    5 km, 4 mm at 10 km.
    """
    longitude, latitude = np.radians(origin_deg)
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    north = np.array([-np.sin(latitude) * np.cos(longitude), -np.sin(latitude) * np.sin(longitude), np.cos(latitude)])
    return (earth_centred(degrees) - earth_centred(np.asarray(origin_deg)[None])) @ np.stack([east, north], axis=1)
