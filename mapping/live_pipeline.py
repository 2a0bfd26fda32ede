"""The same maps while the messages come in: a stream that knows no end yet.

What a finished session holds beforehand is found on the way: readings wait for their poses, and
the grid grows when a beam leaves it. A grown grid begins a new run of artifacts (a second
:class:`~mapping.artifacts.Started`) with all readings so far merged into it in silence, so the
maps are at each moment those that a finished session would have given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Artifact, Finished
from mapping.config import MappingConfig
from mapping.framing import frame_of
from mapping.grid import GridGeometry, geometry_for
from mapping.layer_map import LayerMap, empty_maps
from mapping.parameters import Sensor
from mapping.pipeline import (
    Trail,
    box_of,
    geometry_of,
    merge,
    raw_lines,
    result_stages,
    started_run,
    stretches,
)
from mapping.placed_session import Counts
from mapping.placer import Placer
from mapping.readings import Readings
from recorder.columns import block_of
from recorder.errors import BadInput
from recorder.messages import Message, Record, topic_of

ROOM_TO_GROW_M = 1.0  # at least so far past what is known, so that the grid grows seldom
LATE = 100  # messages that wait at least when a stream is late: they are taken together


def build_live_maps(
    messages: Iterable[Message],
    config: MappingConfig,
    *,
    walls_m: NDArray[np.float64] | None = None,
    is_late: Callable[[], bool] = lambda: False,
) -> Iterator[Artifact]:
    """Everything that comes about while messages arrive, until they end; then the results.

    ``is_late()``: more messages wait than can be followed, :data:`LATE` at least: readings are then
    merged without their intermediate artifacts, whose place a snapshot takes once the stream has
    caught up. Raises BadInput, at the end, when not one reading could be mapped.
    """
    run, rest, row = _LiveRun(config, walls_m), iter(messages), 0
    for message in rest:
        late = is_late()
        together = [message, *(islice(rest, LATE - 1) if late else ())]
        records = (Record(topic_of(each), each.t_ns, each) for each in together)
        yield from run.take(run.placer.take(block_of(records, row)), quiet=late)
        row += len(together)
    yield from run.take(run.placer.finish(), quiet=False)
    yield from run.finish()


@dataclass(frozen=True, slots=True)
class _Grids:
    """The maps on one grid; they grow with the readings of these sensors."""

    sensors: tuple[Sensor, ...]
    geometry: GridGeometry
    maps: dict[str, LayerMap]
    trail: Trail


class _LiveRun:
    """The grids of a stream, and the readings that made them."""

    def __init__(self, config: MappingConfig, walls_m: NDArray[np.float64] | None) -> None:
        self.placer = Placer(config)
        self._config = config
        self._walls_m = walls_m
        self._readings: list[Readings] = []
        self._grids: _Grids | None = None
        self._skipped = False

    def take(self, readings: Readings, *, quiet: bool) -> Iterator[Artifact]:
        """Merge readings; in a quiet moment nothing of them is shown."""
        if not len(readings):
            return
        self._readings.append(readings)
        grids = self._grids
        if grids is None or not self._holds(grids, readings):
            yield from self._begin_anew()
            return
        every = self._config.rerun.stages_every
        for stretch in stretches([readings], every):
            if self._skipped and not quiet:
                yield from self._results(final=False)
            self._skipped = quiet
            yield from merge(
                stretch, grids.maps, watched=not quiet, rejections=self.placer.rejections
            )
            grids.trail.take(stretch)
            end = stretch.first_number + len(stretch)
            if every and end % every == 0 and not quiet:
                yield from self._results(final=False)

    def finish(self) -> Iterator[Artifact]:
        """The results of all that was merged."""
        if not self._readings:
            why = ", ".join(f"{n} {reason}" for reason, n in self.placer.dropped.items())
            raise BadInput(f"not one reading can be mapped: {why or 'there were none'}")
        yield from self.placer.rejections.before(sum(self.placer.used.values()))
        raw = list(raw_lines(self._readings, self._config))
        yield from self._results(final=True, raw=raw)
        yield from raw
        placer = self.placer
        yield Finished(
            placer.readings, dict(placer.used), placer.dropped, dropped_at=placer.dropped_at
        )

    def _results(self, *, final: bool, raw: Sequence[Artifact] = ()) -> Iterator[Artifact]:
        grids = self._grids
        assert grids is not None
        yield from result_stages(
            grids.sensors, grids.maps, grids.trail, self._config, final=final, raw=raw
        )

    def _holds(self, grids: _Grids, readings: Readings) -> bool:
        """Whether the grid holds the readings, and the maps know the sensors of each of them."""
        if readings.sensors != grids.sensors:
            return False
        if self._config.grid.origin_m is not None or self._config.grid.size_m is not None:
            return True
        low, high = box_of([readings])
        origin = np.array(grids.geometry.origin_m)
        return bool((low >= origin).all() and (high <= origin + grids.geometry.size_m).all())

    def _begin_anew(self) -> Iterator[Artifact]:
        """A grid for all readings so far with room to grow, and they merged into it."""
        sensors, geometry = self._readings[-1].sensors, self._roomy()
        maps = empty_maps(sensors, geometry, self._config.grid)
        grids = _Grids(sensors, geometry, maps, Trail(geometry))
        self._grids = grids
        frame_m = frame_of(self._readings, self._walls_m)
        yield started_run(sensors, self._counts(), geometry, self._walls_m, frame_m)
        for readings in stretches(self._readings, 0):
            yield from merge(readings, grids.maps, watched=False)
            grids.trail.take(readings)
        self._skipped = False
        yield from self._results(final=False)

    def _counts(self) -> Counts:
        times = np.concatenate([readings.t_ns for readings in self._readings])
        placer = self.placer
        return Counts(
            placer.readings, dict(placer.used), placer.dropped, int(times.min()), int(times.max())
        )

    def _roomy(self) -> GridGeometry:
        section = self._config.grid
        if section.origin_m is not None or section.size_m is not None:
            return geometry_of(self._readings, self._config)
        low, high = box_of(self._readings)
        return geometry_for(
            low, high, resolution_m=section.resolution_m,
            margin_m=max(ROOM_TO_GROW_M, float((high - low).max()) / 4.0),
            max_cells=section.max_cells,
        )  # fmt: skip
