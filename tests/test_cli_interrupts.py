"""Ctrl-C, SIGTERM and SIGHUP at any moment: one line, one exit code, nothing left beside a file."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# While these are imported: the program's own, its commands' and the large libraries.
IMPORTED = (
    "click", "recorder.outputs", "mapping.cli", "replay.cli.view", "numpy", "mcap.writer",
    "mapping.parameters", "recorder.simulator.rooms", "geojson", "replay.rrd.writer", "rerun",
)  # fmt: skip
# A signal comes when a module is looked for, or when so many bytes have been written beside.
# In the background a shell has signals ignored, and so has what it starts.
PROGRAM = """
import importlib.abc, os, runpy, signal, sys

signal.signal(signal.SIGINT, signal.default_int_handler)
when, number, *arguments = sys.argv[1:]
if when.isdigit():
    import zlib
    crc32, left = zlib.crc32, [int(when)]
    def counting(data, *start):
        left[0] -= 1
        if left[0] == 0:
            os.kill(os.getpid(), int(number))
        return crc32(data, *start)
    zlib.crc32 = counting
else:
    class Finder(importlib.abc.MetaPathFinder):
        def find_spec(self, name, path, target=None):
            if name == when:
                os.kill(os.getpid(), int(number))
    sys.meta_path.insert(0, Finder())
sys.argv = ["echogrid", *arguments]
runpy.run_module("echogrid", run_name="__main__", alter_sys=True)
"""


def run(folder: Path, when: str, number: signal.Signals, *arguments: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, when, str(int(number)), *arguments],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
        timeout=120, check=False,
    )  # fmt: skip
    return done.returncode, done.stderr


MOMENTS = [(name, signal.SIGINT) for name in IMPORTED]
MOMENTS += [(name, number) for name in ("click", "numpy") for number in SIGNALS[1:]]


@pytest.mark.parametrize(("when", "number"), MOMENTS)
def test_while_anything_is_imported(tmp_path: Path, when: str, number: signal.Signals) -> None:
    arguments = ("simulate", "room", "-o", "s.mcap", "--duration", "1", "--quiet")
    if when in ("replay.rrd.writer", "rerun", "mapping.parameters"):
        log = str(ROOT / "logs" / "room.mcap")
        arguments = ("map", log, "-o", "m.rrd", "--quiet")
    assert run(tmp_path, when, number, *arguments) == (128 + number, "echogrid: stopped\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("call", [3, 20])
def test_while_a_session_is_written(tmp_path: Path, call: int, number: signal.Signals) -> None:
    arguments = ("simulate", "room", "-o", "s.mcap", "--duration", "600", "--quiet")
    assert run(tmp_path, str(call), number, *arguments) == (128 + number, "echogrid: stopped\n")
    assert list(tmp_path.iterdir()) == []
