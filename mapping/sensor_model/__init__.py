"""One beam → its temp grid: the evidence of this reading alone for each cell.

Two tables name what there is: ``SENSOR_MODELS`` (how strong the evidence is) and ``RASTERISERS``
(for which cells).
"""

from __future__ import annotations

import math
from collections.abc import Callable

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.grid import GridGeometry
from mapping.names import choose
from mapping.parameters import Sensor
from mapping.sensor_model.arcs import rasterise_arcs
from mapping.sensor_model.cells import rasterise_cells, reach_of
from mapping.sensor_model.models import (
    SENSOR_MODELS,
    CellsInBeam,
    SensorModel,
    emptiness,
    region_of,
    regions_table,
)
from mapping.sensor_model.rays import rasterise_rays
from recorder.errors import BadInput

Rasteriser = Callable[[Beam, Sensor, SensorModel, GridGeometry], TempGrid]
RASTERISERS: dict[str, Rasteriser] = {
    "cells": rasterise_cells, "arcs": rasterise_arcs, "rays": rasterise_rays,
}  # fmt: skip

__all__ = [
    "RASTERISERS",
    "SENSOR_MODELS",
    "CellsInBeam",
    "SensorModel",
    "emptiness",
    "make_temp_grid",
    "region_of",
    "regions_table",
    "stretch_of",
]


def stretch_of(sensor: Sensor) -> float:
    """How far a reading can touch cells, in shares of its range.

    Raises BadInput where there is no such model, or its band has no end.
    """
    model = choose(SENSOR_MODELS, sensor.model, "sensor model")
    reach = max(reach_of(model, each) for each in sensor.models)
    if not math.isfinite(reach):
        raise BadInput(f"sensor model {model.name!r}: its band has no end ({reach - 1.0} ranges)")
    return reach


def make_temp_grid(beam: Beam, sensor: Sensor, geometry: GridGeometry) -> TempGrid:
    """The evidence of one reading for each cell of the rectangle that its beam covers.

    Raises BadInput where the sensor names a model, a rasteriser or regions that do not exist.
    """
    model = choose(SENSOR_MODELS, sensor.model, "sensor model")
    rasterise = choose(RASTERISERS, sensor.rasteriser, "rasteriser")
    return rasterise(beam, sensor, model, geometry)
