"""A robot that is not there: it drives a route through a room and reports what its sensors measure.

Everything is simulated in its own time and follows from the seed: the same call gives the same
messages, however long it took. Each sensor, the tracker and the wheels draw from random numbers of
their own, so leaving one out does not change the others.
"""

from __future__ import annotations

import heapq
import itertools
import math
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    Radiation,
    Scan,
    Transform,
)
from recorder.names import FRAME_NAME, did_you_mean
from recorder.odometry import COUNTER_RANGE, DeadReckoning, WheelGeometry
from recorder.protocols.reports import HeadReport, RangeReport, WheelReport
from recorder.sensors import CATALOGUE, DEFAULT_SENSORS, ScanPattern, SensorKind, guess_kind
from recorder.simulator.drive import Drive
from recorder.simulator.echoes import range_reading, scan_reading
from recorder.simulator.faults import (
    SOUND,
    SOUND_SENSOR,
    RunFaults,
    check_faults,
    holds_at,
    spoiled,
)
from recorder.simulator.rooms import Room, check_route
from recorder.simulator.surfaces import wall_surfaces

DEFAULT_START_NS = 1_767_225_600_000_000_000  # 2026-01-01T00:00:00Z
WHEELS = WheelGeometry(ticks_per_m=2000.0, track_m=0.106)
HEAD_SPEED_RADPS = math.radians(60.0)
MAX_HEAD_SWEEP_DEG = 180.0
MAX_NOISE = 10.0

_POSE_PERIOD_NS = 100_000_000
_WHEEL_PERIOD_NS = 50_000_000
_SERIAL_LATENCY_NS = 4_000_000
_TRACKER_LATENCY_NS = 30_000_000
_POSE_ERROR_M = 0.003
_POSE_ERROR_RAD = math.radians(1.0)
_WHEEL_SIZE_ERROR = 0.005
# Each has random numbers of its own; those of any other sensor follow from its name.
_STREAMS = ("pose", "wheels", "ping", "dirrs", "lidar")


@dataclass(frozen=True, slots=True)
class Event:
    """A report of a device of the simulated robot.

    ``t_ns`` is when it was measured, ``log_ns`` when it reaches the host.
    """

    t_ns: int
    log_ns: int
    report: Pose | RangeReport | HeadReport | WheelReport | Scan


class Robot:
    """The robot in its room, with time counted in nanoseconds from the start of its drive.

    ``sensors`` are names that hold their kind, as ``ping``, ``tfmini`` or ``hcsr04_left``.
    Raises BadInput for an unknown sensor, a route that cannot be driven, and numbers out of range.
    ``head_sweep_deg`` above 0 puts the rangers on a head that turns to and fro by so much to
    either side. ``faults`` are what is wrong with it, besides its noise. ``mounts`` are where
    sensors sit that sit elsewhere than is usual for their kind.
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
        faults: RunFaults = SOUND,
        mounts: Mapping[str, SE2] | None = None,
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
        self.kinds = _placed(_known_sensors(sensors), mounts or {})
        self.drive = Drive(room.route_m if route is None else route, WHEELS.track_m)
        self._noise = noise
        self._seed = seed
        self._sweep_rad = math.radians(head_sweep_deg)
        self._faults = faults
        self._surfaces = wall_surfaces(room.surfaces)
        check_faults(faults, self.kinds)

    def events(self, duration_s: float = math.inf) -> Iterator[Event]:
        """All reports of the first ``duration_s`` seconds, in the order of ``log_ns``."""
        sources = [self._poses(), self._wheels()]
        # Rangers first: of events at one time the order in which the sources stand decides.
        of_each = self.kinds.items()
        sources += [self._ranges(name, kind) for name, kind in of_each if kind.scan is None]
        sources += [self._scans(name, k, k.scan) for name, k in of_each if k.scan is not None]
        end_ns = duration_s * 1e9
        within = [itertools.takewhile(lambda event: event.t_ns <= end_ns, s) for s in sources]
        return heapq.merge(*within, key=attrgetter("log_ns"))

    def mounts(self) -> dict[str, tuple[str, SE2]]:
        """The frame that each sensor is fixed to, and where it is said to sit there."""
        carrier = HEAD_FRAME if self._sweep_rad > 0.0 else BASE_FRAME
        return {
            name: (carrier if kind.scan is None else BASE_FRAME, kind.mount)
            for name, kind in self.kinds.items()
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
        known = stream in _STREAMS
        number = _STREAMS.index(stream) if known else zlib.crc32(stream.encode())
        return np.random.default_rng([self._seed, number])

    def _before(self, t_ns: int, delay_s: float) -> int:
        """The time so long before, or the start."""
        return max(0, t_ns - round(delay_s * 1e9))

    def _poses(self) -> Iterator[Event]:
        rng, faults = self._random("pose"), self._faults
        spread = self._noise * np.array([_POSE_ERROR_M, _POSE_ERROR_M, _POSE_ERROR_RAD])
        error_of_faults = self._pose_error()
        for t_ns in itertools.count(0, _POSE_PERIOD_NS):
            true = self.world_from_base(self._before(t_ns, faults.pose_delay_s))
            error = spread * rng.standard_normal(3) + error_of_faults(t_ns)
            seen = SE2(
                true.x_m + float(error[0]),
                true.y_m + float(error[1]),
                wrap_angle(true.heading_rad + float(error[2])),
            )
            yield Event(t_ns, t_ns + _TRACKER_LATENCY_NS, Pose(t_ns, seen))

    def _pose_error(self) -> Callable[[int], NDArray[np.float64]]:
        """What the faults of the run add to a pose's x, y (m) and heading (rad) at a time."""
        faults, rng = self._faults, self._random("faults of poses")
        away_rad = rng.uniform(-math.pi, math.pi)
        away = np.array([math.cos(away_rad), math.sin(away_rad), 0.0])
        per_min = faults.pose_drift_mpmin * away
        per_min[2] = math.radians(faults.pose_drift_degpmin)
        spread = np.array([faults.pose_noise_m] * 2 + [math.radians(faults.pose_noise_deg)])
        bias = np.array([0.0, 0.0, math.radians(faults.heading_bias_deg)])

        def error(t_ns: int) -> NDArray[np.float64]:
            off = per_min * (t_ns / 60e9) + spread * rng.standard_normal(3) + bias
            return np.asarray(off)

        return error

    def _wheels(self) -> Iterator[Event]:
        """Counters of 16 bits. No wheel has quite the size that it should, and all slip."""
        rng = self._random("wheels")
        size = 1.0 + _WHEEL_SIZE_ERROR * self._noise * rng.standard_normal(2)
        rolled_m = counted_m = np.zeros(2)
        for t_ns in itertools.count(0, _WHEEL_PERIOD_NS):
            state = self.drive.at(t_ns * 1e-9)
            now_m = np.array([state.left_m, state.right_m])
            slip = 1.0 + self._faults.wheel_slip * self._noise * rng.standard_normal(2)
            counted_m = counted_m + (now_m - rolled_m) * size * slip
            rolled_m = now_m
            ticks = np.floor(counted_m * WHEELS.ticks_per_m).astype(np.int64) % COUNTER_RANGE
            report = WheelReport(int(ticks[0]), int(ticks[1]))
            yield Event(t_ns, t_ns + _SERIAL_LATENCY_NS, report)

    def _ranges(self, name: str, kind: SensorKind) -> Iterator[Event]:
        """Readings of one ranger, each after the angle of the head that it was taken at.

        Sound and light take turns.
        """
        faults = self._faults.of(name)
        reported_as = faults.reports_as or name
        measure, last_m = self._ranger(name, kind), math.inf
        period_ns = round(1e9 / kind.rate_hz)
        first_ns = 0 if kind.radiation is Radiation.ULTRASOUND else period_ns // 2
        for t_ns in itertools.count(first_ns, period_ns):
            log_ns = t_ns + _SERIAL_LATENCY_NS
            if self._sweep_rad > 0.0:
                yield Event(t_ns, log_ns, HeadReport(HEAD_FRAME, self.head_rad(t_ns)))
            range_m = measure(self._before(t_ns, faults.delay_s))
            if holds_at(faults.stuck_s, t_ns * 1e-9):
                range_m = last_m
            last_m = range_m
            if not holds_at(faults.dead_s, t_ns * 1e-9):
                yield Event(t_ns, log_ns, RangeReport(reported_as, range_m))

    def _ranger(self, name: str, kind: SensorKind) -> Callable[[int], float]:
        """What a ranger measures at one time after the other, its faults included."""
        rng, faults = self._random(name), self._faults.of(name)
        of_faults, of_talk = self._random(f"faults of {name}"), self._random(f"talk to {name}")
        if faults.beam_width_deg is not None:
            kind = replace(kind, beam_width_deg=faults.beam_width_deg)
        others = self._heard_by(name, kind)

        def measure(t_ns: int) -> float:
            sensor = self._world_from_sensor(name, kind, t_ns)
            range_m = self._reading(sensor, kind, rng)
            for other, of_other in others:
                if of_talk.random() < self._faults.cross_talk:
                    there = self._world_from_sensor(other, of_other, t_ns)
                    way_m = self._reading(there, of_other, of_talk)
                    apart_m = math.hypot(there.x_m - sensor.x_m, there.y_m - sensor.y_m)
                    range_m = min(range_m, way_m + apart_m / 2.0) if way_m > 0.0 else range_m
            return range_m if faults is SOUND_SENSOR else spoiled(range_m, faults, kind, of_faults)

        return measure

    def _reading(self, sensor: SE2, kind: SensorKind, rng: np.random.Generator) -> float:
        return range_reading(self.room.walls_m, sensor, kind, self._noise, rng, self._surfaces)

    def _heard_by(self, name: str, kind: SensorKind) -> list[tuple[str, SensorKind]]:
        """The sonars whose echoes a sonar receives: they ping at once, and sound bends round."""
        if kind.radiation is not Radiation.ULTRASOUND or self._faults.cross_talk == 0.0:
            return []
        of_each = self.kinds.items()
        return [(n, k) for n, k in of_each if n != name and k.radiation is Radiation.ULTRASOUND]

    def _world_from_sensor(self, name: str, kind: SensorKind, t_ns: int) -> SE2:
        """Where a sensor truly is."""
        error = self._faults.of(name).mount
        if kind.scan is None:
            sensor = self.world_from_base(t_ns) @ (SE2(0.0, 0.0, self.head_rad(t_ns)) @ kind.mount)
        else:
            sensor = self.world_from_base(t_ns)
            if kind.mount != IDENTITY:  # the product with it rounds the heading
                sensor = sensor @ kind.mount
        return sensor if error == IDENTITY else sensor @ error

    def _scans(self, name: str, kind: SensorKind, pattern: ScanPattern) -> Iterator[Event]:
        rng, faults = self._random(name), self._faults.of(name)
        of_faults = self._random(f"faults of {name}")
        bearings_rad = pattern.bearings_rad
        for t_ns in itertools.count(0, round(1e9 / kind.rate_hz)):
            at_ns = self._before(t_ns, faults.delay_s)
            sensor = self._world_from_sensor(name, kind, at_ns)
            ranges_m = scan_reading(
                self.room.walls_m, sensor, kind, pattern, self._noise, rng, self._surfaces
            )
            if faults is not SOUND_SENSOR:
                ranges_m = np.array([spoiled(r, faults, kind, of_faults) for r in ranges_m])
            if holds_at(faults.dead_s, t_ns * 1e-9):
                continue
            ranges_m.setflags(write=False)
            scan = Scan(
                t_ns, name, ranges_m, float(bearings_rad[0]),
                float(bearings_rad[1] - bearings_rad[0]), kind.min_range_m, pattern.reach_m,
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
    faults: RunFaults = SOUND,
    mounts: Mapping[str, SE2] | None = None,
    start_ns: int = DEFAULT_START_NS,
) -> Iterator[tuple[int, Message]]:
    """A whole run as ``(log_ns, message)`` pairs, in the order of ``log_ns``.

    First come the mounts of the sensors, as static transforms; then poses (10 Hz), odometry
    (20 Hz), ranges and scans as often as their kind measures, and the head's transform with each
    range when it turns.
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
        faults=faults,
        mounts=mounts,
    )
    return _messages(robot, duration_s, start_ns)


def _messages(robot: Robot, duration_s: float, start_ns: int) -> Iterator[tuple[int, Message]]:
    for name, (carrier, mount) in robot.mounts().items():
        yield start_ns, Transform(start_ns, carrier, name, mount)
    dead_reckoning = DeadReckoning(WHEELS)
    for event in robot.events(duration_s):
        yield start_ns + event.log_ns, _message(event, start_ns, dead_reckoning, robot.kinds)


def _message(
    event: Event, start_ns: int, dead_reckoning: DeadReckoning, kinds: Mapping[str, SensorKind]
) -> Message:
    """What stands in a session for a report of a device."""
    t_ns = start_ns + event.t_ns
    match event.report:
        case Pose() | Scan() as measured:
            return replace(measured, t_ns=t_ns)
        case HeadReport(_, angle_rad):
            turn = SE2(0.0, 0.0, angle_rad)
            return Transform(t_ns, BASE_FRAME, HEAD_FRAME, turn, static=False)
        case WheelReport(left, right):
            return Odometry(t_ns, dead_reckoning.update(left, right))
        case RangeReport(sensor, range_m):
            return kinds[sensor].parameters.reading(t_ns, sensor, range_m)


def _known_sensors(names: Sequence[str]) -> dict[str, SensorKind]:
    """The kind of each sensor, by its name."""
    kinds: dict[str, SensorKind] = {}
    for name in names:
        kind = guess_kind(name)
        if kind is None or not FRAME_NAME.fullmatch(name):
            hint = did_you_mean(name, CATALOGUE)
            raise BadInput(f"the simulated robot has no sensor {name!r}; {hint}")
        kinds[name] = kind
    if not names:
        raise BadInput(f"the simulated robot needs a sensor: {', '.join(CATALOGUE)}")
    return kinds


def _placed(kinds: dict[str, SensorKind], mounts: Mapping[str, SE2]) -> dict[str, SensorKind]:
    """The kinds with other mounts. Raises BadInput for a sensor that there is not."""
    for name in mounts:
        if name not in kinds:
            raise BadInput(f"no sensor {name!r} to mount; {did_you_mean(name, kinds)}")
    return {
        name: replace(kind, mount=mounts[name]) if name in mounts else kind
        for name, kind in kinds.items()
    }
