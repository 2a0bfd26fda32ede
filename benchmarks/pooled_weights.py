"""The weights of the update rule `pooled`, from rooms of our own simulator.

    python -m benchmarks.pooled_weights [--write FILE] [--seed 1] [--media sonar,infrared,laser]

In each built-in room, at four sizes, a robot turns on twelve spots and drives about: 3,000 readings
of each ranger, 150 scans of a lidar, all with exact poses. Each session is mapped whole, and every
fifth and tenth reading of it, so that the weights know how strong few readings are. Which cells
are walls, and which could be seen, is known. Without ``--write`` the file is printed. Maps are in
cells of 2 cm; ``fade_m`` and ``most_unpassed`` are not learned but kept.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray

from mapping.config import MappingConfig, load_config
from mapping.layer_map import empty_maps
from mapping.learning.pooling import Sample, fit_weights, sample_of
from mapping.pipeline import geometry_of
from mapping.placed_session import place_session
from mapping.scoring.observable import observable_cells, with_silent_readings
from mapping.scoring.truth import TrueWalls
from mapping.update_rules.pooled_weights import Weights, as_table, weights_of
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Scan
from recorder.sensors import CATALOGUE
from recorder.simulator.echoes import range_reading, scan_reading
from recorder.simulator.rooms import ROOMS
from recorder.simulator.routes import inside
from recorder.simulator.walls import leg_clearance

SENSORS = {"sonar": "ping", "infrared": "dirrs", "laser": "lidar"}
SIZES = (1.4, 1.7, 2.0, 2.4)  # times the room's own
THINNED = (1, 5, 10)
COUNTS = {"sonar": 3000, "infrared": 3000, "laser": 150}
SPOTS = 12
CLEAR_M = 0.18  # from walls, at least
STEP_M = 0.022  # driven between two readings
SWAY_RAD = 0.3  # of the heading, while driving
PERIOD_NS = 100_000_000
SETTINGS = ("grid.resolution_m=0.02", "sensors.*.update=pooled", "grid.max_memory_mb=4000")


def poses(walls_m: NDArray[np.float64], count: int, draw: np.random.Generator) -> Iterator[SE2]:
    """Half of them turning on spots, half driving between random places in the open."""
    turning = count // 2 // SPOTS
    for _ in range(SPOTS):
        (x, y), heading = open_place(walls_m, draw), float(draw.uniform(-math.pi, math.pi))
        for k in range(turning):
            yield SE2(x, y, heading + 2.0 * math.pi * k / turning)
    left, here = count - turning * SPOTS, np.array(open_place(walls_m, draw))
    while left > 0:
        there = np.array(open_place(walls_m, draw))
        way, length_m = there - here, float(np.hypot(*(there - here)))
        if length_m < 0.3 or leg_clearance(here, there, walls_m) < CLEAR_M:
            here = here if draw.uniform() < 0.95 else there  # out of a corner without a way
            continue
        heading = math.atan2(way[1], way[0])
        for share in np.arange(0.0, 1.0, STEP_M / length_m)[:left]:
            x, y = (here + share * way).tolist()
            yield SE2(x, y, heading + SWAY_RAD * float(draw.standard_normal()))
            left -= 1
        here = there


def open_place(walls_m: NDArray[np.float64], draw: np.random.Generator) -> tuple[float, float]:
    """A random place where the robot can stand."""
    low, high = walls_m.min(axis=(0, 1)), walls_m.max(axis=(0, 1))
    while True:
        place = draw.uniform(low, high)
        if inside(place[None], walls_m)[0] and leg_clearance(place, place, walls_m) > CLEAR_M:
            return float(place[0]), float(place[1])


def session(
    walls_m: NDArray[np.float64], medium: str, draw: np.random.Generator
) -> list[tuple[Pose, Message]]:
    """A pose and what was measured from there, again and again."""
    kind, found = CATALOGUE[SENSORS[medium]], list[tuple[Pose, Message]]()
    for k, base in enumerate(poses(walls_m, COUNTS[medium], draw)):
        t_ns, sensor = k * PERIOD_NS, base @ kind.mount
        measured: Message
        if kind.scan is None:
            range_m = range_reading(walls_m, sensor, kind, 1.0, draw)
            measured = kind.parameters.reading(t_ns, kind.name, range_m)
        else:
            ranges_m = scan_reading(walls_m, sensor, kind, kind.scan, 1.0, draw)
            first, step = np.radians([kind.scan.first_deg, kind.scan.increment_deg]).tolist()
            measured = Scan(t_ns, kind.name, ranges_m, first, step, kind.min_range_m,
                            kind.scan.reach_m)  # fmt: skip
        found.append((Pose(t_ns, base), measured))
    return found


def sample(
    pairs: list[tuple[Pose, Message]], walls_m: NDArray[np.float64], config: MappingConfig
) -> Sample:
    """What the map of a session teaches."""
    messages = [message for pair in pairs for message in pair]
    placed = place_session(messages, config)
    geometry, truth = geometry_of(placed, config), TrueWalls(walls_m)
    maps = empty_maps(placed.placement.sensors, geometry, config.grid)
    for readings in placed:
        for each in maps.values():
            each.merge_many(readings)
    looking = place_session(messages, with_silent_readings(config))
    ((name, made),) = maps.items()
    return sample_of(made.state, observable_cells(looking, truth, geometry)[name], truth)


def learned(medium: str, seed: int) -> Weights:
    """The weights of a medium, from all rooms."""
    config, samples = load_config([], SETTINGS), list[Sample]()
    for number, room in enumerate(ROOMS.values()):
        for size in SIZES:
            walls_m = room.walls_m * size + (0.0037, 0.0051)  # not on the lattice of the cells
            draw = np.random.default_rng([seed, number, int(10 * size)])
            pairs = session(walls_m, medium, draw)
            samples += [sample(pairs[::nth], walls_m, config) for nth in THINNED]
    return fit_weights(samples, weights_of(medium))


def document(weights: dict[str, Weights], seed: int) -> str:
    """The file."""
    text = tomlkit.document()
    text.add(tomlkit.comment("Weights of the update rule `pooled`; made by"))
    text.add(tomlkit.comment(f"python -m benchmarks.pooled_weights --seed {seed}"))
    text.add(tomlkit.comment(f"from rooms {', '.join(ROOMS)},"))
    text.add(tomlkit.comment(f"at {', '.join(map(str, SIZES))} times their size."))
    for medium, each in weights.items():
        table = tomlkit.table()
        table.update(as_table(each))
        text.add(medium, table)
    return tomlkit.dumps(text)


def main() -> None:
    """Learn, and write or print the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--media", default="sonar,infrared", help="of sonar, infrared, laser")
    options = parser.parse_args()
    media = options.media.split(",")
    text = document({medium: learned(medium, options.seed) for medium in media}, options.seed)
    if options.write is None:
        print(text, end="")
    else:
        options.write.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
