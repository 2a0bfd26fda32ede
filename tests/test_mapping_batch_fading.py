"""`fading` in one go: the rasteriser's cells, the model's values, the same bytes in any way."""

from __future__ import annotations

import math
from dataclasses import replace

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import GRID, PING
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid import GridGeometry
from mapping.kernels import merging
from mapping.kernels.batch import fading, steps

FLAT = {"model": "fading", "hit": 2.0, "miss": 1.0, "near": 0.0, "fade_m": 1e9}


def table_of(sensors):
    return np.array(
        [[s.beam_width_rad / 2.0, s.hit, s.miss, s.near, s.fade_m] for s in sensors], float
    )


def map_of(readings, sensors, grid=GRID, parts=1):
    cells, observed = cases.blank(grid)
    for band in cases.bands(grid, parts):
        fading.add_fading(cells, observed, cases.place(grid), readings, table_of(sensors), *band)
    assert not cells[:, grid.cols :].any()
    return cells[:, : grid.cols], observed


def assert_footprint(beam, sensor, grid=GRID):
    """Front and band are those of the rasteriser, in every cell."""
    _, front, band = cases.parts_of(beam, sensor, grid)
    cells, observed = map_of(cases.columns_of([beam], [sensor]), [sensor], grid)
    np.testing.assert_array_equal(cells == -steps.ONE, front)
    np.testing.assert_array_equal(cells == 2 * steps.ONE, band)
    np.testing.assert_array_equal(observed, front | band)


@given(st.data(), cases.sensors(**FLAT))
@settings(max_examples=600, deadline=None)
def test_it_covers_the_cells_of_the_rasteriser(data, sensor):
    assert_footprint(data.draw(cases.beams(sensor)), sensor)


def test_cells_whose_evidence_cancels_are_observed():
    sensor = replace(PING, **{**FLAT, "hit": 1.0}, beam_width_rad=0.5)
    near, far = (cases.beam_of(0.0, 0.0, 0.3, d, sensor) for d in (0.4, 0.9))
    _, _, band = cases.parts_of(near, sensor, GRID)
    _, front, far_band = cases.parts_of(far, sensor, GRID)
    cells, observed = map_of(cases.columns_of([near, far], [sensor] * 2), [sensor] * 2)
    assert (band & front).sum() > 2
    assert (cells[band & front] == 0).all()
    np.testing.assert_array_equal(observed, front | far_band | band)


@pytest.mark.parametrize("resolution_m", [1 / 300, 0.01, 0.02])
def test_it_covers_the_same_cells_of_fine_grids(resolution_m):
    draw = np.random.default_rng(1)
    grid = GridGeometry(
        (-0.5, -0.4), resolution_m, round(0.9 / resolution_m), round(1.1 / resolution_m)
    )
    for k in range(120):
        width = draw.choice([6.0, 38.0, 90.0, 120.0])
        sensor = replace(
            PING, **{**FLAT, "before": 0.05, "behind": 0.1}, beam_width_rad=math.radians(width)
        )
        x, y = draw.uniform(-0.5, 0.6, 2)
        heading = draw.uniform(-4, 4)
        if k % 3 == 0:  # on the lattice, at 45 degrees
            x, y = (math.floor(v / resolution_m) * resolution_m + resolution_m / 2 for v in (x, y))
            heading = round(heading) * math.pi / 4
        assert_footprint(cases.beam_of(x, y, heading, draw.uniform(0.0, 0.6), sensor), sensor, grid)


@given(st.data(), cases.sensors(model="fading"))
@settings(max_examples=300, deadline=None)
def test_its_values_are_the_models(data, sensor):
    beam = data.draw(cases.beams(sensor))
    temp, front, band = cases.parts_of(beam, sensor, GRID)
    cells, observed = map_of(cases.columns_of([beam], [sensor]), [sensor])
    expected = np.zeros(GRID.shape)
    p = temp.probability
    expected[temp.window.slices] = np.clip(np.log(p) - np.log1p(-p), -13.8, 13.8)
    near = 1.0 + 4e-7 * steps.ONE * np.abs(expected)
    assert (np.abs(cells - expected * steps.ONE) <= near).all()
    np.testing.assert_array_equal(observed, band | (front & (sensor.miss > 0.0)))


def random_readings(draw, count, sensors):
    which = [int(k) for k in draw.integers(0, len(sensors), count)]
    beams = [
        cases.beam_of(
            *draw.uniform(-1, 1, 2), draw.uniform(-7, 7), cases.maybe_range(draw), sensors[k]
        )
        for k in which
    ]
    return beams, cases.columns_of(beams, sensors, which)


SEVERAL = [
    replace(PING, model="fading", no_echo="empties"),
    replace(PING, model="fading", beam_width_rad=0.1, near=0.0, fade_m=1e9, before=0.0, behind=0.0),
    replace(PING, model="fading", beam_width_rad=4.0, miss=2.0, near=20.0),
]


@pytest.mark.parametrize("parts", [2, 3, 7])
def test_bands_of_rows_give_the_same_bytes(parts):
    _, readings = random_readings(np.random.default_rng(2), 300, SEVERAL)
    whole, seen = map_of(readings, SEVERAL)
    in_parts, seen_in_parts = map_of(readings, SEVERAL, parts=parts)
    np.testing.assert_array_equal(in_parts, whole)
    np.testing.assert_array_equal(seen_in_parts, seen)
    assert np.abs(whole).max() == steps.CLAMP  # the clamp was met on the way


def test_one_reading_at_a_time_on_a_blank_window_gives_the_same_bytes():
    beams, readings = random_readings(np.random.default_rng(3), 300, SEVERAL)
    whole, seen = map_of(readings, SEVERAL)
    cells, observed = np.zeros(GRID.shape, np.int32), np.zeros(GRID.shape, np.bool_)
    for i, beam in enumerate(beams):
        sensor = SEVERAL[readings.sensor[i]]
        window = cases.parts_of(beam, sensor, GRID)[0].window
        if window.empty:
            continue
        said, seen_here = steps.blank(window.rows, window.cols), observed[window.slices].copy()
        fading.add_fading(
            said,
            seen_here,
            cases.window_place(GRID, window),
            cases.one(readings, i),
            table_of(SEVERAL),
            0,
            window.rows,
        )
        merging.add_steps(cells[window.slices], said[:, : window.cols])
        observed[window.slices] |= seen_here
    np.testing.assert_array_equal(cells, whole)
    np.testing.assert_array_equal(observed, seen)
