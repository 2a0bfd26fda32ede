"""Where the fields of a ROS 2 message lie in its bytes, found once for many that are alike.

CDR has no fixed places: a string moves all that follows it. But the messages of one channel mostly
have the same strings and the same lengths, so the places found in one of them hold for each whose
*fixed* bytes (the lengths, the strings, the byte order) are the same, and these are compared. The
definition is the one that the file carries; what is written here in any unusual way is left to the
library's decoder, message by message.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_HEAD_BYTES = 4  # what CDR begins with; alignment counts from behind it
_PRIMITIVES = {
    "bool": "u1", "byte": "u1", "char": "i1", "int8": "i1", "uint8": "u1", "int16": "<i2",
    "uint16": "<u2", "int32": "<i4", "uint32": "<u4", "int64": "<i8", "uint64": "<u8",
    "float32": "<f4", "float64": "<f8",
}  # fmt: skip
_FIELD = re.compile(r"([A-Za-z][\w/]*)(\[\d*\])?\s+([A-Za-z]\w*)")
_CONSTANT = re.compile(r"[A-Za-z]\w*\s+[A-Za-z]\w*\s*=[^=<>]*")
_PART = re.compile(r"MSG:\s+(\S+)")
_MOST_ELEMENTS = 1 << 20


@dataclass(frozen=True, slots=True)
class _Field:
    name: str
    type_name: str
    count: int | None  # None: one; -1: as many as the length before them
    parts: tuple[_Field, ...] = ()  # of a message within the message


@dataclass(frozen=True, slots=True)
class Definition:
    """A message definition with all that it is made of: fields in the order of their bytes."""

    fields: tuple[_Field, ...]


def parse_definition(name: str, text: str) -> Definition | None:
    """The definition in a ``ros2msg`` schema; None where anything in it is out of the ordinary."""
    time = (("uint32", "", "sec"), ("uint32", "", "nanosec"))  # as in the library, where not given
    parts: dict[str, tuple[tuple[str, str, str], ...]] = {}
    for section in re.split(r"^={3,}$", text, flags=re.MULTILINE):
        lines = [line.split("#")[0].strip() for line in section.splitlines()]
        lines = [line for line in lines if line]
        title = _PART.fullmatch(lines[0]) if lines and parts else None
        key = _short(name if not parts else "" if title is None else title[1])
        found = [_FIELD.fullmatch(line) for line in lines[title is not None :]
                 if _CONSTANT.fullmatch(line) is None]  # fmt: skip
        if not key or key in parts or not found or None in found:
            return None
        parts[key] = tuple((m[1], m[2] or "", m[3]) for m in found if m is not None)
    parts.setdefault("builtin_interfaces/Time", time)
    fields = _resolved(_short(name), parts, 8)
    return None if fields is None else Definition(fields)


def _short(name: str) -> str:
    package, _, _ = name.partition("/")
    return f"{package}/{name.rpartition('/')[2]}" if "/" in name else ""


def _resolved(
    name: str, parts: Mapping[str, tuple[tuple[str, str, str], ...]], depth: int
) -> tuple[_Field, ...] | None:
    if name not in parts or depth == 0:
        return None
    fields: list[_Field] = []
    for type_name, array, field_name in parts[name]:
        count = None if not array else -1 if array == "[]" else int(array[1:-1])
        inner: tuple[_Field, ...] | None = ()
        if type_name not in _PRIMITIVES and type_name != "string":
            whole = type_name if "/" in type_name else f"{name.partition('/')[0]}/{type_name}"
            inner = _resolved(_short(whole), parts, depth - 1)
        if inner is None:
            return None
        fields.append(_Field(field_name, type_name, count, inner))
    return tuple(fields)


@dataclass(slots=True)
class Layout:
    """Where things lie in the messages that are like one message, in bytes from its begin.

    ``values``: path (``header.stamp.sec``) → (offset, NumPy format, how many or None). ``texts``:
    path → string. ``lengths``: path → elements of a sequence. ``fixed``: (offset, bytes) of all
    that must be the same. ``size``: what a message must hold at least.
    """

    values: dict[str, tuple[int, str, int | None]] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    lengths: dict[str, int] = field(default_factory=dict)
    fixed: list[tuple[int, bytes]] = field(default_factory=list)
    size: int = _HEAD_BYTES

    def dtype(self, paths: Mapping[str, str]) -> np.dtype[np.void]:
        """A record with a field each for ``paths`` (path → NumPy format) and the fixed bytes.

        Raises KeyError, ValueError where a path is not there in that format.
        """
        names, formats, offsets = [], [], []
        for path, expected in paths.items():
            offset, given, count = self.values[path]
            if given != expected:
                raise ValueError(f"{path} is {given}, not {expected}")
            names.append(path)
            formats.append(given if count is None else (given, (count,)))
            offsets.append(offset)
        for number, (offset, _, kind) in enumerate(self._words()):
            names.append(f"word {number}")
            formats.append(kind)
            offsets.append(offset)
        return np.dtype({"names": names, "formats": formats, "offsets": offsets})

    def alike(self, found: NDArray[np.void]) -> NDArray[np.bool_]:
        """Which of the records of :meth:`dtype`, (N,), have the same fixed bytes, (N,)."""
        same = np.ones(len(found), np.bool_)
        for number, (_, word, _) in enumerate(self._words()):
            same &= found[f"word {number}"] == word
        return same

    def _words(self) -> Iterator[tuple[int, int, str]]:
        """The fixed bytes as (offset, number, format) of up to eight each, which compare faster."""
        for offset, data in self.fixed:
            at = 0
            while at < len(data):
                width = next(size for size in (8, 4, 2, 1) if size <= len(data) - at)
                yield offset + at, int.from_bytes(data[at : at + width], "little"), f"<u{width}"
                at += width


def layout_of(definition: Definition, data: bytes) -> Layout | None:
    """The layout of one message; None where it does not hold what is defined."""
    if len(data) < _HEAD_BYTES or data[0] or not data[1] & 1:  # compressed, or big-endian
        return None
    layout = Layout(fixed=[(0, data[:2])])
    try:
        _Walk(data, layout).through(definition.fields, "")
    except (struct.error, UnicodeDecodeError, OverflowError):
        return None
    return layout if layout.size <= len(data) else None


@dataclass(slots=True)
class _Walk:
    """One way through the bytes of a message, field by field."""

    data: bytes
    layout: Layout

    def through(self, fields: tuple[_Field, ...], prefix: str) -> None:
        for each in fields:
            path = prefix + each.name
            if each.count is None:
                self._one(each, path)
                continue
            count = each.count
            if count < 0:
                count = self._length()
                self.layout.lengths[path] = count
            if count > _MOST_ELEMENTS:
                raise OverflowError
            if each.type_name in _PRIMITIVES:
                self._values(each.type_name, path, count)
            else:
                for number in range(count):
                    self._one(each, f"{path}.{number}")

    def _one(self, each: _Field, path: str) -> None:
        if each.parts:
            self.through(each.parts, path + ".")
        elif each.type_name == "string":
            self._text(path)
        else:
            self._values(each.type_name, path, None)

    def _values(self, type_name: str, path: str, count: int | None) -> None:
        kind = _PRIMITIVES[type_name]
        width = np.dtype(kind).itemsize
        at = self._aligned(width) if count != 0 else self.layout.size
        self.layout.values[path] = (at, kind, count)
        self.layout.size = at + width * (1 if count is None else count)
        if self.layout.size > len(self.data):
            raise OverflowError

    def _length(self) -> int:
        at = self._aligned(4)
        [length] = struct.unpack_from("<I", self.data, at)
        self.layout.fixed.append((at, self.data[at : at + 4]))
        self.layout.size = at + 4
        return int(length)

    def _text(self, path: str) -> None:
        length = self._length()
        at = self.layout.size
        held = self.data[at : at + length]
        if len(held) < length:
            raise OverflowError
        self.layout.texts[path] = held[:-1].decode()
        if length:
            self.layout.fixed.append((at, held))
        self.layout.size = at + length

    def _aligned(self, width: int) -> int:
        return self.layout.size + (_HEAD_BYTES - self.layout.size) % width
