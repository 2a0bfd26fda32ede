"""Lines of grids before and after they move to the raw points, against known walls.

    python -m benchmarks.line_refit [--seed N] [--resolution-m R] [--rooms A,B] [SESSION.mcap ...]

Without sessions: the built-in rooms, driven through once each. The walls of a session are attached
to it, or lie beside it as ``NAME.geojson`` (of ``NAME_A.mcap``, too). Shares of length within 2, 5
and 10 cm: recall of the walls that the layer's sensors could meet, precision of the lines. "off" is
the median distance of the lines from their walls, negative on the robot's side, "angle" the median
over the lines, "lines/wall" how many lines share a wall. The last rows are means over sessions.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.segment_scores import SegmentScores, observed_steps, segment_scores
from mapping.artifacts import Segment
from mapping.config import MappingConfig
from mapping.pipeline import build_maps
from mapping.placed_session import PlacedSession, place_session
from recorder.errors import BadInput
from recorder.session.columns import open_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS
from recorder.truth import read_walls, true_walls

Floats = NDArray[np.float64]
REFITS = ("none", "points")
DURATION_S = 300.0
HEADER = (
    f"{'':<34}{'lines':>6}" + "".join(f"{f'R {cm}':>7}{f'P {cm}':>6}" for cm in (2, 5, 10))
    + f"{'off cm':>9}{'angle °':>9}{'lines/wall':>12}"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Known:
    """A placed session whose walls (K, 2, 2) are known."""

    name: str
    placed: PlacedSession
    walls_m: Floats


def built_in(names: Iterable[str], seed: int) -> Iterator[Known]:
    """A drive through each room."""
    for name in names:
        messages = [m for _, m in simulate(ROOMS[name], duration_s=DURATION_S, seed=seed)]
        yield Known(name, place_session(messages, MappingConfig()), ROOMS[name].walls_m)


def recorded(files: Iterable[Path]) -> Iterator[Known]:
    """Sessions in files."""
    for file in files:
        session = open_session(file)
        walls = true_walls(session.attachments)
        if walls is None:
            walls = read_walls(_beside(file))
        yield Known(file.stem, place_session(session, MappingConfig()), walls)


def _beside(file: Path) -> Path:
    names = (file.stem, file.stem.rpartition("_")[0])
    for name in names:
        if name and (found := file.with_name(f"{name}.geojson")).is_file():
            return found
    raise BadInput(f"{file}: no walls attached, and no {names[0]}.geojson beside it")


def grid_lines(known: Known, refit: str, resolution_m: float) -> dict[str, list[Segment]]:
    """The lines of each layer's grid."""
    config = MappingConfig.model_validate(
        {"grid": {"resolution_m": resolution_m}, "segments": {"refit": refit}}
    )
    lines: dict[str, list[Segment]] = defaultdict(list)
    for artifact in build_maps(known.placed, config, watched=False):
        if isinstance(artifact, Segment) and artifact.source == "grid":
            lines[artifact.layer].append(artifact)
    return lines


def seen_walls(known: Known) -> dict[str, NDArray[np.bool_]]:
    """By layer, the steps of the walls that some reading could have met; fused: any."""
    seen: dict[str, NDArray[np.bool_]] = {}
    for readings in known.placed:
        start = readings.world_from_sensor
        for number, sensor in enumerate(readings.sensors):
            mine = readings.sensor == number
            steps = observed_steps(
                known.walls_m, np.column_stack([start.x_m[mine], start.y_m[mine]]),
                start.heading_rad[mine], sensor.beam_width_rad, sensor.max_range_m,
            )  # fmt: skip
            for layer in (sensor.layer, "fused"):
                seen[layer] = seen.get(layer, np.zeros_like(steps)) | steps
    return seen


def row(name: str, scores: list[SegmentScores]) -> str:
    """One line of the table: the means of some scores."""
    mean = lambda values: float(np.nanmean(list(values)))  # noqa: E731
    shares = "".join(
        f"{100 * mean(s.within[k].completeness for s in scores):>7.1f}"
        f"{100 * mean(s.within[k].correctness for s in scores):>6.1f}"
        for k in range(3)
    )
    return (
        f"{name:<34}{mean(s.lines for s in scores):>6.0f}{shares}"
        f"{100 * mean(s.offset_m for s in scores):>9.2f}"
        f"{math.degrees(mean(s.angle_rad for s in scores)):>9.2f}"
        f"{mean(s.lines_per_wall for s in scores):>12.2f}"
    )


def print_table(sessions: Iterable[Known], resolution_m: float) -> None:
    """A row for each session, layer and way, and the means."""
    print(HEADER)
    every: dict[tuple[str, str], list[SegmentScores]] = defaultdict(list)
    for known in sessions:
        seen = seen_walls(known)
        base = [readings.world_from_base for readings in known.placed]
        where = np.concatenate([np.column_stack([b.x_m, b.y_m]) for b in base])
        for refit in REFITS:
            lines = grid_lines(known, refit, resolution_m)
            for layer in seen:
                ends = np.array([(s.start_m, s.end_m) for s in lines[layer]]).reshape(-1, 2, 2)
                score = segment_scores(ends, known.walls_m, counts=seen[layer], seen_from_m=where)
                every[layer, refit].append(score)
                print(row(f"{known.name}: {layer}, refit {refit}", [score]), flush=True)
    for (layer, refit), scores in sorted(every.items()):
        print(row(f"mean: {layer}, refit {refit}", scores))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("sessions", nargs="*", type=Path)
    parser.add_argument("--rooms", default=",".join(ROOMS))
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--resolution-m", type=float, default=0.01)
    options = parser.parse_args()
    sessions = (
        recorded(options.sessions) if options.sessions
        else built_in(options.rooms.split(","), options.seed)
    )  # fmt: skip
    print_table(sessions, options.resolution_m)


if __name__ == "__main__":
    main()
