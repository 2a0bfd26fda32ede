"""A layer's readings → the records of its log.

The first readings of a sensor wait until there are enough of them to make a table of their
factors by distance; all later ones are written at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.grid import GridGeometry, Window
from mapping.update_rules import CLAMP
from replay.rrd.value_log.radial_profile import RadialProfile, fit_table
from replay.rrd.value_log.records import (
    Masks,
    formula_record,
    plain_record,
    predicted_record,
    summed_record,
    table_record,
)
from replay.rrd.value_log.sums import Formula
from replay.rrd.value_log.track import Covered, Floats, Singles, Track

T = TypeVar("T")

_MOST_MISSED = 0.4  # of the covered cells; above it plain differences are smaller
_GATHERED = 16  # readings, before a table is made of them
_MOST_WAITING = 64  # readings, of all sensors
_MOST_SAMPLES = 100_000
_MOST_TABLES = 6  # tried for one sensor; then its evidence is no function of the distance
_TRIED = 64  # cells by which a table is judged
_FITS = 1e-9  # relative
_FITTING = 0.9  # of the tried cells


@dataclass(frozen=True, slots=True)
class _Waiting(Generic[T]):
    """A reading not yet written: its new values, its evidence, and whatever came with it."""

    window: Window
    values: Singles
    temp: TempGrid | None
    table: int | None  # that fits it, where one was there already
    ticket: T


@dataclass(slots=True)
class _Sensor:
    """Samples of one sensor's factors, for its next table, and how many tables were tried."""

    tried: int = 0
    distances_m: list[Floats] = field(default_factory=list)
    factors: list[Floats] = field(default_factory=list)


class LogEncoder(Generic[T]):
    """Makes the records of one layer; a ``ticket`` comes back with each record.

    ``predicts`` states whether readings may multiply the odds of the cells.
    """

    def __init__(self, geometry: GridGeometry, kind: str, start: float, *, predicts: bool) -> None:
        self._predicts = predicts
        self._track = Track(geometry, kind, start, math.exp(CLAMP))
        self._number = 0
        self._sensors: dict[str, _Sensor] = {}
        self._lacking: set[str] = set()  # sensors that wait for a table
        self._waiting: list[_Waiting[T]] = []
        self._new_tables: list[RadialProfile] = []
        self._sums_are_known = True  # until anything else than readings of one rule came

    def add(
        self,
        window: Window,
        values: Singles,
        temp: TempGrid | None,
        ticket: T,
        formula: Formula | None = None,
    ) -> list[tuple[T, bytes]]:
        """One more reading; the records that are ready now, oldest first.

        ``formula`` is that of a rule whose sums can be followed: as long as all readings of the
        layer came with it, their records hold how the sums grew.
        """
        if window.empty:
            return []
        if self._sums_are_known:
            record = None if temp is None else self._summed(window, values, temp, formula)
            if record is not None:
                return [(ticket, record)]
            self._sums_are_known = False
        table = None
        if temp is not None and self._predicts and _is_whole(window, temp):
            table = self._look_at(temp)
        else:
            temp = None
        self._waiting.append(_Waiting(window, values, temp, table, ticket))
        if self._lacking and len(self._waiting) < _MOST_WAITING:
            return []
        return self.drain()

    def drain(self) -> list[tuple[T, bytes]]:
        """All that waits, oldest first, with tables from what there is."""
        for sensor in self._sensors.values():
            self._make_table(sensor)
        self._lacking.clear()
        waiting, self._waiting = self._waiting, []
        records = [(each.ticket, self._written(each)) for each in waiting]
        return [(ticket, record) for ticket, record in records if record]

    def replace(self, window: Window, values: Singles) -> None:
        """The file holds these values whole; nothing may wait."""
        if self._changed(window, values).any():
            self._sums_are_known = False
        self._track.replace(window, values)

    def restart(self) -> None:
        """Begin anew after a whole map, so that a reader need not know what was before it."""
        self._track.restart()

    def _summed(
        self, window: Window, values: Singles, temp: TempGrid, formula: Formula | None
    ) -> bytes | None:
        """The record of a reading by which sums grow, if it can be one."""
        if formula is None or len(temp.beam.ranges_m) != 1 or not _is_whole(window, temp):
            return None
        values = np.ascontiguousarray(values, np.float32)
        others = self._other_changes(temp, values)
        if others.any():
            return None
        begun = b""
        if self._track.formula is None:
            begun = formula_record(self._track, self._number, formula)
        masks, reading = Masks(window, temp.free, temp.band, others), formula.reading(temp)
        number = self._number + bool(begun)
        record = summed_record(self._track, number, masks, reading, values, _MOST_MISSED)
        if record is None:
            return None
        self._number = number + 1
        return begun + record

    def _look_at(self, temp: TempGrid) -> int | None:
        """The table that fits a reading; samples of one that none fits yet are kept."""
        sensor = self._sensors.setdefault(temp.beam.sensor, _Sensor())
        table, share = self._best_table(temp)
        if share >= _FITTING or sensor.tried >= _MOST_TABLES:
            return table
        distances, factors = self._samples(temp, 0)
        sensor.distances_m.append(distances)
        sensor.factors.append(factors)
        if len(sensor.factors) < _GATHERED:
            self._lacking.add(temp.beam.sensor)
        else:
            self._lacking.discard(temp.beam.sensor)
        return None

    def _samples(self, temp: TempGrid, most: int) -> tuple[Floats, Floats]:
        """Distances and factors of about ``most`` cells in front of a reading; 0: of all."""
        from replay.rrd.value_log.loops import some_of

        free = some_of(temp.free, most)
        row, col = np.divmod(free, temp.window.cols)
        cells = (row + temp.window.row0) * temp.geometry.cols + col + temp.window.col0
        return (
            self._track.distances_m(_sensor_m(temp), cells),
            self._factors(temp.probability.ravel()[free]),
        )

    def _factors(self, probability: Floats) -> Floats:
        """What readings multiply the odds by."""
        largest = self._track.largest_odds
        with np.errstate(divide="ignore"):
            return np.clip(probability / (1.0 - probability), 1.0 / largest, largest)

    def _best_table(self, temp: TempGrid) -> tuple[int | None, float]:
        """The table that fits most of some cells of a reading, and that share of them."""
        distances, factors = self._samples(temp, _TRIED)
        if not len(factors):
            return None, 1.0
        from replay.rrd.value_log.loops import share_fitting

        best: tuple[int | None, float] = (None, 0.0)
        for number in reversed(range(len(self._track.tables))):
            spacing_m, cubics = self._track.tables[number]
            share = share_fitting(cubics, spacing_m, distances, factors, _FITS)
            if share > best[1]:
                best = (number, share)
            if share >= _FITTING:
                break
        return best

    def _make_table(self, sensor: _Sensor) -> None:
        if not sensor.factors:
            return
        distances, factors = np.concatenate(sensor.distances_m), np.concatenate(sensor.factors)
        sensor.distances_m.clear()
        sensor.factors.clear()
        every = -(-len(factors) // _MOST_SAMPLES)
        table = fit_table(distances[::every], factors[::every])
        sensor.tried += 1 if table is not None else _MOST_TABLES // 2
        if table is not None:
            self._new_tables.append(table)

    def _written(self, reading: _Waiting[T]) -> bytes:
        """The records of one reading, with the tables that are new."""
        records = b""
        for table in self._new_tables:
            records += table_record(self._track, self._number, table)
            self._number += 1
        self._new_tables.clear()
        record = self._predicted(reading) if reading.temp is not None else None
        if record is None:
            record = self._plain(reading)
        self._number += bool(record)
        return records + record

    def _predicted(self, reading: _Waiting[T]) -> bytes | None:
        temp, values = reading.temp, np.ascontiguousarray(reading.values, np.float32)
        assert temp is not None
        masks = Masks(reading.window, temp.free, temp.band, self._other_changes(temp, values))
        cells, inner, in_front, in_band = masks.covered(self._track.geometry)
        factors = self._factors(temp.probability.ravel()[inner[in_front : in_front + in_band]])
        covered = Covered(_sensor_m(temp), cells, inner, in_front, in_band, factors)
        true = values.ravel()[inner]
        table = self._best_table(temp)[0] if reading.table is None else reading.table
        return predicted_record(
            self._track, self._number, masks, covered, table, true, _MOST_MISSED
        )

    def _other_changes(self, temp: TempGrid, values: Singles) -> NDArray[np.bool_]:
        """Cells of a reading's window that changed although it is no evidence for them."""
        from replay.rrd.value_log.loops import other_changes

        others: NDArray[np.bool_] = other_changes(
            values.view(np.uint32), self._track.values.view(np.uint32), temp.free, temp.band,
            temp.window.row0, temp.window.col0,
        )  # fmt: skip
        return others

    def _plain(self, reading: _Waiting[T]) -> bytes:
        """Of the smallest rectangle that holds what changed; nothing where nothing did."""
        changed = self._changed(reading.window, reading.values)
        if not changed.any():
            return b""
        inner = Window.around(changed)
        w = reading.window
        box = Window(w.row0 + inner.row0, w.col0 + inner.col0, inner.rows, inner.cols)
        return plain_record(self._track, self._number, box, reading.values[inner.slices])

    def _changed(self, window: Window, values: Singles) -> NDArray[np.bool_]:
        old = self._track.values[window.slices]
        changed: NDArray[np.bool_] = np.ascontiguousarray(values, np.float32).view(
            np.uint32
        ) != old.view(np.uint32)
        return changed


def _is_whole(window: Window, temp: TempGrid) -> bool:
    """Whether all that a reading says stands in a temp grid, each cell in front or in the band."""
    return (
        temp.window == window
        and not temp.sub_grids
        and not window.empty
        and not (temp.free & temp.band).any()
    )


def _sensor_m(temp: TempGrid) -> tuple[float, float]:
    """Where the sensor of a reading stood."""
    sensor = temp.beam.world_from_sensor
    return sensor.x_m, sensor.y_m
