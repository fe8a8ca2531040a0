"""Medial axis of a polygon: the line in the middle of its banks, and how far they are from it.

The Voronoi diagram of points on the boundary approximates the medial axis (Brandt and Algazi, 1992): its edges inside
the polygon run as far from one bank as from the other. Of this graph the axis is the way between the two ends that are
farthest apart, or nearest to two given places.
"""

from typing import Any

import numpy as np

from thalweg.world import geometry
from thalweg.world.errors import WorldError
from thalweg.world.real.sources.extra import need

POINTS_ACROSS = 8.0
"""Number of boundary points along a stretch as long as the river is wide on average."""
SPACING_M = (0.25, 4.0)
"""Least and greatest distance of the points on the boundary."""
MAX_BOUNDARY_POINTS = 60_000
"""Maximum number of points on the boundary."""
MAX_SIDE_POINTS = 5000
"""Maximum number of points between two corners: the time of the diagram grows as the square of points on a line."""
FORK = 2**0.5
"""Length of the branch into a square corner, relative to the distance of its root from the banks."""
AHEAD = 1.4
"""How far ahead of an end the boundary may be, relative to the banks; a square end lies as far ahead as the banks."""


def medial_axis(
    polygon: Any, start_m: np.ndarray | None = None, end_m: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the middle line [K, 2] of a polygon without holes, in metres, and its distances [K] from the boundary.

    polygon: of shapely. start_m, end_m [2]: places near the ends of the line, if they are known. Branches into corners
    at its ends are cut off, and it goes straight on from there to the boundary. Raises `WorldError` for a polygon that
    is too small or too large.
    """
    vertices, edges = _inner_edges(polygon)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    route = _route(vertices, edges, lengths, start_m, end_m)
    line = vertices[route]
    clearance = _distances(polygon, line)
    return _with_straight_ends(polygon, line, clearance)


def _inner_edges(polygon: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return places [V, 2] and pairs of them [E, 2]: the edges of the Voronoi diagram that lie inside the polygon."""
    from scipy.spatial import Voronoi

    shapely = need("shapely", "a polygon of banks")
    boundary = shapely.get_coordinates(shapely.segmentize(polygon.exterior, _spacing(polygon)))[:-1]
    diagram = Voronoi(boundary)
    ridges = np.asarray(diagram.ridge_vertices)
    ridges = ridges[(ridges >= 0).all(axis=1)]
    inside = shapely.contains_xy(polygon, diagram.vertices)
    ridges = ridges[inside[ridges].all(axis=1)]
    if len(ridges) < 2:
        raise WorldError("the polygon of the banks is too small or too thin to have a middle line")
    return diagram.vertices, ridges


def _spacing(polygon: Any) -> float:
    """Return the distance of the points on the boundary; raises `WorldError` for a boundary that is too long, or that
    runs straight too far, as with a position that is far from where it should be."""
    shapely = need("shapely", "a polygon of banks")
    width = 2 * polygon.area / polygon.length
    spacing = float(np.clip(width / POINTS_ACROSS, *SPACING_M))
    if polygon.length / spacing > MAX_BOUNDARY_POINTS:
        raise WorldError(
            f"the banks are {polygon.length:.0f} m long; limit {MAX_BOUNDARY_POINTS * spacing:.0f} m: cut the polygon "
            "to the reach"
        )
    corners = shapely.get_coordinates(polygon.exterior)
    longest = float(np.hypot(*np.diff(corners, axis=0).T).max())
    if longest / spacing > MAX_SIDE_POINTS:
        raise WorldError(
            f"the banks run straight for {longest:.0f} m between two positions; limit {MAX_SIDE_POINTS * spacing:.0f} m"
            " at their width: correct the positions, or cut the polygon to the reach"
        )
    return spacing


def _route(
    vertices: np.ndarray,
    edges: np.ndarray,
    lengths: np.ndarray,
    start_m: np.ndarray | None,
    end_m: np.ndarray | None,
) -> np.ndarray:
    """Return the vertices of the way between two places, by default those farthest apart in the largest part."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components, dijkstra

    count = len(vertices)
    graph = coo_array((np.maximum(lengths, 1e-9), (edges[:, 0], edges[:, 1])), shape=(count, count)).tocsr()
    part = connected_components(graph, directed=False)[1]
    weight = np.bincount(part[edges[:, 0]], weights=lengths, minlength=part.max() + 1)
    members = np.flatnonzero(part == int(np.argmax(weight)))

    def farthest(node: int) -> int:
        away = dijkstra(graph, directed=False, indices=node)
        return int(members[np.argmax(away[members])])

    def nearest(place: np.ndarray) -> int:
        return int(members[np.argmin(np.hypot(*(vertices[members] - place).T))])

    first = farthest(int(members[0])) if start_m is None else nearest(start_m)
    last = farthest(first) if end_m is None else nearest(end_m)
    before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)[1]
    route = [last]
    while route[-1] != first:
        route.append(int(before[route[-1]]))
    return np.array(route[::-1])


def _distances(polygon: Any, line: np.ndarray) -> np.ndarray:
    """Return [K] the distances of places [K, 2] from the boundary."""
    shapely = need("shapely", "a polygon of banks")
    boundary = polygon.exterior
    shapely.prepare(boundary)
    return shapely.distance(boundary, shapely.points(line))


def _with_straight_ends(polygon: Any, line: np.ndarray, clearance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a line and its distances after its branches into corners at both ends are replaced by straight ends."""
    for _ in range(2):
        keep = _root(line, clearance)
        line, clearance = _extended(polygon, line[keep:], clearance[keep:])
        line, clearance = line[::-1], clearance[::-1]
    return line, clearance


def _root(line: np.ndarray, clearance: np.ndarray) -> int:
    """Return the index of the first place beyond the branch into a corner at the beginning of a line.

    On a branch into a square corner the way from the corner is √2 of the distance from the banks; beyond its root it
    grows and the distance does not.
    """
    way = FORK * clearance[0] + geometry.arc_length(line, False)[0]
    beyond = np.flatnonzero(way > 1.05 * FORK * clearance)
    return min(int(beyond[0]), len(line) - 2) if len(beyond) else 0


def _extended(polygon: Any, line: np.ndarray, clearance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a line whose beginning goes straight on to the boundary, as far from the banks as where it began.

    A line that begins further from the boundary ahead than from the banks, such as at a given place, stays as it is.
    """
    shapely = need("shapely", "a polygon of banks")
    arc = geometry.arc_length(line, False)[0]
    behind = line[min(int(np.searchsorted(arc, 2 * clearance[0])), len(line) - 1)]
    direction = line[0] - behind
    if (length := np.hypot(*direction)) < 1e-9:
        return line, clearance
    far = line[0] + direction / length * AHEAD * clearance[0]
    found = shapely.get_coordinates(shapely.LineString([line[0], far]).intersection(polygon.exterior))
    if not len(found):
        return line, clearance
    end = found[np.argmin(np.hypot(*(found - line[0]).T))]
    if np.hypot(*(end - line[0])) < 1e-6:
        return line, clearance
    return np.concatenate([end[None], line]), np.concatenate([clearance[:1], clearance])
