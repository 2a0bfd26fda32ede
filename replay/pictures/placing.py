"""Where everything of a page stands: sizes and places in inches, from the upper left, y down.

Pure: how wide a text comes out is asked of whoever draws it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from replay.pictures import style
from replay.pictures.parts import (
    Area,
    Box,
    Chart,
    Dots,
    Page,
    Panel,
    RobotMark,
    Strokes,
    Trail,
    Words,
)
from replay.pictures.style import Colour

Measure = Callable[[str, float, bool], float]  # a text, its size in points, bold → inches
Shape = Literal["cells", "line", "dashes", "dot", "area", "robot", "bar"]

_INCH_PT = 72.0
_KEY, _KEY_TEXT, _KEY_GAP = 0.30, 0.10, 0.30
_SIDE = 2.2  # least width of a column of keys beside the map
_LOWEST = 1.6  # height of a panel, however many rows there are
_ROOM = 7.4  # height for all panels together, below which a page fits a slide


@dataclass(frozen=True, slots=True)
class Key:
    """An entry of the legend. A ``bar`` is the scale: ``length_m`` long."""

    shape: Shape
    colour: Colour
    label: str
    length_m: float = 0.0


@dataclass(frozen=True, slots=True)
class PlacedKey:
    """An entry with the left end of its sign, the middle of its line, and the sign's width."""

    key: Key
    x: float
    y: float
    width: float


@dataclass(frozen=True, slots=True)
class PlacedText:
    """A line of text with its left end and its baseline."""

    text: str
    x: float
    y: float
    size_pt: float
    bold: bool = False
    pale: bool = False


@dataclass(frozen=True, slots=True)
class Place:
    """A rectangle on the page: its left and upper edge, its size."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Placed:
    """A whole page: how large it is, and where what stands. ``outer`` panels name their axes."""

    width: float
    height: float
    panels: tuple[Place, ...]
    texts: tuple[PlacedText, ...]
    keys: tuple[PlacedKey, ...]
    rows: int
    columns: int


def line_height(size_pt: float) -> float:
    """From one baseline to the next, inches."""
    return size_pt * style.LINE / _INCH_PT


def wrapped(
    text: str, width: float, size_pt: float, measure: Measure, *, bold: bool = False
) -> list[str]:
    """A text as lines that are no wider; a word that is wider alone is cut."""
    lines: list[str] = []
    for paragraph in text.split("\n"):
        line = ""
        for word in paragraph.split():
            longer = f"{line} {word}".lstrip()
            if measure(longer, size_pt, bold) <= width:
                line = longer
                continue
            if line:
                lines.append(line)
            line = _cut(word, width, lambda part: measure(part, size_pt, bold))
        lines.append(line)
    return lines


def _cut(word: str, width: float, measure: Callable[[str], float]) -> str:
    if measure(word) <= width:
        return word
    kept = word
    while len(kept) > 1 and measure(kept + "…") > width:
        kept = kept[:-1]
    return kept + "…"


def keys_of(page: Page) -> list[Key]:
    """What is on the page and has a name, each once, cells first."""
    keys: dict[tuple[str, str], Key] = {}
    for panel in page.panels:
        for swatch in panel.swatches:
            keys.setdefault(("cells", swatch.label), Key("cells", swatch.colour, swatch.label))
    for panel in page.panels:
        for mark in panel.marks:
            if isinstance(mark, Words) or not mark.label:
                continue
            match mark:
                case Strokes():
                    shape: Shape = "line"
                case Trail():
                    shape = "dashes" if mark.dashed else "line"
                case Dots():
                    shape = "dot"
                case Area():
                    shape = "area"
                case RobotMark():
                    shape = "robot"
            keys.setdefault((shape, mark.label), Key(shape, mark.colour, mark.label))
    return list(keys.values())


def round_length_m(most_m: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten that is no longer."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(k * power for k in (1, 2, 5) if k * power <= most_m * (1 + 1e-9))


def length_text(length_m: float) -> str:
    """``0.2 m``, ``2 cm``."""
    return f"{length_m:g} m" if length_m >= 0.1 else f"{100 * length_m:g} cm"


def place(page: Page, measure: Measure) -> Placed:
    """Where everything of a page stands."""
    inner = style.PAGE_WIDTH - 2 * style.MARGIN
    texts: list[PlacedText] = []
    y = style.MARGIN
    for text, size, bold, pale in (
        (page.title, style.TITLE_PT, True, False),
        (page.source, style.SMALL_PT, False, True),
    ):
        y = _write(texts, text, y, inner, size, measure, bold=bold, pale=pale)
    columns, rows, width, height = _grid_of(page.panels, inner, page.columns)
    titled = any(panel.title for panel in page.panels)
    panels, y = _panel_places(page, columns, width, height, y, measure, texts, titled=titled)
    maps = [panel for panel in page.panels if isinstance(panel, Panel) and panel.in_metres]
    scale = width / page.panels[0].frame.width_m
    one_scale = len({panel.frame.width_m for panel in maps}) == 1
    keys = [*(_scale_key(maps[0].frame, scale) if one_scale else []), *keys_of(page)]
    right = max(each.x + each.width for each in panels) + style.GAP
    left_over = style.PAGE_WIDTH - style.MARGIN - right
    if rows == 1 and left_over >= _SIDE and keys:
        signs, end = _keys_in_rows(keys, right, panels[0].y, 0.0, scale, measure)
        y = max(y, end + 0.1)
    else:
        signs, y = _keys_in_rows(keys, style.MARGIN, y, inner, scale, measure)
    if page.drawn_caption:
        y = _write(texts, page.caption, y + 0.06, inner, style.TEXT_PT, measure)
        y = _write(texts, page.footer, y + 0.04, inner, style.SMALL_PT, measure, pale=True)
    whole = min(y + style.MARGIN * 0.6, style.MOST_PAGE_HEIGHT)
    return Placed(style.PAGE_WIDTH, whole, tuple(panels), tuple(texts), tuple(signs), rows, columns)


def _write(
    texts: list[PlacedText], text: str, y: float, width: float, size_pt: float, measure: Measure,
    *, bold: bool = False, pale: bool = False, x: float = style.MARGIN,
) -> float:  # fmt: skip
    """Place a text that wraps; where the next thing may stand."""
    if not text:
        return y
    for line in wrapped(text, width, size_pt, measure, bold=bold):
        texts.append(PlacedText(line, x, y + size_pt / _INCH_PT, size_pt, bold, pale))
        y += line_height(size_pt)
    return y


def _grid_of(
    panels: Sequence[Panel | Chart], inner: float, most_columns: int
) -> tuple[int, int, float, float]:
    """Columns, rows, and the size of each panel: what makes the panels largest."""
    ratio = max(p.frame.height_m / p.frame.width_m for p in panels)
    best, most = (0, 0, 0.0, 0.0), 0.0
    for columns in range(1, min(most_columns, len(panels)) + 1):
        rows = math.ceil(len(panels) / columns)
        wide = (inner - columns * style.AXIS_LEFT - (columns - 1) * style.GAP) / columns
        other = style.AXIS_BELOW + style.PANEL_TITLE
        tall = min(max(_ROOM / rows - other, _LOWEST), style.TALLEST_PANEL)
        width = min(wide, tall / ratio)
        # An empty place looks like a lost panel.
        worth = width * (len(panels) / (rows * columns)) ** 2
        if worth >= most:
            best, most = (columns, rows, width, width * ratio), worth
    return best


def _panel_places(
    page: Page, columns: int, width: float, height: float, y: float, measure: Measure,
    texts: list[PlacedText], *, titled: bool,
) -> tuple[list[Place], float]:  # fmt: skip
    places = []
    step = width + style.AXIS_LEFT + style.GAP
    for first in range(0, len(page.panels), columns):
        some = page.panels[first : first + columns]
        below = y + 0.08
        for k, panel in enumerate(some):
            x = style.MARGIN + style.AXIS_LEFT + k * step
            end = _write(
                texts, panel.title, y + 0.08, width + style.GAP * 0.7, style.TEXT_PT, measure,
                bold=True, x=x,
            )  # fmt: skip
            below = max(below, end)
        for k, panel in enumerate(some):
            x = style.MARGIN + style.AXIS_LEFT + k * step
            own = min(height, width * panel.frame.height_m / panel.frame.width_m)
            places.append(Place(x, below + 0.04, width, own if len(page.panels) == 1 else height))
        y = below + height + style.AXIS_BELOW + (0.04 if titled else 0.0)
    return places, y


def _scale_key(frame: Box, scale: float) -> list[Key]:
    length_m = round_length_m(min(0.25 * frame.width_m, 1.6 / scale))
    return [Key("bar", style.INK, length_text(length_m), length_m)]


def _keys_in_rows(
    keys: Sequence[Key], x0: float, y: float, width: float, scale: float, measure: Measure
) -> tuple[list[PlacedKey], float]:
    """The keys side by side, in as many lines as it takes; where the next thing may stand."""
    signs: list[PlacedKey] = []
    step, x = line_height(style.TEXT_PT) * 1.12, x0
    middle = y + step / 2
    for key in keys:
        sign = key.length_m * scale if key.shape == "bar" else _KEY
        wide = sign + _KEY_TEXT + measure(key.label, style.TEXT_PT, False)
        if x > x0 and x + wide > x0 + width:
            x, middle = x0, middle + step
        signs.append(PlacedKey(key, x, middle, sign))
        x += wide + _KEY_GAP
    return signs, middle + step / 2
