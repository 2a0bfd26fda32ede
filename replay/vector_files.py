"""Lines, and borders with them, in the formats of other programs: GeoJSON, DXF and SVG, as text.

All are in metres in the map frame, y up. SVG has y down, so there y is negated. The libraries that
write DXF and SVG are imported when they are needed.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape

import numpy as np

from mapping.artifacts import Border, Segment

# Strokes of one layer each, dark enough on white; further layers start again.
_COLOURS = ("#1b6ca8", "#c0392b", "#1e8449", "#7d3c98", "#b9770e", "#2c3e50")
_DXF_COLOURS = (5, 1, 3, 6, 30, 7)
_METRES = 6  # of DXF's $INSUNITS
_MARGIN_M = 0.2
_PIXELS_PER_M = 200.0


def segments_geojson(segments: Sequence[Segment]) -> str:
    """A FeatureCollection of one LineString a segment.

    Its properties: ``layer``, ``border`` (number or null), ``rho`` in metres, ``alpha`` in radians,
    ``covariance`` of the two as a 2 x 2 list, ``rms`` in metres and ``n``, the number of points.
    """
    import geojson

    features = [
        geojson.Feature(
            geometry=geojson.LineString([segment.start_m, segment.end_m], precision=9),
            properties={
                "layer": segment.layer,
                "source": segment.source,
                "border": segment.border,
                "rho": segment.rho_m,
                "alpha": segment.alpha_rad,
                "covariance": segment.covariance.tolist(),
                "rms": segment.rms_m,
                "n": segment.points,
            },
        )
        for segment in segments
    ]
    text: str = geojson.dumps(geojson.FeatureCollection(features), indent=1, allow_nan=False)
    return text + "\n"


def _outline(border: Border) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in border.geometry.centres_of(border.cells)]


def vector_dxf(segments: Sequence[Segment], borders: Sequence[Border] = ()) -> str:
    """A DXF drawing (R2010, units metres) with lines and closed polylines.

    The drawing's layers are ``NAME segments`` and ``NAME borders``. The same lines give the same
    text: dates and identifiers are fixed.
    """
    from ezdxf.filemanagement import new

    with _fixed_dates():
        drawing = new("R2010", units=_METRES)
    model = drawing.modelspace()

    def layer_for(name: str, what: str) -> str:
        # DXF forbids some characters in the names of layers.
        wanted = re.sub(r'[<>/\\":;?*|=`,\x00-\x1f]', "_", f"{name} {what}")
        if wanted not in drawing.layers:
            drawing.layers.add(wanted, color=_DXF_COLOURS[len(drawing.layers) % 6])
        return wanted

    for border in borders:
        where = {"layer": layer_for(border.layer, "borders")}
        model.add_lwpolyline(_outline(border), close=True, dxfattribs=where)
    for segment in segments:
        where = {"layer": layer_for(segment.layer, "segments")}
        model.add_line(segment.start_m, segment.end_m, dxfattribs=where)
    # ezdxf itself goes through a set of names here, in another order in each process
    for kind in sorted(drawing.entitydb.dxf_types_in_use()):
        drawing.classes.add_class(kind)
    text = io.StringIO()
    with _fixed_dates():
        drawing.write(text)
    return text.getvalue()


@contextmanager
def _fixed_dates() -> Iterator[None]:
    """Let ezdxf write a fixed date and fixed identifiers; its own switch, set back afterwards."""
    from ezdxf import options  # type: ignore[attr-defined]  # its documented place

    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def vector_svg(segments: Sequence[Segment], borders: Sequence[Border] = ()) -> str:
    """An SVG picture whose user unit is the metre; y is negated, so that the map stands upright.

    Every element has its ``data-layer`` and ``data-border``.
    """
    import drawsvg

    ends = [np.array([s.start_m, s.end_m]) for s in segments]
    outlines = [np.array(_outline(b)) for b in borders]
    points = np.concatenate([*ends, *outlines]) if ends or outlines else np.zeros((1, 2))
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    width, height = (float(v) for v in high - low)
    picture = drawsvg.Drawing(width, height, origin=(float(low[0]), -float(high[1])))
    picture.set_pixel_scale(_PIXELS_PER_M)
    names = sorted({s.layer for s in segments} | {b.layer for b in borders})
    colours = {name: _COLOURS[k % len(_COLOURS)] for k, name in enumerate(names)}
    for border, outline in zip(borders, outlines, strict=True):
        corners = [v for x, y in outline.tolist() for v in (x, -y)]
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
    svg: str = picture.as_svg()
    return svg
