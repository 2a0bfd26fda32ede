"""Border following on a grid, eight-connected, in a single pass over the cells.

The grid is copied into bytes with white all around: bit 1 of a byte: the cell is occupied,
bit 2 that the crack on its west side (the cell and its white west neighbour) belongs to a border
that has been traced. Marking cracks and not cells is what finds the holes of one-cell walls.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Directions 0 .. 7 run counter-clockwise from east; rows grow upwards.
_ROW_STEP = np.array([0, 1, 1, 1, 0, -1, -1, -1], np.int64)
_COL_STEP = np.array([1, 1, 0, -1, -1, -1, 0, 1], np.int64)
# Where the search around the next cell starts, for each direction in which it was entered.
_NEXT_SEARCH = np.array([7, 7, 1, 1, 3, 3, 5, 5], np.int64)

_PAD = 8  # white bytes before the first row, so that no neighbour has a negative index
_BLACK, _WEST_DONE, _VISITED = 1, 2, 4

Bytes = NDArray[np.uint8]
Cells = NDArray[np.int64]


@njit(cache=True)
def _padded(occupied: Bytes, filled: Bytes) -> tuple[Bytes, int]:
    """The grid as bytes with white around it, and the length of a row (a multiple of 8).

    ``filled`` (rows,) marks which rows hold anything: the others are not even looked at.
    """
    rows, cols = occupied.shape
    stride = (cols // 8 + 1) * 8  # at least one white byte ends a row: the west of the next one
    cells = np.zeros((rows + 2) * stride + 2 * _PAD, np.uint8)
    for row in range(rows):
        if filled[row]:
            start = _PAD + (row + 1) * stride
            cells[start : start + cols] = occupied[row]
    return cells, stride


@njit(cache=True)
def _follow(
    cells: Bytes, stride: int, row: int, col: int, out: Cells, n: int, stop_at_start: bool
) -> tuple[Cells, int]:
    """One border from its first cell, whose west is white, appended to ``out`` at ``n``.

    It closes when the first *move* comes again; ``stop_at_start``: when the first cell does.
    """
    step = _ROW_STEP * stride + _COL_STEP
    first = at = _PAD + (row + 1) * stride + col
    second = -1
    search = 5  # entered as if in direction 7; west, the direction before 5, is white
    while True:
        if search == 5:
            cells[at] |= _WEST_DONE
        direction = search
        for _ in range(8):
            if cells[at + step[direction]]:
                break
            if direction == 4:
                cells[at] |= _WEST_DONE
            direction = (direction + 1) & 7
        else:
            direction = -1  # a single cell
        ahead = at if direction < 0 else at + step[direction]
        if second >= 0 and at == first and (stop_at_start or ahead == second):
            return out, n
        if n == out.shape[0]:
            grown = np.empty((2 * n, 2), np.int64)
            grown[:n] = out
            out = grown
        out[n, 0], out[n, 1] = row, col
        cells[at] |= _VISITED
        n += 1
        if direction < 0:
            return out, n
        if second < 0:
            second = ahead
        row += _ROW_STEP[direction]
        col += _COL_STEP[direction]
        at = ahead
        search = _NEXT_SEARCH[direction]


@njit(cache=True)
def closed_borders(occupied: Bytes, filled: Bytes) -> tuple[Cells, list[int], list[bool]]:
    """All borders: cells of all of them (N, 2) as row, col; where each ends; which are outer.

    ``occupied`` (rows, cols) holds 0 and 1, ``filled`` (rows,) which rows hold any 1.
    The scan runs from the highest row down and from west to east. The first crack that it meets of
    a border has black to its north-west when the border is that of a hole (what is white there has
    nothing white above it), and white when it is an outer one.
    """
    cells, stride = _padded(occupied, filled)
    words = cells.view(np.uint64)  # 8 cells at once, the western one in the lowest byte
    black_bits = np.uint64(0x0101010101010101)
    one, eight, most = np.uint64(1), np.uint64(8), np.uint64(56)
    out = np.empty((max(occupied.size // 16, 64), 2), np.int64)
    n = 0
    ends, outer = [0 for _ in range(0)], [True for _ in range(0)]
    for row in range(occupied.shape[0] - 1, -1, -1):
        if filled[row] == 0:
            continue
        start = _PAD + (row + 1) * stride
        carry = np.uint64(0)
        for k in range(start // 8, (start + stride) // 8):
            word = words[k]
            if word == 0:
                carry = word
                continue
            black = word & black_bits
            fresh = black & ~((black << eight) | carry) & ~(word >> one)
            carry = black >> most
            if fresh == 0:
                continue
            for at in range(8 * k, 8 * k + 8):
                if (cells[at] & (_BLACK | _WEST_DONE)) == _BLACK and cells[at - 1] == 0:
                    outer.append(cells[at + stride - 1] == 0)
                    out, n = _follow(cells, stride, row, at - start, out, n, False)
                    ends.append(n)
    return out[:n], ends, outer


@njit(cache=True)
def chapter_borders(occupied: Bytes, filled: Bytes) -> tuple[Cells, list[int], list[bool]]:
    """The same by the chapter's rules: stop at the first cell, start at cells of no border yet.

    Single cells are left out, as it advises. A border counts as outer when it runs round its cells
    counter-clockwise (twice the signed area is not negative).
    """
    cells, stride = _padded(occupied, filled)
    out = np.empty((max(occupied.size // 16, 64), 2), np.int64)
    n = 0
    ends, outer = [0 for _ in range(0)], [True for _ in range(0)]
    for row in range(occupied.shape[0] - 1, -1, -1):
        if filled[row] == 0:
            continue
        start = _PAD + (row + 1) * stride
        for at in range(start, start + occupied.shape[1]):
            if cells[at] == 0 or cells[at] & _VISITED or cells[at - 1]:
                continue
            before = n
            out, n = _follow(cells, stride, row, at - start, out, n, True)
            if n == before + 1:
                n = before
                continue
            area = 0
            for i in range(before, n):
                j = i + 1 if i + 1 < n else before
                area += out[i, 1] * out[j, 0] - out[j, 1] * out[i, 0]
            outer.append(area >= 0)
            ends.append(n)
    return out[:n], ends, outer
