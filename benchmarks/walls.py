"""The walls as lines: how many, how right, and how many of the points do they explain?

    python -m benchmarks.walls [--seed N] [--trace FILE]

Two simulated rooms, whose walls are known, and a real trace, whose walls are not: nobody surveyed
that arena. Everything is the default configuration's. "near" is the share of the infrared
ranger's points within 5 cm of a line. Recall and precision are by length, in steps of a
centimetre, within 5 cm and in about the right direction: recall counts walls that no beam ever met
too. Where the walls are not known, lines per metre are per metre of line, and "on points" is the
share of the lines' length that has a point within 5 cm.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.grid_lines import TOLERANCE_M, along_lines, distances, scores
from mapping.artifacts import RawPoints, Segment, Snapshot
from mapping.config import MappingConfig
from mapping.grid import Layer
from mapping.pipeline import build_maps
from recorder.importers import import_comp4807
from recorder.messages import Message
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

Floats = NDArray[np.float64]
SENSOR = "dirrs"
ROOM_NAMES = ("room", "l-room")
DURATION_S = 150.0
TRACE = Path(__file__).resolve().parents[2] / "shared" / "data" / "comp4807" / "trace21.trc"
HEADER = (
    f"{'':<30}{'lines':>6}{'metres':>8}{'lines/m':>9}{'near %':>8}{'on points %':>13}"
    f"{'recall %':>10}{'precision %':>13}"
)


@dataclass(frozen=True, slots=True)
class Run:
    """What one session became: its final layers, all its lines, and the points by sensor."""

    name: str
    walls_m: Floats | None
    layers: dict[str, Layer]
    segments: tuple[Segment, ...]
    points_m: dict[str, Floats]

    def lines(self, layer: str, source: str) -> list[Segment]:
        """The lines of one layer, from its ``grid`` or from ``raw`` points."""
        return [s for s in self.segments if (s.layer, s.source) == (layer, source)]


@dataclass(frozen=True, slots=True)
class Figures:
    """One row of the table. Shares are 0 to 1; those that need known walls may be NaN."""

    lines: int
    metres: float
    per_metre: float
    near: float
    on_points: float
    recall: float
    precision: float

    def row(self, name: str) -> str:
        """One line of the table."""
        truth = "".join(
            f"{'-':>{width}}" if math.isnan(share) else f"{100 * share:>{width}.1f}"
            for share, width in ((self.recall, 10), (self.precision, 13))
        )
        return (
            f"{name:<30}{self.lines:>6}{self.metres:>8.2f}{self.per_metre:>9.2f}"
            f"{100 * self.near:>8.1f}{100 * self.on_points:>13.1f}{truth}"
        )


def run_of(
    name: str, messages: Iterable[Message], walls_m: Floats | None, refit: str = "points"
) -> Run:
    """Map a session with the default configuration, but for ``segments.refit``."""
    config = MappingConfig.model_validate({"segments": {"refit": refit}})
    layers: dict[str, Layer] = {}
    segments: list[Segment] = []
    points: dict[str, Floats] = {}
    for artifact in build_maps(messages, config):
        match artifact:
            case Snapshot(final=True):
                layers[artifact.layer.name] = artifact.layer
            case Segment():
                segments.append(artifact)
            case RawPoints():
                points[artifact.layer] = artifact.points_m
            case _:
                pass
    return Run(name, walls_m, layers, tuple(segments), points)


def room_run(name: str, *, seed: int, duration_s: float = DURATION_S, refit: str = "points") -> Run:
    """A simulated robot's drive through a built-in room."""
    room = ROOMS[name]
    messages = [message for _, message in simulate(room, duration_s=duration_s, seed=seed)]
    return run_of(name, messages, room.walls_m, refit)


def trace_run(trace: Path, *, refit: str = "points") -> Run:
    """A real robot's trace."""
    messages = [message for _, message in import_comp4807(trace).records]
    return run_of(trace.stem, messages, None, refit)


def figures(run: Run, layer: str, source: str) -> Figures:
    """How good the lines of one layer and source are; points are the infrared ranger's."""
    from scipy.spatial import cKDTree

    found = run.lines(layer, source)
    points = run.points_m[SENSOR]
    ends = np.array([(s.start_m, s.end_m) for s in found]).reshape(-1, 2, 2)
    metres = sum(s.length_m for s in found)
    near = float((distances(points, None, ends) <= TOLERANCE_M).mean())
    steps = along_lines(ends)[0]
    away = cKDTree(points).query(steps)[0] if len(steps) else np.zeros(0)
    on_points = float((away <= TOLERANCE_M).mean()) if len(steps) else math.nan
    recall = precision = math.nan
    per_metre = len(found) / metres if metres else math.nan
    if run.walls_m is not None:
        recall, precision, _, per_metre = scores(run.walls_m, found)
    return Figures(len(found), metres, per_metre, near, on_points, recall, precision)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--trace", type=Path, default=TRACE)
    options = parser.parse_args()
    runs = [room_run(name, seed=options.seed) for name in ROOM_NAMES]
    if options.trace.is_file():
        runs.append(trace_run(options.trace))
    else:
        print(f"no {options.trace.name} here: the rooms alone")
    print(HEADER)
    for run in runs:
        for layer, source in ((SENSOR, "grid"), (SENSOR, "raw"), ("fused", "grid")):
            said = "raw points" if source == "raw" else "grid"
            print(figures(run, layer, source).row(f"{run.name}: {layer}, {said}"))


if __name__ == "__main__":
    main()
