"""The seeded sessions that all peers map: made up, the same bytes each time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Session:
    """Readings of one sensor in a rectangle of the map frame.

    ``poses`` (N, 3) are x, y in metres and the heading of the sensor; ``ranges_m`` (N, B), NaN
    where a beam says nothing. A ranger has one beam, a scan's beams are ``beam_width_rad`` apart,
    symmetric about the heading.
    """

    name: str
    resolution_m: float
    low_m: tuple[float, float]
    high_m: tuple[float, float]
    beam_width_rad: float
    reach_m: float
    poses: Floats
    ranges_m: Floats

    @property
    def bearings_rad(self) -> Floats:
        """Direction of each beam relative to the heading, (B,)."""
        beams = self.ranges_m.shape[1]
        return (np.arange(beams) - (beams - 1) / 2) * self.beam_width_rad


def _ranger(
    name: str, width_deg: float, resolution_m: float, size_m: tuple[float, float],
    longest_m: float, median_m: float, reach_m: float, readings: int, seed: int,
) -> Session:  # fmt: skip
    draw = np.random.default_rng(seed)
    poses = np.column_stack(
        [draw.uniform(0.1, 0.9, readings) * size_m[0], draw.uniform(0.1, 0.9, readings) * size_m[1],
         draw.uniform(-math.pi, math.pi, readings)]
    )  # fmt: skip
    ranges = np.clip(draw.lognormal(math.log(median_m), 0.55, readings), 0.05, longest_m)
    return Session(
        name, resolution_m, (0.0, 0.0), size_m, math.radians(width_deg), reach_m, poses,
        ranges[:, None],
    )  # fmt: skip


def sonar(readings: int = 2000) -> Session:
    """38 degrees, 3 cells a centimetre, 2 x 1.33 m: the chapter's arena."""
    return _ranger("sonar", 38.0, 1 / 300, (2.0, 4 / 3), 1.2, 0.34, 4.0, readings, 1)


def infrared(readings: int = 2000) -> Session:
    """6 degrees, the same cells."""
    return _ranger("infrared", 6.0, 1 / 300, (2.0, 4 / 3), 0.8, 0.34, 0.8, readings, 2)


def coarse_sonar(readings: int = 2000) -> Session:
    """38 degrees in a room, 2 cm cells, to 3 m."""
    return _ranger("sonar, 2 cm", 38.0, 0.02, (8.0, 6.0), 3.0, 1.2, 4.0, readings, 3)


def coarse_infrared(readings: int = 2000) -> Session:
    """6 degrees in a room, 2 cm cells, to 0.8 m."""
    return _ranger("infrared, 2 cm", 6.0, 0.02, (8.0, 6.0), 0.8, 0.5, 0.8, readings, 4)


def lidar(readings: int = 400) -> Session:
    """180 beams over 180 degrees in a hall of 32 x 25 m with pillars, 5 cm cells, 85 % valid."""
    draw = np.random.default_rng(5)
    size = (32.0, 25.0)
    pillars = np.column_stack([draw.uniform(3, 29, 12), draw.uniform(3, 22, 12)])
    x, y = draw.uniform(5, 27, readings), draw.uniform(5, 20, readings)
    heading = draw.uniform(-math.pi, math.pi, readings)
    bearings = (np.arange(180) - 89.5) * math.radians(1.0)
    angle = heading[:, None] + bearings
    c, s = np.cos(angle), np.sin(angle)
    to_wall = np.minimum(
        np.where(c > 0, (size[0] - x)[:, None], -x[:, None]) / c,
        np.where(s > 0, (size[1] - y)[:, None], -y[:, None]) / s,
    )
    for px, py in pillars:
        dx, dy = (px - x)[:, None], (py - y)[:, None]
        along, across = dx * c + dy * s, dy * c - dx * s
        meets = (along > 0.0) & (np.abs(across) < 0.4)
        near = along - np.sqrt(np.maximum(0.16 - across**2, 0.0))
        to_wall = np.where(meets & (near > 0.3), np.minimum(to_wall, near), to_wall)
    ranges = to_wall * (1.0 + draw.normal(0.0, 0.003, to_wall.shape))
    ranges[(ranges > 20.0) | (draw.uniform(size=ranges.shape) > 0.95)] = math.nan
    return Session(
        "lidar", 0.05, (-1.0, -1.0), (33.0, 26.0), math.radians(1.0), 20.0,
        np.column_stack([x, y, heading]), ranges,
    )  # fmt: skip


SESSIONS = {
    "sonar": sonar, "infrared": infrared, "coarse-sonar": coarse_sonar,
    "coarse-infrared": coarse_infrared, "lidar": lidar,
}  # fmt: skip
