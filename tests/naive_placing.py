"""Readings + poses + mounts → beams in the map frame, one by one: the slow twin of the placer."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from naive_poses import FrameTree, Track
from numpy.typing import NDArray

from mapping.beams import Beam, reach_of_axes
from mapping.config import MappingConfig, Sensor
from mapping.scan_reach import ScanReach, reach_of_rangers
from mapping.selection import selected
from mapping.sensors import resolve_sensors
from mapping.tracks import is_sane
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import (
    HEAD_FRAME,
    Message,
    Odometry,
    Pose,
    Range,
    Record,
    Scan,
    Transform,
)


@dataclass(frozen=True, slots=True)
class Placed:
    """All beams of a session in the order of its readings, its sensors, and what was left out."""

    beams: tuple[Beam, ...]
    sensors: dict[str, Sensor]
    readings: int
    used: dict[str, int]
    dropped: dict[str, int]
    notes: tuple[str, ...] = ()


def place(session: Iterable[Message | Record], config: MappingConfig) -> Placed:
    """Pair each reading with the pose at its own time and put it into the map frame.

    Of records what is mapped is chosen by their topics (:mod:`mapping.selection`); single messages
    are taken as they are. Raises BadInput, in one line, where there are no readings or no poses.
    """
    given = list(session)
    records = [each for each in given if isinstance(each, Record)]
    if not records:
        messages = [each for each in given if not isinstance(each, Record)]
        return _placed(messages, config, _found(messages))
    found = _found([record.message for record in records])
    if not any(isinstance(record.message, Range | Scan) for record in records):
        raise BadInput(f"no range readings in the session (found: {found})")
    kept, selection = selected(records, config)
    try:
        placed = _placed(kept, selection.config, found)
    except BadInput as error:
        raise BadInput("; ".join([str(error), *selection.notes])) from None
    notes = (*selection.notes, *selection.mount_notes(placed.sensors.values()))
    return replace(placed, notes=notes)


def _placed(kept: list[Message], config: MappingConfig, found: str) -> Placed:
    dropped: Counter[str] = Counter()
    transforms = [m for m in kept if isinstance(m, Transform)]
    frames = FrameTree.of(transforms, config.pose.max_gap_s)
    readings = [m for m in kept if isinstance(m, Range | Scan)]
    if not readings:
        raise BadInput(f"no range readings in the session (found: {found})")
    track = _track(kept, config, dropped, found)
    sensors = resolve_sensors(readings, frames.parent_of, config)
    used: Counter[str] = Counter()
    beams: list[Beam] = []
    reach = ScanReach()
    clocks_back = 0
    last_ns = readings[0].t_ns
    for reading in readings:
        clocks_back += reading.t_ns < last_ns
        last_ns = reading.t_ns
        outcome = place_reading(
            len(beams), reading, sensors[reading.sensor], track, frames, config, reach
        )
        if isinstance(outcome, Beam):
            beams.append(outcome)
            used[reading.sensor] += 1
        else:
            dropped[outcome] += 1
    if clocks_back:
        dropped["clock stepped back (reading kept)"] = clocks_back
    if not beams:
        why = ", ".join(f"{count} {reason}" for reason, count in dropped.items())
        raise BadInput(f"not one reading can be mapped: {why} (found: {found})")
    return Placed(tuple(beams), sensors, len(readings), dict(used), dict(dropped))


def _found(messages: list[Message]) -> str:
    counts = Counter(type(m).__name__.lower() for m in messages)
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "nothing"


def _track(
    messages: list[Message], config: MappingConfig, dropped: Counter[str], found: str
) -> Track:
    if config.pose.fixed is not None:
        x_m, y_m, heading_deg = config.pose.fixed
        fixed = SE2(x_m, y_m, math.radians(heading_deg))
        times = [m.t_ns for m in messages]
        return Track([min(times), max(times)], [fixed, fixed], max(times) - min(times) + 1)
    tracked = [(m.t_ns, m.world_from_base) for m in messages if isinstance(m, Pose)]
    odometry = [(m.t_ns, m.odom_from_base) for m in messages if isinstance(m, Odometry)]
    by_odometry = not tracked or config.pose.topic == "/odom"
    stamped = odometry if by_odometry else tracked
    if not stamped:
        raise BadInput(f"no poses in the session (found: {found})")
    sane = [(t_ns, pose) for t_ns, pose in stamped if is_sane(pose)]
    if len(sane) < len(stamped):
        dropped["pose not finite or too far"] = len(stamped) - len(sane)
    track = Track.of(sane, config.pose.max_gap_s)
    if by_odometry and config.pose.odom_start == "tracker":
        seen = [(t_ns, pose) for t_ns, pose in tracked if is_sane(pose)]
        return laid_on(track, Track.of(seen, config.pose.max_gap_s))
    return track


def laid_on(odometry: Track, tracker: Track) -> Track:
    """Dead reckoning moved as a whole, so that it starts where the tracker has the robot.

    At the first time that both know: ``world_from_odom = world_from_base @ odom_from_base⁻¹``. From
    there on nothing corrects it, so that its drift can be seen. Raises BadInput where the two have
    no time in common.
    """
    for t_ns in sorted({*odometry.t_ns, *tracker.t_ns}):
        world_from_base, odom_from_base = tracker.at(t_ns), odometry.at(t_ns)
        if world_from_base is not None and odom_from_base is not None:
            world_from_odom = world_from_base @ odom_from_base.inverse()
            moved = [world_from_odom @ pose for pose in odometry.poses]
            return Track(odometry.t_ns, moved, odometry.max_gap_ns)
    raise BadInput("there is no time at which the tracker and dead reckoning both know the pose")


def place_reading(
    number: int,
    reading: Range | Scan,
    sensor: Sensor,
    track: Track,
    frames: FrameTree,
    config: MappingConfig,
    reach: ScanReach,
) -> Beam | str:
    """The beam, or the reason why there is none; ``reach`` knows the scans before it."""
    ranges_m = _checked(reading, sensor)
    if isinstance(ranges_m, str):
        return ranges_m
    pose = track.at(reading.t_ns)
    if pose is None:
        return "no pose at that time"
    placed = _world_from_sensor(reading, sensor, pose, frames, config)
    if placed is None:
        return "no head angle at that time"
    base, world_from_sensor = placed
    bearings = _bearings(reading)
    usable = ~np.isnan(ranges_m)
    bearings, ranges_m = bearings[usable], ranges_m[usable]
    bearings.flags.writeable = ranges_m.flags.writeable = False
    if isinstance(reading, Scan):
        reach_m = reach.of_scan(world_from_sensor, bearings, ranges_m, sensor)
    else:
        reach_m = reach_of_rangers(ranges_m, sensor.max_range_m, sensor.clear_to_m or math.inf)
    return Beam(
        number=number, t_ns=reading.t_ns, sensor=sensor.name, layer=sensor.layer,
        world_from_base=base, world_from_sensor=world_from_sensor, bearings_rad=bearings,
        ranges_m=ranges_m, beam_width_rad=sensor.beam_width_rad, reach_m=reach_of_axes(reach_m),
    )  # fmt: skip


def _bearings(reading: Range | Scan) -> NDArray[np.float64]:
    """Direction of each axis relative to the sensor, (N,)."""
    if isinstance(reading, Range):
        return np.zeros(1)
    steps = np.arange(len(reading.ranges_m), dtype=np.float64)
    return np.asarray(reading.angle_min_rad + reading.angle_increment_rad * steps, np.float64)


def _checked(
    reading: Range | Scan, sensor: Sensor
) -> np.ndarray[tuple[int], np.dtype[np.float64]] | str:
    """Ranges (N,), +Inf: nothing seen, NaN: not usable; or why the whole reading is dropped."""
    if isinstance(reading, Scan):
        ranges = np.array(reading.ranges_m, np.float64)
        # A beam that is not usable is no evidence; one past the limit saw nothing.
        ranges[~(ranges >= max(sensor.min_range_m, 1e-9))] = np.nan
        ranges[ranges >= sensor.max_range_m] = np.inf
        if np.isnan(ranges).all():
            return "no usable beam"
        return ranges
    d = reading.range_m
    if math.isnan(d):
        return "not a number"
    if d == -math.inf:
        return "too close"
    if d <= 0:
        return "zero or negative"
    if d >= sensor.max_range_m:
        d = math.inf
    if d < sensor.min_range_m:
        return "below the sensor's minimum"
    if math.isinf(d) and sensor.no_echo == "skipped":
        return "saw nothing (skipped)"
    return np.array([d])


def _world_from_sensor(
    reading: Range | Scan, sensor: Sensor, pose: SE2, frames: FrameTree, config: MappingConfig
) -> tuple[SE2, SE2] | None:
    """(world_from_base, world_from_sensor); None where a turning frame has no angle then."""
    base = pose
    if config.pose.rides_on == "head" and HEAD_FRAME in frames.moving:
        head = frames.base_from(HEAD_FRAME, reading.t_ns)
        if head is None:
            return None
        # The tag turns with the head about the robot's centre: take the head's angle out again.
        base = pose @ SE2(0.0, 0.0, head.heading_rad).inverse()
    mount = sensor.mount
    if mount is None:
        mounted = frames.base_from(sensor.name, reading.t_ns)
    elif frames.parent_of(sensor.name) in frames.moving:
        head = frames.base_from(str(frames.parent_of(sensor.name)), reading.t_ns)
        mounted = None if head is None else head @ mount
    else:
        mounted = mount
    return None if mounted is None else (base, base @ mounted)
