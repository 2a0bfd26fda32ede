"""Where a running recording shows how it goes: bars on a terminal, a line a second elsewhere."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from recorder.recording.loop import RecordingStatus


def open_screen(
    stack: ExitStack, output: Path, *, keys: bool
) -> tuple[Callable[[RecordingStatus], None], float]:
    """What shows a status, on standard error, and each how many seconds it wants one.

    ``keys`` says that a key press is heeded. The screen is closed with ``stack``.
    """
    if sys.stderr is None or not sys.stderr.isatty():  # None: closed by who started us
        return _echo_line, 1.0
    from rich.console import Console

    from recorder.recording.live_bars import PERIOD_S, LiveBars

    screen = stack.enter_context(LiveBars(output.name, Console(stderr=True), keys=keys))

    def show(status: RecordingStatus) -> None:
        screen.show(status, shutil.disk_usage(output.parent).free)

    return show, PERIOD_S


def _echo_line(status: RecordingStatus) -> None:
    from recorder.recording.status_text import status_line

    click.echo(status_line(status), err=True)
