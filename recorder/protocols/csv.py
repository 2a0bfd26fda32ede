"""The ``csv`` protocol: rows of numbers, what ``Serial.println`` gives; the columns are named here.

Nothing in a row shows whether it arrived as it was sent, so a damaged digit passes as another
number. What can be noticed is reported: too few or too many numbers, and what is no number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

from recorder.errors import BadInput
from recorder.names import FRAME_NAME
from recorder.protocols.echogrid import DEVICE_MS_RANGE, SEQ_RANGE
from recorder.protocols.interface import LineProtocol
from recorder.protocols.reports import (
    Fault,
    HeadReport,
    Packet,
    PoseReport,
    RangeReport,
    Report,
    WheelReport,
)
from recorder.protocols.rows import NUMBER, RowField, fields_of, plain_fields

SKIPPED = "-"
LENGTHS_M: Mapping[str, float] = MappingProxyType({"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254})
ANGLES_RAD: Mapping[str, float] = MappingProxyType({"deg": math.pi / 180.0, "rad": 1.0})
TIMES_MS: Mapping[str, float] = MappingProxyType({"t_ms": 1.0, "t_s": 1000.0, "t_us": 1e-3})
COUNTS = ("left", "right")  # of the wheels
POSE = ("x", "y", "heading")

_FARTHEST_M = 1000.0
_NUMBER = re.compile(NUMBER)
_NO_NUMBER = ("", "nan", "NaN", "NAN")  # a reading that was not made; Arduinos print nan


@dataclass(frozen=True, slots=True)
class Column:
    """A column: what it holds, and how many SI units (or milliseconds, or counts) one of it is."""

    name: str
    unit: str = ""

    @property
    def scale(self) -> float:
        """What its numbers are multiplied by."""
        for units in (LENGTHS_M, ANGLES_RAD):
            if self.unit in units:
                return units[self.unit]
        return TIMES_MS.get(self.name, 1.0)


def parse_columns(text: str) -> tuple[Column, ...]:
    """``t_ms,ping:cm,dirrs:mm`` → columns. Raises BadInput, in one line, on what cannot be.

    ``t_ms``, ``t_s`` or ``t_us``: the device's time; ``seq``: a count of the rows;
    ``NAME:mm|cm|m|in``: a range; ``NAME:deg|rad``: a head's angle; ``left`` and ``right``: wheel
    counts; ``x:UNIT``, ``y:UNIT`` and ``heading:deg|rad``: a pose; ``-``: a column to skip.
    """
    columns = tuple(_parse_column(part.strip()) for part in text.split(","))
    names = [column.name for column in columns if column.name != SKIPPED]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"columns: {name} is there twice")
    if len(set(TIMES_MS) & set(names)) > 1:
        raise BadInput("columns: one time is enough, t_ms, t_s or t_us")
    for group in (COUNTS, POSE):
        missing = [name for name in group if name not in names]
        if missing and len(missing) < len(group):
            raise BadInput(f"columns: {', '.join(group)} belong together; {missing[0]} is missing")
    if not any(column.unit for column in columns) and not set(COUNTS) <= set(names):
        raise BadInput("columns: no range among them, such as ping:cm")
    return columns


def _parse_column(text: str) -> Column:
    name, _, unit = text.partition(":")
    if text == SKIPPED or text in TIMES_MS or text == "seq" or text in COUNTS:
        return Column(text)
    if not FRAME_NAME.fullmatch(name) or name in (*TIMES_MS, *COUNTS, "seq"):
        raise BadInput(f"columns: {text!r} is no column, such as t_ms, seq, ping:cm or -")
    if unit not in (*LENGTHS_M, *ANGLES_RAD):
        known = ", ".join((*LENGTHS_M, *ANGLES_RAD))
        raise BadInput(f"columns: {name} needs a unit, {name}:UNIT, one of {known}")
    wrong = LENGTHS_M if name == "heading" else ANGLES_RAD if name in POSE else ()
    if unit in wrong:
        raise BadInput(f"columns: {name} cannot be in {unit}")
    return Column(name, unit)


class CsvProtocol(LineProtocol):
    """Rows of numbers with commas, semicolons, tabs or blanks between them; no checksum."""

    name: ClassVar[str] = "csv"
    default_baud: ClassVar[int] = 9600
    carriage_return_ends_lines: ClassVar[bool] = True

    def __init__(self, columns: Sequence[Column] = ()) -> None:
        super().__init__()
        self._columns = tuple(columns)

    def packet(self, raw: bytes) -> Packet:
        """One row; ValueError when it does not fit the columns."""
        text = raw.decode("utf-8").strip()
        if all(_is_word(field) for field in plain_fields(text)):
            return Packet(raw, fault=Fault.HEADER)
        values = self.values(text)
        known = {name: value for name, value in values.items() if value is not None}
        seq = None if "seq" not in known else int(known["seq"]) % SEQ_RANGE
        time_ms = next((known[name] for name in TIMES_MS if name in known), None)
        if time_ms is not None and time_ms < 0.0:
            raise ValueError(f"a device time of {time_ms:g} ms is out of range")
        # Only differences of a time count, so UNIX time will do as well.
        device_ms = None if time_ms is None else math.floor(time_ms) % DEVICE_MS_RANGE
        reports = self._reports(known)
        invalid = len(values) - len(known)
        if not reports and not invalid:
            return Packet(raw, None, seq, device_ms, Fault.MALFORMED)
        first = reports[0] if reports else None
        return Packet(raw, first, seq, device_ms, more=tuple(reports[1:]), invalid=invalid)

    def values(self, text: str) -> dict[str, float | None]:
        """The numbers of a row by column, SI units (times in ms); None: nothing was measured.

        Raises ValueError when the row does not fit the columns.
        """
        fields = self._placed(text)
        return {
            column.name: _number(field, column)
            for column, field in zip(self._columns, fields, strict=True)
            if column.name != SKIPPED
        }

    def _placed(self, text: str) -> list[RowField]:
        """The fields in the order of the columns: by place, or by their names if they have any."""
        plain = plain_fields(text)
        if len(plain) == len(self._columns) and all(
            column.name == SKIPPED or field in _NO_NUMBER or _NUMBER.fullmatch(field)
            for column, field in zip(self._columns, plain, strict=True)
        ):
            return [RowField(field) for field in plain]
        fields = fields_of(text, len(self._columns))
        names = {field.name.strip().lower(): field for field in fields if field.name}
        if names:
            if len(names) < len(fields):
                raise ValueError("some fields have names and some have none")
            by_name = [names.get(column.name.lower(), RowField("")) for column in self._columns]
            if any(field.number for field in by_name):
                return by_name
        return fields

    def _reports(self, values: Mapping[str, float]) -> list[Report]:
        """The reports in the numbers of a row: a head's angle before the ranges that it turned."""
        heads: list[Report] = []
        ranges: list[Report] = []
        for column in self._columns:
            value = values.get(column.name)
            if value is None or column.name in POSE:
                continue
            if column.unit in ANGLES_RAD:
                heads.append(HeadReport(column.name, value))
            elif column.unit in LENGTHS_M:
                ranges.append(RangeReport(column.name, _range_m(value)))
        if set(POSE) <= set(values):
            heads.append(PoseReport(*(values[name] for name in POSE)))
        if set(COUNTS) <= set(values):
            heads.append(WheelReport(*(int(values[name]) for name in COUNTS)))
        return heads + ranges


def _is_word(field: str) -> bool:
    """Whether a field stands in a header: neither a number nor a missing one."""
    return field not in _NO_NUMBER and field[:1].isalpha() and field.lower() not in ("inf", "ovf")


def _number(field: RowField, column: Column) -> float | None:
    """A field in SI units (times in milliseconds); None when nothing was measured."""
    if field.number in _NO_NUMBER:
        return None
    if field.number.lower() in ("inf", "+inf") and column.unit in LENGTHS_M:
        return math.inf
    if not _NUMBER.fullmatch(field.number):
        raise ValueError(f"{field.number!r} is no number")
    value = float(field.number) * _scale_of(field.unit, column)
    if column.unit in LENGTHS_M and abs(value) > _FARTHEST_M:
        raise ValueError(f"{field.number} {field.unit or column.unit} is out of range")
    return value


def _scale_of(unit: str, column: Column) -> float:
    """A unit that stands in the row itself counts, if it is of the column's kind."""
    if not unit or unit == column.unit:
        return column.scale
    for units in (LENGTHS_M, ANGLES_RAD):
        if column.unit in units and unit in units:
            return units[unit]
    if column.name in TIMES_MS and f"t_{unit}" in TIMES_MS:
        return TIMES_MS[f"t_{unit}"]
    raise ValueError(f"{unit} is no unit of {column.name}")


def _range_m(value_m: float) -> float:
    """0 or less is what the usual libraries give when no echo came."""
    return value_m if value_m > 0.0 else math.inf
