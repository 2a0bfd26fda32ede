"""A recorder process that is killed, or finds no room: what it left is a session."""

from __future__ import annotations

import errno
import os
import random
import resource
import subprocess
import sys
import time
import tty
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from conftest import ROOT

from benchmarks.recorder_kill import Outcome, kill_one, line, wait_until_recording
from recorder.session import read_session

# Python takes compiled modules that found no room for whole ones, ever after.
NO_BYTECODE = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
KILLS = 5
# A second may be lost; more is granted here only for a machine that does ten things at once. The
# command in benchmarks/ measures it.
LONGEST_LOSS_S = 5.0


def test_a_killed_recording_loses_its_last_second_recovers_and_maps(tmp_path: Path) -> None:
    """Killed at random moments; ``kill_one`` itself compares every line that is in the file."""
    rng = random.Random()

    def kill(number: int) -> Outcome:
        folder = tmp_path / str(number)
        folder.mkdir()
        return kill_one(folder, rng.uniform(5.5, 8.0))

    with ThreadPoolExecutor(KILLS) as pool:
        outcomes = list(pool.map(kill, range(KILLS)))
    for one in outcomes:
        assert one.lost_s <= LONGEST_LOSS_S, one
        assert 0 < one.kept <= one.sent
        assert one.recovered > one.kept  # the lines, what they carry, and the diagnostics
        assert one.mapped > 0


def feed_until_it_ends(device_fd: int, recorder: subprocess.Popen[str]) -> int:
    """Send lines as fast as they are taken; how many."""
    sent, rest = 0, b""
    deadline_s = time.monotonic() + 120
    while recorder.poll() is None and time.monotonic() < deadline_s:
        if not rest:
            rest, sent = line(sent), sent + 1
        try:
            rest = rest[os.write(device_fd, rest) :]
        except BlockingIOError:
            time.sleep(0.001)
    return sent


def test_a_recorder_that_finds_no_room_stops_with_the_reason(tmp_path: Path) -> None:
    """A file that may not grow over 60 kB stands for a full disk, end to end."""
    session = tmp_path / "run.mcap"
    device_fd, host_fd = os.openpty()
    tty.setraw(device_fd)
    tty.setraw(host_fd)
    os.set_blocking(device_fd, False)
    with subprocess.Popen(
        [
            sys.executable, "-m", "echogrid", "record", os.ttyname(host_fd), "-o", str(session),
            "--min-free-mb", "0", "--quiet",
        ],
        cwd=ROOT, stderr=subprocess.PIPE, text=True, env=NO_BYTECODE,
    ) as recorder:  # fmt: skip
        resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (60_000, 60_000))
        wait_until_recording(recorder, session)
        sent = feed_until_it_ends(device_fd, recorder)
        assert recorder.wait(60) == 1
        assert recorder.stderr is not None
        errors = recorder.stderr.read()
    os.close(device_fd)
    os.close(host_fd)
    assert f"echogrid: {os.strerror(errno.EFBIG)}" in errors
    assert "Traceback" not in errors
    found = read_session(session)
    lines = [r.message.text.encode() for r in found.records if r.topic == "/serial/raw"]
    assert 100 < len(lines) < sent
    assert lines == [line(number) for number in range(len(lines))]
    assert found.damage


def test_a_simulation_that_finds_no_room_fails_in_one_line(tmp_path: Path) -> None:
    session = tmp_path / "run.mcap"
    with subprocess.Popen(
        [sys.executable, "-m", "echogrid", "simulate", "room", "-o", str(session), "--quiet"],
        cwd=ROOT, stderr=subprocess.PIPE, text=True, env=NO_BYTECODE,
    ) as simulation:  # fmt: skip
        resource.prlimit(simulation.pid, resource.RLIMIT_FSIZE, (5_000, 5_000))
        _, errors = simulation.communicate(timeout=120)
    assert (simulation.returncode, errors) == (
        2, f"echogrid: {session}: {os.strerror(errno.EFBIG)}\n",
    )  # fmt: skip
    assert list(tmp_path.iterdir()) == []
