"""The slow, obvious way: which cells a ray passes, and how often walls outrank free cells."""

from __future__ import annotations

import math


def cells_on(shape, start, heading_rad, reach, *, touched_too=False):
    """Cells that a ray passes through, as {(row, col): (entered, left)}, by clipping each cell.

    ``touched_too``: those as well that it only touches.
    """
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    found = {}
    for row in range(shape[0]):
        for col in range(shape[1]):
            first, last = 0.0, reach
            for at, way, low in ((start[0], c, col), (start[1], s, row)):
                if abs(way) < 1e-12:
                    if not low <= at < low + 1 and not (touched_too and at == low + 1):
                        first, last = 1.0, 0.0
                    continue
                one, other = (low - at) / way, (low + 1 - at) / way
                first, last = max(first, min(one, other)), min(last, max(one, other))
            if last > first or (touched_too and last > first - 1e-9):
                found[row, col] = (first, last)
    return found


def seen_on(walls, start, heading_rad, reach):
    """Of those, the ones up to the first wall cell, which is seen too."""
    passed = cells_on(walls.shape, start, heading_rad, reach)
    stop = min((first for cell, (first, _) in passed.items() if walls[cell]), default=math.inf)
    return {cell for cell, (first, _) in passed.items() if first <= stop}


def outranked(free, walls):
    """The share of pairs in which the wall cell has the higher probability, ties half."""
    points = sum(1.0 if w > f else 0.5 if w == f else 0.0 for f in free for w in walls)
    return points / (len(free) * len(walls))
