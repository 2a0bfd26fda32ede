"""A noisy line against the truth: each sound line is recorded exactly, and nothing else."""

from __future__ import annotations

import os
import random
import threading
import tty
from pathlib import Path

import numpy as np
import pytest

from recorder.clock import HostClock
from recorder.link import Link
from recorder.messages import Message, Range, RawLine
from recorder.protocols.echogrid import EchogridProtocol, encode
from recorder.protocols.reports import RangeReport
from recorder.recording import record
from recorder.session import SessionWriter, read_session
from recorder.translation import RecordingCounters

LINES = 4000
FIRST_MM = 100


def sent_lines(rng: np.random.Generator, corrupt_rate: float) -> list[tuple[bytes, bool]]:
    """Lines, some with damaged bytes or cut short, and whether each is as it should be."""
    lines = []
    for number in range(LINES):
        line = encode(RangeReport("ping", (FIRST_MM + number) / 1000.0), number, 5 * number)
        data = np.frombuffer(line, np.uint8).copy()
        hit = rng.random(len(data)) < corrupt_rate
        data[hit] ^= rng.integers(1, 256, size=int(hit.sum()), dtype=np.uint8)
        noisy = data.tobytes()
        if rng.random() < corrupt_rate:
            noisy = noisy[: int(rng.integers(0, len(noisy)))]  # a cut line
        lines.append((noisy, noisy == line))
    return lines


def recorded(path: Path, stream: bytes, rng: random.Random) -> RecordingCounters:
    """What a recorder makes of a stream that comes over a pseudo-terminal in odd pieces."""
    device_fd, host_fd = os.openpty()
    tty.setraw(device_fd)
    tty.setraw(host_fd)
    clock, stop = HostClock(), threading.Event()

    class Counting(SessionWriter):
        """Ends the recording when all bytes are in the file."""

        received = 0

        def write(self, message: Message, *, log_ns: int) -> None:
            super().write(message, log_ns=log_ns)
            if isinstance(message, RawLine):
                self.received += len(message.text)
                if self.received >= len(stream) - 96:  # the rest may still wait for its line end
                    stop.set()

    def feed() -> None:
        rest = stream
        while rest:
            rest = rest[os.write(device_fd, rest[: rng.randrange(1, 700)]) :]

    link = Link(os.ttyname(host_fd), clock=clock)
    link.open()
    feeder = threading.Thread(target=feed, daemon=True)
    with Counting(path, live=True) as session:
        feeder.start()
        counters = record(
            link, session, protocol=EchogridProtocol(), clock=clock, stop=stop, duration_s=120.0
        )
    feeder.join(20)
    os.close(device_fd)
    os.close(host_fd)
    return counters


@pytest.mark.parametrize("corrupt_rate", [0.0, 0.01])
def test_every_sound_line_is_recorded_and_none_is_wrong(
    tmp_path: Path, corrupt_rate: float
) -> None:
    seed = random.SystemRandom().randrange(2**32)
    lines = sent_lines(np.random.default_rng(seed), corrupt_rate)
    stream = b"".join(line for line, _ in lines)
    counters = recorded(tmp_path / "run.mcap", stream, random.Random(seed))
    session = read_session(tmp_path / "run.mcap")
    assert session.damage == ()

    raw = "".join(r.message.text for r in session.records if isinstance(r.message, RawLine))
    assert stream.startswith(raw.encode("latin-1")), f"seed {seed}"
    found = [
        round(r.message.range_m * 1000) - FIRST_MM
        for r in session.records
        if isinstance(r.message, Range)
    ]
    sound = [number for number, (_, is_sound) in enumerate(lines) if is_sound]
    arrived = _arrived(lines, len(raw))
    # in order, each once, all that were sound, and none that was never sent
    assert found == sorted(set(found)), f"seed {seed}"
    assert set(found) >= {number for number in sound if number < arrived}, f"seed {seed}"
    assert set(found) <= set(range(LINES))
    assert counters.received == len(found)
    assert counters.gaps == found[-1] - found[0] + 1 - len(found), f"seed {seed}"
    if corrupt_rate == 0.0:
        assert len(found) >= LINES - 3
        assert counters.bad_checksum + counters.malformed + counters.cut + counters.noise <= 1
    else:
        assert 0.6 < len(found) / LINES < 0.9
        assert counters.bad_checksum + counters.malformed > LINES / 10


def _arrived(lines: list[tuple[bytes, bool]], bytes_: int) -> int:
    """How many lines are in the first ``bytes_`` of the stream, to their ends."""
    for number, (line, _) in enumerate(lines):
        bytes_ -= len(line)
        if bytes_ < 0:
            return number
    return len(lines)
