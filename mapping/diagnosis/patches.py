"""Straight pieces of wall that many readings of thin beams saw, and what would make them thinner.

If a mount is turned or a pose late, the same piece of wall is drawn at another place from each
direction: the points of a patch scatter. Residuals count along the beam, in the unit that was
measured: else shorter ranges would always seem better.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.diagnosis.hypothesis import Hypothesis, Session
from mapping.readings import Readings
from mapping.scoring.held_out import Mixture
from recorder.columns import Floats, Ints

PATCH_M = 0.2
_FEWEST = 8  # points of a patch
_DIRECTIONS = 36
_WINDOW_M = 0.03
_GRAZING = 0.25  # cosine of the angle of incidence: flatter beams say little of where a wall is
_TUKEY = 4.0  # standard deviations beyond which a point does not count
_SPREAD_M = 0.008
MOST_POINTS = 20_000
NO_FAULT = Hypothesis()


@dataclass(frozen=True, slots=True)
class Points:
    """What thin beams met, K of them.

    ``row`` counts readings, ``axis`` all axes of the session. ``at_m`` (K, 2) are the places, ``heading_rad``
    the directions of the beams, ``range_m`` the ranges as they are taken, ``spread_m`` how they
    scatter; ``reach_m`` is the farthest that could have been measured.
    """

    row: Ints
    axis: Ints
    at_m: Floats
    heading_rad: Floats
    range_m: Floats
    spread_m: Floats
    reach_m: Floats
    block: Ints

    def __len__(self) -> int:
        return len(self.range_m)


class ThinBeams:
    """The echoes of some sensors of a session, for any hypothesis."""

    def __init__(self, session: Session, sensors: Sequence[str], block: Ints) -> None:
        readings = session.readings
        self.session, self.block = session, block
        self._row = np.repeat(np.arange(len(readings)), np.diff(readings.begins))
        wanted = np.array([sensor.name in sensors for sensor in readings.sensors], np.bool_)
        mine = wanted[readings.sensor[self._row]] & np.isfinite(readings.ranges_m)
        axes = np.flatnonzero(mine)
        self.axis = axes[:: max(1, len(axes) // MOST_POINTS)]
        errors = np.array([Mixture.of(sensor).error for sensor in readings.sensors])
        error = errors[readings.sensor[self._row[self.axis]]]
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
            self.block[row],
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Patches:
    """Which patch each point is of (K,), -1: none; the normal of its wall (K, 2), and its weight.

    ``behind_m`` (K,) is how much farther than the wall the point lies along its normal, which
    points away from the sensor; ``expected_m`` the range at which its beam meets the wall.
    """

    patch: Ints
    normal: Floats
    weight: Floats
    behind_m: Floats
    expected_m: Floats

    @property
    def count(self) -> int:
        """How many patches there are."""
        return int(self.patch.max(initial=-1)) + 1


def find_patches(points: Points, *, shift: float = 0.0, wide: float = 1.0) -> Patches:
    """Lay a grid over the points and find the straightest wall in each of its squares."""
    cells = np.floor(points.at_m / PATCH_M + shift).astype(np.int64)
    _, of = np.unique(cells, axis=0, return_inverse=True)
    of = of.reshape(-1)
    order = np.argsort(of, kind="stable")
    bounds = np.flatnonzero(np.diff(np.concatenate([[-1], of[order], [-2]])))
    patch = np.full(len(points), -1)
    normal = np.zeros((len(points), 2))
    weight, behind_m, expected_m = (np.zeros(len(points)) for _ in range(3))
    beams = np.column_stack([np.cos(points.heading_rad), np.sin(points.heading_rad)])
    count = 0
    for first, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        rows = order[first:end]
        for _ in range(2):  # a corner, or both faces of a board
            if len(rows) < _FEWEST:
                break
            found = _wall(
                points.at_m[rows],
                beams[rows],
                points.spread_m[rows],
                points.range_m[rows],
                points.reach_m[rows],
                wide,
            )
            if found is None:
                break
            near = found[3]
            mine, rows = rows[near], rows[~near]
            patch[mine], count = count, count + 1
            normal[mine], weight[mine], behind_m[mine] = (each[near] for each in found[:3])
            cosine = (beams[mine] * normal[mine]).sum(axis=1)
            expected_m[mine] = points.range_m[mine] - behind_m[mine] / cosine
    return Patches(patch, normal, weight, behind_m, expected_m)


def _wall(
    at_m: Floats, beams: Floats, spread_m: Floats, range_m: Floats, reach_m: Floats, wide: float
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]] | None:
    """The line that most points lie near, refined, and which do; None where it is no wall."""
    angles = np.arange(_DIRECTIONS) * math.pi / _DIRECTIONS
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    middle = at_m.mean(axis=0)
    off = (at_m - middle) @ normals.T
    bins = np.floor(off / _WINDOW_M).astype(np.int64)
    bins -= bins.min()
    flat = bins + np.arange(_DIRECTIONS) * (bins.max() + 2)
    counts = np.bincount(flat.ravel(), minlength=_DIRECTIONS * (bins.max() + 2))
    pairs = counts[:-1] + counts[1:]
    best = int(np.argmax(pairs))
    k, low = divmod(best, int(bins.max()) + 2)
    n = normals[k]
    inside = (bins[:, k] == low) | (bins[:, k] == low + 1)
    side = 1.0 if np.sum(beams[inside] @ n) >= 0 else -1.0
    inside &= side * (beams @ n) > 0
    if not inside.any():
        return None
    n = side * n
    d = float(off[inside, k].mean())
    weight = inside.astype(np.float64)
    local = at_m - middle
    for _ in range(4):
        if weight.sum() < 1e-9:
            return None
        centre = np.average(local, axis=0, weights=weight)
        moved = local - centre
        spread = (moved * weight[:, None]).T @ moved
        turned = np.linalg.eigh(spread)[1][:, 0]
        n = turned if turned @ n >= 0 else -turned
        d = float(centre @ n)
        cosine = beams @ n
        off_n = local @ n - d
        facing = cosine >= _GRAZING  # and from one side
        along = off_n / np.where(facing, cosine, 1.0)  # along the beam
        z = along / (wide * spread_m)
        expected = range_m - along
        # chosen by where the wall is, not by what was measured: the reach would cut one side off
        usable = facing & (expected + 2.5 * spread_m < reach_m)
        weight = np.where(
            usable & (np.abs(z) < _TUKEY), np.square(1.0 - np.square(z / _TUKEY)), 0.0
        )
        weight = weight / np.square(spread_m * np.where(facing, cosine, 1.0))
    near = facing & (np.abs(z) < _TUKEY)
    if (weight > 0).sum() < _FEWEST or near.mean() < 0.3:
        return None
    return np.broadcast_to(n, (len(at_m), 2)), weight, off_n, near
