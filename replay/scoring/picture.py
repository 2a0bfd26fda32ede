"""One picture of a score: for each layer the map with what is right and wrong in it, and how far
its probabilities can be taken at their word.

Greys are probabilities (white free, black occupied); what could not be seen is blue-grey. Over them
lie true walls, by whether the map has them, ghosts, and the lines of the map.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from mapping.grid import Window
from mapping.scoring.cells import NEAR_M, OCCUPIED, WALL_STEP_M, CellScore, along, lies_on
from mapping.scoring.truth import Truth
from recorder.errors import BadInput
from recorder.outputs import written_beside
from replay.scoring.judging import JudgedLayer, ScoreReport
from replay.swatches import GAP_PX, INK, PAPER, UNSEEN, Colour, legend, letters, wrapped

Floats = NDArray[np.float64]

_FOUND, _MISSED, _NOT_SEEN = (44, 140, 44), (214, 39, 40), (110, 110, 110)
_GHOST, _LINE, _GRID = (255, 127, 14), (31, 100, 210), (215, 215, 215)
_MAP_PX, _HIGHEST_PX, _LARGEST_CELL_PX, _CURVE_PX = 520, 520, 24.0, 260
_CELLS_OF_A_POINT = 20  # fewer are chance
_TEXT_PX = 15
_AIR_M = 0.1
_MOST_LAYERS = 4
_LEGEND = (
    (_FOUND, "wall that the map has"), (_MISSED, "wall that it misses"),
    (_NOT_SEEN, "wall that could not be seen"),
    (_GHOST, "ghost: a wall where nothing could be seen"),
    (_LINE, "line of the map"), (UNSEEN, "could not be seen"),
)  # fmt: skip


def save_picture(report: ScoreReport, path: Path) -> None:
    """Write the picture as PNG, beside its name first. Raises BadInput where it cannot be."""
    if report.truth is None:
        raise BadInput(f"{path}: without known walls (--walls) there is nothing to draw")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_beside(path) as part:
            draw(report, report.truth).save(part, format="PNG", optimize=True)
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror or error}") from error


def draw(report: ScoreReport, truth: Truth) -> Image.Image:
    """A row for each layer, at most four, and the legend below."""
    rows = [_row(layer, truth) for layer in report.layers[-_MOST_LAYERS:]]
    width = _MAP_PX + _CURVE_PX + 4 * GAP_PX
    below = legend(_LEGEND, width, _TEXT_PX)
    head = _TEXT_PX + GAP_PX
    page = Image.new("RGB", (width, head + sum(r.height for r in rows) + below.height), PAPER)
    title = f"{report.path.name} against {report.truth_name}"
    ImageDraw.Draw(page).text((GAP_PX, 8), title, INK, letters(_TEXT_PX))
    y = head
    for each in [*rows, below]:
        page.paste(each, (0, y))
        y += each.height
    return page


def _row(layer: JudgedLayer, truth: Truth) -> Image.Image:
    panel = _map_panel(layer, truth)
    cells, lines = layer.score.cells, layer.score.lines_of("grid")
    texts = [
        f"log-loss {cells.log_loss:.3f}, Brier {cells.brier:.3f}, AUC {cells.auc:.3f}",
        f"wall found {100 * cells.wall_found:.0f} %, ghosts {cells.ghost_m2:.1f} m2",
    ]
    if lines is not None:
        at = lines.within[1]
        texts.append(
            f"lines within 5 cm: {100 * at.completeness:.0f} % of the wall, "
            f"{100 * at.correctness:.0f} % right"
        )
    height = max(panel.height, _CURVE_PX + 90) + _TEXT_PX + 2 * GAP_PX
    row = Image.new("RGB", (_MAP_PX + _CURVE_PX + 4 * GAP_PX, height), PAPER)
    pen, font = ImageDraw.Draw(row), letters(_TEXT_PX)
    pen.text((GAP_PX, 4), f"layer {layer.score.layer}", INK, font)
    top = _TEXT_PX + GAP_PX
    row.paste(panel, (GAP_PX, top))
    pen.rectangle((GAP_PX - 1, top - 1, GAP_PX + panel.width, top + panel.height), outline=INK)
    x = _MAP_PX + 3 * GAP_PX
    row.paste(_curve(cells), (x, top))
    lines_of_text = [line for text in texts for line in wrapped(text, _CURVE_PX + GAP_PX, font)]
    pen.multiline_text((x, top + _CURVE_PX + 24), "\n".join(lines_of_text), INK, font)
    return row


def _map_panel(layer: JudgedLayer, truth: Truth) -> Image.Image:
    """The map around all walls and ghosts, enlarged, with everything drawn over it."""
    geometry, taken = layer.geometry, layer.probability > OCCUPIED
    walls = truth.wall_cells(geometry)
    ghosts = taken & ~layer.seen & ~walls
    grey = np.round(255.0 * (1.0 - np.clip(np.nan_to_num(layer.probability, nan=0.5), 0, 1)))
    pixels = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
    pixels[~layer.seen] = UNSEEN
    pixels[ghosts] = _GHOST
    window = _grown(Window.around(walls | layer.seen | ghosts), layer)
    scale = min(_MAP_PX / window.cols, _HIGHEST_PX / window.rows, _LARGEST_CELL_PX)
    image = Image.fromarray(np.ascontiguousarray(pixels[window.slices][::-1])).resize(
        (max(1, round(window.cols * scale)), max(1, round(window.rows * scale))),
        Image.Resampling.NEAREST if scale >= 1.0 else Image.Resampling.BOX,
    )
    pen = ImageDraw.Draw(image)

    def at(place_m: Floats) -> tuple[float, float]:
        col, row = (place_m - np.array(geometry.origin_m)) / geometry.resolution_m
        return (col - window.col0) * scale, image.height - (row - window.row0) * scale

    for places_m, colour in _walls_by_kind(layer, truth):
        for place_m in places_m:
            x, y = at(place_m)
            pen.ellipse((x - 1.5, y - 1.5, x + 1.5, y + 1.5), fill=colour)
    for ends in layer.lines_m.get("grid", ()):
        pen.line([at(end) for end in ends], fill=_LINE, width=2)
    return image


def _walls_by_kind(layer: JudgedLayer, truth: Truth) -> list[tuple[Floats, Colour]]:
    """Places along the walls, a centimetre apart: not seen, missed, found."""
    from scipy.spatial import cKDTree

    geometry = layer.geometry
    places_m, _, _ = along(truth.walls_m, WALL_STEP_M)
    visible = lies_on(places_m, layer.seen & truth.wall_cells(geometry), geometry)
    taken_m = geometry.centres_of(np.argwhere(layer.probability > OCCUPIED))
    found = np.zeros(len(places_m), np.bool_)
    if len(taken_m):
        found = cKDTree(taken_m).query(places_m)[0] <= NEAR_M + 1e-9
    return [
        (places_m[~visible], _NOT_SEEN), (places_m[visible & ~found], _MISSED),
        (places_m[visible & found], _FOUND),
    ]  # fmt: skip


def _grown(window: Window, layer: JudgedLayer) -> Window:
    by, (rows, cols) = int(np.ceil(_AIR_M / layer.geometry.resolution_m)), layer.geometry.shape
    row0, col0 = max(window.row0 - by, 0), max(window.col0 - by, 0)
    row1 = min(window.row0 + window.rows + by, rows)
    col1 = min(window.col0 + window.cols + by, cols)
    return Window(row0, col0, row1 - row0, col1 - col0)


def _curve(cells: CellScore) -> Image.Image:
    """The share of walls among cells of each probability; on the diagonal both are the same."""
    size = _CURVE_PX
    image = Image.new("RGB", (size + 12, size + 22), PAPER)
    pen, font = ImageDraw.Draw(image), letters(11)
    for k in range(5):
        at = round(k * size / 4)
        pen.line((at, 0, at, size), fill=_GRID)
        pen.line((0, at, size, at), fill=_GRID)
    pen.line((0, size, size, 0), fill=_NOT_SEEN)
    points = [
        (b.probability * size, size - b.occupied * size)
        for b in cells.calibration if b.cells >= _CELLS_OF_A_POINT
    ]  # fmt: skip
    if len(points) > 1:
        pen.line(points, fill=_LINE, width=2)
    for x, y in points:
        pen.ellipse((x - 3, y - 3, x + 3, y + 3), fill=_LINE)
    pen.rectangle((0, 0, size, size), outline=INK)
    pen.text((4, 4), "share of walls", INK, font)
    pen.text((size - 62, size + 4), "probability", INK, font)
    pen.text((0, size + 4), f"calibration error {cells.calibration_error:.3f}", INK, font)
    return image
