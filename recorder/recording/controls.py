"""How a running recording is paused, continued or ended: by keys, and by signals.

Space or ``p`` pauses and goes on, ``q`` ends; so do the signals SIGUSR1, and SIGINT, SIGTERM and
SIGHUP. Keys are read only from a terminal in whose foreground the program runs.
"""

from __future__ import annotations

import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

try:
    import termios
    import tty
except ImportError:  # Windows: no keys, only Ctrl-C
    HAS_TERMINALS = False
else:
    HAS_TERMINALS = True

PAUSE_KEYS, END_KEYS = b" pP", b"qQ"
_END_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_PAUSE_SIGNALS = ("SIGUSR1",)
_POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class Controls:
    """Two flags that a recording heeds."""

    stop: threading.Event = field(default_factory=threading.Event)
    pause: threading.Event = field(default_factory=threading.Event)

    def toggle_pause(self) -> None:
        """Pause, or go on."""
        if self.pause.is_set():
            self.pause.clear()
        else:
            self.pause.set()


@contextmanager
def signals(controls: Controls) -> Iterator[None]:
    """Signals set the flags meanwhile; outside the main thread nothing is changed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before: list[tuple[signal.Signals, Any]] = []

    def obey(names: tuple[str, ...], act: Callable[[], None]) -> None:
        def handle(_number: int, _frame: FrameType | None) -> None:
            act()

        for name in names:
            if not hasattr(signal, name):  # not every system has them all
                continue
            number = signal.Signals[name]
            if name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN:
                continue  # nohup: it shall outlive its terminal
            before.append((number, signal.signal(number, handle)))

    try:
        obey(_END_SIGNALS, controls.stop.set)
        obey(_PAUSE_SIGNALS, controls.toggle_pause)
        yield
    finally:
        for number, old in reversed(before):
            signal.signal(number, old)


@contextmanager
def keys(controls: Controls, fd: int) -> Iterator[bool]:
    """Keys typed on ``fd`` set the flags meanwhile; False when it is no terminal of ours."""
    if not (HAS_TERMINALS and os.isatty(fd) and _in_foreground(fd)):
        yield False
        return
    before = termios.tcgetattr(fd)
    done = threading.Event()
    reader = threading.Thread(target=_read_keys, args=(controls, fd, done), daemon=True)
    try:
        tty.setcbreak(fd, termios.TCSANOW)  # each key at once; Ctrl-C stays a signal
        reader.start()
        yield True
    finally:
        done.set()
        reader.join()
        termios.tcsetattr(fd, termios.TCSANOW, before)


def _read_keys(controls: Controls, fd: int, done: threading.Event) -> None:
    while not done.is_set():
        try:
            ready, _, _ = select.select([fd], [], [], _POLL_S)
            if not ready:
                continue
            if not _in_foreground(fd):  # reading would stop the whole program
                done.wait(_POLL_S)
                continue
            typed = os.read(fd, 64)
        except OSError:  # the terminal is gone
            return
        if not typed:
            return
        for key in typed:
            if key in PAUSE_KEYS:
                controls.toggle_pause()
            elif key in END_KEYS:
                controls.stop.set()


def _in_foreground(fd: int) -> bool:
    try:
        return os.tcgetpgrp(fd) == os.getpgrp()
    except OSError:  # a terminal that controls nobody
        return True
