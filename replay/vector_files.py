"""Lines, and borders with them, in the formats of other programs: GeoJSON and DXF, as text.

All are in metres in the map frame, y up.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mapping.artifacts import Border, Segment

_DXF_COLOURS = (5, 1, 3, 6, 30, 7)
_LAYERS, _FIRST_FREE = 2, 0x2F  # of the empty drawing: its layers, the first number it leaves


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
    return [(float(x), float(y)) for x, y in border.geometry.centres_of(border.cells)]


def vector_dxf(segments: Sequence[Segment], borders: Sequence[Border] = ()) -> str:
    """A DXF drawing (R2010, units metres) with lines and closed polylines.

    The drawing's layers are ``NAME segments`` and ``NAME borders``. The same lines give the same
    text: dates and identifiers are fixed. It is an empty drawing of ezdxf's, filled in as ezdxf
    would; a test compares the two (ezdxf itself takes longer to load than a small map to make).
    """
    drawing = _Drawing()
    for border in borders:
        places = "".join(f" 10\n{x}\n 20\n{y}\n" for x, y in _outline(border))
        what = f"100\nAcDbPolyline\n 90\n{len(border.cells)}\n 70\n1\n{places}"
        drawing.add("LWPOLYLINE", f"{border.layer} borders", what)
    for segment in segments:
        (x0, y0), (x1, y1) = np.array([segment.start_m, segment.end_m], np.float64).tolist()
        start, end = f" 10\n{x0}\n 20\n{y0}\n 30\n0.0\n", f" 11\n{x1}\n 21\n{y1}\n 31\n0.0\n"
        drawing.add("LINE", f"{segment.layer} segments", f"100\nAcDbLine\n{start}{end}")
    return drawing.text()


class _Drawing:
    """An empty drawing that layers and entities are put into, each with the next free number."""

    def __init__(self) -> None:
        self._number = _FIRST_FREE
        self._layers: dict[str, str] = {}  # by names in small letters, as DXF tells them apart
        self._entities: list[str] = []

    def add(self, kind: str, layer: str, what: str) -> None:
        """An entity on a layer, which is made where it is a new one."""
        # DXF forbids some characters in the names of layers.
        name = re.sub(r'[<>/\\":;?*|=`,\x00-\x1f]', "_", layer)
        if name.lower() not in self._layers:
            colour = _DXF_COLOURS[(len(self._layers) + _LAYERS) % len(_DXF_COLOURS)]
            self._layers[name.lower()] = (
                f"  0\nLAYER\n  5\n{self._next()}\n330\n1\n100\nAcDbSymbolTableRecord\n100\n"
                f"AcDbLayerTableRecord\n  2\n{name}\n 70\n0\n 62\n{colour}\n  6\nContinuous\n"
                "370\n-3\n390\n13\n347\n21\n"
            )
        head = f"  0\n{kind}\n  5\n{self._next()}\n330\n17\n100\nAcDbEntity\n  8\n{name}\n"
        self._entities.append(head + what)

    def _next(self) -> str:
        self._number += 1
        return f"{self._number - 1:X}"

    def text(self) -> str:
        """The drawing as a file."""
        text = (Path(__file__).parent / "drawing.dxf").read_text("utf-8")
        known = {
            "LAYER COUNT": str(len(self._layers) + _LAYERS),
            "LAYERS": "".join(self._layers.values()),
            "ENTITIES": "".join(self._entities), "FIRST": self._next(), "SECOND": self._next(),
            "THIRD": self._next(), "SEED": self._next(),
        }  # fmt: skip
        return re.sub("@([A-Z ]+)@", lambda found: known[found[1]], text)
