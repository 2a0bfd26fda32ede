"""``import``: other people's logs into a session."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options


@click.command("import", epilog="Example:  echogrid import trace21.trc -o t.mcap --format comp4807")
@click.argument("files", nargs=-1, required=True, type=options.FILE)
@options.output_session
@click.option("--format", "form", help="comp4807 is the only one; guessed when left out.")
@click.option(
    "--rate",
    type=float,
    default=20.0,
    show_default=True,
    help="Readings a second of each sensor; such a trace has no clock.",
)
@click.option(
    "--start",
    type=float,
    default=0.0,
    show_default=True,
    help="When it began, in UNIX seconds.",
)
@click.option(
    "--columns",
    help="The sensors in the order of the columns, as in ping,dirrs; default: the header's.",
)
@options.force
@options.quiet
def import_(
    files: tuple[Path, ...], output: Path, form: str | None, rate: float, start: float,
    columns: str | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Turn other people's logs into a session."""
    from recorder.errors import BadInput
    from recorder.importers import IMPORTERS, guess_format
    from recorder.outputs import check_output
    from recorder.session import SessionWriter

    check_output(output, files, force=force)
    if len(files) > 1:
        raise BadInput("one file at a time for this format")
    name = form or guess_format(files[0])
    if name not in IMPORTERS:
        raise BadInput(f"unknown format {name!r} (known: {', '.join(IMPORTERS)})")
    order = None if columns is None else tuple(c.strip() for c in columns.split(","))
    found = IMPORTERS[name](files[0], rate_hz=rate, start_s=start, columns=order)
    metadata = {**found.metadata, "dropped": dict(found.dropped), "file": files[0].name}
    with SessionWriter(output, metadata=metadata, force=force) as session:
        for log_ns, message in found.records:
            session.write(message, log_ns=log_ns)
    if not quiet:
        dropped = ", ".join(f"{why} {n}" for why, n in found.dropped.items()) or "nothing"
        click.echo(f"{output}: {len(found.records)} messages; dropped: {dropped}")
    return 0
