"""CARMEN logs of laser scanners → messages: FLASER, RLASER, ROBOTLASER1; plain or gzipped.

``FLASER n r1 .. rn x y theta ox oy otheta ipc_time host logger_time``: metres and radians; the
first pose is the laser's, the second the robot's. Where the two keep one distance in all scans,
that is the mount and the second is the robot's pose; else the first was corrected by a scan matcher
and the second is dead reckoning. Beams run from the right to the left, over half a turn where the
log does not say otherwise. Every scan carries its poses, so ODOM lines are left out.
Format: http://carmen.sourceforge.net/doc/binary__loggerplayback.html

The clocks of such logs are coarse, stand still or step back: the order of rows is the order of
time.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorder.errors import BadInput
from recorder.geometry import SE2, wrap_angle
from recorder.importers.imported import Imported
from recorder.messages import BASE_FRAME, Message, Odometry, Pose, Scan, Transform

FORMAT = "carmen"
NAMES = {
    "FLASER": "lidar",
    "RLASER": "lidar_rear",
    "ROBOTLASER1": "lidar",
    "ROBOTLASER2": "lidar_rear",
}
FARTHEST_M = 1e6
NO_RETURN_M = 50.0  # no laser of that time reached farther; 80 or 81.9 stood for nothing seen
LONGEST_LINE = 1 << 20
MOST_BYTES = 1 << 30  # of a log, unpacked
ASSUMED_RATE_HZ = 5.0
LATEST_S = 2.0**31  # of a stamp
SAME_MOUNT_M, SAME_MOUNT_RAD = 0.01, 0.01
_HEADS = (b"# CARMEN", b"# message formats", b"PARAM ", b"ODOM ", b"SYNC ", b"NEFF ")
_LINES = ("FLASER ", "RLASER ", "ROBOTLASER1 ", "ROBOTLASER2 ", "ODOM ")

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Sweep:
    """One line of a laser: ``ranges_m`` (N,), both poses, the logger's time in seconds."""

    sensor: str
    ranges_m: Floats
    start_rad: float
    step_rad: float
    world_from_laser: SE2
    world_from_robot: SE2
    time_s: float


def looks_like_carmen(head: bytes) -> bool:
    """Whether a file that begins with these bytes is such a log, plain or gzipped."""
    if head.startswith(b"\x1f\x8b"):
        try:
            head = zlib.decompressobj(31).decompress(head, 4096)
        except zlib.error:
            return False
    lines = head.lstrip(b"\xef\xbb\xbf \t\r\n").splitlines()
    marks = (*_HEADS, *(line.encode() for line in _LINES))
    return any(line.startswith(marks) for line in lines[:50])


def import_carmen(path: Path, *, start_s: float = 0.0) -> Imported:
    """Read a log; its first scan gets ``start_s`` plus the logger's time (UNIX seconds).

    Raises BadInput: cannot be read, no such log, not one scan in it.
    """
    dropped: Counter[str] = Counter()
    sweeps: list[_Sweep] = []
    offsets_m: dict[str, float] = {}
    for line in _lines(path, dropped):
        name, _, rest = line.partition(" ")
        if name == "PARAM":
            _take_parameter(rest, offsets_m)
        elif name == "ODOM":
            dropped["ODOM line (scans carry their poses)"] += 1
        elif name in NAMES:
            try:
                sweeps.append(_sweep(name, rest.split()))
            except (ValueError, IndexError):
                dropped["malformed line"] += 1
    if not sweeps:
        raise BadInput(f"{path}: no scan in it (no line FLASER, RLASER or ROBOTLASER1)")
    times_ns, clock = _times_ns([sweep.time_s for sweep in sweeps], start_s)
    sensors = dict.fromkeys(sweep.sensor for sweep in sweeps)
    mounts = {name: _mount(name, sweeps, offsets_m) for name in sensors}
    corrected = any(mount is None for mount in mounts.values())
    no_return_m = _no_return_m(sweeps)
    records: list[tuple[int, Message]] = [
        (times_ns[0], Transform(times_ns[0], BASE_FRAME, name, mount or _assumed(name, offsets_m)))
        for name, mount in mounts.items()
    ]
    for t_ns, sweep in zip(times_ns, sweeps, strict=True):
        pose = sweep.world_from_robot
        if corrected:
            records.append((t_ns, Odometry(t_ns, pose)))
            pose = sweep.world_from_laser @ _assumed(sweep.sensor, offsets_m).inverse()
        records += [(t_ns, Pose(t_ns, pose)), (t_ns, _scan(sweep, t_ns, no_return_m))]
    metadata = {
        "format": FORMAT, "start_s": f"{start_s!r}", "clock": clock,
        "no_return_m": f"{no_return_m:g}",
        "poses": "of the laser, corrected" if corrected else "of the robot",
    }  # fmt: skip
    return Imported(records, metadata, dict(dropped))


def _lines(path: Path, dropped: Counter[str]) -> Iterator[str]:
    try:
        with path.open("rb") as plain:
            packed = plain.read(2) == b"\x1f\x8b"
        with gzip.open(path) if packed else path.open("rb") as file:
            size = 0
            while raw := file.readline(LONGEST_LINE):
                size += len(raw)
                if size > MOST_BYTES:
                    raise BadInput(f"{path}: over {MOST_BYTES >> 20} MB of text: split it first")
                yield raw.decode("latin-1").strip("\ufeff \t\r\n")
    except (EOFError, gzip.BadGzipFile, zlib.error):
        dropped["end of a damaged gzip file"] += 1
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror or error})") from error


def _take_parameter(text: str, offsets_m: dict[str, float]) -> None:
    """``robot_frontlaser_offset 0.28 host time``: how far ahead of the centre a laser sits."""
    name, _, rest = text.partition(" ")
    for key, sensor in (("frontlaser_offset", "lidar"), ("rearlaser_offset", "lidar_rear")):
        if name.endswith(key):
            try:
                offset_m = float(rest.split()[0])
            except (ValueError, IndexError):
                continue
            if math.isfinite(offset_m) and abs(offset_m) < FARTHEST_M:
                offsets_m[sensor] = offset_m


def _sweep(name: str, words: Sequence[str]) -> _Sweep:
    """A line's words after its name; ValueError or IndexError where they are not as they should."""
    start_rad = math.nan
    if name.startswith("ROBOTLASER"):
        start_rad, step_rad = float(words[1]), float(words[3])
        count = int(words[7])
        ranges, rest = words[8 : 8 + count], words[8 + count :]
        rest = rest[1 + int(rest[0]) :]  # remissions
    else:
        count = int(words[0])
        ranges, rest = words[1 : 1 + count], words[1 + count :]
        step_rad = math.pi / (count - count % 2) if count > 1 else math.nan
    if count < 2 or len(ranges) < count or not 0.0 < abs(step_rad) * count < 2.1 * math.pi:
        raise ValueError("not so many ranges")
    if math.isnan(start_rad):
        start_rad = -math.pi / 2.0
    return _Sweep(
        NAMES[name], np.array(ranges, np.float64), start_rad, step_rad, _pose(rest[0:3]),
        _pose(rest[3:6]), _time_s(rest),
    )  # fmt: skip


def _pose(words: Sequence[str]) -> SE2:
    x_m, y_m, heading_rad = map(float, words)
    if not all(math.isfinite(v) and abs(v) <= FARTHEST_M for v in (x_m, y_m, heading_rad)):
        raise ValueError("a pose out of bounds")
    return SE2(x_m, y_m, wrap_angle(heading_rad))


def _time_s(words: Sequence[str]) -> float:
    """The logger's own time, the last word; NaN where there is none."""
    try:
        return float(words[-1])
    except ValueError:
        return math.nan


def _times_ns(times_s: Sequence[float], start_s: float) -> tuple[list[int], str]:
    """Times that rise from scan to scan, and a note on what was made of the log's clock.

    A clock that goes on in most rows is followed; where it stands still or steps back, a scan comes
    1 ms after the one before it. Any other clock is left out for an assumed rate.
    """
    times = np.array([t if 0.0 <= t < LATEST_S else math.nan for t in times_s])
    steps = np.diff(times)
    steps[~np.isfinite(steps)] = 0.0
    forward = steps > 1e-6
    first_ns = round(start_s * 1e9)
    if 2 * int(forward.sum()) < len(steps) or not len(steps):
        period_ns = round(1e9 / ASSUMED_RATE_HZ)
        rate = f"{ASSUMED_RATE_HZ:g} scans a second, an assumption: the log has no clock"
        return [first_ns + i * period_ns for i in range(len(times))], rate
    steps[~forward] = 1e-3
    begin_s = float(times[0]) if math.isfinite(times[0]) else 0.0
    own_ns = np.round((begin_s + np.concatenate([[0.0], np.cumsum(steps)])) * 1e9).astype(np.int64)
    still = int((~forward).sum())
    kept = f"; it stood still or stepped back {still} times: order of rows kept" if still else ""
    return [first_ns + int(t) for t in own_ns], f"the logger's{kept}"


def _mount(name: str, sweeps: Sequence[_Sweep], offsets_m: dict[str, float]) -> SE2 | None:
    """Where a laser sits, if both poses of all its scans agree on one place; else None."""
    places = [s.world_from_robot.inverse() @ s.world_from_laser for s in sweeps if s.sensor == name]
    first = places[len(places) // 2]
    if all(
        math.hypot(p.x_m - first.x_m, p.y_m - first.y_m) < SAME_MOUNT_M
        and abs(wrap_angle(p.heading_rad - first.heading_rad)) < SAME_MOUNT_RAD
        for p in places
    ):
        same = math.hypot(first.x_m, first.y_m) < 1e-9 and abs(first.heading_rad) < 1e-9
        return _assumed(name, {}) if same and name == "lidar" else first
    return None


def _assumed(name: str, offsets_m: dict[str, float]) -> SE2:
    rear = name == "lidar_rear"
    return SE2(offsets_m.get(name, 0.0), 0.0, -math.pi if rear else 0.0)


def _no_return_m(sweeps: Sequence[_Sweep]) -> float:
    """From which range on a beam saw nothing: 50 m, or less where the log caps its ranges.

    A cap is the largest number of 12 to 16 bits, in mm or cm (the nine largest are a SICK's codes
    for errors), or one largest value that comes again and again with nothing close below it.
    """
    ranges_m = np.concatenate([sweep.ranges_m for sweep in sweeps])
    ranges_m = ranges_m[np.isfinite(ranges_m) & (ranges_m < NO_RETURN_M)]
    if not ranges_m.size:
        return NO_RETURN_M
    largest_m = float(ranges_m.max())
    capped = int((ranges_m == largest_m).sum())
    close = int(((ranges_m > 0.98 * largest_m) & (ranges_m < largest_m)).sum())
    for bits, per_m in product(range(12, 17), (1000.0, 100.0)):
        full = (1 << bits) - 1
        if abs(largest_m * per_m - full) < 1e-6:
            return (full - 8) / per_m
    return largest_m if capped >= 10 and capped > 10 * close else NO_RETURN_M


def _scan(sweep: _Sweep, t_ns: int, no_return_m: float) -> Scan:
    """Ranges from ``no_return_m`` on become +Inf, zero and negative ones stay to be dropped."""
    ranges_m = np.where(sweep.ranges_m >= no_return_m, math.inf, sweep.ranges_m)
    return Scan(t_ns, sweep.sensor, ranges_m, sweep.start_rad, sweep.step_rad, 0.0, no_return_m)
