"""Where a running recording shows how it goes: bars on a terminal, a line a second elsewhere."""

from __future__ import annotations

import math
import shutil
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import click
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from recorder.recording.status import (
    RecordingStatus,
    damaged_lines,
    pose_text,
    range_text,
    status_line,
)

_PERIOD_S = 0.2
_BAR_WIDTH = 32
_LOW_BYTES = 1_000_000_000


def open_screen(
    stack: ExitStack, output: Path, *, keys: bool
) -> tuple[Callable[[RecordingStatus], None], float]:
    """What shows a status, on standard error, and each how many seconds it wants one.

    ``keys``: a key press is heeded. The screen is closed with ``stack``.
    """
    if sys.stderr is None or not sys.stderr.isatty():  # None: closed by who started us
        return lambda status: click.echo(status_line(status), err=True), 1.0
    live = stack.enter_context(Live(console=Console(stderr=True), auto_refresh=False))

    def show(status: RecordingStatus) -> None:
        free_bytes = shutil.disk_usage(output.parent).free
        live.update(bars(output.name, status, free_bytes, keys=keys), refresh=True)

    return show, _PERIOD_S


def bars(title: str, status: RecordingStatus, free_bytes: int, *, keys: bool) -> RenderableType:
    """What is drawn: one head line, a row for each sensor, the counters, and the keys."""
    parts: list[RenderableType] = [_head(title, status, free_bytes), _sensors(status)]
    parts.append(Text(_counters(status), style="yellow" if damaged_lines(status.counters) else ""))
    if keys:
        parts.append(Text("space: pause or go on   q: end", style="dim"))
    return Group(*parts)


def _head(title: str, status: RecordingStatus, free_bytes: int) -> Text:
    minutes, seconds = divmod(int(status.elapsed_s), 60)
    head = Text()
    if status.paused:
        head.append("PAUSED   ", style="bold yellow")
    else:
        head.append("recording", style="bold red")
    head.append(f" {title}  {minutes:02d}:{seconds:02d}  ")
    head.append("line up" if status.link_up else "NO LINK", style="" if status.link_up else "red")
    low = "bold red" if free_bytes < _LOW_BYTES else ""
    head.append(f"  {free_bytes / 1e9:.1f} GB free", style=low)
    return head


def _sensors(status: RecordingStatus) -> RenderableType:
    if not status.latest:
        return Text("no reading yet", style="dim")
    table = Table(box=None, pad_edge=False)
    table.add_column("sensor")
    table.add_column("", width=_BAR_WIDTH)
    for heading in ("range", "rate", "missing"):
        table.add_column(heading, justify="right")
    for name, reading in sorted(status.latest.items()):
        filled = min(max(reading.range_m, 0.0), reading.max_range_m)
        bar = ProgressBar(reading.max_range_m, filled, width=_BAR_WIDTH)
        nothing = Text("·" * _BAR_WIDTH, style="dim")
        missing = status.missing.get(name, 0)
        table.add_row(
            name,
            bar if math.isfinite(reading.range_m) else nothing,
            range_text(reading),
            f"{status.rate_hz.get(name, 0.0):.1f}/s",
            Text(f"~{missing}" if missing else "0", style="yellow" if missing else ""),
        )
    return table


def _counters(status: RecordingStatus) -> str:
    counters = status.counters
    parts = [
        f"lines {counters.received}", f"damaged {damaged_lines(counters)}",
        f"missing {counters.gaps}", f"reconnects {counters.reconnects}",
        f"restarts {counters.device_restarts}", f"poses {counters.poses}",
        f"written {counters.written}",
    ]  # fmt: skip
    return f"{pose_text(status.pose)}\n{'   '.join(parts)}"
