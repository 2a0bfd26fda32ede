"""``replay``: a session sent again, so that recorded hardware stands in for hardware."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.cli import options
from recorder.cli.progress import progress_bar

if TYPE_CHECKING:
    from recorder.playback import Playback
    from recorder.playback.run import PlayedCounts


@click.command(
    epilog="Example:  echogrid replay run.mcap --to pty --tracker-port 5005, then in another "
    "window:  echogrid record /dev/pts/3 -o again.mcap --tracker tcp://127.0.0.1:5005"
)
@click.argument("session", type=options.INPUT)
@click.option(
    "--to",
    "to",
    default="pty",
    show_default=True,
    help="pty makes a serial port; socket or socket://HOST:PORT listens; or a device; none.",
)
@click.option(
    "--speed",
    type=float,
    default=1.0,
    show_default=True,
    help="How many times as fast as it was; 0: as fast as it goes.",
)
@click.option("--fast", is_flag=True, help="The same as --speed 0.")
@click.option(
    "--baud", type=int, help="Speed of a device's line in bits a second; default: 115200."
)
@click.option(
    "--tracker-port",
    type=click.IntRange(0, 65535),
    help="Send the poses over TCP, from this port; 0: any free one.",
)
@click.option(
    "--poses-in-line",
    is_flag=True,
    help="Send the poses as lines, too (for sessions without raw lines).",
)
@options.quiet
def replay(
    session: Path, to: str, speed: float, fast: bool, baud: int | None, tracker_port: int | None,
    poses_in_line: bool, quiet: bool,
) -> int:  # fmt: skip
    """Send a SESSION again, in time, as its robot did.

    Its serial lines come byte by byte, its poses as from a tracker.

    It begins when somebody has opened the port (and connected to the tracker, where there is one).
    """
    from recorder.errors import BadInput
    from recorder.interrupts import STOPPED
    from recorder.playback import check_speed, playback_of
    from recorder.playback.command import record_command
    from recorder.session import read_session

    speed = check_speed(0.0 if fast else speed)
    if to == "none" and tracker_port is None:
        raise BadInput("--to none needs a --tracker-port, or nothing would be sent")
    read = read_session(session)
    playback = playback_of(read.records, poses_in_line=poses_in_line)
    for reason in read.damage:
        click.echo(f"echogrid: {session}: {reason}", err=True)
    stopped = threading.Event()
    played = _play(
        playback, to, speed, baud, tracker_port, quiet=quiet, stopped=stopped,
        command=functools.partial(record_command, read),
    )  # fmt: skip
    if not quiet:
        click.echo(f"sent {played.pieces} lines, {played.sent_bytes} bytes, {played.poses} poses")
        for topic, count in playback.left_out.items():
            click.echo(
                f"left out {count} of {topic}: a serial line has no message for it", err=True
            )
    if played.ended:
        click.echo(f"echogrid: {played.ended}", err=True)
    if stopped.is_set():
        return STOPPED
    return 1 if played.ended or read.damage else 0


def _play(
    playback: Playback, to: str, speed: float, baud: int | None, tracker_port: int | None, *,
    quiet: bool, stopped: threading.Event, command: Callable[[str, str | None], str],
) -> PlayedCounts:  # fmt: skip
    """Open both ends, print where they are and how they are recorded, play with a bar."""
    from recorder.clock import HostClock
    from recorder.errors import LinkError
    from recorder.link import DEFAULT_BAUD
    from recorder.playback.command import poses_unsent
    from recorder.playback.outlets import open_outlet
    from recorder.playback.run import play
    from recorder.recording.controls import Controls, signals
    from recorder.simulator.tracker_server import TrackerServer

    clock, controls = HostClock(), Controls(stop=stopped)
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
    if not quiet and outlet is not None and outlet.name:
        tracker_url = None if tracker is None else tracker.url
        click.echo(f"record it with:  {command(outlet.name, tracker_url)}")
        if poses_unsent(playback, tracker_url):
            click.echo("its poses are not sent: --tracker-port 0 sends them")
    with signals(controls), progress_bar("replay", quiet=quiet) as advance:
        return play(
            playback, outlet, tracker, speed=speed, clock=clock, stop=controls.stop,
            on_second=functools.partial(advance, total=playback.duration_s),
        )  # fmt: skip
