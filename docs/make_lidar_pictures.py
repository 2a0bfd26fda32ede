"""Draw the floor plans of ``docs/lidar.md`` again: ``python -m docs.make_lidar_pictures``.

From the recordings beside the checkout; prints the rows of the page's table.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from echogrid import main as echogrid
from mapping.artifacts import Segment, Snapshot
from mapping.config import load_config
from mapping.grid import Layer
from replay.mapping_run import RunResult, map_session

IMAGES = Path(__file__).resolve().parent / "images"
DATA = IMAGES.parents[2] / "shared" / "data"
RESOLUTION_M = 0.05
LONGER_SIDE_PX, MARGIN_CELLS, BAR_M = 1000, 12, 5.0
LINE, TEXT = (214, 0, 140), (60, 60, 60)
UNKNOWN, FREE, WALL = (206, 212, 220), (255, 255, 255), (30, 34, 42)


@dataclass(frozen=True, slots=True)
class Log:
    """A recording of somebody's robot: its files, the layer to show, and whose lines."""

    name: str
    files: tuple[Path, ...]
    layer: str
    source: str


LOGS = (
    Log("intel", (DATA / "lidar" / "intel-corrected.log.gz",), "lidar", "raw"),
    Log("orebro", (DATA / "lidar" / "orebro-corrected.log.gz",), "lidar", "raw"),
    Log(
        "sonar-ring",
        (DATA / "sonar_ring" / "measurement.txt", DATA / "sonar_ring" / "poses.txt"),
        "ping",
        "grid",
    ),
)


def picture(layer: Layer, segments: Sequence[Segment]) -> Image.Image:
    """The plan (walls, free and never seen) cut to what was seen, and lines over it."""
    rows, cols = np.nonzero(layer.observed)
    row0, col0 = rows.min() - MARGIN_CELLS, cols.min() - MARGIN_CELLS
    row1, col1 = rows.max() + MARGIN_CELLS, cols.max() + MARGIN_CELLS
    pixels = np.full((row1 - row0 + 1, col1 - col0 + 1, 3), UNKNOWN, np.float64)
    share = layer.probability[rows, cols][:, np.newaxis]
    pixels[rows - row0, cols - col0] = (1.0 - share) * FREE + share * WALL
    plan = Image.fromarray(pixels[::-1].round().astype(np.uint8))
    scale = LONGER_SIDE_PX / max(plan.size)
    width, height = (round(side * scale) for side in plan.size)
    drawn = plan.resize((width * 2, height * 2), Image.Resampling.LANCZOS)
    pen = ImageDraw.Draw(drawn)
    cell_px = 2.0 * scale
    x0 = layer.geometry.origin_m[0] + col0 * layer.geometry.resolution_m
    y0 = layer.geometry.origin_m[1] + row0 * layer.geometry.resolution_m
    per_m = cell_px / layer.geometry.resolution_m
    for segment in segments:
        ends = [segment.start_m, segment.end_m]
        pen.line(
            [((x - x0) * per_m, 2 * height - (y - y0) * per_m) for x, y in ends],
            fill=LINE, width=5,
        )  # fmt: skip
    left, bottom = 2 * MARGIN_CELLS, 2 * height - 2 * MARGIN_CELLS
    pen.line([(left, bottom), (left + BAR_M * per_m, bottom)], fill=TEXT, width=6)
    font = ImageFont.load_default(size=26)
    pen.text((left, bottom - 38), f"{BAR_M:g} m", fill=TEXT, font=font)
    small = drawn.resize((width, height), Image.Resampling.LANCZOS)
    return small.quantize(colors=64, dither=Image.Dither.NONE)


def mapped(log: Log, folder: Path) -> tuple[RunResult, float]:
    """A log's map, and how long it took, seconds, without what the first map compiles and loads."""
    session = folder / f"{log.name}.mcap"
    echogrid(["import", *map(str, log.files), "-o", str(session), "--quiet"])
    config = load_config(settings=[f"grid.resolution_m={RESOLUTION_M}"])
    map_session(session, config, rrd=None, export=None)
    began = time.perf_counter()
    result = map_session(session, config, rrd=None, export=folder / log.name)
    return result, time.perf_counter() - began


def row_of(log: Log, snapshot: Snapshot, result: RunResult, seconds: float) -> str:
    """A row of the page's table."""
    layer = snapshot.layer
    cells = f"{layer.geometry.cols} x {layer.geometry.rows}"
    counts = [sum(s.source == source for s in result.segments) for source in ("grid", "raw")]
    used = sum(result.finished.used.values())
    return (
        f"| {log.name} | {used} | {cells} | {np.count_nonzero(layer.observed)} | {seconds:.1f} s "
        f"| {counts[0]} | {counts[1]} |"
    )


def main() -> int:
    """Draw all that are at hand; 1 where one is missing."""
    missing = 0
    for log in LOGS:
        if not all(file.exists() for file in log.files):
            print(f"left out, not at hand: {log.name}", file=sys.stderr)
            missing = 1
            continue
        with tempfile.TemporaryDirectory() as folder:
            result, seconds = mapped(log, Path(folder))
        (snapshot,) = [s for s in result.snapshots if s.layer.name == log.layer]
        lines = [s for s in result.segments if s.layer == log.layer and s.source == log.source]
        picture(snapshot.layer, lines).save(IMAGES / f"lidar-{log.name}.png", optimize=True)
        print(row_of(log, snapshot, result, seconds), flush=True)
    return missing


if __name__ == "__main__":
    sys.exit(main())
