"""``recover``: what can be trusted of a damaged session, as a new one."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options


@click.command(epilog="Example:  echogrid recover bad.mcap -o good.mcap")
@click.argument("bad", type=options.FILE)
@options.output_session
@options.force
@options.quiet
def recover(bad: Path, output: Path, force: bool, quiet: bool) -> int:
    """Write what can be trusted of the damaged or unfinished session BAD to a new one.

    Exit code 0: nothing was lost; 1: something was, and is said; 2: nothing can be used.
    """
    from rich.console import Console
    from rich.progress import Progress

    from recorder.session_recover import recover as run
    from recorder.summary import counted

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task(f"recovering {bad.name}", total=None)
        recovery = run(
            bad, output, force=force,
            progress=lambda done, size: bar.update(task, completed=done, total=size),
        )  # fmt: skip
    for reason in recovery.lost:
        click.echo(f"echogrid: lost: {reason}", err=True)
    if not quiet:
        said = "some was lost" if recovery.lost else "nothing was lost"
        files = ""
        if recovery.attachments:
            files = f", {counted(recovery.attachments, 'attachment')}"
        click.echo(f"{output}: {counted(recovery.messages, 'message')}{files}; {said}")
    return 1 if recovery.lost else 0
