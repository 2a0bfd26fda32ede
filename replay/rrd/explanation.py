"""What a step did, as text with its numbers: short markdown for someone new to maps.

One function for each artifact; :func:`describe` picks it. Lengths are in metres, angles in degrees
counter-clockwise from the x axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mapping.artifacts import (
    Artifact,
    Border,
    Classes,
    Finished,
    LineStage,
    MergedGrid,
    RawPoints,
    RejectedReading,
    Segment,
    Snapshot,
    Started,
    TempGrid,
    Thresholded,
    TracerStep,
)
from mapping.beams import Beam
from mapping.filters import FILTERS
from mapping.fusion import FUSED
from replay.colours import in_place, sensor_colour_names
from replay.probe_text import moved_by
from replay.rrd import layout
from replay.tables import markdown_table

MANUAL = """\
**Keys**: the arrows go one step on or back: in `step` one thing, in `reading` a whole reading.
Ctrl and the wheel zoom, dragging moves, a double click shows all.

**The map** (grey): white is free, black is occupied, blue-grey was never seen. Point at a cell to
read its probability.

**One reading** (over the map): red cells become more occupied, blue ones more free;
the stronger the colour, the stronger the evidence. The outline is its beam, in the sensor's colour,
the dots are echoes; teal are the robot and its path. Green walls are the true ones.

**Results** (after the last reading): yellow are cells above the threshold, cyan their borders,
magenta the straight lines fitted to them. Lines in a sensor's colour were fitted to its raw points.
Each step draws the newest in full and pales the others. The end leaves the maps and their lines;
the tab *With borders and points* keeps the rest.

**Classes** (at the end): black where the sensors agree on occupied, white where they agree on
empty, red where they contradict each other. What one sensor alone saw has its colour: full where
occupied, pale where empty.

**Two or three sensors in one picture**: each prints its map in its own ink on white paper, the
stronger the more occupied. Where both do, the inks lie over each other and come out dark, or green
in the picture that has green for both.

**Ranges**: measured, with a band as wide as the sensor's error, and paler what the map so far
predicted.
"""


def _started(started: Started) -> str:
    geometry = started.geometry
    width, height = geometry.size_m
    seconds = (started.last_t_ns - started.first_t_ns) / 1e9
    walls = len(started.walls_m)
    known = f" The {walls} true walls are known and drawn in green." if walls else ""
    return (
        f"## The empty map\n\n{geometry.cols} × {geometry.rows} cells of "
        f"{geometry.resolution_m:g} m: {width:.4g} m wide, {height:.4g} m high. Nothing has been "
        f"seen yet.{known}\n\n**What will happen**: {_plan(started)} from readings over "
        f"{seconds:.1f} s.\n\nEach reading takes three steps: its beam, its evidence for each "
        "cell, and the map with it. After the last one come the cells above the threshold, their "
        "borders, and the walls as lines.\n\nPress the **right arrow key** for the next step; "
        "the last step reports what came out."
    )


def _plan(started: Started) -> str:
    """Which maps will come of which sensors, in their colours."""
    layer_of = {sensor.name: sensor.layer for sensor in started.sensors}
    words = sensor_colour_names([*started.layers, *layer_of], layer_of)
    parts = []
    for layer in in_place(started.layers):
        mine = in_place(name for name, of in layer_of.items() if of == layer)
        if layer == FUSED:
            parts.append("**fused**, all of them together")
        elif len(mine) > 1:
            named = ", ".join(f"{name} {words[name]}" for name in mine)
            parts.append(f"**{layer}**, of the sensors {named}")
        else:
            parts.append(f"**{layer}** ({words[layer]})")
    maps = f"{len(parts)} maps come about" if len(parts) > 1 else "a map comes about"
    return f"{maps}: {'; '.join(parts)};"


def _beam(beam: Beam) -> str:
    base, sensor = beam.world_from_base, beam.world_from_sensor
    return (
        f"## Reading {beam.number}: {beam.sensor} measures {_measured(beam)}\n\n"
        f"The robot stands at ({base.x_m:.3f}, {base.y_m:.3f}) m and faces "
        f"{math.degrees(base.heading_rad):.1f}°. The sensor sits at ({sensor.x_m:.3f}, "
        f"{sensor.y_m:.3f}) m and looks along {math.degrees(sensor.heading_rad):.1f}°.\n\n"
        f"{_what_it_means(beam)}"
    )


def _measured(beam: Beam) -> str:
    seen = beam.ranges_m[beam.saw_something]
    if len(beam.ranges_m) > 1:
        nearest = f", the nearest at **{seen.min():.3f} m**" if len(seen) else ""
        return f"{len(beam.ranges_m)} beams, {len(seen)} with an obstacle{nearest}"
    return f"**{seen[0]:.3f} m**" if len(seen) else "**nothing** within its reach"


def _what_it_means(beam: Beam) -> str:
    width = math.degrees(beam.beam_width_rad)
    if len(beam.ranges_m) > 1:
        return "Each beam ends at an obstacle; what lies before it is free."
    if not beam.saw_something[0]:
        return f"No echo came back: nothing stands in the {width:.3g}° beam, as far as it reaches."
    x, y = beam.points_m[0]
    return (
        f"The beam is {width:.3g}° wide, so the obstacle may be anywhere along the arc. Straight "
        f"ahead it would be at ({x:.3f}, {y:.3f}) m: the dot."
    )


def _temp(temp: TempGrid) -> str:
    from mapping.kernels.loops import evidence_of

    in_band, most, in_front, least = evidence_of(temp.probability, temp.free, temp.band)
    if not in_band and not in_front:
        return f"## Reading {temp.beam.number} is no evidence\n\nIt touches no cell of the map."
    lines = [f"## Reading {temp.beam.number}: the evidence of {temp.beam.sensor} for each cell\n"]
    if temp.beam.model:
        lines.append(f"{temp.beam.sensor} has several models: this is the one {temp.beam.model}.\n")
    if in_band:
        lines.append(
            f"- **Red, {in_band:,} cells**: the obstacle may be here. Probability of being "
            f"occupied up to {percent(most)}."
        )
    else:
        lines.append("- No red cells: nothing was seen.")
    if in_front:
        lines.append(
            f"- **Blue, {in_front:,} cells**: the beam passed through them, so they are "
            f"rather free. Probability down to {percent(least)}."
        )
    lines.append("- All other cells: 50 %, this reading is no evidence for them.")
    return "\n".join(lines)


def _merged(merged: MergedGrid) -> str:
    from mapping.kernels.loops import changes_of

    head = f"## Reading {merged.beam.number} goes into the map {merged.layer}\n\n"
    before, after = merged.previous, merged.probability
    changed, occupied, free, most, above, below = changes_of(before.ravel(), after.ravel())
    rule = f"Rule: **{merged.rule}**."
    if not changed:
        return f"{head}{rule} No cell changed."
    row, col = divmod(most, merged.window.cols)
    cell = np.array([[row + merged.window.row0, col + merged.window.col0]], np.int64)
    x, y = merged.geometry.centres_of(cell)[0]
    by_sums = _by_sums(merged, row, col)
    return (
        f"{head}{rule} **{changed:,} cells changed**: {occupied:,} more occupied, "
        f"{free:,} more free.\n\nThe largest change: the cell at ({x:.3f}, {y:.3f}) m (row "
        f"{cell[0, 0]}, column {cell[0, 1]}) went from "
        f"{percent(before[row, col])} to **{percent(after[row, col])}**{by_sums}.\n\n"
        f"Of the {after.size:,} cells around this beam, {above:,} are now "
        f"rather occupied and {below:,} rather free."
    )


def _rejected(rejected: RejectedReading) -> str:
    beam, known = rejected.beam, FILTERS[rejected.filter]
    expected = f"{rejected.expected_m:.3f} m" if math.isfinite(rejected.expected_m) else "nothing"
    why = known.explained.format(
        sensor=beam.sensor, of=rejected.of, before=rejected.of - 1, expected=f"**{expected}**"
    )
    return (
        f"## A reading of {beam.sensor} is left out: {_measured(beam)}\n\n{why}\n\nCounted as "
        f"*{rejected.reason}*. It changes no cell; its beam is drawn in pink. The filter is set by "
        f'`sensors.{beam.sensor}.filter = "{rejected.filter}"`.'
    )


def _by_sums(merged: MergedGrid, row: int, col: int) -> str:
    """Which sums moved a cell, for a rule that keeps several."""
    changes = () if merged.sums is None else merged.sums.changes(row, col)
    return f", by {moved_by(changes)} in log-odds" if changes else ""


def _snapshot(snapshot: Snapshot) -> str:
    layer = snapshot.layer
    seen = layer.observed
    p = layer.probability[seen]
    when = "at the end" if snapshot.final else "so far"
    share = seen.mean() if seen.size else 0.0
    return (
        f"## The map {layer.name} {when}\n\nRule: **{snapshot.rule}** (values: {layer.kind}). "
        f"{percent(share)} of the cells were seen.\n\nOf these, {int((p > 0.5).sum()):,} are "
        f"rather occupied, {int((p < 0.5).sum()):,} rather free and {int((p == 0.5).sum()):,} "
        f"undecided."
    )


def _thresholded(thresholded: Thresholded) -> str:
    return (
        f"## {thresholded.layer}: which cells count as occupied\n\nYellow: the "
        f"**{int(thresholded.occupied.sum()):,} cells** whose probability lies above "
        f"{percent(thresholded.threshold)}."
    )


def _classes(classes: Classes) -> str:
    counts = np.bincount(classes.codes.ravel(), minlength=len(classes.names))
    colours = layout.class_colours(classes.names)
    rows = [
        (name, colours[name][1], f"{count:,}")
        for name, count in zip(classes.names, counts, strict=False)
    ]
    table = markdown_table([("class", "drawn in", "cells"), *rows])
    return f"## Where the sensors agree\n\n{table}"


def _border(border: Border) -> str:
    kind = (
        "An outer border, traced counter-clockwise" if border.outer else "A hole, traced clockwise"
    )
    return (
        f"## {border.layer}: border {border.number}\n\n{kind}: **{len(border.cells):,} cells** "
        f"long (orange). It starts at the red arrow."
    )


def _raw_points(points: RawPoints) -> str:
    return (
        f"## {points.layer}: all obstacle points\n\n**{len(points.points_m):,} points**: each "
        f"reading taken as if its obstacle stood straight ahead."
    )


def _tracer_step(step: TracerStep) -> str:
    row, col = (int(v) for v in step.cells[-1])
    free = len(step.tried) - (step.following is not None)
    if step.following is None:
        after = "It has no neighbour that is occupied: a border of one cell."
    else:
        to_row, to_col = step.following
        after = f"The first that is occupied: row {to_row}, column {to_col} (arrow)."
    return (
        f"## {step.layer}: the tracer at cell {len(step.cells)} of border {step.border}\n\nIt "
        f"stands at row {row}, column {col} and looks around, counter-clockwise, starting behind "
        f"the way it came: {free} free neighbours (red). {after} Blue is its way so far."
    )


_STAGES = {  # heading; what was done; what the number is
    "split": ("cut", "Blue: {n} pieces that bend too much. Each is cut at the red dot, the point "
              "farthest from its chord", "{low:.3f} to {high:.3f} m away"),
    "merge": ("join", "Blue: {n} times two pieces that are one line became one; red is where they "
              "met. Together they fit about as well as apart", "{low:.0%} to {high:.0%} of the "
              "misfit that is allowed"),
    "fit": ("fit", "Blue: {n} lines, each the best through its points", "rms {low:.4f} to "
            "{high:.4f} m"),
    "corner": ("corners", "Red: {n} corners, where neighbouring lines cross; both end there now",
               ""),
    "move": ("move to the raw points", "Blue: {n} lines as the grid has them. Each is fitted again "
             "to the readings that it explains", "it moves by {low:.3f} to {high:.3f} m"),
    "drop": ("leave out", "Blue: {n} lines that are no walls: readings went past them, or better "
             "lines explain the same readings", ""),
}  # fmt: skip


def _line_stage(stage: LineStage) -> str:
    heading, done, measure = _STAGES[stage.kind]
    count = max(len(stage.pieces_m), len(stage.places_m))
    measured = ""
    if stage.sizes and measure:
        measured = ": " + measure.format(low=min(stage.sizes), high=max(stage.sizes))
    origin = "raw points" if stage.source == "raw" else "the borders of its grid"
    return f"## {stage.layer}: {heading} ({origin})\n\n{done.format(n=count)}{measured}."


def _segment(segment: Segment) -> str:
    (x0, y0), (x1, y1) = segment.start_m, segment.end_m
    if segment.source == "raw":
        origin = f"{segment.points} raw points (violet)"
    else:
        of = "" if segment.border is None else f" along border {segment.border}"
        origin = f"{segment.points} points{of} (magenta)"
    rho_sd, alpha_sd = np.sqrt(np.maximum(np.diag(segment.covariance), 0.0))
    return (
        f"## {segment.layer}: a straight line\n\nFrom ({x0:.3f}, {y0:.3f}) to ({x1:.3f}, {y1:.3f}) "
        f"m, **{segment.length_m:.3f} m** long, fitted to {origin}, which lie "
        f"{1000 * segment.rms_m:.1f} mm from it (rms).\n\nAs x cos α + y sin α = ρ: ρ = "
        f"{segment.rho_m:.4f} ± {rho_sd:.4f} m, α = {math.degrees(segment.alpha_rad):.2f} ± "
        f"{math.degrees(alpha_sd):.2f}°."
    )


def _finished(finished: Finished) -> str:
    used = ", ".join(f"{name} {count:,}" for name, count in finished.used.items()) or "none"
    dropped = [f"- {count:,} dropped: {reason}" for reason, count in finished.dropped.items()]
    return "\n".join(
        [f"## The end\n\n**{finished.readings:,} readings**; used: {used}.\n", *dropped]
    )


def percent(share: float) -> str:
    """``0.558243`` → ``55.8 %``; near 0, ½ and 1, where it matters, with more digits."""
    value = 100.0 * float(share)
    distance = min(abs(value), abs(value - 50.0), abs(value - 100.0))
    digits = 1 if distance >= 0.5 or distance == 0 else 3
    return f"{value:.{digits}f} %"


def layer_of(artifact: Artifact) -> str:
    """The layer that an artifact belongs to; empty where it belongs to all."""
    match artifact:
        case Snapshot():
            return artifact.layer.name
        case TempGrid() | RejectedReading():
            return artifact.beam.layer
        case Started() | Classes() | Finished():
            return ""
    return artifact.layer


_DESCRIBED: dict[type[Artifact], Callable[..., str]] = {
    Started: _started, Beam: _beam, TempGrid: _temp, MergedGrid: _merged,
    RejectedReading: _rejected, Snapshot: _snapshot,
    Thresholded: _thresholded, Classes: _classes, Border: _border, RawPoints: _raw_points,
    TracerStep: _tracer_step, LineStage: _line_stage, Segment: _segment, Finished: _finished,
}  # fmt: skip


def describe(artifact: Artifact) -> str:
    """Markdown for one step. Raises TypeError for something that is no artifact."""
    how = _DESCRIBED.get(type(artifact))
    if how is None:
        raise TypeError(f"{type(artifact).__name__} is no artifact")
    return how(artifact)


def described(artifact: Artifact, more: Sequence[str]) -> str:
    """The same with what others have to add; at the end that comes first, since it came out."""
    text = describe(artifact)
    if not isinstance(artifact, Finished) or not more:
        return "\n\n".join([text, *more])
    heading, _, counts = text.partition("\n\n")
    return "\n\n".join([heading, *more, counts])
