"""What the writer and the reader of a layer's history both know, and how a reading moves it.

Both keep the values and the odds of every cell. A reading multiplies the odds of the cells that it
covers; what comes of it is foretold from there. Only sums, products and roots are used, which give
the same bits on every machine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry, Window
from replay.rrd.distance_table import DistanceTable, look_up

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Cells = NDArray[np.int64]

# What a cell holds before any reading, by the unit of the layer's values; all others begin at 0.
STARTS = {"probability": 0.5, "odds": 1.0}


@dataclass(frozen=True, slots=True)
class Covered:
    """The cells that a reading speaks of, as flat indices into the grid, and what it says.

    Of the cells in front only the distance is known, the ``factors`` of those in the band are
    given; other cells are changed though nothing is said of them. ``sensor_m`` is where the sensor
    stood.
    """

    sensor_m: tuple[float, float]
    front: Cells
    band: Cells
    others: Cells
    factors: Floats

    @property
    def cells(self) -> Cells:
        """All of them: in front, in the band, others."""
        return np.concatenate([self.front, self.band, self.others])


class Track:
    """Values and odds of all cells of one layer, and the tables of factors so far."""

    def __init__(
        self, geometry: GridGeometry, kind: str, start: float, largest_odds: float = 1.0
    ) -> None:
        self.geometry = geometry
        self.kind = kind
        self.largest_odds = largest_odds
        self.values: Singles = np.full(geometry.shape, start, np.float32)
        self.tables: list[tuple[float, Floats]] = []  # spacing and cubics
        self.restart()

    def restart(self) -> None:
        """Forget all odds; they begin again from the values."""
        self._odds: Floats = np.zeros(self.values.size)  # 0: not known but from the value

    def add_table(self, table: DistanceTable) -> None:
        """One more table that readings may name."""
        self.tables.append((table.spacing_m, table.cubics()))

    def replace(self, window: Window, values: Singles) -> None:
        """Take over values that are given, in a window."""
        part = self.values[window.slices]
        # Compared as bits: NaN equals itself, and 0.0 is not -0.0.
        changed = part.view(np.uint32) != np.ascontiguousarray(values).view(np.uint32)
        self._odds.reshape(self.geometry.shape)[window.slices][changed] = 0.0
        part[...] = values

    def distances_m(self, sensor_m: tuple[float, float], cells: Cells) -> Floats:
        """From a sensor to the centres of cells."""
        geometry = self.geometry
        (x0, y0), size = geometry.origin_m, geometry.resolution_m
        row, col = np.divmod(cells, geometry.cols)
        dx = (np.arange(geometry.cols) + 0.5) * size + (x0 - sensor_m[0])
        dy = (np.arange(geometry.rows) + 0.5) * size + (y0 - sensor_m[1])
        distances: Floats = np.sqrt((dx * dx)[col] + (dy * dy)[row])
        return distances

    def foretell(self, covered: Covered, table: int) -> tuple[Floats, Singles]:
        """Odds and values that the covered cells should have after a reading."""
        front = np.ones(len(covered.front))
        if table < len(self.tables):
            spacing, cubics = self.tables[table]
            distances = self.distances_m(covered.sensor_m, covered.front)
            front = look_up(cubics, spacing, distances)
        factors = np.concatenate([front, covered.factors, np.ones(len(covered.others))])
        cells = covered.cells
        odds = self._odds[cells]
        fresh = np.flatnonzero(odds == 0.0)
        with np.errstate(invalid="ignore", over="ignore"):
            odds[fresh] = self._odds_of(self.values.ravel()[cells[fresh]].astype(np.float64))
            odds *= factors
            np.clip(odds, 1.0 / self.largest_odds, self.largest_odds, out=odds)
            values = odds if self.kind == "odds" else odds / (1.0 + odds)
            return odds, values.astype(np.float32)

    def settle(
        self, covered: Covered, odds: Floats, foretold: Singles, missed: Cells, true: Singles
    ) -> Singles:
        """Take over what was foretold, but for the ``missed`` cells, which hold ``true``.

        A value that was missed by one bit had odds at the border between the two, nearly. Returns
        the values of all covered cells.
        """
        values = foretold.copy()
        values[missed] = true
        off = np.abs(foretold[missed].view(np.int32).astype(np.int64) - true.view(np.int32))
        with np.errstate(invalid="ignore", over="ignore"):
            between = (foretold[missed].astype(np.float64) + true) / 2.0
        odds[missed] = np.where(off <= 1, self._odds_of(between), 0.0)
        self._odds[covered.cells] = odds
        self.values.ravel()[covered.cells] = values
        return values

    def _odds_of(self, values: Floats) -> Floats:
        if self.kind == "odds":
            return values
        with np.errstate(divide="ignore", invalid="ignore"):
            odds: Floats = values / (1.0 - values)
        return odds


def largest_odds(clamp: float) -> float:
    """The odds beyond which readings change nothing, from the clamp of the log-odds."""
    return math.exp(clamp)
