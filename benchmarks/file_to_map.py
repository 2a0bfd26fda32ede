"""From a session file to its maps: how long, and what of it is reading, placing and merging.

``python -m benchmarks.file_to_map`` writes a session of 10,000 readings (sonar and infrared, a
moving robot) and maps it with cells of 1 cm as ``map -o -`` does, in alternating rounds with the
kernels alone on readings that are placed already: CPU seconds of one thread, or seconds on the
clock of several. ``--memory N`` maps sessions of growing length up to N readings, each in a process
of its own: time and peak memory.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.made_up_sessions import write_session
from mapping.config import MappingConfig, load_config
from mapping.layer_map import empty_maps
from mapping.pipeline import Trail, geometry_of, merge, result_stages, stretches
from mapping.placed_session import PlacedSession, place_session
from mapping.readings import Readings
from recorder.session.columns import open_session


def grids(placed: PlacedSession, config: MappingConfig, threads: int) -> int:
    """All maps of a session, without what is found in them; how many readings they hold."""
    maps = empty_maps(
        placed.placement.sensors, geometry_of(placed, config), config.grid, threads=threads
    )
    readings = 0
    for stretch in stretches(placed, 0):
        for _ in merge(stretch, maps, watched=False):
            pass
        readings += len(stretch)
    return readings


def kernels(stretch: Readings, placed: PlacedSession, config: MappingConfig, threads: int) -> None:
    """The merging alone, of readings in memory."""
    maps = empty_maps(
        placed.placement.sensors, geometry_of([stretch], config), config.grid, threads=threads
    )
    for _ in merge(stretch, maps, watched=False):
        pass


def results(placed: PlacedSession, config: MappingConfig) -> None:
    """What is found in the maps: fusion, borders, lines."""
    sensors, geometry = placed.placement.sensors, geometry_of(placed, config)
    maps, trail = empty_maps(sensors, geometry, config.grid), Trail(geometry)
    for stretch in stretches(placed, 0):
        for _ in merge(stretch, maps, watched=False):
            pass
        trail.take(stretch)
    start = time.process_time()
    for _ in result_stages(sensors, maps, trail, config, final=True):
        pass
    print(f"  {'fusion, borders, lines':28} {time.process_time() - start:8.3f} s (once)")


def shares(path: Path, config: MappingConfig, rounds: int, threads: int) -> None:
    """The parts in alternating rounds, and their ratios."""
    session = open_session(path)
    placed = place_session(session, config)
    stretch = Readings.joined(list(placed))
    messages = sum(len(columns) for block in session.blocks() for columns in block.columns)

    def read_and_place() -> None:
        for _ in place_session(session, config):
            pass

    parts: dict[str, Callable[[], object]] = {
        "reading": lambda: sum(len(block.columns) for block in session.blocks()),
        "reading and placing": read_and_place,
        "kernels": lambda: kernels(stretch, placed, config, threads),
        "file to grids": lambda: grids(place_session(session, config), config, threads),
    }
    clock = time.process_time if threads == 1 else time.perf_counter
    spent: dict[str, list[float]] = {name: [] for name in parts}
    for turn in range(rounds + 1):
        for name, run in parts.items():
            start = clock()
            run()
            if turn:  # the first round compiles and warms up
                spent[name].append(clock() - start)
    print(f"{len(stretch):,} readings of {messages:,} messages, {threads} thread(s), "
          f"{rounds} rounds, cells of {config.grid.resolution_m * 100:g} cm")  # fmt: skip
    for name, times in spent.items():
        middle = statistics.median(times)
        print(f"  {name:28} {middle:8.3f} s ({min(times):.3f} to {max(times):.3f}), "
              f"{middle / len(stretch) * 1e6:6.2f} us a reading, "
              f"{len(stretch) / middle:10,.0f} readings/s")  # fmt: skip
    ratios = [a / b for a, b in zip(spent["file to grids"], spent["kernels"], strict=True)]
    print(f"  file to grids over kernels   {statistics.median(ratios):8.2f} times "
          f"({min(ratios):.2f} to {max(ratios):.2f})")  # fmt: skip
    results(placed, config)


def through(path: Path, config: MappingConfig, threads: int) -> None:
    """One session to its grids. Prints what it took."""
    start = time.perf_counter()
    readings = grids(place_session(open_session(path), config), config, threads)
    seconds = time.perf_counter() - start
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{readings:12,} {path.stat().st_size / 1e6:9.0f} {peak_mb:9.0f} "
          f"{seconds:9.2f} {readings / seconds:12,.0f}", flush=True)  # fmt: skip


def memory(longest: int, more: list[str]) -> None:
    """Sessions of growing length."""
    print("    readings   file MB   peak MB   seconds   readings/s", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.mcap"
        for readings in (longest // 100, longest // 10, longest):
            write_session(path, readings)
            command = [sys.executable, "-m", "benchmarks.file_to_map", "--through", str(path)]
            subprocess.run([*command, *more], check=True)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--readings", type=int, default=10_000)
    options.add_argument("--rounds", type=int, default=7)
    options.add_argument("--threads", type=int, default=1)
    options.add_argument("--set", dest="settings", action="append", default=[])
    options.add_argument("--session", type=Path)
    options.add_argument("--memory", type=int, metavar="READINGS")
    options.add_argument("--through", type=Path, help=argparse.SUPPRESS)
    asked = options.parse_args()
    config = load_config((), ["grid.resolution_m=0.01", *asked.settings], None)
    if asked.through is not None:
        through(asked.through, config, asked.threads)
    elif asked.memory is not None:
        memory(asked.memory, [f"--threads={asked.threads}"])
    elif asked.session is not None:
        shares(asked.session, config, asked.rounds, asked.threads)
    else:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "made-up.mcap"
            write_session(path, asked.readings)
            shares(path, config, asked.rounds, asked.threads)


if __name__ == "__main__":
    main()
