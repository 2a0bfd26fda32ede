"""Reading and placing by columns against message by message, and the memory of long sessions.

python benchmarks/columns.py                       20,000 readings, alternating rounds, ratios
python benchmarks/columns.py --session run.mcap    the same on a session of one's own
python benchmarks/columns.py --memory 10000000     time and peak memory up to so many readings
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

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from naive_placing import place  # noqa: E402

from benchmarks.made_up_sessions import write_session  # noqa: E402
from mapping.config import load_config  # noqa: E402
from mapping.pipeline import box_of  # noqa: E402
from mapping.placed_session import PlacedSession  # noqa: E402
from recorder.session import read_session  # noqa: E402
from recorder.session.columns import OpenSession  # noqa: E402

CONFIG = load_config((), (), None)


def in_turn(path: Path, rounds: int) -> None:
    """CPU time a message of each way, a part at a time, in alternating rounds."""
    session = OpenSession(path)
    messages = list(read_session(path).messages())

    def by_columns() -> None:
        for _ in PlacedSession(session.blocks, CONFIG):
            pass

    rivals: dict[str, Callable[[], object]] = {
        "read, one by one": lambda: read_session(path),
        "read, columns": lambda: sum(len(block.columns) for block in session.blocks()),
        "place, one by one": lambda: place(messages, CONFIG),
        "read and place, columns": by_columns,
    }
    spent: dict[str, list[float]] = {name: [] for name in rivals}
    for turn in range(rounds + 1):
        for name, run in rivals.items():
            start = time.process_time()
            run()
            if turn:  # the first round warms up
                spent[name].append((time.process_time() - start) / len(messages) * 1e6)
    print(f"{path.name}: {len(messages)} messages, {rounds} rounds, CPU time a message")
    for name, times in spent.items():
        low, middle, high = min(times), statistics.median(times), max(times)
        print(f"  {name:24} {middle:8.2f} us   ({low:.2f} to {high:.2f})")
    whole = [
        a + b for a, b in zip(spent["read, one by one"], spent["place, one by one"], strict=True)
    ]
    ratios = [a / b for a, b in zip(whole, spent["read and place, columns"], strict=True)]
    print(
        f"  one by one over columns  {statistics.median(ratios):8.1f} times "
        f"({min(ratios):.1f} to {max(ratios):.1f})"
    )


def go_through(path: Path) -> None:
    """Pass over a session as mapping does: poses, bounds, readings. Prints what it took."""
    start = time.process_time()
    placed = PlacedSession(OpenSession(path).blocks, CONFIG)
    known_s = time.process_time() - start
    box_of(placed)
    bounds_s = time.process_time() - start - known_s
    readings = sum(len(each) for each in placed)
    mapped_s = time.process_time() - start - known_s - bounds_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    parts = " + ".join(f"{s / readings * 1e6:.2f}" for s in (known_s, bounds_s, mapped_s))
    print(f"{readings:12,} {path.stat().st_size / 1e6:9.0f} {peak_mb:9.0f} MB   {parts}")


def memory(longest: int) -> None:
    """Sessions of growing length, each in a process of its own."""
    print("    readings   file MB      peak   us a reading: poses + bounds + readings")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.mcap"
        for readings in (longest // 1000, longest // 100, longest // 10, longest):
            write_session(path, readings)
            command = [sys.executable, __file__, "--through", str(path)]
            subprocess.run(command, check=True)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--readings", type=int, default=20_000)
    options.add_argument("--rounds", type=int, default=9)
    options.add_argument("--session", type=Path)
    options.add_argument("--memory", type=int, metavar="READINGS")
    options.add_argument("--through", type=Path, help=argparse.SUPPRESS)
    asked = options.parse_args()
    if asked.through is not None:
        go_through(asked.through)
    elif asked.memory is not None:
        memory(asked.memory)
    elif asked.session is not None:
        in_turn(asked.session, asked.rounds)
    else:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "made-up.mcap"
            write_session(path, asked.readings)
            in_turn(path, asked.rounds)


if __name__ == "__main__":
    main()
