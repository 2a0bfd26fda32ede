"""Text files of readings → messages: CSV and its kin, what a serial monitor saved, JSON lines.

A row holds one number a column; :mod:`recorder.protocols.csv` defines the columns and reads the
rows. Columns that are not named are guessed from the words above them, or from the numbers. Without
a column for its pose the robot stands still. Rows are in order of time: a clock that stands still
or steps back moves no row.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from recorder.errors import BadInput
from recorder.geometry import IDENTITY, SE2
from recorder.importers.columns import columns_of_names, columns_of_numbers
from recorder.importers.imported import Imported
from recorder.messages import BASE_FRAME, Message, Pose, Transform
from recorder.odometry import WheelGeometry
from recorder.protocols.csv import (
    ANGLES_RAD,
    COUNTS,
    LENGTHS_M,
    POSE,
    TIMES_MS,
    Column,
    CsvProtocol,
    parse_columns,
)
from recorder.protocols.reports import Fault, Packet, RangeReport
from recorder.protocols.rows import fields_of
from recorder.sensors import SensorParameters
from recorder.translation import Translator

FORMAT = "csv"
MOST_BYTES = 1 << 30
LONGEST_LINE = 4096
SHOWN_CHARACTERS = 60
_LINE_END = re.compile(r"\r\n|\n|\r")
_WRAPS_MS = {"t_ms": 2.0**32, "t_us": 2.0**32 / 1000.0}  # counters of 32 bits


def looks_like_text(head: bytes) -> bool:
    """Whether a file that begins with these bytes is text with numbers in its rows."""
    if not head or b"\0" in head:
        return False
    lines = [line for line in _LINE_END.split(head.decode("latin-1"))[:12] if line.strip()]
    return any(_is_row(line) for line in lines)


def import_text(
    path: Path,
    *,
    columns: str | None = None,
    rate_hz: float = 20.0,
    start_s: float = 0.0,
    pose: SE2 | None = None,
    wheels: WheelGeometry | None = None,
    mounts: Sequence[Transform] = (),
    sensors: Mapping[str, SensorParameters] | None = None,
) -> Imported:
    """Read rows; ``columns`` as in ``t_ms,ping:cm``, guessed when left out.

    Without a time among them rows come ``rate_hz`` times a second from ``start_s`` (UNIX seconds);
    without a pose or wheels the robot stands at ``pose`` (default: the origin). Raises BadInput, in
    one line, for what cannot be read and for a file without one range.
    """
    lines = _lines_of(path)
    if any(line.startswith("{") for line in lines[:3]):
        lines = _rows_of_json(path, lines)
    known = parse_columns(columns) if columns is not None else _guessed(path, lines)
    packets, dropped, bad = _packets(lines, known)
    if not any(isinstance(report, RangeReport) or packet.report for packet in packets
               for report in (packet.report, *packet.more)):  # fmt: skip
        shown = f"; the first row that did not fit: {_shown(bad)}" if bad else ""
        raise BadInput(f"{path}: not one reading in columns {_text_of(known)}{shown}")
    times_ns, clock = _times_ns(known, packets, rate_hz, start_s)
    names = {column.name for column in known}
    if set(COUNTS) <= names and wheels is None and not set(POSE) <= names:
        raise BadInput(f"{path}: wheel counts need --wheels RADIUS_M,TRACK_M,COUNTS")
    stands = not set(POSE) <= names and not set(COUNTS) <= names
    records = _mounts(known, times_ns[0], mounts)
    translator = Translator(sensors=sensors, wheels=wheels)
    for t_ns, packet in zip(times_ns, packets, strict=True):
        if stands:
            records.append((t_ns, Pose(t_ns, pose or IDENTITY)))
        records += [(t_ns, message) for message in translator.reports(packet, t_ns)]
        dropped["not measured"] += packet.invalid
    metadata = {
        "format": FORMAT, "columns": _text_of(known), "clock": clock, "start_s": f"{start_s!r}",
        "columns_note": "guessed" if columns is None else "as given",
    }  # fmt: skip
    if stands:
        metadata["pose_note"] = "no pose in the file: the robot is taken to stand still"
    if bad:
        metadata["first_bad_row"] = _shown(bad)
    return Imported(records, metadata, {why: n for why, n in dropped.items() if n})


def _lines_of(path: Path) -> list[str]:
    try:
        if path.exists() and not path.is_file():  # a pipe would never end
            raise BadInput(f"{path}: cannot be read (no regular file)")
        if path.stat().st_size > MOST_BYTES:
            raise BadInput(f"{path}: over {MOST_BYTES >> 20} MB: split it first")
        data = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror or error})") from error
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", errors="replace")
    else:
        text = data.removeprefix(b"\xef\xbb\xbf").decode("utf-8", errors="replace")
    lines = (line.strip() for line in _LINE_END.split(text))
    return [line for line in lines if line and not line.startswith(("#", "//"))]


def _is_row(line: str) -> bool:
    """Whether a line is fields with at least one number, or a JSON object."""
    if line.lstrip().startswith("{"):
        return True
    try:
        fields = fields_of(line)
    except ValueError:
        return False
    return any(field.number for field in fields)


def _rows_of_json(path: Path, lines: Sequence[str]) -> list[str]:
    """JSON objects, a line each → named fields, as ``x:1.5 y:2``; what is no number is left out."""
    names: dict[str, None] = {}
    objects: list[dict[str, Any]] = []
    for line in lines:
        try:
            value = json.loads(line) if len(line) <= LONGEST_LINE else None
        except (ValueError, RecursionError):
            value = None
        objects.append(value if isinstance(value, dict) else {})
        names.update(dict.fromkeys(k for k, v in objects[-1].items() if _is_number(v)))
    if not names:
        raise BadInput(f"{path}: JSON lines without one number")
    rows = (
        ",".join(repr(float(one[k])) if _is_number(one.get(k)) else "" for k in names)
        for one in objects
    )
    return [",".join(names), *rows]


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e15 if isinstance(value, int) else math.isfinite(value)


def _guessed(path: Path, lines: Sequence[str]) -> tuple[Column, ...]:
    """What the columns are by the words above them, else by the numbers in them."""
    for i, line in enumerate(lines[:12]):
        if not _is_row(line):
            named = columns_of_names(line)
            if named is not None:
                return named
            continue
        rows = []
        for row in lines[i : i + 2000]:
            try:
                rows.append(fields_of(row))
            except ValueError:
                continue
        guess = columns_of_numbers(rows)
        if guess is not None:
            return guess
        break
    first = _shown(lines[0]) if lines else "nothing in it"
    raise BadInput(
        f"{path}: what the columns are cannot be guessed ({first}); name them, as in "
        "--columns t_ms,ping:cm"
    )


def _packets(
    lines: Sequence[str], columns: Sequence[Column]
) -> tuple[list[Packet], Counter[str], str]:
    """The rows that fit, what the others are, and the first of those that are malformed."""
    protocol, dropped, bad = CsvProtocol(columns), Counter[str](), ""
    packets: list[Packet] = []
    for line in lines:
        try:
            packet = protocol.packet(line.encode())
        except (ValueError, LookupError, ArithmeticError):
            packet = Packet(b"", fault=Fault.MALFORMED)
        if packet.fault is None:
            packets.append(packet)
        elif packet.fault is not Fault.HEADER:
            dropped["malformed row"] += 1
            bad = bad or line
    return packets, dropped, bad


def _times_ns(
    columns: Sequence[Column], packets: Sequence[Packet], rate_hz: float, start_s: float
) -> tuple[list[int], str]:
    """When each row was measured, rising, and in words by which clock."""
    first_ns = round(start_s * 1e9)
    time = next((column for column in columns if column.name in TIMES_MS), None)
    if time is None:
        step_ns = round(1e9 / rate_hz)
        times = [first_ns + i * step_ns for i in range(len(packets))]
        return times, f"{rate_hz:g} rows a second, an assumption: no column is a time"
    times_ms = np.array([_time_ms(packet, columns) for packet in packets])
    times_ms, note = _rising(times_ms, _WRAPS_MS.get(time.name))
    own_ns = np.round((times_ms - math.floor(times_ms[0])) * 1e6).astype(np.int64)
    epoch = times_ms[0] > 1e12  # UNIX milliseconds of this century
    base_ns = math.floor(times_ms[0]) * 1_000_000 if epoch else first_ns
    return [base_ns + int(t) for t in own_ns], f"{time.name}{note}"


def _time_ms(packet: Packet, columns: Sequence[Column]) -> float:
    """The time of a row as it stands there, not wrapped at 32 bits as a device's counter is."""
    values = CsvProtocol(columns).values(packet.raw.decode())
    return next((v for name in TIMES_MS if (v := values.get(name)) is not None), math.nan)


def _rising(times_ms: np.ndarray, wrap_ms: float | None) -> tuple[np.ndarray, str]:
    """The same times made to rise: wraps undone, steps back left out, coarse clocks spread."""
    steps = np.diff(times_ms)
    steps[~np.isfinite(steps)] = 0.0
    wraps = steps < -wrap_ms / 2.0 if wrap_ms else np.zeros(len(steps), np.bool_)
    back = (steps < 0.0) & ~wraps
    steps[wraps] += wrap_ms or 0.0
    usual_ms = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    steps[back] = min(usual_ms, 1000.0)
    start_ms = float(times_ms[0]) if math.isfinite(times_ms[0]) else 0.0
    rising = start_ms + np.concatenate([[0.0], np.cumsum(steps)])
    notes = f", stepped back {int(back.sum())} times: order of rows kept" if back.any() else ""
    if (steps == 0.0).any():
        rising, coarse = _spread(rising)
        notes += f", rows of one time spread over its step ({coarse:g} ms)"
    return rising, notes


def _spread(times_ms: np.ndarray) -> tuple[np.ndarray, float]:
    """Rows that share a time, evenly over the time until the next; also the usual step.

    The first and the last group may be cut: their rows keep the distance of all others.
    """
    values, first, counts = np.unique(times_ms, return_index=True, return_counts=True)
    if len(values) < 2:
        return times_ms + np.arange(len(times_ms)), 0.0
    gaps = np.diff(values)
    inner = slice(1, -1) if len(gaps) > 1 else slice(None)
    each_ms = float(np.median(gaps[inner] / counts[:-1][inner])) if len(gaps[inner]) else gaps[0]
    out = times_ms.copy()
    for i, (value, at, count) in enumerate(zip(values, first, counts, strict=True)):
        k = np.arange(count)
        if i == 0:
            out[at : at + count] = values[1] - (count - k) * min(each_ms, gaps[0] / count)
        elif i == len(values) - 1:
            out[at : at + count] = value + k * each_ms
        else:
            out[at : at + count] = value + k * gaps[i] / count
    return out, float(np.median(gaps))


def _mounts(
    columns: Sequence[Column], t_ns: int, mounts: Sequence[Transform]
) -> list[tuple[int, Message]]:
    """Mounts as given; a ranger without one turns with the first head, if there is a head."""
    given = {mount.child for mount in mounts}
    out: list[tuple[int, Message]] = [
        (t_ns, Transform(t_ns, mount.parent, mount.child, mount.parent_from_child))
        for mount in mounts
    ]
    heads = [c.name for c in columns if c.unit in ANGLES_RAD and c.name not in POSE]
    for column in columns:
        ranger = column.unit in LENGTHS_M and column.name not in (*POSE, *given)
        if ranger and heads:
            out.append((t_ns, Transform(t_ns, heads[0], column.name, IDENTITY)))
    if heads:
        out.append((t_ns, Transform(t_ns, BASE_FRAME, heads[0], IDENTITY, static=False)))
    return out


def _text_of(columns: Sequence[Column]) -> str:
    return ",".join(f"{c.name}:{c.unit}" if c.unit else c.name for c in columns)


def _shown(line: str) -> str:
    """A row as it can be shown: printable, not too long."""
    text = "".join(c if c.isprintable() else "?" for c in line)
    return repr(text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}...")
