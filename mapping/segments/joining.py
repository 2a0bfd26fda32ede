"""Lines that are one wall: collinear pieces, and the two faces of a thin wall."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.config import SegmentsSection
from mapping.segments.least_squares import FittedLine, FloatArray, fit_line
from mapping.segments.stages import Merge, Observer, place_of


def merge_collinear(
    lines: list[FittedLine],
    config: SegmentsSection,
    observe: Observer | None = None,
    *,
    same_side: bool = False,
) -> list[FittedLine]:
    """Pieces of one wall become one line, the longest first.

    Two lines are joined when a line through the points of both keeps within the largest rms and
    the gap between them, along it, is at most ``gap_m``. ``same_side``: only lines that run the
    same way, as the borders of one side of a wall do.
    """
    done: list[FittedLine] = []
    waiting = _Waiting.of(sorted(lines, key=lambda line: line.length_m))
    while waiting.lines:
        line, spread = waiting.take(len(waiting.lines) - 1)
        while waiting.lines:
            partner, cost = waiting.best_partner(line, spread, config, same_side)
            if partner is None:
                break
            other, _ = waiting.take(partner)
            merged = _union(line, other)
            spread = _spread(merged.points_m)
            _report(line, other, merged, cost, observe)
            line = merged
        done.append(line)
    return done


def _spread(points_m: FloatArray) -> FloatArray:
    """How many points there are, their mean, and the sums of xx, xy, yy about it: (6,)."""
    mean = points_m.mean(axis=0)
    x, y = (points_m - mean).T
    return np.array([len(points_m), *mean, x @ x, x @ y, y @ y])


@dataclass(slots=True)
class _Waiting:
    """Lines that are not yet joined, and what is asked of them all: (N, ...) arrays."""

    lines: list[FittedLine]
    ends_m: FloatArray
    along: FloatArray
    spreads: FloatArray

    @classmethod
    def of(cls, lines: list[FittedLine]) -> _Waiting:
        ends = np.array([(line.start_m, line.end_m) for line in lines]).reshape(-1, 2, 2)
        along = np.array([line.along for line in lines]).reshape(-1, 2)
        spreads = np.array([_spread(line.points_m) for line in lines]).reshape(-1, 6)
        return cls(list(lines), ends, along, spreads)

    def take(self, k: int) -> tuple[FittedLine, FloatArray]:
        """A line and its spread, which waits no longer."""
        spread = self.spreads[k].copy()
        self.ends_m = np.delete(self.ends_m, k, axis=0)
        self.along = np.delete(self.along, k, axis=0)
        self.spreads = np.delete(self.spreads, k, axis=0)
        return self.lines.pop(k), spread

    def joint_rms_m(self, one: FloatArray) -> FloatArray:
        """Root mean square distances of its points and each line's from their common line, (N,).

        But for rounding.
        """
        count = self.spreads[:, 0]
        away = self.spreads[:, 1:3] - one[1:3]
        both = (one[0] * count / (one[0] + count))[:, None]
        sums = self.spreads[:, 3:] + one[3:] + both * (away[:, [0, 0, 1]] * away[:, [0, 1, 1]])
        xx, xy, yy = sums.T
        across = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)
        rms_m: FloatArray = np.sqrt(np.maximum(across, 0.0) / (one[0] + count))
        return rms_m

    def best_partner(
        self, line: FittedLine, spread: FloatArray, config: SegmentsSection, same_side: bool
    ) -> tuple[int | None, float]:
        """The line that fits best with another one, of that spread, and how well."""
        cosine = self.along @ line.along
        t = np.sort((self.ends_m - line.start_m) @ line.along, axis=1)
        gap = np.maximum(t[:, 0] - line.length_m, -t[:, 1])
        off = np.abs((self.ends_m - line.centre_m) @ line.normal).min(axis=1)
        # Only what could pass is fitted: near in all senses, turned by no more than a wall's noise.
        likely = (gap <= config.gap_m) & (off <= 4.0 * config.epsilon_m) & (np.abs(cosine) > 0.8)
        if same_side:
            likely &= cosine > 0.0
        found = np.flatnonzero(likely)
        rms_m = self.joint_rms_m(spread)[found]
        for k in found[np.argsort(rms_m, kind="stable")].tolist():
            other = self.lines[k]
            joint = fit_line(np.concatenate([line.points_m, other.points_m]))
            cost = joint.rms_m / config.largest_rms_m
            if cost >= 1.0:
                break
            if _gap_along(joint, line, other) <= config.gap_m:
                return k, cost
        return None, 1.0


def _gap_along(joint: FittedLine, a: FittedLine, b: FittedLine) -> float:
    ta = sorted(float((end - joint.centre_m) @ joint.along) for end in (a.start_m, a.end_m))
    tb = sorted(float((end - joint.centre_m) @ joint.along) for end in (b.start_m, b.end_m))
    return max(ta[0], tb[0]) - min(ta[1], tb[1])


def _union(a: FittedLine, b: FittedLine) -> FittedLine:
    """One line through the points of both, from end to end, running as ``a`` does."""
    points = np.concatenate([a.points_m, b.points_m])
    points = points[np.argsort(points @ a.along, kind="stable")]
    line = fit_line(points)
    along = line.along if line.along @ a.along >= 0 else -line.along
    ends = np.array([a.start_m, a.end_m, b.start_m, b.end_m])
    t = (ends - line.centre_m) @ along
    start, end = line.centre_m + t.min() * along, line.centre_m + t.max() * along
    return FittedLine(points, line.centre_m, along, start, end)


def _report(
    line: FittedLine, other: FittedLine, merged: FittedLine, cost: float, observe: Observer | None
) -> None:
    if observe is None:
        return
    ends = [p for one in (line, other) for p in (one.start_m, one.end_m)]
    middle = sorted(ends, key=lambda p: float(p @ merged.along))[1]
    start, joint, end = (place_of(p) for p in (merged.start_m, middle, merged.end_m))
    observe(Merge(start, joint, end, cost))


def pair_faces(
    faces: list[FittedLine], backs: list[FittedLine], thickness_m: float
) -> list[FittedLine]:
    """The two faces of a thin wall become its centre line; other faces stay as they are.

    What is solid lies on the left of every line. The longest face takes all faces, and ``backs``
    that make no lines of their own, that run against it, lie on its left within ``thickness_m``,
    have at least half of their length beside it and half of its length beside them.
    """
    done: list[FittedLine] = []
    waiting = sorted(faces, key=lambda line: line.length_m)
    while waiting:
        face = waiting.pop()
        others = waiting + backs
        behind = _faces_behind(face, others, thickness_m)
        if len(behind) == 0:
            done.append(face)
            continue
        taken = set(behind.tolist())
        done.append(_centre_line(face, [others[k] for k in behind]))
        backs = [line for k, line in enumerate(backs, len(waiting)) if k not in taken]
        waiting = [line for k, line in enumerate(waiting) if k not in taken]
    return done


def _faces_behind(
    face: FittedLine, others: list[FittedLine], thickness_m: float
) -> NDArray[np.int64]:
    if not others:
        return np.empty(0, np.int64)
    ends = np.array([[other.start_m, other.end_m] for other in others])
    against = np.array([other.along for other in others]) @ face.along < -math.cos(math.radians(15))
    left = ((ends - face.centre_m) @ face.normal).mean(axis=1)
    t = np.sort((ends - face.start_m) @ face.along, axis=1)
    beside = np.minimum(t[:, 1], face.length_m) - np.maximum(t[:, 0], 0.0)
    enough = beside >= 0.5 * np.maximum(t[:, 1] - t[:, 0], 1e-9)
    behind = np.flatnonzero(against & (left > 0.0) & (left <= thickness_m) & enough)
    if beside[behind].sum() < 0.5 * face.length_m:
        return behind[:0]
    return behind


def _centre_line(face: FittedLine, others: list[FittedLine]) -> FittedLine:
    """Each face's points are moved half of the thickness inwards, then fitted together."""
    parts: list[FloatArray] = []
    lengths = np.array([other.length_m for other in others])
    depths = np.array([
        float(((other.start_m + other.end_m) / 2.0 - face.centre_m) @ face.normal)
        for other in others
    ])  # fmt: skip
    half = float(lengths @ depths / lengths.sum()) / 2.0 if lengths.sum() > 0 else 0.0
    parts.append(face.points_m + half * face.normal)
    for other, depth in zip(others, depths, strict=True):
        parts.append(other.points_m + (half - depth) * face.normal)
    points = np.concatenate(parts)
    points = points[np.argsort(points @ face.along, kind="stable")]
    line = fit_line(points)
    ends = np.array([p for one in (face, *others) for p in (one.start_m, one.end_m)])
    t = (ends - line.centre_m) @ line.along
    start, end = (line.centre_m + at * line.along for at in (t.min(), t.max()))
    return FittedLine(points, line.centre_m, line.along, start, end)
