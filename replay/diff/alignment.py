"""Two grids on one: shifted by whole cells, what only one of them has padded as never seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from recorder.errors import BadInput
from replay.diff.layers import UNKNOWN, Codes, MapLayer, Values, never_seen

_WHOLE = 1e-3  # a shift is whole when it is so many cells away from one, over the whole grid
_MOST_CELLS = 100_000_000

Shades = NDArray[np.float64]
T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Aligned:
    """Both layers on ``geometry``, which holds the two; ``a_offset`` is where A's (0, 0) lies.

    ``values`` of a layer of classes are its codes, and its ``shades`` are empty: else they are
    probabilities (rows, cols), NaN where nothing was seen.
    """

    geometry: GridGeometry
    a_offset: tuple[int, int]
    b_offset: tuple[int, int]
    a_values: Values
    b_values: Values
    a_classes: Codes
    b_classes: Codes
    by_class: bool
    a_shades: Shades
    b_shades: Shades


def common_grid(
    a: GridGeometry, b: GridGeometry, what: str
) -> tuple[GridGeometry, tuple[int, int], tuple[int, int]]:
    """The grid that holds both, and the row and col of the two origins in it.

    Raises BadInput, in one sentence, where their cells cannot lie on each other.
    """
    size = a.resolution_m
    cells = max(*a.shape, *b.shape)
    if abs(size - b.resolution_m) / size * cells > _WHOLE:
        raise BadInput(
            f"{what}: the cells cannot be compared, they are {size:g} m in A and "
            f"{b.resolution_m:g} m in B (map both with one grid.resolution_m)"
        )
    shift = [(q - p) / size for p, q in zip(a.origin_m, b.origin_m, strict=True)]
    whole = [round(s) for s in shift]
    if max(abs(s - w) for s, w in zip(shift, whole, strict=True)) > _WHOLE:
        raise BadInput(
            f"{what}: the cells cannot be compared, the origins lie {shift[0]:.3f} and "
            f"{shift[1]:.3f} cells apart, which is not a whole number of cells"
        )
    col, row = whole
    row0, col0 = min(0, row), min(0, col)
    rows = max(a.rows, row + b.rows) - row0
    cols = max(a.cols, col + b.cols) - col0
    if rows * cols > max(_MOST_CELLS, a.rows * a.cols, b.rows * b.cols):
        raise BadInput(f"{what}: the two maps lie too far apart ({cols} x {rows} cells for both)")
    origin = (a.origin_m[0] + col0 * size, a.origin_m[1] + row0 * size)
    union = GridGeometry(origin, size, rows, cols)
    return union, (-row0, -col0), (row - row0, col - col0)


def align(a: MapLayer, b: MapLayer) -> Aligned:
    """Both layers on one grid; by class where one has nothing else, or the units differ."""
    geometry, at_a, at_b = common_grid(a.geometry, b.geometry, f"layer {a.name}")
    a_classes = a.classes if b.reclass is None or a.values is None else b.reclass(a)
    b_classes = b.classes if a.reclass is None or b.values is None else a.reclass(b)
    a_classes = padded(a_classes, geometry, at_a, UNKNOWN)
    b_classes = padded(b_classes, geometry, at_b, UNKNOWN)
    if a.values is None or b.values is None or a.kind != b.kind:
        return Aligned(
            geometry, at_a, at_b, a_classes.astype(np.float32), b_classes.astype(np.float32),
            a_classes, b_classes, True, np.zeros((0, 0)), np.zeros((0, 0)),
        )  # fmt: skip
    a_values = padded(a.values, geometry, at_a, a.start)
    b_values = padded(b.values, geometry, at_b, b.start)
    a_shades = padded(_shades(a), geometry, at_a, np.nan)
    b_shades = padded(_shades(b), geometry, at_b, np.nan)
    return Aligned(
        geometry, at_a, at_b, a_values, b_values, a_classes, b_classes, False, a_shades, b_shades
    )


def _shades(layer: MapLayer) -> Shades:
    return np.where(never_seen(layer), np.nan, layer.probability)


def padded(
    grid: NDArray[T], geometry: GridGeometry, at: tuple[int, int], fill: float
) -> NDArray[T]:
    """A grid (rows, cols) laid at row, col into a larger one that is ``fill`` elsewhere."""
    if grid.shape == geometry.shape:
        return grid
    out = np.full(geometry.shape, fill, grid.dtype)
    out[at[0] : at[0] + grid.shape[0], at[1] : at[1] + grid.shape[1]] = grid
    return out
