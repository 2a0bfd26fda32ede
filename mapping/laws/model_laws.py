"""What every sensor model must keep."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.grid import read_only
from mapping.laws.made_readings import GRID, READINGS, Draw, beam_at, random_beam, random_sensor
from mapping.parameters import Sensor
from mapping.sensor_model import CellsInBeam, SensorModel
from mapping.sensor_model.cells import rasterise_cells
from recorder.geometry import SE2

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROUNDING = 1e-9


def _seen(model: SensorModel, draw: Draw) -> Iterator[tuple[Sensor, CellsInBeam]]:
    """Random sensors and what their beams could cover."""
    for _ in range(READINGS):
        sensor = random_sensor(draw, model)
        yield sensor, random_cells_in_beam(model, sensor, draw)


def random_cells_in_beam(
    model: SensorModel, sensor: Sensor, draw: Draw, count: int = 200
) -> CellsInBeam:
    """Random places in the front and in the band of a random range."""
    before, behind = model.band(sensor)
    range_m = float(draw.uniform(0.05, 3.0))
    start, end = range_m * (1.0 - before), range_m * (1.0 + behind)
    half = sensor.beam_width_rad / 2.0
    rho, alpha = draw.uniform(0.0, end, count), draw.uniform(-half, half, count)
    beam_cells = CellsInBeam(
        rho_m=rho,
        along_m=rho * np.cos(alpha),
        across_m=rho * np.sin(alpha),
        range_m=np.full(count, range_m),
        band_start_m=np.full(count, start),
        band_end_m=np.full(count, end),
        in_band=rho >= start,
        half_width_rad=half,
    )
    # A model that writes into what it was given is caught by the lock.
    for array in (
        beam_cells.rho_m,
        beam_cells.along_m,
        beam_cells.across_m,
        beam_cells.range_m,
        beam_cells.in_band,
    ):
        read_only(array)
    return beam_cells


def band_is_a_band(model: SensorModel, draw: Draw) -> str | None:
    """The band begins between the sensor and the range, and does not end before the range."""
    for _ in range(READINGS):
        before, behind = model.band(random_sensor(draw, model))
        if not (0.0 <= before <= 1.0 and 0.0 <= behind < np.inf):
            return f"band gives {before:g} before and {behind:g} behind the range"
    return None


def gives_probabilities(model: SensorModel, draw: Draw) -> str | None:
    """Every cell gets one probability, a number from 0 to 1."""
    for sensor, beam_cells in _seen(model, draw):
        given = np.asarray(model.occupied(sensor, beam_cells))
        if given.shape != beam_cells.rho_m.shape:
            return f"{given.shape} probabilities for {beam_cells.rho_m.shape} cells"
        wrong = ~((given >= 0.0) & (given <= 1.0))
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            return f"{given[k]:g} for a cell {_place(beam_cells, k)}"
    return None


def band_is_evidence_for_the_obstacle(model: SensorModel, draw: Draw) -> str | None:
    """Nothing in the band is below 0.5, and nothing in front of it above."""
    for sensor, beam_cells in _seen(model, draw):
        given = model.occupied(sensor, beam_cells)
        wrong = np.where(beam_cells.in_band, given < 0.5 - ROUNDING, given > 0.5 + ROUNDING)
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            where = "in the band" if beam_cells.in_band[k] else "in front of the band"
            return f"{given[k]:.4g} {where}, for a cell {_place(beam_cells, k)}"
    return None


def mirrors_across_the_beam(model: SensorModel, draw: Draw) -> str | None:
    """A cell to the left of the axis gets what its mirror image to the right gets."""
    for sensor, beam_cells in _seen(model, draw):
        left = model.occupied(sensor, beam_cells)
        right = model.occupied(sensor, replace(beam_cells, across_m=-beam_cells.across_m))
        wrong = np.abs(left - right) > ROUNDING
        wrong &= ~_on_a_region_edge(beam_cells, sensor.regions)
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            return f"{left[k]:.4g} against {right[k]:.4g} for a cell {_place(beam_cells, k)}"
    return None


def _on_a_region_edge(beam_cells: CellsInBeam, regions: int) -> Flags:
    """An edge belongs to one of its two regions, so it has no mirror image."""
    place = beam_cells.across_fraction * regions
    edge: Flags = np.abs(place - np.round(place)) < 1e-6
    return edge


def turns_with_the_beam(model: SensorModel, draw: Draw) -> str | None:
    """A robot turned by a quarter gets the same temp grid, turned by a quarter."""
    for _ in range(READINGS):
        sensor = random_sensor(draw, model)
        beam = random_beam(draw, sensor)
        pose = beam.world_from_sensor
        turned_pose = SE2(-pose.y_m, pose.x_m, pose.heading_rad + np.pi / 2.0)
        turned = beam_at(turned_pose, float(beam.ranges_m[0]), sensor)
        a = _on_the_whole_grid(rasterise_cells(beam, sensor, model, GRID))
        b = _on_the_whole_grid(rasterise_cells(turned, sensor, model, GRID))
        # Rounding may carry a centre that lies on an edge over it: one cell is allowed to.
        differing = int((np.abs(np.rot90(b, 1) - a) > 1e-6).sum())
        if differing > 1:
            return f"{differing} cells differ for a range of {beam.ranges_m[0]:.4g} m"
    return None


def _on_the_whole_grid(temp: TempGrid) -> Floats:
    whole = np.full(temp.geometry.shape, 0.5)
    whole[temp.window.slices] = temp.probability
    return whole


def each_cell_for_itself(model: SensorModel, draw: Draw) -> str | None:
    """What a cell is given depends on that cell alone, and is the same each time."""
    for sensor, beam_cells in _seen(model, draw):
        all_at_once = np.array(model.occupied(sensor, beam_cells))
        some = np.sort(draw.permutation(beam_cells.rho_m.size)[:20])
        part = beam_cells.of(some)
        alone = model.occupied(sensor, part)
        wrong = ~(np.abs(alone - all_at_once[some]) <= ROUNDING)
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            return (
                f"{alone[k]:.4g} among 20 cells, {all_at_once[some][k]:.4g} among "
                f"{beam_cells.rho_m.size}, for a cell {_place(part, k)}"
            )
    return None


def _place(beam_cells: CellsInBeam, k: int) -> str:
    angle = float(np.degrees(beam_cells.alpha_rad[k]))
    rho_m, range_m = beam_cells.rho_m[k], beam_cells.range_m[k]
    return f"{rho_m:.3g} m away, {angle:.3g} degrees off (range {range_m:.3g} m)"


ModelLaw = Callable[[SensorModel, Draw], "str | None"]
MODEL_LAWS: dict[str, ModelLaw] = {
    "the band lies at the range": band_is_a_band,
    "every cell gets one probability": gives_probabilities,
    "the band speaks for the obstacle, the front against it": band_is_evidence_for_the_obstacle,
    "the temp grid mirrors across the beam": mirrors_across_the_beam,
    "the temp grid turns with the beam": turns_with_the_beam,
    "each cell is judged by itself": each_cell_for_itself,
}
