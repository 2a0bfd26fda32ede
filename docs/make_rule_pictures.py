"""The pictures and the numbers of docs/rules.md again: ``python docs/make_rule_pictures.py``.

One reading of a sonar at one metre goes into a map of each update rule, once, twice and five
times; then one cell is followed through hits and misses. Everything comes from the program's own
rules; the tables are written into the page between its two marks. The picture of the maps side by
side is a real session in the real viewer, which needs a Vulkan driver; ``--no-viewer`` leaves it
out.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.config import MappingConfig, ReportedSensor, Sensor, resolve_sensor
from mapping.display import grey
from mapping.grid import GridGeometry, Layer
from mapping.sensor_model import make_temp_grid
from mapping.update_rules import UPDATE_RULES, MapState, start
from recorder.errors import EchogridError
from recorder.geometry import SE2
from recorder.messages import Radiation
from replay.rrd.layout import NEVER_SEEN
from replay.rrd.pictures import strength_classes, strength_names

REPOSITORY = Path(__file__).resolve().parent.parent
PAGE = REPOSITORY / "docs" / "rules.md"
IMAGES = REPOSITORY / "docs" / "images"
BEGIN, END = "<!-- numbers: {} -->", "<!-- end of numbers -->"
MOST_BYTES = 150_000
VIEWER_PX = 1200

GRID = GridGeometry((0.0, -0.4), 0.02, 40, 60)
WIDE_GRID = GridGeometry((0.0, -0.6), 0.02, 60, 90)  # holds the band of a miss as well
SENSOR_AT = SE2(0.01, 0.01, 0.0)  # the centre of a cell, so that the obstacle point is one too
HIT_M, MISS_M = 1.0, 1.5
OBSTACLE_M, EMPTY_M = (1.01, 0.01), (0.51, 0.01)
TIMES = (1, 2, 5)
SEQUENCE = ("hit", "hit", "miss", "hit", "miss", "miss", "miss", "miss", "hit", "hit")
RULES = tuple(UPDATE_RULES)

PAPER, INK, FAINT = (255, 255, 255), (20, 20, 20), (110, 110, 110)
RED, BLUE = (200, 30, 30), (20, 80, 200)


def ping() -> Sensor:
    """The built-in sonar as the program takes it when nothing is configured."""
    reported = ReportedSensor("ping", Radiation.ULTRASOUND)
    return resolve_sensor(reported, MappingConfig(), mounted=False)


def reading(range_m: float, grid: GridGeometry = GRID) -> TempGrid:
    """The evidence of one reading for each cell."""
    sensor = ping()
    beam = Beam(
        0, 0, "ping", "ping", SENSOR_AT, SENSOR_AT, np.zeros(1), np.array([range_m]),
        sensor.beam_width_rad, sensor.max_range_m,
    )  # fmt: skip
    return make_temp_grid(beam, sensor, grid)


def after(rule: str, ranges_m: list[float]) -> Layer:
    """The map of a rule after readings of those ranges."""
    state: MapState = start(rule, GRID)
    for range_m in ranges_m:
        state.merge(reading(range_m))
    return state.layer("ping")


def at(layer: Layer, point_m: tuple[float, float]) -> tuple[float, float]:
    """Value, in the rule's own unit, and probability of the cell that holds a point."""
    row, col = layer.geometry.cells_of(np.array([point_m]))[0]
    return float(layer.values[row, col]), float(layer.probability[row, col])


def number(value: float) -> str:
    """Four digits behind the point at most; whole numbers without."""
    return f"{value:.4f}".rstrip("0").rstrip(".") if value != round(value) else f"{value:.0f}"


def repeated_table() -> str:
    """Markdown: the same reading 1, 2 and 5 times, at the obstacle and halfway to it."""
    heads = [f"{place}, {times}×" for place in ("obstacle", "in front") for times in TIMES]
    lines = [f"| rule | unit | {' | '.join(heads)} |", "|---|---|" + "---:|" * len(heads)]
    for rule in RULES:
        layers = [after(rule, [HIT_M] * times) for times in TIMES]
        cells = []
        for point in (OBSTACLE_M, EMPTY_M):
            for layer in layers:
                value, probability = at(layer, point)
                same = UPDATE_RULES[rule].kind == "probability"
                text = f"**{100 * probability:.1f} %**"
                cells.append(text if same else f"{number(value)} → {text}")
        lines.append(f"| `{rule}` | {UPDATE_RULES[rule].kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


def sequence_of(rule: str) -> list[float]:
    """Probability of the obstacle's cell after each reading of the sequence."""
    state = start(rule, WIDE_GRID)
    found = []
    for event in SEQUENCE:
        state.merge(reading(HIT_M if event == "hit" else MISS_M, WIDE_GRID))
        found.append(at(state.layer("ping"), OBSTACLE_M)[1])
    return found


def sequence_table() -> str:
    """Markdown: one cell through hits and misses, in per cent."""
    lines = [f"| rule | {' | '.join(SEQUENCE)} |", "|---|" + "---:|" * len(SEQUENCE)]
    for rule in RULES:
        cells = [f"{100 * p:.1f}" for p in sequence_of(rule)]
        lines.append(f"| `{rule}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def reading_table() -> str:
    """Markdown: the evidence of the two readings for the two cells."""
    lines = ["| cell | reading of 1 m | reading of 1.5 m |", "|---|---:|---:|"]
    for name, point in (("obstacle", OBSTACLE_M), ("in front", EMPTY_M)):
        row, col = GRID.cells_of(np.array([point]))[0]
        cells = []
        for range_m in (HIT_M, MISS_M):
            temp = reading(range_m)
            p = temp.probability[row - temp.window.row0, col - temp.window.col0]
            cells.append(f"{100 * float(p):.2f} %")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


TABLES = {"reading": reading_table, "repeated": repeated_table, "sequence": sequence_table}


def with_numbers(page: str) -> str:
    """The page with all its tables as the program gives them now."""
    for name, table in TABLES.items():
        begin = BEGIN.format(name)
        head, _, rest = page.partition(begin)
        _, mark, tail = rest.partition(END)
        if not mark:
            raise SystemExit(f"docs/rules.md lacks the mark {begin}")
        page = f"{head}{begin}\n{table()}\n{END}{tail}"
    return page


def letters(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def map_picture(layer: Layer, scale: int) -> Image.Image:
    """White is free, black occupied, blue-grey never seen; row 0 below."""
    pixels = grey(layer.probability)
    pixels[~layer.observed] = NEVER_SEEN[:3]
    return enlarged(pixels, scale)


def temp_picture(temp: TempGrid, scale: int) -> Image.Image:
    """Red where the reading is evidence for an obstacle, blue against it, by strength."""
    pixels = np.full((*GRID.shape, 3), 255, np.uint8)
    classes = strength_classes(temp.probability - 0.5, temp.band | temp.free)
    for code, _, (r, g, b, a) in strength_names()[1:]:
        blended = [round(255 - (255 - c) * a / 255) for c in (r, g, b)]
        pixels[temp.window.slices][classes == code] = blended
    return enlarged(pixels, scale)


def enlarged(pixels: NDArray[np.uint8], scale: int) -> Image.Image:
    picture = Image.fromarray(np.ascontiguousarray(pixels[::-1]))
    return picture.resize((picture.width * scale, picture.height * scale), Image.Resampling.NEAREST)


def place_px(point_m: tuple[float, float], scale: int) -> tuple[float, float]:
    """Where a point of the map lies in an enlarged picture."""
    x, y = np.subtract(point_m, GRID.origin_m) / GRID.resolution_m * scale
    return float(x), GRID.rows * scale - float(y)


def draw_reading() -> Image.Image:
    """The temp grid of one reading, with its two cells named."""
    scale, top = 12, 44
    temp = temp_picture(reading(HIT_M), scale)
    canvas = Image.new("RGB", (temp.width, temp.height + top + 40), PAPER)
    canvas.paste(temp, (0, top))
    pen = ImageDraw.Draw(canvas)
    pen.text((8, 10), "One reading of the sonar: an echo from 1 m", INK, letters(22))
    for point, name in ((OBSTACLE_M, "obstacle"), (EMPTY_M, "in front")):
        x, y = place_px(point, scale)
        y += top
        pen.rectangle((x - 8, y - 8, x + 8, y + 8), outline=INK, width=3)
        pen.text((x, y - 24), name, INK, letters(20), anchor="mm")
    x, y = place_px((SENSOR_AT.x_m, SENSOR_AT.y_m), scale)
    pen.ellipse((x - 9, y + top - 9, x + 9, y + top + 9), fill=(0, 150, 136))
    pen.text((x + 8, y + top + 22), "sensor", INK, letters(18))
    below = temp.height + top + 10
    pen.text((8, below), "red: here may be the obstacle", RED, letters(18))
    pen.text((300, below), "blue: the beam passed here", BLUE, letters(18))
    return canvas


def draw_repeated() -> Image.Image:
    """A row for each rule: its map after 1, 2 and 5 times the same reading."""
    scale, left, top, gap = 4, 190, 40, 8
    wide, high = GRID.cols * scale, GRID.rows * scale
    size = (left + len(TIMES) * (wide + gap), top + len(RULES) * (high + gap) + 34)
    canvas = Image.new("RGB", size, PAPER)
    pen = ImageDraw.Draw(canvas)
    for column, times in enumerate(TIMES):
        text = "after 1 reading" if times == 1 else f"after {times} such readings"
        pen.text((left + column * (wide + gap), 10), text, INK, letters(20))
    for row, rule in enumerate(RULES):
        y = top + row * (high + gap)
        pen.text((8, y + high / 2 - 14), rule, INK, letters(22))
        for column, times in enumerate(TIMES):
            picture = map_picture(after(rule, [HIT_M] * times), scale)
            canvas.paste(picture, (left + column * (wide + gap), y))
    below = "white: free    black: occupied    grey: in between    blue-grey: never seen"
    pen.text((left, size[1] - 30), below, INK, letters(20))
    return canvas


def draw_sequence() -> Image.Image:
    """A row for each rule, a column for each reading: the shade and number of one cell."""
    side, left, top = 78, 190, 76
    canvas = Image.new(
        "RGB", (left + side * len(SEQUENCE) + 8, top + side * len(RULES) + 8), PAPER
    )  # fmt: skip
    pen = ImageDraw.Draw(canvas)
    pen.text((8, 8), "One cell, after each reading: per cent occupied", INK, letters(22))
    for column, event in enumerate(SEQUENCE):
        middle = left + side * (column + 0.5)
        colour = RED if event == "hit" else BLUE
        pen.text((middle, 58), event, colour, letters(20), anchor="mm")
    for row, rule in enumerate(RULES):
        y = top + side * row
        pen.text((8, y + side / 2 - 14), rule, INK, letters(22))
        for column, p in enumerate(sequence_of(rule)):
            x = left + side * column
            shade = round(255 * (1 - p))
            box = (x + 2, y + 2, x + side - 3, y + side - 3)
            pen.rectangle(box, fill=(shade,) * 3, outline=FAINT)
            ink = PAPER if p > 0.5 else INK
            middle_px = (x + side / 2, y + side / 2)
            pen.text(middle_px, f"{100 * p:.0f}", ink, letters(24), anchor="mm")
    return canvas


def save(picture: Image.Image, name: str) -> None:
    """Few colours for a small file; rare ones are kept apart."""
    target = IMAGES / name
    few = picture.quantize(160, kmeans=3, dither=Image.Dither.NONE)
    few.save(target, optimize=True)
    size = target.stat().st_size
    print(f"{name}: {picture.width} x {picture.height}, {size} bytes")
    if size > MOST_BYTES:
        raise SystemExit(f"{name} has {size} bytes, more than {MOST_BYTES}")


def side_by_side() -> Image.Image:
    """All rules on a session of ``logs/``, in the real viewer, in the middle of the run."""
    from replay.comparison import from_values
    from replay.comparison_run import compare_session
    from replay.rrd.headless import HeadlessViewer
    from replay.rrd.reader import read_maps

    with tempfile.TemporaryDirectory() as folder:
        rrd = Path(folder, "rules.rrd")
        variants = from_values("rules", settings=["grid.resolution_m=0.02"])
        compare_session(REPOSITORY / "logs" / "room.mcap", variants, rrd=rrd, export=None)
        merged = [
            step.step
            for step in next(iter(read_maps(rrd).values())).steps
            if step.artifact == "MergedGrid" and step.layer == "ping"
        ]
        with HeadlessViewer(rrd) as viewer:
            time.sleep(8.0)  # the viewer covers a corner with a message at first
            viewer.go_to(merged[len(merged) * 3 // 4])
            taken = settled(viewer.screenshot)
            for complaint in viewer.complaints:
                print(complaint, file=sys.stderr)
    window = taken.crop((0, 36, taken.width, taken.height))  # without the viewer's own bar
    height = round(window.height * VIEWER_PX / window.width)
    return window.resize((VIEWER_PX, height), Image.Resampling.LANCZOS)


def settled(take: Callable[[], Image.Image]) -> Image.Image:
    """A picture that does not change any more: the viewer loads while it draws."""
    before = take()
    for _ in range(60):
        time.sleep(1.0)
        after_it = take()
        if after_it.tobytes() == before.tobytes():
            return after_it
        before = after_it
    raise SystemExit("the viewer's picture does not settle")


def main() -> None:
    """The page's tables, and all pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--no-viewer", action="store_true", help="leave the viewer's picture out")
    asked = parser.parse_args()
    IMAGES.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(with_numbers(PAGE.read_text("utf-8")), "utf-8")
    save(draw_reading(), "rules-reading.png")
    save(draw_repeated(), "rules-repeated.png")
    save(draw_sequence(), "rules-sequence.png")
    if not asked.no_viewer:
        save(side_by_side(), "rules-side-by-side.png")


if __name__ == "__main__":
    try:
        main()
    except EchogridError as error:
        raise SystemExit(str(error)) from None
