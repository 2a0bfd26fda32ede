"""Points in order, broken where neighbours lie too far apart: what the ordered methods work on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from mapping.segments.least_squares import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Order = Literal["time", "bearing", "path"]
# The shallowest angle at which a wall is still taken as one; coarse scans cannot be so strict.
BREAKPOINT_LAMBDA_RAD = math.radians(5.0)
_LAMBDA_STEPS = 2.5
_NEIGHBOURS = 16


@dataclass(frozen=True, slots=True)
class Chains:
    """``points_m`` (N, 2); chain c is ``offsets[c]`` to ``offsets[c + 1]``.

    A ``closed`` chain goes on from its last point to its first, and starts at a corner.
    """

    points_m: FloatArray
    offsets: NDArray[np.int64]
    closed: NDArray[np.bool_]

    def points_of(self, chain: int, first: int, count: int) -> FloatArray:
        """``count`` points of a chain from index ``first`` on, round its end where it is closed."""
        begin, end = int(self.offsets[chain]), int(self.offsets[chain + 1])
        if first + count <= end:
            return self.points_m[first : first + count]
        return self.points_m[begin + (first - begin + np.arange(count)) % (end - begin)]


def joined(parts: list[tuple[FloatArray, bool]]) -> Chains:
    """Chains from point arrays, each with whether it is closed (those then start at a corner)."""
    arrays = [from_corner(points) if closed else points for points, closed in parts]
    offsets = np.concatenate([[0], np.cumsum([len(points) for points in arrays])])
    points = np.concatenate(arrays) if arrays else np.empty((0, 2))
    return Chains(
        np.ascontiguousarray(points, np.float64),
        offsets.astype(np.int64),
        np.array([closed for _, closed in parts], np.bool_),
    )


def from_corner(points_m: FloatArray) -> FloatArray:
    """A closed polyline, started at the point farthest from its centroid: no wall's middle is."""
    away = points_m - points_m.mean(axis=0)
    return np.roll(points_m, -int(np.argmax((away**2).sum(axis=1))), axis=0)


def chains_from_points(
    points_m: FloatArray, *, order: Order, gap_m: float, closed: bool | None, origin_m: FloatArray
) -> Chains:
    """Put points (N, 2) in order and break them where neighbours are more than ``gap_m`` apart.

    Points that are not finite are left out; what they leave open is a gap like any other.
    ``closed`` None: where the two ends of all the points meet, after having been far apart.
    """
    from mapping.kernels.loops import break_at_gaps

    points = np.ascontiguousarray(points_m[np.isfinite(points_m).all(axis=1)], np.float64)
    if order == "bearing" and len(points):
        away = points - origin_m
        points = points[np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable")]
    elif order == "path":
        points = points[nearest_neighbour_path(points, gap_m)]
    offsets = break_at_gaps(points, gap_m)
    if len(points) == 0:
        return joined([])
    if closed is None:
        closed = _ends_meet(points, gap_m)
    if closed and len(offsets) == 2:
        return joined([(points, True)])
    if closed and math.dist(points[0], points[-1]) <= gap_m:
        points, offsets = _from_a_gap(points, offsets)
    return Chains(points, offsets, np.zeros(len(offsets) - 1, np.bool_))


def _ends_meet(points: FloatArray, gap_m: float) -> bool:
    away = np.hypot(*(points - points[0]).T)
    return bool(away[-1] <= gap_m and away.max() > 3.0 * gap_m)


def _from_a_gap(
    points: FloatArray, offsets: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.int64]]:
    """A circle with gaps starts behind one of them, so that no chain runs over its end."""
    first = int(offsets[1])
    shifted = np.concatenate([[0], offsets[2:] - first, [len(points)]])
    return np.roll(points, -first, axis=0), shifted.astype(np.int64)


def nearest_neighbour_path(points_m: FloatArray, gap_m: float) -> NDArray[np.int64]:
    """Indices (N,) that walk from the first point to the nearest one left, again and again.

    Where none is left within ``gap_m`` the walk goes on from the first point not yet visited.
    """
    from scipy.spatial import cKDTree

    if len(points_m) == 0:
        return np.empty(0, np.int64)
    # Repeated points would fill each other's lists of neighbours: walk over each place once.
    places, first, place_of = np.unique(points_m, axis=0, return_index=True, return_inverse=True)
    tree = cKDTree(places)
    count = min(_NEIGHBOURS, len(places))
    _, near = tree.query(places, count)
    near = near.reshape(len(places), count)
    left = np.ones(len(places), np.bool_)
    walk: list[int] = []
    for start in place_of.reshape(-1)[np.sort(first)]:
        at: int | None = int(start)
        while at is not None and left[at]:
            left[at] = False
            walk.append(at)
            at = _next_place(tree, places, near, left, at, gap_m)
    rank = np.empty(len(places), np.int64)
    rank[walk] = np.arange(len(walk))
    return np.argsort(rank[place_of.reshape(-1)], kind="stable")


def _next_place(
    tree: cKDTree,
    places: FloatArray,
    near: NDArray[np.int64],
    left: NDArray[np.bool_],
    at: int,
    gap_m: float,
) -> int | None:
    """The nearest place not yet visited within the gap: among the listed ones, or further out."""
    candidates = near[at]
    count = len(candidates)
    while True:
        open_ones = candidates[left[candidates]]
        if len(open_ones):
            best = int(open_ones[0])
            return best if math.dist(places[at], places[best]) <= gap_m else None
        farthest = math.dist(places[at], places[candidates[-1]])
        if count == len(places) or farthest > gap_m:
            return None
        count = min(4 * count, len(places))
        _, candidates = tree.query(places[at], count)


def chains_from_scan(ranges_m: FloatArray, bearings_rad: FloatArray, *, sigma_m: float) -> Chains:
    """The returns of a scan (N,), around the sensor, broken by the adaptive breakpoint rule.

    Beams that came back with nothing are left out and leave a wider step in bearing. A scan that
    runs round the circle without a break is one closed chain.
    """
    from mapping.kernels.loops import scan_chains

    bearings = np.ascontiguousarray(bearings_rad, np.float64)
    step_rad = (
        abs(float(bearings[-1] - bearings[0])) / (len(bearings) - 1) if len(bearings) > 1 else 0
    )
    shallowest = BREAKPOINT_LAMBDA_RAD
    if math.isfinite(step_rad):
        shallowest = min(max(shallowest, _LAMBDA_STEPS * step_rad), math.pi / 2)
    points, offsets, closed = scan_chains(
        np.ascontiguousarray(ranges_m, np.float64),
        bearings,
        math.sin(shallowest),
        math.cos(shallowest),
        sigma_m,
    )
    if len(points) == 0:
        return joined([])
    if closed:
        return joined([(points, True)])
    return Chains(points, offsets, np.zeros(len(offsets) - 1, np.bool_))
