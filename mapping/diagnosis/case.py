"""A session on trial: its readings, placed as it states, thinned to what a search can afford."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.config import MappingConfig, sensor_defaults
from mapping.diagnosis.evaluation import score
from mapping.diagnosis.hypothesis import Hypothesis, Session
from mapping.diagnosis.on_walls import on_walls
from mapping.diagnosis.patches import ThinBeams
from mapping.diagnosis.pose_quality import is_rough
from mapping.grid import GridGeometry, geometry_for
from mapping.parameters import Sensor
from mapping.pipeline import box_of
from mapping.placed_session import PlacedSession
from mapping.readings import Readings
from mapping.scoring.held_out import BlockScores, Judged, blocks_of
from recorder.columns import Ints
from recorder.errors import BadInput
from recorder.sensors import CATALOGUE

THIN_RAD = math.radians(10.0)
_MOST_READINGS = 20_000
_MOST_AXES = 40_000
_MOST_ON_WALLS = 4_000
_FINEST_M = 0.02
_MOST_CELLS = 1_000_000
_MARGIN_M = 0.4
_FEWEST = 100


@dataclass(frozen=True, slots=True)
class Case:
    """What the causes look at.

    ``thin`` and ``wide`` name the sensors whose beams are so; ``block`` (N,) cuts the readings into
    blocks of neighbours. ``rough``: the poses are too bad to draw walls with. ``scores`` remembers
    what was judged, ``walls`` how well points fitted walls, ``talks`` what was found of cross-talk.
    """

    placed: PlacedSession
    config: MappingConfig
    session: Session
    block: Ints
    blocks: int
    geometry: GridGeometry
    thin: tuple[str, ...]
    wide: tuple[str, ...]
    threads: int = 1
    rough: bool = False
    scores: dict[tuple[Hypothesis, tuple[str, ...]], Judged] = field(
        default_factory=dict, init=False, repr=False
    )
    walls: dict[tuple[Hypothesis, float], BlockScores] = field(
        default_factory=dict, init=False, repr=False
    )
    talks: dict[Hypothesis, Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def readings(self) -> Readings:
        """All readings on trial, as the session has them."""
        return self.session.readings

    @property
    def judged_by(self) -> tuple[str, ...]:
        """The sensors by which a hypothesis is judged: the thin beams, where there are any."""
        return self.thin or self.wide

    @property
    def start_ns(self) -> int:
        """When the first reading was taken."""
        return int(self.readings.t_ns.min())

    def seconds(self, row: int) -> float:
        """When a reading was taken, in seconds since the first."""
        return (int(self.readings.t_ns[row]) - self.start_ns) * 1e-9

    def rows_of(self, sensor: str) -> Ints:
        """The readings of a sensor."""
        names = [each.name for each in self.readings.sensors]
        return np.flatnonzero(self.readings.sensor == names.index(sensor))

    def is_scan(self, sensor: str) -> bool:
        """Whether a sensor has many beams at a time."""
        rows = self.rows_of(sensor)
        return bool(len(rows)) and bool(np.diff(self.readings.begins)[rows].max() > 1)

    def beams(self, sensors: Sequence[str]) -> ThinBeams:
        """The echoes of some sensors."""
        return ThinBeams(self.session, sensors, self.block)

    def on_walls(self, hypothesis: Hypothesis, wide: float) -> BlockScores:
        """How well the points of thin beams fit walls, ``wide`` times as wide as assumed, if a
        hypothesis holds; each of several sensors by as many points."""
        key = (hypothesis, wide)
        if key not in self.walls:
            beams = ThinBeams(self.session, self.thin, self.block, _MOST_ON_WALLS * len(self.thin))
            self.walls[key] = on_walls(beams, hypothesis, wide, self.blocks)
        return self.walls[key]

    def score(self, hypothesis: Hypothesis, sensors: Sequence[str] = ()) -> Judged:
        """How well the maps of some sensors predict their readings, if a hypothesis holds."""
        names = tuple(sensors) or self.judged_by
        key = (hypothesis, names)
        if key not in self.scores:
            self.scores[key] = self.judged(self.session.under(hypothesis), names)
        return self.scores[key]

    def judged(
        self, readings: Readings, sensors: Sequence[str], kept: NDArray[np.bool_] | None = None
    ) -> Judged:
        """How well the maps of some sensors predict these readings (N,), placed in another way, or
        those of them that are ``kept`` (N,)."""
        mine = np.isin(readings.sensor, _numbers(readings, sensors))
        if kept is not None:
            mine &= kept
        return score(
            readings.chosen(mine), self.block[mine], self.blocks, self.geometry,
            together=False, threads=self.threads,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stretch:
    """Readings of a sensor that are no measurements, from one time to another (nanoseconds)."""

    sensor: str
    first_ns: int
    last_ns: int


def case_of(
    placed: PlacedSession,
    config: MappingConfig,
    *,
    without: Sequence[Stretch] = (),
    threads: int = 1,
) -> Case:
    """The case of a session. Raises BadInput where there is too little to judge by."""
    readings = Readings.joined(list(placed))
    for each in without:
        mine = np.isin(readings.sensor, _numbers(readings, [each.sensor]))
        inside = (readings.t_ns >= each.first_ns) & (readings.t_ns <= each.last_ns)
        readings = readings.chosen(~(mine & inside))
    if len(readings) < _FEWEST:
        raise BadInput(f"{len(readings)} readings with a pose are too few to tell what is wrong")
    readings = _thinned(readings)
    readings = replace(readings, sensors=tuple(map(_as_usual, readings.sensors)))
    block, blocks = blocks_of(len(readings))
    low, high = box_of([readings])
    area = float(np.prod(high - low + 2 * _MARGIN_M))
    resolution_m = max(_FINEST_M, math.sqrt(area / _MOST_CELLS))
    geometry = geometry_for(
        low, high, resolution_m=resolution_m, margin_m=_MARGIN_M, max_cells=config.grid.max_cells
    )
    used = set(readings.sensor.tolist())
    there = [sensor for number, sensor in enumerate(readings.sensors) if number in used]
    thin = tuple(s.name for s in there if s.beam_width_rad <= THIN_RAD)
    wide = tuple(s.name for s in there if s.beam_width_rad > THIN_RAD)
    session = Session(readings, placed.placement)
    rough = is_rough(placed.placement.track, config.pose.max_gap_s)
    return Case(placed, config, session, block, blocks, geometry, thin, wide, threads, rough)


def _numbers(readings: Readings, names: Sequence[str]) -> list[int]:
    return [number for number, sensor in enumerate(readings.sensors) if sensor.name in names]


def _as_usual(sensor: Sensor) -> Sensor:
    """A sensor by the model of its kind: not the settings are on trial, but the session."""
    if sensor.kind not in CATALOGUE:
        return replace(sensor, update="bayes", layer=sensor.name)
    usual = sensor_defaults(CATALOGUE[sensor.kind])
    known = {
        key: value for key, value in usual.items()
        if key in Sensor.__slots__ and key not in _OF_THE_SESSION
    }  # fmt: skip
    return replace(sensor, **known, update="bayes", layer=sensor.name)


_OF_THE_SESSION = (
    "update",
    "mount",
    "min_range_m",
    "max_range_m",
    "no_echo",
    "layer",
    "clear_to_m",
)


def _thinned(readings: Readings) -> Readings:
    """Every k-th reading, and of scans every k-th beam, so that a search stays quick."""
    if len(readings) > _MOST_READINGS:
        every = math.ceil(len(readings) / _MOST_READINGS)
        kept = np.zeros(len(readings), np.bool_)
        for number in range(len(readings.sensors)):
            kept[np.flatnonzero(readings.sensor == number)[::every]] = True
        readings = readings.chosen(kept)
    every = math.ceil(len(readings.ranges_m) / _MOST_AXES)
    if every == 1:
        return readings
    counts = np.diff(readings.begins)
    within = np.arange(len(readings.ranges_m)) - np.repeat(readings.begins[:-1], counts)
    return _axes(readings, within % every == 0)


def _axes(readings: Readings, kept: NDArray[np.bool_]) -> Readings:
    counts = np.add.reduceat(kept.astype(np.int64), readings.begins[:-1])
    return replace(
        readings, begins=np.concatenate([[0], np.cumsum(counts)]),
        bearings_rad=readings.bearings_rad[kept], ranges_m=readings.ranges_m[kept],
        reach_m=readings.reach_m[kept],
    )  # fmt: skip
