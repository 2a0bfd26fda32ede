"""A recording killed at random moments: how much of what the robot sent is not in the file.

A real ``echogrid record`` process records a pseudo-terminal on which 200 lines a second arrive, is
killed by SIGKILL at a random moment, and what it left is read, recovered and mapped. "Lost" is the
age, at the kill, of the oldest line that is missing.

    python benchmarks/recorder_kill.py [--kills 20] [--seed 0]
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tty
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from mapping.config import MappingConfig  # noqa: E402
from mapping.pipeline import build_maps  # noqa: E402
from recorder.messages import Range  # noqa: E402
from recorder.protocols.echogrid import encode  # noqa: E402
from recorder.protocols.reports import PoseReport, RangeReport  # noqa: E402
from recorder.session import read_session  # noqa: E402
from recorder.session.recover import recover  # noqa: E402

LINES_PER_S = 200
MOUNT = "ping=0.044,0,0"


@dataclass(frozen=True)
class Outcome:
    """What one kill left."""

    killed_after_s: float
    sent: int
    kept: int
    lost_s: float
    recovered: int
    mapped: int


def line(number: int) -> bytes:
    """Line ``number``: poses and readings take turns; a reading carries its number."""
    ms = number * 1000 // LINES_PER_S
    if number % 2:
        return encode(RangeReport("ping", (number % 3000 + 300) / 1000.0), number % 2**16, ms)
    return encode(PoseReport(number / 1e4, 1.0, 0.0), number % 2**16, ms)


def kill_one(folder: Path, after_s: float) -> Outcome:
    """Record into ``folder``, kill the recorder ``after_s`` after the first line, and look."""
    session = folder / "run.mcap"
    device_fd, host_fd = os.openpty()
    tty.setraw(device_fd)
    tty.setraw(host_fd)
    command = [
        sys.executable, "-m", "echogrid", "record", os.ttyname(host_fd), "-o", str(session),
        "--mount", MOUNT, "--min-free-mb", "1", "--quiet",
    ]  # fmt: skip
    with subprocess.Popen(command, cwd=ROOT) as recorder:
        wait_until_recording(recorder, session)
        sent_s = feed_and_kill(device_fd, recorder, after_s)
    killed_s = time.monotonic()
    os.close(device_fd)
    os.close(host_fd)
    return judged(folder, session, sent_s, killed_s)


def wait_until_recording(recorder: subprocess.Popen[Any], session: Path) -> None:
    """Until the file stands there: the line is open by then."""
    while not session.exists():
        if recorder.poll() is not None:
            raise RuntimeError(f"the recorder ended with {recorder.returncode}")
        time.sleep(0.01)


def feed_and_kill(device_fd: int, recorder: subprocess.Popen[bytes], after_s: float) -> list[float]:
    """Send lines at their times until it is time to kill; when each was sent."""
    start_s = time.monotonic()
    sent_s: list[float] = []
    while (now_s := time.monotonic()) < start_s + after_s:
        while now_s >= start_s + len(sent_s) / LINES_PER_S:
            os.write(device_fd, line(len(sent_s)))
            sent_s.append(now_s)
        time.sleep(0.5 / LINES_PER_S)
    recorder.send_signal(signal.SIGKILL)
    return sent_s


def judged(folder: Path, session: Path, sent_s: list[float], killed_s: float) -> Outcome:
    """What is in the file, against what was sent."""
    found = read_session(session)
    lines = [r.message.text.encode("latin-1") for r in found.records if r.topic == "/serial/raw"]
    if lines != [line(number) for number in range(len(lines))]:
        raise AssertionError("the file holds other lines than were sent")
    if not found.damage:
        raise AssertionError("the file does not report that it was not finished")
    lost_s = killed_s - sent_s[len(lines)] if len(lines) < len(sent_s) else 0.0
    good = folder / "good.mcap"
    recovery = recover(session, good)
    mended = read_session(good)
    if not recovery.lost or mended.damage or mended.records != found.records:
        raise AssertionError("the recovered file is not what could be read")
    mapped = 0
    if sum(isinstance(record.message, Range) for record in mended.records) > 10:
        *_, finished = build_maps(mended.messages(), MappingConfig())
        mapped = sum(finished.used.values())
    return Outcome(
        sent_s[-1] - sent_s[0], len(sent_s), len(lines), lost_s, recovery.messages, mapped
    )


def main() -> None:
    """Kill and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--kills", type=int, default=20)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--at-once", type=int, default=2)
    options = arguments.parse_args()
    rng = random.Random(options.seed)
    moments_s = [rng.uniform(0.2, 8.0) for _ in range(options.kills)]
    lock = threading.Lock()
    worst_s = 0.0
    print("killed after   sent   kept   lost     recovered   readings mapped")

    def run(after_s: float) -> float:
        with tempfile.TemporaryDirectory(prefix="echogrid-kill-") as name:
            one = kill_one(Path(name), after_s)
        with lock:
            print(
                f"{one.killed_after_s:10.2f} s {one.sent:6} {one.kept:6} {one.lost_s:6.2f} s "
                f"{one.recovered:9} {one.mapped:12}",
                flush=True,
            )
        return one.lost_s

    with ThreadPoolExecutor(options.at_once) as pool:
        worst_s = max(pool.map(run, moments_s))
    print(f"{options.kills} kills (seed {options.seed}), most lost: {worst_s:.2f} s of lines")


if __name__ == "__main__":
    main()
