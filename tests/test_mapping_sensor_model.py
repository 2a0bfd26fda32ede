"""The temp grid of one reading: the chapter's figures, and every cell against the slow twin."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive_sensor_model import naive_arc_samples, naive_temp_grid

from mapping.beams import Beam
from mapping.config import MappingConfig, ReportedSensor, resolve_sensor
from mapping.grid import GridGeometry
from mapping.sensor_model import (
    RASTERISERS,
    SENSOR_MODELS,
    emptiness,
    make_temp_grid,
    region_of,
    regions_table,
)
from mapping.sensor_model.arcs import angular_step
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Radiation

PING = resolve_sensor(ReportedSensor("ping", Radiation.ULTRASOUND), MappingConfig(), mounted=False)
GRID = GridGeometry((-1.0, -0.8), 0.05, 33, 41)
CHAPTER_TABLE = """
0.0004579600 0.0029082602 0.0073038205 0.0073038205 0.0029082602 0.0004579600
0.0029082602 0.0184688115 0.0463826733 0.0463826733 0.0184688115 0.0029082602
0.0073038205 0.0463826733 0.1164856972 0.1164856972 0.0463826733 0.0073038205
0.0073038205 0.0463826733 0.1164856972 0.1164856972 0.0463826733 0.0073038205
0.0029082602 0.0184688115 0.0463826733 0.0463826733 0.0184688115 0.0029082602
0.0004579600 0.0029082602 0.0073038205 0.0073038205 0.0029082602 0.0004579600
"""


def beam_of(d, *, x=0.0, y=0.0, heading=0.0, width=PING.beam_width_rad, bearings=(0.0,), reach=1.5):
    pose = SE2(x, y, heading)
    return Beam(
        number=0, t_ns=0, sensor="ping", layer="ping", world_from_base=pose,
        world_from_sensor=pose, bearings_rad=np.array(bearings, float),
        ranges_m=np.atleast_1d(np.array(d, float)), beam_width_rad=width, reach_m=reach,
    )  # fmt: skip


def whole(temp, array, empty):
    out = np.full(temp.geometry.shape, empty, array.dtype)
    out[temp.window.slices] = array
    return out


def assert_like_the_twin(beam, sensor, geometry=GRID):
    temp = make_temp_grid(beam, sensor, geometry)
    twin = naive_temp_grid(beam, sensor, geometry)
    sure = ~twin.unsure
    np.testing.assert_array_equal(whole(temp, temp.band, False)[sure], twin.band[sure])
    np.testing.assert_array_equal(whole(temp, temp.free, False)[sure], twin.free[sure])
    np.testing.assert_allclose(
        whole(temp, temp.probability, 0.5)[sure], twin.probability[sure], atol=1e-9
    )
    assert sure.mean() > 0.9
    return temp


# --- regions ----------------------------------------------------------------------------------


def test_the_chapters_table_of_36_values():
    expected = np.array(CHAPTER_TABLE.split(), float).reshape(6, 6)
    np.testing.assert_allclose(np.outer(regions_table(6), regions_table(6)), expected, atol=1e-8)


def test_the_table_of_36_values_comes_out_of_a_reading():
    sensor = replace(PING, model="regions", regions=6, gaussian="both", emptiness="none")
    temp = make_temp_grid(beam_of(1.5), sensor, GridGeometry((-0.5, -1.0), 0.005, 400, 500))
    evidence = np.unique(np.round(2.0 * temp.probability[temp.band] - 1.0, 10))
    expected = np.unique(np.array(CHAPTER_TABLE.split(), float))
    np.testing.assert_allclose(evidence, expected, atol=1e-8)
    assert temp.probability.max() == pytest.approx(0.5582428486, abs=1e-8)


def test_sums_of_the_chapters_tables():
    assert regions_table(6).sum() == pytest.approx(0.9972, abs=1e-12)
    assert regions_table(12).sum() == pytest.approx(0.9974, abs=1e-12)


@pytest.mark.parametrize("n", [18, 24, 30, 60, 120])
def test_finer_regions_are_areas_under_the_normal_curve(n):
    table = regions_table(n)
    assert table.size == n
    assert table.sum() == pytest.approx(math.erf(3 / math.sqrt(2)), abs=1e-12)
    np.testing.assert_allclose(table, table[::-1], atol=1e-15)
    # A region of 6 is as much as the n/6 finer ones in it, to the chapter's four digits.
    np.testing.assert_allclose(table.reshape(6, -1).sum(axis=1), regions_table(6), atol=1e-4)


@pytest.mark.parametrize("n", [0, -6, 7, 3, 13])
def test_regions_that_are_no_multiple_of_six_are_refused(n):
    with pytest.raises(BadInput, match="multiple of 6"):
        regions_table(n)


def test_the_last_region_holds_its_end():
    np.testing.assert_array_equal(region_of(np.array([0.0, 0.5, 0.999, 1.0]), 6), [0, 3, 5, 5])


# --- emptiness --------------------------------------------------------------------------------


def test_emptiness_in_front_of_the_band():
    t = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_array_equal(emptiness("none", t), np.zeros(5))
    np.testing.assert_array_equal(emptiness("constant", t), -np.ones(5))
    np.testing.assert_allclose(emptiness("linear", t), [-1, -0.75, -0.5, -0.25, 0])
    np.testing.assert_allclose(emptiness("combined", t), [-1, -1, -1, -0.5, 0])


# --- every cell against the twin --------------------------------------------------------------

SENSORS = st.builds(
    lambda **k: replace(PING, **k),
    model=st.sampled_from(["regions", "peak", "fading"]),
    gaussian=st.sampled_from(["both", "angle", "distance", "none"]),
    emptiness=st.sampled_from(["none", "constant", "linear", "combined"]),
    regions=st.sampled_from([6, 12, 18, 60]),
    range_error=st.sampled_from([0.0, 0.03, 0.1, 0.4]) | st.floats(0.0, 0.9),
    p_hit=st.floats(0.5, 1.0),
    p_miss=st.floats(0.0, 0.5),
    hit=st.floats(0.0, 3.0),
    miss=st.floats(0.0, 2.0),
    near=st.floats(0.0, 30.0),
    before=st.floats(0.0, 0.3),
    behind=st.floats(0.0, 0.3),
    fade_m=st.floats(0.2, 5.0) | st.just(1e9),
    no_echo=st.sampled_from(["empties", "skipped"]),
)
ANGLES = st.floats(-9.0, 9.0) | st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi, 3 * math.pi])
WIDTHS = st.floats(0.01, 2 * math.pi) | st.sampled_from([0.1, PING.beam_width_rad, math.pi])
RANGES = st.floats(0.0, 1.8) | st.sampled_from([0.001, 0.02, 0.5, math.inf])
# Also outside the grid, whose corners are (-1, -0.8) and (1.05, 0.85).
PLACES = st.floats(-1.6, 1.6)


@settings(deadline=None, max_examples=400)
@given(SENSORS, RANGES, PLACES, PLACES, ANGLES, WIDTHS)
def test_a_ranger_is_like_its_twin_in_every_cell(sensor, d, x, y, heading, width):
    assert_like_the_twin(beam_of(d, x=x, y=y, heading=heading, width=width), sensor)


@settings(deadline=None, max_examples=250)
@given(
    SENSORS,
    st.lists(RANGES | st.just(math.nan), min_size=2, max_size=9),
    PLACES,
    PLACES,
    ANGLES,
    st.floats(0.02, 1.2),
    st.floats(0.01, 1.5),
)
def test_a_scan_is_like_its_twin_in_every_cell(sensor, ranges, x, y, heading, step, width):
    assume(step * (len(ranges) - 1) < 2 * math.pi - 0.01)
    bearings = (np.arange(len(ranges)) - len(ranges) / 2) * step
    beam = beam_of(ranges, x=x, y=y, heading=heading, width=width, bearings=bearings)
    assert_like_the_twin(beam, sensor)


def test_a_beam_across_pi_is_like_one_that_is_not():
    sensor = replace(PING, model="peak", regions=12)
    grid = GridGeometry((-1.0, -1.0), 0.05, 40, 40)
    ahead = make_temp_grid(beam_of(0.8, heading=0.0), sensor, grid)
    back = make_temp_grid(beam_of(0.8, heading=-math.pi), sensor, grid)
    np.testing.assert_allclose(
        whole(ahead, ahead.probability, 0.5), whole(back, back.probability, 0.5)[:, ::-1], atol=1e-9
    )
    assert back.band.sum() == ahead.band.sum() > 0


def test_a_beam_beside_the_grid_is_an_empty_window():
    temp = make_temp_grid(beam_of(0.5, x=9.0), PING, GRID)
    assert temp.window.empty
    assert temp.probability.size == 0


def test_a_heading_far_beyond_pi_is_the_same_heading():
    a = make_temp_grid(beam_of(0.6, x=0.11, y=0.07, heading=0.3), PING, GRID)
    b = make_temp_grid(beam_of(0.6, x=0.11, y=0.07, heading=0.3 + 40 * math.pi), PING, GRID)
    np.testing.assert_array_equal(a.band, b.band)
    np.testing.assert_allclose(a.probability, b.probability, atol=1e-9)


# --- the obstacle's own cell ------------------------------------------------------------------


@pytest.mark.parametrize("model", ["regions", "peak"])
def test_without_an_error_the_map_is_the_point_map(model):
    sensor = replace(PING, model=model, range_error=0.0, emptiness="none", regions=6)
    beam = beam_of(0.52, x=0.03, y=0.02, heading=0.7)
    temp = assert_like_the_twin(beam, sensor)
    (row, col), *more = np.argwhere(whole(temp, temp.band, False))
    assert not more
    np.testing.assert_array_equal(GRID.cells_of(beam.points_m)[0], [row, col])
    evidence = whole(temp, temp.probability, 0.5)
    assert (evidence != 0.5).sum() == 1
    assert evidence[row, col] == pytest.approx(0.7 if model == "peak" else 0.5582428486, abs=1e-8)


def test_a_narrow_beam_between_the_centres_marks_the_obstacles_cell():
    sensor = replace(PING, model="peak", range_error=0.01)
    temp = make_temp_grid(beam_of(0.6, y=0.001, width=0.002), sensor, GRID)
    assert temp.band.sum() == 1
    assert not temp.free[temp.band].any()
    assert temp.probability.max() == pytest.approx(sensor.p_hit)


def test_each_beam_of_a_scan_marks_its_obstacle_and_hits_win():
    sensor = replace(PING, model="peak", range_error=0.01)
    bearings = np.radians(np.arange(-90, 90, 1.0))
    ranges = 0.4 + 0.3 * np.cos(3 * bearings) ** 2
    beam = beam_of(ranges, bearings=bearings, width=math.radians(1.0))
    temp = make_temp_grid(beam, sensor, GRID)
    cells = GRID.cells_of(beam.points_m)
    assert whole(temp, temp.band, False)[cells[:, 0], cells[:, 1]].all()
    assert not (temp.band & temp.free).any()


# --- nothing seen -----------------------------------------------------------------------------


@pytest.mark.parametrize("model", SENSOR_MODELS)
def test_a_reading_that_saw_nothing_empties_its_beam_or_is_skipped(model):
    empties = replace(PING, model=model, no_echo="empties")
    temp = make_temp_grid(beam_of(math.inf, reach=0.7), empties, GRID)
    assert not temp.band.any()
    assert temp.free.sum() > 20
    assert (temp.probability[temp.free] < 0.5).mean() > 0.95
    skipped = make_temp_grid(
        beam_of(math.inf, reach=0.7), replace(empties, no_echo="skipped"), GRID
    )
    assert not (skipped.free | skipped.band).any()
    assert (skipped.probability == 0.5).all()


# --- arcs -------------------------------------------------------------------------------------


def test_the_angular_step_covers_an_arc_cell_by_cell():
    rho, width = np.array([0.0, 0.01, 0.5, 1.0]), math.radians(38.0)
    chord_cells = 2 * rho * math.sin(width / 2) / 0.01
    simple = angular_step(rho, width, 0.01, halved=False)
    halved = angular_step(rho, width, 0.01, halved=True)
    np.testing.assert_allclose(simple[2:], width / chord_cells[2:])
    np.testing.assert_allclose(halved[2:], simple[2:] / 2)
    np.testing.assert_allclose(simple[:2], width)  # an arc shorter than a cell: two samples
    assert np.isfinite(angular_step(rho, 2 * math.pi, 0.01, halved=True)).all()


ARC_GRID = GridGeometry((-2.0, -2.0), 0.02, 200, 200)


def arc_case(model, gaussian, d, heading, width, regions):
    sensor = replace(
        PING, model=model, gaussian=gaussian, regions=regions, emptiness="linear", rasteriser="arcs"
    )
    return sensor, beam_of(d, x=0.0041, y=0.0033, heading=heading, width=width)


ARC_CASES = st.builds(
    arc_case,
    st.sampled_from(["regions", "peak", "fading"]),
    st.sampled_from(["both", "angle", "distance", "none"]),
    st.floats(0.7, 1.5),
    st.floats(-4, 4),
    st.floats(0.3, 1.5),
    st.sampled_from([6, 12]),
)


@settings(deadline=None, max_examples=25)
@given(ARC_CASES)
def test_arcs_are_like_the_chapters_loops(case):
    sensor, beam = case
    temp = make_temp_grid(beam, sensor, ARC_GRID)
    expected = np.full(ARC_GRID.shape, np.nan)
    band = np.zeros(ARC_GRID.shape, bool)
    for row, col, evidence, in_band in naive_arc_samples(beam, sensor, ARC_GRID):
        expected[row, col], band[row, col] = evidence, in_band  # setCell: the last one stays
    evidence = whole(temp, temp.probability, 0.5)
    touched = whole(temp, temp.band | temp.free, False)
    # Rounding may carry a sample on a border into the next cell or region: a few may.
    differing = (touched != np.isfinite(expected)) | (whole(temp, temp.band, False) != band)
    differing |= touched & ~(np.abs(evidence - np.where(touched, expected, 0.5)) < 1e-9)
    assert differing.sum() <= 0.01 * touched.sum()


@settings(deadline=None, max_examples=60)
@given(ARC_CASES)
def test_arcs_agree_with_cells_up_to_the_sampling_error(case):
    """A sample lies somewhere in its cell, not at its centre.

    Where a model is steep the two differ by what it changes within a cell; over a reading that
    evens out. For beams and bands of at least seven cells: the Gaussian code's step misses at most
    0.5 % of the covered cells, the simple one at most 5 %; on average a cell differs by at most
    15 % of the strongest evidence of the reading, and so does its sum, band and front.
    """
    sensor, beam = case
    arcs = make_temp_grid(beam, sensor, ARC_GRID)
    cells = make_temp_grid(beam, replace(sensor, rasteriser="cells"), ARC_GRID)
    inside = cells.band | cells.free
    sampled = arcs.band | arcs.free
    missed = (inside & ~sampled).sum() / inside.sum()
    assert missed <= (0.05 if sensor.gaussian == "none" else 0.005)
    for part in (cells.band & arcs.band, cells.free & arcs.free):
        a, b = arcs.probability[part] - 0.5, cells.probability[part] - 0.5
        assert np.abs(a - b).mean() <= 0.15 * np.abs(b).max()
        assert abs(a.sum() - b.sum()) <= 0.15 * abs(b.sum())


def test_without_a_second_grid_every_sample_is_merged_once():
    sensor = replace(PING, model="regions", rasteriser="arcs", second_grid=False, gaussian="none")
    temp = make_temp_grid(beam_of(0.7), sensor, GRID)
    once = make_temp_grid(beam_of(0.7), replace(sensor, second_grid=True), GRID)
    assert once.sub_grids == ()
    np.testing.assert_array_equal(temp.probability, once.probability)
    times = np.zeros(GRID.shape, int)
    for part in temp.sub_grids:
        times[part.window.slices] += part.band | part.free
    assert times.max() > 1  # the speckle
    np.testing.assert_array_equal(times > 0, whole(once, once.band | once.free, False))
    samples = 0
    for k in range(10_000):  # the chapter's loop, literally
        rho = k * 0.5 * GRID.resolution_m
        if rho >= 0.7 * 0.9:
            break
        step = angular_step(np.array([rho]), PING.beam_width_rad, GRID.resolution_m, halved=False)
        samples += math.floor(PING.beam_width_rad / step[0] + 1e-9) + 1
    band_times = sum(int(part.free.sum()) for part in temp.sub_grids)
    assert band_times == samples


def test_arcs_with_no_error_mark_the_arc():
    sensor = replace(PING, model="regions", rasteriser="arcs", range_error=0.0, emptiness="none")
    temp = make_temp_grid(beam_of(0.7), sensor, GRID)
    row, col = np.nonzero(whole(temp, temp.band, False))
    centres = GRID.centres_of(np.column_stack([row, col]))
    assert len(centres) >= 9
    assert np.abs(np.hypot(*centres.T) - 0.7).max() < 0.05


@pytest.mark.parametrize("second_grid", [True, False])
def test_arcs_of_a_scan_and_of_a_beam_that_leaves_the_grid(second_grid):
    sensor = replace(PING, model="peak", rasteriser="arcs", second_grid=second_grid)
    bearings = np.linspace(-2, 2, 9)
    beam = beam_of([*np.linspace(0.3, 1.7, 7), math.inf, math.nan], bearings=bearings, width=0.5)
    temp = make_temp_grid(beam, replace(sensor, no_echo="empties"), GRID)
    assert temp.band.any()
    assert temp.free.any()
    assert temp.probability.min() >= 0.0
    assert temp.probability.max() <= 1.0
    outside = make_temp_grid(beam_of(0.5, x=-3.0), sensor, GRID)
    assert outside.probability.size == 0


# --- names and imports ------------------------------------------------------------------------


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(BadInput, match=r"unknown sensor model 'fadin'; the nearest .* fading"):
        make_temp_grid(beam_of(0.5), replace(PING, model="fadin"), GRID)
    with pytest.raises(BadInput, match=r"unknown rasteriser 'zzz'; there are cells, arcs"):
        make_temp_grid(beam_of(0.5), replace(PING, rasteriser="zzz"), GRID)
    assert set(RASTERISERS) == {"cells", "arcs", "rays"}


def test_naming_the_models_does_not_load_numba():
    code = "import sys, mapping.sensor_model, mapping.update_rules; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_temp_grids_are_locked():
    temp = make_temp_grid(beam_of(0.5), PING, GRID)
    for array in (temp.probability, temp.band, temp.free):
        assert not array.flags.writeable
