"""``live``: record, map and show at once."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from mapping.cli import config_options
from recorder.cli import options
from recorder.cli.recording import line_options, prepared, report_counters
from replay.cli.map_report import map_and_report


@click.command(epilog="Example:  echogrid live sim:room --web")
@click.argument("source")
@click.option(
    "-o",
    "--output",
    type=options.FILE,
    help="Folder to write to; default ./echogrid-live, then ./echogrid-live-2 and so on.",
)
@click.option("--web", is_flag=True, help="Show it in the browser, on 127.0.0.1.")
@click.option(
    "--viewer",
    metavar="URL",
    help="Show it in a viewer that is open already, as in rerun+http://127.0.0.1:9876/proxy.",
)
@click.option("--no-map", is_flag=True, help="Do not map the finished session into an .rrd.")
@config_options
@line_options
@options.force
@options.quiet
def live(
    source: str, output: Path | None, web: bool, viewer: str | None, no_map: bool,
    configs: tuple[Path, ...], settings: tuple[str, ...], preset: str | None, force: bool,
    quiet: bool, **choices: Any,
) -> int:  # fmt: skip
    """Record SOURCE, and watch its map grow.

    SOURCE is what `record` takes.

    The map is made in a process of its own. When it lags or ends, or the viewer is closed, the
    recording goes on. At the end the whole session is mapped once more, step by step, into an .rrd.
    """
    from mapping.config import load_config
    from replay.demo import new_folder
    from replay.live.run import record_and_show

    config = load_config(configs, settings, preset)
    with _viewer(web, viewer, quiet=quiet) as url:
        folder = new_folder(output, "echogrid-live", force=force)
        session = folder / "live.mcap"
        with prepared(source, session, choices, force=force, quiet=quiet) as ready:
            result = record_and_show(
                ready.source, session, ready.options, config, viewer_url=url,
                stop=ready.controls.stop, pause=ready.controls.pause,
                on_status=ready.on_status, status_period_s=ready.status_period_s,
            )  # fmt: skip
        status = report_counters(
            result.counters, session, quiet=quiet, source_damage=ready.options.source_damage
        )
        if result.end.failure:
            click.echo(f"echogrid: the live map ended: {result.end.failure}", err=True)
        if result.end.not_followed and not quiet:
            click.echo(
                f"{result.end.not_followed} messages are in the session, not in the live map"
            )
        if not no_map:
            status |= map_and_report(
                session, config, folder / "live.rrd", None, force=True, quiet=quiet
            )
        elif result.end.report and not quiet:
            click.echo(result.end.report)
        if web and sys.stdin is not None and sys.stdin.isatty():
            click.echo("the live map stays in the browser until Enter or Ctrl-C")
            with contextlib.suppress(KeyboardInterrupt, EOFError):
                sys.stdin.readline()
    return status


@contextmanager
def _viewer(web: bool, url: str | None, *, quiet: bool) -> Iterator[str]:
    """The address of a viewer that waits for the map."""
    if url is not None:
        yield url
        return
    from replay.viewer import waiting_viewer

    def announce(line: str) -> None:
        if not quiet:
            click.echo(line)

    with waiting_viewer(web=web, announce=announce) as address:
        yield address
