"""Draw the pictures of ``docs/lines.md`` again: ``python -m docs.make_line_pictures [NAME ...]``.

The walls of two simulated rooms, of a real trace where it is at hand, lines before and after they
move to the raw points, and three thresholds side by side as the viewer shows them. NAME is one of
rooms, trace, refit, thresholds; all of them by default. The last needs a Vulkan driver, as
``make_screenshot.py`` does.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from benchmarks.walls import ROOM_NAMES, SENSOR, TRACE, Run, figures, room_run, trace_run
from mapping.artifacts import Segment
from mapping.fusion import FUSED
from recorder.errors import EchogridError
from replay.rrd.blueprints import THRESHOLDS
from replay.rrd.headless import HeadlessViewer
from replay.rrd.reader import read_rrd

IMAGES = Path(__file__).resolve().parent / "images"
PANEL_PX, CAPTION_PX, GAP_PX = 620, 30, 14
WALL, LINE, END, POINT = (46, 160, 67), (230, 0, 160), (90, 0, 140), (0, 114, 190)
REFIT_ROOMS, REFITS = ("cluttered", "corridor"), ("none", "points")
GREETING_S = 8.0  # the viewer covers a corner with a message at first
MENU_PX, TABS_SHARE = 36, 0.7

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Frame:
    """The part of the map plane that a panel shows, and its pixels a metre."""

    low_m: Floats
    high_m: Floats

    @property
    def px_per_m(self) -> float:
        """So that the wider side fills the panel."""
        return PANEL_PX / float((self.high_m - self.low_m).max())

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        width, height = (self.high_m - self.low_m) * self.px_per_m
        return round(width), round(height)

    def pixel(self, place_m: Sequence[float] | Floats) -> tuple[float, float]:
        """Where a place of the map is in the picture: y runs down there."""
        x, y = (np.asarray(place_m) - self.low_m) * self.px_per_m
        return float(x), self.size_px[1] - float(y)


def panel(run: Run, source: str, frame: Frame, layer: str = SENSOR, note: str = "") -> Image.Image:
    """A map with the lines from the grid, or with the raw points and theirs."""
    picture = _grid_picture(run, frame, layer)
    draw = ImageDraw.Draw(picture)
    if source == "raw":
        for place in run.points_m[SENSOR]:
            x, y = frame.pixel(place)
            draw.ellipse((x - 1, y - 1, x + 1, y + 1), fill=POINT)
    for start, end in run.walls_m if run.walls_m is not None else ():
        draw.line([frame.pixel(start), frame.pixel(end)], fill=WALL, width=7)
    for line in run.lines(layer, source):
        _draw_line(draw, line, frame)
    quality = figures(run, layer, source)
    origin = note or ("raw points" if source == "raw" else "grid")
    caption = f"{run.name}, {origin}: {quality.lines} lines, {quality.metres:.1f} m"
    return _with_caption(picture, caption)


def _grid_picture(run: Run, frame: Frame, name: str) -> Image.Image:
    layer = run.layers[name]
    cells = layer.geometry.cells_of(np.array([frame.low_m, frame.high_m]))
    low, high = np.maximum(cells[0], 0), np.minimum(cells[1], layer.probability.shape)
    part = layer.probability[low[0] : high[0], low[1] : high[1]][::-1]
    grey = np.round(255.0 - 130.0 * part).astype(np.uint8)  # pale: the lines are what is shown
    return Image.fromarray(grey).convert("RGB").resize(frame.size_px, Image.Resampling.NEAREST)


def _draw_line(draw: ImageDraw.ImageDraw, line: Segment, frame: Frame) -> None:
    ends = [frame.pixel(line.start_m), frame.pixel(line.end_m)]
    draw.line(ends, fill=LINE, width=4)
    for x, y in ends:
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=END)


def _with_caption(picture: Image.Image, caption: str) -> Image.Image:
    whole = Image.new("RGB", (picture.width, picture.height + CAPTION_PX), "white")
    whole.paste(picture, (0, CAPTION_PX))
    ImageDraw.Draw(whole).text((4, 4), caption, fill="black", font=ImageFont.load_default(18))
    return whole


def frame_of(run: Run) -> Frame:
    """All that the infrared ranger saw, and a margin."""
    points = run.points_m[SENSOR]
    return Frame(points.min(axis=0) - 0.15, points.max(axis=0) + 0.15)


def walls_picture(runs: Sequence[Run], target: Path) -> None:
    """A row for each run: the lines from its grid, and those from its raw points."""
    rows = [[panel(run, source, frame_of(run)) for source in ("grid", "raw")] for run in runs]
    _rows_picture(rows, target)


def refit_picture(target: Path) -> None:
    """Rooms and the trace: fused lines as the grid has them, and where the raw points are."""
    rows = []
    for name in REFIT_ROOMS:
        runs = [room_run(name, seed=1, refit=refit) for refit in REFITS]
        rows.append(
            [_fused(run, f"refit {refit}") for run, refit in zip(runs, REFITS, strict=True)]
        )
    if TRACE.is_file():
        rows.append([_fused(trace_run(TRACE, refit=refit), f"refit {refit}") for refit in REFITS])
    _rows_picture(rows, target)


def _fused(run: Run, note: str) -> Image.Image:
    return panel(run, "grid", frame_of(run), FUSED, note)


def _rows_picture(rows: Sequence[Sequence[Image.Image]], target: Path) -> None:
    width = max(sum(p.width + GAP_PX for p in row) for row in rows) - GAP_PX
    height = sum(max(p.height for p in row) + GAP_PX for row in rows) - GAP_PX
    whole = Image.new("RGB", (width, height), "white")
    top = 0
    for row in rows:
        left = 0
        for picture in row:
            whole.paste(picture, (left, top))
            left += picture.width + GAP_PX
        top += max(picture.height for picture in row) + GAP_PX
    _save(whole, target)


def thresholds_picture(target: Path) -> None:
    """The viewer's tab with the maps of a room at each threshold, at the end of a run."""
    with tempfile.TemporaryDirectory() as folder:
        session, rrd = Path(folder, "room.mcap"), Path(folder, "room.rrd")
        _echogrid("simulate", "room", "-o", str(session), "--duration", "60", "--seed", "1")
        _echogrid("map", str(session), "-o", str(rrd), "--set", "grid.resolution_m=0.02")
        with HeadlessViewer(rrd) as viewer:
            time.sleep(GREETING_S)
            viewer.go_to(read_rrd(rrd).steps[-1].step)
            viewer.bring_to_front(THRESHOLDS)
            taken = viewer.screenshot()
    box = (0, MENU_PX, round(TABS_SHARE * taken.width), taken.height - MENU_PX)
    _save(taken.crop(box), target)


def _echogrid(*arguments: str) -> None:
    command = [sys.executable, "-m", "echogrid", *arguments, "--quiet"]
    subprocess.run(command, check=True, cwd=IMAGES.parent.parent)


def _save(picture: Image.Image, target: Path) -> None:
    picture.quantize(128, dither=Image.Dither.NONE).save(target, optimize=True)
    print(f"{target.name}: {target.stat().st_size} bytes")


def main(names: Sequence[str]) -> None:
    """The pictures of those names into docs/images, by default all."""
    wanted = set(names) or {"rooms", "trace", "refit", "thresholds"}
    if "rooms" in wanted:
        walls_picture([room_run(name, seed=1) for name in ROOM_NAMES], IMAGES / "walls-rooms.png")
    if "trace" in wanted and TRACE.is_file():
        walls_picture([trace_run(TRACE)], IMAGES / "walls-trace21.png")
    if "refit" in wanted:
        refit_picture(IMAGES / "walls-refit.png")
    if "thresholds" in wanted:
        thresholds_picture(IMAGES / "thresholds.png")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except EchogridError as error:
        raise SystemExit(str(error)) from None
