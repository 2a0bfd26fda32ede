"""Where a cell is, and the layer of values that a map is made of.

``grid[row, col]``: row 0 lies at the lowest y, columns run along +x. A point lies in the cell
``floor((p - origin) / resolution)``; the origin is the outer corner of cell (0, 0), so a cell's
centre stands half a cell further. This is the only place where the rule is written.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.errors import BadInput

FloatArray = NDArray[np.float64]
BYTES_PER_CELL = 30  # of each layer, measured: the rule's array, what is drawn and what is exported
BYTES_PER_SUM = 8  # of a cell: each further array of a rule that keeps several


def read_only(array: NDArray[np.generic]) -> NDArray[np.generic]:
    """The same array, locked: what flows between stages cannot be changed behind one's back."""
    array.flags.writeable = False
    return array


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of cells: rows ``row0 .. row0 + rows - 1``, and columns alike."""

    row0: int
    col0: int
    rows: int
    cols: int

    @classmethod
    def around(cls, cells: NDArray[np.bool_ | np.integer]) -> Window:
        """The smallest rectangle of an array (rows, cols) that holds all cells but those of 0."""
        rows, cols = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
        if not len(rows):
            return cls(0, 0, 0, 0)
        row0, col0 = int(rows[0]), int(cols[0])
        return cls(row0, col0, int(rows[-1]) - row0 + 1, int(cols[-1]) - col0 + 1)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of a whole grid that takes this rectangle."""
        return (
            slice(self.row0, self.row0 + self.rows),
            slice(self.col0, self.col0 + self.cols),
        )

    @property
    def empty(self) -> bool:
        """True where the rectangle holds no cell (a beam beside the grid)."""
        return self.rows <= 0 or self.cols <= 0


@dataclass(frozen=True, slots=True)
class GridGeometry:
    """Where a grid lies in the map frame, and how many cells it has."""

    origin_m: tuple[float, float]
    resolution_m: float
    rows: int
    cols: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols), as NumPy wants it."""
        return (self.rows, self.cols)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width along x and height along y, metres."""
        return (self.cols * self.resolution_m, self.rows * self.resolution_m)

    @property
    def whole(self) -> Window:
        """The rectangle of all cells."""
        return Window(0, 0, self.rows, self.cols)

    def cells_of(self, points_m: FloatArray) -> NDArray[np.int64]:
        """Points ``(N, 2)`` as x, y in metres → cells ``(N, 2)`` as row, col (may lie outside)."""
        scaled = (np.asarray(points_m, np.float64) - self.origin_m) / self.resolution_m
        return np.floor(scaled).astype(np.int64)[..., ::-1]

    def centres_of(self, cells: NDArray[np.int64]) -> FloatArray:
        """Cells ``(N, 2)`` as row, col → their centres ``(N, 2)`` as x, y in metres."""
        inner_m = (np.asarray(cells)[..., ::-1] + 0.5) * self.resolution_m
        centres_m: FloatArray = inner_m + np.array(self.origin_m)
        return centres_m

    def contains(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of the cells ``(N, 2)`` lie inside the grid."""
        row, col = cells[..., 0], cells[..., 1]
        inside: NDArray[np.bool_] = (row >= 0) & (row < self.rows) & (col >= 0) & (col < self.cols)
        return inside

    def window_around(self, low_m: FloatArray, high_m: FloatArray) -> Window:
        """The rectangle of cells that covers a box of the map frame, cut to the grid."""
        corners = self.cells_of(np.array([low_m, high_m]))
        row0, col0 = (max(int(v), 0) for v in corners[0])
        row1 = min(int(corners[1, 0]), self.rows - 1)
        col1 = min(int(corners[1, 1]), self.cols - 1)
        return Window(row0, col0, max(row1 - row0 + 1, 0), max(col1 - col0 + 1, 0))


def geometry_for(
    low_m: FloatArray, high_m: FloatArray, *, resolution_m: float, margin_m: float, max_cells: int
) -> GridGeometry:
    """The grid that holds a box and a margin; its origin lies on a multiple of the resolution.

    Raises BadInput, before any memory is taken, when it would have more than ``max_cells`` cells.
    """
    low = [math.floor((float(v) - margin_m) / resolution_m) for v in low_m]
    high = [math.ceil((float(v) + margin_m) / resolution_m) for v in high_m]
    cols, rows = max(high[0] - low[0], 1), max(high[1] - low[1], 1)
    check_size(rows, cols, resolution_m=resolution_m, max_cells=max_cells)
    return GridGeometry((low[0] * resolution_m, low[1] * resolution_m), resolution_m, rows, cols)


def check_size(rows: int, cols: int, *, resolution_m: float, max_cells: int) -> None:
    """Refuse a grid that is too large, and say how large it would have been."""
    if rows * cols > max_cells:
        raise BadInput(
            f"the grid would have {cols} x {rows} = {rows * cols:,} cells "
            f"({cols * resolution_m:.4g} x {rows * resolution_m:.4g} m at {resolution_m:g} m), "
            f"more than grid.max_cells = {max_cells:,}"
        )


def check_memory(geometry: GridGeometry, arrays: Sequence[int], max_memory_mb: float) -> None:
    """Refuse maps, and the one fused of them, that would take too much memory.

    ``arrays`` are how many arrays the rule of each layer keeps.
    """
    cells, layers = geometry.rows * geometry.cols, len(arrays)
    further = BYTES_PER_SUM * sum(max(number - 1, 0) for number in arrays)
    needed_mb = cells * ((layers + (layers > 1)) * BYTES_PER_CELL + further) / 1e6
    if needed_mb > max_memory_mb:
        raise BadInput(
            f"maps of {geometry.cols} x {geometry.rows} = {cells:,} cells in "
            f"{layers} layer{'s' * (layers > 1)} would take about {needed_mb:,.0f} MB, more than "
            f"grid.max_memory_mb = {max_memory_mb:g}: a larger grid.resolution_m makes fewer cells"
        )


@dataclass(frozen=True, slots=True)
class Layer:
    """One exported map: of a sensor, of a kind of sensor, or fused.

    ``values`` (rows, cols) float32 are in the update rule's own unit, named by ``kind``
    (``probability``, ``count``, ``odds``, ``mass``, ``certainty``, ``sum``, ``binary``);
    ``probability`` (rows, cols) float32 is what thresholds, fusion and map files use.
    ``observed`` are the cells that any reading ever touched. ``extra`` holds further arrays of
    the rule, by name (Dempster-Shafer's masses and conflict).
    """

    name: str
    kind: str
    geometry: GridGeometry
    values: NDArray[np.float32]
    probability: NDArray[np.float32]
    observed: NDArray[np.bool_]
    extra: dict[str, NDArray[np.float32]]
