"""Features from a grid: thresholds, borders and how they are traced, lines fitted to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, Segment, Thresholded
from mapping.borders import DIRECTIONS, trace_borders, walk_border
from mapping.config import SegmentsSection
from mapping.config_sections import FusionSection
from mapping.fusion import fuse
from mapping.grid import GridGeometry, Layer
from mapping.segments import segments_from_borders
from replay.pictures import style
from replay.pictures.figures.bench import CHAPTER, Bench, Role
from replay.pictures.figures.figure import Drawing, Figure, LeftOut
from replay.pictures.figures.shading import (
    blank,
    dots,
    numbers_at,
    percent,
    probable,
    segment_strokes,
    walls,
    yes_no,
)
from replay.pictures.parts import Box, Cells, Dots, Mark, Panel, Strokes, Swatch, Trail, Words

FEATURES, THRESHOLDING = "Extracting Features", "Thresholding"
DETECTION, FITTING = "Border Detection", "Fitting Lines"
THRESHOLDS = (0.51, 0.55, 0.60)
_MOST_NUMBERS = 25
# The chapter's way of looking around a pixel, on a figure with a bay and a single cell.
_EXAMPLE = np.array(
    [
        [0, 0, 0, 0, 0, 0, 0, 0],
        [0, 1, 1, 1, 1, 0, 1, 0],
        [0, 1, 1, 1, 1, 0, 0, 0],
        [0, 1, 1, 0, 0, 0, 0, 0],
        [0, 1, 1, 1, 1, 1, 0, 0],
        [0, 0, 0, 0, 0, 0, 0, 0],
    ],
    np.bool_,
)


def _chapter(bench: Bench, role: Role) -> Layer:
    return bench.layer(role, **CHAPTER)


def _fused(bench: Bench) -> Layer:
    sonar, narrow = bench.both
    layers = [_chapter(bench, role) for role in (sonar, narrow)]
    return fuse(layers, [sonar.sensor, narrow.sensor], FusionSection(rule="weights"))


def _instead(bench: Bench) -> Drawing:
    role = bench.any_ranger
    points, _ = bench.points(role)
    panels = (
        blank(bench, "raw points", [*walls(bench), dots(bench, role, points)]),
        probable(bench, "the grid of the same readings", _chapter(bench, role)),
    )
    caption = (
        f"Raw points of {role.sensor.name} hold every error, and need an order; its grid has the "
        "errors weighed, in any order."
    )
    return Drawing(panels, caption)


def _thresholds(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = _chapter(bench, role)
    panels, counts = [], []
    for threshold in THRESHOLDS:
        occupied, _ = bench.borders(layer, threshold)
        counts.append(int(occupied.sum()))
        panels.append(yes_no(bench, f"p > {threshold:.2f}", occupied, layer))
    caption = (
        f"In the end a robot must decide. Of {role.sensor.name}'s map {counts[0]:,}, {counts[1]:,} "
        f"and {counts[2]:,} cells are above 0.51, 0.55 and 0.60."
    )
    return Drawing(tuple(panels), caption)


def _example_panel(title: str, marks: Sequence[Mark]) -> Panel:
    geometry = GridGeometry((0.0, 0.0), 1.0, *_EXAMPLE.shape)
    shade = np.where(_EXAMPLE, 90, 255).astype(np.uint8)
    pixels = np.repeat(shade[..., None], 3, axis=2)
    grey = Swatch((90 / 255,) * 3, "occupied")
    cells = Cells(geometry, pixels)
    frame = Box(0.0, 0.0, 8.0, 6.0)
    return Panel(title, frame, cells, (grey,), tuple(marks), in_metres=False)


def _centre(cell: tuple[int, int]) -> tuple[float, float]:
    return cell[1] + 0.5, cell[0] + 0.5


def _directions(bench: Bench) -> Drawing:
    del bench
    (border, *_) = trace_borders(_EXAMPLE)
    step = list(walk_border(_EXAMPLE, border))[6]
    marks: list[Mark] = []
    for number, (row, col) in enumerate(DIRECTIONS):
        at = _centre((step.cell[0] + row, step.cell[1] + col))
        marks.append(Words(at, str(number), style.INK))
    tried = [_centre((step.cell[0] + DIRECTIONS[d][0], step.cell[1] + DIRECTIONS[d][1]))
             for d in step.tried]  # fmt: skip
    here = np.array([_centre(step.cell)])
    looks = np.stack([np.repeat(here, len(tried), axis=0), np.array(tried)], axis=1)
    marks = [
        Strokes(looks[:-1], style.MORE_OCCUPIED, 1.2, "looked at, free"),
        Strokes(looks[-1:], style.MORE_FREE, 2.4, "the first that is occupied"),
        Dots(here, style.BORDER, 9.0, "where the tracer stands"), *marks,
    ]  # fmt: skip
    caption = (
        "Around a cell the directions are numbered from the right, counter-clockwise. The tracer "
        "begins to look behind the way it came, and goes to the first occupied cell: here it tries "
        f"{', '.join(str(d) for d in step.tried)}. The example is drawn by hand."
    )
    return Drawing((_example_panel("", marks),), caption)


def _walk(bench: Bench) -> Drawing:
    del bench
    borders = trace_borders(_EXAMPLE)
    marks: list[Mark] = []
    for border in borders:
        centres = np.array([_centre((r, c)) for r, c in border.cells.tolist()])
        marks.append(Trail(centres, style.BORDER, 2.2, "border", closed=True))
        marks.append(Dots(centres[:1], style.MORE_OCCUPIED, 7.0, "where it starts"))
    first = borders[0]
    marks += numbers_at([_centre((r, c)) for r, c in first.cells.tolist()])
    caption = (
        f"The first border, step by step: {len(first.cells)} cells, from the first occupied one "
        "that a scan from the upper left meets, until it moves as it did at first. The single "
        "cell is a border of its own. The example is drawn by hand."
    )
    return Drawing((_example_panel("", marks),), caption)


def _border_marks(borders: Sequence[Border]) -> list[Mark]:
    """Borders, and a number at the largest of them."""
    marks: list[Mark] = []
    for border in borders:
        centres = border.geometry.centres_of(border.cells)
        marks.append(Trail(centres, style.BORDER, 1.0, "borders", closed=True))
    largest = sorted(borders, key=lambda b: -len(b.cells))[:_MOST_NUMBERS]
    for border in largest:
        x, y = border.geometry.centres_of(border.cells[:1])[0].tolist()
        marks.append(Words((x, y), str(border.number + 1), style.INK))
    return marks


def _numbered(bench: Bench, title: str, layer: Layer, threshold: float) -> tuple[Panel, int]:
    _, borders = bench.borders(layer, threshold)
    panel = blank(
        bench, f"{title}: {len(borders)} borders", [*walls(bench), *_border_marks(borders)]
    )
    return panel, len(borders)


def _borders_sonar(bench: Bench) -> Drawing:
    role = bench.sonar
    found = [
        _numbered(bench, f"p > {threshold:.2f}", _chapter(bench, role), threshold)
        for threshold in THRESHOLDS
    ]
    a, b, c = (count for _, count in found)
    caption = (
        f"The borders of {role.sensor.name}'s map above three thresholds: {a}, {b} and {c}. Many "
        f"are small; the {_MOST_NUMBERS} longest at most bear their numbers, in the order of a "
        "scan from the upper left."
    )
    return Drawing(tuple(panel for panel, _ in found), caption)


def _borders_narrow(bench: Bench) -> Drawing:
    role = bench.narrow
    panel, count = _numbered(bench, "p > 0.51", _chapter(bench, role), 0.51)
    caption = (
        f"The map of {role.sensor.name} falls into {count} borders: its cells hardly hang together."
    )
    return Drawing((panel,), caption)


def _border_to_lines(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = _chapter(bench, role)
    occupied, borders = bench.borders(layer, 0.51)
    if not borders:
        raise LeftOut(f"no cell of {role.sensor.name} lies above 0.51")
    border = max(borders, key=lambda b: len(b.cells))
    lines = _lines(layer, occupied, [border])
    centres = border.geometry.centres_of(border.cells)
    frame = Box.around(centres, 0.08)
    panels = (
        Panel("its cells, in order", frame, None, (),
              (Dots(centres, style.BORDER, 2.2, "border cells"),)),
        Panel(f"{len(lines)} lines", frame, None, (),
              (Trail(centres, style.BORDER, 0.8, "border", closed=True),
               *segment_strokes(lines))),
    )  # fmt: skip
    caption = (
        f"A border is a row of points in order, here the longest of {role.sensor.name} with "
        f"{len(border.cells):,} cells: the same methods fit lines to it as to raw points."
    )
    return Drawing(panels, caption)


def _lines(layer: Layer, occupied: NDArray[np.bool_], borders: Sequence[Border]) -> list[Segment]:
    """By the incremental method, as the chapter does."""
    section = SegmentsSection.model_validate({"method": "incremental", "min_length_m": 0.08})
    thresholded = Thresholded(layer.name, layer.geometry, 0.0, occupied)
    return (
        segments_from_borders(list(borders), section, observed=layer.observed)
        if (thresholded.occupied.any())
        else []
    )


def _fitted(bench: Bench, layer: Layer, threshold: float) -> Drawing:
    occupied, borders = bench.borders(layer, threshold)
    lines = _lines(layer, occupied, borders)
    marks: list[Mark] = []
    for border in borders:
        centres = border.geometry.centres_of(border.cells)
        marks.append(Trail(centres, style.BORDER, 0.7, "borders", closed=True))
    marks += segment_strokes(lines)
    longest = max((line.length_m for line in lines), default=0.0)
    which = f"the longest of {longest:.2f} m" if lines else "all borders being too short"
    caption = (
        f"{len(lines)} lines fitted to the {len(borders)} borders of {layer.name} above "
        f"{percent(threshold)} by the incremental method, {which}."
    )
    return Drawing((probable(bench, "", layer, marks),), caption)


def _lines_sonar_low(bench: Bench) -> Drawing:
    return _fitted(bench, _chapter(bench, bench.sonar), 0.51)


def _lines_sonar_high(bench: Bench) -> Drawing:
    return _fitted(bench, _chapter(bench, bench.sonar), 0.60)


def _lines_narrow(bench: Bench) -> Drawing:
    return _fitted(bench, _chapter(bench, bench.narrow), 0.51)


def _lines_fused(bench: Bench) -> Drawing:
    return _fitted(bench, _fused(bench), 0.51)


def _lines_all(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = _chapter(bench, role)
    panels, counts = [], []
    for threshold in THRESHOLDS:
        occupied, borders = bench.borders(layer, threshold)
        lines = _lines(layer, occupied, borders)
        counts.append(len(lines))
        marks = [*walls(bench), *segment_strokes(lines)]
        panels.append(blank(bench, f"p > {threshold:.2f}: {len(lines)} lines", marks))
    caption = (
        f"The lines of {role.sensor.name} at the three thresholds, {counts[0]}, {counts[1]} and "
        f"{counts[2]}: a higher one leaves less, and surer, of the walls."
    )
    return Drawing(tuple(panels), caption)


FIGURES = (
    Figure("grid-instead", FEATURES, "A grid instead of points", _instead),
    Figure("thresholds", THRESHOLDING, "Above 0.51, 0.55 and 0.60", _thresholds),
    Figure("directions", DETECTION, "Directions around a cell", _directions),
    Figure("border-traced", DETECTION, "A border traced", _walk),
    Figure("borders-sonar", DETECTION, "Borders of the sonar's map", _borders_sonar),
    Figure("borders-infrared", DETECTION, "Borders of the infrared's map", _borders_narrow),
    Figure("border-to-lines", FITTING, "From a border to lines", _border_to_lines),
    Figure("lines-thresholds", FITTING, "Lines at the three thresholds", _lines_all),
    Figure("lines-sonar-low", FITTING, "Lines on the sonar's map at 0.51", _lines_sonar_low),
    Figure("lines-sonar-high", FITTING, "Lines on the sonar's map at 0.60", _lines_sonar_high),
    Figure("lines-infrared", FITTING, "Lines on the infrared's map at 0.51", _lines_narrow),
    Figure("lines-fused", FITTING, "Lines on the fused map at 0.51", _lines_fused),
)
