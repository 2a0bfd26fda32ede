"""Lines from the grids of simulated rooms against their walls: borders or ridges, which threshold?

    python -m benchmarks.grid_lines [--seed N] [--duration-s S] [--resolution-m R] [--raw]

Every built-in room is driven through once with sonar and infrared; the maps are the default ones.
Scores are by length, in steps of a centimetre: recall is the share of the walls that have a line
within 5 cm in about their direction, precision the share of the lines that have such a wall. Walls
that no reading came near count too, so that recall stays below 1. ``--raw`` adds the lines from raw
points and the share of the points within 5 cm of a line.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment
from mapping.beams import Beam
from mapping.borders import find_borders, threshold_layer
from mapping.config import (
    BordersSection,
    MappingConfig,
    ReportedSensor,
    SegmentsSection,
    resolve_sensor,
)
from mapping.fusion import fuse
from mapping.grid import Layer, geometry_for
from mapping.segments import (
    LINE_METHODS,
    reachable_cells,
    segments_from_grid,
    segments_of_ranger,
)
from mapping.sensor_model import make_temp_grid
from mapping.update_rules import start
from recorder.geometry import SE2, interpolate
from recorder.messages import Pose, Radiation, Range
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS, Room

Floats = NDArray[np.float64]
TOLERANCE_M = 0.05
STEP_M = 0.01
MATCH_RAD = math.radians(15.0)
SENSORS = {"ping": Radiation.ULTRASOUND, "dirrs": Radiation.INFRARED}


@dataclass(frozen=True, slots=True)
class Mapped:
    """One run through a room: its layers, where the robot was, and by sensor the raw points and
    from where each was seen."""

    room: Room
    layers: dict[str, Layer]
    positions_m: Floats
    points_m: dict[str, Floats]
    sensor_positions_m: dict[str, Floats]


def mapped(room: Room, *, seed: int, duration_s: float, resolution_m: float) -> Mapped:
    """Drive through a room and map what was heard, with the default configuration."""
    config = MappingConfig()
    sensors = {
        name: resolve_sensor(ReportedSensor(name, radiation), config, mounted=False)
        for name, radiation in SENSORS.items()
    }
    corners = room.walls_m.reshape(-1, 2)
    geometry = geometry_for(
        corners.min(axis=0),
        corners.max(axis=0),
        resolution_m=resolution_m,
        margin_m=0.5,
        max_cells=10_000_000,
    )
    states = {name: start(sensor.update, geometry) for name, sensor in sensors.items()}
    points: dict[str, list[Floats]] = defaultdict(list)
    sensor_positions_m: dict[str, list[tuple[float, float]]] = defaultdict(list)
    messages = [message for _, message in simulate(room, duration_s=duration_s, seed=seed)]
    poses = [message for message in messages if isinstance(message, Pose)]
    times = np.array([pose.t_ns for pose in poses])
    for number, reading in enumerate(m for m in messages if isinstance(m, Range)):
        sensor = sensors[reading.sensor]
        pose = _pose_at(poses, times, reading.t_ns)
        range_m = reading.range_m if reading.range_m < sensor.max_range_m else math.inf
        if pose is None or range_m < sensor.min_range_m or sensor.mount is None:
            continue
        if math.isinf(range_m) and sensor.no_echo == "skipped":
            continue
        beam = Beam(
            number, reading.t_ns, sensor.name, sensor.name, pose, pose @ sensor.mount,
            np.zeros(1), np.array([range_m]), sensor.beam_width_rad, sensor.max_range_m,
        )  # fmt: skip
        states[sensor.name].merge(make_temp_grid(beam, sensor, geometry))
        points[sensor.name] += list(beam.points_m)
        eye = (beam.world_from_sensor.x_m, beam.world_from_sensor.y_m)
        sensor_positions_m[sensor.name] += [eye] * len(beam.points_m)
    layers = {name: state.layer(name) for name, state in states.items()}
    layers["fused"] = fuse(list(layers.values()), list(sensors.values()), config.fusion)
    where = np.array([(p.world_from_base.x_m, p.world_from_base.y_m) for p in poses])
    at = [
        {name: np.array(p) for name, p in places.items()} for places in (points, sensor_positions_m)
    ]
    return Mapped(room, layers, where, *at)


def _pose_at(poses: list[Pose], times: NDArray[np.int64], t_ns: int) -> SE2 | None:
    i = int(np.searchsorted(times, t_ns))
    if not 0 < i < len(poses):
        return None
    fraction = (t_ns - times[i - 1]) / (times[i] - times[i - 1])
    return interpolate(poses[i - 1].world_from_base, poses[i].world_from_base, float(fraction))


def along_lines(ends: Floats) -> tuple[Floats, Floats]:
    """Places along pieces (K, 2, 2), a centimetre apart, and the direction at each."""
    places, directions = [np.empty((0, 2))], [np.empty(0)]
    for a, b in ends:
        n = max(int(math.dist(a, b) / STEP_M), 1)
        places.append(a + (b - a) * ((np.arange(n) + 0.5) / n)[:, None])
        directions.append(np.full(n, math.atan2(b[1] - a[1], b[0] - a[0])))
    return np.concatenate(places), np.concatenate(directions)


def distances(places: Floats, directions: Floats | None, ends: Floats) -> Floats:
    """From each place to the nearest piece (K, 2, 2) that runs in about its direction."""
    least = np.full(len(places), np.inf)
    for a, b in ends:
        along = b - a
        t = np.clip((places - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        away = np.hypot(*(a + t[:, None] * along - places).T)
        if directions is not None:
            turn = np.abs((directions - math.atan2(along[1], along[0]) + math.pi / 2) % math.pi)
            away = np.where(np.abs(turn - math.pi / 2) < MATCH_RAD, away, np.inf)
        least = np.minimum(least, away)
    return least


def scores(walls_m: Floats, segments: list[Segment]) -> tuple[float, float, float, float]:
    """Recall, precision, rms offset of the right lines in metres, and lines per metre of wall."""
    lines = np.array([(s.start_m, s.end_m) for s in segments]).reshape(-1, 2, 2)
    on_walls, on_lines = along_lines(walls_m), along_lines(lines)
    recall = float((distances(*on_walls, lines) <= TOLERANCE_M).mean())
    off = distances(*on_lines, walls_m)
    right = off <= TOLERANCE_M
    offset = float(np.sqrt(np.mean(off[right] ** 2))) if right.any() else math.nan
    precision = float(right.mean()) if len(off) else math.nan
    return recall, precision, offset, len(segments) / (len(on_walls[0]) * STEP_M)


def _print_row(name: str, rows: list[tuple[float, ...]]) -> None:
    recall, precision, offset, density = np.nanmean(np.array(rows), axis=0)[:4]
    f1 = 2 * recall * precision / (recall + precision)
    print(
        f"{name:<34}{100 * recall:>9.1f}{100 * precision:>12.1f}{100 * f1:>7.1f}"
        f"{100 * offset:>10.2f}{density:>14.2f}"
    )


def _print_grids(runs: list[Mapped]) -> None:
    masks = {name: [reachable_cells(r.layers[name], r.positions_m) for r in runs]
             for name in ("fused", *SENSORS)}  # fmt: skip
    for layer in masks:
        for source in ("borders", "ridge"):
            for threshold in (0.51, 0.55, 0.60, 0.80, 0.95):
                for seen in (True, False):
                    rows = [
                        scores(
                            run.room.walls_m,
                            _lines(run.layers[layer], threshold, source, mask if seen else None),
                        )
                        for run, mask in zip(runs, masks[layer], strict=True)
                    ]
                    note = "" if seen else " unmasked"
                    if seen or threshold == 0.55:
                        _print_row(f"{layer} {source} > {threshold:.2f}{note}", rows)


def _lines(
    layer: Layer, threshold: float, source: str, reachable: NDArray[np.bool_] | None
) -> list[Segment]:
    thresholded = threshold_layer(layer, threshold)
    borders = find_borders(thresholded, BordersSection())
    config = SegmentsSection(source=source)  # type: ignore[arg-type]
    return segments_from_grid(thresholded, borders, config, reachable=reachable)


def _print_raw(runs: list[Mapped]) -> None:
    print("\nraw points; 'near' is the share of the points within 5 cm of a line")
    for sensor in SENSORS:
        for method in LINE_METHODS:
            rows, near = [], []
            for run in runs:
                points = run.points_m[sensor]
                config = SegmentsSection(method=method)
                found = segments_of_ranger(
                    points,
                    run.sensor_positions_m[sensor],
                    config,
                    layer=sensor,
                    narrow=sensor == "dirrs",
                )
                lines = np.array([(s.start_m, s.end_m) for s in found]).reshape(-1, 2, 2)
                near.append(float((distances(points, None, lines) <= TOLERANCE_M).mean()))
                rows.append(scores(run.room.walls_m, found))
            _print_row(f"{sensor} {method}, near {100 * np.mean(near):.0f} %", rows)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--duration-s", type=float, default=150.0)
    parser.add_argument("--resolution-m", type=float, default=0.01)
    parser.add_argument("--raw", action="store_true")
    options = parser.parse_args()
    runs = [
        mapped(
            room,
            seed=options.seed,
            duration_s=options.duration_s,
            resolution_m=options.resolution_m,
        )
        for room in ROOMS.values()
    ]
    print(f"{len(runs)} rooms, seed {options.seed}, {options.duration_s:g} s each; means")
    print(f"{'':<34}{'recall %':>9}{'precision %':>12}{'F1':>7}{'off cm':>10}{'lines/m wall':>14}")
    _print_grids(runs)
    if options.raw:
        _print_raw(runs)


if __name__ == "__main__":
    main()
