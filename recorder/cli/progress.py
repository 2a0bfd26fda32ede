"""What commands write to standard error: warnings, and a bar for work that takes its time."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import click


class Advance(Protocol):
    """Called now and then with how much is done, and of how much, once that is known.

    ``doing`` is what holds it up meanwhile.
    """

    def __call__(self, done: float, total: float | None = None, doing: str = "") -> None: ...


def warn(text: str) -> None:
    """A line on standard error, after the name of the program."""
    click.echo(f"echogrid: {text}", err=True)


@contextmanager
def progress_bar(title: str, *, quiet: bool) -> Iterator[Advance]:
    """A bar for as long as the context; none when ``quiet`` or where no terminal would show it."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, total=None, doing="": None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)

        def advance(done: float, total: float | None = None, doing: str = "") -> None:
            described = f"{title}: {doing}" if doing else title
            bar.update(task, completed=done, total=total, description=described)

        yield advance
