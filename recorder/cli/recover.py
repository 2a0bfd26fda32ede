"""``recover``: what can be trusted of a damaged session, as a new one."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options
from recorder.cli.progress import progress_bar, warn


@click.command(epilog="Example:  echogrid recover bad.mcap -o good.mcap")
@click.argument("bad", type=options.INPUT)
@options.output_session
@options.force
@options.quiet
def recover(bad: Path, output: Path, force: bool, quiet: bool) -> int:
    """Save what can be trusted of a damaged session.

    BAD is damaged or unfinished; what is sound in it is written to a new session.

    Exit code 0: nothing was lost; 1: something was, and is listed; 2: nothing can be used.
    """
    from recorder.session.recover import recover as run
    from recorder.summary import counted

    with progress_bar(f"recovering {bad.name}", quiet=quiet) as advance:
        recovery = run(bad, output, force=force, progress=advance)
    for reason in recovery.lost:
        warn(f"lost: {reason}")
    if not quiet:
        loss = "some was lost" if recovery.lost else "nothing was lost"
        files = ""
        if recovery.attachments:
            files = f", {counted(recovery.attachments, 'attachment')}"
        click.echo(f"{output}: {counted(recovery.messages, 'message')}{files}; {loss}")
    return 1 if recovery.lost else 0
