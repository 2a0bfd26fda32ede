"""The value logs of a run's layers, as rows of its recording; and at which steps they are complete.

A record may wait: for a table that it needs, or, of a reading that is not shown, for the next step
of its layer that is. Records of a layer come in their order, so those behind it wait as well.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import MergedGrid, TempGrid
from mapping.update_rules import rule_of
from mapping.update_rules.pooled import Pooled
from replay.rrd import columns, layout
from replay.rrd.layout import Tiling
from replay.rrd.sink import RowBuffer, Stamp
from replay.rrd.value_log.encoder import LogEncoder
from replay.rrd.value_log.sums import Formula


@dataclass(slots=True)
class _Due:
    """The step at which a reading's record stands; None until it is known."""

    stamp: Stamp | None


@dataclass(slots=True)
class _LayerLog:
    """One layer's encoder, its finished records that wait, and the readings whose step is open."""

    encoder: LogEncoder[_Due]
    waiting: list[tuple[_Due, bytes]] = field(default_factory=list)
    undated: list[_Due] = field(default_factory=list)

    def date(self, stamp: Stamp) -> None:
        """What the readings did that were not shown stands at this step."""
        for due in self.undated:
            due.stamp = stamp
        self.undated.clear()


class ValueLog:
    """Logs what readings do to the layers of one grid; ``rows`` take the records.

    The encoders run in the background; what they made is picked up before rows are sent.
    """

    def __init__(self, rows: RowBuffer, tiling: Tiling) -> None:
        self._rows, self._tiling = rows, tiling
        self._logs: dict[str, _LayerLog] = {}
        self._undated: set[str] = set()
        self._formulas: dict[str, tuple[Pooled, Formula]] = {}
        self._records: deque[tuple[str, Stamp, bytes]] = deque()
        rows.before_sending(self._finish)

    def append(
        self, merged: MergedGrid, temp: TempGrid | None, stamp: Stamp, *, shown: bool
    ) -> None:
        """Log what a reading did to its layer.

        All that the layer held before must be in the file. ``temp`` is its evidence, where it is at
        hand. One that is not ``shown`` has no step of its own.
        """
        self._note(merged.layer, dated=shown)
        if temp is not None and temp.beam is not merged.beam:
            temp = None
        self._rows.background.do(self._append, merged, temp, stamp, shown)
        self._collect()

    def replace(
        self, name: str, tiles: Sequence[tuple[layout.Place, NDArray[np.float32]]], stamp: Stamp
    ) -> None:
        """Write whole tiles of a layer; readings after them are logged from there."""
        if not tiles:
            return
        self._note(name, dated=True)
        for place, values in tiles:
            entity = layout.tile(layout.merged(name), *place)
            self._rows.add_exact(entity, columns.float32_values, stamp, values, values.nbytes)
        self._rows.background.do(self._replace, name, tiles, stamp)

    def restart(self, name: str, stamp: Stamp) -> None:
        """The file holds the whole layer at this step: the log begins anew after it."""
        self._note(name, dated=True)
        self._rows.background.do(self._restart, name, stamp)

    def is_complete(self, name: str) -> bool:
        """Whether the records up to the current step hold all that readings did to a layer."""
        return name not in self._undated

    def _note(self, name: str, *, dated: bool) -> None:
        if dated:
            self._undated.discard(name)
        else:
            self._undated.add(name)

    def _collect(self) -> None:
        """Hand on the records that are ready."""
        while self._records:
            name, stamp, record = self._records.popleft()
            self._rows.add_exact(
                layout.value_log(name), columns.log_records, stamp, record, len(record)
            )

    def _finish(self) -> None:
        """Hand on all records, also those that the encoders held back."""
        self._rows.background.do(self._drain)
        self._rows.background.wait()
        self._collect()

    # What follows runs in the background, in the order of the calls.

    def _append(self, merged: MergedGrid, temp: TempGrid | None, stamp: Stamp, shown: bool) -> None:
        name = merged.layer
        if name not in self._logs:
            rule = rule_of(merged.kind, merged.rule)
            encoder: LogEncoder[_Due] = LogEncoder(
                self._tiling.geometry, merged.kind, rule.start_value, predicts=rule.multiplies_odds
            )
            self._logs[name] = _LayerLog(encoder)
        log, due = self._logs[name], _Due(stamp if shown else None)
        if shown:
            log.date(stamp)
        else:
            log.undated.append(due)
        log.waiting += log.encoder.add(
            merged.window, merged.values, temp, due, self._formula_of(merged)
        )
        self._take_ready(name)

    def _formula_of(self, merged: MergedGrid) -> Formula | None:
        rule = None if merged.sums is None else merged.sums.rule
        if type(rule) is not Pooled:
            return None
        if self._formulas.get(merged.layer, (None, None))[0] is not rule:
            self._formulas[merged.layer] = rule, Formula.of(rule)
        return self._formulas[merged.layer][1]

    def _replace(
        self, name: str, tiles: Sequence[tuple[layout.Place, NDArray[np.float32]]], stamp: Stamp
    ) -> None:
        if name not in self._logs:
            return
        self._logs[name].date(stamp)
        self._drain()
        for place, values in tiles:
            self._logs[name].encoder.replace(self._tiling.window(*place), values)

    def _restart(self, name: str, stamp: Stamp) -> None:
        if name in self._logs:
            self._logs[name].date(stamp)
            self._drain()
            self._logs[name].encoder.restart()

    def _drain(self) -> None:
        """Take what the encoders hold back."""
        for name, log in self._logs.items():
            log.waiting += log.encoder.drain()
            self._take_ready(name)

    def _take_ready(self, name: str) -> None:
        """Records of a layer whose step is known; those after one that is not wait."""
        waiting = self._logs[name].waiting
        while waiting and (stamp := waiting[0][0].stamp) is not None:
            _, record = waiting.pop(0)
            self._records.append((name, stamp, record))
