"""From probabilities to the few classes that the viewer draws, and outlines from beams.

The viewer colours whole numbers by a table and shows each number's name under the mouse, so that
a cell says "70 % occupied". Few classes also make a small file. The exact values are kept beside
the picture, never read back from it.
"""

from __future__ import annotations

import functools
import math
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from mapping.beams import Beam
from replay.rrd import layout

UNSEEN = 101  # class of a cell that no reading touched; 0 to 100 are per cent
# Edges, in probability, of how strongly a reading speaks: the chapter's finest regions say a
# thousandth, a laser nearly a half.
STRENGTHS = (0.0, 0.002, 0.01, 0.03, 0.1, 0.2)
_LEVELS = len(STRENGTHS)

Named = tuple[int, str, layout.Colour]


def percent_classes(
    probability: NDArray[np.float32], observed: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Per cent of being occupied, to the nearest even one, or ``UNSEEN``; same shape as the input.

    The eye tells no finer shades apart, and every other one saves a seventh of the file.
    """
    percent = 2 * np.rint(probability * np.float32(50)).astype(np.uint8)
    return np.where(observed, percent, np.uint8(UNSEEN))


def percent_names() -> list[Named]:
    """The classes of :func:`percent_classes`: white is free, black is occupied."""
    shades = [(percent, round(255 * (100 - percent) / 100)) for percent in range(0, 101, 2)]
    named: list[Named] = [(p, f"{p} % occupied", (g, g, g, 255)) for p, g in shades]
    return [*named, (UNSEEN, "never seen", layout.NEVER_SEEN)]


def strength_classes(
    difference: NDArray[np.floating], said: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """How far a probability lies above (fuller) or below (emptier) another, in levels.

    0 where nothing is ``said``; 1 to 6 emptier, 7 to 12 fuller, each by rising strength.
    """
    cells = difference[said]
    strength = np.abs(cells)
    level = np.zeros(cells.shape, np.uint8)
    for low in STRENGTHS:
        level += strength >= low
    level[cells > 0] += _LEVELS
    classes = np.zeros(difference.shape, np.uint8)
    classes[said] = level
    return classes


def strength_names() -> list[Named]:
    """The classes of :func:`strength_classes`: red is fuller, blue emptier, by strength."""
    named: list[Named] = [(0, "", (0, 0, 0, 0))]
    for first, word, colour in (
        (1, "emptier", layout.EMPTIER),
        (1 + _LEVELS, "fuller", layout.FULLER),
    ):
        for level in range(_LEVELS):
            low, high = STRENGTHS[level], (*STRENGTHS, 0.5)[level + 1]
            text = f"{word} by {100 * low:g} to {100 * high:g} points"
            alpha = 115 + 120 * level // (_LEVELS - 1)
            named.append((first + level, text, (*colour[:3], alpha)))
    return named


def strength_png(classes: NDArray[np.uint8]) -> bytes:
    """Classes (rows, cols) of :func:`strength_classes` as a PNG in their colours.

    Two cells share a byte, which the viewer undoes; a picture library would take three times as
    long and half as much room again, twice for each reading.
    """
    rows, cols = classes.shape
    lines = np.zeros((rows, 1 + (cols + 1) // 2), np.uint8)  # each begins with "no filter"
    lines[:, 1:] = classes[:, ::2] << 4
    lines[:, 1 : 1 + cols // 2] |= classes[:, 1::2]
    head = struct.pack(">IIBBBBB", cols, rows, 4, 3, 0, 0, 0)
    return b"".join([
        b"\x89PNG\r\n\x1a\n", _chunk(b"IHDR", head), *_palette(),
        _chunk(b"IDAT", zlib.compress(lines.tobytes(), 6)), _chunk(b"IEND", b""),
    ])  # fmt: skip


@functools.cache
def _palette() -> tuple[bytes, bytes]:
    colours = [colour for _, _, colour in strength_names()]
    solid = bytes(channel for colour in colours for channel in colour[:3])
    return _chunk(b"PLTE", solid), _chunk(b"tRNS", bytes(colour[3] for colour in colours))


def _chunk(name: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(name + data)
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", checksum)


def beam_outline(beam: Beam) -> list[NDArray[np.float64]]:
    """Line strips (N, 2), metres, around the part of the map that a reading speaks of.

    A ranger's is its sector out to the range (or the reach when it saw nothing) and the axis; a
    scan's goes through the ends of all its beams.
    """
    origin = np.array([beam.world_from_sensor.x_m, beam.world_from_sensor.y_m])
    ranges = np.where(beam.saw_something, beam.ranges_m, beam.reach_m)
    if len(beam.ranges_m) > 1:
        ends = origin + _polar(ranges, beam.headings_rad)
        return [np.vstack([origin, ends, origin])]
    low, high = beam.spread_rad
    steps = max(2, math.ceil(math.degrees(high - low) / 3) + 1)
    angles = np.linspace(low, high, steps) + beam.world_from_sensor.heading_rad
    arc = origin + _polar(np.full(steps, float(ranges[0])), angles)
    axis = origin + _polar(ranges, beam.headings_rad)
    return [np.vstack([origin, arc, origin]), np.vstack([origin, axis])]


def _polar(ranges_m: NDArray[np.float64], angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([ranges_m * np.cos(angles_rad), ranges_m * np.sin(angles_rad)])
