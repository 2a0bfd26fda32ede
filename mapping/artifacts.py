"""Everything that the mapping stage shows: each intermediate result as one frozen value.

The pipeline yields them in the order in which they come about; exports, the Rerun writer and the
comparison each take what they need. Arrays are read-only. One artifact is one *step* in Rerun.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping.beams import Beam
from mapping.grid import GridGeometry, Layer, Window
from mapping.parameters import Sensor


@dataclass(frozen=True, slots=True)
class TempGrid:
    """The evidence of one reading for each cell, before it is merged into the map.

    All arrays cover ``window``. ``probability`` (float64) is that of being occupied given this
    reading: above 0.5 in the band, below in front of it, 0.5 without evidence. ``band`` are the
    cells where the obstacle may be, ``free`` those that the beam passed through.

    ``sub_grids`` is empty, but for a reading whose samples go straight into the map (``arcs``
    without a second grid): then these, merged one after the other, hold every sample once, and the
    arrays here hold the last sample of each cell.
    """

    beam: Beam
    geometry: GridGeometry
    window: Window
    probability: NDArray[np.float64]
    band: NDArray[np.bool_]
    free: NDArray[np.bool_]
    sub_grids: tuple[TempGrid, ...] = ()

    @property
    def front(self) -> NDArray[np.bool_]:
        """``free`` by its former name, for plugins written before it changed."""
        return self.free


class HasTerms(Protocol):
    """An update rule of several sums a cell."""

    def terms(self, cells: dict[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        """What each sum adds to the log-odds, by name."""


@dataclass(frozen=True, slots=True)
class Sums:
    """What a rule of several sums holds of some of a window's cells, before a reading and after it.


    ``cells`` (N,) are these in ascending order, row times columns of the window plus column; no
    other one changed. Of each array of the rule there are the N numbers. ``rule`` is the update
    rule, whose terms state what each sum adds to the log-odds.
    """

    cells: NDArray[np.int64]
    cols: int
    before: Mapping[str, NDArray[np.float64]]
    after: Mapping[str, NDArray[np.float64]]
    rule: HasTerms

    def changes(self, row: int, col: int) -> tuple[tuple[str, float], ...]:
        """By how much each term of a cell of the window changed, the largest first."""
        cell = row * self.cols + col
        at = int(np.searchsorted(self.cells, cell))
        if at == len(self.cells) or self.cells[at] != cell:
            return ()
        old, new = (
            self.rule.terms({name: array[at : at + 1] for name, array in sums.items()})
            for sums in (self.before, self.after)
        )
        changed = [(name, float(new[name][0] - old[name][0])) for name in new]
        return tuple(sorted((c for c in changed if c[1]), key=lambda c: -abs(c[1])))


@dataclass(frozen=True, slots=True)
class MergedGrid:
    """The map of one layer after a reading, in the rectangle that the reading could change.

    ``values`` and ``probability`` (float32) are the new ones; ``previous`` the probability before.
    ``sums`` is there where the rule keeps several.
    """

    beam: Beam
    layer: str
    rule: str
    kind: str
    geometry: GridGeometry
    window: Window
    values: NDArray[np.float32]
    probability: NDArray[np.float32]
    previous: NDArray[np.float32]
    sums: Sums | None = None


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A whole layer: at the chosen interval, and at the end (``final``)."""

    layer: Layer
    rule: str
    final: bool


@dataclass(frozen=True, slots=True)
class Thresholded:
    """Which cells of a layer are taken as occupied: probability strictly above the threshold."""

    layer: str
    geometry: GridGeometry
    threshold: float
    occupied: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Classes:
    """Where the sensors agree, where one alone has evidence, where they contradict each other.

    ``codes`` (rows, cols) uint8 index ``names``.
    """

    geometry: GridGeometry
    codes: NDArray[np.uint8]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Border:
    """One closed border: ``cells`` (N, 2) as row, col in trace order, the first not repeated."""

    layer: str
    number: int
    outer: bool
    geometry: GridGeometry
    cells: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class RawPoints:
    """The obstacle points of one sensor, (N, 2), metres, map frame, with the time of each."""

    layer: str
    points_m: NDArray[np.float64]
    t_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Segment:
    """A straight piece of wall: the line x cos(alpha) + y sin(alpha) = rho between two ends.

    ``covariance`` (2, 2) is that of (rho_m, alpha_rad); ``rms_m`` the distance of its ``points``
    points from it. ``border`` is the number of the border that it was fitted to, or None for raw
    points. ``source`` is which: ``raw`` or ``grid``.
    """

    layer: str
    source: str
    border: int | None
    start_m: tuple[float, float]
    end_m: tuple[float, float]
    rho_m: float
    alpha_rad: float
    covariance: NDArray[np.float64]
    rms_m: float
    points: int

    @property
    def length_m(self) -> float:
        """Distance between the ends, metres."""
        (x0, y0), (x1, y1) = self.start_m, self.end_m
        return float(np.hypot(x1 - x0, y1 - y0))


@dataclass(frozen=True, slots=True)
class TracerStep:
    """The tracer at one cell of a border: where it looked, and where it goes next.

    ``cells`` (K, 2) are those that it has passed, as row, col, the present one last. ``tried`` are
    the neighbours that it looked at in turn; ``following`` the last of them, unless there is none.
    """

    layer: str
    border: int
    geometry: GridGeometry
    cells: NDArray[np.int64]
    tried: NDArray[np.int64]
    following: tuple[int, int] | None


@dataclass(frozen=True, slots=True)
class LineStage:
    """Something done on the way to a layer's lines: one thing, or all of its kind together.

    ``kind`` is ``split``, ``merge``, ``fit``, ``corner``, ``move`` or ``drop``. ``pieces_m``
    (K, 2, 2) are the pieces that it was done to, as two ends; ``places_m`` (M, 2) where: cuts,
    joints, crossings; ``sizes`` (K,) what decided: metres from the chord, cost over what is
    allowed, rms in metres, metres that a line moved.
    """

    layer: str
    source: str
    kind: str
    pieces_m: NDArray[np.float64]
    places_m: NDArray[np.float64]
    sizes: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Started:
    """The first artifact of a run: the grid, the layers and the walls, where they are known.

    ``frame_m`` (2, 2) are the corners (low, high) of the part worth looking at, as far as it is
    known: the path and what was measured, without the few readings that went astray.
    """

    geometry: GridGeometry
    layers: tuple[str, ...]
    walls_m: NDArray[np.float64]  # (K, 2, 2): K walls, two ends, x and y; K = 0 when unknown
    first_t_ns: int
    last_t_ns: int
    beam_widths_rad: Mapping[str, float] = field(default_factory=dict)  # by layer
    sensors: tuple[Sensor, ...] = ()
    frame_m: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class RejectedReading:
    """A reading that a filter left out: it is on no map.

    ``beam.number`` is that of the next reading that is mapped. ``filter`` looked at ``of`` readings
    and expected ``expected_m`` (+Inf: to see nothing).
    """

    beam: Beam
    reason: str
    expected_m: float
    filter: str
    of: int


@dataclass(frozen=True, slots=True)
class DroppedReadings:
    """When a sensor's readings were dropped for one reason, (N,) nanoseconds, in order."""

    sensor: str
    reason: str
    t_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Finished:
    """The last artifact of a run: how many readings went in, and why the others did not."""

    readings: int
    used: Mapping[str, int]  # by sensor
    dropped: Mapping[str, int]  # by reason
    notes: tuple[str, ...] = ()  # what was taken otherwise than it came, or assumed
    dropped_at: tuple[DroppedReadings, ...] = field(default=(), compare=False)


Artifact = (
    Started
    | Beam
    | TempGrid
    | MergedGrid
    | RejectedReading
    | Snapshot
    | Thresholded
    | Classes
    | Border
    | RawPoints
    | TracerStep
    | LineStage
    | Segment
    | Finished
)
