"""A report on a comparison, in lines for people, and as plain values for programs."""

from __future__ import annotations

import math
from typing import Any

from mapping.artifacts import MergedGrid, Snapshot
from replay.diff.cells import Cell
from replay.diff.comparing import LayerReport, Report
from replay.diff.divergence import Divergence, ReceivedReading, StepDivergence
from replay.diff.layers import Line, Moment
from replay.diff.lines import BorderFigures, LineFigures
from replay.json_values import json_object, json_value

# What a step of a recording was, for people.
_CAME = {
    MergedGrid.__name__: "reading {} merged",
    Snapshot.__name__: "the whole map, written after reading {}",
}
_SHOWN = 3  # lines that moved, came or went, of each kind


def summary(report: Report) -> list[str]:
    """The whole comparison; the verdict first."""
    lines = [
        f"A  {report.a.path} ({report.a.what})",
        f"B  {report.b.path} ({report.b.what})",
        f"verdict: {report.verdict.text}",
    ]
    lines += [f"note: {note}" for note in report.notes]
    for name, side in ((report.only_a, "A"), (report.only_b, "B")):
        lines += [f"layer {each}: only in {side}" for each in name]
    for layer in report.layers:
        lines += _layer_lines(layer)
    if report.divergence is not None:
        lines += _divergence_lines(report.divergence)
    if report.step_divergence is not None:
        lines.append(_step_line(report.step_divergence))
    return lines


def _layer_lines(layer: LayerReport) -> list[str]:
    cells = layer.cells
    if not cells.differ:
        head = f"layer {layer.name}: all {cells.compared:,} cells agree"
    else:
        head = f"layer {layer.name}: {cells.differ:,} of {cells.compared:,} cells differ; worst "
        head += _cell_text(cells.worst[0])
        head += _written_text(layer)
    lines = [head]
    if cells.differ:
        iou = "none are occupied" if cells.occupied_iou is None else f"{cells.occupied_iou:.3f}"
        lines.append(
            f"  class changed: {cells.class_changed:,} of {cells.seen:,} seen cells "
            f"({cells.class_changed_share:.1%}); intersection over union of occupied cells: {iou}"
        )
        lines += _near_lines(layer)
    lines += [
        f"  array {extra.name}: {extra.differ:,} cells differ, by {extra.most:.3g} at most"
        for extra in layer.extras
        if extra.differ
    ]
    if layer.lines is not None:
        lines.append("  lines: " + _line_text(layer.lines))
        lines += _line_places(layer.lines)
    if layer.borders is not None:
        lines.append("  borders: " + _border_text(layer.borders))
    return lines


def _cell_text(cell: Cell) -> str:
    place = f"x {cell.x_m:.3f} m, y {cell.y_m:.3f} m (row {cell.row}, col {cell.col} of A): "
    return place + _both(cell.a, cell.b)


def _both(a: float | str, b: float | str) -> str:
    """Both values, to three digits, and how far apart they are where those look alike."""
    one, two = (value if isinstance(value, str) else f"{value:.3g}" for value in (a, b))
    text = f"{one} in A, {two} in B"
    if one == two and not isinstance(a, str) and not isinstance(b, str):
        text += f", {abs(b - a):.3g} apart"
    return text


def _written_text(layer: LayerReport) -> str:
    written = [
        f"{side} wrote it last at {_moment(moment)}"
        for side, moment in (("A", layer.written_a), ("B", layer.written_b))
        if moment is not None
    ]
    return "".join(f"; {each}" for each in written)


def _moment(moment: Moment) -> str:
    came = _CAME.get(moment.artifact, "after reading {}").format(moment.reading)
    return f"step {moment.step} ({came})"


def _near_lines(layer: LayerReport) -> list[str]:
    verdict = layer.verdict
    if verdict.near_a is None or verdict.near_b is None:
        return []
    return [
        f"  occupied cells within {verdict.near_m:.2g} m of the other's, of those both have seen: "
        f"{verdict.near_a:.1%} of A's, {verdict.near_b:.1%} of B's"
    ]


def _line_text(lines: LineFigures) -> str:
    text = f"{lines.same} the same, {len(lines.moved)} moved, "
    return text + f"{len(lines.appeared)} only in B, {len(lines.vanished)} only in A"


def _line_places(lines: LineFigures) -> list[str]:
    out = [
        f"    moved {m.offset_m:.3f} m, turned {math.degrees(m.turned_rad):.1f} deg, ends by up to "
        f"{m.ends_m:.3f} m: {_line(m.a)} -> {_line(m.b)}"
        for m in lines.moved[:_SHOWN]
    ]
    for where, some in (("only in B", lines.appeared), ("only in A", lines.vanished)):
        out += [f"    {where}: {_line(each)}" for each in some[:_SHOWN]]
    return out


def _line(line: Line) -> str:
    (x0, y0), (x1, y1) = line.start_m, line.end_m
    return f"({x0:.3f}, {y0:.3f})-({x1:.3f}, {y1:.3f}) m ({line.source})"


def _border_text(borders: BorderFigures) -> str:
    text = f"{borders.same} the same, {len(borders.moved)} moved"
    if borders.moved:
        most = borders.moved[0]
        text += f" (up to {most.most_m:.3f} m, at ({most.at_m[0]:.2f}, {most.at_m[1]:.2f}) m)"
    return text + f", {len(borders.appeared_m)} only in B, {len(borders.vanished_m)} only in A"


def _divergence_lines(divergence: Divergence) -> list[str]:
    when = (
        f"after reading {divergence.reading}" if divergence.reading else "at the very first reading"
    )
    return [
        f"the maps part {when}, in layer {divergence.layer}",
        *(f"  {s}: {_received(h)}" for s, h in (("A", divergence.a), ("B", divergence.b))),
    ]


def _received(received: ReceivedReading | None) -> str:
    if received is None:
        return "no such reading: the session ended before"
    range_m = "saw nothing" if received.range_m is None else f"{received.range_m:.4f} m"
    x, y, heading = received.world_from_sensor
    return (
        f"{received.sensor} {range_m}, {received.since_start_s:.3f} s after the first reading, "
        f"from ({x:.4f}, {y:.4f}) m at {math.degrees(heading):.2f} deg"
    )


def _step_line(divergence: StepDivergence) -> str:
    return (
        f"the recordings part at {_moment(divergence.a)}: layer {divergence.layer}, "
        f"x {divergence.x_m:.3f} m, y {divergence.y_m:.3f} m "
        f"(row {divergence.row}, col {divergence.col} of A): "
        + _both(divergence.a_value, divergence.b_value)
    )


def as_json(report: Report) -> dict[str, Any]:
    """The same as values that JSON can hold; numbers that are not finite become text."""
    return {
        "a": {"path": str(report.a.path), "what": report.a.what},
        "b": {"path": str(report.b.path), "what": report.b.what},
        "differs": report.differs,
        "verdict": report.verdict.kind,
        "words": report.verdict.text,
        "wall_changes": json_value(report.verdict.changes),
        "notes": list(report.notes),
        "only_in_a": list(report.only_a),
        "only_in_b": list(report.only_b),
        "layers": {layer.name: _layer_json(layer) for layer in report.layers},
        "first_reading": json_value(report.divergence),
        "first_step": json_value(report.step_divergence),
    }


def _layer_json(layer: LayerReport) -> dict[str, Any]:
    geometry = layer.pair.geometry
    return {
        "differs": layer.differs,
        "compared": "classes" if layer.by_class else "values",
        "origin_m": list(geometry.origin_m),
        "resolution_m": geometry.resolution_m,
        "shape": list(geometry.shape),
        **json_object(layer.cells),
        "near_a": layer.verdict.near_a,
        "near_b": layer.verdict.near_b,
        "near_m": layer.verdict.near_m,
        "noise_m": layer.verdict.noise_m,
        "arrays": json_value(layer.extras),
        "lines": json_value(layer.lines),
        "borders": json_value(layer.borders),
        "last_written_a": json_value(layer.written_a),
        "last_written_b": json_value(layer.written_b),
    }
