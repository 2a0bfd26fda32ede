"""Size and speed of recordings: ``python benchmarks/rrd.py [READINGS] [ROWSxCOLS] [BUDGET_MB]``.

Writes a made run (sonar and infrared in an empty rectangle) and prints a line of a table: how large
the file is, how long writing took, how much memory, how long it takes to read a grid back. With
``--viewer`` also how long the viewer takes for its first picture and for a jump to a far step.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests")]

from made_run import MadeRun  # noqa: E402

from mapping.grid import GridGeometry  # noqa: E402
from replay.rrd.reader import read_rrd  # noqa: E402
from replay.rrd.writer import RrdWriter  # noqa: E402

LONGEST_M = 3.0


def write(run: MadeRun, path: Path, budget_mb: float) -> tuple[float, RrdWriter]:
    """Write the run; seconds spent in the writer alone, and the writer."""
    seconds = 0.0
    with RrdWriter(path, config_text="", name="benchmark", budget_mb=budget_mb) as writer:
        for artifact in run.artifacts():
            start = time.perf_counter()
            writer(artifact)
            seconds += time.perf_counter() - start
        start = time.perf_counter()
    return seconds + time.perf_counter() - start, writer


def measure_reading(path: Path) -> str:
    """How long it takes to open the file and to read the last grid."""
    start = time.perf_counter()
    recording = read_rrd(path)
    opened = time.perf_counter()
    recording.grid("ping")
    return f"open {opened - start:.2f} s, grid {time.perf_counter() - opened:.2f} s"


def measure_viewer(path: Path) -> str:
    """How long the real viewer takes, without a window."""
    from replay.rrd.headless import HeadlessViewer

    start = time.perf_counter()
    with HeadlessViewer(path) as viewer:
        viewer.screenshot()
        first = time.perf_counter() - start
        jumps = []
        for share in (0.9, 0.2, 0.6, 0.60001):
            start = time.perf_counter()
            viewer.go_to(int(viewer.steps[1] * share))
            viewer.screenshot()
            jumps.append(time.perf_counter() - start)
    return f"first picture {first:.1f} s, jumps {', '.join(f'{jump:.1f}' for jump in jumps)} s"


def main() -> None:
    """One line of the table."""
    given = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    readings, shape, budget = (*given, *("10000", "400x600", "100")[len(given) :])
    rows, cols = (int(number) for number in shape.split("x"))
    geometry = GridGeometry((0.0, 0.0), 0.01, rows, cols)
    run = MadeRun(geometry, readings=int(readings), longest_m=LONGEST_M)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "benchmark.rrd"
        seconds, writer = write(run, path, float(budget))
        memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"readings {readings}, cells {cols} x {rows}, budget {budget} MB")
        print(f"size {path.stat().st_size / 1e6:.1f} MB, written in {seconds:.1f} s")
        print(f"memory {memory_mb:.0f} MB; {measure_reading(path)}")
        if "--viewer" in sys.argv:
            print(measure_viewer(path))
        print(writer.left_out or "nothing left out")


if __name__ == "__main__":
    main()
