"""Where the robot could have seen: what lies beyond is an echo that went astray, not a wall.

A sonar's echo that came back by way of a second wall is longer than the way to the first. It puts a
band behind the wall, and free space in front of that band. Such ghosts have no way to the robot but
through walls, or through gaps in them that no robot fits through.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry, Layer
from mapping.segments.least_squares import FittedLine, FloatArray

Cells = NDArray[np.bool_]
PASSAGE_M = 0.12
FREE_BELOW = 0.3  # faint traces of freedom behind walls lie between this and 0.5

# A line further than this from what is solid, for longer than the second, runs through the open.
_NEAR_CELLS = 2.5
_OPEN_CELLS = 5.0


def reachable_cells(
    layer: Layer,
    positions_m: FloatArray,
    *,
    free_below: float = FREE_BELOW,
    passage_m: float = PASSAGE_M,
) -> Cells:
    """Free cells (rows, cols) that hang together with where the robot was.

    ``positions_m`` (N, 2) are places of the robot, map frame. Free are the cells that were observed
    and whose probability is below ``free_below``. A way leads through them only where a disc of
    diameter ``passage_m`` fits.
    """
    from mapping.kernels.loops import distances, spread

    geometry = layer.geometry
    radius = 0.5 * passage_m / geometry.resolution_m
    free = layer.observed & (layer.probability < np.float32(free_below))
    places = _cells_at(geometry, positions_m)
    if places.any():
        free |= distances(places) <= radius  # the robot's own body went there
    # What lies beyond the grid is as good as free to a disc at its edge.
    inner = distances(~np.pad(free, 1, mode="edge"))[1:-1, 1:-1] >= radius
    core = spread(inner | places, places)
    if not core.any():
        return np.zeros(geometry.shape, np.bool_)
    reachable: Cells = free & (distances(core) <= radius)
    return reachable


def _cells_at(geometry: GridGeometry, positions_m: FloatArray) -> Cells:
    finite = positions_m[np.isfinite(positions_m).all(axis=1)]
    cells = geometry.cells_of(finite)
    cells = cells[geometry.contains(cells)]
    at = np.zeros(geometry.shape, np.bool_)
    at[cells[:, 0], cells[:, 1]] = True
    return at


def cut_where_free(
    lines: list[FittedLine], solid: Cells, reachable: Cells, geometry: GridGeometry
) -> list[FittedLine]:
    """What remains of lines where they run through the open, far from anything ``solid``.

    ``solid`` (rows, cols) are the cells that lines come from. A stretch that lies in ``reachable``
    cells and is longer than a few cells is cut out.
    """
    open_cells = reachable & ~grown(
        solid, _NEAR_CELLS * geometry.resolution_m, geometry.resolution_m
    )
    if not open_cells.any():
        return lines
    kept: list[FittedLine] = []
    for line in lines:
        steps = max(int(2.0 * line.length_m / geometry.resolution_m), 1)
        t = (np.arange(steps) + 0.5) * (line.length_m / steps)
        cells = geometry.cells_of(line.start_m + t[:, None] * line.along)
        inside = geometry.contains(cells)
        bad = np.zeros(steps, np.bool_)
        bad[inside] = open_cells[cells[inside, 0], cells[inside, 1]]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8)))
        step_m = line.length_m / steps
        kept += _remains(
            line,
            [
                (begin * step_m, end * step_m)
                for begin, end in edges.reshape(-1, 2).tolist()
                if end - begin > 2.0 * _OPEN_CELLS
            ],
        )
    return kept


def _remains(line: FittedLine, cuts: list[tuple[float, float]]) -> list[FittedLine]:
    """A line without the stretches (from, to), metres from its start."""
    if not cuts:
        return [line]
    at = (line.points_m - line.start_m) @ line.along
    begins = [0.0, *(cut[1] for cut in cuts)]
    ends = [*(cut[0] for cut in cuts), line.length_m]
    pieces = []
    for begin, end in zip(begins, ends, strict=True):
        mine = (at >= begin) & (at <= end)
        if mine.any() and end > begin:
            start, stop = (line.start_m + t * line.along for t in (begin, end))
            corners = (line.corners[0] and begin == 0.0, line.corners[1] and end == line.length_m)
            points = line.points_m[mine]
            pieces.append(FittedLine(points, points.mean(axis=0), line.along, start, stop, corners))
    return pieces


def grown(cells: Cells, by_m: float, resolution_m: float) -> Cells:
    """The cells and all whose centres lie within ``by_m`` of one of theirs."""
    from mapping.kernels.loops import distances

    if not cells.any():
        return cells.copy()
    near: Cells = distances(cells) <= by_m / resolution_m + 1e-9
    return near
