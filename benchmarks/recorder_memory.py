"""The memory of a long recording, by a clock that is set: hours pass as fast as they are written.

The whole recorder runs in this process, from bytes to file: noise each few seconds, the line
unplugged and the robot restarted each hour, a tracker beside it, a chunk closed each 0.8 s.

    python benchmarks/recorder_memory.py --hours 1            200 lines a second, as a robot sends
    python benchmarks/recorder_memory.py --hours 10 --rate 5  as many chunks as ten hours have
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import psutil

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from mcap.reader import make_reader  # noqa: E402

from recorder.clock import NS_PER_S  # noqa: E402
from recorder.link import LinkEvent, LinkState, Received  # noqa: E402
from recorder.messages import Message  # noqa: E402
from recorder.protocols.echogrid import EchogridProtocol, encode  # noqa: E402
from recorder.protocols.reports import HeadReport, RangeReport, Report, WheelReport  # noqa: E402
from recorder.recording import inbox, record  # noqa: E402
from recorder.session import SessionWriter  # noqa: E402
from recorder.session import writer as session_writer  # noqa: E402
from recorder.simulator.robot import WHEELS  # noqa: E402
from recorder.tracker import Tracker  # noqa: E402
from recorder.translation import RecordingCounters  # noqa: E402

START_NS = 1_700_000_000 * NS_PER_S
CHUNK_NS = NS_PER_S * 4 // 5
LINES_A_POSE = 20
SAMPLES = 10


@dataclass
class LongRun:
    """A line for so long: what it brings, the clock that it moves, and what it reported."""

    seconds: int
    rate: int
    hour_s: int = 3600  # how often it is unplugged, and in the middle restarted
    now: int = START_NS
    lines: int = 0
    noisy: int = 0
    poses_due: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))

    def now_ns(self) -> int:
        """The time is where the line is."""
        return self.now

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        """``rate`` lines a second; some are noisy, and each hour the line is unplugged."""
        yield LinkEvent(LinkState.OPENED, START_NS, "the line")
        for second in range(self.seconds):
            start_ns = START_NS + second * NS_PER_S
            boot_ms = (second + self.hour_s // 2) % self.hour_s * 1000
            for number in range(self.rate):
                data = encode(
                    self._report(), self.lines % 2**16, boot_ms + number * 1000 // self.rate
                )
                if self.lines % 1009 == 0:
                    data, self.noisy = data.replace(b",", b";", 1), self.noisy + 1
                self.lines += 1
                self.now = start_ns + (number + 1) * NS_PER_S // self.rate
                yield Received(data, self.now)
                if self.lines % LINES_A_POSE == 0:
                    self.poses_due.release()
            if second % self.hour_s == self.hour_s - 1:
                yield LinkEvent(LinkState.LOST, self.now, "unplugged")
                yield LinkEvent(LinkState.REOPENED, self.now, "the line")

    def _report(self) -> Report:
        """Of every kind: two known rangers, one unknown, a head, wheels."""
        n = self.lines
        return (
            RangeReport("ping", 0.3 + n % 300 / 100.0),
            RangeReport("dirrs", 0.5),
            RangeReport("whiskers", 0.4),
            HeadReport("head", n % 300 / 100.0),
            WheelReport(n * 3 % 2**16, n * 4 % 2**16),
        )[n % 5]


@dataclass(frozen=True)
class Poses:
    """A tracker that sends a pose for each 20 lines of the robot."""

    run: LongRun

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        """Poses, in step with the lines."""
        yield LinkEvent(LinkState.OPENED, START_NS, "the tracker")
        for number in range(self.run.seconds * self.run.rate // LINES_A_POSE):
            self.run.poses_due.acquire()
            pose = {"x": number % 100 / 50.0, "y": 1.0, "heading_deg": number % 360}
            yield Received(json.dumps(pose).encode() + b"\n", self.run.now)


class TimedSession:
    """A session whose chunks are closed by the simulated clock; ``look`` is called now and then."""

    def __init__(self, writer: SessionWriter, look_each: int, look: Callable[[int], None]) -> None:
        self._writer, self._look_each, self._look = writer, look_each, look
        self._next_chunk_ns = START_NS
        self.chunks = 0

    def write(self, message: Message, *, log_ns: int) -> None:
        """Append, and close the chunk where 0.8 s have passed."""
        if log_ns >= self._next_chunk_ns:
            self._next_chunk_ns += CHUNK_NS
            self.sync()
        self._writer.write(message, log_ns=log_ns)

    def sync(self) -> None:
        """Close the chunk."""
        self._writer.sync()
        self.chunks += 1
        if self.chunks % self._look_each == 0:
            self._look(self.chunks)


def record_long(
    path: Path, run: LongRun, look_each: int, look: Callable[[int], None]
) -> RecordingCounters:
    """Record ``run`` into ``path``; ``look(chunks)`` is called each ``look_each`` chunks."""
    with (
        mock.patch.object(inbox, "_QUEUE_LENGTH", 8),  # what waits in it is bounded, not steady
        mock.patch.object(session_writer, "_SYNC_PERIOD_S", 3600.0),
        mock.patch.object(os, "fsync", _not_synced),
        SessionWriter(path, live=True) as writer,
    ):
        return record(
            run, TimedSession(writer, look_each, look), protocol=EchogridProtocol(), clock=run,
            stop=threading.Event(), tracker=Tracker(Poses(run)), wheels=WHEELS,
        )  # fmt: skip


def _not_synced(descriptor: int) -> None:
    """The disk is not what is measured; a Mock would keep a note of each call, and grow."""


def indexed_chunks(path: Path) -> tuple[int, int]:
    """How many chunks the index of a finished session names, and how many there are."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    return len(summary.chunk_indexes), summary.statistics.chunk_count


def main() -> None:
    """Record and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--hours", type=float, default=1.0)
    arguments.add_argument("--rate", type=int, default=200)
    options = arguments.parse_args()
    run = LongRun(round(options.hours * 3600), options.rate)
    process = psutil.Process()
    print("  hours     lines   chunks   memory in MB")

    def look(chunks: int) -> None:
        hours = (run.now - START_NS) / 3600 / NS_PER_S
        mb = process.memory_info().rss / 1e6
        print(f"{hours:7.2f} {run.lines:9} {chunks:8} {mb:10.2f}", flush=True)

    with tempfile.TemporaryDirectory(prefix="echogrid-memory-") as name:
        path = Path(name) / "run.mcap"
        each = max(run.seconds * NS_PER_S // CHUNK_NS // SAMPLES, 1)
        counters = record_long(path, run, each, look)
        indexed, chunks = indexed_chunks(path)
        size_mb = path.stat().st_size / 1e6
    lost = run.lines - run.noisy - counters.received
    print(f"{lost} lines lost; {run.noisy} were noisy, {counters.gaps} are missing by their number")
    print(f"{size_mb:.1f} MB; the index names {indexed} of {chunks} chunks")


if __name__ == "__main__":
    main()
