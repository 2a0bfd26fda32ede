"""The default rasteriser: every cell that the beam covers, once, at its centre."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.grid import GridGeometry, Window, read_only
from mapping.parameters import Sensor
from mapping.sensor_model.models import CellsInBeam, SensorModel

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Spans:
    """Of each axis, (N,) metres: its range, and where its band begins and ends.

    An axis that saw nothing has its front up to the sensor's reach and no band (an end of -1); one
    without evidence of any kind begins at -1, too.
    """

    range_m: Floats
    start_m: Floats
    end_m: Floats

    def of(self, axes: Integers | slice) -> Spans:
        """The same for some of the axes."""
        return Spans(self.range_m[axes], self.start_m[axes], self.end_m[axes])


def spans_of(beam: Beam, sensor: Sensor, model: SensorModel) -> Spans:
    """Where front and band of each axis lie."""
    before, behind = model.band(sensor)
    ranges = np.asarray(beam.ranges_m, np.float64)
    seen = np.isfinite(ranges) & (ranges >= 0.0)
    silent = ~seen & ~(np.isposinf(ranges) & (sensor.no_echo == "empties"))
    range_m = np.where(seen, ranges, beam.reach_m)
    start = np.where(seen, range_m * (1.0 - before), range_m)
    end = np.where(seen, range_m * (1.0 + behind), -1.0)
    start[silent] = -1.0
    return Spans(range_m, start, end)


@dataclass(slots=True)
class Covered:
    """The cells found in a window: flat index and place as seen along the beam, all (M,)."""

    index: Integers
    rho_m: Floats
    along_m: Floats
    across_m: Floats
    owner: Integers


def rasterise_cells(
    beam: Beam, sensor: Sensor, model: SensorModel, geometry: GridGeometry
) -> TempGrid:
    """The temp grid of a reading, from the centres of the cells.

    An axis none of whose cells lies in its band (a narrow beam, a small error, coarse cells) takes
    the cell that holds its obstacle point as the band, seen as if its centre were that point.
    """
    spans = spans_of(beam, sensor, model)
    window = geometry.window_around(*beam.bounds_m(reach_of(model, sensor)))
    free = np.zeros((window.rows, window.cols), np.bool_)
    band = np.zeros_like(free)
    if beam.ranges_m.size == 1:
        covered, with_band = _one_axis(beam, spans, geometry, window, free, band)
    else:
        covered, with_band = _many_axes(beam, spans, geometry, window, free, band)
    if not with_band.all():
        covered = _with_point_bands(beam, spans, geometry, window, covered, with_band, free, band)
    if sensor.clear_to_m is not None:
        covered = _cleared_no_farther(covered, sensor.clear_to_m, free, band)
    beam_cells = _cells_in_beam(beam, spans, covered, band)
    probability = np.full(free.shape, 0.5)
    probability.ravel()[covered.index] = model.occupied(sensor, beam_cells)
    for array in (probability, band, free):
        read_only(array)
    return TempGrid(beam, geometry, window, probability, band, free)


def reach_of(model: SensorModel, sensor: Sensor) -> float:
    """How far a reading can touch cells, in shares of its range: to the end of its band."""
    return 1.0 + max(0.0, model.band(sensor)[1])


def _centres(geometry: GridGeometry, window: Window, beam: Beam) -> tuple[Floats, Floats]:
    """Centres of the window's columns (x) and rows (y) relative to the sensor, metres."""
    (x0, y0), size = geometry.origin_m, geometry.resolution_m
    origin = beam.world_from_sensor
    column = np.arange(window.col0, window.col0 + window.cols, dtype=np.float64)
    row = np.arange(window.row0, window.row0 + window.rows, dtype=np.float64)
    return (column + 0.5) * size + x0 - origin.x_m, (row + 0.5) * size + y0 - origin.y_m


def _one_axis(
    beam: Beam, spans: Spans, geometry: GridGeometry, window: Window, free: Flags, band: Flags
) -> tuple[Covered, Flags]:
    from mapping.kernels import loops

    heading, half = float(beam.headings_rad[0]), beam.beam_width_rad / 2.0
    index = np.empty(free.size, np.int64)
    rho, along, across = (np.empty(free.size) for _ in range(3))
    found, in_band = loops.wedge(
        *_centres(geometry, window, beam), math.cos(heading), math.sin(heading), half,
        float(spans.start_m[0]), float(spans.end_m[0]), free, band, index, rho, along, across,
    )  # fmt: skip
    owner = np.zeros(found, np.int64)
    covered = Covered(index[:found], rho[:found], along[:found], across[:found], owner)
    return covered, np.array([in_band > 0])


def _many_axes(
    beam: Beam, spans: Spans, geometry: GridGeometry, window: Window, free: Flags, band: Flags
) -> tuple[Covered, Flags]:
    from mapping.kernels import loops

    headings = beam.headings_rad
    index, owner = np.empty(free.size, np.int64), np.empty(free.size, np.int64)
    rho, along, across = (np.empty(free.size) for _ in range(3))
    in_band = np.zeros(headings.size, np.int64)
    found = loops.fan(
        *_centres(geometry, window, beam), *_borders_between(headings), np.cos(headings),
        np.sin(headings), beam.beam_width_rad / 2.0, spans.start_m, spans.end_m, free, band,
        index, rho, along, across, owner, in_band,
    )  # fmt: skip
    covered = Covered(index[:found], rho[:found], along[:found], across[:found], owner[:found])
    return covered, in_band > 0


def _borders_between(headings_rad: Floats) -> tuple[Floats, Integers]:
    """Directions half way between neighbouring axes, ascending, and the axis after each.

    Of axes that look the same way the first is taken.
    """
    from mapping.kernels import loops

    directions, axes = np.unique(headings_rad % (2.0 * math.pi), return_index=True)
    gaps = np.diff(directions, append=directions[0] + 2.0 * math.pi)
    middles = directions + gaps / 2.0
    turns = loops.turns_of(np.cos(middles), np.sin(middles))
    order = np.argsort(turns, kind="stable")
    return turns[order], np.roll(axes, -1)[order]


def _with_point_bands(
    beam: Beam, spans: Spans, geometry: GridGeometry, window: Window, covered: Covered,
    with_band: Flags, free: Flags, band: Flags,
) -> Covered:  # fmt: skip
    """Add the obstacle's own cell of each axis without a band; the shortest range wins a cell."""
    lacking = np.flatnonzero(~with_band & (spans.end_m >= 0.0))
    lacking = lacking[np.argsort(-spans.range_m[lacking], kind="stable")]
    d, heading = spans.range_m[lacking], beam.headings_rad[lacking]
    origin = beam.world_from_sensor
    points = np.column_stack([origin.x_m + d * np.cos(heading), origin.y_m + d * np.sin(heading)])
    cells = geometry.cells_of(points) - (window.row0, window.col0)
    inside = ((cells >= 0) & (cells < (window.rows, window.cols))).all(axis=1)
    cells, lacking, d = cells[inside], lacking[inside], d[inside]
    flat = cells[:, 0] * window.cols + cells[:, 1]
    band.ravel()[flat], free.ravel()[flat] = True, False
    # Of several axes that end in one cell the last, the shortest, stays.
    _, last = np.unique(flat[::-1], return_index=True)
    chosen = flat.size - 1 - last
    flat, lacking, d = flat[chosen], lacking[chosen], d[chosen]
    kept = ~np.isin(covered.index, flat)
    return Covered(
        np.concatenate([covered.index[kept], flat]),
        np.concatenate([covered.rho_m[kept], d]),
        np.concatenate([covered.along_m[kept], d]),
        np.concatenate([covered.across_m[kept], np.zeros_like(d)]),
        np.concatenate([covered.owner[kept], lacking]),
    )


def _cleared_no_farther(covered: Covered, clear_to_m: float, free: Flags, band: Flags) -> Covered:
    """Those of the cells that lie in a band or near enough; the others are not free any more."""
    kept = band.ravel()[covered.index] | (covered.rho_m <= clear_to_m)
    free.ravel()[covered.index[~kept]] = False
    return Covered(
        covered.index[kept], covered.rho_m[kept], covered.along_m[kept], covered.across_m[kept],
        covered.owner[kept],
    )  # fmt: skip


def _cells_in_beam(beam: Beam, spans: Spans, covered: Covered, band: Flags) -> CellsInBeam:
    of_cells = spans.of(covered.owner)
    return CellsInBeam(
        rho_m=covered.rho_m,
        along_m=covered.along_m,
        across_m=covered.across_m,
        range_m=of_cells.range_m,
        band_start_m=of_cells.start_m,
        band_end_m=of_cells.end_m,
        in_band=band.ravel()[covered.index],
        half_width_rad=beam.beam_width_rad / 2.0,
    )
