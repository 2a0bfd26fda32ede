"""Straight stretches in the plane: what lies along them, what joins them, what crosses them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP_M = 0.01
_JOINED_RAD = math.radians(7.0)  # between two pieces of one wall, at most
_JOINED_M = 0.03  # across the wall
_BESIDE_M = 0.02  # within this of an end a ray passes beside a stretch


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """From ``begin_m`` to ``end_m`` along the unit vector ``along`` (2,), from ``place_m`` (2,)."""

    place_m: Floats
    along: Floats
    begin_m: float
    end_m: float

    @classmethod
    def between(cls, start_m: Floats, end_m: Floats) -> Stretch:
        """From one end to another; along +x where the two are one place."""
        way = np.asarray(end_m, np.float64) - start_m
        length = math.hypot(way[0], way[1])
        along = way / length if length > 0.0 else np.array([1.0, 0.0])
        return cls(np.asarray(start_m, np.float64), along, 0.0, length)

    @property
    def normal(self) -> Floats:
        """Unit vector to the left."""
        return np.array([-self.along[1], self.along[0]])

    @property
    def length_m(self) -> float:
        """Between the two ends."""
        return self.end_m - self.begin_m

    @property
    def ends_m(self) -> Floats:
        """The two ends, (2, 2)."""
        ends: Floats = self.place_m + np.array([[self.begin_m], [self.end_m]]) * self.along
        return ends

    @property
    def middle_m(self) -> Floats:
        """Halfway, (2,)."""
        middle: Floats = self.place_m + 0.5 * (self.begin_m + self.end_m) * self.along
        return middle

    def frame_of(self, points_m: Floats) -> tuple[Floats, Floats]:
        """How far points (N, 2) lie along the stretch, and how far to its left."""
        away = np.empty_like(points_m)  # column by column: rows of two are slow
        for k, from_m in enumerate(self.place_m.tolist()):
            np.subtract(points_m[:, k], from_m, out=away[:, k])
        return away @ self.along, away @ self.normal

    def steps_m(self) -> Floats:
        """Places along it, (S, 2), about a centimetre apart."""
        many = max(round(self.length_m / STEP_M), 1)
        t = self.begin_m + (np.arange(many) + 0.5) * (self.length_m / many)
        steps: Floats = self.place_m + t[:, None] * self.along
        return steps

    def part(self, begin_m: float, end_m: float) -> Stretch:
        """Another stretch of the same line."""
        return replace(self, begin_m=begin_m, end_m=end_m)

    def with_(self, other: Stretch) -> Stretch:
        """The longer of the two, drawn out to the ends of the other."""
        if other.length_m > self.length_m:
            return other.with_(self)
        t, _ = self.frame_of(other.ends_m)
        return self.part(min(self.begin_m, float(t.min())), max(self.end_m, float(t.max())))

    def gap_to(self, other: Stretch) -> tuple[float, float]:
        """What lies between the two, from and to along this line; backwards where they overlap."""
        t = np.sort(self.frame_of(other.ends_m)[0])
        if t[0] + t[1] < self.begin_m + self.end_m:
            return float(t[1]), self.begin_m
        return self.end_m, float(t[0])

    def continues(self, other: Stretch, gap_m: float) -> bool:
        """Whether the other lies in one line with this one, at most ``gap_m`` along from it."""
        if abs(float(self.along @ other.along)) < math.cos(_JOINED_RAD):
            return False
        begin, end = self.gap_to(other)
        if end - begin > gap_m:
            return False
        t, off = self.frame_of(other.ends_m)
        apart = float(t[1] - t[0])
        slope = float(off[1] - off[0]) / apart if apart else 0.0
        where = np.clip(t, self.begin_m, self.end_m)
        return bool(np.abs(off[0] + slope * (where - t[0])).max() <= _JOINED_M)

    def share_along(self, others: list[Stretch], within_m: float, within_rad: float) -> float:
        """The share of its length that lies along others."""
        steps = self.steps_m()
        covered = np.zeros(len(steps), np.bool_)
        for other in others:
            if abs(float(self.along @ other.along)) >= math.cos(within_rad):
                t, off = other.frame_of(steps)
                inside = (t >= other.begin_m - STEP_M) & (t <= other.end_m + STEP_M)
                covered |= inside & (np.abs(off) <= within_m)
        return float(covered.mean())

    def crossed(self, from_m: Floats, to_m: Floats, behind_m: float) -> Flags:
        """Which ways (N, 2) to (N, 2) go through it and end more than ``behind_m`` behind it."""
        (t0, off0), (t1, off1) = self.frame_of(from_m), self.frame_of(to_m)
        through = (off0 * off1 < 0.0) & (np.abs(off1) > behind_m)
        share = off0 / np.where(through, off0 - off1, 1.0)
        at = t0 + share * (t1 - t0)
        inside = (at > self.begin_m + _BESIDE_M) & (at < self.end_m - _BESIDE_M)
        return through & inside

    def crossing(self, other: Stretch, least_sine: float) -> Floats | None:
        """Where the two lines cross, however far on; None where they are nearly parallel."""
        sine = float(self.along[0] * other.along[1] - self.along[1] * other.along[0])
        if abs(sine) < least_sine:
            return None
        d = other.place_m - self.place_m
        place: Floats = self.place_m + self.along * (
            float(d[0] * other.along[1] - d[1] * other.along[0]) / sine
        )
        return place
