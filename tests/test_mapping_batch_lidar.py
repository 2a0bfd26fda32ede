"""Laser scans in one go: the rasteriser's cells, the model's values, the same bytes in any way."""

from __future__ import annotations

import math
from dataclasses import replace

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import GRID, PING
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.beams import Beam
from mapping.grid import GridGeometry
from mapping.kernels import merging
from mapping.kernels.batch import lidar, steps
from mapping.kernels.batch.readings import Scans, ends_of, scan_axes
from recorder.geometry import SE2

FLAT = {"model": "fading", "hit": 2.0, "miss": 1.0, "near": 0.0, "fade_m": 1e9}


def scan_of(x, y, heading, bearings, ranges, sensor, reach_m=cases.REACH_M):
    pose = SE2(x, y, heading)
    return Beam(
        number=0,
        t_ns=0,
        sensor="lidar",
        layer="made",
        world_from_base=pose,
        world_from_sensor=pose,
        bearings_rad=np.asarray(bearings, float),
        ranges_m=np.asarray(ranges, float),
        beam_width_rad=sensor.beam_width_rad,
        reach_m=reach_m,
    )


def columns_of(beams, sensor):
    poses = np.array(
        [
            [b.world_from_sensor.x_m, b.world_from_sensor.y_m, b.world_from_sensor.heading_rad]
            for b in beams
        ]
    )
    x, y, heading = (np.ascontiguousarray(column) for column in poses.T)
    ranges = np.array([b.ranges_m for b in beams])
    ends = ends_of(ranges, cases.REACH_M, sensor.before, sensor.behind, sensor.no_echo == "empties")
    return Scans(x, y, heading, *ends)


def map_of(beams, sensor, grid=GRID, parts=1):
    cells, observed = cases.blank(grid)
    half = sensor.beam_width_rad / 2
    row = np.array([half, sensor.hit, sensor.miss, sensor.near, sensor.fade_m])
    axes = scan_axes(beams[0].bearings_rad, half)
    for part in range(parts):
        lidar.add_scans(
            cells, observed, cases.place(grid), columns_of(beams, sensor), axes, row, part, parts
        )
    assert not cells[:, grid.cols :].any()
    return cells[:, : grid.cols], observed


def assert_footprint(beam, sensor, grid=GRID):
    _, front, band = cases.parts_of(beam, sensor, grid)
    cells, observed = map_of([beam], sensor, grid)
    np.testing.assert_array_equal(cells == 2 * steps.ONE, band)
    np.testing.assert_array_equal(cells == -steps.ONE, front)
    np.testing.assert_array_equal(observed, front | band)


@st.composite
def scans(draw, sensor):
    beams = draw(st.integers(1, 24))
    step = draw(st.sampled_from([0.02, math.pi / 36, math.pi / 12, 2 * math.pi / beams]))
    ranges = draw(st.lists(cases.RANGES | st.just(math.nan), min_size=beams, max_size=beams))
    bearings = (np.arange(beams) - draw(st.sampled_from([0.0, beams / 2, (beams - 1) / 2]))) * step
    return scan_of(
        draw(cases.PLACES), draw(cases.PLACES), draw(cases.ANGLES), bearings, ranges, sensor
    )


WIDTHS = st.sampled_from([0.01, math.pi / 36, 0.1, math.pi / 12, 0.5, 1.5])


@given(st.data(), WIDTHS.flatmap(lambda width: cases.sensors(**FLAT, beam_width_rad=width)))
@settings(max_examples=600, deadline=None)
def test_it_covers_the_cells_of_the_rasteriser(data, sensor):
    assert_footprint(data.draw(scans(sensor)), sensor)


def test_cells_whose_evidence_cancels_are_observed():
    sensor = replace(LASER, **{**FLAT, "hit": 1.0})
    bearings = (np.arange(40) - 20) * sensor.beam_width_rad
    near, far = (scan_of(0.0, 0.0, 0.3, bearings, [d] * 40, sensor) for d in (0.4, 0.7))
    _, _, band = cases.parts_of(near, sensor, GRID)
    _, front, far_band = cases.parts_of(far, sensor, GRID)
    cells, observed = map_of([near, far], sensor)
    assert (band & front).sum() > 2
    assert (cells[band & front] == 0).all()
    np.testing.assert_array_equal(observed, front | far_band | band)


def made_scans(count, beams=90, seed=1):
    draw = np.random.default_rng(seed)
    bearings = (np.arange(beams) - (beams - 1) / 2) * math.radians(2.0)
    out = []
    for k in range(count):
        ranges = draw.uniform(0.05, 1.4, beams)
        ranges = np.repeat(ranges[:: 1 + k % 6], 1 + k % 6)[:beams]  # walls
        ranges[draw.uniform(size=beams) < 0.1] = math.inf
        ranges[draw.uniform(size=beams) < 0.1] = math.nan
        out.append(scan_of(*draw.uniform(-1, 1, 2), draw.uniform(-7, 7), bearings, ranges, LASER))
    return out


LASER = replace(
    PING,
    model="fading",
    layer="made",
    beam_width_rad=math.radians(2.0),
    hit=2.2,
    miss=0.85,
    near=0.0,
    before=0.015,
    behind=0.015,
    fade_m=1e9,
    no_echo="empties",
)


def test_it_covers_the_same_cells_of_a_fine_grid():
    grid = GridGeometry((-1.0, -0.8), 0.01, 165, 205)
    for beam in made_scans(40):
        assert_footprint(beam, replace(LASER, **FLAT), grid)


@pytest.mark.parametrize("sensor", [LASER, replace(LASER, near=5.0, fade_m=0.7, miss=0.1)])
def test_its_values_are_the_models(sensor):
    for beam in made_scans(15, seed=2):
        temp, _front, _band = cases.parts_of(beam, sensor, GRID)
        cells, _ = map_of([beam], sensor)
        expected = np.zeros(GRID.shape)
        p = temp.probability
        expected[temp.window.slices] = np.log(p) - np.log1p(-p)
        assert (
            np.abs(cells - expected * steps.ONE) <= 1.0 + 5e-7 * steps.ONE * np.abs(expected)
        ).all()


@pytest.mark.parametrize("parts", [2, 3])
def test_parts_by_rows_give_the_same_bytes(parts):
    beams = made_scans(30, seed=3)
    whole, seen = map_of(beams, LASER)
    in_parts, seen_in_parts = map_of(beams, LASER, parts=parts)
    np.testing.assert_array_equal(in_parts, whole)
    np.testing.assert_array_equal(seen_in_parts, seen)


def test_one_scan_at_a_time_on_a_blank_window_gives_the_same_bytes():
    beams = made_scans(30, seed=4)
    whole, seen = map_of(beams, LASER)
    cells, observed = np.zeros(GRID.shape, np.int32), np.zeros(GRID.shape, np.bool_)
    half = LASER.beam_width_rad / 2
    row = np.array([half, LASER.hit, LASER.miss, LASER.near, LASER.fade_m])
    for beam in beams:
        window = cases.parts_of(beam, LASER, GRID)[0].window
        if window.empty:
            continue
        said, here = steps.blank(window.rows, window.cols), observed[window.slices].copy()
        lidar.add_scans(
            said,
            here,
            cases.window_place(GRID, window),
            columns_of([beam], LASER),
            scan_axes(beam.bearings_rad, half),
            row,
            0,
            1,
        )
        merging.add_steps(cells[window.slices], said[:, : window.cols])
        observed[window.slices] |= here
    np.testing.assert_array_equal(cells, whole)
    np.testing.assert_array_equal(observed, seen)
