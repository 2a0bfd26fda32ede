"""How the time of a sonar reading grows: ``python -m benchmarks.growth``.

The default model's kernel on made-up readings of 38 degrees, one thing changed at a time: how many
there are, how far they see, the size of a cell, the size of the grid, threads. Medians of 7 rounds
in turn; microseconds a reading, CPU time of one thread (threads: wall clock).
"""

from __future__ import annotations

import statistics
from dataclasses import replace

import numpy as np

from benchmarks.peers import rivals, sessions
from mapping.kernels.batch import fading
from mapping.kernels.batch.threads import band_edges, in_bands

ROUNDS = 7


def racer(session: sessions.Session, threads: int = 0) -> rivals.Race:
    """One run over a session; 0 threads: CPU time of this one."""
    cells, observed, place = rivals._map_of(session)
    model = rivals.SONAR
    readings = rivals._readings(session, model["before"], model["behind"])
    half = session.beam_width_rad / 2.0
    table = np.array([[half, model["hit"], model["miss"], model["near"], model["fade_m"]]])
    job = (cells, observed, place, readings, table)
    rows = len(observed)
    if threads:
        edges = band_edges(readings, np.array([half]), place, rows, threads)
        return rivals.wall(lambda: in_bands(fading.add_fading, *job, edges=edges))
    return rivals.cpu(lambda: fading.add_fading(*job, 0, rows))


def variants() -> dict[str, tuple[rivals.Race, int]]:
    """What is tried, by name, and of how many readings."""
    usual = sessions.coarse_sonar(2000)
    made: dict[str, tuple[rivals.Race, int]] = {}
    for count in (500, 2000, 8000, 32000):
        made[f"{count} readings"] = racer(sessions.coarse_sonar(count)), count
    for factor in (0.25, 0.5, 1.0):
        seen = replace(usual, ranges_m=usual.ranges_m * factor)
        made[f"ranges x {factor}"] = racer(seen), 2000
    for size_m in (0.04, 0.02, 0.01, 0.005):
        made[f"cells of {size_m * 100:g} cm"] = racer(replace(usual, resolution_m=size_m)), 2000
    for factor in (1, 2, 4):
        (x, y), margin = usual.high_m, 4.0 * (factor - 1)
        wide = replace(usual, low_m=(-margin, -margin), high_m=(x + margin, y + margin))
        made[f"grid of {(x + 2 * margin) * (y + 2 * margin):.0f} m2"] = racer(wide), 2000
    for threads in (1, 2):
        made[f"{threads} threads, 32000 readings"] = (
            racer(sessions.coarse_sonar(32000), threads), 32000
        )  # fmt: skip
    return made


def main() -> None:
    tried = variants()
    times: dict[str, list[float]] = {name: [] for name in tried}
    for turn in range(ROUNDS + 1):
        for name, (run, _) in tried.items():
            seconds = run()
            if turn:  # the first one compiles
                times[name].append(seconds)
    for name, (_, count) in tried.items():
        print(f"  {name:28} {statistics.median(times[name]) / count * 1e6:8.2f} us a reading")


if __name__ == "__main__":
    main()
