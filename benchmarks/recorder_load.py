"""A recorder under load: a real process records a pseudo-terminal at a given rate.

Lines that find no room in the terminal's buffer (4 kB) are lost, as they are on a real line when
nobody reads in time. In the end the file is read back and compared with what was sent.

    python benchmarks/recorder_load.py --rates 500,1000,2000 --seconds 60   each rate for so long
    python benchmarks/recorder_load.py --hour                720 000 lines, an hour of 200 a second

The hour is sent ten times as fast, and there the sender waits for room: the buffer holds 0.7 s of a
line at 200 a second, and the longest wait is reported. It must be below that. So that a busy
machine is not taken for a slow recorder, the longest time is reported, too, by which the sender
itself was late to wake from a sleep.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
import tty
from dataclasses import dataclass, field
from pathlib import Path

import psutil

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from recorder.messages import Diagnostics, Range, RawLine  # noqa: E402
from recorder.protocols.echogrid import encode  # noqa: E402
from recorder.protocols.reports import RangeReport  # noqa: E402
from recorder.session import SessionReader  # noqa: E402

HOUR_LINES = 3600 * 200
HOUR_PACED_PER_S = 2000
SAMPLES = 10
_PERIOD_S = 0.002


@dataclass
class Load:
    """What was sent and what the process took, while it was fed."""

    seconds: float = 0.0
    sent: int = 0
    no_room: int = 0
    waited_s: float = 0.0  # at most, for room
    overslept_s: float = 0.0  # at most, by the sender itself: the machine was busy
    cpu_share: float = 0.0
    rss_mb: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Found:
    """What is in the file."""

    lines: int
    readings: int
    gaps: int
    damage: tuple[str, ...]
    file_mb: float


def line(number: int, ms: int) -> bytes:
    """Line ``number``: an echo of the ``ping``, 29 bytes or so."""
    return encode(RangeReport("ping", (number % 3000 + 300) / 1000.0), number % 2**16, ms)


def run(rate: float, count: int, folder: Path, *, wait: bool) -> tuple[Load, Found]:
    """Record ``count`` lines at ``rate`` a second; ``wait`` for room, or lose them."""
    session = folder / "run.mcap"
    device_fd, host_fd = os.openpty()
    tty.setraw(device_fd)
    tty.setraw(host_fd)
    os.set_blocking(device_fd, wait)
    command = [
        sys.executable, "-m", "echogrid", "record", os.ttyname(host_fd), "-o", str(session),
        "--min-free-mb", "1", "--quiet",
    ]  # fmt: skip
    with subprocess.Popen(command, cwd=ROOT) as recorder:
        while not session.exists():
            time.sleep(0.05)
        time.sleep(1.0)  # its imports are done
        load = fed(device_fd, psutil.Process(recorder.pid), rate, count)
        time.sleep(2.0)
        recorder.send_signal(signal.SIGINT)
    os.close(device_fd)
    os.close(host_fd)
    return load, found(session)


def fed(device_fd: int, process: psutil.Process, rate: float, count: int) -> Load:
    """Send lines at their times, each once, whether there is room or not."""
    load = Load()
    cpu_s = sum(process.cpu_times()[:2])
    start_s = time.monotonic()
    while load.sent < count:
        now_s = time.monotonic() - start_s
        due = min(int(now_s * rate) + 1, count)
        while load.sent < due:
            before_s = time.monotonic()
            load.no_room += not offered(device_fd, line(load.sent, round(now_s * 1000)))
            if os.get_blocking(device_fd):
                load.waited_s = max(load.waited_s, time.monotonic() - before_s)
            load.sent += 1
        if load.sent * SAMPLES >= count * (len(load.rss_mb) + 1):
            load.rss_mb.append(process.memory_info().rss / 1e6)
        asleep_s = time.monotonic()
        time.sleep(_PERIOD_S)
        load.overslept_s = max(load.overslept_s, time.monotonic() - asleep_s - _PERIOD_S)
    load.seconds = time.monotonic() - start_s
    load.cpu_share = (sum(process.cpu_times()[:2]) - cpu_s) / load.seconds
    return load


def offered(device_fd: int, data: bytes) -> bool:
    """Whether the line found room, all of it."""
    try:
        return os.write(device_fd, data) == len(data)
    except BlockingIOError:
        return False


def found(session: Path) -> Found:
    """Read the file back."""
    reader = SessionReader(session)
    lines = readings = gaps = 0
    for record in reader.records():
        match record.message:
            case RawLine():
                lines += 1
            case Range():
                readings += 1
            case Diagnostics():
                gaps = int(record.message.counters["gaps"])
    return Found(lines, readings, gaps, reader.damage, session.stat().st_size / 1e6)


def report(rate: float, load: Load, found: Found) -> None:
    """One line of the table."""
    rss = " ".join(f"{mb:.0f}" for mb in load.rss_mb)
    lost = load.sent - found.readings
    print(
        f"{rate:7.0f} {load.sent / load.seconds:9.0f} {load.sent:8} {lost:6} {load.no_room:8} "
        f"{load.cpu_share:5.0%} {found.file_mb:7.1f}   {rss}",
        flush=True,
    )
    if load.waited_s > 0.0:
        print(f"        longest wait for room: {load.waited_s:.2f} s")
    print(f"        the sender itself was late by {load.overslept_s:.2f} s at most")
    if found.damage:
        print(f"        damage: {found.damage}")


def main() -> None:
    """Run and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--rates", default="500,1000,2000,4000")
    arguments.add_argument("--seconds", type=float, default=60.0)
    arguments.add_argument("--hour", action="store_true")
    options = arguments.parse_args()
    print("wanted/s  reached/s     sent   lost  no room   CPU  file MB   memory in MB over time")
    runs = [
        (float(rate), round(float(rate) * options.seconds)) for rate in options.rates.split(",")
    ]
    if options.hour:
        runs = [(float(HOUR_PACED_PER_S), HOUR_LINES)]
    for rate, count in runs:
        with tempfile.TemporaryDirectory(prefix="echogrid-load-") as name:
            report(rate, *run(rate, count, Path(name), wait=options.hour))


if __name__ == "__main__":
    main()
