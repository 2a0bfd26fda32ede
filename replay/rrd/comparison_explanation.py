"""What a step did in each of several maps: the same moment in a table, a line for each map.

Where all maps agree it stands there once, as for a single map.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from mapping.artifacts import (
    Finished,
    MergedGrid,
    Segment,
    Snapshot,
    Started,
    TempGrid,
    Thresholded,
)
from mapping.beams import Beam
from replay.colours import in_place
from replay.comparison import Variant
from replay.comparison_steps import SAME_PLACE_M, Distances, Moment, apart
from replay.comparison_table import footnotes, map_rows, shown_layer, table_of
from replay.rrd.explanation import describe, layer_of, percent
from replay.tables import markdown_table

Some = TypeVar("Some")
Row = Sequence[object]


@dataclass(frozen=True, slots=True)
class Compared:
    """What is known of a comparison beside the moment itself."""

    variants: Mapping[str, Variant]
    started: Mapping[str, Started]
    finals: Mapping[str, Sequence[Snapshot]]
    distances: Distances
    left_out: str


def describe_moment(moment: Moment, known: Compared) -> str:
    """Markdown for one step of several maps, and in which tab it is to be seen."""
    layers = {layer_of(artifact) for artifact in moment.values()} - {""}
    tab = f"\n\nSeen in the tab **{layers.pop()}**." if len(layers) == 1 else ""
    return _described(moment, known) + tab


def _described(moment: Moment, known: Compared) -> str:
    if begun := _all(moment, Started):
        return _started(begun, known)
    if beams := _all(moment, Beam):
        return _beams(beams, known)
    if temps := _all(moment, TempGrid):
        return _temps(temps)
    if merged := _all(moment, MergedGrid):
        return _merged(merged)
    if snapshots := _all(moment, Snapshot):
        return _snapshots(snapshots)
    if thresholded := _all(moment, Thresholded):
        return _thresholded(thresholded)
    if segments := _all(moment, Segment):
        return _segments(segments)
    return _finished(moment, known) if _all(moment, Finished) else _each(moment)


def _all(moment: Moment, kind: type[Some]) -> dict[str, Some]:
    """The artifacts by name, if they all are of that kind."""
    found: dict[str, Some] = {name: a for name, a in moment.items() if isinstance(a, kind)}
    return found if len(found) == len(moment) else {}


def _started(begun: Mapping[str, Started], known: Compared) -> str:
    rows = [
        (name, f"{one.geometry.cols} × {one.geometry.rows}", f"{one.geometry.resolution_m:g} m")
        for name, one in begun.items()
    ]
    notes = [f"- **{v.name}**: {v.note}" for v in known.variants.values() if v.note]
    one = next(iter(begun.values()))
    walls = "\n\nThe true walls are known and drawn in green." if len(one.walls_m) else ""
    return (
        f"## {len(begun)} empty maps of one session\n\nEach view shows one map; every step shows "
        f"the same reading in all of them. The tabs are the layers: "
        f"**{', '.join(one.layers)}**.{walls}\n\n"
        f"{_table(('map', 'cells', 'side of a cell'), rows)}\n\n"
        + "\n".join([*notes, "\nPress the **right arrow key** for the next step."])
    )


def _beams(beams: Mapping[str, Beam], known: Compared) -> str:
    names = list(beams)
    text = describe(beams[names[0]])
    lines = []
    first = beams[names[0]].world_from_base
    for name in names[1:]:
        away_m, turned_rad = apart(first, beams[name].world_from_base)
        if away_m > SAME_PLACE_M:
            lines.append(
                f"- In **{name}** the robot stands **{away_m:.3f} m** and "
                f"{math.degrees(turned_rad):.1f}° from where {names[0]} has it."
            )
    missing = [name for name in known.variants if name not in beams]
    if missing:
        lines.append(f"- Not used by **{', '.join(missing)}**.")
    return "\n\n".join([text, "\n".join(lines)]) if lines else text


def _temps(temps: Mapping[str, TempGrid]) -> str:
    texts = {name: describe(temp) for name, temp in temps.items()}
    if len(set(texts.values())) == 1:
        alike = "\n\nThe evidence is the same for all maps." if len(texts) > 1 else ""
        return next(iter(texts.values())) + alike
    rows = []
    for name, temp in temps.items():
        band, free = temp.probability[temp.band], temp.probability[temp.free]
        rows.append((
            name, f"{band.size:,}", percent(band.max()) if band.size else "",
            f"{free.size:,}", percent(free.min()) if free.size else "",
        ))  # fmt: skip
    number = next(iter(temps.values())).beam.number
    head = ("map", "red cells", "up to", "blue cells", "down to")
    return f"## The evidence of reading {number} for each cell\n\n{_table(head, rows)}"


def _merged(merged: Mapping[str, MergedGrid]) -> str:
    rows: list[Row] = []
    for name, one in merged.items():
        difference = one.probability.astype(np.float64) - one.previous
        occupied, free = int((difference > 0).sum()), int((difference < 0).sum())
        rows.append((name, f"{occupied:,}", f"{free:,}", *_two_cells(one)))
    first = next(iter(merged.values()))
    head: Row = ("map", "more occupied", "more free", "straight ahead", "halfway")
    explained = (
        "*More occupied*, *more free*: how many cells changed that way. *Straight ahead*, "
        "*halfway*: the probability before and after, where the obstacle stands if it is straight "
        "ahead, and halfway to there."
    )
    if not any(row[3] or row[4] for row in rows):
        rows, head = [row[:3] for row in rows], head[:3]
        explained = "*More occupied*, *more free*: how many cells changed so. Nothing was seen."
    title = f"## Reading {first.beam.number} goes into the maps of {first.layer}"
    return f"{title}\n\n{_table(head, rows)}\n\n{explained}"


def _two_cells(merged: MergedGrid) -> tuple[str, str]:
    """Before and after, of the cell at the first obstacle point and the one halfway to it."""
    points = merged.beam.points_m
    if not len(points):
        return "", ""
    sensor = np.array([merged.beam.world_from_sensor.x_m, merged.beam.world_from_sensor.y_m])
    changes = []
    for point in (points[0], (points[0] + sensor) / 2):
        (row, col) = merged.geometry.cells_of(point[None])[0]
        row, col = int(row) - merged.window.row0, int(col) - merged.window.col0
        if 0 <= row < merged.window.rows and 0 <= col < merged.window.cols:
            before, after = merged.previous[row, col], merged.probability[row, col]
            was = percent(before).removesuffix(" %")
            changes.append(f"{was} → **{percent(after)}**")
        else:
            changes.append("")
    return changes[0], changes[1]


def _thresholded(thresholded: Mapping[str, Thresholded]) -> str:
    rows = [
        (name, percent(one.threshold), f"{int(one.occupied.sum()):,}")
        for name, one in thresholded.items()
    ]
    layer = next(iter(thresholded.values())).layer
    head = ("map", "above", "cells, in yellow")
    return f"## {layer}: which cells count as occupied\n\n{_table(head, rows)}"


def _segments(segments: Mapping[str, Segment]) -> str:
    rows = [
        (name, f"{one.length_m:.3f} m", one.points, f"{1000 * one.rms_m:.1f} mm")
        for name, one in segments.items()
    ]
    layer = next(iter(segments.values())).layer
    head = ("map", "length", "points", "rms")
    return f"## {layer}: one more straight line in each\n\n{_table(head, rows)}"


def _snapshots(snapshots: Mapping[str, Snapshot]) -> str:
    rows = []
    for name, one in snapshots.items():
        p = one.layer.probability[one.layer.observed]
        rows.append((
            name, one.rule, f"{int((p > 0.5).sum()):,}", f"{int((p < 0.5).sum()):,}",
            f"{int((p == 0.5).sum()):,}",
        ))  # fmt: skip
    one = next(iter(snapshots.values()))
    when = "at the end" if one.final else "so far"
    head = ("map", "rule", "above 50 %", "below", "at 50 %")
    return f"## The maps {one.layer.name} {when}\n\n{_table(head, rows)}"


def _finished(moment: Moment, known: Compared) -> str:
    """A table for each tab, since any may be in front; the last layer that all have comes first."""
    finals = {name: some for name, some in known.finals.items() if some}
    parts = []
    if finals:
        first = shown_layer(finals)
        every = in_place(one.layer.name for some in finals.values() for one in some)
        parts.append("## The maps, compared")
        parts += [_compared_tab(finals, layer, known) for layer in _in_front(first, every)]
    away = "\n".join(f"- {line}" for line in known.distances.sentences())
    return "\n\n".join(part for part in (*parts, away, _each(moment), known.left_out) if part)


def _compared_tab(finals: Mapping[str, Sequence[Snapshot]], layer: str, known: Compared) -> str:
    thresholds = {name: v.config.borders.threshold for name, v in known.variants.items()}
    lines = map_rows(finals, layer, thresholds)
    head, *rows = table_of(lines)
    return "\n\n".join([f"### Tab {layer}", _table(head, rows), *footnotes(lines)])


def _in_front(first: str, every: Sequence[str]) -> list[str]:
    return [first, *(each for each in every if each != first)]


def _each(moment: Moment) -> str:
    """The text of each map, once where they are the same."""
    texts = {name: describe(artifact) for name, artifact in moment.items()}
    if len(set(texts.values())) == 1:
        return next(iter(texts.values()))
    parts = {name: text.partition("\n") for name, text in texts.items()}
    titles = {title for title, _, _ in parts.values()}
    if len(titles) == 1:
        bodies = (f"### {name}\n\n{body.strip()}" for name, (_, _, body) in parts.items())
        return "\n\n".join([titles.pop(), *bodies])
    bodies = (
        f"### {name}: {title.lstrip('# ')}\n\n{body.strip()}"
        for name, (title, _, body) in parts.items()
    )
    return "\n\n".join(["## In each map", *bodies])


def _table(head: Row, rows: Sequence[Row]) -> str:
    return markdown_table([head, *rows])
