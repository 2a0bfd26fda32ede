"""Readings for the tests of the batch kernels: as beams for the rasteriser, as columns for them."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from hypothesis import strategies as st

from mapping.beams import Beam
from mapping.config import MappingConfig, ReportedSensor, resolve_sensor
from mapping.grid import GridGeometry
from mapping.kernels.batch import steps
from mapping.kernels.batch.readings import Readings, ends_of, place_of
from mapping.sensor_model import SENSOR_MODELS, make_temp_grid
from recorder.geometry import SE2
from recorder.messages import Radiation

PING = resolve_sensor(ReportedSensor("ping", Radiation.ULTRASOUND), MappingConfig(), mounted=False)
GRID = GridGeometry((-1.0, -0.8), 0.05, 33, 41)
REACH_M = 1.5


def beam_of(x, y, heading, range_m, sensor, reach_m=REACH_M):
    """One reading, placed."""
    pose = SE2(x, y, heading)
    return Beam(
        number=0, t_ns=0, sensor=sensor.name, layer="made", world_from_base=pose,
        world_from_sensor=pose, bearings_rad=np.zeros(1), ranges_m=np.array([range_m]),
        beam_width_rad=sensor.beam_width_rad, reach_m=reach_m,
    )  # fmt: skip


def columns_of(beams, sensors, which=None):
    """Beams of rangers → ``Readings``; ``which`` names the sensor of each."""
    which = [0] * len(beams) if which is None else which
    ends = []
    for beam, k in zip(beams, which, strict=True):
        before, behind = SENSOR_MODELS[sensors[k].model].band(sensors[k])
        empties = sensors[k].no_echo == "empties"
        ends.append(ends_of(beam.ranges_m, beam.reach_m, before, behind, empties))
    far, front, band = (np.array([end[n][0] for end in ends]) for n in range(3))
    poses = np.array([[b.world_from_sensor.x_m, b.world_from_sensor.y_m,
                       b.world_from_sensor.heading_rad] for b in beams]).reshape(-1, 3)  # fmt: skip
    x, y, heading = (np.ascontiguousarray(column) for column in poses.T)
    return Readings(x, y, heading, far, front, band, np.array(which, np.int32))


def first(readings, count):
    """The first ``count`` readings."""
    return Readings(*(np.ascontiguousarray(column[:count]) for column in readings))


def one(readings, i):
    """Reading ``i`` alone."""
    return Readings(*(np.ascontiguousarray(column[i : i + 1]) for column in readings))


def blank(grid):
    """An empty map: steps and the observed mask."""
    return steps.blank(grid.rows, grid.cols), np.zeros(grid.shape, np.bool_)


def bands(grid, count):
    """The rows of a grid in so many bands: the first of each, and the one after its last."""
    return pairwise([k * grid.rows // count for k in range(count + 1)])


def place(grid):
    """Where a grid lies."""
    return place_of(grid.origin_m, grid.resolution_m)


def window_place(grid, window):
    """Where a window of a grid lies."""
    return place_of(grid.origin_m, grid.resolution_m, window.row0, window.col0)


def whole(window, array, grid):
    """A window's array among zeros of a whole grid."""
    out = np.zeros(grid.shape, array.dtype)
    out[window.slices] = array
    return out


def parts_of(beam, sensor, grid):
    """Today's temp grid of a reading, front and band over the whole grid."""
    temp = make_temp_grid(beam, sensor, grid)
    return temp, whole(temp.window, temp.front, grid), whole(temp.window, temp.band, grid)


def maybe_range(draw):
    """A range, or nothing seen in one of ten."""
    return draw.uniform(0, 1.4) if draw.uniform() < 0.9 else math.inf


# Anything, and what lies on the lattice of the cells: borders through centres and corners.
PLACES = st.floats(-1.3, 1.3) | st.integers(-44, 44).map(lambda k: k * 0.025)
ANGLES = st.floats(-7.0, 7.0) | st.integers(-24, 24).map(lambda k: k * math.pi / 12)
WIDTHS = st.floats(0.01, 6.28) | st.sampled_from([15, 30, 60, 90, 120, 180, 270, 360]).map(
    math.radians
)
RANGES = st.floats(0.0, 1.4) | st.integers(0, 28).map(lambda k: k * 0.05) | st.just(math.inf)
ERRORS = st.floats(0.0, 0.3) | st.just(0.0)


@st.composite
def sensors(draw, **fixed):
    """A ranger with any beam and model."""
    values = {
        "beam_width_rad": draw(WIDTHS), "range_error": draw(ERRORS), "before": draw(ERRORS),
        "behind": draw(ERRORS), "no_echo": draw(st.sampled_from(["empties", "skipped"])),
        "hit": draw(st.floats(0.0, 3.0)), "miss": draw(st.just(0.0) | st.floats(1e-3, 1.0)),
        "near": draw(st.sampled_from([0.0, 1.0, 30.0])),
        "fade_m": draw(st.sampled_from([0.3, 0.75, 3.0, 1e9])),
        "model": draw(st.sampled_from(["regions", "peak", "fading"])),
        "regions": draw(st.sampled_from([6, 12, 18, 60])),
        "gaussian": draw(st.sampled_from(["both", "angle", "distance", "none"])),
        "emptiness": draw(st.sampled_from(["none", "constant", "linear", "combined"])),
        "p_hit": draw(st.floats(0.5, 0.99)), "p_miss": draw(st.floats(0.01, 0.5)),
    }  # fmt: skip
    return replace(PING, layer="made", **{**values, **fixed})


@st.composite
def beams(draw, sensor):
    """A reading of it."""
    return beam_of(draw(PLACES), draw(PLACES), draw(ANGLES), draw(RANGES), sensor)
