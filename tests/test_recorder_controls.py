"""Keys and signals that pause, go on and end."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from recorder.recording.controls import Controls, keys, signals

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs terminals")


def wait_until(condition: Callable[[], bool]) -> None:
    give_up_s = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < give_up_s
        time.sleep(0.01)


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """The end where somebody types, and the end where the program reads."""
    ours, theirs = os.openpty()
    yield ours, theirs
    os.close(ours)
    os.close(theirs)


def test_keys_pause_go_on_and_end(terminal: tuple[int, int]) -> None:
    import termios

    typist, fd = terminal
    controls = Controls()
    before = termios.tcgetattr(fd)
    with keys(controls, fd) as heeded:
        assert heeded
        os.write(typist, b"x ")
        wait_until(controls.pause.is_set)
        os.write(typist, b"p")
        wait_until(lambda: not controls.pause.is_set())
        assert not controls.stop.is_set()
        os.write(typist, b"q")
        wait_until(controls.stop.is_set)
    assert termios.tcgetattr(fd) == before


def test_no_keys_are_read_from_a_pipe() -> None:
    reading, writing = os.pipe()
    os.write(writing, b"q")
    controls = Controls()
    with keys(controls, reading) as heeded:
        assert not heeded
    assert os.read(reading, 10) == b"q"
    assert not controls.stop.is_set()
    os.close(reading)
    os.close(writing)


@pytest.fixture
def hanging_up() -> Iterator[None]:
    """SIGHUP does something, even where the tests themselves run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hanging_up")
def test_signals_set_the_flags_and_are_given_back() -> None:
    controls = Controls()
    before = [signal.getsignal(number) for number in (signal.SIGUSR1, signal.SIGTERM)]
    with signals(controls):
        signal.raise_signal(signal.SIGUSR1)
        assert controls.pause.is_set()
        signal.raise_signal(signal.SIGUSR1)
        assert not controls.pause.is_set()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            controls.stop.clear()
            signal.raise_signal(number)
            assert controls.stop.is_set()
    assert [signal.getsignal(number) for number in (signal.SIGUSR1, signal.SIGTERM)] == before


def test_what_runs_under_nohup_outlives_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        controls = Controls()
        with signals(controls):
            signal.raise_signal(signal.SIGHUP)
        assert not controls.stop.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_another_thread_leaves_the_signals_alone() -> None:
    before = signal.getsignal(signal.SIGINT)
    seen = []

    def run() -> None:
        with signals(Controls()):
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(30)
    assert seen == [before]
