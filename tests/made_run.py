"""A run made by hand: a robot circles in an empty rectangle, and every reading is exact.

Small enough to be read, and independent of the mapping rooms, so that the recording can be tested
(and timed) by itself: the same artifacts in the same order as a real run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from mapping.artifacts import (
    Artifact,
    Border,
    Classes,
    Finished,
    MergedGrid,
    RawPoints,
    Segment,
    Snapshot,
    Started,
    TempGrid,
    Thresholded,
)
from mapping.beams import Beam
from mapping.grid import GridGeometry, Layer
from recorder.geometry import SE2

FIRST_T_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000  # 20 readings a second
WALL_BAND = 0.05
MOUNT = SE2(0.04, 0.0, 0.0)
SMALL_GRID = GridGeometry((-0.2, -0.3), 0.02, 90, 120)


@dataclass
class Belief:
    """The evidence of the run so far for each cell, and the points that it saw."""

    log_odds: np.ndarray
    observed: np.ndarray
    points_m: list[np.ndarray] = field(default_factory=list)
    t_ns: list[int] = field(default_factory=list)

    @property
    def probability(self) -> np.ndarray:
        return (1.0 / (1.0 + np.exp(-self.log_odds))).astype(np.float32)


@dataclass(frozen=True)
class MadeRun:
    """What is made: the grid, the sensors as layer → full beam width, how many readings."""

    geometry: GridGeometry = SMALL_GRID
    sensors: tuple[tuple[str, float], ...] = (("ping", 38.0), ("dirrs", 6.0))
    readings: int = 12
    wall_margin_m: float = 0.2  # between the walls and the edge of the grid
    turn_rad: float = 0.61
    longest_m: float = math.inf  # something stands no further away than this
    knows_walls: bool = True  # whether the run knows where the walls are

    @property
    def walls_m(self) -> np.ndarray:
        """The four walls, (4, 2, 2)."""
        low = np.array(self.geometry.origin_m) + self.wall_margin_m
        high = np.array(self.geometry.origin_m) + self.geometry.size_m - self.wall_margin_m
        corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)

    def artifacts(self) -> Iterator[Artifact]:
        """Everything that a run of the mapping stage would yield."""
        names = [name for name, _ in self.sensors]
        last_t_ns = FIRST_T_NS + (self.readings - 1) * STEP_NS
        walls = self.walls_m if self.knows_walls else np.zeros((0, 2, 2))
        yield Started(self.geometry, (*names, "fused"), walls, FIRST_T_NS, last_t_ns)
        beliefs = {
            name: Belief(np.zeros(self.geometry.shape), np.zeros(self.geometry.shape, bool))
            for name in names
        }
        for number in range(self.readings):
            beam = self.beam(number)
            yield beam
            temp = temp_grid(beam, self.geometry)
            yield temp
            yield merged(beliefs[beam.layer], temp)
        for name in names:
            yield from _stages(name, beliefs[name], self.geometry)
        fused = Belief(sum(b.log_odds for b in beliefs.values()), beliefs[names[0]].observed)
        yield from _stages("fused", fused, self.geometry)
        codes = np.zeros(self.geometry.shape, np.uint8)
        for bit, name in enumerate(names):
            codes |= (beliefs[name].probability > 0.55).astype(np.uint8) << bit
        yield Classes(self.geometry, codes, ("nothing", "ping alone", "dirrs alone", "agree"))
        used = {name: len(beliefs[name].points_m) for name in names}
        yield Finished(self.readings, used, {"out of range": 2})

    def beam(self, number: int) -> Beam:
        """Reading ``number``: the robot stands on an ellipse and looks further round each time."""
        name, width_deg = self.sensors[number % len(self.sensors)]
        centre = np.array(self.geometry.origin_m) + np.array(self.geometry.size_m) / 2
        radius = np.array(self.geometry.size_m) * 0.22
        around = 2 * math.pi * number / max(self.readings, 60)
        x, y = centre + radius * [math.cos(around), math.sin(around)]
        base = SE2(float(x), float(y), self.turn_rad * number % (2 * math.pi) - math.pi)
        sensor = base @ MOUNT
        return Beam(
            number=number,
            t_ns=FIRST_T_NS + number * STEP_NS,
            sensor=name,
            layer=name,
            world_from_base=base,
            world_from_sensor=sensor,
            bearings_rad=np.zeros(1),
            ranges_m=np.array([self._range_m(sensor)]),
            beam_width_rad=math.radians(width_deg),
            reach_m=4.0,
        )

    def _range_m(self, sensor: SE2) -> float:
        low, high = self.walls_m[0, 0], self.walls_m[1, 1]
        c, s = math.cos(sensor.heading_rad), math.sin(sensor.heading_rad)
        along_x = ((high if c > 0 else low)[0] - sensor.x_m) / c if abs(c) > 1e-9 else math.inf
        along_y = ((high if s > 0 else low)[1] - sensor.y_m) / s if abs(s) > 1e-9 else math.inf
        return float(min(along_x, along_y, self.longest_m))


def temp_grid(beam: Beam, geometry: GridGeometry) -> TempGrid:
    """A plain sensor model: a band at the range, fading with it, and emptiness before it."""
    window = geometry.window_around(*beam.bounds_m(1.0 + WALL_BAND))
    rows, cols = np.mgrid[window.slices]
    centres = geometry.centres_of(np.stack([rows, cols], axis=-1))
    delta = centres - [beam.world_from_sensor.x_m, beam.world_from_sensor.y_m]
    rho = np.hypot(delta[..., 0], delta[..., 1])
    alpha = np.arctan2(delta[..., 1], delta[..., 0]) - beam.world_from_sensor.heading_rad
    alpha = (alpha + math.pi) % (2 * math.pi) - math.pi
    d = float(beam.ranges_m[0])
    inside = np.abs(alpha) <= beam.beam_width_rad / 2
    band = inside & (np.abs(rho - d) <= WALL_BAND * d)
    free = inside & (rho < (1 - WALL_BAND) * d)
    hit = 0.8 / (1 + (d / 0.75) ** 2)
    miss = 0.08 * (1 + 30 * np.exp(-((rho / 0.35) ** 2))) / (1 + (rho / 0.75) ** 2)
    log_odds = np.where(band, hit, np.where(free, -miss, 0.0))
    return TempGrid(beam, geometry, window, 1 / (1 + np.exp(-log_odds)), band, free)


def merged(belief: Belief, temp: TempGrid) -> MergedGrid:
    """The log-odds added, and the rectangle before and after."""
    part = temp.window.slices
    p = temp.probability
    previous = (1.0 / (1.0 + np.exp(-belief.log_odds[part]))).astype(np.float32)
    belief.log_odds[part] = np.clip(belief.log_odds[part] + np.log(p / (1 - p)), -13.8, 13.8)
    belief.observed[part] |= temp.band | temp.free
    belief.points_m.append(temp.beam.points_m)
    belief.t_ns.append(temp.beam.t_ns)
    after = (1.0 / (1.0 + np.exp(-belief.log_odds[part]))).astype(np.float32)
    return MergedGrid(
        temp.beam, temp.beam.layer, "bayes", "probability", temp.geometry, temp.window,
        after, after, previous,
    )  # fmt: skip


def _stages(name: str, belief: Belief, geometry: GridGeometry) -> Iterator[Artifact]:
    """The end of a layer: the whole of it, its threshold, one border, raw points, one segment."""
    p = belief.probability
    yield Snapshot(Layer(name, "probability", geometry, p, p, belief.observed, {}), "bayes", True)
    occupied = p > 0.55
    yield Thresholded(name, geometry, 0.55, occupied)
    cells = np.argwhere(occupied)
    if len(cells):
        (row0, col0), (row1, col1) = cells.min(axis=0), cells.max(axis=0)
        box = np.array([[row1, col0], [row0, col0], [row0, col1], [row1, col1]], np.int64)
        yield Border(name, 0, True, geometry, box)
        ends = geometry.centres_of(box[1:3])
        yield segment_between(name, tuple(ends[0]), tuple(ends[1]))
    if belief.points_m:
        points = np.concatenate(belief.points_m)
        yield RawPoints(name, points, np.array(belief.t_ns, np.int64))


def segment_between(
    layer: str, start_m: tuple[float, float], end_m: tuple[float, float]
) -> Segment:
    """A segment with the line through its ends, and a made-up covariance."""
    (x0, y0), (x1, y1) = start_m, end_m
    alpha = math.atan2(x1 - x0, -(y1 - y0))
    rho = x0 * math.cos(alpha) + y0 * math.sin(alpha)
    return Segment(
        layer, "grid", 0, (float(x0), float(y0)), (float(x1), float(y1)), rho, alpha,
        np.array([[1e-5, 1e-7], [1e-7, 2e-6]]), 0.004, 37,
    )  # fmt: skip
