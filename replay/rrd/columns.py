"""From the values of many rows to columns of the recording, a *pack* for each kind of thing."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from replay.rrd.sink import Columns


@dataclass(frozen=True, slots=True)
class _Arrow:
    """An Arrow array that is taken as it is: no copy, no guess at its type."""

    array: pa.Array

    def as_arrow_array(self) -> pa.Array:
        return self.array


def _offsets(lengths: Sequence[int]) -> NDArray[np.int32]:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)


def _joined(name: str, rows: Sequence[NDArray[Any]]) -> rr.ComponentColumn:
    """A component of our own: each row a flat list of numbers, of the rows' own type."""
    flat = np.concatenate([np.ravel(row) for row in rows]) if rows else np.zeros(0)
    lengths = [row.size for row in rows]
    return rr.ComponentColumn(
        rr.ComponentDescriptor(name), _Arrow(pa.array(flat)), offsets=_offsets(lengths)
    )


def _texts(name: str, rows: Sequence[str]) -> rr.ComponentColumn:
    return rr.ComponentColumn(rr.ComponentDescriptor(name), _Arrow(pa.array(rows, pa.string())))


_BLOB = pa.list_(pa.field("item", pa.uint8(), nullable=False))
_BUFFER = next(iter(rr.SegmentationImage.columns(buffer=[b"0"]))).component_descriptor()
_BLOB_OF_PNG = next(iter(rr.EncodedImage.columns(blob=[b"0"]))).component_descriptor()


def image_format(shape: tuple[int, ...]) -> rr.components.ImageFormat:
    """One byte a cell, rows and columns as in ``shape``."""
    return rr.components.ImageFormat(
        width=shape[1], height=shape[0], color_model="L", channel_datatype="U8"
    )


def class_images(rows: Sequence[NDArray[np.uint8]]) -> Columns:
    """Pictures (rows, cols) of classes whose place and size were logged once for the entity."""
    flat = np.concatenate([row.ravel() for row in rows])
    return [rr.ComponentColumn(_BUFFER, _Arrow(_blobs(flat, [row.size for row in rows])))]


def _blobs(flat: NDArray[np.uint8], lengths: Sequence[int]) -> pa.Array:
    return pa.ListArray.from_arrays(pa.array(_offsets(lengths)), pa.array(flat), type=_BLOB)


@dataclass(frozen=True, slots=True)
class Patch:
    """A picture of cells with the outer corner of their cell (0, 0) and its side, metres."""

    corner_m: tuple[float, float]
    cell_m: float
    png: Future[bytes]


def patches(rows: Sequence[Patch]) -> Columns:
    """Pictures whose place and size differ from row to row; row 0 lies at the lowest y.

    The scale is written again each time: a transform is taken from one row, whole.
    """
    pngs = [row.png.result() for row in rows]
    flat = np.frombuffer(b"".join(pngs), np.uint8)
    return [
        rr.ComponentColumn(_BLOB_OF_PNG, _Arrow(_blobs(flat, [len(png) for png in pngs]))),
        *rr.Transform3D.columns(
            translation=[[*row.corner_m, 0.0] for row in rows],
            scale=[[row.cell_m] * 3 for row in rows],
        ),
    ]


def float32_values(rows: Sequence[NDArray[np.float32]]) -> Columns:
    """The exact values of a grid or tile, row by row from the lowest y."""
    return [_joined("values", rows)]


def texts(rows: Sequence[str]) -> Columns:
    """Text as markdown; the media type was logged once for the entity."""
    return list(rr.TextDocument.columns(text=rows))


def scalars(rows: Sequence[float]) -> Columns:
    """One number a row, for plots."""
    return list(rr.Scalars.columns(scalars=rows))


def points(rows: Sequence[NDArray[np.float64]]) -> Columns:
    """Points (N, 2), metres; N may differ, and be 0 to take points away."""
    both = np.concatenate(rows).reshape(-1, 2)
    return list(rr.Points2D.columns(positions=both).partition([len(row) for row in rows]))


_STRIPS = next(iter(rr.LineStrips2D.columns(strips=[[[0, 0], [1, 1]]]))).component_descriptor()
_VERTEX = pa.list_(pa.field("item", pa.float32(), nullable=False), 2)
_STRIP = pa.list_(pa.field("item", _VERTEX, nullable=False))


def strips(rows: Sequence[Sequence[NDArray[np.float64]]]) -> Columns:
    """Line strips, each (N, 2) in metres; no strip at all takes lines away."""
    every = [strip for row in rows for strip in row]
    lengths = [len(row) for row in rows]
    vertices = np.concatenate([np.zeros((0, 2)), *every]).astype(np.float32).ravel()
    pairs = pa.FixedSizeListArray.from_arrays(pa.array(vertices), type=_VERTEX)
    offsets = pa.array(_offsets([len(strip) for strip in every]))
    lists = pa.ListArray.from_arrays(offsets, pairs, type=_STRIP)
    return [rr.ComponentColumn(_STRIPS, _Arrow(lists), offsets=_offsets(lengths))]


_LABELS = next(
    each
    for each in rr.LineStrips2D.columns(labels=["a"])
    if "labels" in str(each.component_descriptor())
).component_descriptor()


def labels(rows: Sequence[Sequence[str]]) -> Columns:
    """What each strip of an entity is called, in the order of the strips."""
    every = [label for row in rows for label in row]
    array = _Arrow(pa.array(every, pa.string()))
    return [rr.ComponentColumn(_LABELS, array, offsets=_offsets([len(row) for row in rows]))]


def arrows(rows: Sequence[NDArray[np.float64]]) -> Columns:
    """One arrow a row, as its start and its vector: (2, 2), metres."""
    both = np.stack(rows)
    return list(rr.Arrows2D.columns(origins=both[:, 0], vectors=both[:, 1]))


@dataclass(frozen=True, slots=True)
class BeamRecord:
    """A beam's names, and its numbers (float64) by name."""

    sensor: str
    layer: str
    numbers: dict[str, NDArray[np.float64]]


def beam_records(rows: Sequence[BeamRecord]) -> Columns:
    """Where the robot and the sensor stood and what was read, exactly."""
    return [
        _texts("sensor", [row.sensor for row in rows]),
        _texts("layer", [row.layer for row in rows]),
        *(_joined(name, [row.numbers[name] for row in rows]) for name in rows[0].numbers),
    ]


@dataclass(frozen=True, slots=True)
class LayerRecord:
    """The unit of a layer's values, its update rule, and what a cell holds before any reading."""

    kind: str
    rule: str
    start: float


def layer_records(rows: Sequence[LayerRecord]) -> Columns:
    """What is known of a layer once its first reading was merged."""
    return [
        _texts("kind", [row.kind for row in rows]),
        _texts("rule", [row.rule for row in rows]),
        _joined("start", [np.array([row.start]) for row in rows]),
    ]


def log_records(rows: Sequence[bytes]) -> Columns:
    """What readings did to a layer's values, exactly; see :mod:`replay.rrd.value_log`."""
    return [_joined("history", [np.frombuffer(row, np.uint8) for row in rows])]


def number_records(rows: Sequence[NDArray[Any]]) -> Columns:
    """Numbers of any one type, exactly: a segment, a border's cells, raw points."""
    return [_joined("numbers", rows)]


def notices(rows: Sequence[str]) -> Columns:
    """Lines of a log."""
    return list(rr.TextLog.columns(text=rows, level=["WARN"] * len(rows)))
