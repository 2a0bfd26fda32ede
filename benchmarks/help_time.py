"""How long ``echogrid --help`` takes, in a new process each: ``python benchmarks/help_time.py``.

The smallest time is the program's own; the median shows how busy the machine was.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RUNS = 10
CODE = "import sys, echogrid; sys.exit(echogrid.main(['--help']))"


def seconds_of_help() -> float:
    """One run, seconds; CalledProcessError if it fails."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", CODE], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    seconds_of_help()  # writes the byte code, once
    times_s = [seconds_of_help() for _ in range(RUNS)]
    low_ms, mid_ms = 1e3 * min(times_s), 1e3 * statistics.median(times_s)
    print(f"echogrid --help, {RUNS} runs: min {low_ms:.0f} ms, median {mid_ms:.0f} ms")


if __name__ == "__main__":
    main()
