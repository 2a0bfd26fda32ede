"""DXF by the library that is made for it: what the program's own drawings must equal."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import ezdxf
from ezdxf import options  # type: ignore[attr-defined]  # its documented place

from mapping.artifacts import Border, Segment


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
