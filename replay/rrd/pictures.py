"""From probabilities to the few classes that the viewer draws, and outlines from beams.

The viewer colours whole numbers by a table and shows each number's name under the mouse, so that
one reads "70 % occupied" there. Few classes also make a small file. The exact values are kept
beside the picture, never read back from it.
"""

from __future__ import annotations

import functools
import math
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import MergedGrid, TempGrid
from mapping.beams import Beam
from replay.rrd import layout

UNSEEN = 101  # class of a cell that no reading touched; 0 to 100 are per cent
SLACK = 3.0  # points by which a cell may be drawn off between whole maps
# Edges, in probability, of how strong a reading's evidence is: the chapter's finest regions give
# a thousandth, a laser nearly a half.
STRENGTHS = (0.0, 0.002, 0.01, 0.03, 0.1, 0.2)
_LEVELS = len(STRENGTHS)
_PNG, _BITS, _INDEXED = b"\x89PNG\r\n\x1a\n", 4, 3
_PNG_LEVEL = 6

Named = tuple[int, str, layout.Colour]


def percent_classes(
    probability: NDArray[np.float32], observed: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Per cent of being occupied, to the nearest even one, or ``UNSEEN``; same shape as the input.

    The eye sees no finer shades, and every other one saves a seventh of the file.
    """
    percent = 2 * np.rint(probability * np.float32(50)).astype(np.uint8)
    return np.where(observed, percent, np.uint8(UNSEEN))


def percent_names() -> list[Named]:
    """The classes of :func:`percent_classes`: white is free, black is occupied."""
    shades = [(percent, round(255 * (100 - percent) / 100)) for percent in range(0, 101, 2)]
    named: list[Named] = [(p, f"{p} % occupied", (g, g, g, 255)) for p, g in shades]
    return [*named, (UNSEEN, "never seen", layout.NEVER_SEEN)]


def strength_classes(
    difference: NDArray[np.floating], marked: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """How far a probability lies above (more occupied) or below (more free) another, in levels.

    0 where it is not ``marked``; 1 to 6 more free, 7 to 12 more occupied, each by rising strength.
    """
    from mapping.kernels import loops

    edges = np.array(STRENGTHS, difference.dtype)
    flat = loops.strength_classes(difference.ravel(), marked.ravel(), edges)
    classes: NDArray[np.uint8] = flat.reshape(difference.shape)
    return classes


def strength_names() -> list[Named]:
    """The classes of :func:`strength_classes`: red is more occupied, blue more free."""
    named: list[Named] = [(0, "", (0, 0, 0, 0))]
    for first, word, colour in (
        (1, "more free", layout.MORE_FREE),
        (1 + _LEVELS, "more occupied", layout.MORE_OCCUPIED),
    ):
        for level in range(_LEVELS):
            low, high = STRENGTHS[level], (*STRENGTHS, 0.5)[level + 1]
            text = f"{word} by {100 * low:g} to {100 * high:g} points"
            # The viewer darkens what it lets the map shine through: nothing is very clear.
            alpha = 170 + 70 * level // (_LEVELS - 1)
            named.append((first + level, text, (*colour[:3], alpha)))
    return named


def evidence_png(temp: TempGrid, side: int) -> bytes:
    """The picture of a reading's evidence; see :func:`strength_png`."""
    from mapping.kernels.loops import evidence_by_strength

    probability = np.ascontiguousarray(temp.probability, np.float64)
    edges = np.array(STRENGTHS, np.float64)
    return strength_png(evidence_by_strength(probability, temp.free, temp.band, edges), side)


def change_png(merged: MergedGrid, side: int) -> bytes:
    """The picture of what a reading changed; see :func:`strength_png`."""
    from mapping.kernels.loops import changes_by_strength

    after, before = merged.probability, merged.previous
    return strength_png(changes_by_strength(after, before, np.array(STRENGTHS, after.dtype)), side)


def strength_png(classes: NDArray[np.uint8], side: int) -> bytes:
    """The picture of :func:`strength_classes` (rows, cols), in the colours of their names.

    It has ``side`` rows and columns; what is more than the classes have is transparent. The classes
    are few enough for two cells in a byte: half as much to be packed.
    """
    from mapping.kernels.loops import packed_rows

    colours, alphas = _strength_palette()
    head = struct.pack(">IIBBBBB", side, side, _BITS, _INDEXED, 0, 0, 0)
    pixels = zlib.compress(packed_rows(classes, side), _PNG_LEVEL)
    chunks = ((b"IHDR", head), (b"PLTE", colours), (b"tRNS", alphas), (b"IDAT", pixels))
    return b"".join([_PNG, *(_png_chunk(*each) for each in chunks), _png_chunk(b"IEND", b"")])


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return b"".join([
        len(data).to_bytes(4), kind, data, zlib.crc32(data, zlib.crc32(kind)).to_bytes(4)
    ])  # fmt: skip


@functools.cache
def _strength_palette() -> tuple[bytes, bytes]:
    """Red, green and blue of each class, and how opaque it is."""
    colours = np.array([colour for _, _, colour in strength_names()], np.uint8)
    return colours[:, :3].tobytes(), colours[:, 3].tobytes()


def beam_outline(beam: Beam) -> list[NDArray[np.float64]]:
    """Line strips (N, 2), metres, around the part of the map that a reading is evidence for.

    A ranger's is its sector out to the range (or the reach when it saw nothing) and the axis; a
    scan's goes through the ends of all its beams.
    """
    origin = np.array([beam.world_from_sensor.x_m, beam.world_from_sensor.y_m])
    ranges = beam.far_m
    if len(beam.ranges_m) > 1:
        ends = origin + _polar(ranges, beam.headings_rad)
        return [np.vstack([origin, ends, origin])]
    arc = origin + float(ranges[0]) * _arc(*beam.spread_rad) @ _turned(beam)
    axis = origin + _polar(ranges, beam.headings_rad)
    return [np.vstack([origin, arc, origin]), np.vstack([origin, axis])]


@functools.lru_cache(maxsize=64)
def _arc(low_rad: float, high_rad: float) -> NDArray[np.float64]:
    """Unit vectors (N, 2) from one direction to another, close enough to look round.

    Between two of them the line lies less than a seven-hundredth of the range inside the arc.
    """
    steps = max(2, math.ceil(math.degrees(high_rad - low_rad) / 6) + 1)
    return _polar(np.ones(steps), np.linspace(low_rad, high_rad, steps))


def _turned(beam: Beam) -> NDArray[np.float64]:
    """What turns row vectors as the sensor stands, (2, 2)."""
    heading = beam.world_from_sensor.heading_rad
    c, s = math.cos(heading), math.sin(heading)
    return np.array([[c, s], [-s, c]])


def _polar(ranges_m: NDArray[np.float64], angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([ranges_m * np.cos(angles_rad), ranges_m * np.sin(angles_rad)])
