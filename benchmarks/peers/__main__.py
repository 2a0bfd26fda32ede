"""How fast are the kernels beside their peers? ``python -m benchmarks.peers [--rounds N] [NAME]``.

Builds MRPT's occupancy grid (Debian: libmrpt-maps-dev libmrpt-obs-dev) where its headers are, and
maps the same seeded sessions with it, with the kernels and with a plain NumPy and a plain Python
twin, in alternating rounds; scans also with OctoMap (``pip install pyoctomap``). Prints
readings/s, and the ratio to MRPT of each round (median, and the quarter to three-quarter range);
"share" is that of the limit: the same spans, a constant added. Times are CPU seconds of one
thread, but for "2 threads" (wall clock, beside one thread's): what two can give on a quiet machine
is told by the CPU time of either one's rows. OpenCV for lines: ``python -m benchmarks.lines``.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.peers import rivals, sessions

Times = dict[str, list[float]]


def timed(racers: dict[str, Callable[[], float]], rounds: int) -> Times:
    """Seconds of each racer in each round, after one that does not count."""
    times: Times = {name: [] for name in racers}
    for run in racers.values():
        run()
    for _ in range(rounds):
        for name, run in racers.items():
            times[name].append(run())
    return times


def ratio(times: Times, of: str, to: str) -> str:
    """How much faster one racer is than another: median, and its quartiles."""
    shares = np.array(times[to]) / np.array(times[of])
    low, middle, high = np.percentile(shares, [25, 50, 75])
    return f"{middle:5.2f} ({low:.2f}-{high:.2f})"


def table(name: str, times: Times, readings: int, slow: dict[str, int]) -> Iterator[str]:
    """The lines of one session's table; ``slow`` racers took only so many of the readings."""
    yield f"\n{name}"
    peers = [k for k in times if k.startswith("MRPT")]
    yield f"  {'':34}{'readings/s':>12}" + "".join(f"  {f'to {peer}':>22}" for peer in peers)
    for racer, seconds in times.items():
        rate = slow.get(racer, readings) / np.median(seconds)
        line = f"  {racer:34}{rate:12,.0f}"
        if racer not in slow:
            line += "".join(f"  {ratio(times, racer, peer):>22}" for peer in peers)
        yield line
    if "limit" in times:
        for racer in ("fading", "regions 12"):
            if racer in times:
                yield f"  share of the limit, {racer}: {ratio(times, racer, 'limit')}"
    if "2 threads, wall" in times:
        yield f"  2 threads to 1, wall clock: {ratio(times, '2 threads, wall', '1 thread, wall')}"


def main() -> None:
    """Run all sessions, or those named."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("names", nargs="*", help="sessions: " + ", ".join(sessions.SESSIONS))
    arguments = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} (ratios suffer above 1)")
    with tempfile.TemporaryDirectory() as folder:
        harness = rivals.built_mrpt(Path(folder))
        if harness is None:
            print("MRPT is not here: apt install libmrpt-maps-dev libmrpt-obs-dev g++")
        if find_spec("pyoctomap") is None:
            print("OctoMap is not here: pip install pyoctomap")
        for name in arguments.names or sessions.SESSIONS:
            session = sessions.SESSIONS[name]()
            racers, slow = rivals.racers_of(session, harness, Path(folder))
            times = timed(racers, arguments.rounds)
            print("\n".join(table(name, times, len(session.poses), slow)), flush=True)


if __name__ == "__main__":
    main()
