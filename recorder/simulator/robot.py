"""A robot that is not there: it drives a route through a room and says what its sensors hear.

Everything is simulated in its own time and follows from the seed: the same call gives the same
messages, however long it took. Each sensor, the tracker and the wheels draw from random numbers of
their own, so leaving one out does not change the others.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from recorder.errors import BadInput
from recorder.geometry import IDENTITY, SE2, wrap_angle
from recorder.messages import (
    BASE_FRAME,
    HEAD_FRAME,
    Message,
    Odometry,
    Pose,
    Scan,
    Transform,
)
from recorder.names import did_you_mean
from recorder.odometry import COUNTER_RANGE, DeadReckoning, WheelGeometry
from recorder.protocols.reports import HeadReport, RangeReport, WheelReport
from recorder.sensors import BUILT_IN_SENSORS
from recorder.simulator.drive import Drive
from recorder.simulator.echoes import Ranger, range_reading, scan_reading
from recorder.simulator.rooms import Room, check_route

DEFAULT_START_NS = 1_767_225_600_000_000_000  # 2026-01-01T00:00:00Z
DEFAULT_SENSORS = ("ping", "dirrs")
WHEELS = WheelGeometry(ticks_per_m=2000.0, track_m=0.106)
HEAD_SPEED_RADPS = math.radians(60.0)
MAX_HEAD_SWEEP_DEG = 180.0
MAX_NOISE = 10.0

LIDAR = "lidar"
LIDAR_MIN_M, LIDAR_MAX_M = 0.05, 12.0
_MOUNTS = {"ping": SE2(0.044, 0.0, 0.0), "dirrs": SE2(-0.0312, 0.0, 0.0)}
RANGERS = {
    name: Ranger(name, BUILT_IN_SENSORS[name], base_from_sensor)
    for name, base_from_sensor in _MOUNTS.items()
}

_RANGE_PERIOD_NS = 50_000_000
_RANGE_OFFSET_NS = {"ping": 0, "dirrs": 25_000_000}  # they take turns
_SCAN_PERIOD_NS = 200_000_000
_POSE_PERIOD_NS = 100_000_000
_WHEEL_PERIOD_NS = 50_000_000
_SERIAL_LATENCY_NS = 4_000_000
_TRACKER_LATENCY_NS = 30_000_000
_POSE_ERROR_M = 0.003
_POSE_ERROR_RAD = math.radians(1.0)
_WHEEL_SIZE_ERROR = 0.005
_WHEEL_SLIP = 0.02  # of the way rolled between two readings of the counters
_STREAMS = ("pose", "wheels", "ping", "dirrs", LIDAR)  # each with random numbers of its own


@dataclass(frozen=True, slots=True)
class Event:
    """Something that a device of the simulated robot says.

    ``t_ns`` is when it was measured, ``log_ns`` when it reaches the host.
    """

    t_ns: int
    log_ns: int
    said: Pose | RangeReport | HeadReport | WheelReport | Scan


class Robot:
    """The robot in its room, with time counted in nanoseconds from the start of its drive.

    Raises BadInput for an unknown sensor, a route that cannot be driven, and numbers out of range.
    ``head_sweep_deg`` above 0 puts the rangers on a head that turns to and fro by so much to
    either side.
    """

    def __init__(
        self,
        room: Room,
        *,
        seed: int,
        noise: float = 1.0,
        sensors: Sequence[str] = DEFAULT_SENSORS,
        route: NDArray[np.float64] | None = None,
        head_sweep_deg: float = 0.0,
        lidar_beams: int = 360,
    ) -> None:
        for what, value, highest in (
            ("noise", noise, MAX_NOISE),
            ("head sweep", head_sweep_deg, MAX_HEAD_SWEEP_DEG),
            ("seed", seed, math.inf),
        ):
            if not 0.0 <= value <= highest:
                raise BadInput(f"the {what} must be between 0 and {highest:g}, not {value:g}")
        if route is not None and route is not room.route_m:
            check_route(route, room)
        self.room = room
        self.sensors = _known_sensors(sensors)
        self.drive = Drive(room.route_m if route is None else route, WHEELS.track_m)
        self._noise = noise
        self._seed = seed
        self._sweep_rad = math.radians(head_sweep_deg)
        self._bearings_rad = _bearings(lidar_beams)

    def events(self, duration_s: float = math.inf) -> Iterator[Event]:
        """All that is said of the first ``duration_s`` seconds, in the order of ``log_ns``."""
        sources = [self._poses(), self._wheels()]
        rangers = [RANGERS[name] for name in self.sensors if name in RANGERS]
        sources += [self._ranges(ranger) for ranger in rangers]
        if LIDAR in self.sensors:
            sources.append(self._scans())
        end_ns = duration_s * 1e9
        within = [itertools.takewhile(lambda event: event.t_ns <= end_ns, s) for s in sources]
        return heapq.merge(*within, key=attrgetter("log_ns"))

    def mounts(self) -> dict[str, tuple[str, SE2]]:
        """The frame that each sensor is fixed to, and where it sits there."""
        carrier = HEAD_FRAME if self._sweep_rad > 0.0 else BASE_FRAME
        return {
            name: (carrier, RANGERS[name].mount) if name in RANGERS else (BASE_FRAME, IDENTITY)
            for name in self.sensors
        }

    def world_from_base(self, t_ns: int) -> SE2:
        """Where the robot truly is."""
        return self.drive.at(t_ns * 1e-9).world_from_base

    def head_rad(self, t_ns: int) -> float:
        """The angle of the head: to and fro at a steady pace, left first."""
        if self._sweep_rad == 0.0:
            return 0.0
        quarters = t_ns * 1e-9 * HEAD_SPEED_RADPS / self._sweep_rad
        return self._sweep_rad * math.asin(math.sin(quarters * math.pi / 2.0)) / (math.pi / 2.0)

    def _random(self, stream: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, _STREAMS.index(stream)])

    def _poses(self) -> Iterator[Event]:
        rng = self._random("pose")
        spread = self._noise * np.array([_POSE_ERROR_M, _POSE_ERROR_M, _POSE_ERROR_RAD])
        for t_ns in itertools.count(0, _POSE_PERIOD_NS):
            true = self.world_from_base(t_ns)
            error = spread * rng.standard_normal(3)
            seen = SE2(
                true.x_m + float(error[0]),
                true.y_m + float(error[1]),
                wrap_angle(true.heading_rad + float(error[2])),
            )
            yield Event(t_ns, t_ns + _TRACKER_LATENCY_NS, Pose(t_ns, seen))

    def _wheels(self) -> Iterator[Event]:
        """Counters of 16 bits. No wheel has quite the size that it should, and all slip."""
        rng = self._random("wheels")
        size = 1.0 + _WHEEL_SIZE_ERROR * self._noise * rng.standard_normal(2)
        rolled_m = counted_m = np.zeros(2)
        for t_ns in itertools.count(0, _WHEEL_PERIOD_NS):
            state = self.drive.at(t_ns * 1e-9)
            now_m = np.array([state.left_m, state.right_m])
            slip = 1.0 + _WHEEL_SLIP * self._noise * rng.standard_normal(2)
            counted_m = counted_m + (now_m - rolled_m) * size * slip
            rolled_m = now_m
            ticks = np.floor(counted_m * WHEELS.ticks_per_m).astype(np.int64) % COUNTER_RANGE
            report = WheelReport(int(ticks[0]), int(ticks[1]))
            yield Event(t_ns, t_ns + _SERIAL_LATENCY_NS, report)

    def _ranges(self, ranger: Ranger) -> Iterator[Event]:
        """Readings of one ranger, each after the angle of the head that it was taken at."""
        rng = self._random(ranger.name)
        for t_ns in itertools.count(_RANGE_OFFSET_NS[ranger.name], _RANGE_PERIOD_NS):
            log_ns = t_ns + _SERIAL_LATENCY_NS
            head_rad = self.head_rad(t_ns)
            if self._sweep_rad > 0.0:
                yield Event(t_ns, log_ns, HeadReport(HEAD_FRAME, head_rad))
            base_from_sensor = SE2(0.0, 0.0, head_rad) @ ranger.mount
            sensor = self.world_from_base(t_ns) @ base_from_sensor
            range_m = range_reading(self.room.walls_m, sensor, ranger, self._noise, rng)
            yield Event(t_ns, log_ns, RangeReport(ranger.name, range_m))

    def _scans(self) -> Iterator[Event]:
        rng = self._random(LIDAR)
        bearings_rad = self._bearings_rad
        for t_ns in itertools.count(0, _SCAN_PERIOD_NS):
            ranges_m = scan_reading(
                self.room.walls_m, self.world_from_base(t_ns), bearings_rad,
                LIDAR_MIN_M, LIDAR_MAX_M, self._noise, rng,
            )  # fmt: skip
            ranges_m.setflags(write=False)
            scan = Scan(
                t_ns, LIDAR, ranges_m, float(bearings_rad[0]),
                float(bearings_rad[1] - bearings_rad[0]), LIDAR_MIN_M, LIDAR_MAX_M,
            )  # fmt: skip
            yield Event(t_ns, t_ns + _SERIAL_LATENCY_NS, scan)


def simulate(
    room: Room,
    *,
    duration_s: float,
    seed: int,
    noise: float = 1.0,
    sensors: Sequence[str] = DEFAULT_SENSORS,
    route: NDArray[np.float64] | None = None,
    head_sweep_deg: float = 0.0,
    lidar_beams: int = 360,
    start_ns: int = DEFAULT_START_NS,
) -> Iterator[tuple[int, Message]]:
    """A whole run as ``(log_ns, message)`` pairs, in the order of ``log_ns``.

    First come the mounts of the sensors, as static transforms; then poses (10 Hz), odometry and
    ranges (20 Hz each) and scans (5 Hz), and the head's transform with each reading when it turns.
    Raises BadInput, before the first pair, for what :class:`Robot` refuses and for a duration that
    is not above zero and finite.
    """
    if not 0.0 < duration_s < math.inf:
        raise BadInput(f"the duration must be above 0 and finite, not {duration_s:g} s")
    robot = Robot(
        room,
        seed=seed,
        noise=noise,
        sensors=sensors,
        route=route,
        head_sweep_deg=head_sweep_deg,
        lidar_beams=lidar_beams,
    )
    return _messages(robot, duration_s, start_ns)


def _messages(robot: Robot, duration_s: float, start_ns: int) -> Iterator[tuple[int, Message]]:
    for name, (carrier, mount) in robot.mounts().items():
        yield start_ns, Transform(start_ns, carrier, name, mount)
    dead_reckoning = DeadReckoning(WHEELS)
    for event in robot.events(duration_s):
        yield start_ns + event.log_ns, _message(event, start_ns, dead_reckoning)


def _message(event: Event, start_ns: int, dead_reckoning: DeadReckoning) -> Message:
    """What stands in a session for something that a device said."""
    t_ns = start_ns + event.t_ns
    match event.said:
        case Pose() | Scan():
            return replace(event.said, t_ns=t_ns)
        case HeadReport():
            turn = SE2(0.0, 0.0, event.said.angle_rad)
            return Transform(t_ns, BASE_FRAME, HEAD_FRAME, turn, static=False)
        case WheelReport():
            return Odometry(t_ns, dead_reckoning.update(event.said.left, event.said.right))
        case RangeReport():
            ranger = RANGERS[event.said.sensor]
            return ranger.parameters.reading(t_ns, ranger.name, event.said.range_m)


def _known_sensors(names: Sequence[str]) -> tuple[str, ...]:
    known = (*RANGERS, LIDAR)
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known)
            raise BadInput(f"the simulated robot has no sensor {name!r}; {hint}")
    if not names:
        raise BadInput(f"the simulated robot needs a sensor: {', '.join(known)}")
    return tuple(dict.fromkeys(names))


def _bearings(beams: int) -> NDArray[np.float64]:
    """Directions of the laser's beams, a degree apart: all around, or the half ahead."""
    if beams not in (360, 180):
        raise BadInput(f"the simulated lidar has 360 or 180 beams, not {beams}")
    first_deg = -180.0 if beams == 360 else -89.5
    bearings_rad: NDArray[np.float64] = np.radians(first_deg + np.arange(beams))
    return bearings_rad
