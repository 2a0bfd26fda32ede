"""DXF and SVG by the libraries that are made for it: what the program's own drawings must equal."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape

import drawsvg
import ezdxf
import numpy as np
from ezdxf import options  # type: ignore[attr-defined]  # its documented place

from mapping.artifacts import Border, Segment

COLOURS = ("#1b6ca8", "#c0392b", "#1e8449", "#7d3c98", "#b9770e", "#2c3e50")


def outline(border: Border) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in border.geometry.centres_of(border.cells)]


@contextmanager
def fixed_dates() -> Iterator[None]:
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def dxf(segments: Sequence[Segment], borders: Sequence[Border]) -> str:
    with fixed_dates():
        drawing = ezdxf.new("R2010", units=6)
    model = drawing.modelspace()

    def layer_for(name: str, what: str) -> str:
        wanted = re.sub(r'[<>/\\":;?*|=`,\x00-\x1f]', "_", f"{name} {what}")
        if wanted not in drawing.layers:
            drawing.layers.add(wanted, color=(5, 1, 3, 6, 30, 7)[len(drawing.layers) % 6])
        return wanted

    for border in borders:
        where = {"layer": layer_for(border.layer, "borders")}
        model.add_lwpolyline(outline(border), close=True, dxfattribs=where)
    for segment in segments:
        where = {"layer": layer_for(segment.layer, "segments")}
        model.add_line(segment.start_m, segment.end_m, dxfattribs=where)
    # ezdxf itself goes through a set of names here, in another order in each process
    for kind in sorted(drawing.entitydb.dxf_types_in_use()):
        drawing.classes.add_class(kind)
    text = io.StringIO()
    with fixed_dates():
        drawing.write(text)
    return text.getvalue()


def svg(segments: Sequence[Segment], borders: Sequence[Border]) -> str:
    ends = [np.array([s.start_m, s.end_m]) for s in segments]
    outlines = [np.array(outline(b)) for b in borders]
    points = np.concatenate([*ends, *outlines]) if ends or outlines else np.zeros((1, 2))
    low, high = points.min(axis=0) - 0.2, points.max(axis=0) + 0.2
    width, height = (float(v) for v in high - low)
    picture = drawsvg.Drawing(width, height, origin=(float(low[0]), -float(high[1])))
    picture.set_pixel_scale(200.0)
    names = sorted({s.layer for s in segments} | {b.layer for b in borders})
    colours = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}
    for border, points in zip(borders, outlines, strict=True):
        corners = [v for x, y in points.tolist() for v in (x, -y)]
        look = {"fill": "none", "stroke": colours[border.layer], "stroke_width": 0.004}
        attributes = {"data-layer": escape(border.layer), "data-border": border.number}
        picture.append(drawsvg.Lines(*corners, close=True, **look, **attributes))
    for segment in segments:
        (x0, y0), (x1, y1) = segment.start_m, segment.end_m
        look = {"stroke": colours[segment.layer], "stroke_width": 0.012}
        attributes = {"data-layer": escape(segment.layer)}  # drawsvg writes attributes as they are
        if segment.border is not None:
            attributes["data-border"] = str(segment.border)
        picture.append(drawsvg.Line(x0, -y0, x1, -y1, stroke_linecap="round", **look, **attributes))
    return str(picture.as_svg())
