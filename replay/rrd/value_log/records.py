"""All values that a layer ever held, reading by reading, in as few bytes as they truly need.

A reading multiplies the odds of each cell that it covers by a factor: one for each distance in
front of its band (see :mod:`replay.rrd.value_log.radial_profile`), a few in the band itself. From
these the new values are predicted, and a record holds only where they came out differently. What
cannot be predicted is written as plain differences to the values before. Either way the values come
back bit for bit: each record carries a checksum of what it must come to.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from mapping.grid import GridGeometry, Window
from replay.rrd.value_log.radial_profile import RadialProfile
from replay.rrd.value_log.sums import LENGTH, Formula, SummedReading, unpacked
from replay.rrd.value_log.track import Cells, Covered, Floats, Singles, Track

_PLAIN, _PREDICTED, _TABLE, _FORMULA, _SUMMED = range(5)
_NO_TABLE = 255
_MOST_FACTORS = 4096  # in one band
_HEAD = struct.Struct("<BBIIIIIIII")
_COUNTS = struct.Struct("<dddIII")
_CODEC = pa.Codec("zstd", compression_level=3)


class ValueLogError(ValueError):
    """A record does not follow the one before it, or does not come to what it must."""


@dataclass(frozen=True, slots=True)
class Head:
    """What a record begins with; ``number`` counts the records of a layer."""

    form: int
    table: int
    number: int
    window: Window
    checksum: int

    def packed(self, body: bytes) -> bytes:
        """The whole record, with its body compressed."""
        w = self.window
        small = bytes(_CODEC.compress(body, asbytes=True))
        where = (w.row0, w.col0, w.rows, w.cols)
        lengths = (len(body), len(small))
        return (
            _HEAD.pack(self.form, self.table, self.number, *where, self.checksum, *lengths) + small
        )


def table_record(track: Track, number: int, table: RadialProfile) -> bytes:
    """The record of one more table that readings may name."""
    track.add_table(table)
    body = struct.pack("<d", table.spacing_m) + table.knots.tobytes()
    return Head(_TABLE, 0, number, Window(0, 0, 0, 0), zlib.crc32(body)).packed(body)


def plain_record(track: Track, number: int, window: Window, values: Singles) -> bytes:
    """The record of new values in a window, as differences; the track takes them over."""
    part = track.values[window.slices]
    new = np.ascontiguousarray(values, np.float32)
    body = _shuffled(new.view(np.int32) - np.ascontiguousarray(part).view(np.int32))
    track.replace(window, new)
    return Head(_PLAIN, _NO_TABLE, number, window, zlib.crc32(new.tobytes())).packed(body)


@dataclass(frozen=True, slots=True)
class Masks:
    """Which cells of a window a reading covers, (rows, cols) each; see :class:`Covered`."""

    window: Window
    free: NDArray[np.bool_]
    band: NDArray[np.bool_]
    others: NDArray[np.bool_]

    def covered(self, geometry: GridGeometry) -> tuple[Cells, Cells, int, int]:
        """The same as cells of the grid and of the window; how many in front and in the band."""
        from replay.rrd.value_log.loops import covered_cells

        w = self.window
        cells, inner, in_front, in_band = covered_cells(
            self.free, self.band, self.others, w.row0, w.col0, geometry.cols
        )
        return cells, inner, in_front, in_band


def predicted_record(
    track: Track, number: int, masks: Masks, covered: Covered, table: int | None,
    true: Singles, most_missed: float,
) -> bytes | None:  # fmt: skip
    """The record of a reading whose covered cells now hold ``true``; the track takes them over.

    None, with the track as it was, when more than the share ``most_missed`` is not as predicted.
    """
    factors, which = _distinct(covered.factors)
    if len(factors) > _MOST_FACTORS:
        return None
    table = _NO_TABLE if table is None else table
    odds, predicted = track.predict(covered, table)
    off = true.view(np.int32) - predicted.view(np.int32)
    missed = np.flatnonzero(off)
    if len(missed) > most_missed * len(true):
        return None
    others = len(covered.cells) > covered.in_front + covered.in_band
    counts = (*covered.sensor_m, track.largest_odds, len(missed), len(factors), others)
    body = b"".join([
        _COUNTS.pack(*counts), factors.tobytes(), _packed(masks.free), _packed(masks.band),
        _packed(masks.others) if others else b"", which.tobytes(),
        _shuffled(np.diff(missed, prepend=0)), _shuffled(off[missed]),
    ])  # fmt: skip
    values = track.settle(covered, odds, predicted, missed, true[missed])
    checksum = zlib.crc32(values.tobytes())
    return Head(_PREDICTED, table, number, masks.window, checksum).packed(body)


def formula_record(track: Track, number: int, formula: Formula) -> bytes:
    """The record of the rule whose sums are followed from here on."""
    track.begin_sums(formula)
    body = formula.numbers.tobytes()
    return Head(_FORMULA, 0, number, Window(0, 0, 0, 0), zlib.crc32(body)).packed(body)


def summed_record(
    track: Track, number: int, masks: Masks, reading: SummedReading, true: Singles,
    most_missed: float,
) -> bytes | None:  # fmt: skip
    """The record of a reading by which sums grow; ``true`` (rows, cols) are its window's values.

    None when more than the share ``most_missed`` is not as predicted: the values are as they were,
    but the sums are of no more use.
    """
    cells, inner, in_front, _ = masks.covered(track.geometry)
    track.follow_sums(cells, in_front, reading)
    predicted, values = track.values_by_sums(cells), true.ravel()[inner]
    off = values.view(np.int32) - predicted.view(np.int32)
    missed = np.flatnonzero(off)
    if len(missed) > most_missed * len(cells):
        return None
    body = b"".join([
        reading.packed(), struct.pack("<I", len(missed)), _packed(masks.free), _packed(masks.band),
        _shuffled(np.diff(missed, prepend=0)), _shuffled(off[missed]),
    ])  # fmt: skip
    track.values.ravel()[cells] = values
    return Head(_SUMMED, 0, number, masks.window, zlib.crc32(values.tobytes())).packed(body)


def _distinct(factors: Floats) -> tuple[Floats, NDArray[np.uint16]]:
    """The different factors, and which one each cell has; nothing where it is the same for all."""
    if not len(factors) or (factors == factors[0]).all():
        return factors[:1], np.zeros(0, np.uint16)
    distinct, which = np.unique(factors, return_inverse=True)
    return distinct, which.astype(np.uint16)


class LogReader:
    """Takes the records of a layer one after the other; ``values`` are what they come to."""

    def __init__(self, track: Track) -> None:
        self._track = track
        self._number = 0

    @property
    def values(self) -> Singles:
        """Of all cells, as of the last record."""
        return self._track.values

    def restart(self) -> None:
        """As the writer did after a whole map."""
        self._track.restart()

    def replace(self, window: Window, values: Singles) -> None:
        """Values that the file holds whole."""
        self._track.replace(window, values)

    def skip(self, records: bytes) -> None:
        """Pass over records before a whole map; only tables are kept, and sums, which go on."""
        for record in _records(records):
            self._number = record.head.number + 1
            if record.head.form in (_TABLE, _FORMULA):
                self._result(record.head, record.body)
            elif record.head.form == _SUMMED:
                self._take_summed(record.head, record.body, passing=True)

    def take(self, records: bytes) -> None:
        """Follow records. Raises ValueLogError where one is missing or it comes out wrong."""
        for record in _records(records):
            head = record.head
            if head.number != self._number:
                raise ValueLogError(f"record {self._number} is missing")
            self._number += 1
            if zlib.crc32(self._result(head, record.body)) != head.checksum:
                raise ValueLogError(f"record {head.number} does not come to what it must")

    def _result(self, head: Head, body: bytes) -> bytes:
        """Follow one record; what its checksum is of."""
        if head.form == _PLAIN:
            return self._take_plain(head.window, body).tobytes()
        if head.form == _PREDICTED:
            return self._take_predicted(head, body).tobytes()
        if head.form == _SUMMED:
            return self._take_summed(head, body).tobytes()
        if head.form == _FORMULA:
            self._track.begin_sums(Formula(np.frombuffer(body, np.float64)))
            return body
        (spacing_m,) = struct.unpack_from("<d", body)
        self._track.add_table(RadialProfile(spacing_m, np.frombuffer(body, np.float64, offset=8)))
        return body

    def _take_plain(self, window: Window, body: bytes) -> Singles:
        off = _unshuffled(body).reshape(window.rows, window.cols)
        old = np.ascontiguousarray(self._track.values[window.slices]).view(np.int32)
        new = (old + off).view(np.float32)
        self._track.replace(window, new)
        return new

    def _take_predicted(self, head: Head, body: bytes) -> Singles:
        parts = _Parts(body, head.window)
        x, y, self._track.largest_odds, misses, kinds, others = _COUNTS.unpack(
            parts.bytes(_COUNTS.size)
        )
        factors = np.frombuffer(parts.bytes(8 * kinds), np.float64)
        free, band = parts.mask(), parts.mask()
        left = parts.mask() if others else np.zeros_like(band)
        masks = Masks(head.window, free, band, left)
        cells, inner, in_front, count = masks.covered(self._track.geometry)
        if kinds > 1:
            factors = factors[np.frombuffer(parts.bytes(2 * count), np.uint16)]
        else:
            factors = np.repeat(factors, count)
        covered = Covered((x, y), cells, inner, in_front, count, factors)
        missed = np.cumsum(_unshuffled(parts.bytes(4 * misses)).astype(np.int64))
        off = _unshuffled(parts.bytes(4 * misses))
        odds, predicted = self._track.predict(covered, head.table)
        true = (predicted[missed].view(np.int32) + off).view(np.float32)
        return self._track.settle(covered, odds, predicted, missed, true)

    def _take_summed(self, head: Head, body: bytes, *, passing: bool = False) -> Singles:
        """In ``passing`` the values, which a whole map brings, are of no matter."""
        parts = _Parts(body, head.window)
        reading = unpacked(parts.bytes(LENGTH))
        (misses,) = struct.unpack("<I", parts.bytes(4))
        free, band = parts.mask(), parts.mask()
        cells, _, in_front, _ = Masks(head.window, free, band, np.zeros_like(band)).covered(
            self._track.geometry
        )
        self._track.follow_sums(cells, in_front, reading)
        known = self._track.values.ravel()
        if not passing:
            values = self._track.values_by_sums(cells)
            missed = np.cumsum(_unshuffled(parts.bytes(4 * misses)).astype(np.int64))
            values.view(np.int32)[missed] += _unshuffled(parts.bytes(4 * misses))
            known[cells] = values
        return known[cells]


class _Parts:
    """A body, taken apart from its begin."""

    def __init__(self, body: bytes, window: Window) -> None:
        self._body, self._at, self._window = body, 0, window

    def bytes(self, count: int) -> bytes:
        self._at += count
        return self._body[self._at - count : self._at]

    def mask(self) -> NDArray[np.bool_]:
        w = self._window
        across = -(-w.cols // 8)
        rows = np.frombuffer(self.bytes(w.rows * across), np.uint8).reshape(w.rows, across)
        bits = np.unpackbits(np.bitwise_xor.accumulate(rows, axis=0), axis=1, count=w.cols)
        return bits.astype(np.bool_)


def _packed(mask: NDArray[np.bool_]) -> bytes:
    """Eight cells a byte, and only where a row differs from the one below: mostly zeros."""
    rows = np.packbits(mask, axis=1)
    rows[1:] ^= rows[:-1].copy()
    return rows.tobytes()


def _shuffled(numbers: NDArray[np.integer]) -> bytes:
    """32-bit numbers as all their first bytes, then all second ones ...; signs folded in."""
    n = numbers.astype(np.int32)
    folded = ((n << 1) ^ (n >> 31)).ravel()
    return np.ascontiguousarray(folded.view(np.uint8).reshape(-1, 4).T).tobytes()


def _unshuffled(data: bytes) -> NDArray[np.int32]:
    columns = np.frombuffer(data, np.uint8).reshape(4, -1)
    folded = np.ascontiguousarray(columns.T).view(np.uint32).ravel()
    n: NDArray[np.int32] = (folded >> 1).view(np.int32) ^ -(folded & 1).view(np.int32)
    return n


@dataclass(frozen=True, slots=True)
class _Record:
    """One record as it stands in the file."""

    head: Head
    length: int
    small: bytes

    @property
    def body(self) -> bytes:
        return bytes(_CODEC.decompress(self.small, decompressed_size=self.length, asbytes=True))


def _records(data: bytes) -> Iterator[_Record]:
    """The records that stand one after the other in one row."""
    at = 0
    while at < len(data):
        form, table, number, row0, col0, rows, cols, checksum, length, small = _HEAD.unpack_from(
            data, at
        )
        at += _HEAD.size
        head = Head(form, table, number, Window(row0, col0, rows, cols), checksum)
        yield _Record(head, length, data[at : at + small])
        at += small
