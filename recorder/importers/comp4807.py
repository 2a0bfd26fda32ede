"""Traces of the comp4807 tracker program → messages.

The first line names the sensors, every other line is a pose of the overhead camera (pixels and
degrees) followed by groups of one reading per sensor in whole centimetres. There is no clock in the
file: groups are taken to come at an assumed rate, counted from the first one of the file, and the
pose of a line holds for all the readings of that line. What cannot be used is dropped and counted.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from recorder.errors import BadInput
from recorder.geometry import SE2, wrap_angle
from recorder.importers.imported import Imported
from recorder.messages import BASE_FRAME, Message, Pose, Range, Transform
from recorder.sensors import UNKNOWN_KIND, SensorKind, guess_kind

FORMAT = "comp4807"
PIXELS_PER_METRE = 300.0
INVALID_M = UNKNOWN_KIND.invalid_m  # the robot's own, whatever the sensor
FARTHEST_M = 1e6
NO_TAG = (-1.0, -1.0, -1.0)
KNOWN_NAMES = {"dirrs+": "dirrs", "sonar": "ping"}
LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 0.01, 1e6
LATEST_START_S = 4e9  # keeps nanoseconds well inside 63 bits

_HEADER = re.compile(r"\s*x\s*,\s*y\s*,\s*angle\s*,", re.IGNORECASE)
_LINE_END = re.compile(r"\r\n|\n|\r")


@dataclass(frozen=True, slots=True)
class TraceSensor:
    """One sensor as the header describes it, under the name that it gets in the session."""

    name: str
    kind: SensorKind
    mount: SE2
    error_fraction: float
    beam_width_rad: float

    def reading(self, t_ns: int, range_m: float) -> Range:
        """A reading of this sensor, with the limits of its kind."""
        limits = self.kind.parameters
        return replace(limits, beam_width_rad=self.beam_width_rad).reading(t_ns, self.name, range_m)


@dataclass(slots=True)
class _Trace:
    """The messages so far, and the count of groups, which is the clock."""

    sensors: Sequence[TraceSensor]
    rate_hz: float
    start_ns: int
    records: list[tuple[int, Message]] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    groups: int = 0
    readings_with_pose: int = 0

    def add_row(self, tokens: Sequence[str]) -> None:
        if len(tokens) < 3:
            self.dropped["incomplete row"] += 1
            return
        pose = self._pose(tokens[:3])
        if len(tokens) == 3 and pose is not None:
            self.dropped["pose without readings"] += 1
        self.add_readings(tokens[3:], pose)

    def add_readings(self, tokens: Sequence[str], pose: SE2 | None) -> None:
        size = len(self.sensors)
        whole = len(tokens) - len(tokens) % size
        if whole < len(tokens):
            self.dropped["incomplete group"] += 1
        for first in range(0, whole, size):
            t_ns = self.start_ns + round(self.groups * 1e9 / self.rate_hz)
            self.groups += 1
            if pose is not None:
                self.records.append((t_ns, Pose(t_ns, pose)))
            for sensor, token in zip(self.sensors, tokens[first : first + size], strict=True):
                range_m = self._range_m(sensor, token)
                if range_m is not None:
                    self.records.append((t_ns, sensor.reading(t_ns, range_m)))
                    self.readings_with_pose += pose is not None

    def _pose(self, tokens: Sequence[str]) -> SE2 | None:
        values = [_number(token) for token in tokens]
        known = tuple(value for value in values if value is not None)
        if known == NO_TAG:
            return None
        if len(known) < 3:
            self.dropped["pose not a number"] += 1
            return None
        if not all(math.isfinite(value) for value in known):
            self.dropped["pose not finite"] += 1
            return None
        x_m, y_m = known[0] / PIXELS_PER_METRE, known[1] / PIXELS_PER_METRE
        # An angle that large has lost its fraction of a turn: no heading can be read from it.
        if max(abs(x_m), abs(y_m), abs(known[2])) > FARTHEST_M:
            self.dropped["pose out of bounds"] += 1
            return None
        return SE2(x_m, y_m, wrap_angle(math.radians(known[2])))

    def _range_m(self, sensor: TraceSensor, token: str) -> float | None:
        range_cm = _number(token)
        reason = ""
        if range_cm is None:
            reason = "reading not a number"
        elif not math.isfinite(range_cm):
            reason = "reading not finite"
        elif abs(range_cm) > FARTHEST_M * 100.0:
            reason = "reading out of bounds"
        elif range_cm / 100.0 in INVALID_M:
            reason = f"invalid {range_cm:g}"
        else:
            reason = sensor.kind.misread(range_cm / 100.0)
        if range_cm is None or reason:
            self.dropped[reason] += 1
            return None
        return range_cm / 100.0 if range_cm > 0.0 else math.inf


def looks_like_comp4807(head: bytes) -> bool:
    """Whether a file that begins with these bytes has the first line of a trace."""
    first_line = _LINE_END.split(_text(head), maxsplit=1)[0]
    return _HEADER.match(first_line) is not None and "|" in first_line


def import_comp4807(
    path: Path,
    *,
    rate_hz: float = 20.0,
    start_s: float = 0.0,
    columns: tuple[str, ...] | None = None,
) -> Imported:
    """Read a trace; group k of the file gets the time ``start_s + k / rate_hz`` (UNIX seconds).

    ``columns`` names the sensors in the order in which their readings stand in the rows, where this
    is not the order of the header. BadInput: no trace, a bad option, no reading with a pose.
    """
    _check_clock(rate_hz, start_s)
    try:
        lines = _LINE_END.split(_text(path.read_bytes()))
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror})") from error
    if not looks_like_comp4807(lines[0].encode("latin-1")):
        raise BadInput(f"{path}: not a comp4807 trace (no first line 'x,y,angle,NAME|...')")
    sensors, glued = _read_header(path, lines[0])
    ordered = _in_order(path, sensors, columns)
    start_ns = round(start_s * 1e9)
    trace = _Trace(ordered, rate_hz, start_ns)
    for sensor in sensors:
        mount = Transform(start_ns, BASE_FRAME, sensor.name, sensor.mount)
        trace.records.append((start_ns, mount))
    trace.add_readings(glued, None)
    for line in lines[1:]:
        if line.strip():
            trace.add_row(_tokens(line))
    if not trace.readings_with_pose:
        many = f"{trace.groups} group{'s' * (trace.groups != 1)} of readings without one"
        why = many if trace.groups else "no reading at all"
        raise BadInput(f"{path}: not one reading with a pose ({why})")
    metadata = _metadata(ordered, rate_hz, start_s)
    return Imported(trace.records, metadata, dict(trace.dropped))


def _check_clock(rate_hz: float, start_s: float) -> None:
    if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ:
        raise BadInput(
            f"rate {rate_hz:g}: must be {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g} readings a second"
        )
    if not 0.0 <= start_s <= LATEST_START_S:
        raise BadInput(f"start {start_s:g}: must be 0 to {LATEST_START_S:g} seconds (UNIX time)")


def _read_header(path: Path, line: str) -> tuple[list[TraceSensor], list[str]]:
    """The sensors, and the readings glued to the line before the first pose was known."""
    tokens = _tokens(line)[3:]
    count = next((i for i, token in enumerate(tokens) if "|" not in token), len(tokens))
    sensors: list[TraceSensor] = []
    for token in tokens[:count]:
        sensors.append(_read_sensor(path, token, {sensor.name for sensor in sensors}))
    if not sensors:
        raise BadInput(f"{path}: the first line names no sensor before the first reading")
    return sensors, tokens[count:]


def _read_sensor(path: Path, token: str, taken: set[str]) -> TraceSensor:
    label, *fields = token.split("|")
    values = [value for value in map(_number, fields) if value is not None]
    if len(fields) != 5 or len(values) != 5 or not all(abs(value) <= 1e6 for value in values):
        raise BadInput(
            f"{path}: sensor {token!r} is not NAME|bearing|x cm|y cm|error fraction|half beam"
        )
    bearing_deg, x_cm, y_cm, error_fraction, half_beam_deg = values
    if not 0.0 < half_beam_deg <= 180.0 or error_fraction < 0.0:
        raise BadInput(f"{path}: sensor {token!r} has no usable error fraction or half beam")
    first = name = _session_name(label)
    kind = guess_kind(name) or UNKNOWN_KIND
    # The header gives whole centimetres; the kind's own mount was measured: used where both agree.
    agrees = kind.name == first and round(kind.mount.x_m * 100.0) == x_cm
    x_m = kind.mount.x_m if agrees else x_cm / 100.0
    number = 2
    while name in taken:
        name, number = f"{first}_{number}", number + 1
    mount = SE2(x_m, y_cm / 100.0, wrap_angle(math.radians(bearing_deg)))
    return TraceSensor(name, kind, mount, error_fraction, math.radians(2.0 * half_beam_deg))


def _in_order(
    path: Path, sensors: list[TraceSensor], columns: tuple[str, ...] | None
) -> list[TraceSensor]:
    if columns is None:
        return sensors
    by_name = {sensor.name: sensor for sensor in sensors}
    names = [_session_name(column) for column in columns]
    if sorted(names) != sorted(by_name):
        raise BadInput(
            f"{path}: columns {','.join(columns)!r} must name each of {','.join(by_name)} once"
        )
    return [by_name[name] for name in names]


def _metadata(sensors: Sequence[TraceSensor], rate_hz: float, start_s: float) -> dict[str, str]:
    metadata = {
        "format": FORMAT,
        "rate_hz": f"{rate_hz!r}",
        "rate_note": "an assumption: the trace has no clock",
        "start_s": f"{start_s!r}",
        "columns": ",".join(sensor.name for sensor in sensors),
    }
    for sensor in sensors:
        metadata[f"error_fraction.{sensor.name}"] = f"{sensor.error_fraction!r}"
    return metadata


def _session_name(label: str) -> str:
    label = label.strip().lower()
    plain = re.sub(r"[^a-z0-9_]+", "_", label).strip("_")
    return KNOWN_NAMES.get(label, plain or "sensor")


def _text(data: bytes) -> str:
    return data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")


def _tokens(line: str) -> list[str]:
    """The fields of a line; a comma at the very end begins no field."""
    return line.strip().removesuffix(",").split(",")


def _number(token: str) -> float | None:
    if "_" in token:  # Python reads 1_000 as a number, nobody else does
        return None
    try:
        return float(token)
    except ValueError:
        return None
