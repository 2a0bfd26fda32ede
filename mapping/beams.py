"""A reading, the pose at its time and the sensor's mount → a beam in the map frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.geometry import SE2


def reach_of_axes(reach_m: NDArray[np.float64]) -> float | NDArray[np.float64]:
    """The reach of a reading's axes (N,) as a beam holds it: a number where there is one axis."""
    if len(reach_m) == 1:
        return float(reach_m[0])
    reach_m.flags.writeable = False
    return reach_m


@dataclass(frozen=True, slots=True)
class Beam:
    """One reading, placed: where its beam starts, where it looks and how far it got.

    ``number`` counts the readings of a session from 0 in the order in which they are mapped.
    A ranger has one axis (``bearings_rad == [0]``); a laser scan has one for each of its beams.
    ``bearings_rad`` and ``ranges_m`` are both (N,); a range of +Inf saw nothing.
    ``world_from_sensor`` is the beam's origin and heading; ``reach_m`` how far the sensor
    sees, and so how far a beam without return clears; of scans and of sensors that may clear less,
    one for each axis (N,). An obstacle beyond ``mark_to_m`` is not marked: what lies before it is
    free, no more. ``model`` names which of several models of its sensor, by range, it is judged by.
    """

    number: int
    t_ns: int
    sensor: str
    layer: str
    world_from_base: SE2
    world_from_sensor: SE2
    bearings_rad: NDArray[np.float64]
    ranges_m: NDArray[np.float64]
    beam_width_rad: float
    reach_m: float | NDArray[np.float64]
    mark_to_m: float = math.inf
    model: str = ""

    @property
    def headings_rad(self) -> NDArray[np.float64]:
        """Direction of each axis in the map frame, (N,), not wrapped."""
        return self.bearings_rad + self.world_from_sensor.heading_rad

    @property
    def saw_something(self) -> NDArray[np.bool_]:
        """Which axes came back with an obstacle, (N,)."""
        return np.isfinite(self.ranges_m)

    @property
    def marks(self) -> NDArray[np.bool_]:
        """Which axes mark their obstacle, (N,)."""
        return self.saw_something & (self.ranges_m <= self.mark_to_m)

    @property
    def far_m(self) -> NDArray[np.float64]:
        """How far each axis reaches: its range, or how far it clears without return, (N,)."""
        return np.where(self.saw_something, self.ranges_m, self.reach_m)

    @property
    def points_m(self) -> NDArray[np.float64]:
        """Obstacle point of each axis that saw one, (M, 2), metres, map frame."""
        seen = self.saw_something
        heading, d = self.headings_rad[seen], self.ranges_m[seen]
        origin = self.world_from_sensor
        return np.column_stack([origin.x_m + d * np.cos(heading), origin.y_m + d * np.sin(heading)])

    @property
    def spread_rad(self) -> tuple[float, float]:
        """Lowest and highest direction that any part of the beam covers, relative to the sensor."""
        half = self.beam_width_rad / 2.0
        return float(self.bearings_rad.min()) - half, float(self.bearings_rad.max()) + half

    def bounds_m(self, stretch: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """A box (low, high) that holds the beam with its ranges stretched by a factor."""
        reach = float(self.far_m.max(initial=0.0)) * stretch
        low, high = self.spread_rad
        start = self.world_from_sensor.heading_rad
        # The box of a sector: its tip, its two edges, and each axis direction that it crosses.
        edges = [start + low, start + high]
        first = math.ceil(edges[0] / (math.pi / 2))
        edges += [k * math.pi / 2 for k in range(first, first + 4) if k * math.pi / 2 <= edges[1]]
        x = np.array([0.0, *(reach * math.cos(a) for a in edges)]) + self.world_from_sensor.x_m
        y = np.array([0.0, *(reach * math.sin(a) for a in edges)]) + self.world_from_sensor.y_m
        return np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
