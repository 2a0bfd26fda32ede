"""How right the lines of a map are: by their length, against the walls that could be seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from mapping.scoring.cells import WALL_STEP_M, along, lies_on, looked_up
from mapping.scoring.truth import Floats, Truth

Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

TOLERANCES_M = (0.02, 0.05, 0.10)
_USUAL_M = 0.05
_MATCH_RAD = math.radians(15.0)  # a line that runs otherwise is not the wall's, however near
_BESIDE_M = 0.05  # where it is looked up which side of a wall could be seen
_LEAST_PLACES = 3  # centimetres of a wall that a line must explain to count as a piece of it


@dataclass(frozen=True, slots=True)
class WithinTolerance:
    """Shares of length within a distance, in about the right direction.

    ``completeness`` (recall): of the seen wall, that a line explains; ``correctness`` (precision):
    of the lines, that lies on a wall, seen or not.
    """

    tolerance_m: float
    completeness: float
    correctness: float


@dataclass(frozen=True, slots=True)
class LineScore:
    """How right the lines of one ``source`` (grid or raw) are.

    ``fragmentation``: lines to a wall that was found. ``offset_m``: how far right lines (within
    10 cm) lie from their wall, the median, negative on the side from which it was seen.
    ``angle_deg``: how much they are turned, the median by length. ``false_lines``: lines of which
    less than half lies within 5 cm of a wall.
    """

    source: str
    lines: int
    length_m: float
    within: tuple[WithinTolerance, ...]
    fragmentation: float
    offset_m: float
    angle_deg: float
    false_lines: int


def score_lines(
    source: str, lines_m: Floats, geometry: GridGeometry, truth: Truth, seen: Flags
) -> LineScore:
    """Judge lines (L, 2, 2) in metres; ``seen`` (rows, cols) are the cells that could be seen."""
    walls_m = truth.walls_m
    on_walls, wall_rad, wall_of = along(walls_m, WALL_STEP_M)
    visible = lies_on(on_walls, seen & truth.wall_cells(geometry), geometry)
    on_walls, wall_rad, wall_of = on_walls[visible], wall_rad[visible], wall_of[visible]
    on_lines, line_rad, line_of = along(lines_m, WALL_STEP_M)
    directed = truth.directed
    missed_m, by = nearest(on_walls, wall_rad if directed else None, lines_m)
    off_m, on = nearest(on_lines, line_rad if directed else None, walls_m)
    within = tuple(
        WithinTolerance(tolerance_m, _share(missed_m <= tolerance_m), _share(off_m <= tolerance_m))
        for tolerance_m in TOLERANCES_M
    )
    right = off_m <= _USUAL_M
    near = np.flatnonzero(off_m <= TOLERANCES_M[-1])
    turned = (
        angle_between(line_rad[near], _directions(walls_m)[on[near]]) if directed else np.zeros(0)
    )
    return LineScore(
        source=source,
        lines=len(lines_m),
        length_m=float(np.linalg.norm(np.diff(lines_m, axis=1), axis=-1).sum()),
        within=within,
        fragmentation=_fragmentation(wall_of, by, missed_m <= _USUAL_M),
        offset_m=_offset(on_lines[near], walls_m[on[near]], geometry, seen),
        angle_deg=math.degrees(float(np.median(turned))) if len(turned) else math.nan,
        false_lines=sum(
            bool(right[line_of == line].mean() < 0.5) for line in range(len(lines_m))
        ),
    )  # fmt: skip


def nearest(places_m: Floats, directions: Floats | None, pieces_m: Floats) -> tuple[Floats, Ints]:
    """How far each place (N, 2) is from the nearest piece (K, 2, 2), and which that is.

    ``directions`` (N,): only pieces that run in about the place's direction count. +Inf and -1
    where there is none.
    """
    least, which = np.full(len(places_m), np.inf), np.full(len(places_m), -1)
    for number, ((a, b), heading) in enumerate(zip(pieces_m, _directions(pieces_m), strict=True)):
        way = b - a
        share = np.clip((places_m - a) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
        away = np.hypot(*(a + share[:, None] * way - places_m).T)
        if directions is not None:
            away = np.where(angle_between(directions, heading) < _MATCH_RAD, away, np.inf)
        nearer = away < least
        least[nearer], which[nearer] = away[nearer], number
    return least, which


def _directions(pieces_m: Floats) -> Floats:
    way = pieces_m[:, 1] - pieces_m[:, 0]
    return np.asarray(np.arctan2(way[:, 1], way[:, 0]))


def angle_between(a_rad: Floats, b_rad: Floats | float) -> Floats:
    """The angle between undirected lines, 0 to π/2."""
    turned: Floats = np.abs((a_rad - b_rad + math.pi / 2.0) % math.pi - math.pi / 2.0)
    return turned


def _share(flags: Flags) -> float:
    return float(flags.mean()) if len(flags) else math.nan


def _fragmentation(wall_of: Ints, line: Ints, found: Flags) -> float:
    """The mean number of lines to a wall that has any."""
    pairs, places = np.unique(
        np.column_stack([wall_of[found], line[found]]), axis=0, return_counts=True
    )
    walls = pairs[places >= _LEAST_PLACES, 0]
    return len(walls) / len(np.unique(walls)) if len(walls) else math.nan


def _offset(places_m: Floats, pieces_m: Floats, geometry: GridGeometry, seen: Flags) -> float:
    """The median offset of places (N, 2) from their walls (N, 2, 2), by the side seen."""
    normal = normals_of(pieces_m)
    off_m = ((places_m - pieces_m[:, 0]) * normal).sum(axis=1)
    foot_m = places_m - off_m[:, None] * normal
    beside_m = _BESIDE_M * normal
    left, right = (looked_up(seen, foot_m + side_m, geometry) for side_m in (beside_m, -beside_m))
    side = left.astype(np.float64) - right  # where both sides are seen, neither is in front
    return median_offset_m(places_m, pieces_m, side)


def median_offset_m(places_m: Floats, pieces_m: Floats, seen_from: Floats) -> float:
    """How far places (N, 2) lie from the lines of their walls (N, 2, 2), the median; NaN of none.

    ``seen_from`` (N,) is the side from which each wall was seen: 1 its left, -1 its right, 0 is not
    counted. Negative: in front of the wall, on that side; positive: behind it.
    """
    off_m = ((places_m - pieces_m[:, 0]) * normals_of(pieces_m)).sum(axis=1)
    counted = seen_from != 0.0
    signed_m = -off_m[counted] * np.sign(seen_from[counted])
    return float(np.median(signed_m)) if len(signed_m) else math.nan


def normals_of(pieces_m: Floats) -> Floats:
    """Unit vectors (N, 2) to the left of pieces (N, 2, 2)."""
    way = pieces_m[:, 1] - pieces_m[:, 0]
    length = np.hypot(way[:, 0], way[:, 1])
    return np.asarray(np.column_stack([-way[:, 1], way[:, 0]]) / length[:, None])
