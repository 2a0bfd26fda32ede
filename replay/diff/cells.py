"""How far the cells of two aligned maps lie from each other: counts, the worst one, classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.diff.alignment import Aligned
from replay.diff.layers import CLASS_NAMES, OCCUPIED, UNKNOWN, Values

Flags = NDArray[np.bool_]
_WORST = 10  # cells that are named


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell that differs: row and col in A's own grid, its centre in metres, both values.

    Values are class names where classes are compared. ``difference`` is B less A; NaN against a
    number is a difference of infinity.
    """

    row: int
    col: int
    x_m: float
    y_m: float
    a: float | str
    b: float | str
    difference: float


@dataclass(frozen=True, slots=True)
class CellFigures:
    """Counts of cells. ``seen`` by either side; IoU is None where neither has occupied cells."""

    compared: int
    seen: int
    differ: int
    class_changed: int
    class_changed_share: float
    occupied_a: int
    occupied_b: int
    occupied_iou: float | None
    worst: tuple[Cell, ...]


def distances(a: Values, b: Values) -> NDArray[np.float64]:
    """|a - b| of each cell; 0 for two NaN, infinity for one."""
    with np.errstate(invalid="ignore"):
        away = np.abs(np.asarray(a, np.float64) - np.asarray(b, np.float64))
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    out: NDArray[np.float64] = np.where(same, 0.0, np.where(np.isnan(away), np.inf, away))
    return out


def beyond(away: NDArray[np.float64], tolerance: float) -> Flags:
    """Cells that lie further apart than the tolerance."""
    flags: Flags = away > tolerance
    return flags


def cell_figures(pair: Aligned, tolerance: float) -> CellFigures:
    """All figures of a pair of layers; of classes any change counts, whatever the tolerance."""
    away = distances(pair.a_values, pair.b_values)
    differs = beyond(away, 0.0 if pair.by_class else tolerance)
    changed = pair.a_classes != pair.b_classes
    seen = (pair.a_classes != UNKNOWN) | (pair.b_classes != UNKNOWN)
    a, b = pair.a_classes == OCCUPIED, pair.b_classes == OCCUPIED
    either = int(np.count_nonzero(a | b))
    number = int(np.count_nonzero(seen))
    return CellFigures(
        compared=away.size,
        seen=number,
        differ=int(np.count_nonzero(differs)),
        class_changed=int(np.count_nonzero(changed)),
        class_changed_share=int(np.count_nonzero(changed)) / number if number else 0.0,
        occupied_a=int(np.count_nonzero(a)),
        occupied_b=int(np.count_nonzero(b)),
        occupied_iou=int(np.count_nonzero(a & b)) / either if either else None,
        worst=_worst(pair, np.where(differs, away, 0.0)),
    )


@dataclass(frozen=True, slots=True)
class ExtraFigures:
    """A further array of a layer's rule: how many of its cells differ, and by how much at most."""

    name: str
    differ: int
    most: float


def extra_figures(
    a: Mapping[str, Values], b: Mapping[str, Values], tolerance: float
) -> tuple[ExtraFigures, ...]:
    """The arrays that two layers of one grid both have, by name."""
    found = []
    for name in a:
        if name in b and a[name].shape == b[name].shape:
            away = distances(a[name], b[name])
            number = int(np.count_nonzero(beyond(away, tolerance)))
            found.append(ExtraFigures(name, number, float(away.max(initial=0.0))))
    return tuple(found)


def _worst(pair: Aligned, away: NDArray[np.float64]) -> tuple[Cell, ...]:
    """The cells that differ most, the worst first; of equals, the one of the lowest row, col."""
    flat = away.ravel()
    count = min(_WORST, int(np.count_nonzero(flat)))
    if not count:
        return ()
    least = np.partition(flat, flat.size - count)[flat.size - count]
    above = np.flatnonzero(flat > least)
    level = np.flatnonzero(flat == least)[: count - above.size]
    index = np.concatenate([above, level])
    order = np.lexsort((index, -flat[index]))
    return tuple(_cell(pair, int(i)) for i in index[order])


def _cell(pair: Aligned, index: int) -> Cell:
    row, col = divmod(index, pair.geometry.cols)
    x_m, y_m = pair.geometry.centres_of(np.array([[row, col]]))[0].tolist()
    a, b = float(pair.a_values[row, col]), float(pair.b_values[row, col])
    row, col = row - pair.a_offset[0], col - pair.a_offset[1]
    if pair.by_class:
        return Cell(row, col, x_m, y_m, CLASS_NAMES[int(a)], CLASS_NAMES[int(b)], b - a)
    gap = b - a
    return Cell(row, col, x_m, y_m, a, b, gap if np.isfinite(gap) else float("inf"))
