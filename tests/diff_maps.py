"""Small made-up maps for the tests of the comparison: rooms drawn by hand, cell by cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mapping.grid import GridGeometry
from replay.diff.layers import Line, MapLayer, Outline, Source, value_layer

GEOMETRY = GridGeometry((-0.2, 0.4), 0.02, 60, 80)


def source(*layers: MapLayer, single: bool = False) -> Source:
    """Layers as one side of a comparison."""
    return Source(Path("made-up"), "made up", {layer.name: layer for layer in layers}, single)


def layer(
    values: np.ndarray,
    *,
    name: str = "ping",
    kind: str = "probability",
    geometry: GridGeometry | None = None,
    lines: tuple[Line, ...] | None = None,
    borders: tuple[Outline, ...] | None = None,
) -> MapLayer:
    """Values on a grid whose origin lies where that of ``GEOMETRY`` does."""
    grid = geometry or GridGeometry(GEOMETRY.origin_m, GEOMETRY.resolution_m, *values.shape)
    return value_layer(name, kind, grid, values, lines=lines, borders=borders)


def room(
    *, right_col: int = 65, box: bool = True, noise: int = 0, seed: int = 0
) -> np.ndarray:  # fmt: skip
    """A rectangle with walls of two cells, free inside, and a box; float32 (60, 80).

    ``right_col`` is where the right wall stands; ``noise`` moves each wall cell by so many cells.
    """
    random = np.random.default_rng(seed)
    values = np.full(GEOMETRY.shape, 0.5, np.float32)
    values[10:50, 10 : right_col + 2] = 0.05

    def wall(rows: range, cols: range) -> None:
        for row in rows:
            for col in cols:
                there = random.integers(-noise, noise + 1, 2) if noise else (0, 0)
                values[row + there[0], col + there[1]] = 0.95

    wall(range(10, 12), range(10, right_col + 2))
    wall(range(48, 50), range(10, right_col + 2))
    wall(range(10, 50), range(10, 12))
    wall(range(10, 50), range(right_col, right_col + 2))
    if box:
        wall(range(26, 28), range(28, 44))
    return values
