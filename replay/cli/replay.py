"""``replay``: a session said again, so that recorded hardware stands in for hardware."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.cli import options

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import ExitStack

    from recorder.playback import Playback
    from recorder.playback_run import PlayedCounts


@click.command(
    epilog="Example:  echogrid replay run.mcap --to pty --tracker-port 5005, then in another "
    "window:  echogrid record /dev/pts/3 -o again.mcap --tracker tcp://127.0.0.1:5005"
)
@click.argument("session", type=options.FILE)
@click.option(
    "--to",
    "to",
    default="pty",
    show_default=True,
    help="pty makes a serial port; socket or socket://HOST:PORT listens; or a device; none.",
)
@click.option("--speed", type=float, default=1.0, show_default=True, help="0: as fast as it goes.")
@click.option("--fast", is_flag=True, help="The same as --speed 0.")
@click.option("--baud", type=int, help="Speed of a device's line; default: the protocol's.")
@click.option("--tracker-port", type=click.IntRange(0, 65535), help="Poses over TCP; 0: any port.")
@click.option("--poses-in-line", is_flag=True, help="Without raw lines: poses as lines, too.")
@options.quiet
def replay(
    session: Path, to: str, speed: float, fast: bool, baud: int | None, tracker_port: int | None,
    poses_in_line: bool, quiet: bool,
) -> int:  # fmt: skip
    """Say a SESSION again, in time: its serial lines byte by byte, its poses as a tracker.

    It begins when somebody has opened the port (and connected to the tracker, where there is one).
    """
    from recorder.errors import BadInput
    from recorder.playback import check_speed, playback_of
    from recorder.session import read_session

    speed = check_speed(0.0 if fast else speed)
    if to == "none" and tracker_port is None:
        raise BadInput("--to none needs a --tracker-port, or nothing would be said")
    read = read_session(session)
    playback = playback_of(read.records, poses_in_line=poses_in_line)
    for reason in read.damage:
        click.echo(f"echogrid: {session}: {reason}", err=True)
    played = _play(playback, to, speed, baud, tracker_port, quiet=quiet)
    if not quiet:
        click.echo(f"sent {played.pieces} lines, {played.sent_bytes} bytes, {played.poses} poses")
        for topic, count in playback.left_out.items():
            click.echo(f"left out {count} of {topic}: a serial line has no word for it", err=True)
    if played.ended:
        click.echo(f"echogrid: {played.ended}", err=True)
    return 1 if played.ended or read.damage else 0


def _play(
    playback: Playback, to: str, speed: float, baud: int | None, tracker_port: int | None, *,
    quiet: bool,
) -> PlayedCounts:  # fmt: skip
    """Open both ends, say where they are, play with a bar."""
    from contextlib import ExitStack

    from recorder.clock import HostClock
    from recorder.controls import Controls, signals
    from recorder.errors import LinkError
    from recorder.link import DEFAULT_BAUD
    from recorder.playback_ports import open_outlet
    from recorder.playback_run import play
    from recorder.simulator.tracker_server import TrackerServer

    clock, controls = HostClock(), Controls()
    outlet = None if to == "none" else open_outlet(to, clock=clock, baud=baud or DEFAULT_BAUD)
    try:
        tracker = None if tracker_port is None else TrackerServer(tracker_port)
    except OSError as error:
        raise LinkError(f"cannot listen at port {tracker_port}: {error.strerror}") from None
    # also when quiet: without it nobody knows what to open
    if outlet is not None and outlet.name:
        click.echo(outlet.name)
    if tracker is not None:
        click.echo(tracker.url)
    with ExitStack() as stack:
        stack.enter_context(signals(controls))
        on_second = (lambda _: None) if quiet else _bar(stack, playback.duration_s)
        return play(
            playback, outlet, tracker, speed=speed, clock=clock, stop=controls.stop,
            on_second=on_second,
        )  # fmt: skip


def _bar(stack: ExitStack, duration_s: float) -> Callable[[float], None]:
    """A bar over the session's seconds, on standard error."""
    from rich.console import Console
    from rich.progress import Progress

    progress = stack.enter_context(Progress(console=Console(stderr=True), transient=True))
    task = progress.add_task("replay", total=duration_s)
    return lambda passed_s: progress.update(task, completed=passed_s)
