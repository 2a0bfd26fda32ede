"""Does what is learned of a sensor in one half of a real run make the map of the other half better?

    python -m benchmarks.trace_halves TRACE.trc [--sensor dirrs]

No walls of such a trace were surveyed. What is learned of the first half comes from its own map,
and from the four walls of the rectangle that fits the map of the whole run best: no truth either,
but straight. The second half is then mapped with each, and judged by its own readings that were
kept out (the score without truth, with the gain over what is in force), and by how far what it
takes for walls within 15 cm of the four walls lies off them.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.arena import fit_arena
from mapping.config import MappingConfig, load_config
from mapping.grid import GridGeometry
from mapping.layer_map import empty_maps
from mapping.pipeline import geometry_of
from mapping.placed_session import PlacedSession, place_session
from mapping.scoring.held_out import held_out
from mapping.scoring.lines import nearest
from recorder.columns import Floats
from recorder.errors import BadInput
from recorder.importers import import_comp4807
from recorder.session import SessionWriter
from recorder.session.columns import open_session
from recorder.truth import walls_to_geojson
from replay.learning.run import learn
from replay.learning.strengths import strengths
from replay.learning.text import sensor_file
from replay.tables import text_table

OCCUPIED = 0.6
BESIDE_M = 0.15
SETTINGS = ("grid.resolution_m=0.01",)


def sessions(trace: Path, folder: Path) -> tuple[Path, Path, Path]:
    """The trace as sessions: its first half in time, its second, and all of it."""
    records = [message for _, message in import_comp4807(trace).records]
    times = [message.t_ns for message in records]
    middle_ns = int(np.median(times))
    files = folder / "first.mcap", folder / "second.mcap", folder / "whole.mcap"
    for file, low_ns, high_ns in zip(
        files, (min(times), middle_ns, min(times)), (middle_ns, None, None), strict=True
    ):
        with SessionWriter(file) as session:
            for message in records:
                if low_ns <= message.t_ns and (high_ns is None or message.t_ns < high_ns):
                    session.write(message, log_ns=message.t_ns)
    return files


def layer_of(
    file: Path, config: MappingConfig, sensor: str
) -> tuple[PlacedSession, GridGeometry, Floats]:
    """A session, and where a sensor's map of it has walls: the centres (N, 2) of those cells."""
    placed = place_session(open_session(file), config)
    geometry = geometry_of(placed, config)
    maps = empty_maps(placed.placement.sensors, geometry, config.grid)
    for readings in placed:
        for each in maps.values():
            each.merge_many(readings)
    layer = maps[placed.sensors[sensor].layer].layer()
    return placed, geometry, geometry.centres_of(np.argwhere(layer.probability > OCCUPIED))


def learned(
    first: Path, sensor: str, walls: str | None, settings: Sequence[str], file: Path
) -> Path:
    """What ``learn --weights`` writes of the first half."""
    config, given = load_config([], [*SETTINGS, *settings]), [walls] if walls else []
    try:
        of = learn([first], config, walls=given, only=[sensor])
        strong = strengths([first], config, of, walls=given, known=walls is not None, only=[sensor])
        file.write_text(sensor_file(of, [first.name], strong), "utf-8")
    except BadInput as error:
        file.write_text(f"# {error}\n", "utf-8")
    return file


def off_walls_m(places_m: Floats, walls_m: Floats) -> Floats:
    """How far places lie off the nearest wall, of those within 15 cm of one."""
    away_m, _ = nearest(places_m, None, walls_m)
    return np.asarray(away_m[away_m <= BESIDE_M])


def rows(trace: Path, sensor: str, folder: Path) -> Iterator[list[str]]:
    """The table, a row for each way."""
    first, second, whole = sessions(trace, folder)
    arena = fit_arena(layer_of(whole, load_config([], SETTINGS), sensor)[2][::3])
    print(f"four walls: {arena.size_m[0]:.2f} x {arena.size_m[1]:.2f} m")
    file = folder / "walls.geojson"
    file.write_bytes(walls_to_geojson(arena.walls_m, "four walls"))
    ways: list[tuple[str, list[Path], list[str]]] = [("in force", [], [])]
    for rule in ("bayes", "pooled"):
        settings = [f"sensors.*.update={rule}"]
        ways.append((rule, [], settings))
        for against, given in (("its own map", None), ("four walls", str(file))):
            found = learned(first, sensor, given, settings, folder / f"{rule} {against}.toml")
            print(f"--- {rule}, learned against {against}\n{found.read_text('utf-8')}")
            ways.append((f"{rule}, learned: {against}", [found], settings))
    yield ["second half", "log-likelihood", "gain", "95 %", "cells", "off the four walls", "rms"]
    before = None
    for name, files, settings in ways:
        config = load_config(files, [*SETTINGS, *settings])
        placed, geometry, taken_m = layer_of(second, config, sensor)
        judged, off_m = held_out(placed, config, geometry), off_walls_m(taken_m, arena.walls_m)
        row = [name, f"{judged.of_sensors([sensor]).mean:.3f}"]
        if before is not None:
            gain = judged.gain_over(before, [sensor])
            row += [f"{gain.mean:+.3f}", f"{gain.low:+.3f} .. {gain.high:+.3f}"]
        before = before or judged
        row += [""] * (4 - len(row)) + [str(len(taken_m)), f"{100 * np.median(off_m):.1f} cm"]
        yield [*row, f"{100 * np.sqrt(np.mean(np.square(off_m))):.1f} cm"]


def main() -> None:
    """Print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("trace", type=Path)
    parser.add_argument("--sensor", default="dirrs")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print("\n".join(text_table(list(rows(options.trace, options.sensor, Path(folder))))))


if __name__ == "__main__":
    main()
