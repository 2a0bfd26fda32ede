"""A map in the terminal, drawn with block characters, and a run summed up in a few lines.

Each character shows two squares, one above the other, since characters are about twice as high as
wide. A square covers as many cells as it takes to fit the width, and shows a wall when any of them
is one, so that thin walls stay.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Finished
from mapping.grid import Layer, Window

_UNKNOWN, _FREE, _UNDECIDED, _WALL = range(4)
_PLAIN = {_UNKNOWN: "·", _FREE: " ", _UNDECIDED: "░"}
_NARROWEST, _WIDEST, _GAP = 24, 72, 2  # columns of maps that stand beside each other
_WALLS = {(True, True): "█", (True, False): "▀", (False, True): "▄"}


def picture(
    layer_probability: NDArray[np.floating],
    observed: NDArray[np.bool_] | None = None,
    *,
    width: int = 72,
    threshold: float = 0.55,
) -> str:
    """Probabilities (rows, cols) as lines of at most ``width`` characters, highest y first.

    ``█ ▀ ▄`` are walls (above ``threshold``), a space is free (as far below 0.5), ``░`` was seen
    but is undecided, ``·`` was never seen. Without ``observed``, cells at exactly 0.5 were not.
    """
    probability = np.asarray(layer_probability, np.float64)
    if probability.size == 0:
        return ""
    seen = probability != 0.5 if observed is None else observed
    states = _squares(probability[::-1], (seen & np.isfinite(probability))[::-1], width, threshold)
    upper, lower = states[::2].tolist(), states[1::2].tolist()
    lines = [
        "".join(_character(u, v) for u, v in zip(top, bottom, strict=True))
        for top, bottom in zip(upper, lower, strict=True)
    ]
    return "\n".join(lines)


def pictures_beside(
    maps: Mapping[str, tuple[NDArray[np.floating], NDArray[np.bool_], float]], width: int = 80
) -> str:
    """Several maps (probability, observed, threshold), named, in as many columns as fit.

    All in one scale: a square covers as many cells in each of them, if their grids are alike.
    """
    per_row = min(max((width + _GAP) // (_NARROWEST + _GAP), 1), len(maps))
    each = min((width - _GAP * (per_row - 1)) // per_row, _WIDEST)
    blocks = [
        [name, *picture(p, seen, width=each, threshold=threshold).splitlines()]
        for name, (p, seen, threshold) in maps.items()
    ]
    lines: list[str] = []
    for first in range(0, len(blocks), per_row):
        row = blocks[first : first + per_row]
        lines += [
            (" " * _GAP).join(f"{part[:each]:<{each}}" for part in line).rstrip()
            for line in itertools.zip_longest(*row, fillvalue="")
        ]
        lines.append("")
    return "\n".join(lines[:-1])


def _squares(
    probability: NDArray[np.float64], seen: NDArray[np.bool_], width: int, threshold: float
) -> NDArray[np.int64]:
    """The state of each square, an even number of rows; what is beyond the grid is unknown."""
    rows, cols = probability.shape
    step = -(-cols // max(width, 1))
    padding = ((0, -rows % (2 * step)), (0, -cols % step))
    seen = np.pad(seen, padding)
    shape = (seen.shape[0] // step, step, seen.shape[1] // step, step)
    cells = np.where(seen, np.pad(probability, padding), 0.0).reshape(shape)
    number = seen.reshape(shape).sum(axis=(1, 3))
    mean = cells.sum(axis=(1, 3)) / np.maximum(number, 1)
    states = np.where(mean < 1.0 - threshold, _FREE, _UNDECIDED)
    states = np.where(cells.max(axis=(1, 3)) > threshold, _WALL, states)
    return np.where(number == 0, _UNKNOWN, states)


def _character(upper: int, lower: int) -> str:
    walls = (upper == _WALL, lower == _WALL)
    return _WALLS[walls] if any(walls) else _PLAIN[max(upper, lower)]


def legend(layer: str) -> str:
    """What the characters of a layer's picture mean."""
    return f"layer {layer}: █ wall, blank free, ░ undecided, · never seen"


def map_lines(layer: Layer, finished: Finished) -> list[str]:
    """The part of a layer that was seen, what it shows, and how many readings went into the map."""
    seen = Window.around(layer.observed)
    part = (layer.geometry.whole if seen.empty else seen).slices
    drawn = picture(layer.probability[part], layer.observed[part])
    return [*drawn.splitlines(), legend(layer.name), *summary_lines(finished)]


def summary_lines(finished: Finished) -> list[str]:
    """How many readings went into the map, by sensor, and why others did not, by reason."""
    used = ", ".join(f"{sensor} {number}" for sensor, number in finished.used.items())
    lines = [f"{finished.readings} readings, used: {used or 'none'}"]
    if any(finished.dropped.values()):
        reasons = [f"{reason} {number}" for reason, number in finished.dropped.items() if number]
        lines.append(f"dropped: {', '.join(reasons)}")
    return lines
