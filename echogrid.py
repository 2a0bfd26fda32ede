"""echogrid: see, step by step, how a robot's range readings become a map.

The face of the project: gathers the commands of the three packages, and the public names. Nothing
heavy is imported here; each command imports what it needs when it runs.
"""

from __future__ import annotations

from recorder import startup  # first: it heeds Ctrl-C while the rest is imported

# isort: split
import gc
import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from mapping import cli as mapping_cli
from mapping.kernels.first_run import compiling_reported
from recorder import cli as recorder_cli
from recorder.inputs import remembered_inputs
from recorder.interrupts import STOPPED, code_of, heeded
from recorder.names import printable
from recorder.outputs import NO_ROOM
from replay import cli as replay_cli

if TYPE_CHECKING:
    from replay.mapping_run import RunResult

_LONGEST_LINE = 2000  # a name in a file may have any length
__version__ = "0.1.0"


class _Commands(click.Group):
    """Leaves Ctrl-C to ``main``: click would begin a line of its own for it."""

    def make_context(self, *args: Any, **keywords: Any) -> click.Context:
        """As click does."""
        with _passed_by_click():
            return super().make_context(*args, **keywords)

    def invoke(self, ctx: click.Context) -> Any:
        """As click does."""
        with _passed_by_click():
            return super().invoke(ctx)


class _FirstRun:
    """One line when loops have to be compiled: nobody should wait without knowing for what."""

    def __init__(self, argv: Sequence[str] | None) -> None:
        self._silent = "--quiet" in (sys.argv if argv is None else argv)

    def __call__(self, name: str) -> None:
        """The first of them."""
        if not self._silent:
            self._silent = True
            click.echo(f"echogrid: compiling {name} and what else it needs, some seconds: "
                       "only the first run on a machine does", err=True)  # fmt: skip


@contextmanager
def _rarely_collected() -> Iterator[None]:
    """What is imported stays: to look through it for garbage is a sixth of the start."""
    before = gc.get_threshold()
    gc.set_threshold(startup.SELDOM, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


class _Ended(BaseException):
    """The command was stopped; its argument is the exit code."""


@contextmanager
def _passed_by_click() -> Iterator[None]:
    try:
        yield
    except BaseException as error:
        code = code_of(error)
        if code is None:
            raise
        raise _Ended(code) from None


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Begin with:  echogrid demo",
)
@click.version_option(__version__, prog_name="echogrid")
def cli() -> None:
    """See, step by step, how a robot's range readings become a map."""


for _command in (*recorder_cli.COMMANDS, *mapping_cli.COMMANDS, *replay_cli.COMMANDS):
    cli.add_command(_command)


def show(
    run: str | os.PathLike[str] | RunResult,
    *,
    width: int | str = "auto",
    height: int | str = 720,
    session: str | os.PathLike[str] | None = None,
) -> Any:
    """A recording, or what a run came to, as a notebook widget: see ``replay.rrd.notebook``."""
    from replay.rrd.notebook import show as show_in_notebook

    return show_in_notebook(run, width=width, height=height, session=session)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. 0: done; 1: differs or lost something; 2: bad input, in one line.

    130: stopped by Ctrl-C, 143 by SIGTERM.
    """
    try:
        with (
            heeded(), remembered_inputs(), _rarely_collected(),
            compiling_reported(_FirstRun(argv)), _passed_by_click(),
        ):  # fmt: skip
            return _run(argv)
    except (_Ended, click.Abort) as error:
        click.echo("echogrid: stopped", err=True)
        return int(error.args[0]) if isinstance(error, _Ended) else STOPPED


def _run(argv: Sequence[str] | None) -> int:
    from recorder.errors import EchogridError

    _take_every_name()
    try:
        result = cli.main(
            args=None if argv is None else list(argv), prog_name="echogrid", standalone_mode=False
        )
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return 2
    except click.ClickException as error:
        return _refused(" ".join(error.format_message().split()))
    except EchogridError as error:
        return _refused(str(error))
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except OSError as error:
        if error.filename is not None:  # a file that somebody named, or one beside it
            return _refused(f"{os.fsdecode(error.filename)}: {error.strerror}")
        if error.errno not in NO_ROOM:  # all else is a bug
            raise
        return _refused(str(error.strerror))
    return result if isinstance(result, int) else 0


def _refused(why: str) -> int:
    """One line on standard error; nothing in it that a terminal would obey."""
    click.echo(f"echogrid: {printable(why, most=_LONGEST_LINE)}", err=True)
    return 2


def _take_every_name() -> None:
    """A file's name may hold what standard output cannot write: it is then shown escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


if __name__ == "__main__":
    sys.exit(main())
