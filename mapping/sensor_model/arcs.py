"""The chapter's own rasteriser: samples along arcs, half a cell apart in range.

Rounding makes it hit some cells several times and miss others. With a second grid the last sample
of a cell stays, and the reading is merged once. Without it every sample goes straight into the map,
so that the speckle, which the second grid cures, can be seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.grid import GridGeometry, Window, read_only
from mapping.parameters import Sensor
from mapping.sensor_model.cells import Spans, reach_of, spans_of
from mapping.sensor_model.models import CellsInBeam, SensorModel

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

RANGE_STEP_CELLS = 0.5
_ROUNDING = 1e-9  # so that the last step of a loop is not lost to rounding


@dataclass(frozen=True, slots=True)
class Samples:
    """Points of one or more axes in polar form, (M,): range, angle off the axis, which axis."""

    rho_m: Floats
    off_rad: Floats
    in_band: Flags
    axis: Integers


def rasterise_arcs(
    beam: Beam, sensor: Sensor, model: SensorModel, geometry: GridGeometry
) -> TempGrid:
    """The temp grid of a reading, from samples; ``sub_grids`` holds each of them once, if asked."""
    spans = spans_of(beam, sensor, model)
    samples = _samples(beam, spans, geometry.resolution_m, halved=sensor.gaussian != "none")
    window = geometry.window_around(*beam.bounds_m(reach_of(model, sensor)))
    probability = model.occupied(sensor, _cells_in_beam(beam, spans, samples))
    cells = geometry.cells_of(_points(beam, samples)) - (window.row0, window.col0)
    inside = ((cells >= 0) & (cells < (window.rows, window.cols))).all(axis=1)
    cells, probability, band = cells[inside], probability[inside], samples.in_band[inside]
    whole = _grid(beam, geometry, window, cells, probability, band)
    if sensor.second_grid:
        return whole
    sub_grids = tuple(
        _grid(beam, geometry, *_shrunk(window, cells[taken]), probability[taken], band[taken])
        for taken in _repeats(cells[:, 0] * window.cols + cells[:, 1])
    )
    return TempGrid(
        beam, geometry, window, whole.probability, whole.band, whole.free, sub_grids=sub_grids
    )


def angular_step(
    rho_m: Floats, beam_width_rad: float, resolution_m: float, *, halved: bool
) -> Floats:
    """Angle between neighbouring samples of arcs at some ranges, radians.

    The beam's width over the arc's chord in cells (half of that in the chapter's Gaussian code),
    never more than the beam. Past half a turn, where the chord shrinks again, the arc's length
    stands for it.
    """
    if beam_width_rad <= math.pi:
        chord = 2.0 * rho_m * math.sin(beam_width_rad / 2.0) / resolution_m
    else:
        chord = rho_m * beam_width_rad / resolution_m
    share = 0.5 if halved else 1.0
    return beam_width_rad * np.minimum(1.0, share / np.maximum(chord, share))


def _samples(beam: Beam, spans: Spans, resolution_m: float, *, halved: bool) -> Samples:
    parts = [
        _samples_of_axis(beam.beam_width_rad, spans, axis, resolution_m, halved)
        for axis in range(beam.ranges_m.size)
    ]
    rho, off, band = (np.concatenate([part[k] for part in parts]) for k in range(3))
    axis = np.repeat(np.arange(len(parts)), [part[0].size for part in parts])
    if len(parts) > 1:  # the sample nearest to its axis is written last, so it stays
        order = np.argsort(-np.abs(off), kind="stable")
        rho, off, band, axis = rho[order], off[order], band[order], axis[order]
    return Samples(rho, off, band.astype(np.bool_), axis)


def _samples_of_axis(
    width_rad: float, spans: Spans, axis: int, resolution_m: float, halved: bool
) -> tuple[Floats, Floats, Flags]:
    start, end = float(spans.start_m[axis]), float(spans.end_m[axis])
    step = RANGE_STEP_CELLS * resolution_m
    free = np.arange(0.0, start, step) if start > 0.0 else np.empty(0)
    band = start + step * np.arange(math.floor((end - start) / step + _ROUNDING) + 1)
    if end < 0.0:
        band = np.empty(0)
    ranges = np.concatenate([free, band])
    in_band = np.arange(ranges.size) >= free.size
    turn = angular_step(ranges, width_rad, resolution_m, halved=halved)
    count = np.floor(width_rad / turn + _ROUNDING).astype(np.int64) + 1
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    off = np.minimum(number * np.repeat(turn, count) - width_rad / 2.0, width_rad / 2.0)
    return np.repeat(ranges, count), off, np.repeat(in_band, count)


def _points(beam: Beam, samples: Samples) -> Floats:
    heading, origin = beam.headings_rad[samples.axis] + samples.off_rad, beam.world_from_sensor
    x = origin.x_m + np.cos(heading) * samples.rho_m
    y = origin.y_m + np.sin(heading) * samples.rho_m
    return np.column_stack([x, y])


def _cells_in_beam(beam: Beam, spans: Spans, samples: Samples) -> CellsInBeam:
    of_samples = spans.of(samples.axis)
    return CellsInBeam(
        rho_m=samples.rho_m,
        along_m=samples.rho_m * np.cos(samples.off_rad),
        across_m=samples.rho_m * np.sin(samples.off_rad),
        range_m=of_samples.range_m,
        band_start_m=of_samples.start_m,
        band_end_m=of_samples.end_m,
        in_band=samples.in_band,
        half_width_rad=beam.beam_width_rad / 2.0,
    )


def _grid(
    beam: Beam, geometry: GridGeometry, window: Window, cells: Integers, probability: Floats,
    band: Flags,
) -> TempGrid:  # fmt: skip
    """Write the samples in their order: the last one of a cell stays."""
    row, col = cells[:, 0], cells[:, 1]
    grid = np.full((window.rows, window.cols), 0.5)
    in_band = np.zeros(grid.shape, np.bool_)
    touched = np.zeros(grid.shape, np.bool_)
    grid[row, col] = probability
    in_band[row, col] = band
    touched[row, col] = True
    free = touched & ~in_band
    for array in (grid, in_band, free):
        read_only(array)
    return TempGrid(beam, geometry, window, grid, in_band, free)


def _repeats(flat: Integers) -> list[Integers]:
    """Samples by how often their cell came before: first all first ones, then all second ones."""
    order = np.argsort(flat, kind="stable")
    ordered = flat[order]
    first = np.flatnonzero(np.diff(ordered, prepend=-1))
    count = np.diff(first, append=ordered.size)
    nth = np.arange(ordered.size) - np.repeat(first, count)
    return [np.sort(order[nth == k]) for k in range(int(nth.max(initial=-1)) + 1)]


def _shrunk(window: Window, cells: Integers) -> tuple[Window, Integers]:
    """The smallest rectangle that holds some cells of a window, and the cells in it."""
    low, high = cells.min(axis=0), cells.max(axis=0)
    rows, cols = (int(v) for v in high - low + 1)
    small = Window(window.row0 + int(low[0]), window.col0 + int(low[1]), rows, cols)
    return small, cells - low
