"""Scans as thin rays in one go: the rasteriser's cells, each once, the same bytes in any way."""

from __future__ import annotations

import math
from dataclasses import replace

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import GRID, PING
from hypothesis import given, settings
from hypothesis import strategies as st
from test_mapping_batch_lidar import FLAT, columns_of, scan_of, scans

from mapping.artifacts import Snapshot
from mapping.config import load_config
from mapping.kernels import merging
from mapping.kernels.batch import rays, steps
from mapping.kernels.batch.readings import scan_axes
from mapping.pipeline import build_maps
from mapping.sensor_model import make_temp_grid
from recorder.geometry import SE2
from recorder.messages import Pose, Scan

LASER = replace(PING, **FLAT, rasteriser="rays", beam_width_rad=0.05)


def map_of(beams, sensor, grid=GRID, parts=1):
    cells, observed = cases.blank(grid)
    half = sensor.beam_width_rad / 2
    row = np.array([half, sensor.hit, sensor.miss, sensor.near, sensor.fade_m])
    axes = scan_axes(beams[0].bearings_rad, half)
    for part in range(parts):
        rays.add_rays(
            cells, observed, cases.place(grid), columns_of(beams, sensor), axes, row, part, parts
        )
    assert not cells[:, grid.cols :].any()
    return cells[:, : grid.cols], observed


def assert_footprint(beam, sensor) -> None:
    temp = make_temp_grid(beam, sensor, GRID)
    cells, observed = map_of([beam], sensor)
    free, band = np.zeros(GRID.shape, bool), np.zeros(GRID.shape, bool)
    free[temp.window.slices], band[temp.window.slices] = temp.free, temp.band
    np.testing.assert_array_equal(cells == 2 * steps.ONE, band)
    np.testing.assert_array_equal(cells == -steps.ONE, free)
    np.testing.assert_array_equal(observed, free | band)


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(["empties", "skipped"]).flatmap(
    lambda no_echo: scans(replace(LASER, no_echo=no_echo)).map(lambda beam: (beam, no_echo))
))  # fmt: skip
def test_each_cell_once_and_hits_win(found) -> None:
    beam, no_echo = found
    assert_footprint(beam, replace(LASER, no_echo=no_echo))


@pytest.mark.parametrize("quarter", range(4))
def test_rays_along_the_borders_of_the_grid_leave_no_cell_behind_them(quarter: int) -> None:
    (x0, y0), size = GRID.origin_m, GRID.resolution_m
    for x in (x0, x0 + GRID.cols * size):
        for y in (y0, y0 + GRID.rows * size):
            beam = scan_of(x, y, quarter * math.pi / 2, [-1e-9, 0.0, 1e-9], [0.5] * 3, LASER)
            assert_footprint(beam, LASER)


def test_losses_that_wait_end_at_the_clamp_as_those_that_do_not() -> None:
    sensor = replace(LASER, miss=0.3, hit=1.1)
    rng, bearings = np.random.default_rng(6), np.linspace(-1.0, 1.0, 24)
    beams = [
        scan_of(*rng.uniform(0.4, 0.6, 2), rng.uniform(-0.2, 0.2), bearings,
                rng.uniform(0.05, 0.8, 24), LASER)
        for _ in range(600)
    ]  # fmt: skip
    whole, observed = map_of(beams, sensor)
    cells, seen = cases.blank(GRID)
    for beam in beams:
        said, here = map_of([beam], sensor)
        merging.add_steps(cells[:, : GRID.cols], np.ascontiguousarray(said))
        seen |= here
    assert (whole == steps.LOWEST).any()
    np.testing.assert_array_equal(cells[:, : GRID.cols], whole)
    np.testing.assert_array_equal(seen, observed)


@settings(max_examples=40, deadline=None)
@given(scans(LASER), st.sampled_from([(0.0, 1e9), (30.0, 0.75), (0.0, 0.5)]))
def test_values_are_those_of_the_model_and_of_any_number_of_parts(beam, shade) -> None:
    sensor = replace(LASER, near=shade[0], fade_m=shade[1], hit=0.8, miss=0.08, no_echo="empties")
    temp = make_temp_grid(beam, sensor, GRID)
    cells, _ = map_of([beam], sensor)
    wanted = np.zeros(GRID.shape)
    p = temp.probability
    wanted[temp.window.slices] = np.log(p / (1.0 - p))
    np.testing.assert_allclose(cells / steps.ONE, wanted, atol=2e-6)
    for parts in (2, 3):
        again, observed = map_of([beam], sensor, parts=parts)
        np.testing.assert_array_equal(again, cells)
        np.testing.assert_array_equal(observed, map_of([beam], sensor)[1])


def test_many_scans_are_one_after_the_other_each_on_its_window() -> None:
    rng = np.random.default_rng(4)
    bearings = np.linspace(-2.0, 2.0, 90)
    beams = [
        scan_of(*rng.uniform(0.4, 0.9, 2), rng.uniform(-3, 3), bearings,
                rng.uniform(0.05, 0.8, 90), LASER)
        for _ in range(30)
    ]  # fmt: skip
    whole, observed = map_of(beams, LASER)
    cells, seen = cases.blank(GRID)
    for beam in beams:
        said, here = map_of([beam], LASER)
        window = make_temp_grid(beam, LASER, GRID).window
        assert not np.delete(said, np.arange(*window.slices[0].indices(GRID.rows)), axis=0).any()
        merging.add_steps(cells[:, : GRID.cols], np.ascontiguousarray(said))
        seen |= here
    np.testing.assert_array_equal(cells[:, : GRID.cols], whole)
    np.testing.assert_array_equal(seen, observed)


@pytest.mark.parametrize("rule", ["bayes", "odds", "count", "dempster-shafer"])
def test_a_session_is_the_same_watched_or_not(rule: str) -> None:
    rng = np.random.default_rng(5)
    messages: list[Pose | Scan] = []
    for k in range(12):
        t = k * 100_000_000
        messages.append(Pose(t, SE2(0.1 * k, 0.05 * k, 0.2 * k)))
        messages.append(Scan(t, "lidar", rng.uniform(0.5, 3.0, 60), -1.5, 0.05, 0.05, 4.0))
    config = load_config(
        settings=["sensors.lidar.rasteriser=rays", f"sensors.lidar.update={rule}",
                  "grid.resolution_m=0.05"],
    )  # fmt: skip
    maps = []
    for watched, threads in ((True, 1), (False, 1), (False, 2)):
        found = build_maps(messages, config, watched=watched, threads=threads)
        maps.append(next(a.layer for a in found if isinstance(a, Snapshot)))
    for other in maps[1:]:
        assert other.values.tobytes() == maps[0].values.tobytes()
        assert other.observed.tobytes() == maps[0].observed.tobytes()
    assert maps[0].observed.sum() > 500
    assert math.isfinite(float(maps[0].values.max()))
