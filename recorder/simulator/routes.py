"""Where a robot can drive: the inside of a room, and a safe closed route through it.

The room is laid out in small cells. What cannot be reached from outside without crossing a wall is
its inside; when the walls enclose next to nothing (single lines, an open door), the rectangle
around them is. The route visits places far from each other, joined by the shortest safe ways.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from recorder.errors import BadInput
from recorder.simulator.walls import Points, Walls

ROBOT_RADIUS_M = 0.07
WAYPOINT_SPACING_M = 0.6
MAX_WAYPOINTS = 24
_CLEARANCES_M = (0.20, 0.15, 0.11)  # wished for; a narrow room gets less
_FAR_CLEARANCES_M = (0.8, 0.7, 0.6, 0.5, 0.45, 0.4, 0.35, 0.3, 0.25)
_BESIDE_WALLS_M = 0.12
_RANDOM_PLACES = 20
_NOWHERE = "between these walls there is no place where a robot could drive"
_CELL_M = 0.02
_MAX_CELLS_ACROSS = 1000
_MAX_NODES = 10_000
_ENCLOSED_SHARE = 0.05  # of the rectangle around the walls; less does not count as a room


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """The room in cells: ``grid[row, col]``, row 0 at the lowest y.

    ``clearance_m`` is the distance of a cell from the nearest wall, to about a cell; ``inside``
    marks the cells in the room, those with a wall included.
    """

    origin_m: tuple[float, float]
    cell_m: float
    clearance_m: NDArray[np.float64]
    inside: NDArray[np.bool_]

    def cells_of(self, points_m: Points) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Row and column of each point (..., 2); points off the grid get its border."""
        index = np.floor((points_m - np.array(self.origin_m)) / self.cell_m).astype(np.intp)
        rows, cols = self.clearance_m.shape
        return np.clip(index[..., 1], 0, rows - 1), np.clip(index[..., 0], 0, cols - 1)

    @property
    def centres_m(self) -> Points:
        """The centres of all cells, (rows * cols, 2), row by row."""
        return self.points_m(np.argwhere(np.ones(self.inside.shape, np.bool_)))

    def points_m(self, cells: NDArray[np.intp]) -> Points:
        """The centres (N, 2) of cells (N, 2) as row, col."""
        return np.asarray((cells[:, ::-1] + 0.5) * self.cell_m + np.array(self.origin_m))

    def safe(self, points_m: Points, clearance_m: float) -> NDArray[np.bool_]:
        """Which points (..., 2) are in the room and at least ``clearance_m`` from any wall."""
        cells = self.cells_of(points_m)
        return np.asarray(self.inside[cells] & (self.clearance_m[cells] >= clearance_m))

    def safe_legs(self, starts: Points, ends: Points, clearance_m: float) -> NDArray[np.bool_]:
        """Which straight legs (N,), from ``starts`` to ``ends`` (N, 2), are safe all along."""
        longest_m = float(np.linalg.norm(ends - starts, axis=-1).max(initial=0.0))
        shares = np.linspace(0.0, 1.0, math.ceil(longest_m / self.cell_m) + 2)[:, None, None]
        return np.asarray(self.safe(starts + shares * (ends - starts), clearance_m).all(axis=0))


def inside(points_m: Points, walls_m: Walls) -> NDArray[np.bool_]:
    """Which of the points (N, 2) lie in the room that the walls (K, 2, 2) make, to about 2 cm."""
    space = free_space(walls_m)
    off_grid = np.any(
        (points_m < walls_m.min(axis=(0, 1))) | (points_m > walls_m.max(axis=(0, 1))), axis=1
    )
    return np.asarray(space.inside[space.cells_of(points_m)] & ~off_grid)


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """Where a robot can drive and how: nodes (N, 2), and the lengths of the legs between them."""

    space: FreeSpace
    nodes_m: Points
    graph: sparse.csr_array
    clearance_m: float


def default_route(walls_m: Walls) -> NDArray[np.float64]:
    """A closed route (N, 2) through the room that keeps clear of its walls (K, 2, 2).

    The places to visit are picked one after the other, each as far from the others as can be;
    they are visited nearest first. A room with space for one place only gives one waypoint.
    Raises BadInput when a robot fits nowhere.
    """
    ways = _ways(free_space(walls_m), _CLEARANCES_M)
    return _locked(ways.nodes_m[_tour(ways)])


def route_far_from_walls(walls_m: Walls) -> NDArray[np.float64]:
    """The same with the most clearance that leaves at least three waypoints."""
    space = free_space(walls_m)
    for clearance_m in _FAR_CLEARANCES_M:
        if space.safe(space.centres_m, clearance_m).any():
            ways = _ways(space, (clearance_m, *_CLEARANCES_M))
            tour = _tour(ways)
            if len(tour) >= 3:
                return _locked(ways.nodes_m[tour])
    return default_route(walls_m)


def route_on_the_spot(walls_m: Walls) -> NDArray[np.float64]:
    """One waypoint (1, 2): the place farthest from any wall, where the robot turns round."""
    space = free_space(walls_m)
    clear_m = np.where(space.inside, space.clearance_m, -1.0).ravel()
    if clear_m.max() < ROBOT_RADIUS_M:
        raise BadInput(_NOWHERE)
    return _locked(space.centres_m[[int(np.argmax(clear_m))]])


def random_route(walls_m: Walls, seed: int) -> NDArray[np.float64]:
    """A closed route (N, 2) past twenty places drawn at random, the same for the same seed."""
    ways = _ways(free_space(walls_m), _CLEARANCES_M)
    places = np.random.default_rng(seed).integers(0, len(ways.nodes_m), _RANDOM_PLACES).tolist()
    _, parents = csgraph.dijkstra(
        ways.graph, directed=False, indices=places, return_predecessors=True
    )
    return _locked(ways.nodes_m[_joined(ways, places, list(parents), list(range(len(places))))])


def route_along_walls(walls_m: Walls) -> NDArray[np.float64]:
    """A closed route (N, 2) round the room, as near to its outer walls as the robot may come."""
    space = free_space(walls_m)
    for clearance_m in (_BESIDE_WALLS_M, ROBOT_RADIUS_M):
        label, count = ndimage.label(
            space.inside & (space.clearance_m >= clearance_m + space.cell_m)
        )
        if count:
            largest = 1 + int(np.argmax(np.bincount(label.ravel())[1:]))
            outline_m = space.points_m(_outline(label == largest))
            return _locked(_simplified(outline_m, space, clearance_m))
    raise BadInput(_NOWHERE)


def _locked(route_m: Points) -> NDArray[np.float64]:
    route_m.setflags(write=False)
    return route_m


def _ways(space: FreeSpace, clearances_m: Sequence[float]) -> Ways:
    """The largest part of the room that can be driven, with the first clearance that gives any."""
    for clearance_m in clearances_m:
        place, nodes_m = _lattice(space, clearance_m)
        if len(nodes_m):
            break
    else:
        raise BadInput(_NOWHERE)
    graph = _graph(space, place, nodes_m, clearance_m)
    _, part = csgraph.connected_components(graph, directed=False)
    largest = np.flatnonzero(part == np.argmax(np.bincount(part)))
    return Ways(space, nodes_m[largest], graph[largest][:, largest], clearance_m)


_AROUND = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))


def _outline(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The outer border of one connected patch, cells (N, 2) as row, col, counter-clockwise."""
    padded = np.pad(flags, 1)
    row, col = (int(v) for v in np.argwhere(padded)[0])
    start, way, cells = (row, col), 0, [(row, col)]
    for _ in range(4 * int(flags.sum()) + 8):
        for turn in range(-2, 6):
            step = (way + turn) % 8
            there = row + _AROUND[step][0], col + _AROUND[step][1]
            if padded[there]:
                break
        else:
            break  # a patch of one cell
        (row, col), way = there, step
        if there == start:
            break
        cells.append(there)
    return np.array(cells, dtype=np.intp) - 1


def _simplified(outline_m: Points, space: FreeSpace, clearance_m: float) -> Points:
    """A closed line of few corners that stays within a few cells of an outline (N, 2), and safe.

    Halves are cut at the point farthest from the chord (Ramer 1972, Douglas and Peucker 1973)
    until each leg is near and safe.
    """
    far = int(np.argmax(np.hypot(*(outline_m - outline_m[0]).T)))
    if far == 0:
        return outline_m[:1].copy()
    ring_m = np.concatenate([outline_m, outline_m[:1]])
    kept, open_legs = {0, far}, [(0, far), (far, len(outline_m))]
    while open_legs:
        first, last = open_legs.pop()
        if last - first < 2:
            continue
        start, way = ring_m[first], ring_m[last] - ring_m[first]
        inner = ring_m[first + 1 : last] - start
        length_m = max(float(np.hypot(*way)), 1e-9)
        away_m = np.abs(inner[:, 0] * way[1] - inner[:, 1] * way[0]) / length_m
        safe = space.safe_legs(ring_m[[first]], ring_m[[last]], clearance_m - space.cell_m)[0]
        if away_m.max() > 3.0 * space.cell_m or not safe:
            cut = first + 1 + int(np.argmax(away_m))
            kept.add(cut)
            open_legs += [(first, cut), (cut, last)]
    return outline_m[sorted(kept - {len(outline_m)})]


def free_space(walls_m: Walls) -> FreeSpace:
    """The cells of the room that the walls (K, 2, 2) make; gaps narrower than a cell are closed."""
    low, high = walls_m.min(axis=(0, 1)), walls_m.max(axis=(0, 1))
    cell_m = max(_CELL_M, float((high - low).max()) / _MAX_CELLS_ACROSS)
    origin_m = low - 3 * cell_m
    cols, rows = (np.ceil((high - low) / cell_m).astype(int) + 6).tolist()
    wall = np.zeros((rows, cols), dtype=np.bool_)
    for start, end in walls_m:
        steps = math.ceil(float(np.linalg.norm(end - start)) / (cell_m / 2)) + 1
        points_m = start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)
        col, row = np.floor((points_m - origin_m) / cell_m).astype(int).T
        wall[row, col] = True
    clearance_m = ndimage.distance_transform_edt(~wall) * cell_m
    corner = (float(origin_m[0]), float(origin_m[1]))
    return FreeSpace(corner, cell_m, clearance_m, _room_cells(wall, clearance_m))


def _room_cells(wall: NDArray[np.bool_], clearance_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The largest stretch that the walls close off from the rim, or the rectangle around them."""
    label, count = ndimage.label(~wall)
    rectangle = np.zeros_like(wall)
    rectangle[3:-3, 3:-3] = True
    roomy = np.bincount(label[clearance_m >= _CLEARANCES_M[-1]], minlength=count + 1)
    roomy[[0, label[0, 0]]] = 0
    room = int(np.argmax(roomy))
    if roomy[room] < _ENCLOSED_SHARE * rectangle.sum():
        return rectangle
    return np.asarray((label == room) | wall)


def _lattice(space: FreeSpace, clearance_m: float) -> tuple[NDArray[np.intp], Points]:
    """Safe points of a square lattice, as fine as a bounded number of them allows.

    Returns their column and row in the lattice (N, 2) and where they are (N, 2).
    """
    rows, cols = space.clearance_m.shape
    area_m2 = float((space.inside & (space.clearance_m >= clearance_m)).sum()) * space.cell_m**2
    stride = max(1, math.ceil(max(0.05, math.sqrt(area_m2 / _MAX_NODES)) / space.cell_m))
    place = np.argwhere(np.ones((-(-cols // stride), -(-rows // stride)), dtype=np.bool_))
    points_m = np.array(space.origin_m) + (place * stride + 0.5) * space.cell_m
    safe = space.safe(points_m, clearance_m)
    return place[safe], points_m[safe]


def _graph(
    space: FreeSpace, place: NDArray[np.intp], nodes_m: Points, clearance_m: float
) -> sparse.csr_array:
    """Lengths of the safe legs between neighbouring nodes, eight to each, as a sparse matrix."""
    number = np.full(place.max(axis=0) + 3, -1, dtype=np.intp)  # with an empty rim all around
    col, row = place.T + 1
    number[col, row] = np.arange(len(nodes_m))
    starts, ends = [], []
    for right, up in ((1, 0), (0, 1), (1, 1), (1, -1)):
        neighbour = number[col + right, row + up]
        starts.append(np.flatnonzero(neighbour >= 0))
        ends.append(neighbour[neighbour >= 0])
    a, b = np.concatenate(starts), np.concatenate(ends)
    safe = space.safe_legs(nodes_m[a], nodes_m[b], clearance_m)
    a, b = a[safe], b[safe]
    length_m = np.linalg.norm(nodes_m[a] - nodes_m[b], axis=1)
    return sparse.csr_array((length_m, (a, b)), shape=(len(nodes_m), len(nodes_m)))


def _tour(ways: Ways) -> list[int]:
    """Node numbers of a closed way past places far from each other, without idle ones."""
    graph = ways.graph
    places = [int(np.argmin(ways.nodes_m.sum(axis=1)))]
    distances, parents = [], []
    while True:
        distance, parent = csgraph.dijkstra(
            graph, directed=False, indices=places[-1], return_predecessors=True
        )
        distances.append(distance)
        parents.append(parent)
        nearest = np.min(distances, axis=0)
        if len(places) == MAX_WAYPOINTS or nearest.max() < WAYPOINT_SPACING_M:
            break
        places.append(int(np.argmax(nearest)))
    order, left = [0], set(range(1, len(places)))
    while left:
        order.append(min(left, key=lambda k: (distances[order[-1]][places[k]], k)))
        left.remove(order[-1])
    return _joined(ways, places, parents, order)


def _joined(
    ways: Ways, places: list[int], parents: list[NDArray[np.int32]], order: list[int]
) -> list[int]:
    """Node numbers of the closed way past places in an order, by trees of shortest ways."""
    tour: list[int] = []
    for here, there in zip(order, [*order[1:], order[0]], strict=True):
        if places[here] != places[there]:
            way = _way(parents[here], places[here], places[there])
            tour += _straightened(ways.space, ways.nodes_m, way, ways.clearance_m)[:-1]
    return tour or places[:1]


def _way(parent: NDArray[np.int32], start: int, end: int) -> list[int]:
    """The nodes from ``start`` to ``end`` along the tree of shortest ways from ``start``."""
    way = [end]
    while way[-1] != start:
        way.append(int(parent[way[-1]]))
    return way[::-1]


def _straightened(
    space: FreeSpace, nodes_m: Points, way: list[int], clearance_m: float
) -> list[int]:
    """The way without the nodes that a safe straight leg can pass by; both ends stay."""
    kept, at = [way[0]], 0
    while at < len(way) - 1:
        ahead = nodes_m[way[at + 1 :]]
        seen = space.safe_legs(np.broadcast_to(nodes_m[way[at]], ahead.shape), ahead, clearance_m)
        at += 1 + (int(np.flatnonzero(seen)[-1]) if seen.any() else 0)
        kept.append(way[at])
    return kept
