"""Rigid motions as columns: where the robot and its frames were at many times at once.

Operation for operation that of single motions in :mod:`recorder.geometry`, so that each
value is the same to the bit. Cosines and sines come from :mod:`math` for the same reason.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.columns import Floats, Ints, MotionColumns, elementwise
from recorder.geometry import IDENTITY, SE2
from recorder.messages import BASE_FRAME, Transform

_EXACT_IN_DOUBLE = 1 << 53


# No robot of ours is a thousand kilometres from its map's origin: such a pose is a fault.
FARTHEST_M = 1e6


def is_sane(pose: SE2) -> bool:
    """Finite, and not absurdly far away."""
    finite = all(math.isfinite(v) for v in (pose.x_m, pose.y_m, pose.heading_rad))
    return finite and max(abs(pose.x_m), abs(pose.y_m)) <= FARTHEST_M


@dataclass(frozen=True, slots=True)
class Motions:
    """Rigid motions of the plane, or poses: ``x_m``, ``y_m``, ``heading_rad`` are (N,)."""

    x_m: Floats
    y_m: Floats
    heading_rad: Floats

    @classmethod
    def none(cls) -> Motions:
        """No motion at all."""
        return cls(np.zeros(0), np.zeros(0), np.zeros(0))

    @classmethod
    def same(cls, motion: SE2, count: int) -> Motions:
        """One motion many times."""
        values = (motion.x_m, motion.y_m, motion.heading_rad)
        return cls(*(np.full(count, value) for value in values))

    @classmethod
    def of(cls, columns: MotionColumns) -> Motions:
        """Those of messages."""
        return cls(columns.x_m, columns.y_m, columns.heading_rad)

    @classmethod
    def joined(cls, parts: Sequence[Motions]) -> Motions:
        """Several, one behind the other."""
        return cls(
            np.concatenate([part.x_m for part in parts]),
            np.concatenate([part.y_m for part in parts]),
            np.concatenate([part.heading_rad for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.x_m)

    def __getitem__(self, at: Ints | NDArray[np.bool_] | slice) -> Motions:
        return Motions(self.x_m[at], self.y_m[at], self.heading_rad[at])

    def one(self, at: int) -> SE2:
        """One of them."""
        return SE2(float(self.x_m[at]), float(self.y_m[at]), float(self.heading_rad[at]))

    def __matmul__(self, other: Motions | SE2) -> Motions:
        """``a_from_b @ b_from_c == a_from_c``, each with each, or all with one."""
        c, s = _cos_sin(self.heading_rad)
        return Motions(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            wrapped(self.heading_rad + other.heading_rad),
        )

    def after(self, first: SE2) -> Motions:
        """``first @ self``."""
        c, s = math.cos(first.heading_rad), math.sin(first.heading_rad)
        return Motions(
            first.x_m + c * self.x_m - s * self.y_m,
            first.y_m + s * self.x_m + c * self.y_m,
            wrapped(first.heading_rad + self.heading_rad),
        )

    def inverse(self) -> Motions:
        """``a_from_b.inverse() == b_from_a``."""
        c, s = _cos_sin(self.heading_rad)
        return Motions(
            -c * self.x_m - s * self.y_m,
            s * self.x_m - c * self.y_m,
            wrapped(-self.heading_rad),
        )

    def sane(self) -> NDArray[np.bool_]:
        """Which are finite and not absurdly far away, (N,)."""
        near = (np.abs(self.x_m) <= FARTHEST_M) & (np.abs(self.y_m) <= FARTHEST_M)
        return near & np.isfinite(self.heading_rad)


def wrapped(angle_rad: Floats) -> Floats:
    """The same directions in [-π, π)."""
    out: Floats = (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
    return out


def _cos_sin(angle_rad: Floats) -> tuple[Floats, Floats]:
    return elementwise(math.cos, angle_rad), elementwise(math.sin, angle_rad)


@dataclass(frozen=True, slots=True)
class MotionTrack:
    """Motions over time, sorted: ``t_ns`` (N,); between two of them the motion is even."""

    t_ns: Ints
    motions: Motions
    max_gap_ns: int

    @classmethod
    def empty(cls, max_gap_ns: int) -> MotionTrack:
        """Nothing is known yet."""
        return cls(np.zeros(0, np.int64), Motions.none(), max_gap_ns)

    def with_more(self, parts: Sequence[tuple[Ints, Motions]]) -> MotionTrack:
        """With later ones sorted in; those of one time keep the order in which they came."""
        if not parts:
            return self
        t_ns = np.concatenate([self.t_ns, *(part[0] for part in parts)])
        motions = Motions.joined([self.motions, *(part[1] for part in parts)])
        if (t_ns[1:] < t_ns[:-1]).any():
            order = np.argsort(t_ns, kind="stable")
            t_ns, motions = t_ns[order], motions[order]
        return MotionTrack(t_ns, motions, self.max_gap_ns)

    def since(self, first: int) -> MotionTrack:
        """Without the first ones."""
        return MotionTrack(self.t_ns[first:], self.motions[first:], self.max_gap_ns)

    def at(self, t_ns: Ints) -> tuple[Motions, NDArray[np.bool_]]:
        """The motions at times (M,), and which of them are known.

        None is before the first, after the last, or in a longer gap.
        """
        count = len(self.t_ns)
        if count == 0:
            return Motions.same(IDENTITY, len(t_ns)), np.zeros(len(t_ns), np.bool_)
        after = np.searchsorted(self.t_ns, t_ns)
        before, inside = np.maximum(after - 1, 0), after < count
        after = np.minimum(after, count - 1)
        t0_ns, t1_ns = self.t_ns[before], self.t_ns[after]
        exact = t1_ns == t_ns
        between = inside & (after > 0) & (t1_ns - t0_ns <= self.max_gap_ns) & ~exact
        after_motions = self.motions[after]
        if not between.any():
            return after_motions, exact
        share = _shares(t_ns, t0_ns, t1_ns, between)
        found = _between(self.motions[before], after_motions, share)
        if exact.any():
            found.x_m[exact] = after_motions.x_m[exact]
            found.y_m[exact] = after_motions.y_m[exact]
            found.heading_rad[exact] = after_motions.heading_rad[exact]
        return found, exact | between


def _shares(t_ns: Ints, t0_ns: Ints, t1_ns: Ints, wanted: NDArray[np.bool_]) -> Floats:
    """``(t - t0) / (t1 - t0)`` where it is wanted, as Python divides whole numbers; else 0."""
    past_ns = np.where(wanted, t_ns - t0_ns, 0)
    gap_ns = np.where(wanted, t1_ns - t0_ns, 1)
    share: Floats = past_ns / gap_ns
    for at in np.flatnonzero(gap_ns >= _EXACT_IN_DOUBLE):  # three months: no double holds it
        share[at] = int(past_ns[at]) / int(gap_ns[at])
    return share


def _between(a: Motions, b: Motions, share: Floats) -> Motions:
    """Position along the straight line, heading along the shorter arc."""
    turn_rad = wrapped(b.heading_rad - a.heading_rad)
    return Motions(
        a.x_m + share * (b.x_m - a.x_m),
        a.y_m + share * (b.y_m - a.y_m),
        wrapped(a.heading_rad + share * turn_rad),
    )


@dataclass(frozen=True, slots=True)
class Frames:
    """The mounts of a session, and frames that turn: where each stands on the robot."""

    static: Mapping[str, Transform]
    moving: Mapping[str, tuple[str, MotionTrack]]

    def parent_of(self, frame: str) -> str | None:
        """The frame that another one is fixed to or turns on; None where that is not known."""
        if frame in self.moving:
            return self.moving[frame][0]
        return self.static[frame].parent if frame in self.static else None

    def mount_of(self, frame: str, asked: SE2 | None) -> SE2 | None:
        """Where a sensor stands on the robot if it does not move: there, or as is ``asked``.

        None where it moves, or where that is not known.
        """
        if asked is not None:
            return None if self.parent_of(frame) in self.moving else asked
        motion = IDENTITY
        for _ in range(len(self.static) + 1):
            if frame == BASE_FRAME:
                return motion
            if frame in self.moving or frame not in self.static:
                return None
            frame, motion = (
                self.static[frame].parent,
                (self.static[frame].parent_from_child @ motion),
            )
        return None

    def base_from(self, frame: str, t_ns: Ints) -> tuple[Motions, NDArray[np.bool_]]:
        """Where a frame stands on the robot at times (N,), and at which of them that is known."""
        motion: Motions | SE2 = IDENTITY
        known = np.ones(len(t_ns), np.bool_)
        for _ in range(len(self.static) + len(self.moving) + 1):  # a circle of frames must end
            if frame == BASE_FRAME:
                if isinstance(motion, SE2):
                    motion = Motions.same(motion, len(t_ns))
                return motion, known
            if frame in self.moving:
                frame, track = self.moving[frame]
                step, there = track.at(t_ns)
                known &= there
                motion = step @ motion
            elif frame in self.static:
                mount = self.static[frame]
                frame, fixed = mount.parent, mount.parent_from_child
                motion = fixed @ motion if isinstance(motion, SE2) else motion.after(fixed)
            else:
                break
        return Motions.same(IDENTITY, len(t_ns)), np.zeros(len(t_ns), np.bool_)
