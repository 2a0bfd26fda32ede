"""One picture of a comparison: for each layer A, B and their difference side by side.

Greys are probabilities as everywhere (white free, black occupied); what was never seen is
blue-grey. In the difference, red cells are more occupied in B and blue ones more free, over the
walls that both share in grey. Walls that changed are outlined, and so is the cell that differs
most.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from mapping.grid import Window
from recorder.errors import BadInput
from recorder.outputs import written_beside
from replay.diff.alignment import Aligned, Shades
from replay.diff.cells import distances
from replay.diff.comparing import LayerReport, Report
from replay.diff.layers import FREE, OCCUPIED, UNKNOWN, Codes
from replay.diff.patches import Ends
from replay.swatches import GAP_PX, INK, PAPER, UNSEEN, legend, letters, wrapped

Pixels = NDArray[np.uint8]

_MORE_OCCUPIED, _MORE_FREE, _BOTH = (214, 39, 40), (31, 100, 210), (190, 190, 190)
_GONE, _COME, _WORST = (255, 127, 14), (44, 140, 44), (160, 32, 200)
_PANEL_PX, _HIGHEST_PX, _LARGEST_CELL_PX = 400, 400, 24.0
_TEXT_PX = 17
_AIR_CELLS = 3  # around what was seen
_MOST_LAYERS = 4
_CLASS_SHADE = {FREE: 0.0, OCCUPIED: 1.0}
_LEGEND = (
    (PAPER, "free"), ((0, 0, 0), "occupied"), (UNSEEN, "never seen"),
    (_MORE_OCCUPIED, "more occupied in B"),
    (_MORE_FREE, "more free in B"), (_BOTH, "occupied in both"), (_GONE, "wall only in A"),
    (_COME, "wall only in B"), (_WORST, "the cell that differs most"),
)  # fmt: skip


def draw(report: Report) -> Image.Image:
    """The picture: a row for each layer that differs (or for all, when none does), at most four."""
    chosen = [layer for layer in report.layers if layer.differs] or list(report.layers)
    chosen = chosen[:_MOST_LAYERS]
    rows = [_row(layer, report) for layer in chosen]
    font = letters(_TEXT_PX)
    width = max(row.width for row in rows)
    verdict = wrapped("verdict: " + report.verdict.text, width - 2 * GAP_PX, font, indent="   ")
    head = [f"A: {report.a.path.name}   B: {report.b.path.name}", *verdict]
    line = _TEXT_PX + 7
    below = legend(_LEGEND, width, _TEXT_PX, ringed=[_WORST])
    height = len(head) * line + sum(r.height for r in rows) + below.height + 2 * GAP_PX
    page = Image.new("RGB", (width, height), PAPER)
    pen = ImageDraw.Draw(page)
    y = GAP_PX // 2
    for text in head:
        pen.text((GAP_PX, y), text, INK, font)
        y += line
    for each in [*rows, below]:
        page.paste(each, (0, y))
        y += each.height
    return page


def save_picture(report: Report, path: Path) -> None:
    """Write the picture as PNG, beside its name first. Raises BadInput where it cannot be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_beside(path) as part:
            draw(report).save(part, format="PNG", optimize=True)
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror or error}") from error


def _row(layer: LayerReport, report: Report) -> Image.Image:
    pair = layer.pair
    window = _seen_part(pair)
    scale = min(_PANEL_PX / window.cols, _HIGHEST_PX / window.rows, _LARGEST_CELL_PX)
    panels = [
        _enlarged(pixels, window, scale)
        for pixels in (
            map_pixels(pair.a_shades, pair.a_classes, by_class=pair.by_class),
            map_pixels(pair.b_shades, pair.b_classes, by_class=pair.by_class),
            difference_pixels(pair),
        )
    ]
    _mark(panels[2], layer, report, window, scale)
    _scale_bar(panels[0], pair.geometry.resolution_m, scale)
    cells = layer.cells
    titles = (
        f"layer {layer.name}: A",
        "B",
        f"difference: {cells.differ:,} of {cells.compared:,} cells",
    )
    size = (3 * _PANEL_PX + 4 * GAP_PX, panels[0].height + _TEXT_PX + 2 * GAP_PX)
    row = Image.new("RGB", size, PAPER)
    pen = ImageDraw.Draw(row)
    for k, (panel, title) in enumerate(zip(panels, titles, strict=True)):
        x, y = GAP_PX + k * (_PANEL_PX + GAP_PX), _TEXT_PX + GAP_PX
        pen.text((x, 4), title, INK, letters(_TEXT_PX))
        row.paste(panel, (x, y))
        pen.rectangle((x - 1, y - 1, x + panel.width, y + panel.height), outline=INK)
    return row


def map_pixels(shades: Shades, classes: Codes, *, by_class: bool) -> Pixels:
    """A layer as grey probabilities, (rows, cols, 3), row 0 at the lowest y."""
    if by_class:
        shade = np.full(classes.shape, 0.5)
        for code, value in _CLASS_SHADE.items():
            shade[classes == code] = value
    else:
        shade = np.nan_to_num(shades, nan=0.5)
    grey = np.round(255.0 * (1.0 - np.clip(shade, 0.0, 1.0))).astype(np.uint8)
    pixels = np.repeat(grey[..., None], 3, axis=2)
    unseen = classes == UNKNOWN
    if not by_class:
        unseen &= np.isnan(shades)
    pixels[unseen] = UNSEEN
    return pixels


def difference_pixels(pair: Aligned) -> Pixels:
    """Red and blue by how much more occupied or more free a cell is in B, (rows, cols, 3)."""
    away = distances(pair.a_values, pair.b_values)
    sign = np.sign(np.nan_to_num(np.asarray(pair.b_values, np.float64) - pair.a_values))
    if pair.by_class:
        # From unknown to free is more free; by the codes alone it would be more occupied.
        order = np.array([0.5, 0.0, 1.0])
        sign = np.sign(order[pair.b_classes] - order[pair.a_classes])
    largest = float(np.max(away, initial=0.0, where=np.isfinite(away)))
    strength = np.clip(np.nan_to_num(away / largest if largest else away, posinf=1.0), 0.0, 1.0)
    # The root lets small differences be seen; none at all stays white.
    strength = np.where(away > 0.0, 0.12 + 0.88 * np.sqrt(strength), 0.0)[..., None]
    paper = np.full((*away.shape, 3), 255.0)
    paper[(pair.a_classes == OCCUPIED) & (pair.b_classes == OCCUPIED)] = _BOTH
    ink = np.where((sign >= 0)[..., None], np.array(_MORE_OCCUPIED), np.array(_MORE_FREE))
    mixed: Pixels = np.round(paper * (1.0 - strength) + ink * strength).astype(np.uint8)
    return mixed


def _seen_part(pair: Aligned) -> Window:
    """The rectangle of all that either has seen or that differs, and a little around it."""
    there = (pair.a_classes != UNKNOWN) | (pair.b_classes != UNKNOWN)
    there |= distances(pair.a_values, pair.b_values) > 0.0
    seen = Window.around(there)
    if seen.empty:
        return pair.geometry.whole
    row0, col0 = max(seen.row0 - _AIR_CELLS, 0), max(seen.col0 - _AIR_CELLS, 0)
    row1 = min(seen.row0 + seen.rows + _AIR_CELLS, pair.geometry.rows)
    col1 = min(seen.col0 + seen.cols + _AIR_CELLS, pair.geometry.cols)
    return Window(row0, col0, row1 - row0, col1 - col0)


def _enlarged(pixels: Pixels, window: Window, scale: float) -> Image.Image:
    """Each cell a square of pixels; very large maps are shrunk. Highest y first."""
    image = Image.fromarray(np.ascontiguousarray(pixels[window.slices][::-1]))
    size = (max(1, round(window.cols * scale)), max(1, round(window.rows * scale)))
    how = Image.Resampling.NEAREST if scale >= 1.0 else Image.Resampling.BOX
    return image.resize(size, how)


def _mark(
    panel: Image.Image, layer: LayerReport, report: Report, window: Window, scale: float
) -> None:
    """Outline the walls that changed, and circle the worst cell."""
    pen = ImageDraw.Draw(panel)
    geometry = layer.pair.geometry

    def pixel(x_m: float, y_m: float) -> tuple[float, float]:
        col = (x_m - geometry.origin_m[0]) / geometry.resolution_m - window.col0
        row = (y_m - geometry.origin_m[1]) / geometry.resolution_m - window.row0
        return col * scale, panel.height - row * scale

    def stroke(ends: Ends, colour: tuple[int, int, int]) -> None:
        pen.line([pixel(*end) for end in ends], fill=colour, width=4)

    for change in report.verdict.changes if _has_changes(layer, report) else ():
        if change.from_m:
            stroke(change.from_m, _GONE)
        if change.to_m:
            stroke(change.to_m, _COME)
    if layer.cells.worst:
        x, y = pixel(layer.cells.worst[0].x_m, layer.cells.worst[0].y_m)
        r = max(9.0, scale)
        pen.ellipse((x - r, y - r, x + r, y + r), outline=_WORST, width=3)


def _has_changes(layer: LayerReport, report: Report) -> bool:
    return any(change.layer == layer.name for change in report.verdict.changes)


def _scale_bar(panel: Image.Image, resolution_m: float, scale: float) -> None:
    """A bar of a round length in the lower left corner, on a plate of its own."""
    pen, font = ImageDraw.Draw(panel), letters(_TEXT_PX)
    most_m = max(0.3 * panel.width / scale, 1.0) * resolution_m
    power = 10.0 ** np.floor(np.log10(most_m))
    length_m = float(max(k * power for k in (1, 2, 5) if k * power <= most_m))
    wide, text = length_m / resolution_m * scale, f"{length_m:g} m"
    low = panel.height
    plate = wide + font.getlength(text) + 22
    pen.rectangle((0, low - _TEXT_PX - 8, plate, low), fill=PAPER)
    pen.line((6, low - 12, 6 + wide, low - 12), fill=INK, width=4)
    pen.text((12 + wide, low - 12), text, INK, font, anchor="lm")
