"""Readings as columns → the batch kernels: which of them adds a reading, and what it has to know.

What no kernel knows (a plugin's model or rule, the rasteriser `arcs`, scans by most rules, a limit
``clear_to_m`` in front of what is seen) is merged reading by reading from its temp grid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.threads import band_edges, in_bands, in_parts
from mapping.parameters import Sensor
from mapping.readings import Readings
from mapping.sensor_model import SENSOR_MODELS, regions_table
from mapping.sensor_model.models import Fading, Peak, Regions
from mapping.update_rules.pooled import LIMITS
from mapping.update_rules.rules import (
    HIMM_HIT,
    HIMM_MISS,
    HIMM_MOST,
    Bayes,
    Binary,
    Count,
    DempsterShafer,
    Himm,
    Odds,
    Pooled,
    Saturating,
    Sum,
    UpdateRule,
)
from mapping.update_rules.state import Target
from recorder.columns import Floats, Ints

if TYPE_CHECKING:
    from mapping.kernels.batch.readings import Readings as Columns
    from mapping.kernels.batch.readings import ScanAxes

_MODELS = (Regions, Peak, Fading)
_KEPT_AXES = 256  # sets of directions
_LOOKED_AT = 100  # readings of a stretch, to see how many cells they cover
_CELLS_WORTH_A_THREAD = 20_000  # a scan: below, what each thread works out by itself costs more


class Adder(Protocol):
    """A kernel with what it knows of some sensors."""

    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        """Add the readings of some rows, in their order, to a map."""


def adder_of(rule: UpdateRule, sensors: Sequence[Sensor], number: int) -> str:
    """The name of the kernel for a sensor's readings of one axis; "" where there is none."""
    sensor = sensors[number]
    model = type(SENSOR_MODELS.get(sensor.model))
    if sensor.rasteriser != "cells" or model not in _MODELS:
        return ""
    if sensor.clear_to_m is not None:  # the kernels know no gap between front and band
        return ""
    if type(rule) in (Bayes, Odds):
        return "fading" if model is Fading else "regions"
    if type(rule) is Saturating:
        return "sums" if model is Fading else "cells"
    if type(rule) is Pooled:
        return "sums"
    kernels = {Binary: "bands", Count: "bands", Sum: "cells", DempsterShafer: "cells", Himm: "axes"}
    return kernels.get(type(rule), "")


def adders(rule: UpdateRule, sensors: Sequence[Sensor], mine: Sequence[int]) -> dict[str, Adder]:
    """The kernels for some of the sensors, by name; that for scans of sensor n is ``scans n``."""
    found: dict[str, list[int]] = {}
    for number in mine:
        found.setdefault(adder_of(rule, sensors, number), []).append(number)
    kinds: dict[str, type[_Kernel]] = {
        "fading": _FadingReadings, "regions": _RegionReadings, "bands": _Bands, "cells": _Cells,
        "axes": _Axes, "sums": _Sums,
    }  # fmt: skip
    made: dict[str, Adder] = {
        name: kinds[name](rule, sensors, some) for name, some in found.items() if name
    }
    for number in found.get("fading", ()):
        made[f"scans {number}"] = _FadingScans(sensors[number])
    for number in mine:
        if _has_fast_rays(rule, sensors[number]):
            made[f"scans {number}"] = _FadingRays(sensors[number])
    return made


def _has_fast_rays(rule: UpdateRule, sensor: Sensor) -> bool:
    is_fading = type(SENSOR_MODELS.get(sensor.model)) is Fading and type(rule) in (Bayes, Odds)
    return is_fading and sensor.rasteriser == "rays" and sensor.clear_to_m is None


class _Kernel:
    """What all kernels for readings of one axis have in common: the readings as they want them."""

    def __init__(self, rule: UpdateRule, sensors: Sequence[Sensor], mine: Sequence[int]) -> None:
        models = [sensors[number].models for number in mine]
        self.rule, self.sensors = rule, [model for each in models for model in each]
        self._row = np.zeros(len(sensors), np.int32)
        self._row[list(mine)] = np.cumsum([0, *map(len, models)])[:-1]
        # Up to which range each model goes but the last, by sensor.
        self._ends_m = np.full((len(sensors), max(map(len, models)) - 1), np.inf)
        for number in mine:
            nearer = sensors[number].nearer
            self._ends_m[number, : len(nearer)] = [model.up_to_m for model in nearer]
        self._half_rad = np.array([sensor.beam_width_rad / 2.0 for sensor in self.sensors])
        self._band = np.array([SENSOR_MODELS[s.model].band(s) for s in self.sensors])
        self._mark_to_m = np.array([s.mark_to_m or np.inf for s in self.sensors])
        self._empties = np.array([sensor.no_echo == "empties" for sensor in self.sensors])

    def columns(self, readings: Readings, rows: Ints) -> Columns:
        """Some readings, with where front and band of each end."""
        from mapping.kernels.batch.readings import Readings as Columns
        from mapping.kernels.batch.readings import ends_of

        start, axis = readings.world_from_sensor, readings.begins[rows]
        of = self._models_of(readings.sensor[rows], readings.ranges_m[axis])
        before, behind = self._band[of].T
        ends = ends_of(
            readings.ranges_m[axis], readings.reach_m[axis], before, behind, self._empties[of],
            self._mark_to_m[of],
        )  # fmt: skip
        heading_rad = readings.bearings_rad[axis] + start.heading_rad[rows]
        columns = (start.x_m[rows], start.y_m[rows], heading_rad, *ends)
        x_m, y_m, heading_rad, far, front, band = map(np.ascontiguousarray, columns)
        return Columns(x_m, y_m, heading_rad, far, front, band, of)

    def _models_of(self, sensor: Ints, range_m: Floats) -> NDArray[np.int32]:
        """The model of each reading (N,), as a row of the tables."""
        row = self._row[sensor]
        for end_m in self._ends_m.T:
            row = row + (range_m > end_m[sensor])
        return row.astype(np.int32, copy=False)

    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        """See :class:`Adder`."""
        raise NotImplementedError

    def in_bands(
        self, kernel: Callable[..., None], target: Target, columns: Columns, *more: Any,
        threads: int,
    ) -> None:  # fmt: skip
        """Run a loop on some columns, a thread a band of rows."""
        rows = len(target.observed)
        edges = band_edges(columns, self._half_rad, target.place, rows, threads)
        in_bands(kernel, *target, columns, *more, edges=edges)

    @property
    def has_front_evidence(self) -> Floats:
        """1 where a sensor's model has evidence for the cells in front of the band, (S,)."""
        return np.array([_has_front_evidence(sensor) for sensor in self.sensors], np.float64)


def _has_front_evidence(sensor: Sensor) -> bool:
    if sensor.model == Fading.name:
        return sensor.miss > 0.0
    if sensor.model == Peak.name and sensor.p_miss == 0.5:
        return False
    return sensor.emptiness != "none"


def _factors(sensor: Sensor) -> tuple[Floats, Floats]:
    """Factors of the angular regions and of those of the band; a one where it is not modelled."""
    both, table, one = sensor.gaussian == "both", regions_table(sensor.regions), np.ones(1)
    angle = table if both or sensor.gaussian == "angle" else one
    return angle, table if both or sensor.gaussian == "distance" else one


def _fading_row(sensor: Sensor) -> tuple[float, ...]:
    return sensor.beam_width_rad / 2.0, sensor.hit, sensor.miss, sensor.near, sensor.fade_m


class _FadingReadings(_Kernel):
    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        from mapping.kernels.loops import add_fading

        table = np.array([_fading_row(sensor) for sensor in self.sensors])
        self.in_bands(add_fading, target, self.columns(readings, rows), table, threads=threads)


class _RegionReadings(_Kernel):
    def __init__(self, rule: UpdateRule, sensors: Sequence[Sensor], mine: Sequence[int]) -> None:
        from mapping.kernels.batch.region_tables import peak_sensor, regions_sensor, tables_of

        super().__init__(rule, sensors, mine)
        known = []
        for sensor in self.sensors:
            common = sensor.beam_width_rad, sensor.emptiness, *_factors(sensor)
            if sensor.model == Peak.name:
                known.append(peak_sensor(*common, sensor.p_hit, sensor.p_miss))
            else:
                known.append(regions_sensor(*common))
        self._tables = tables_of(known)

    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        from mapping.kernels.loops import add_regions

        columns = self.columns(readings, rows)
        self.in_bands(add_regions, target, columns, *self._tables, threads=threads)


class _Bands(_Kernel):
    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        from mapping.kernels.batch.readings import BINARY, COUNT

        what = COUNT if isinstance(self.rule, Count) else BINARY
        self._mark(target, self.columns(readings, rows), what, threads)

    def _mark(self, target: Target, columns: Columns, what: int, threads: int) -> None:
        from mapping.kernels.loops import add_bands

        table = np.column_stack([self._half_rad, self.has_front_evidence])
        target = target._replace(array=target.array[0])
        self.in_bands(add_bands, target, columns, table, what, threads=threads)


class _Axes(_Bands):
    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        from mapping.kernels.batch.readings import NOTHING
        from mapping.kernels.loops import add_axes

        columns = self.columns(readings, rows)
        self._mark(target, columns, NOTHING, threads)
        add_axes(
            target.array[0], target.observed, target.place, columns, self._half_rad,
            HIMM_HIT, HIMM_MISS, HIMM_MOST,
        )  # fmt: skip


class _Cells(_Kernel):
    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        from mapping.kernels.batch import cell_tables
        from mapping.kernels.loops import add_cellwise

        tables = cell_tables.tables_of(
            [
                cell_tables.CellSensor(
                    s.beam_width_rad, s.model, s.emptiness, s.hit, s.miss, s.near, s.fade_m,
                    s.p_hit, s.p_miss, *_factors(s),
                )
                for s in self.sensors
            ]
        )  # fmt: skip
        rules = {Sum: cell_tables.SUM, Saturating: cell_tables.EVIDENCE}
        what = rules.get(type(self.rule), cell_tables.MASSES)
        columns = self.columns(readings, rows)
        self.in_bands(add_cellwise, target, columns, *tables, what, threads=threads)


class _Sums(_Kernel):
    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        from mapping.kernels.batch.cell_tables import POOLED, SATURATING
        from mapping.kernels.loops import add_sums

        rule, columns, free = self.rule, self.columns(readings, rows), self.has_front_evidence
        fades_m = [rule.learned.fade_m if isinstance(rule, Pooled) else s.fade_m
                   for s in self.sensors]  # fmt: skip
        table = np.array([
            (half, fade_m, with_free, s.hit, s.miss, s.near)
            for s, half, fade_m, with_free in zip(
                self.sensors, self._half_rad, fades_m, free, strict=True
            )
        ])  # fmt: skip
        what = POOLED if isinstance(rule, Pooled) else SATURATING
        self.in_bands(add_sums, target, columns, table, np.array(LIMITS), what, threads=threads)


class _FadingScans:
    """Scans of one laser, whose usable beams may be others each time."""

    def __init__(self, sensor: Sensor) -> None:
        self.sensor = sensor
        self._axes: dict[bytes, ScanAxes] = {}

    def add(self, target: Target, readings: Readings, rows: Ints, threads: int) -> None:
        from mapping.kernels.batch.readings import Scans, ends_of

        sensor, start = self.sensor, readings.world_from_sensor
        threads = worth_threads(readings, rows, target.place.size_m, threads)
        before, behind = SENSOR_MODELS[sensor.model].band(sensor)
        for same, bearings_rad in _same_beams(readings, rows):
            axes = readings.begins[same][:, None] + np.arange(len(bearings_rad))
            ends = ends_of(
                readings.ranges_m[axes], readings.reach_m[axes], before, behind,
                sensor.no_echo == "empties", sensor.mark_to_m or np.inf,
            )  # fmt: skip
            columns = (start.x_m[same], start.y_m[same], start.heading_rad[same], *ends)
            scans = Scans(*(np.ascontiguousarray(each, np.float64) for each in columns))
            known = self._axes_of(bearings_rad)
            row = np.array(_fading_row(sensor))
            in_parts(self.kernel(), *target, scans, known, row, threads=threads)

    def kernel(self) -> Callable[..., None]:
        """The loop that adds them."""
        from mapping.kernels.loops import add_scans

        return add_scans

    def _axes_of(self, bearings_rad: Floats) -> ScanAxes:
        from mapping.kernels.batch.readings import scan_axes

        key = bearings_rad.tobytes()
        if key not in self._axes:
            if len(self._axes) >= _KEPT_AXES:
                self._axes.clear()
            self._axes[key] = scan_axes(bearings_rad, self.sensor.beam_width_rad / 2.0)
        return self._axes[key]


class _FadingRays(_FadingScans):
    """The same as thin lines."""

    def kernel(self) -> Callable[..., None]:
        """The loop that adds them."""
        from mapping.kernels.loops import add_rays

        return add_rays


def _same_beams(readings: Readings, rows: Ints) -> Iterator[tuple[Ints, Floats]]:
    """Stretches of scans whose beams look the same ways, and these directions."""
    begins, bearings_rad = readings.begins, readings.bearings_rad
    each = [bearings_rad[begins[row] : begins[row + 1]] for row in rows.tolist()]
    first = 0
    for end in range(1, len(rows) + 1):
        if end == len(rows) or not np.array_equal(each[end], each[first]):
            yield rows[first:end], each[first]
            first = end


def worth_threads(readings: Readings, rows: Ints, resolution_m: float, threads: int) -> int:
    """One, where readings cover so few cells that another thread costs more than it brings."""
    if threads == 1 or not len(rows):
        return 1
    some = rows[:: -(-len(rows) // _LOOKED_AT)]
    area_m2 = 0.0
    for row in some.tolist():
        axes = slice(readings.begins[row], readings.begins[row + 1])
        far_m = np.minimum(readings.ranges_m[axes], readings.reach_m[axes])
        width_rad = readings.sensors[readings.sensor[row]].beam_width_rad
        area_m2 += 0.5 * width_rad * float(np.square(far_m).sum())
    return threads if area_m2 / len(some) / resolution_m**2 > _CELLS_WORTH_A_THREAD else 1


def runs_of(values: NDArray[np.generic]) -> Iterator[tuple[int, int]]:
    """Where stretches of the same value begin and end."""
    borders = np.flatnonzero(values[1:] != values[:-1]) + 1
    edges = [0, *borders.tolist(), len(values)]
    return pairwise(edges) if len(values) else iter(())
