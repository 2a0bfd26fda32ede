"""The values of one layer, followed through a recording step by step.

A recording holds whole tiles of values (at whole maps, and where readings were left out) and in
between what each reading did. Both are taken in the order of the steps.
"""

from __future__ import annotations

import heapq
import itertools
import operator
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapping.grid import Window
from replay.rrd.value_log.records import LogReader
from replay.rrd.value_log.track import Track

Singles = NDArray[np.float32]
Tiles = list[tuple[Window, Singles]]


@dataclass(frozen=True, slots=True)
class _Event:
    """What one step brings: whole tiles, or what a reading did, or a whole map."""

    tiles: Tiles = field(default_factory=list)
    records: bytes = b""
    whole: bool = False


class Playback:
    """One layer; ``start`` is what it is before any reading.

    ``tiles``, ``records`` and ``whole_maps`` are each in the order of their steps. With ``begin``,
    a whole map's step, all up to it is passed over quickly. Raises ValueLogError where records are
    lost or spoiled.
    """

    def __init__(
        self,
        start: Track,
        tiles: Iterable[tuple[int, Tiles]],
        records: Iterable[tuple[int, bytes]],
        whole_maps: Iterable[int],
        *,
        begin: int = -1,
    ) -> None:
        self.begin, self.step = begin, begin
        self._reader = LogReader(start)
        self._coming = _by_step(tiles, records, whole_maps)
        self._next = next(self._coming, None)
        self.at(begin)

    def at(self, step: int) -> Singles:
        """Values after a step, no earlier than one asked for before; the array is the same one."""
        while self._next is not None and self._next[0] <= step:
            self._take()
        self.step = step
        return self._reader.values

    def steps(self) -> Iterator[tuple[int, Singles]]:
        """Step and values after each step that brought any; the array is the same one."""
        while self._next is not None:
            step, events = self._next
            self._take()
            if any(event.tiles or event.records for event in events):
                yield step, self._reader.values

    def _take(self) -> None:
        if self._next is None:
            return
        step, events = self._next
        for event in events:
            if step <= self.begin:
                self._reader.skip(event.records)
            else:
                self._reader.take(event.records)
            for window, values in event.tiles:
                self._reader.replace(window, values)
        if any(event.whole for event in events):
            self._reader.restart()
        self._next = next(self._coming, None)


def _by_step(
    tiles: Iterable[tuple[int, Tiles]],
    records: Iterable[tuple[int, bytes]],
    whole_maps: Iterable[int],
) -> Iterator[tuple[int, list[_Event]]]:
    streams = (
        ((step, _Event(records=record)) for step, record in records),
        ((step, _Event(tiles=found)) for step, found in tiles),
        ((step, _Event(whole=True)) for step in whole_maps),
    )
    by_step = operator.itemgetter(0)
    for step, events in itertools.groupby(heapq.merge(*streams, key=by_step), key=by_step):
        yield step, [event for _, event in events]
