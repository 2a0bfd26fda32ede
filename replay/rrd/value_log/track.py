"""What the writer and the reader of a layer's value log both know, and how a reading moves it.

Both keep the values and the odds of every cell. A reading multiplies the odds of the cells that it
covers; what comes of it is predicted from there. Only sums, products and roots are used, which give
the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry, Window
from replay.rrd.value_log.radial_profile import RadialProfile
from replay.rrd.value_log.sums import Formula, SummedReading, logarithms

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Cells = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Covered:
    """The cells that a reading covers, as flat indices into the grid, and its factors there.

    The first ``in_front`` of ``cells`` lie in front, of which only the distance is known; then come
    those in the band, whose ``factors`` are given, and others that are changed without one.
    ``inner`` are the same cells as indices into the reading's window, ``sensor_m`` is where the
    sensor stood.
    """

    sensor_m: tuple[float, float]
    cells: Cells
    inner: Cells
    in_front: int
    in_band: int
    factors: Floats


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
        self.formula: Formula | None = None  # of a rule whose sums are followed
        self._sums: Floats = np.zeros((0, 0))
        self.restart()

    def restart(self) -> None:
        """Forget all odds; they begin again from the values."""
        self._odds: Floats = np.zeros(self.values.size)  # 0: not known but from the value

    def add_table(self, table: RadialProfile) -> None:
        """One more table that readings may name."""
        self.tables.append((table.spacing_m, table.cubics()))

    def begin_sums(self, formula: Formula) -> None:
        """From here on sums are followed: no reading was merged yet."""
        self.formula = formula
        self._sums = np.tile(formula.start, (self.values.size, 1))

    def follow_sums(self, cells: Cells, in_front: int, reading: SummedReading) -> None:
        """Let the sums grow of the cells that a reading covers, the first of them in front.

        Raises ValueError where no sums are followed.
        """
        from replay.rrd.value_log.loops import follow_sums

        if self.formula is None:
            raise ValueError("sums without their formula")
        distances = np.empty(len(cells))
        for part in (slice(0, in_front), slice(in_front, None)):
            distances[part] = self.distances_m(reading.sensor_m, cells[part])
        follow_sums(cells, in_front, distances, self._sums, reading.numbers, self.formula.numbers)

    def values_by_sums(self, cells: Cells) -> Singles:
        """The values that the sums of cells should stand for."""
        from replay.rrd.value_log.loops import values_of_sums

        assert self.formula is not None
        values: Singles = values_of_sums(
            cells, self._sums, self.formula.numbers, logarithms(), self.formula.curve
        )
        return values

    def replace(self, window: Window, values: Singles) -> None:
        """Take over values that are given, in a window."""
        part = self.values[window.slices]
        # Compared as bits: NaN equals itself, and 0.0 is not -0.0.
        changed = part.view(np.uint32) != np.ascontiguousarray(values).view(np.uint32)
        self._odds.reshape(self.geometry.shape)[window.slices][changed] = 0.0
        part[...] = values

    def distances_m(self, sensor_m: tuple[float, float], cells: Cells) -> Floats:
        """From a sensor to the centres of cells, which are in ascending order."""
        from replay.rrd.value_log.loops import distances_m

        geometry = self.geometry
        x, y = (start - at for start, at in zip(geometry.origin_m, sensor_m, strict=True))
        distances: Floats = distances_m(cells, geometry.cols, geometry.resolution_m, x, y)
        return distances

    def predict(self, covered: Covered, table: int) -> tuple[Floats, Singles]:
        """Odds and values that the covered cells should have after a reading."""
        from replay.rrd.value_log.loops import front_factors, predict

        free = np.ones(covered.in_front)
        if table < len(self.tables):
            spacing_m, cubics = self.tables[table]
            distances = self.distances_m(covered.sensor_m, covered.cells[: covered.in_front])
            free = front_factors(cubics, spacing_m, distances)
        odds, values = predict(
            covered.cells, free, covered.factors, self._odds, self.values.ravel(),
            self.kind == "odds", self.largest_odds,
        )  # fmt: skip
        return odds, values

    def settle(
        self, covered: Covered, odds: Floats, predicted: Singles, missed: Cells, true: Singles
    ) -> Singles:
        """Take over what was predicted, but for the ``missed`` cells, which hold ``true``.

        A value that was missed by one bit had odds at the border between the two, nearly. Returns
        the values of all covered cells; ``odds`` and ``predicted`` are written over.
        """
        from replay.rrd.value_log.loops import settle

        off = np.abs(predicted[missed].view(np.int32).astype(np.int64) - true.view(np.int32))
        settle(
            covered.cells, odds, predicted, missed, true, off, self._odds, self.values.ravel(),
            self.kind == "odds",
        )  # fmt: skip
        return predicted
