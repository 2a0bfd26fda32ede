"""The same maps while the messages come in: a stream that knows no end yet.

What a finished session holds beforehand is found on the way: readings wait for their poses, and
the grid grows when a beam leaves it. A grown grid begins a new run of artifacts (a second
:class:`~mapping.artifacts.Started`) with all readings so far merged into it in silence, so the
maps are at each moment those that a finished session would have given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Artifact, Finished
from mapping.beams import Beam
from mapping.config import MappingConfig
from mapping.grid import GridGeometry, geometry_for
from mapping.live_placing import LivePlacer
from mapping.pipeline import empty_maps, geometry_of, raw_lines, result_stages, started_run
from mapping.sensor_model import beam_box_m, make_temp_grid
from mapping.update_rules import MapState
from recorder.errors import BadInput
from recorder.messages import Message

ROOM_TO_GROW_M = 1.0  # at least so far past what is known, so that the grid grows seldom


def build_live_maps(
    messages: Iterable[Message],
    config: MappingConfig,
    *,
    walls_m: NDArray[np.float64] | None = None,
    is_late: Callable[[], bool] = lambda: False,
) -> Iterator[Artifact]:
    """Everything that comes about while messages arrive, until they end; then the results.

    ``is_late()``: more messages wait than can be followed: readings are then merged
    without their intermediate artifacts, whose place a snapshot takes once the stream has caught
    up. Raises BadInput, at the end, when not one reading could be mapped.
    """
    run = _LiveRun(config, walls_m)
    for message in messages:
        yield from run.take(run.placer.take(message), quiet=is_late())
    yield from run.take(run.placer.finish(), quiet=False)
    yield from run.finish()


class _LiveRun:
    """The grids of a stream, and the beams that made them."""

    def __init__(self, config: MappingConfig, walls_m: NDArray[np.float64] | None) -> None:
        self.placer = LivePlacer(config)
        self._config = config
        self._walls_m = walls_m
        self._beams: list[Beam] = []
        self._geometry: GridGeometry | None = None
        self._maps: dict[str, MapState] = {}
        self._skipped = False

    def take(self, beams: list[Beam], *, quiet: bool) -> Iterator[Artifact]:
        """Merge beams; in a quiet moment nothing of them is shown."""
        if not beams:
            return
        if not self._holds(beams):
            self._beams.extend(beams)
            yield from self._begin_anew()
            return
        for beam in beams:
            self._beams.append(beam)
            yield from self._merge(beam, quiet=quiet)

    def finish(self) -> Iterator[Artifact]:
        """The results of all that was merged."""
        if not self._beams:
            why = ", ".join(f"{n} {reason}" for reason, n in self.placer.dropped.items())
            raise BadInput(f"not one reading can be mapped: {why or 'there were none'}")
        placed = self.placer.placed(tuple(self._beams))
        yield from result_stages(placed, self._maps, self._config, final=True)
        yield from raw_lines(placed, self._config)
        yield Finished(placed.readings, placed.used, placed.dropped)

    def _merge(self, beam: Beam, *, quiet: bool) -> Iterator[Artifact]:
        assert self._geometry is not None
        temp = make_temp_grid(beam, self.placer.sensors[beam.sensor], self._geometry)
        merged = self._maps[beam.layer].merge(temp)
        if quiet:
            self._skipped = True
            return
        if self._skipped:
            self._skipped = False
            yield from self._results()
        yield from (beam, temp, merged)
        every = self._config.rerun.stages_every
        if every and (beam.number + 1) % every == 0:
            yield from self._results()

    def _results(self) -> Iterator[Artifact]:
        placed = self.placer.placed(tuple(self._beams))
        yield from result_stages(placed, self._maps, self._config, final=False)

    def _holds(self, beams: list[Beam]) -> bool:
        """Whether the grid holds the beams, and has a layer for each of them."""
        if self._geometry is None or any(beam.layer not in self._maps for beam in beams):
            return False
        if self._config.grid.origin_m is not None or self._config.grid.size_m is not None:
            return True
        low, high = self._box_m(beams)
        origin = np.array(self._geometry.origin_m)
        return bool((low >= origin).all() and (high <= origin + self._geometry.size_m).all())

    def _begin_anew(self) -> Iterator[Artifact]:
        """A grid for all beams so far with room to grow, and they merged into it."""
        placed = self.placer.placed(tuple(self._beams))
        self._geometry = self._roomy(placed.beams)
        self._maps = empty_maps(placed.sensors.values(), self._geometry)
        yield started_run(placed, self._geometry, self._walls_m)
        for beam in placed.beams:
            temp = make_temp_grid(beam, placed.sensors[beam.sensor], self._geometry)
            self._maps[beam.layer].merge(temp)
        yield from result_stages(placed, self._maps, self._config, final=False)

    def _roomy(self, beams: tuple[Beam, ...]) -> GridGeometry:
        section = self._config.grid
        if section.origin_m is not None or section.size_m is not None:
            return geometry_of(self.placer.placed(beams), self._config)
        low, high = self._box_m(beams)
        return geometry_for(
            low, high, resolution_m=section.resolution_m,
            margin_m=max(ROOM_TO_GROW_M, float((high - low).max()) / 4.0),
            max_cells=section.max_cells,
        )  # fmt: skip

    def _box_m(self, beams: Iterable[Beam]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        boxes = [beam_box_m(beam, self.placer.sensors[beam.sensor]) for beam in beams]
        return np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
