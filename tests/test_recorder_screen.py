"""What a recording shows on a terminal, and as a line a second."""

from __future__ import annotations

import io
import math
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from recorder.geometry import SE2
from recorder.messages import Pose, Radiation, Range
from recorder.recording import RecordingStatus
from recorder.recording.screen import bars, open_screen
from recorder.recording.status import lost_anything, status_line
from recorder.translation import RecordingCounters


def reading(sensor: str, range_m: float) -> Range:
    return Range(0, sensor, range_m, 0.6, 0.02, 4.0, Radiation.ULTRASOUND)


STATUS = RecordingStatus(
    t_ns=83_000_000_000,
    elapsed_s=83.0,
    link_up=True,
    counters=RecordingCounters(received=1660, malformed=2, gaps=3, poses=830, written=4000),
    latest={"ping": reading("ping", 2.0), "dirrs": reading("dirrs", math.inf)},
    rate_hz={"ping": 19.96, "dirrs": 0.0},
    pose=Pose(0, SE2(1.25, 0.8, math.pi / 2)),
    missing={"ping": 4, "dirrs": 0},
    paused=False,
)


def drawn(status: RecordingStatus, free_bytes: int = 12_300_000_000, keys: bool = True) -> str:
    console = Console(file=io.StringIO(), width=100, color_system=None)
    console.print(bars("run.mcap", status, free_bytes, keys=keys))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def row_of(text: str, sensor: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(sensor))


def test_all_is_on_the_screen() -> None:
    text = drawn(STATUS)
    assert "recording run.mcap  01:23  line up  12.3 GB free" in text
    assert row_of(text, "ping").split()[-4:] == ["2.00", "m", "20.0/s", "~4"]
    assert row_of(text, "dirrs").split()[-3:] == ["nothing", "0.0/s", "0"]
    assert "x 1.25 m, y 0.80 m, 90 deg" in text
    assert "lines 1660   damaged 2   missing 3" in text
    assert "space: pause" in text
    assert "space" not in drawn(STATUS, keys=False)


@pytest.mark.parametrize(("range_m", "full"), [(0.5, 4), (2.0, 16), (4.0, 32), (9.0, 32)])
def test_the_bar_is_as_long_as_the_range(range_m: float, full: int) -> None:
    status = replace(STATUS, latest={"ping": reading("ping", range_m)})
    console = Console(file=io.StringIO(), width=100, color_system="standard", force_terminal=True)
    console.print(bars("run.mcap", status, 0, keys=False))
    assert isinstance(console.file, io.StringIO)
    line = next(line for line in console.file.getvalue().splitlines() if "ping" in line)
    in_colour = [part for part in line.split("\x1b[") if "━" in part]
    assert in_colour[0].count("━") == full, "the filled part comes first, in a colour of its own"


def test_what_is_wrong_can_be_seen() -> None:
    assert "PAUSED" in drawn(replace(STATUS, paused=True))
    assert "NO LINK" in drawn(replace(STATUS, link_up=False))
    assert "no reading yet" in drawn(replace(STATUS, latest={}, missing={}))
    assert "no pose yet" in drawn(replace(STATUS, pose=None))
    assert "too close" in drawn(replace(STATUS, latest={"ping": reading("ping", -math.inf)}))


def test_it_is_drawn_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with ExitStack() as stack:
        show, period_s = open_screen(stack, tmp_path / "run.mcap", keys=False)
        show(STATUS)
        show(replace(STATUS, elapsed_s=84.0))
    assert period_s < 1.0
    text = terminal.getvalue()
    assert "01:23" in text
    assert "01:24" in text
    assert "\x1b[1A" in text, "the cursor goes up again"


def test_the_same_in_a_line() -> None:
    assert status_line(STATUS) == (
        "   83 s  dirrs nothing 0/s  ping 2.00 m 20/s  bad 2  missing 3  poses 830"
    )
    assert "PAUSED  no link" in status_line(replace(STATUS, paused=True, link_up=False))


def test_what_counts_as_a_loss() -> None:
    assert not lost_anything(RecordingCounters(received=5, noise=1, blank=2, header=1))
    for name in ("bad_checksum", "malformed", "cut", "overlong", "gaps"):
        assert lost_anything(RecordingCounters(**{name: 1}))
    assert lost_anything(RecordingCounters(failure="No space left on device"))
