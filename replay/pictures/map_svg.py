"""A layer as an SVG drawing whose user unit is the metre: the map, its lines, axes and a scale.

SVG has y down, so y is negated: the map stands upright. Borders and segments are paths of their own
with ``data-layer`` and ``data-border``, for programs that go on with them. On paper it fills an A4
page. The library that writes it is imported when it is needed.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from PIL import Image

from mapping.artifacts import Border, Segment
from mapping.grid import Layer
from recorder.names import printable
from replay.pictures import style
from replay.pictures.parts import Box, Floats
from replay.pictures.placing import length_text, round_length_m
from replay.pictures.views import box_of, frame_around, grey_pixels, whole_of

_PAGE_MM = (277.0, 190.0)  # of A4, within the edges that printers leave
_LEFT_MM, _RIGHT_MM, _ABOVE_MM, _BELOW_MM = 14.0, 3.0, 11.0, 19.0
_TEXT_MM, _TITLE_MM = 3.4, 5.0
_NOWHERE = Box(-0.5, -0.5, 0.5, 0.5)


@dataclass(frozen=True, slots=True)
class _Paper:
    """The frame of the map on the paper: ``mm`` is the length of one, in metres of the map."""

    frame: Box
    mm: float

    @classmethod
    def of(cls, frame: Box) -> _Paper:
        """As large as fits the page, which lies as suits the map."""
        sizes = []
        for width, height in (_PAGE_MM, _PAGE_MM[::-1]):
            free = width - _LEFT_MM - _RIGHT_MM, height - _ABOVE_MM - _BELOW_MM
            sizes.append(max(frame.width_m / free[0], frame.height_m / free[1]))
        return cls(frame, min(sizes))

    @property
    def box(self) -> Box:
        """The whole paper in metres of the map."""
        f, mm = self.frame, self.mm
        return Box(
            f.x0 - _LEFT_MM * mm, f.y0 - _BELOW_MM * mm, f.x1 + _RIGHT_MM * mm,
            f.y1 + _ABOVE_MM * mm,
        )  # fmt: skip


def map_svg(
    segments: Sequence[Segment],
    borders: Sequence[Border] = (),
    *,
    layer: Layer | None = None,
    path_m: Floats | None = None,
) -> str:
    """The drawing as text; ``path_m`` (N, 2) is where the robot was. Same map, same text.

    All segments lie on the page, and the path; what of borders lies elsewhere is in the file, but
    not on the page.
    """
    import drawsvg

    ends = np.array([(s.start_m, s.end_m) for s in segments]).reshape(-1, 2, 2)
    path = np.zeros((0, 2)) if path_m is None else path_m
    paper = _Paper.of(_frame(ends, path, borders, layer))
    box = paper.box
    drawing = drawsvg.Drawing(box.width_m, box.height_m, origin=(box.x0, -box.y1))
    names = list(dict.fromkeys([s.layer for s in segments] + [b.layer for b in borders]))
    if layer is not None:
        names = [layer.name]
    for piece in (
        *_ground(drawsvg, paper, layer), *_lines(drawsvg, paper, segments, borders, path),
        *_axes(drawsvg, paper), *_texts(drawsvg, paper, " ".join(names)),
        *_legend(drawsvg, paper, segments, borders, path, layer),
    ):  # fmt: skip
        drawing.append(piece)
    drawing.set_render_size(f"{box.width_m / paper.mm:.6g}mm", f"{box.height_m / paper.mm:.6g}mm")
    svg: str = drawing.as_svg()
    return svg


def _frame(ends: Floats, path: Floats, borders: Sequence[Border], layer: Layer | None) -> Box:
    """Around all lines and the path; else around the borders, or the whole map."""
    if len(ends) or len(path):
        points = np.concatenate([ends.reshape(-1, 2), path])
        around = frame_around(points, ends[:0], ends[:0])
        assert around is not None
        return around
    if borders:
        outlines = np.concatenate([b.geometry.centres_of(b.cells) for b in borders])
        return Box.around(outlines, 0.06, 0.5)
    return _NOWHERE if layer is None else whole_of(layer.geometry)


def _ground(svg: Any, paper: _Paper, layer: Layer | None) -> Iterator[Any]:
    """White paper, the map in grey as a picture, a thin line around it."""
    box, frame = paper.box, paper.frame
    white = {"fill": "#ffffff"}
    yield svg.Rectangle(box.x0, -box.y1, box.width_m, box.height_m, **white)
    if layer is not None:
        low, high = frame.corners_m
        window = layer.geometry.window_around(low, high)
        if not window.empty:
            known = layer.observed & np.isfinite(layer.probability)
            pixels = grey_pixels(layer.probability[window.slices], known[window.slices])
            file = io.BytesIO()
            Image.fromarray(np.ascontiguousarray(pixels[::-1])).save(file, format="PNG")
            at = box_of(layer.geometry, window)
            yield svg.Image(
                at.x0, -at.y1, at.width_m, at.height_m, data=file.getvalue(),
                mime_type="image/png", preserveAspectRatio="none", clip_path=_inside(svg, paper),
                style="image-rendering: pixelated",
            )  # fmt: skip
    line = {"fill": "none", "stroke": _hex(style.PALE_INK), "stroke_width": 0.2 * paper.mm}
    yield svg.Rectangle(frame.x0, -frame.y1, frame.width_m, frame.height_m, **line)


def _inside(svg: Any, paper: _Paper) -> Any:
    """What lets only the frame be seen."""
    frame, clip = paper.frame, svg.ClipPath()
    clip.append(svg.Rectangle(frame.x0, -frame.y1, frame.width_m, frame.height_m))
    return clip


def _lines(
    svg: Any, paper: _Paper, segments: Sequence[Segment], borders: Sequence[Border], path: Floats
) -> Iterator[Any]:
    """The path, the borders, and the straight lines over them."""
    if len(path) > 1:
        corners = " ".join(f"{x:.6g},{-y:.6g}" for x, y in path.tolist())
        look = f'fill="none" stroke="{_hex(style.PATH)}" stroke-width="{0.35 * paper.mm:.6g}"'
        yield svg.Raw(f'<polyline points="{corners}" {look} />')
    inside = _inside(svg, paper)
    for border in borders:
        outline = border.geometry.centres_of(border.cells)
        corners_m = [v for x, y in outline.tolist() for v in (x, -y)]
        look_m = {"fill": "none", "stroke": _hex(style.BORDER), "stroke_width": 0.3 * paper.mm}
        attributes = {"data-layer": escape(border.layer), "data-border": border.number}
        yield svg.Lines(*corners_m, close=True, clip_path=inside, **look_m, **attributes)
    for segment in segments:
        (x0, y0), (x1, y1) = segment.start_m, segment.end_m
        look_m = {"stroke": _hex(style.FOUND_WALL), "stroke_width": 0.8 * paper.mm}
        attributes = {"data-layer": escape(segment.layer)}  # drawsvg writes attributes as they are
        if segment.border is not None:
            attributes["data-border"] = str(segment.border)
        yield svg.Line(x0, -y0, x1, -y1, stroke_linecap="round", **look_m, **attributes)


def _axes(svg: Any, paper: _Paper) -> Iterator[Any]:
    """Ticks and their numbers, in metres, along the lower and the left edge."""
    frame, mm = paper.frame, paper.mm
    step = round_length_m(max(frame.width_m, frame.height_m) / 5.0)
    digits = max(0, -int(np.floor(np.log10(step))))
    ink = {"fill": _hex(style.PALE_INK)}
    for x in _ticks(frame.x0, frame.x1, step):
        yield svg.Rectangle(x - 0.1 * mm, -frame.y0, 0.2 * mm, 1.2 * mm, **ink)
        yield _text(svg, paper, f"{x:.{digits}f}", x, frame.y0 - 5.0 * mm, anchor="middle")
    for y in _ticks(frame.y0, frame.y1, step):
        yield svg.Rectangle(frame.x0 - 1.2 * mm, -y - 0.1 * mm, 1.2 * mm, 0.2 * mm, **ink)
        text = f"{y:.{digits}f}"
        yield _text(svg, paper, text, frame.x0 - 2.0 * mm, y - 1.1 * mm, anchor="end")


def _ticks(low: float, high: float, step: float) -> list[float]:
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return [k * step for k in range(first, last + 1)]


def _texts(svg: Any, paper: _Paper, name: str) -> Iterator[Any]:
    """The title; that the numbers are metres; the scale on paper, and as a bar."""
    frame, mm = paper.frame, paper.mm
    title = f"{printable(name)}: map and walls" if name else "map and walls"
    yield _text(svg, paper, title, frame.x0, frame.y1 + 4.0 * mm, size=_TITLE_MM, bold=True)
    low = frame.y0 - 10.5 * mm
    length_m = round_length_m(min(50.0 * mm, frame.width_m * 0.3))
    yield svg.Rectangle(frame.x0, -low - 1.3 * mm, length_m, 0.5 * mm, fill=_hex(style.INK))
    scale = f"{length_text(length_m)}   (1 : {1000.0 * mm:.3g} on A4; x and y in metres)"
    yield _text(svg, paper, scale, frame.x0 + length_m + 2.0 * mm, low)


def _legend(
    svg: Any, paper: _Paper, segments: Sequence[Segment], borders: Sequence[Border], path: Floats,
    layer: Layer | None,
) -> Iterator[Any]:  # fmt: skip
    """A coloured box and its meaning, for what is there."""
    entries = [("walls found", style.FOUND_WALL)] if segments else []
    entries += [("borders of occupied cells", style.BORDER)] if borders else []
    entries += [("path", style.PATH)] if len(path) > 1 else []
    if layer is not None:
        entries += [
            ("free", style.FREE), ("occupied", style.OCCUPIED), ("never seen", style.NEVER_SEEN)
        ]  # fmt: skip
    x, y, mm = paper.frame.x0, paper.frame.y0 - 16.0 * paper.mm, paper.mm
    for text, colour in entries:
        edge = {"stroke": _hex(style.PALE_INK), "stroke_width": 0.15 * mm, "fill": _hex(colour)}
        yield svg.Rectangle(x, -y - 2.4 * mm, 4.0 * mm, 2.4 * mm, **edge)
        yield _text(svg, paper, text, x + 5.2 * mm, y)
        x += (8.5 + 0.56 * _TEXT_MM * len(text)) * mm


def _text(
    svg: Any, paper: _Paper, text: str, x: float, y: float, *, size: float = _TEXT_MM,
    anchor: str = "start", bold: bool = False,
) -> Any:  # fmt: skip
    """A text at a place of the map, set in millimetres: letters of some centimetres of a unit are
    more than some programs can set."""
    weight = ' font-weight="bold"' if bold else ""
    return svg.Raw(
        f'<text transform="translate({x:.6g} {-y:.6g}) scale({paper.mm:.6g})" font-size="{size:g}" '
        f'font-family="DejaVu Sans, Arial, sans-serif" text-anchor="{anchor}"{weight} '
        f'fill="{_hex(style.INK)}">{escape(text)}</text>'
    )


def _hex(colour: style.Colour) -> str:
    return "#" + "".join(f"{round(255 * each):02x}" for each in colour)
