"""The list of a recording's steps, for programs: what each is, and which values are exact at it.

A row of its own for each of them would take more room than what it states. So the steps that are
written together are one row, packed.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from replay.rrd import columns, layout
from replay.rrd.batches import Batches, numbers_of
from replay.rrd.sink import RowBuffer, Stamp

_COMPONENT = "numbers"
_CODEC = pa.Codec("zstd", compression_level=3)
_HEAD = struct.Struct("<II")  # bytes of what follows unpacked, and of the kinds in it
_MOST_BYTES = 1 << 26


@dataclass(frozen=True, slots=True)
class Step:
    """One step: when, which artifact, of which layer, and the layers that are exact at it."""

    step: int
    reading: int
    t_ns: int
    artifact: str
    layer: str
    exact: frozenset[str]


class StepList:
    """Gathers the steps of one map, and adds them to its rows when these are sent."""

    def __init__(self, rows: RowBuffer) -> None:
        self._rows = rows
        self._stamps: list[Stamp] = []
        self._kinds: dict[tuple[str, str, tuple[str, ...]], int] = {}
        self._kind_of: list[int] = []
        rows.before_sending(self._send)

    def add(self, stamp: Stamp, artifact: str, layer: str, exact: tuple[str, ...]) -> None:
        """One more step."""
        self._stamps.append(stamp)
        self._kind_of.append(self._kinds.setdefault((artifact, layer, exact), len(self._kinds)))

    def _send(self) -> None:
        """The rows of steps go last: a cut file never lists one whose values it lost."""
        if not self._stamps:
            return
        times = [(each.step, each.reading, each.t_ns) for each in self._stamps]
        table = np.column_stack([np.array(times, np.int64), np.array(self._kind_of, np.int64)])
        packed = np.frombuffer(_packed(table, list(self._kinds)), np.uint8)
        self._rows.add(layout.STEPS, columns.number_records, self._stamps[-1], packed, len(packed))
        self._stamps.clear()
        self._kind_of.clear()
        self._kinds.clear()


def read_steps(file: Batches) -> list[Step]:
    """All steps of a map, in order. Raises ValueError where they are damaged."""
    steps = [*_older_steps(file)]
    for batch in file.batches(layout.STEPS, _COMPONENT):
        for row in range(batch.num_rows):
            steps += _unpacked(numbers_of(batch, _COMPONENT, row).astype(np.uint8).tobytes())
    return sorted(steps, key=lambda each: each.step)


def _packed(table: NDArray[np.int64], kinds: list[Any]) -> bytes:
    """Steps as differences to the one before, (N, 4), number by number; and the kinds they are."""
    names = json.dumps(kinds).encode()
    differences = np.diff(table, axis=0, prepend=0)
    body = names + np.ascontiguousarray(differences.T).tobytes()
    return _HEAD.pack(len(body), len(names)) + bytes(_CODEC.compress(body, asbytes=True))


def _unpacked(data: bytes) -> Iterator[Step]:
    length, named = _HEAD.unpack_from(data)
    if length > _MOST_BYTES:
        raise ValueError("a list of steps that is too long")
    body = bytes(_CODEC.decompress(data[_HEAD.size :], decompressed_size=length, asbytes=True))
    kinds = json.loads(body[:named])
    table = np.cumsum(np.frombuffer(body, np.int64, offset=named).reshape(4, -1), axis=1).T
    for step, reading, t_ns, kind in table.tolist():
        artifact, layer, exact = kinds[kind]
        yield Step(step, reading, t_ns, str(artifact), str(layer), frozenset(exact))


def _older_steps(file: Batches) -> Iterator[Step]:
    """Of recordings in which each step is a row."""
    for batch in file.batches(layout.STEPS, "artifact", whole=True):
        texts = [batch.column(name).to_pylist() for name in ("artifact", "layer", "exact")]
        numbers = [batch.column(name).to_numpy() for name in (layout.STEP, layout.READING)]
        times = batch.column(layout.TIME).cast(pa.int64()).to_numpy()
        for (artifact,), (layer,), exact, step, number, t_ns in zip(
            *texts, *numbers, times, strict=True
        ):
            names = frozenset(exact or ())
            yield Step(int(step), int(number), int(t_ns), artifact, layer, names)
