"""What came of a run, as text at its end, and the readings that matter, as a list to jump by.

A reading matters that moved many cells, or that the finished map contradicts: one of the two is
wrong. Each line of the list lies at its own reading, so that a click on its step goes there.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mapping.artifacts import (
    Artifact,
    Classes,
    Finished,
    MergedGrid,
    Segment,
    Snapshot,
    Started,
)
from mapping.beams import Beam
from mapping.fusion import FUSED
from mapping.grid import Layer
from mapping.prediction import THROUGH, Contradiction, RangePredictor
from replay.colours import in_place
from replay.rrd import columns, layout
from replay.rrd.canvas import Canvas
from replay.rrd.sink import Stamp

LISTED = 20  # readings in the list, half of them for each reason
_KEPT = 20_000  # readings that are held against the finished map; of more, every other one
_MOVED = 0.1  # of probability: a cell that moved so far was moved
_NAMED = 3  # readings that the text itself names


@dataclass(frozen=True, slots=True)
class _Read:
    """A reading, and where it is in the recording."""

    stamp: Stamp
    beam: Beam
    shown: bool


@dataclass(frozen=True, slots=True)
class Judged:
    """A reading that the finished map contradicts."""

    read: _Read
    how: Contradiction


class OutcomeOverlay:
    """Follows a run beside its ``predictor``, which takes each artifact before it."""

    def __init__(self, predictor: RangePredictor, threshold: float) -> None:
        self._predictor, self._threshold = predictor, threshold
        self._maps: dict[str, Layer] = {}
        self._reads: list[_Read] = []
        self._every = 1
        self._moved: list[tuple[int, int, _Read]] = []  # a heap: the least is the first
        self._lines: list[Segment] = []
        self._contradicting_cells = 0
        self._newest: _Read | None = None
        self._layers: tuple[str, ...] = ()

    def start(self, canvas: Canvas, started: Started) -> None:
        """Know the layers."""
        self._layers = tuple(in_place(started.layers))

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """Note one artifact; at the end write the list, and return what came out."""
        match artifact:
            case Beam():
                self._lines.clear()  # those of a stage before it
                self._newest = _Read(canvas.stamp, artifact, shown)
                self._keep(self._newest)
            case MergedGrid():
                self._note(artifact)
            case Segment():
                self._lines.append(artifact)
            case Snapshot():
                self._maps[artifact.layer.name] = artifact.layer
                if artifact.layer.name == FUSED:
                    return lost_in_fusion(self._maps, artifact.rule, self._threshold)
            case Classes():
                contradict = [i for i, name in enumerate(artifact.names) if name == "contradict"]
                self._contradicting_cells = int(np.isin(artifact.codes, contradict).sum())
            case Finished():
                return self._finish(canvas, sum(artifact.used.values()))
        return ""

    def _keep(self, read: _Read) -> None:
        if read.beam.number % self._every == 0:
            self._reads.append(read)
        if len(self._reads) > _KEPT:
            self._every *= 2
            self._reads = [each for each in self._reads if each.beam.number % self._every == 0]

    def _note(self, merged: MergedGrid) -> None:
        """Keep the readings that moved most cells."""
        if self._newest is None or not self._newest.shown:
            return
        moved = int((np.abs(merged.probability - merged.previous) > _MOVED).sum())
        entry = (moved, -merged.beam.number, self._newest)
        if moved and len(self._moved) < LISTED:
            heapq.heappush(self._moved, entry)
        elif moved and entry[:2] > self._moved[0][:2]:
            heapq.heapreplace(self._moved, entry)

    def _finish(self, canvas: Canvas, used: int) -> str:
        judged = [
            Judged(read, how)
            for read in self._reads
            if (how := self._predictor.contradiction(read.beam)) is not None
        ]
        judged.sort(key=lambda each: -each.how.weight)
        self._list(canvas, judged)
        parts = [self._walls(), self._contradictions(judged, used), self._next(judged)]
        return "\n\n".join(filter(None, parts))

    def _list(self, canvas: Canvas, judged: Sequence[Judged]) -> None:
        wrong = [each for each in judged if each.read.shown][: LISTED // 2]
        movers = sorted(self._moved, reverse=True)[: LISTED - len(wrong)]
        lines = [(each.read.stamp, (_contradiction_text(each), "WARN")) for each in wrong]
        lines += [
            (read.stamp, (_moved_text(read.beam, moved), "INFO")) for moved, _, read in movers
        ]
        for stamp, (text, level) in sorted(lines, key=lambda each: each[0].step):
            line = f"step {stamp.step}: {text}", level  # the viewer's own column is often too thin
            canvas.rows.add(layout.MATTERS, columns.log_lines, stamp, line, len(line[0]))

    def _walls(self) -> str:
        """How many lines there are in each map, and the longest of all."""
        if not self._lines:
            return "**No walls** were found: too few cells are above the threshold."
        of = Counter((line.layer, line.source) for line in self._lines)
        shown = max(self._layers, key=lambda layer: (of[layer, "grid"] > 0, layer == FUSED))
        source = "grid" if of[shown, "grid"] else "raw"
        mine = [line for line in self._lines if (line.layer, line.source) == (shown, source)]
        if not mine:
            mine = self._lines
        longest = max(mine, key=lambda line: line.length_m)
        (x0, y0), (x1, y1) = longest.start_m, longest.end_m
        text = (
            f"**{len(mine)} walls** in the map {mine[0].layer} (magenta), "
            f"{sum(line.length_m for line in mine):.2f} m together. The longest: "
            f"**{longest.length_m:.2f} m**, from ({x0:.2f}, {y0:.2f}) to ({x1:.2f}, {y1:.2f}) m."
        )
        others = [
            f"{layer} {of[layer, 'grid']}" for layer in self._layers if layer != mine[0].layer
        ]
        return f"{text} In the other maps: {', '.join(others)}." if others else text

    def _contradictions(self, judged: Sequence[Judged], used: int) -> str:
        """How many readings the finished map contradicts, by sensor, and the worst of them."""
        total = Counter(read.beam.sensor for read in self._reads)
        if not total:
            return ""
        bad = Counter(each.read.beam.sensor for each in judged)
        through = Counter(e.read.beam.sensor for e in judged if e.how.kind == THROUGH)
        held = sum(total.values())
        of = f" ({held:,} of {used:,} were held against it)" if held < used else ""
        head = (
            f"**{len(judged):,} of {held:,} readings contradict the finished map of "
            f"their sensor**{of}: they saw something where it has nothing, or looked through its "
            "walls."
        )
        if not judged:
            return f"No reading contradicts the finished map{of}."
        of_each = "; ".join(
            f"{name} {bad[name]:,} of {total[name]:,}, {through[name]:,} of them through a wall"
            for name in in_place(total)
        )
        worst = [each for each in judged if each.read.shown][:_NAMED]
        listed = [f"- step {each.read.stamp.step}: {_contradiction_text(each)}" for each in worst]
        return "\n\n".join([f"{head} {of_each}.", "The worst:", "\n".join(listed)])

    def _next(self, judged: Sequence[Judged]) -> str:
        """Where to look now."""
        hints = []
        if judged or self._moved:
            hints.append(
                f"*The readings that matter* (below): up to {LISTED}, each a click on its step away"
            )
        if self._contradicting_cells:
            hints.append(
                f"*{layout.CLASSES_TITLE}*: {self._contradicting_cells:,} cells in which the "
                "sensors contradict each other, in red"
            )
        hints.append(
            f"*{layout.KEPT_TITLE}*: what the lines were fitted to, and the path, over the maps"
        )
        return "**What to look at next**\n\n" + "\n".join(f"- {hint}" for hint in hints)


def lost_in_fusion(maps: Mapping[str, Layer], rule: str, threshold: float) -> str:
    """Which occupied cells of one layer the fused map does not hold as occupied, and why."""
    fused, lines = maps[FUSED], []
    for name in in_place(maps):
        mine = maps[name]
        lost = mine.observed & (mine.probability > threshold) & (fused.probability <= threshold)
        total, count = int((mine.observed & (mine.probability > threshold)).sum()), int(lost.sum())
        if name == FUSED or not count:
            continue
        against = {
            other: int((lost & layer.observed & (layer.probability < 0.5)).sum())
            for other, layer in maps.items() if other not in (name, FUSED)
        }  # fmt: skip
        other = max(against, key=lambda each: against[each])
        why = f"{other} saw {against[other]:,} of them free"
        how = (
            "and its evidence there is the stronger: the log-odds of both are added"
            if rule == "bayes"
            else "and the weighted mean of both lies below the threshold"
        )
        lines.append(f"- **{count:,} of {total:,}** that {name} holds occupied: {why}, {how}.")
    if not lines:
        return ""
    return "Occupied in one map, and not in the fused one:\n\n" + "\n".join(lines)


def _contradiction_text(judged: Judged) -> str:
    beam, how = judged.read.beam, judged.how
    part = f" in {how.share:.0%} of its beams" if len(beam.ranges_m) > 1 else ""
    head = f"reading {beam.number}, {beam.sensor} measured {_metres(beam, how)}{part}"
    if how.kind == THROUGH:
        return f"{head}, through a wall of the map at {how.expected_m:.2f} m"
    if math.isinf(how.expected_m):
        return f"{head}, and the map has nothing in its beam"
    return f"{head}, and the map has nothing nearer than {how.expected_m:.2f} m"


def _metres(beam: Beam, how: Contradiction) -> str:
    return f"{how.measured_m:.2f} m" if beam.saw_something.any() else "nothing"


def _moved_text(beam: Beam, moved: int) -> str:
    return f"reading {beam.number}, {beam.sensor}: moved {moved:,} cells by more than 10 points"
