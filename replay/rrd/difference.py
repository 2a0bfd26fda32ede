"""A comparison as a recording: both maps and their difference side by side, and the verdict.

For each layer the map plane holds three pictures, ``a``, ``b`` and ``difference``; beside each
stand its exact values. Lines of both sides and walls that changed are drawn over them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from recorder.errors import BadInput
from recorder.outputs import written_beside
from replay.diff.comparing import LayerReport, Report
from replay.diff.layers import Line
from replay.diff.picture import difference_pixels, map_pixels
from replay.diff.report_text import summary
from replay.rrd import layout, scene
from replay.rrd.axes import whole_frame
from replay.rrd.sink import Sink, new_recording

_VERDICT = "/verdict"
_GONE, _COME = (255, 127, 14, 255), (44, 140, 44, 255)
_ABOVE = 10.0
_SIDES = ("a", "b", "difference")


def write_difference(report: Report, path: Path) -> None:
    """Write the recording, beside its name first. Raises BadInput where it cannot be written."""
    recording = new_recording()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_beside(path) as part:
            recording.save(part, default_blueprint=_blueprint(report))
            recording.send_recording_name(f"{report.a.path.name} and {report.b.path.name}")
            _draw(Sink(recording), report)
            recording.flush()
            recording.disconnect()
    except (OSError, RuntimeError) as error:
        raise BadInput(f"{path}: cannot be written: {error}") from None


def _draw(sink: Sink, report: Report) -> None:
    scene.set_up_plane(sink)
    text = "\n\n".join(line.strip() for line in summary(report))
    sink.log(_VERDICT, rr.TextDocument(text, media_type="text/markdown"))
    for layer in report.layers:
        _draw_layer(sink, report, layer)


def _draw_layer(sink: Sink, report: Report, layer: LayerReport) -> None:
    pair, geometry = layer.pair, layer.pair.geometry
    difference = np.asarray(pair.b_values, np.float64) - pair.a_values
    sides = (
        (map_pixels(pair.a_shades, pair.a_classes, by_class=pair.by_class), pair.a_values),
        (map_pixels(pair.b_shades, pair.b_classes, by_class=pair.by_class), pair.b_values),
        (difference_pixels(pair), difference),
    )
    for side, (pixels, exact) in zip(_SIDES, sides, strict=True):
        entity = f"{layout.layer_root(layer.name)}/{side}"
        corner = [*layout.corner_m(geometry, geometry.whole), 0.0]
        place = rr.Transform3D(translation=corner, scale=geometry.resolution_m)
        sink.log(entity, place, rr.Image(pixels))
        sink.log(entity, _exact(geometry, side, exact))
    for side, source in (("a", report.a), ("b", report.b)):
        lines = source.layers[layer.name].lines if layer.name in source.layers else None
        if lines:
            entity = f"{layout.layer_root(layer.name)}/lines_{side}"
            sink.log(entity, _strips(lines))
    changes = [c for c in report.verdict.changes if c.layer == layer.name]
    ends = [(c.from_m, _GONE) for c in changes if c.from_m]
    ends += [(c.to_m, _COME) for c in changes if c.to_m]
    if ends:
        entity = f"{layout.layer_root(layer.name)}/walls"
        strips = [list(each) for each, _ in ends]
        drawn = rr.LineStrips2D(
            strips, colors=[colour for _, colour in ends], radii=-2.5, draw_order=_ABOVE
        )
        sink.log(entity, drawn)


def _exact(geometry: GridGeometry, side: str, exact: NDArray[np.floating]) -> rr.AnyValues:
    """The numbers themselves, named ``a_values`` and so on: Rerun keeps one type for each name."""
    where = np.array([*geometry.origin_m, geometry.resolution_m], np.float64)
    shape = np.array(geometry.shape, np.int64)
    numbers = np.ascontiguousarray(exact, np.float64).ravel()
    return rr.AnyValues(**{f"{side}_values": numbers}, shape=shape, where_m=where)


def _strips(lines: tuple[Line, ...]) -> rr.LineStrips2D:
    strips = [[line.start_m, line.end_m] for line in lines if line.source == "grid"]
    return rr.LineStrips2D(strips, colors=[layout.SEGMENT], radii=-1.5, draw_order=_ABOVE)


def _blueprint(report: Report) -> rrb.Blueprint:
    """A tab for each layer, the three pictures side by side, the verdict beside them."""
    tabs = [_tab(layer, report) for layer in report.layers]
    verdict = rrb.TextDocumentView(origin=_VERDICT, name="What differs")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(*tabs, active_tab=_clearest(report)), verdict, column_shares=[7, 2]
        ),
        rrb.TimePanel(state="hidden"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _clearest(report: Report) -> int:
    """The layer in which a wall changed, or else the one of which most cells differ."""
    changed = {change.layer for change in report.verdict.changes}
    return max(
        range(len(report.layers)),
        key=lambda i: (report.layers[i].name in changed, report.layers[i].cells.differ),
    )


def _tab(layer: LayerReport, report: Report) -> rrb.Container:
    root = layout.layer_root(layer.name)
    titles = (
        f"A: {report.a.path.name}",
        f"B: {report.b.path.name}",
        "difference: red is more occupied in B, blue more free",
    )
    over = ([f"{root}/lines_a"], [f"{root}/lines_b"], [f"{root}/walls"])
    views = [
        rrb.Spatial2DView(
            origin="/", name=title, contents=[layout.MAP, f"{root}/{side}", *more],
            visual_bounds=whole_frame(layer.pair.geometry).bounds,
        )
        for side, title, more in zip(_SIDES, titles, over, strict=True)
    ]  # fmt: skip
    return rrb.Horizontal(*views, name=layer.name)
