"""Maps and single readings → panels: which grey stands for what, and the signs over it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment, TempGrid
from mapping.beams import Beam
from mapping.grid import Layer
from recorder.geometry import SE2
from replay.pictures import style
from replay.pictures.figures.bench import Bench, Role, box_of_beam
from replay.pictures.parts import (
    Area,
    Box,
    Cells,
    Dots,
    Floats,
    Mark,
    Panel,
    RobotMark,
    Strokes,
    Swatch,
    Trail,
    Words,
)
from replay.pictures.style import Colour
from replay.pictures.views import GREY_SWATCHES, grey_pixels
from replay.rrd.pictures import beam_outline

_LEAST_SHADE = 0.12
_SEEN = np.round(255.0 * np.array(style.NEVER_SEEN)).astype(np.uint8)


def walls(bench: Bench) -> list[Mark]:
    """The true walls, where they are known."""
    return (
        [Strokes(bench.walls_m, style.TRUE_WALL, 0.9, "true walls")] if len(bench.walls_m) else []
    )


def path(bench: Bench) -> list[Mark]:
    """Where the robot went."""
    return [Trail(bench.path_m, style.PATH, 1.1, "path")] if len(bench.path_m) > 1 else []


def colour_of(bench: Bench, role: Role) -> Colour:
    """The colour of a role's sensor."""
    return style.sensor_colour(role.sensor.name, bench.sensors)


def blank(bench: Bench, title: str, marks: Sequence[Mark], frame: Box | None = None) -> Panel:
    """White paper with marks."""
    return Panel(title, frame or bench.frame, None, (), tuple(marks))


def probable(bench: Bench, title: str, layer: Layer, marks: Sequence[Mark] = ()) -> Panel:
    """A map of probabilities: white free, black occupied, blue-grey never seen."""
    cells = Cells(layer.geometry, grey_pixels(layer.probability, layer.observed))
    return Panel(title, bench.frame, cells, GREY_SWATCHES, (*walls(bench), *marks))


def shares(
    bench: Bench, title: str, values: NDArray[np.floating], layer: Layer,
    words: tuple[str, str] = ("none", "most"), marks: Sequence[Mark] = (),
) -> Panel:  # fmt: skip
    """Values from 0 (white) to the largest (black); never seen stays so."""
    largest = float(np.max(values, initial=0.0))
    shade = np.asarray(values, np.float64) / (largest or 1.0)
    cells = Cells(layer.geometry, grey_pixels(shade, layer.observed))
    swatches = (
        Swatch(style.FREE, words[0]), Swatch(style.OCCUPIED, words[1]), GREY_SWATCHES[2]
    )  # fmt: skip
    return Panel(title, bench.frame, cells, swatches, (*walls(bench), *marks))


def counts(
    bench: Bench, title: str, layer: Layer, words: tuple[str, str] = ("never", "most often")
) -> Panel:
    """What was added up in each cell: where nothing was, white; anything more can be seen."""
    all_cells = replace(layer, observed=np.ones_like(layer.observed))
    share = layer.values / max(float(layer.values.max()), 1e-9)
    shade = np.where(share > 0.0, _LEAST_SHADE + (1.0 - _LEAST_SHADE) * share, 0.0)
    panel = shares(bench, title, shade, all_cells, words)
    return replace(panel, swatches=panel.swatches[:2])


def yes_no(
    bench: Bench, title: str, occupied: NDArray[np.bool_], layer: Layer,
    marks: Sequence[Mark] = (),
) -> Panel:  # fmt: skip
    """Cells that are taken as occupied in black, all others white."""
    cells = Cells(layer.geometry, grey_pixels(occupied.astype(np.float64), np.ones_like(occupied)))
    swatches = (Swatch(style.FREE, "not"), Swatch(style.OCCUPIED, "taken as occupied"))
    return Panel(title, bench.frame, cells, swatches, (*walls(bench), *marks))


def evidence(
    title: str, temp: TempGrid, marks: Sequence[Mark] = (), frame: Box | None = None
) -> Panel:
    """What one reading says of each cell: each side of one half stretched to its largest."""
    p = temp.probability
    above, below = float(np.max(p - 0.5, initial=0.0)), float(np.max(0.5 - p, initial=0.0))
    shade = 0.5 + np.where(p > 0.5, (p - 0.5) / (2 * (above or 1)), (p - 0.5) / (2 * (below or 1)))
    pixels = np.full((*temp.geometry.shape, 3), 0, np.uint8)
    pixels[:] = _SEEN
    touched = (p != 0.5) | temp.band
    pixels[temp.window.slices] = grey_pixels(shade, touched)
    swatches = [Swatch(style.OCCUPIED, "strongest for an obstacle")]
    if below:
        swatches.append(Swatch(style.FREE, "strongest against one"))
    swatches.append(Swatch(style.NEVER_SEEN, "not touched"))
    cells = Cells(temp.geometry, pixels)
    outline = Trail(beam_outline(temp.beam)[0], style.INK, 0.6, "beam", closed=True)
    frame = frame or box_of_beam(temp.beam)
    return Panel(title, frame, cells, tuple(swatches), (outline, *marks))


def counted(title: str, values: NDArray[np.floating], temp: TempGrid) -> Panel:
    """How often the samples of one reading hit each cell of its window."""
    largest = float(values.max(initial=0.0))
    pixels = np.full((*temp.geometry.shape, 3), 255, np.uint8)
    pixels[temp.window.slices] = grey_pixels(values / (largest or 1.0), np.ones(values.shape, bool))
    swatches = (Swatch(style.FREE, "not counted"), Swatch(style.OCCUPIED, "counted most often"))
    hit = np.argwhere(values > 0) + np.array([temp.window.row0, temp.window.col0])
    frame = Box.around(temp.geometry.centres_of(hit), 0.06, 4 * temp.geometry.resolution_m)
    return Panel(title, frame, Cells(temp.geometry, pixels), swatches)


def cone(bench: Bench, beam: Beam, error: float = 0.0, label: str = "") -> list[Mark]:
    """A beam as a wedge, and the edges of its band where the range has an error."""
    colour = style.sensor_colour(beam.sensor, bench.sensors)
    marks: list[Mark] = [Area(beam_outline(beam)[0], colour, label or f"beam of {beam.sensor}")]
    if error and len(beam.ranges_m) == 1:
        marks += [
            Trail(arc_m(beam, float(beam.ranges_m[0]) * factor), colour, 1.0, dashed=True)
            for factor in (1.0 - error, 1.0 + error)
        ]
    return marks


def arc_m(beam: Beam, range_m: float, count: int = 61) -> Floats:
    """Points (N, 2) along the arc of a beam at a range."""
    low, high = beam.spread_rad
    angle = beam.world_from_sensor.heading_rad + np.linspace(low, high, count)
    at = beam.world_from_sensor
    return np.column_stack([at.x_m + range_m * np.cos(angle), at.y_m + range_m * np.sin(angle)])


def robot(pose: SE2) -> list[Mark]:
    """The robot at a place."""
    return [RobotMark(pose, style.ROBOT)]


def dots(bench: Bench, role: Role, points_m: Floats, size_pt: float = 2.6) -> Dots:
    """The obstacle points of a role."""
    return Dots(points_m, colour_of(bench, role), size_pt, f"points of {role.sensor.name}")


def segment_strokes(segments: Sequence[Segment], label: str = "lines found") -> list[Mark]:
    """Straight lines, magenta."""
    ends = np.array([(s.start_m, s.end_m) for s in segments], np.float64).reshape(-1, 2, 2)
    return [Strokes(ends, style.FOUND_WALL, 2.0, label)] if len(ends) else []


def numbers_at(places: Sequence[tuple[float, float]], first: int = 1) -> list[Mark]:
    """1, 2, 3 at some places."""
    return [Words(at, str(number), style.INK) for number, at in enumerate(places, first)]


def degrees(rad: float) -> str:
    """``38°``."""
    return f"{math.degrees(rad):.3g}°"


def percent(share: float) -> str:
    """``10 %``."""
    return f"{100 * share:.3g} %"
