"""What might be wrong with a session, as numbers; and its readings as they would then have been.

A hypothesis changes readings that are placed already: poses looked up at other times, mounts and
ranges mended. So a search tries hundreds of them in the time that it takes to place a session anew
a few times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.parameters import Sensor
from mapping.placer import Placement
from mapping.readings import Readings
from mapping.tracks import Motions, MotionTrack
from recorder.clock import NS_PER_S
from recorder.columns import Floats, Ints
from recorder.geometry import IDENTITY, SE2


@dataclass(frozen=True, slots=True)
class Change:
    """What is mended of one sensor: added to its mount, and how its ranges are taken.

    A range r becomes ``(r - bias_m) / scale``; a beam of width w ``w * widened``.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    scale: float = 1.0
    bias_m: float = 0.0
    widened: float = 1.0


NO_CHANGE = Change()


@dataclass(frozen=True, slots=True)
class Number:
    """One number of a hypothesis that can be searched for: a field of it, or of a sensor's change.

    ``step`` is small, to differentiate by (the time of poses by at least so much); ``usual`` is
    what faults amount to (one standard deviation), ``most`` what is not believed; ``least`` is the
    smallest fault worth a word.
    """

    key: str
    sensor: str | None
    step: float
    usual: float
    most: float
    least: float

    @property
    def neutral(self) -> float:
        """Its value where nothing is wrong."""
        return 1.0 if self.key in ("scale", "widened") else 0.0


def offset_of_poses() -> Number:
    """How much later the poses are than their times, seconds, with the sign of pose.offset_s."""
    return Number("offset_s", None, 0.005, 0.2, 0.5, 0.008)


def heading_of_poses() -> Number:
    """What is added to all headings, radians, with the sign of pose.heading_offset_deg."""
    return Number("heading_rad", None, 0.005, 0.2, 0.6, math.radians(0.8))


def drift_of_poses(key: str, lasted_s: float) -> Number:
    """What is added to the poses a second: ``heading_radps``, ``x_mps`` or ``y_mps``.

    As small or large over a session as an offset of the headings, or of the places, would be.
    """
    if key == "heading_radps":
        step, usual, most, least = 0.005, 0.2, 2.0, math.radians(1.5)
    else:
        step, usual, most, least = 0.002, 0.1, 1.0, 0.02
    return Number(key, None, *(each / lasted_s for each in (step, usual, most, least)))


def yaw_of(sensor: str) -> Number:
    """How far a mount is turned, radians."""
    return Number("yaw_rad", sensor, 0.005, 0.2, 0.6, math.radians(0.8))


def x_of(sensor: str) -> Number:
    """How far a mount is shifted forward, metres; along a beam that looks ahead, it is no other
    thing than a bias of its ranges."""
    return Number("x_m", sensor, 0.002, 0.05, 0.15, 0.006)


def y_of(sensor: str) -> Number:
    """How far a mount is shifted to the left, metres."""
    return Number("y_m", sensor, 0.002, 0.05, 0.15, 0.005)


def bias_of(sensor: str) -> Number:
    """How much too long all ranges are, metres."""
    return Number("bias_m", sensor, 0.002, 0.015, 0.06, 0.006)


def scale_of(sensor: str, least: float = 0.008) -> Number:
    """How many times too long the ranges are."""
    return Number("scale", sensor, 0.005, 0.03, 0.12, least)


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A whole explanation: ``offset_s`` is added to the times of the poses, ``heading_rad`` to
    their headings, and so much a second since the first pose to all three; then each sensor's."""

    offset_s: float = 0.0
    heading_rad: float = 0.0
    x_mps: float = 0.0
    y_mps: float = 0.0
    heading_radps: float = 0.0
    sensors: tuple[tuple[str, Change], ...] = ()

    def of(self, sensor: str) -> Change:
        """What is mended of a sensor."""
        return dict(self.sensors).get(sensor, NO_CHANGE)

    def with_number(self, number: Number, value: float) -> Hypothesis:
        """The same with one number replaced."""
        if number.sensor is None:
            return replace(self, **{number.key: value})  # type: ignore[arg-type]
        return self.with_sensor(number.sensor, **{number.key: value})

    def number(self, number: Number) -> float:
        """One of its numbers."""
        holder = self if number.sensor is None else self.of(number.sensor)
        return float(getattr(holder, number.key))

    def with_sensor(self, sensor: str, **values: float) -> Hypothesis:
        """The same with some numbers of a sensor replaced."""
        changed = {**dict(self.sensors), sensor: replace(self.of(sensor), **values)}
        return replace(self, sensors=tuple(sorted(changed.items())))


class Session:
    """The readings of a session, as placed, with all that is needed to place them otherwise."""

    def __init__(self, readings: Readings, placement: Placement) -> None:
        self.readings, self.placement = readings, placement
        base, track = readings.world_from_base, placement.track
        seen, self._known = track.at(readings.t_ns)
        self._base_from_tag = seen.inverse() @ base  # a tag may ride on the head
        on_robot = base.inverse() @ readings.world_from_sensor
        self._mounts = [mount_of(sensor, placement) for sensor in readings.sensors]
        of_each = _each_mount(self._mounts, readings)
        self._base_from_carrier = on_robot @ of_each.inverse()
        self._row = np.repeat(np.arange(len(readings)), np.diff(readings.begins))
        between_ns = np.diff(track.t_ns) if len(track.t_ns) > 1 else np.zeros(1)
        self.pose_interval_s = min(float(np.median(between_ns)) / NS_PER_S, _LONGEST_S)

    def has_poses(self, row: Ints, offset_s: float) -> NDArray[np.bool_]:
        """Whether poses are known for some readings (K,) if they are that much later."""
        offset_ns = round(offset_s * NS_PER_S)
        return self.placement.track.at(self.readings.t_ns[row] - offset_ns)[1]

    def mount(self, sensor: str) -> SE2:
        """Where a sensor sits, as the session is placed."""
        names = [each.name for each in self.readings.sensors]
        return self._mounts[names.index(sensor)]

    def under(
        self,
        hypothesis: Hypothesis,
        track: MotionTrack | None = None,
        measured_m: Floats | None = None,
    ) -> Readings:
        """All readings as they lie if the hypothesis holds.

        By other poses, where these are given, and as if other ranges (K,) had been measured. Those
        for which no pose would be known keep theirs.
        """
        readings = self.readings
        if measured_m is not None:
            readings = replace(readings, ranges_m=measured_m)
        base = self._base(hypothesis, track)
        changes = [hypothesis.of(sensor.name) for sensor in readings.sensors]
        mounts = [
            SE2(m.x_m + c.x_m, m.y_m + c.y_m, m.heading_rad + c.yaw_rad)
            for m, c in zip(self._mounts, changes, strict=True)
        ]
        start = base @ (self._base_from_carrier @ _each_mount(mounts, readings))
        sensor = readings.sensor[self._row]
        scale, bias_m = (np.array([getattr(c, k) for c in changes])[sensor] for k in _RANGE_KEYS)
        ranges_m, reach_m = (
            np.maximum((each - bias_m) / scale, _NEAREST_M)
            for each in (readings.ranges_m, readings.reach_m)
        )
        sensors = tuple(
            replace(s, beam_width_rad=s.beam_width_rad * c.widened) if c.widened != 1.0 else s
            for s, c in zip(readings.sensors, changes, strict=True)
        )
        return replace(
            readings, sensors=sensors, world_from_base=base, world_from_sensor=start,
            ranges_m=ranges_m, reach_m=reach_m,
        )  # fmt: skip

    def _base(self, hypothesis: Hypothesis, track: MotionTrack | None) -> Motions:
        readings = self.readings
        if hypothesis.offset_s == 0.0 and track is None:
            base = readings.world_from_base
        else:
            offset_ns = round(hypothesis.offset_s * NS_PER_S)
            poses, known = (track or self.placement.track).at(readings.t_ns - offset_ns)
            base = _where(known, poses @ self._base_from_tag, readings.world_from_base)
        rates = hypothesis.x_mps, hypothesis.y_mps, hypothesis.heading_radps
        if any(rates):
            since_s = (readings.t_ns - self.placement.track.t_ns[0]) * 1e-9
            base = Motions(
                *(
                    value + rate * since_s
                    for value, rate in zip(
                        (base.x_m, base.y_m, base.heading_rad), rates, strict=True
                    )
                )
            )
        if hypothesis.heading_rad:
            base = base @ SE2(0.0, 0.0, hypothesis.heading_rad)
        return base


_LONGEST_S = 0.2  # between poses: over more the motion is no longer even
_RANGE_KEYS = ("scale", "bias_m")
_NEAREST_M = 1e-3


def mount_of(sensor: Sensor, placement: Placement) -> SE2:
    """Where a sensor sits on the robot, or on the head that turns."""
    frames = placement.frames
    if sensor.mount is not None:
        return sensor.mount
    if (fixed := frames.mount_of(sensor.name, None)) is not None:
        return fixed
    known = frames.static.get(sensor.name)
    return IDENTITY if known is None else known.parent_from_child


def _each_mount(mounts: list[SE2], readings: Readings) -> Motions:
    places = np.array([(m.x_m, m.y_m, m.heading_rad) for m in mounts])
    return Motions(*places.T.copy()[:, readings.sensor])


def _where(chosen: NDArray[np.bool_], a: Motions, b: Motions) -> Motions:
    def pick(x: Floats, y: Floats) -> Floats:
        return np.where(chosen, x, y)

    return Motions(pick(a.x_m, b.x_m), pick(a.y_m, b.y_m), pick(a.heading_rad, b.heading_rad))
