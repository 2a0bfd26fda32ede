"""Straight pieces of wall that many readings of thin beams saw, and what would make them thinner.

If a mount is turned or a pose late, the same piece of wall is drawn at another place from each
direction: the points of a patch scatter. Residuals count along the beam, in the unit that was
measured: else shorter ranges would always seem better.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.diagnosis.hypothesis import Hypothesis, Session
from mapping.diagnosis.pose_quality import heading_noise_rad
from mapping.readings import Readings
from mapping.scoring.held_out import Mixture
from recorder.columns import Floats, Ints

Flags = NDArray[np.bool_]

PATCH_M = 1.2
_FEWEST = 8  # points of a patch
_DIRECTIONS = 36
_WINDOW_M = 0.03
_GRAZING = 0.3  # cosine of the angle of incidence: flatter beams say little of where a wall is
_MOST_WALLS = 6  # of a square
_LEAST_SHARE = 0.12  # of the points that are left in it
TUKEY = 4.0  # standard deviations beyond which a point does not count
_SPREAD_M = 0.008
_POSE_M, _POSE_RAD = 0.004, math.radians(0.5)  # no pose is better than that
_MOST_RAD, _GAP_S = math.radians(4.0), 0.5
_SHORTEST_M = 0.2  # a bent wall is cut in two, and again, until it is that long
_CORNER, _ALONG = 0.4, 0.05  # sines: of walls that are two, of a beam and a wall that never meet
_REACHES_M = 0.1  # beyond the points that were seen of it
_BENT_M, _SURELY = 0.004, 3.0
MOST_POINTS = 12_000
NO_FAULT = Hypothesis()


@dataclass(frozen=True, slots=True)
class Points:
    """What thin beams met, K of them.

    ``row`` counts readings, ``axis`` all axes of the session. ``at_m`` (K, 2) are the places,
    ``heading_rad`` the directions of the beams, ``range_m`` the ranges as they are taken,
    ``spread_m`` how they scatter by themselves, ``pose_rad`` how headings do; ``reach_m`` is the
    farthest that could have been measured.
    """

    row: Ints
    axis: Ints
    at_m: Floats
    heading_rad: Floats
    range_m: Floats
    spread_m: Floats
    reach_m: Floats
    block: Ints
    pose_rad: float = _POSE_RAD

    def spread_along(self, rows: Ints, cosine: Floats) -> Floats:
        """How ranges scatter where walls are met at those cosines of incidence, for poses err."""
        turned_m = self.range_m[rows] * np.sqrt(1.0 - np.square(cosine)) * self.pose_rad
        of_pose = np.square(turned_m) + _POSE_M**2
        return np.sqrt(np.square(self.spread_m[rows]) + of_pose / np.square(cosine))

    def __len__(self) -> int:
        return len(self.range_m)


def _drawn(axes: Ints, most: int) -> Ints:
    """At most so many, always the same: every k-th would be the same few beams of each scan."""
    if len(axes) <= most:
        return axes
    return np.random.default_rng(0).choice(axes, most, replace=False)


class ThinBeams:
    """The echoes of some sensors of a session for any hypothesis; at most so many, drawn evenly,
    and of each sensor an equal part of those."""

    def __init__(
        self, session: Session, sensors: Sequence[str], block: Ints, most: int = MOST_POINTS
    ) -> None:
        readings = session.readings
        self.session, self.block = session, block
        self._row = np.repeat(np.arange(len(readings)), np.diff(readings.begins))
        wanted = np.array([sensor.name in sensors for sensor in readings.sensors], np.bool_)
        of_axis = readings.sensor[self._row]
        seen = np.isfinite(readings.ranges_m)
        each = most // max(int(wanted.sum()), 1)
        self.axis = np.sort(np.concatenate([
            np.zeros(0, np.int64),
            *(_drawn(np.flatnonzero(seen & (of_axis == k)), each) for k in np.flatnonzero(wanted)),
        ]))  # fmt: skip
        errors = np.array([Mixture.of(sensor).error for sensor in readings.sensors])
        error = errors[readings.sensor[self._row[self.axis]]]
        noise_rad = heading_noise_rad(session.placement.track, _GAP_S)
        self._pose_rad = min(max(_POSE_RAD, noise_rad), _MOST_RAD)
        self._spread_m = _SPREAD_M + error * readings.ranges_m[self.axis]

    def points(self, hypothesis: Hypothesis) -> Points:
        """Where the echoes lie, if a hypothesis holds."""
        return self.placed(self.session.under(hypothesis))

    def placed(self, readings: Readings) -> Points:
        """Where they lie, if the session's readings are those."""
        row, start, range_m = self._row[self.axis], readings.world_from_sensor, readings.ranges_m
        heading_rad = start.heading_rad[row] + readings.bearings_rad[self.axis]
        along_m = range_m[self.axis]
        at_m = np.column_stack([
            start.x_m[row] + along_m * np.cos(heading_rad),
            start.y_m[row] + along_m * np.sin(heading_rad),
        ])  # fmt: skip
        return Points(
            row, self.axis, at_m, heading_rad, along_m, self._spread_m, readings.reach_m[self.axis],
            self.block[row], self._pose_rad,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Patches:
    """Which patch each point is of (K,), -1: none; the normal of its wall (K, 2), and its weight.

    ``behind_m`` (K,) is how much farther than the wall the point lies along its normal, which
    points away from the sensor; ``expected_m`` the range at which its beam meets the wall, and
    ``spread_m`` how the measured one scatters about it, the noise of poses included.
    """

    patch: Ints
    normal: Floats
    weight: Floats
    behind_m: Floats
    expected_m: Floats
    spread_m: Floats

    @property
    def count(self) -> int:
        """How many patches there are."""
        return int(self.patch.max(initial=-1)) + 1


@dataclass(frozen=True, slots=True)
class _Wall:
    """A line through some of N points: which of them are near, the rest as of :class:`Patches`."""

    normal: Floats
    near: Flags
    weight: Floats
    behind_m: Floats
    spread_m: Floats
    cosine: Floats
    across_m: Floats

    def cut(self) -> tuple[Flags, ...]:
        """Its near points; in two halves where the line is bent, and long enough to be cut."""
        used = self.near & (self.weight > 0)
        low, high = self.across_m[used].min(), self.across_m[used].max()
        if high - low <= _SHORTEST_M:
            return (self.near,)
        t, w = self.across_m[used], self.weight[used]
        terms = np.column_stack([np.ones(len(t)), t, np.square(2.0 * t / (high - low))])
        covariance = np.linalg.pinv(terms.T @ (terms * w[:, None]))
        bend_m = float((covariance @ (terms.T @ (w * self.behind_m[used])))[2])
        error_m = math.sqrt(max(float(covariance[2, 2]), 0.0))
        if abs(bend_m) < max(_BENT_M, _SURELY * error_m):
            return (self.near,)
        first = self.across_m < 0.5 * (low + high)
        return self.near & first, self.near & ~first


def find_patches(
    points: Points, *, shift: float = 0.0, wide: float = 1.0, size_m: float = PATCH_M
) -> Patches:
    """Lay a grid over the points and find the straightest walls in each of its squares."""
    cells = np.floor(points.at_m / size_m + shift).astype(np.int64)
    _, of = np.unique(cells, axis=0, return_inverse=True)
    of = of.reshape(-1)
    order = np.argsort(of, kind="stable")
    bounds = np.flatnonzero(np.diff(np.concatenate([[-1], of[order], [-2]])))
    patch = np.full(len(points), -1)
    normal = np.zeros((len(points), 2))
    weight, behind_m, expected_m, spread_m = (np.zeros(len(points)) for _ in range(4))
    beams = np.column_stack([np.cos(points.heading_rad), np.sin(points.heading_rad)])
    count = 0
    for first, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        for rows, wall in _walls_of(points, beams, order[first:end], wide):
            mine = rows[wall.near]
            patch[mine], count = count, count + 1
            normal[mine], weight[mine] = wall.normal, wall.weight[wall.near]
            behind_m[mine], spread_m[mine] = wall.behind_m[wall.near], wall.spread_m[wall.near]
            expected_m[mine] = points.range_m[mine] - behind_m[mine] / wall.cosine[wall.near]
    found = Patches(patch, normal, weight, behind_m, expected_m, spread_m)
    return replace(found, weight=np.where(_in_corners(points, beams, found), 0.0, weight))


def _in_corners(points: Points, beams: Floats, patches: Patches) -> Flags:
    """Points whose beams meet another wall about as far away (K,): they may be of either.

    Taken for the wrong one they lie before it at a corner, the more the flatter they meet it, as if
    all ranges were too long. Chosen by where the walls are, not by what was measured.
    """
    unsure = np.zeros(len(points), np.bool_)
    used = np.flatnonzero(patches.weight > 0)
    used = used[np.argsort(patches.patch[used], kind="stable")]
    _, first = np.unique(patches.patch[used], return_index=True)
    if not len(first):
        return unsure
    members = np.split(used, first[1:])
    normal = patches.normal[used[first]]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    of = np.repeat(np.arange(len(first)), [len(rows) for rows in members])
    across_m = (points.at_m[used] * tangent[of]).sum(axis=1)
    low_m = np.minimum.reduceat(across_m, first) - _REACHES_M
    high_m = np.maximum.reduceat(across_m, first) + _REACHES_M
    at_m = points.at_m[used[first]]
    offset_m = (at_m * normal).sum(axis=1) - patches.behind_m[used[first]]
    middle_m = normal * offset_m[:, None] + tangent * (0.5 * (low_m + high_m))[:, None]
    apart_m = np.hypot(*(middle_m[:, None] - middle_m).transpose(2, 0, 1))
    half_m = 0.5 * (high_m - low_m)
    near = (apart_m < half_m[:, None] + half_m) & (np.abs(normal @ tangent.T) > _CORNER)
    for k, other in np.argwhere(near):
        rows = members[k]
        closing = beams[rows] @ normal[other]
        closing = np.where(np.abs(closing) < _ALONG, np.nan, closing)
        ahead_m = (offset_m[other] - points.at_m[rows] @ normal[other]) / closing
        met_m = (points.at_m[rows] + ahead_m[:, None] * beams[rows]) @ tangent[other]
        behind_m = points.range_m[rows] - patches.expected_m[rows]
        both = np.abs(ahead_m + behind_m) < TUKEY * patches.spread_m[rows]
        unsure[rows[both & (met_m > low_m[other]) & (met_m < high_m[other])]] = True
    return unsure


def _walls_of(
    points: Points, beams: Floats, rows: Ints, wide: float
) -> Iterator[tuple[Ints, _Wall]]:
    """The walls among some points: the sides of a corner, or both faces of a board."""
    for _ in range(_MOST_WALLS):
        wall = _wall(points, beams, rows, wide)
        if wall is None:
            return
        waiting = [(rows, part) for part in wall.cut()]
        if len(waiting) == 1:
            yield rows, wall
            waiting = []
        while waiting:
            its, part = waiting.pop()
            shorter = _wall(points, beams, its[part], wide)
            if shorter is None:
                continue
            parts = shorter.cut()
            if len(parts) == 1:
                yield its[part], shorter
            else:
                waiting += [(its[part], each) for each in parts]
        rows = rows[~wall.near]


def _wall(points: Points, beams: Floats, rows: Ints, wide: float) -> _Wall | None:
    """The line that most points lie near, refined; None where it is no wall."""
    if len(rows) < _FEWEST:
        return None
    at_m, beams, range_m = points.at_m[rows], beams[rows], points.range_m[rows]
    middle = at_m.mean(axis=0)
    local = at_m - middle
    found = _roughly(local, beams)
    if found is None:
        return None
    n, weight = found
    for _ in range(4):
        mass = weight.sum()
        if mass < 1e-9:
            return None
        centre = weight @ local / mass
        moved = local - centre
        n = _flattest((moved * weight[:, None]).T @ moved, n)
        cosine = beams @ n
        off_n = local @ n - centre @ n
        facing = cosine >= _GRAZING  # and from one side
        cosine = np.where(facing, cosine, 1.0)
        spread_m = points.spread_along(rows, cosine)
        along = off_n / cosine
        z = along / (wide * spread_m)
        # chosen by where the wall is, not by what was measured: the reach would cut one side off
        usable = facing & (range_m - along + 2.5 * points.spread_m[rows] < points.reach_m[rows])
        inside = usable & (np.abs(z) < TUKEY)
        weight = np.where(inside, np.square(1.0 - np.square(z / TUKEY)), 0.0)
        weight = weight / np.square(spread_m * cosine)
    near = facing & (np.abs(z) < TUKEY)
    if (weight > 0).sum() < _FEWEST or near.mean() < _LEAST_SHARE:
        return None
    across_m = moved[:, 1] * n[0] - moved[:, 0] * n[1]
    return _Wall(n, near, weight, off_n, spread_m, cosine, across_m)


def _roughly(local: Floats, beams: Floats) -> tuple[Floats, Floats] | None:
    """The normal of the strip that holds most points, and which (1.0, else 0.0), by voting."""
    angles = np.arange(_DIRECTIONS) * math.pi / _DIRECTIONS
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    off = local @ normals.T
    bins = np.floor(off / _WINDOW_M).astype(np.int64)
    bins -= bins.min()
    flat = bins + np.arange(_DIRECTIONS) * (bins.max() + 2)
    counts = np.bincount(flat.ravel(), minlength=_DIRECTIONS * (bins.max() + 2))
    k, low = divmod(int(np.argmax(counts[:-1] + counts[1:])), int(bins.max()) + 2)
    n = normals[k]
    inside = (bins[:, k] == low) | (bins[:, k] == low + 1)
    n = n if np.sum(beams[inside] @ n) >= 0 else -n
    inside &= beams @ n > 0
    return (n, inside.astype(np.float64)) if inside.any() else None


def _flattest(spread: Floats, like: Floats) -> Floats:
    """The direction in which points scatter least, turned as ``like``; of a (2, 2) matrix."""
    turned_rad = 0.5 * math.atan2(2.0 * spread[0, 1], spread[0, 0] - spread[1, 1])
    n = np.array([-math.sin(turned_rad), math.cos(turned_rad)])
    return n if n @ like >= 0 else -n
