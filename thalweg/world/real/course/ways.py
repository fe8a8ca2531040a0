"""Ways of water joined to one line: put in order, turned where they run against the others, side arms left out.

Two ends belong together if they are at most `JOIN_M` apart. Ways are split where another one ends on them. Of a network
with forks the line is its main stem: the shortest way along the river that most of it is named after, between those two
ends that are farthest apart. Distances are chords in space, so that any two places on the Earth have one.
"""

import heapq
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.geometry import blocks
from thalweg.world.real.geodesy import chord_lengths, earth_centred

JOIN_M = 1.0
"""Greatest distance of two ends that belong together."""
MAX_WAYS = 5000
"""Maximum number of ways."""


@dataclass(frozen=True)
class Way:
    """A line of water; K positions."""

    places: np.ndarray
    """[K, 3] float64: longitude and latitude in degrees, elevation in metres or NaN."""
    width_m: np.ndarray
    """[K] float64, NaN where the file gives none."""
    name: str | None
    label: str
    """Its name in messages."""

    @cached_property
    def length_m(self) -> float:
        """Length along the straight segments."""
        return float(chord_lengths(self.places[:, :2]).sum())

    def turned(self) -> "Way":
        """Return the way from its last position to its first."""
        return replace(self, places=self.places[::-1], width_m=self.width_m[::-1])


@dataclass(frozen=True)
class Stem:
    """The line that ways make up, and what was done to get it."""

    places: np.ndarray
    """[K, 3] as in `Way`; the last position equals the first if the ways make a ring."""
    width_m: np.ndarray
    """[K] as in `Way`."""
    joined: int
    """Number of ways in it."""
    turned: int
    """Number of ways that ran against the others."""
    left_out: int
    """Number of ways beside the main stem."""


def join_ways(ways: Sequence[Way]) -> Stem:
    """Return the line that ways make up; it runs as most of its length does.

    Raises `WorldError` for ways in several pieces, with the gap in metres between the nearest ends.
    """
    if len(ways) == 1:
        return Stem(ways[0].places, ways[0].width_m, 1, 0, 0)
    if len(ways) > MAX_WAYS:
        raise WorldError(f"{len(ways)} ways of water; limit {MAX_WAYS}: keep only the river")
    split = [(index, piece) for index, piece in _split(ways) if piece.length_m > JOIN_M]
    way_of, pieces = [index for index, _ in split], [piece for _, piece in split]
    if not pieces:
        raise WorldError(f"its {len(ways)} ways of water are all shorter than {JOIN_M:g} m")
    network = _Network(pieces)
    network.check_connected()
    route = network.stem()
    if not route:
        raise WorldError(
            f"its {len(ways)} ways of water are loops that meet in one place, so that none is the main stem: keep one"
        )
    lengths = np.array([pieces[piece].length_m * (1 if forward else -1) for piece, forward in route])
    # Of as much length both ways, the first way in the file decides.
    tie = abs(lengths.sum()) <= 1e-6 * np.abs(lengths).sum()
    if not min(route)[1] if tie else lengths.sum() < 0:
        route = [(piece, not forward) for piece, forward in reversed(route)]
    parts = [pieces[piece] if forward else pieces[piece].turned() for piece, forward in route]
    places = np.concatenate([parts[0].places, *(part.places[1:] for part in parts[1:])])
    widths = np.concatenate([parts[0].width_m, *(part.width_m[1:] for part in parts[1:])])
    first, last = network.ends[route[0][0]], network.ends[route[-1][0]]
    if first[0 if route[0][1] else 1] == last[1 if route[-1][1] else 0]:
        places[-1] = places[0]
    # By index, since several ways may have one label.
    joined = {way_of[piece] for piece, _ in route}
    turned = {way_of[piece] for piece, forward in route if not forward}
    return Stem(places, widths, len(joined), len(turned), len(ways) - len(joined))


def _split(ways: Sequence[Way]) -> list[tuple[int, Way]]:
    """Return the pieces of ways that are split where another one begins or ends, each with the index of its way."""
    ends = {tuple(place) for way in ways for place in (way.places[0, :2], way.places[-1, :2])}
    found = []
    for index, way in enumerate(ways):
        inner = [i for i in range(1, len(way.places) - 1) if tuple(way.places[i, :2]) in ends]
        for start, stop in pairwise([0, *inner, len(way.places) - 1]):
            rows = slice(start, stop + 1)
            found.append((index, replace(way, places=way.places[rows], width_m=way.width_m[rows])))
    return found


class _Network:
    """Pieces of ways as the edges of a graph, whose nodes are groups of ends."""

    def __init__(self, pieces: list[Way]) -> None:
        self.pieces = pieces
        self._places = earth_centred(np.array([way.places[i, :2] for way in pieces for i in (0, -1)]))
        nodes = _groups(self._places)
        self.ends = [(int(nodes[2 * i]), int(nodes[2 * i + 1])) for i in range(len(pieces))]
        self._edges: dict[int, list[int]] = defaultdict(list)
        for piece, (start, stop) in enumerate(self.ends):
            self._edges[start].append(piece)
            self._edges[stop].append(piece)

    def check_connected(self) -> None:
        """Raise `WorldError` for several pieces of water, with the nearest ends of the longest and of another one."""
        groups = self._components()
        if len(groups) == 1:
            return
        groups.sort(key=lambda members: -sum(self.pieces[piece].length_m for piece in members))
        rows = [np.array([2 * piece + end for piece in members for end in (0, 1)]) for members in groups]
        others = np.concatenate(rows[1:])
        apart = np.linalg.norm(self._places[rows[0]][:, None] - self._places[others][None], axis=2)
        one, other = np.unravel_index(int(np.argmin(apart)), apart.shape)
        at, to = (self._end(int(row)) for row in (rows[0][one], others[other]))
        names = sorted({way.name for way in self.pieces if way.name})
        choice = f", or choose one of {', '.join(names[:6])} by river_name" if len(names) > 1 else ""
        raise WorldError(
            f"{len(self.pieces)} ways of water in {len(groups)} pieces that do not join: the longest ends at {at}, "
            f"{apart[one, other]:.1f} m from the nearest end of another at {to}; limit {JOIN_M:g} m: draw what is "
            f"missing{choice}"
        )

    def _end(self, row: int) -> str:
        way = self.pieces[row // 2]
        longitude, latitude = way.places[-(row % 2), :2]
        return f"longitude {longitude:.6f}, latitude {latitude:.6f} ({way.label})"

    def _components(self) -> list[list[int]]:
        """Return the pieces of each connected part."""
        rest, found = set(range(len(self.pieces))), []
        while rest:
            members, todo = [], [min(rest)]
            rest.discard(todo[0])
            while todo:
                piece = todo.pop()
                members.append(piece)
                for node in self.ends[piece]:
                    more = [each for each in self._edges[node] if each in rest]
                    rest.difference_update(more)
                    todo.extend(more)
            found.append(sorted(members))
        return found

    def stem(self) -> list[tuple[int, bool]]:
        """Return the pieces of the main stem in order, each with whether it is run from its first position."""
        loose = [node for node, pieces in self._edges.items() if len(pieces) == 1]
        if not loose and all(len(pieces) == 2 for pieces in self._edges.values()):
            return self._ring()
        allowed = self._named_most() if len(loose) != 2 or self._has_forks() else None
        for members in (allowed, None):
            nodes = self._loose_ends(members)
            farthest, longest = nodes[0], -1.0
            for node, length in zip(nodes, self._reaches(nodes, members), strict=True):
                if length > longest + 1e-6:
                    longest, farthest = length, node
            if route := self._farthest(farthest, members)[1]:
                return route
        return []

    def _reaches(self, nodes: list[int], members: set[int] | None) -> list[float]:
        """Return how far the farthest node from each of some nodes is, by the shortest way."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import dijkstra

        shortest: dict[tuple[int, int], float] = {}
        for piece, ends in enumerate(self.ends):
            if (members is None or piece in members) and ends[0] != ends[1]:
                between = min(ends), max(ends)
                length = self.pieces[piece].length_m
                shortest[between] = min(length, shortest.get(between, length))
        count = max(map(max, self.ends)) + 1
        rows, columns = np.array([*shortest], int).reshape(-1, 2).T
        graph = coo_array((np.array([*shortest.values()]), (rows, columns)), shape=(count, count)).tocsr()
        found = []
        for block in blocks(len(nodes)):
            apart = dijkstra(graph, directed=False, indices=nodes[block])
            found += np.where(np.isfinite(apart), apart, 0.0).max(axis=1).tolist()
        return found

    def _has_forks(self) -> bool:
        return any(len(pieces) > 2 for pieces in self._edges.values())

    def _named_most(self) -> set[int] | None:
        """Return the pieces of the name that most of the length has, if they hold together; else None."""
        lengths: dict[str, float] = defaultdict(float)
        for way in self.pieces:
            if way.name:
                lengths[way.name] += way.length_m
        if len(lengths) < 2:
            return None
        name = max(lengths, key=lambda each: lengths[each])
        members = [way for way in self.pieces if way.name == name]
        return (
            {index for index, way in enumerate(self.pieces) if way.name == name}
            if len(_Network(members)._components()) == 1
            else None
        )

    def _loose_ends(self, members: set[int] | None) -> list[int]:
        """Return the nodes at which one piece ends, or all if there is none."""
        counts = {
            node: sum(members is None or piece in members for piece in pieces) for node, pieces in self._edges.items()
        }
        return [node for node, count in counts.items() if count == 1] or [n for n, count in counts.items() if count]

    def _ring(self) -> list[tuple[int, bool]]:
        """Return the pieces of a ring from the first position of the first piece."""
        route, node = [(0, True)], self.ends[0][1]
        while len(route) < len(self.pieces):
            last = route[-1][0]
            piece = next(each for each in self._edges[node] if each != last)
            forward = self.ends[piece][0] == node
            route.append((piece, forward))
            node = self.ends[piece][1 if forward else 0]
        return route

    def _farthest(self, start: int, members: set[int] | None) -> tuple[float, list[tuple[int, bool]]]:
        """Return the length and the pieces of the shortest way to the node that is farthest from `start` (Dijkstra)."""
        reached: dict[int, tuple[float, int | None, bool]] = {}
        queue: list[tuple[float, int, int, bool]] = [(0.0, start, -1, True)]
        while queue:
            length, node, by, forward = heapq.heappop(queue)
            if node in reached:
                continue
            reached[node] = (length, None if by < 0 else by, forward)
            for piece in self._edges[node]:
                if members is None or piece in members:
                    begin, end = self.ends[piece]
                    ahead = begin == node
                    queue_item = (length + self.pieces[piece].length_m, end if ahead else begin, piece, ahead)
                    heapq.heappush(queue, queue_item)
        node = max(reached, key=lambda each: reached[each][0])
        total, route = reached[node][0], []
        while (by := reached[node][1]) is not None:
            forward = reached[node][2]
            route.append((by, forward))
            node = self.ends[by][0 if forward else 1]
        return total, route[::-1]


def _groups(places: np.ndarray) -> np.ndarray:
    """Return [K] the group of each place [K, 3]; places at most `JOIN_M` apart are of one group, also by steps."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    pairs = KDTree(places).query_pairs(JOIN_M, output_type="ndarray")
    ones = np.ones(len(pairs))
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return connected_components(graph, directed=False)[1]
