"""``record``: a serial line and a tracker into a session."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from recorder.cli import options
from recorder.cli.recording import line_options, prepared, report_counters


@click.command(
    epilog="Example:  echogrid record /dev/ttyUSB0 -o run.mcap --tracker tcp://host:5005"
)
@click.argument("source")
@options.output_session
@line_options
@options.force
@options.quiet
def record(source: str, output: Path, force: bool, quiet: bool, **choices: Any) -> int:
    """Record SOURCE into a session.

    SOURCE is a device, socket://HOST:PORT, rfc2217://HOST:PORT, sim:ROOM (a simulated robot) or
    replay:SESSION (one that was recorded). On a terminal, space or p pauses and goes on and q ends;
    elsewhere the signals SIGUSR1 and SIGINT do.
    """
    from recorder.recording.run import record_line

    with prepared(source, output, choices, force=force, quiet=quiet) as ready:
        counters = record_line(
            ready.source, output, ready.options, stop=ready.controls.stop,
            pause=ready.controls.pause, on_status=ready.on_status,
            status_period_s=ready.status_period_s,
        )  # fmt: skip
    return report_counters(counters, output, quiet=quiet, source_damage=ready.options.source_damage)
