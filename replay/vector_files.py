"""Lines, and borders with them, in the formats of other programs: GeoJSON and DXF, as text.

All are in metres in the map frame, y up. The library that writes DXF is imported when it is needed.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from mapping.artifacts import Border, Segment

_DXF_COLOURS = (5, 1, 3, 6, 30, 7)
_METRES = 6  # of DXF's $INSUNITS


def segments_geojson(segments: Sequence[Segment]) -> str:
    """A FeatureCollection of one LineString a segment.

    Its properties: ``layer``, ``border`` (number or null), ``rho`` in metres, ``alpha`` in radians,
    ``covariance`` of the two as a 2 x 2 list, ``rms`` in metres and ``n``, the number of points.
    The collection states its ``frame`` and ``unit``.
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
    # Foreign members (RFC 7946, 6.1), as its own coordinates would be degrees on the globe.
    whole = geojson.FeatureCollection(features, frame="map", unit="metre")
    text: str = geojson.dumps(whole, indent=1, allow_nan=False)
    return text + "\n"


def _outline(border: Border) -> list[tuple[float, float]]:
    """The corners of a border; the cells of a straight run between two of them add nothing."""
    cells = border.cells
    ahead = np.roll(cells, -1, axis=0) - cells
    turns = (ahead != np.roll(ahead, 1, axis=0)).any(axis=1)
    corners = cells[turns] if turns.any() else cells
    return [(x, y) for x, y in border.geometry.centres_of(corners).tolist()]


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
