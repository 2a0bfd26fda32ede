"""Of which cells anything was said: a bit a cell, small enough to stay in the nearest cache.

Log-odds that are not 0 tell so themselves: where a kernel adds whole steps, only cells that became
0 are noted, and ``mark_changed`` marks the others at the end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import inlined_loop, loop

Bits = NDArray[np.uint64]
Columns = NDArray[np.int32]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]
Box = tuple[int, int, int, int]  # first row, row after the last, the same of columns

_ALL: Any = np.uint64(0xFFFFFFFFFFFFFFFF)
_LAST, _ONE, _NONE = np.uint64(63), np.uint64(1), np.uint64(0)


@loop
def blank_seen(rows: int, cols: int, part: int, parts: int) -> Bits:
    """No cell yet of the rows part, part + parts, ...: row k is row part + k parts."""
    return np.zeros(((rows - part + parts - 1) // parts, cols // 64 + 1), np.uint64)


@inlined_loop
def _mark_run(seen: Bits, row: int, first: int, after: int) -> None:
    """The cells first to after - 1, if any. Rows are short, so without branches: both ends are
    marked, whether or not they lie in the same word."""
    last = after - 1 if after > first else first
    left, right = _ALL << (np.uint64(first) & _LAST), _ALL >> (_LAST - (np.uint64(last) & _LAST))
    right = right if after > first else _NONE
    word, end, line = np.uint64(first >> 6), np.uint64(last >> 6), np.uint64(row)
    is_one = word == end
    seen[line, word] |= left & (right if is_one else _ALL)
    seen[line, end] |= right & (left if is_one else _ALL)
    for between in range(word + _ONE, end):
        seen[line, between] = _ALL


@inlined_loop
def mark(seen: Bits, row: int, a: int, f: int, g: int, b: int, with_free: bool) -> None:
    """Note a row's cells a to b - 1, without its front f to g - 1 where that says nothing."""
    if with_free:
        _mark_run(seen, row, a, b)
    else:
        _mark_run(seen, row, a, f)
        _mark_run(seen, row, g, b)


@loop
def mark_rows(
    seen: Bits, first: int, rows: int, shift: int, spans: Columns, with_free: bool
) -> None:
    """Note the spans (4, rows) of some rows, that begin at row ``first`` and column ``shift``."""
    for k in range(rows):
        a, f, g, b = spans[0, k], spans[1, k], spans[2, k], spans[3, k]
        mark(seen, first + k, a - shift, f - shift, g - shift, b - shift, with_free)


@loop
def mark_seen(seen: Bits, observed: Flags, part: int, parts: int) -> None:
    """Mark in ``observed`` (rows, cols) what was noted."""
    _rows, cols = observed.shape
    for k in range(seen.shape[0]):
        row = part + k * parts
        for w in range(seen.shape[1]):
            word = seen[k, w]
            if word == 0:
                continue
            first = w * 64
            for u in range(min(64, cols - first)):
                observed[row, first + u] |= (word >> np.uint64(u)) & _ONE != 0


@inlined_loop
def no_box() -> Box:
    """A box without a cell, to begin with."""
    return 1 << 60, -(1 << 60), 1 << 60, -(1 << 60)


@inlined_loop
def around(one: Box, other: Box) -> Box:
    """The box around two boxes."""
    return (min(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]),
            max(one[3], other[3]))  # fmt: skip


@loop
def mark_changed(
    cells: Steps, observed: Flags, box: Box, row0: int, col0: int, part: int, parts: int
) -> None:
    """Mark the cells of a box that are not 0; the array's first cell is (row0, col0).

    Of its rows only part, part + parts, ...
    """
    rows, cols = observed.shape
    first, after = max(box[2] - col0, 0), min(box[3] - col0, cols)
    if after <= first:
        return
    top = max(box[0] - row0, 0)
    for row in range(top + (part - top) % parts, min(box[1] - row0, rows), parts):
        own, flags = cells[row], observed[row]
        for c in range(np.uint64(first), np.uint64(after)):
            flags[c] |= own[c] != 0
