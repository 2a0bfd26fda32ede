"""Thin rays: of each axis only the cells that a line from the sensor to the obstacle runs through.

A ray runs along x or y, whichever it does more, and takes the cell in which it crosses the middle
of each column (row) between the sensor's and the obstacle's. The sensor's own cell is free, the
obstacle's is the band; each cell counts once a reading, and where a ray runs through the obstacle
of another one, the obstacle wins.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.grid import GridGeometry, Window, read_only
from mapping.kernels.batch.readings import scan_axes
from mapping.parameters import Sensor
from mapping.sensor_model.cells import Covered, Spans, cells_in_beam, reach_of, spans_of
from mapping.sensor_model.models import SensorModel

Integers = NDArray[np.int64]
_WHOLE = float(1 << 32)  # slopes and places along a ray are whole numbers of so many parts


def rasterise_rays(
    beam: Beam, sensor: Sensor, model: SensorModel, geometry: GridGeometry
) -> TempGrid:
    """The temp grid of a reading whose beams are taken as lines."""
    spans = spans_of(beam, sensor, model)
    window = _window_of(beam, sensor, model, geometry)
    owner = np.full((window.rows, window.cols), -1, np.int64)
    band = np.zeros(owner.shape, np.bool_)
    origin, headings = beam.world_from_sensor, beam.headings_rad
    kept = np.sort(scan_axes(beam.bearings_rad, beam.beam_width_rad / 2.0).axis)
    said = kept[spans.start_m[kept] >= 0.0]
    cosine, sine = (np.array(list(map(f, headings.tolist()))) for f in (math.cos, math.sin))
    ends = np.column_stack([origin.x_m + spans.range_m * cosine, origin.y_m + spans.range_m * sine])
    at = np.array([[origin.x_m, origin.y_m]])
    (own,), end_cells = geometry.cells_of(at), geometry.cells_of(ends)
    for axis in said[::-1].tolist():  # of several rays through a cell the first is its owner
        if (end_cells[axis] == own).all():
            continue
        passed = np.vstack([own, _passed(geometry, beam, axis, end_cells[axis])]).astype(np.int64)
        cells = _inside(passed - (window.row0, window.col0), window)
        owner[cells[:, 0], cells[:, 1]] = axis
    if sensor.clear_to_m is not None:
        owner[_rho_m(geometry, window, beam) > sensor.clear_to_m] = -1
    hits = said[spans.end_m[said] >= 0.0]
    for axis in hits[np.argsort(-spans.range_m[hits], kind="stable")].tolist():  # the nearest last
        cells = _inside(end_cells[axis][None] - (window.row0, window.col0), window)
        owner[cells[:, 0], cells[:, 1]], band[cells[:, 0], cells[:, 1]] = axis, True
    return _temp_grid(beam, sensor, model, geometry, window, spans, owner, band)


def _window_of(beam: Beam, sensor: Sensor, model: SensorModel, geometry: GridGeometry) -> Window:
    """All that the rays can touch: a line may leave the box of its ends by half a cell."""
    low, high = beam.bounds_m(max(reach_of(model, sensor), 1.0))
    size = geometry.resolution_m
    return geometry.window_around(low - size, high + size)


def _passed(geometry: GridGeometry, beam: Beam, axis: int, end: Integers) -> Integers:
    """Row and column (N, 2) of the cells between the sensor's and the one where the ray ends."""
    (x0, y0), size, origin = geometry.origin_m, geometry.resolution_m, beam.world_from_sensor
    place = np.array([(origin.y_m - y0) / size, (origin.x_m - x0) / size])  # row, column
    own = np.floor(place).astype(np.int64)
    heading = float(beam.headings_rad[axis])
    forward = math.sin(heading), math.cos(heading)
    main = 1 if abs(forward[1]) >= abs(forward[0]) else 0
    side, ahead = 1 - main, 1 if forward[main] > 0.0 else -1
    slope = forward[side] / abs(forward[main])
    off = ahead * (own[main] + 0.5 - place[main])
    step = math.floor(slope * _WHOLE + 0.5)
    begin = math.floor((place[side] - own[side] + off * slope) * _WHOLE)
    k = np.arange(1, abs(int(end[main] - own[main])), dtype=np.int64)
    cells = np.empty((len(k), 2), np.int64)
    cells[:, main] = own[main] + ahead * k
    cells[:, side] = own[side] + ((begin + k * step) >> 32)
    return cells


def _inside(cells: Integers, window: Window) -> Integers:
    return cells[((cells >= 0) & (cells < (window.rows, window.cols))).all(axis=1)]


def _rho_m(geometry: GridGeometry, window: Window, beam: Beam) -> NDArray[np.float64]:
    """How far the centre of each cell of a window lies from the sensor."""
    (x0, y0), size, origin = geometry.origin_m, geometry.resolution_m, beam.world_from_sensor
    x = (np.arange(window.col0, window.col0 + window.cols) + 0.5) * size + x0 - origin.x_m
    y = (np.arange(window.row0, window.row0 + window.rows) + 0.5) * size + y0 - origin.y_m
    rho_m: NDArray[np.float64] = np.hypot(x[None, :], y[:, None])
    return rho_m


def _temp_grid(
    beam: Beam, sensor: Sensor, model: SensorModel, geometry: GridGeometry, window: Window,
    spans: Spans, owner: Integers, band: NDArray[np.bool_],
) -> TempGrid:  # fmt: skip
    """The evidence of the cells that have an owner; of a band's cell as if at its obstacle."""
    index = np.flatnonzero(owner.ravel() >= 0)
    of, in_band = owner.ravel()[index], band.ravel()[index]
    rho = np.where(in_band, spans.range_m[of], _rho_m(geometry, window, beam).ravel()[index])
    covered = Covered(index, rho, rho, np.zeros(len(index)), of)
    probability = np.full(owner.shape, 0.5)
    beam_cells = cells_in_beam(beam, spans, covered, band)
    probability.ravel()[index] = model.occupied(sensor, beam_cells)
    free = (owner >= 0) & ~band
    for array in (probability, band, free):
        read_only(array)
    return TempGrid(beam, geometry, window, probability, band, free)
