"""Sessions → what their sensors are like."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mapping.config import MappingConfig
from mapping.config_sections import sensor_section
from mapping.layer_map import empty_maps
from mapping.learning.known_ranges import (
    WIDEST,
    KnownRanges,
    as_measured,
    from_map,
    from_tape,
    from_walls,
)
from mapping.learning.sensors import LearnedSensor, check_enough, learn_sensor
from mapping.pipeline import geometry_of
from mapping.placed_session import PlacedSession, place_session
from mapping.readings import Readings
from mapping.scoring.held_out import BlockScores, Judged, as_occupied, held_out, judge
from recorder.columns import Floats
from recorder.errors import BadInput
from recorder.messages import Radiation
from recorder.session.columns import open_session
from recorder.simulator.rooms import named_walls
from recorder.simulator.surfaces import wall_surfaces
from recorder.truth import true_surfaces, true_walls
from replay.learning.strengths import walls_of_each

_RAY_RAD = math.radians(2.0)
_THIN_RAD = math.radians(0.5)
_BANDS = (0.025, 0.05, 0.1, 0.15, 0.2)  # relative depths that are tried where no walls are known


def learn(
    sessions: Sequence[Path],
    config: MappingConfig,
    *,
    walls: Sequence[str] = (),
    trust: str | None = None,
    distances_m: Sequence[float] = (),
    only: Sequence[str] = (),
) -> list[LearnedSensor]:
    """What the sensors of some sessions are like, each sensor of all sessions together.

    Against ``walls`` (a room's name or a GeoJSON file; one for all sessions, or one for each in
    order) or those that the sessions carry; else
    against the map that ``trust``, one of the sensors, makes, or that each makes itself. With
    ``distances_m``, one to a session, the sensor stood that far from a wall. Raises BadInput, in
    one line, where nothing can be learned.
    """
    known: dict[str, list[KnownRanges]] = {}
    bases: set[str] = set()
    if distances_m and (walls or trust is not None):
        raise BadInput("the distances of a tape measure need neither walls nor a trusted sensor")
    if walls and trust is not None:
        raise BadInput("give walls or a trusted sensor, not both")
    if distances_m and len(distances_m) != len(sessions):
        raise BadInput(
            f"{len(distances_m)} distances for {len(sessions)} sessions: give one of each, in order"
        )
    given = walls_of_each(walls, sessions)
    for number, path in enumerate(sessions):
        if distances_m:
            found, against = _by_tape(path, config, distances_m[number]), "a tape measure"
        else:
            found, against = _known(path, config, given[number], trust)
        bases.add(against)
        for each in found:
            if not only or each.sensor.name in only:
                known.setdefault(each.sensor.name, []).append(each)
    if len(bases) > 1:
        raise BadInput(
            f"the sessions are held against {' and '.join(sorted(bases))}: learn from one kind"
        )
    if only and set(only) - set(known):
        missing = ", ".join(sorted(set(only) - set(known)))
        raise BadInput(f"no readings of {missing} to learn from")
    own_map = against == "its own map"
    learned, reasons = [], []
    for parts in known.values():
        try:
            joined = _joined(parts)
            check_enough(joined)
            fitted = learn_sensor(joined, against, own_map=own_map)
            if against not in ("true walls", "a tape measure"):
                fitted = replace(fitted, tuned=_tuned(sessions, config, fitted))
            learned.append(fitted)
        except BadInput as error:
            reasons.append(str(error))
    if not learned:
        raise BadInput("; ".join(reasons) or "there is no sensor to learn of")
    return learned


def _known(
    path: Path, config: MappingConfig, walls: str | None, trust: str | None
) -> tuple[list[KnownRanges], str]:
    session = open_session(path)
    placed = place_session(session, as_measured(config))
    names = list(placed.sensors)
    if walls is not None:
        walls_m, surfaces = named_walls(walls)
    else:
        own_m = true_walls(session.attachments)
        if own_m is None or trust is not None:
            return _by_map(placed, as_measured(config), trust)
        walls_m, surfaces = own_m, true_surfaces(session.attachments)
    made_of = wall_surfaces(surfaces)
    through = None if made_of is None else walls_m[made_of.opaque]
    return [from_walls(placed, n, walls_m, through=through) for n in names], "true walls"


def _tuned(
    sessions: Sequence[Path], config: MappingConfig, learned: LearnedSensor
) -> dict[str, float]:
    """The depth of the band with which the map predicts the readings best, if surely better.

    A map blurs what it is learned from, so a spread by it is no measure of the band: the readings
    that were kept out are, of all sessions together. Only models with such a band have it.
    """
    sensor = learned.sensor
    if sensor.model != "fading":
        return {}
    keys = ("behind",) if sensor.radiation is Radiation.ULTRASOUND else ("before", "behind")
    first = [_held_out_with(path, config, sensor.name, {}) for path in sessions]
    best, most = dict[str, float](), 0.0
    for depth in _BANDS:
        settings = dict.fromkeys(keys, depth)
        judged = [_held_out_with(path, config, sensor.name, settings) for path in sessions]
        pairs = [one.paired(other, [sensor.name])
                 for one, other in zip(judged, first, strict=True)]  # fmt: skip
        before, after = (BlockScores.joined(each) for each in zip(*pairs, strict=True))
        gain = after.gain_over(before)
        if gain.mean > most and gain.low > 0.0:
            best, most = settings, gain.mean
    return best


def _held_out_with(
    path: Path, config: MappingConfig, name: str, settings: Mapping[str, float]
) -> Judged:
    section = config.sensors.get(name) or sensor_section()()
    sensors = {**config.sensors, name: section.model_copy(update=dict(settings))}
    changed = config.model_copy(update={"sensors": sensors})
    placed = place_session(open_session(path), changed)
    return held_out(placed, changed, geometry_of(placed, config))


def _by_map(
    placed: PlacedSession, config: MappingConfig, trust: str | None
) -> tuple[list[KnownRanges], str]:
    """Against the map of the trusted sensor, or of each sensor's own other readings."""
    if trust is not None and trust not in placed.sensors:
        raise BadInput(f"no sensor {trust!r} to trust; there are {', '.join(placed.sensors)}")
    if trust is None:
        judged = held_out(placed, config, geometry_of(placed, config))
        known = [
            from_map(judged.readings, judged.axes_row, judged.expected_m, name)
            for name in placed.sensors
        ]
        return known, "its own map"
    known = [_by_trusted(placed, config, trust, name) for name in placed.sensors if name != trust]
    return known, f"the map of {trust}"


def _by_trusted(placed: PlacedSession, config: MappingConfig, trust: str, name: str) -> KnownRanges:
    """A sensor's readings against the whole map of another: what each of some rays would meet."""
    geometry, sensor = geometry_of(placed, config), placed.sensors[name]
    maps = empty_maps(placed.placement.sensors, geometry, config.grid)
    readings = Readings.joined(list(placed))
    layer = maps[placed.sensors[trust].layer]
    layer.merge_many(readings)
    occupied = as_occupied(layer.layer().probability, geometry.resolution_m)[None]
    block = np.zeros(len(readings), np.int64)
    count = math.ceil(WIDEST * sensor.beam_width_rad / 2.0 / _RAY_RAD)
    if len(readings.ranges_m) != len(readings):
        count = 0  # of a scan the axes are rays already
    bearings_rad: Floats = np.arange(-count, count + 1).astype(np.float64) * _RAY_RAD
    thin = tuple(replace(each, beam_width_rad=_THIN_RAD) for each in readings.sensors)
    expected_m = []
    for across_rad in bearings_rad.tolist():
        ray = replace(readings, sensors=thin, bearings_rad=readings.bearings_rad + across_rad)
        judged = judge(ray, block, 1, geometry, dict.fromkeys(maps, occupied))
        expected_m.append(judged.expected_m)
    every_m = np.column_stack(expected_m)
    return from_map(readings, judged.axes_row, every_m, name, bearings_rad if count else None)


def _by_tape(path: Path, config: MappingConfig, distance_m: float) -> list[KnownRanges]:
    """The readings of a sensor that stood still; poses are of no matter."""
    if not distance_m > 0.0:
        raise BadInput(f"a distance is above 0, not {distance_m:g} m")
    standing = as_measured(config)
    pose = standing.pose.model_copy(update={"fixed": (0.0, 0.0, 0.0)})
    placed = place_session(open_session(path), standing.model_copy(update={"pose": pose}))
    found = []
    for readings in placed:
        for number, sensor in enumerate(readings.sensors):
            mine = readings.axes_of(readings.sensor) == number
            if mine.any():
                found.append(from_tape(sensor, [readings.ranges_m[mine]], [distance_m]))
    return found


def _joined(parts: Sequence[KnownRanges]) -> KnownRanges:
    """The readings of one sensor in several sessions; blocks stay apart."""
    if len(parts) == 1:
        return parts[0]
    first = parts[0]
    ends = np.cumsum([0, *(int(each.block.max(initial=0)) + 1 for each in parts)])
    return replace(
        first,
        range_m=np.concatenate([each.range_m for each in parts]),
        true_m=np.concatenate([each.true_m for each in parts]),
        incidence_rad=np.concatenate([each.incidence_rad for each in parts]),
        t_ns=np.concatenate([each.t_ns for each in parts]),
        block=np.concatenate([e.block + end for e, end in zip(parts, ends[:-1], strict=True)]),
    )
