"""When two maps part: the first reading of two sessions, or the first step of two recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from mapping.artifacts import Artifact, MergedGrid
from mapping.beams import Beam
from mapping.update_rules import rule_of
from replay.diff.alignment import common_grid, padded
from replay.diff.cells import beyond, distances
from replay.diff.layers import History, MapLayer, Moment, Values


@dataclass(frozen=True, slots=True)
class Readings:
    """One reading of a run and what the map held afterwards where it could change."""

    beam: Beam
    merged: MergedGrid


@dataclass(frozen=True, slots=True)
class ReceivedReading:
    """What a reading was: its sensor, its own time, and its (nearest) range in metres."""

    sensor: str
    t_ns: int
    since_start_s: float
    range_m: float | None  # None: it saw nothing
    world_from_sensor: tuple[float, float, float]  # x_m, y_m, heading_rad


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first reading, counted from 0, after which two maps differ; None: that side had ended."""

    reading: int
    layer: str
    a: ReceivedReading | None
    b: ReceivedReading | None


@dataclass(frozen=True, slots=True)
class StepDivergence:
    """The first step at which two recordings, or the values of one, part."""

    layer: str
    row: int  # row and col in A's own grid, x and y the cell's centre
    col: int
    x_m: float
    y_m: float
    a: Moment
    b: Moment
    a_value: float
    b_value: float


def readings_of(artifacts: Iterable[Artifact]) -> Iterator[Readings]:
    """The readings of a run, each with what it changed; the rest of the run goes by."""
    beam: Beam | None = None
    for artifact in artifacts:
        if isinstance(artifact, Beam):
            beam = artifact
        elif isinstance(artifact, MergedGrid) and beam is not None:
            yield Readings(beam, artifact)


class _Growing:
    """The maps of one run as far as it went."""

    def __init__(self) -> None:
        self.first_t_ns: int | None = None
        self._grids: dict[str, Values] = {}

    def take(self, reading: Readings) -> None:
        merged = reading.merged
        if self.first_t_ns is None:
            self.first_t_ns = reading.beam.t_ns
        self.grid(merged)[merged.window.slices] = merged.values

    def grid(self, merged: MergedGrid) -> Values:
        if merged.layer not in self._grids:
            start = rule_of(merged.kind, merged.rule).start_value
            self._grids[merged.layer] = np.full(merged.geometry.shape, start, np.float32)
        return self._grids[merged.layer]

    def received(self, reading: Readings | None) -> ReceivedReading | None:
        if reading is None:
            return None
        beam, first = reading.beam, self.first_t_ns
        ranges = beam.ranges_m[np.isfinite(beam.ranges_m)]
        at = beam.world_from_sensor
        return ReceivedReading(
            beam.sensor, beam.t_ns, (beam.t_ns - (first or beam.t_ns)) / 1e9,
            float(ranges.min()) if ranges.size else None, (at.x_m, at.y_m, at.heading_rad),
        )  # fmt: skip


def walk_in_step(
    a: Iterator[Readings],
    b: Iterator[Readings],
    tolerance: float,
    *,
    progress: Callable[[int, int], None] | None = None,
    total: int = 0,
) -> Divergence | None:
    """Run two maps on one grid reading by reading, to the end; None where they never part."""
    left, right = _Growing(), _Growing()
    found: Divergence | None = None
    for number, (one, other) in enumerate(zip_longest(a, b)):
        if progress is not None and number % 50 == 0:
            progress(number, total)
        if found is not None:
            continue
        for side, reading in ((left, one), (right, other)):
            if reading is not None:
                side.take(reading)
        for reading in (one, other):
            if reading is not None and _part(left, right, reading.merged, tolerance):
                layer = reading.merged.layer
                found = Divergence(number, layer, left.received(one), right.received(other))
                break
    return found


def _part(left: _Growing, right: _Growing, merged: MergedGrid, tolerance: float) -> bool:
    """Whether the two differ where a reading could change them: elsewhere they did not before."""
    here = merged.window.slices
    away = distances(left.grid(merged)[here], right.grid(merged)[here])
    return bool(beyond(away, tolerance).any())


def part_at_step(
    a: History, b: History, layers: Mapping[str, tuple[MapLayer, MapLayer]], tolerance: float
) -> StepDivergence | None:
    """The first step, exact in both recordings, at which any of their layers differ."""
    found = [_layer_parts(a, b, *pair, tolerance) for pair in layers.values()]
    parted = [each for each in found if each is not None]
    return min(parted, key=lambda each: each.a.step, default=None)


def _layer_parts(
    a: History, b: History, left: MapLayer, right: MapLayer, tolerance: float
) -> StepDivergence | None:
    geometry, at_a, at_b = common_grid(left.geometry, right.geometry, f"layer {left.name}")
    for (moment_a, grid_a), (moment_b, grid_b) in _together(
        a.grids(left.name), b.grids(right.name)
    ):
        one = padded(grid_a, geometry, at_a, left.start)
        other = padded(grid_b, geometry, at_b, right.start)
        away = distances(one, other)
        if beyond(away, tolerance).any():
            row, col = (int(v) for v in np.unravel_index(int(np.argmax(away)), away.shape))
            x_m, y_m = geometry.centres_of(np.array([[row, col]]))[0].tolist()
            return StepDivergence(
                left.name, row - at_a[0], col - at_a[1], x_m, y_m, moment_a, moment_b,
                float(one[row, col]), float(other[row, col]),
            )  # fmt: skip
    return None


def _together(
    a: Iterator[tuple[Moment, Values]], b: Iterator[tuple[Moment, Values]]
) -> Iterator[tuple[tuple[Moment, Values], tuple[Moment, Values]]]:
    """The entries of both that are of one step; each stream is in the order of its steps."""
    one, other = next(a, None), next(b, None)
    while one is not None and other is not None:
        if one[0].step == other[0].step:
            yield one, other
            one, other = next(a, None), next(b, None)
        elif one[0].step < other[0].step:
            one = next(a, None)
        else:
            other = next(b, None)
