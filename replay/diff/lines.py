"""Lines and borders of two maps: which are the same, which moved and how far, which came or went.

Two lines can be one wall when they point the same way within 15 degrees, lie within half a metre
of each other and overlap along their length. Of all such pairs those are taken that lie nearest in
sum (an assignment problem). Borders are matched by the mean distance of their cells.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from replay.diff.layers import Line, Outline

Floats = NDArray[np.float64]

MOST_ANGLE_RAD = math.radians(15.0)
MOST_OFFSET_M = 0.5
_LEAST_OVERLAP = 0.25  # of the shorter line
_MOST_BORDER_M = 0.25  # mean distance of the cells of borders that are one
_NEVER = 1e9


@dataclass(frozen=True, slots=True)
class MovedLine:
    """A line of A and what it is in B: how far off it lies, turned by how much.

    ``offset_m`` is the distance of B's middle from A's line; ``ends_m`` how far an end moved, at
    most (a line that only became longer or shorter has no offset).
    """

    a: Line
    b: Line
    offset_m: float
    turned_rad: float
    ends_m: float


@dataclass(frozen=True, slots=True)
class LineFigures:
    """The lines of one layer: counts, and those that moved, came (in B alone) and went."""

    same: int
    moved: tuple[MovedLine, ...]
    appeared: tuple[Line, ...]
    vanished: tuple[Line, ...]

    @property
    def differ(self) -> bool:
        """Whether anything is not the same."""
        return bool(self.moved or self.appeared or self.vanished)


@dataclass(frozen=True, slots=True)
class MovedBorder:
    """A border that changed: a point of it, metres, how far its cells lie apart, mean and most."""

    at_m: tuple[float, float]
    mean_m: float
    most_m: float


@dataclass(frozen=True, slots=True)
class BorderFigures:
    """The borders of one layer; those that came and went by a point of them, metres."""

    same: int
    moved: tuple[MovedBorder, ...]
    appeared_m: tuple[tuple[float, float], ...]
    vanished_m: tuple[tuple[float, float], ...]

    @property
    def differ(self) -> bool:
        """Whether anything is not the same."""
        return bool(self.moved or self.appeared_m or self.vanished_m)


def line_figures(a: Sequence[Line], b: Sequence[Line], tolerance_m: float) -> LineFigures:
    """Match the lines of two layers; those whose ends moved no further than the tolerance are same.

    Lines of grids and of raw points are matched each among themselves.
    """
    same, moved, gone, come = 0, [], [], []
    for source in dict.fromkeys(line.source for line in (*a, *b)):
        left = [line for line in a if line.source == source]
        right = [line for line in b if line.source == source]
        pairs = _matched(_line_costs(left, right))
        for i, j in pairs:
            change = _change(left[i], right[j])
            if change.ends_m <= tolerance_m:
                same += 1
            else:
                moved.append(change)
        taken_a, taken_b = {i for i, _ in pairs}, {j for _, j in pairs}
        gone += [line for i, line in enumerate(left) if i not in taken_a]
        come += [line for j, line in enumerate(right) if j not in taken_b]
    moved.sort(key=lambda each: -max(each.offset_m, each.ends_m))
    return LineFigures(same, tuple(moved), tuple(come), tuple(gone))


def _change(a: Line, b: Line) -> MovedLine:
    """How B's line lies to A's, whichever way each runs."""
    p, q = np.array([a.start_m, a.end_m]), np.array([b.start_m, b.end_m])
    ends = min(
        float(np.hypot(*(p - other).T).max())
        for other in (q, q[::-1])
    )  # fmt: skip
    along, length = _direction(p)
    other, _ = _direction(q)
    cross = along[0] * other[1] - along[1] * other[0]
    turned = math.asin(min(1.0, abs(float(cross))))
    offset = 0.0
    if length > 0.0:
        middle = q.mean(axis=0) - p[0]
        offset = abs(float(along[0] * middle[1] - along[1] * middle[0]))
    return MovedLine(a, b, offset, turned, ends)


def _direction(ends: Floats) -> tuple[Floats, float]:
    vector = ends[1] - ends[0]
    length = float(np.hypot(*vector))
    return (vector / length if length > 0.0 else np.array([1.0, 0.0])), length


def _line_costs(a: Sequence[Line], b: Sequence[Line]) -> Floats:
    """(len(a), len(b)): offset, and a little of the ends' way; ``_NEVER`` where not one wall."""
    costs = np.full((len(a), len(b)), _NEVER)
    for i, left in enumerate(a):
        for j, right in enumerate(b):
            change = _change(left, right)
            near = change.offset_m <= MOST_OFFSET_M and change.turned_rad <= MOST_ANGLE_RAD
            if near and _overlap(left, right) >= _LEAST_OVERLAP:
                costs[i, j] = change.offset_m + 0.1 * change.ends_m
    return costs


def _overlap(a: Line, b: Line) -> float:
    """The length that both share along A, as a part of the shorter one."""
    p, q = np.array([a.start_m, a.end_m]), np.array([b.start_m, b.end_m])
    along, length = _direction(p)
    low, high = sorted(float(v) for v in (q - p[0]) @ along)
    shorter = min(length, high - low)
    common = min(length, high) - max(0.0, low)
    if shorter <= 0.0:
        return 1.0 if common >= 0.0 else 0.0
    return common / shorter


def _matched(costs: Floats) -> list[tuple[int, int]]:
    """Pairs of the least cost in sum, each row and column once at most."""
    if not costs.size:
        return []
    rows, cols = linear_sum_assignment(costs)
    return [(int(i), int(j)) for i, j in zip(rows, cols, strict=True) if costs[i, j] < _NEVER]


def border_figures(
    a: Sequence[Outline], b: Sequence[Outline], resolution_m: float
) -> BorderFigures:
    """Match the borders of two layers; equal are those through the same cells in any order."""
    left, right, same = _without_equal(a, b, resolution_m)
    pairs: list[tuple[int, int]] = []
    trees = [cKDTree(each.points_m) for each in left], [cKDTree(each.points_m) for each in right]
    costs = np.full((len(left), len(right)), _NEVER)
    moved: dict[tuple[int, int], MovedBorder] = {}
    for i, one in enumerate(left):
        for j, other in enumerate(right):
            if one.outer == other.outer and _boxes_near(one, other):
                change = _border_change(one, other, trees[0][i], trees[1][j])
                if change.mean_m <= _MOST_BORDER_M:
                    costs[i, j], moved[i, j] = change.mean_m, change
    pairs = _matched(costs)
    taken_a, taken_b = {i for i, _ in pairs}, {j for _, j in pairs}
    return BorderFigures(
        same,
        tuple(sorted((moved[pair] for pair in pairs), key=lambda each: -each.most_m)),
        tuple(_point(each) for j, each in enumerate(right) if j not in taken_b),
        tuple(_point(each) for i, each in enumerate(left) if i not in taken_a),
    )


def _without_equal(
    a: Sequence[Outline], b: Sequence[Outline], resolution_m: float
) -> tuple[list[Outline], list[Outline], int]:
    """What is left of both when equal borders are taken out, and how many those are."""
    waiting: defaultdict[tuple[bool, bytes], list[int]] = defaultdict(list)
    for j, each in enumerate(b):
        waiting[_key(each, resolution_m)].append(j)
    left, used = [], set()
    for each in a:
        found = waiting.get(_key(each, resolution_m))
        if found:
            used.add(found.pop())
        else:
            left.append(each)
    return left, [each for j, each in enumerate(b) if j not in used], len(used)


def _key(border: Outline, resolution_m: float) -> tuple[bool, bytes]:
    # In half cells, since centres of cells lie halfway between multiples of the resolution.
    cells = np.unique(np.rint(border.points_m * (2.0 / resolution_m)).astype(np.int64), axis=0)
    return border.outer, cells.tobytes()


def _boxes_near(a: Outline, b: Outline) -> bool:
    low_a, high_a = a.points_m.min(axis=0), a.points_m.max(axis=0)
    low_b, high_b = b.points_m.min(axis=0), b.points_m.max(axis=0)
    apart = np.maximum(np.maximum(low_a - high_b, low_b - high_a), 0.0)
    return float(np.hypot(*apart)) <= _MOST_BORDER_M


def _border_change(a: Outline, b: Outline, tree_a: cKDTree, tree_b: cKDTree) -> MovedBorder:
    there = np.concatenate([tree_b.query(a.points_m)[0], tree_a.query(b.points_m)[0]])
    return MovedBorder(_point(a), float(there.mean()), float(there.max()))


def _point(border: Outline) -> tuple[float, float]:
    x, y = border.points_m[0].tolist()
    return x, y
