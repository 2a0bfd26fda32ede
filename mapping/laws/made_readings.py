"""Random readings on a small grid, for laws to be tried on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.config import MappingConfig, ReportedSensor, Sensor, resolve_sensor
from mapping.grid import GridGeometry
from mapping.sensor_model import SENSOR_MODELS, SensorModel
from mapping.sensor_model.cells import rasterise_cells
from recorder.geometry import SE2
from recorder.messages import Radiation

Draw = np.random.Generator

GRID = GridGeometry((-1.0, -1.0), 0.05, 40, 40)
READINGS = 12
"""How many random cases each law tries."""


def random_sensor(draw: Draw, model: SensorModel = SENSOR_MODELS["peak"]) -> Sensor:
    """A sensor with a random beam, error and shape; keys of the model alone keep their defaults."""
    reported = ReportedSensor("made", Radiation.ULTRASOUND)
    return replace(
        resolve_sensor(reported, MappingConfig(), mounted=False),
        layer="made",
        model=model.name,
        own=model.Parameters.defaults(),
        beam_width_rad=float(draw.uniform(0.02, 2.0)),
        range_error=float(draw.uniform(0.0, 0.3)),
        regions=int(6 * draw.integers(1, 5)),
        gaussian=str(draw.choice(["both", "angle", "distance", "none"])),
        emptiness=str(draw.choice(["constant", "linear", "combined"])),
        fade_m=float(draw.uniform(0.3, 3.0)),
        no_echo="empties",
    )


def random_beam(draw: Draw, sensor: Sensor, *, echo: bool = True) -> Beam:
    """A beam somewhere on the grid; its heading may lie beyond ±pi."""
    x, y = draw.uniform(-0.8, 0.8, 2)
    pose = SE2(float(x), float(y), float(draw.uniform(-7.0, 7.0)))
    range_m = float(draw.uniform(0.01, 1.2)) if echo else np.inf
    return beam_at(pose, range_m, sensor)


def beam_at(pose: SE2, range_m: float, sensor: Sensor) -> Beam:
    """A reading of a ranger that stands at a pose and looks ahead."""
    return Beam(
        number=0,
        t_ns=0,
        sensor=sensor.name,
        layer=sensor.layer,
        world_from_base=pose,
        world_from_sensor=pose,
        bearings_rad=np.zeros(1),
        ranges_m=np.array([range_m]),
        beam_width_rad=sensor.beam_width_rad,
        reach_m=1.5,
    )


def random_reading(draw: Draw, *, echo: bool = True) -> TempGrid:
    """The temp grid of a random beam, by one of the built-in models."""
    model = SENSOR_MODELS[str(draw.choice(["regions", "peak", "fading"]))]
    sensor = random_sensor(draw, model)
    return rasterise_cells(random_beam(draw, sensor, echo=echo), sensor, model, GRID)


def one_spot_readings() -> tuple[TempGrid, TempGrid]:
    """Two readings over the same window: one ends in a cell, the other passes through it."""
    sensor = replace(random_sensor(np.random.default_rng(0)), beam_width_rad=0.02,
                     range_error=0.0, emptiness="constant", gaussian="none", p_hit=0.95,
                     p_miss=0.05)  # fmt: skip
    grid = GridGeometry((0.0, 0.0), 0.1, 1, 5)
    pose = SE2(0.05, 0.05, 0.0)
    hit, through = (
        rasterise_cells(beam_at(pose, range_m, sensor), sensor, SENSOR_MODELS["peak"], grid)
        for range_m in (0.2, 0.4)
    )
    width = hit.window.cols
    through = replace(
        through, window=hit.window, probability=through.probability[:, :width],
        band=through.band[:, :width], free=through.free[:, :width],
    )  # fmt: skip
    return hit, through
