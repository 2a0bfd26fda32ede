"""How well line segments give the walls of a room, by length: for benchmarks, without a grid.

Walls and lines are walked along in steps of a centimetre. A step of a wall is *found* where a line
lies within the tolerance and runs in about its direction; a step of a line is *right* where such a
wall lies. The shares of the two are completeness (recall) and correctness (precision), as they are
known from the extraction of roads (Heipke, Mayer, Wiedemann and Jamet 1997). They do not see a wall
that came out in pieces, or twice: lines per wall does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.scoring.cells import along
from mapping.scoring.lines import (
    TOLERANCES_M,
    angle_between,
    median_offset_m,
    nearest,
    normals_of,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

STEP_M = 0.01
_ON_WALL = 0.5  # of a line's length, for it to have an angle
_PIECE_M = 0.05  # so much of a wall belongs to each of its lines
_RAY_STEP_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class Within:
    """Shares of length (0 to 1; NaN of nothing) within one tolerance."""

    tolerance_m: float
    completeness: float
    correctness: float


@dataclass(frozen=True, slots=True)
class SegmentScores:
    """How good the lines are; figures that nothing gives are NaN.

    ``wall_m`` is the length of the walls that count, ``line_m`` that of all lines. ``offset_m`` is
    the median distance of the lines from their walls, negative in front of them, on the side from
    which they were seen, as everywhere; ``spread_m`` the median of its size. ``angle_rad`` is the
    median over the lines of the size of the angle to their walls. ``lines_per_wall`` counts the
    lines of each wall that was found.
    """

    lines: int
    walls: int
    line_m: float
    wall_m: float
    within: tuple[Within, ...]
    offset_m: float
    spread_m: float
    angle_rad: float
    lines_per_wall: float


@dataclass(frozen=True, slots=True)
class Steps:
    """Places (S, 2) along pieces, the direction at each and the number of its piece, (S,)."""

    places_m: Floats
    directions_rad: Floats
    piece: Ints


def segment_scores(
    lines_m: Floats,
    walls_m: Floats,
    *,
    counts: Flags | None = None,
    seen_from_m: Floats | None = None,
    tolerances_m: tuple[float, ...] = TOLERANCES_M,
) -> SegmentScores:
    """Lines (L, 2, 2) against walls (K, 2, 2), two ends each, metres.

    ``counts`` (S,): which steps of the walls (:func:`steps_along`) could be observed, as
    :func:`observed_steps` finds them; default: all. Lines on other walls are right all the same.
    ``seen_from_m`` (N, 2): where the sensors were; without them ``offset_m`` is NaN.
    """
    lines_m, walls_m = (
        np.asarray(ends, np.float64).reshape(-1, 2, 2) for ends in (lines_m, walls_m)
    )
    on_walls, on_lines = steps_along(walls_m), steps_along(lines_m)
    counts = np.ones(len(on_walls.piece), np.bool_) if counts is None else counts
    found_m = nearest(on_walls.places_m, on_walls.directions_rad, lines_m)[0][counts]
    right_m, wall_of = nearest(on_lines.places_m, on_lines.directions_rad, walls_m)
    matched = right_m <= max(tolerances_m)
    within = tuple(
        Within(tolerance_m, _share(found_m <= tolerance_m), _share(right_m <= tolerance_m))
        for tolerance_m in tolerances_m
    )
    return SegmentScores(
        lines=len(lines_m),
        walls=len(walls_m),
        line_m=float(np.hypot(*(lines_m[:, 1] - lines_m[:, 0]).T).sum()),
        wall_m=float(counts.sum() * STEP_M),
        within=within,
        offset_m=_offset(on_lines.places_m[matched], walls_m[wall_of[matched]], seen_from_m),
        spread_m=_median(right_m[matched]),
        angle_rad=_angle(on_lines, matched, walls_m, wall_of),
        lines_per_wall=_lines_per_wall(on_lines.piece[matched], wall_of[matched]),
    )


def steps_along(ends_m: Floats) -> Steps:
    """Places along pieces (K, 2, 2), about a centimetre apart."""
    return Steps(*along(ends_m, STEP_M))


def observed_steps(
    walls_m: Floats, from_m: Floats, headings_rad: Floats, beam_width_rad: float, reach_m: float
) -> Flags:
    """Which steps (S,) of the walls (K, 2, 2) some reading of a sensor could have met.

    Readings are at ``from_m`` (N, 2), along ``headings_rad`` (N,), map frame. A step counts when
    it is the first thing on a ray in the beam, within reach; rays stand a degree apart.
    """
    steps = steps_along(walls_m)
    seen = np.zeros(len(steps.piece), np.bool_)
    half = beam_width_rad / 2.0
    rays = np.linspace(-half, half, max(int(2.0 * half / _RAY_STEP_RAD) + 1, 3))
    for turn in rays.tolist():
        hit_m, wall, far_along_m = _first_wall(walls_m, from_m, headings_rad + turn)
        near = hit_m <= reach_m
        if not near.any():
            continue
        # A ray stands for what lies between it and its neighbours.
        foot_m = hit_m[near] * (rays[1] - rays[0]) / 2.0 + STEP_M / 2.0
        _mark(seen, steps, walls_m, wall[near], far_along_m[near], foot_m)
    return seen


def _first_wall(
    walls_m: Floats, from_m: Floats, headings_rad: Floats
) -> tuple[Floats, Ints, Floats]:
    """Distance to the first wall on each ray (N,), its number, and how far along it, metres."""
    best = np.full(len(from_m), np.inf)
    wall, along = np.zeros(len(from_m), np.int64), np.zeros(len(from_m))
    ray = np.column_stack([np.cos(headings_rad), np.sin(headings_rad)])
    for k, (a, b) in enumerate(walls_m):
        way = b - a
        cross = ray[:, 0] * way[1] - ray[:, 1] * way[0]
        d = a - from_m
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (d[:, 0] * way[1] - d[:, 1] * way[0]) / cross
            share = (d[:, 0] * ray[:, 1] - d[:, 1] * ray[:, 0]) / cross
        hits = (far > 0.0) & (far < best) & (share >= 0.0) & (share <= 1.0)
        best[hits], wall[hits] = far[hits], k
        along[hits] = share[hits] * math.hypot(way[0], way[1])
    return best, wall, along


def _mark(
    seen: Flags, steps: Steps, walls_m: Floats, wall: Ints, along_m: Floats, foot_m: Floats
) -> None:
    """Mark the steps within ``foot_m`` of places on walls."""
    begins = np.searchsorted(steps.piece, np.arange(len(walls_m) + 1))
    low, high = begins[wall], begins[wall + 1]
    first = low + np.floor((along_m - foot_m) / STEP_M).astype(np.int64)
    end = low + np.ceil((along_m + foot_m) / STEP_M).astype(np.int64)
    change = np.zeros(len(seen) + 1, np.int64)
    np.add.at(change, np.clip(first, low, high), 1)
    np.add.at(change, np.clip(end, low, high), -1)
    seen |= np.cumsum(change[:-1]) > 0


def _offset(places_m: Floats, walls_m: Floats, seen_from_m: Floats | None) -> float:
    """Median distance of places (M, 2) from their walls (M, 2, 2), by the side seen."""
    if seen_from_m is None or not len(places_m) or not len(seen_from_m):
        return math.nan
    from scipy.spatial import cKDTree

    stood_m = seen_from_m[cKDTree(seen_from_m).query(places_m)[1]]
    side = np.sign(((stood_m - walls_m[:, 0]) * normals_of(walls_m)).sum(axis=1))
    return median_offset_m(places_m, walls_m, side)


def _angle(on_lines: Steps, matched: Flags, walls_m: Floats, wall_of: Ints) -> float:
    """Median over the lines that lie on walls of the angle to the wall that most of each is on."""
    way = walls_m[:, 1] - walls_m[:, 0]
    angles_of_walls = np.arctan2(way[:, 1], way[:, 0])
    angles = []
    for line in np.unique(on_lines.piece):
        mine = on_lines.piece == line
        here = mine & matched
        if here.sum() >= _ON_WALL * mine.sum():
            wall = np.bincount(wall_of[here]).argmax()
            angles.append(
                angle_between(on_lines.directions_rad[here][:1], angles_of_walls[wall])[0]
            )
    return _median(np.array(angles))


def _lines_per_wall(line: Ints, wall: Ints) -> float:
    """How many lines share a wall, over the walls that have one."""
    pairs, steps = np.unique(np.column_stack([wall, line]), axis=0, return_counts=True)
    pairs = pairs[steps * STEP_M >= _PIECE_M]
    return len(pairs) / len(np.unique(pairs[:, 0])) if len(pairs) else math.nan


def _share(flags: Flags) -> float:
    return float(flags.mean()) if len(flags) else math.nan


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else math.nan
