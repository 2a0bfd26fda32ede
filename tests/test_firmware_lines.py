"""What the library and the MicroPython module write, held against the recorder's own protocol."""

from __future__ import annotations

import ctypes
import math
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated_board import FIRMWARE

from recorder.protocols.echogrid import EchogridProtocol, encode
from recorder.protocols.reports import (
    HeadReport,
    HelloReport,
    LogReport,
    PoseReport,
    RangeReport,
    Report,
    WheelReport,
)

LIBRARY = FIRMWARE / "Echogrid"
LINE_BYTES = 96
INT32 = st.integers(-(2**31), 2**31 - 1)
SEQ, MS = st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1)
ROBOT_SENDS = """
import sys
sys.path.insert(0, {module!r})
{before}
import echogrid
robot = echogrid.Echogrid("pico", "test-1")
robot.range("ping", 523)
robot.range("ping", 522.6, 4294967295)
robot.range("dirrs", echogrid.NOTHING_SEEN)
robot.range("dirrs", echogrid.TOO_CLOSE)
robot.head(-9000)
robot.wheels(70000, -3)
robot.pose(1250, 800, 9000)
robot.log("7.4 V, $full* " + 90 * "x")
for _ in range(3):
    robot.ticks_go_on()
    robot.range("ping", 1)
"""
# ticks_ms() goes round at 2**30; the test turns it on by four days.
TICKS = """
import time
class Time:
    now = 2**30 - 1000
    def ticks_ms(self): return self.now % 2**30
    def ticks_diff(self, a, b): return (a - b + 2**29) % 2**30 - 2**29
clock = sys.modules["time"] = Time()
import echogrid
def go_on(robot): clock.now += 4 * 86_400_000
echogrid.Echogrid.ticks_go_on = go_on
"""


class Line(ctypes.Structure):
    _fields_ = (("length", ctypes.c_uint8), ("text", ctypes.c_char * LINE_BYTES))


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The lines of the firmware, compiled for this computer."""
    if shutil.which("cc") is None:
        if os.environ.get("CI") == "true":
            pytest.fail("no C compiler: sudo apt install gcc libc6-dev")
        pytest.skip("no C compiler: sudo apt install gcc libc6-dev")
    file = tmp_path_factory.mktemp("lines") / "lines.so"
    source = LIBRARY / "src" / "echogrid_line.c"
    flags = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
    subprocess.run(["cc", *flags, "-shared", "-fPIC", str(source), "-o", str(file)], check=True)
    return ctypes.CDLL(str(file))


def written(library: ctypes.CDLL, kind: str, seq: int, ms: int, *values: int | str) -> bytes:
    line = Line()
    library.echogrid_start(
        ctypes.byref(line), kind.encode(), ctypes.c_uint16(seq), ctypes.c_uint32(ms)
    )
    for value in values:
        if isinstance(value, str):
            library.echogrid_word(ctypes.byref(line), value.encode())
        else:
            library.echogrid_integer(ctypes.byref(line), ctypes.c_int32(value))
    library.echogrid_end(ctypes.byref(line))
    return bytes(line)[1 : 1 + line.length]


@given(SEQ, MS, st.integers(0, 2**31 - 1), INT32, INT32)
def test_each_line_is_the_recorders_to_the_last_byte(
    library: ctypes.CDLL, seq: int, ms: int, mm: int, left: int, right: int
) -> None:
    pairs: list[tuple[Report, bytes]] = [
        (RangeReport("ping", mm / 1000.0), written(library, "RNG", seq, ms, "ping", mm)),
        (RangeReport("ping", math.inf), written(library, "RNG", seq, ms, "ping", -1)),
        (RangeReport("dirrs", -math.inf), written(library, "RNG", seq, ms, "dirrs", -2)),
        (WheelReport(left, right), written(library, "WHL", seq, ms, left, right)),
        (HelloReport(1, "a", "b-1"), written(library, "HEL", seq, ms, 1, "a", "b-1")),
        (LogReport("a, b"), written(library, "LOG", seq, ms, "a, b")),
    ]
    for report, line in pairs:
        assert line == encode(report, seq, ms)


@given(SEQ, MS, st.text(st.characters(min_codepoint=1, max_codepoint=255), max_size=120))
def test_any_text_becomes_a_sound_line(library: ctypes.CDLL, seq: int, ms: int, text: str) -> None:
    line = written(library, "LOG", seq, ms, text)
    assert len(line) <= LINE_BYTES
    (packet,) = EchogridProtocol().feed(line)
    assert packet.fault is None
    assert isinstance(packet.report, LogReport)


def interpreters() -> list[str]:
    """MicroPython, where there is one, and Python."""
    beside = Path(sys.executable).with_name("micropython")
    found = str(beside) if beside.exists() else shutil.which("micropython")
    return [sys.executable, *([found] if found else [])]


@pytest.mark.parametrize("interpreter", interpreters(), ids=lambda path: Path(path).name)
def test_what_micropython_writes_is_understood(interpreter: str, tmp_path: Path) -> None:
    script = tmp_path / "main.py"
    module = str(FIRMWARE / "micropython")
    script.write_text(ROBOT_SENDS.format(module=module, before=TICKS), "utf-8")
    output = subprocess.run([interpreter, str(script)], capture_output=True, check=True).stdout
    packets = EchogridProtocol().feed(output)
    assert [packet.fault for packet in packets] == [None] * len(packets)
    assert [packet.seq for packet in packets] == list(range(len(packets)))
    hello = HelloReport(1, "pico", "test-1")
    text = "7.4 V, ?full? " + 90 * "x"
    far = [hello, RangeReport("ping", 0.001)]  # four days later it introduces itself again
    assert [packet.report for packet in packets] == [
        hello,
        RangeReport("ping", 0.523), RangeReport("ping", 0.523),
        RangeReport("dirrs", math.inf), RangeReport("dirrs", -math.inf),
        HeadReport("head", math.radians(-90.0)), WheelReport(70000, -3),
        PoseReport(1.25, 0.8, math.radians(90.0)), LogReport(text[: 85 - len("$LOG,8,0,")]),
        *far, *far, *far,
    ]  # fmt: skip
    days_ms = 4 * 86_400_000
    assert packets[2].device_ms == 2**32 - 1
    assert [packet.device_ms for packet in packets[-6::2]] == [days_ms, 2 * days_ms, 3 * days_ms]
    assert packets[-1].device_ms < 2**30  # it went round in between


def test_micropython_is_there_in_ci() -> None:
    if os.environ.get("CI") == "true" and platform.machine() == "x86_64":
        assert len(interpreters()) == 2


def test_the_arduino_library_is_laid_out_as_one() -> None:
    """What the Arduino IDE and its linter look at."""
    lines = (LIBRARY / "library.properties").read_text("utf-8").splitlines()
    fields = dict(line.split("=", 1) for line in lines)
    assert fields["name"] == LIBRARY.name
    assert re.fullmatch(r"\d+\.\d+\.\d+", fields["version"])
    for name in ("author", "maintainer", "sentence", "paragraph", "url", "architectures"):
        assert fields[name]
    assert fields["category"] == "Communication"
    assert (LIBRARY / "src" / fields["includes"]).exists()
    for sketch in (LIBRARY / "examples").iterdir():
        assert (sketch / f"{sketch.name}.ino").exists()
    keywords = [
        line.split("\t") for line in (LIBRARY / "keywords.txt").read_text("utf-8").splitlines()
    ]
    assert all(len(parts) == 2 for parts in keywords)
    header = (LIBRARY / "src" / "Echogrid.h").read_text("utf-8")
    assert all(re.search(rf"\b{word}\b", header) for word, _ in keywords)
