"""``record``: a serial line and a tracker into a session."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.cli import options

if TYPE_CHECKING:
    from recorder.messages import Transform
    from recorder.recording import RecordingStatus
    from recorder.translation import RecordingCounters


@click.command(
    epilog="Example:  echogrid record /dev/ttyUSB0 -o run.mcap --tracker tcp://host:5005"
)
@click.argument("source")
@options.output_session
@click.option("--protocol", default="echogrid", show_default=True, help="What the robot speaks.")
@click.option("--baud", type=int, help="Speed of the line; default: the protocol's.")
@click.option("--tracker", help="Poses as JSON lines: tcp://HOST:PORT or udp://HOST:PORT.")
@click.option("--tracker-px-per-m", type=float, help="The tracker speaks pixels, so many a metre.")
@click.option("--duration", type=click.FloatRange(min=0), help="Seconds; default: until Ctrl-C.")
@click.option("--seed", type=int, default=0, help="sim: of the simulated robot.")
@options.force
@options.quiet
def record(
    source: str,
    output: Path,
    protocol: str,
    baud: int | None,
    tracker: str | None,
    tracker_px_per_m: float | None,
    duration: float | None,
    seed: int,
    force: bool,
    quiet: bool,
) -> int:
    """Record SOURCE, a device, socket://HOST:PORT or sim:ROOM, into a session."""
    from contextlib import ExitStack

    from recorder.errors import OutputExists

    if output.exists() and not force:
        raise OutputExists(output)
    with ExitStack() as stack:
        mounts: tuple[Transform, ...] = ()
        walls = None
        if source.startswith("sim:"):
            from recorder.simulator.room_files import room_to_geojson
            from recorder.simulator.rooms import load_room
            from recorder.simulator.serial_robot import SerialRobot

            room = load_room(source.removeprefix("sim:"))
            robot = stack.enter_context(SerialRobot(room, seed=seed))
            source, tracker, tracker_px_per_m = str(robot.device), robot.tracker_url, None
            mounts, walls = robot.mount_transforms(), room_to_geojson(room)
        counters = record_line(
            source, output, protocol=protocol, baud=baud, tracker=tracker,
            px_per_m=tracker_px_per_m, duration_s=duration, force=force, mounts=mounts,
            walls=walls, quiet=quiet,
        )  # fmt: skip
    if not quiet:
        click.echo(f"{output}: {counters.written} messages, {counters.poses} poses")
    if counters.failure:
        click.echo(f"echogrid: {counters.failure}", err=True)
    lost = counters.bad_checksum + counters.malformed + counters.cut + counters.gaps
    return 1 if counters.failure or lost else 0


def record_line(
    source: str,
    output: Path,
    *,
    protocol: str = "echogrid",
    baud: int | None = None,
    tracker: str | None = None,
    px_per_m: float | None = None,
    duration_s: float | None = None,
    force: bool = False,
    mounts: tuple[Transform, ...] = (),
    walls: bytes | None = None,
    quiet: bool = False,
) -> RecordingCounters:
    """Record a serial line and a tracker; the links are opened before the file is made."""
    from recorder.clock import HostClock
    from recorder.errors import BadInput
    from recorder.link import Link
    from recorder.protocols import PROTOCOLS
    from recorder.recording import record as run
    from recorder.session import WALLS, SessionWriter
    from recorder.simulator.robot import WHEELS
    from recorder.tracker import open_tracker

    if protocol not in PROTOCOLS:
        raise BadInput(f"unknown protocol {protocol!r} (known: {', '.join(PROTOCOLS)})")
    clock, decoder, stop = HostClock(), PROTOCOLS[protocol](), threading.Event()
    link = Link(source, baud=baud or decoder.default_baud, clock=clock)
    link.open()
    poses = None if tracker is None else open_tracker(tracker, clock=clock, px_per_m=px_per_m)
    metadata = {"protocol": protocol, "source": source, "tracker": tracker or ""}
    old = None
    if threading.current_thread() is threading.main_thread():
        old = signal.signal(signal.SIGINT, lambda *_: stop.set())
    try:
        with SessionWriter(output, metadata=metadata, force=force, live=True) as session:
            if walls is not None:
                session.attach(WALLS, "application/geo+json", walls)
            return run(
                link, session, protocol=decoder, clock=clock, stop=stop, tracker=poses,
                duration_s=duration_s, mounts=mounts,
                wheels=WHEELS if walls is not None else None,
                on_status=None if quiet else _show_status,
            )  # fmt: skip
    finally:
        if old is not None:
            signal.signal(signal.SIGINT, old)


def _show_status(status: RecordingStatus) -> None:
    latest = "  ".join(
        f"{name} {reading.range_m:.2f} m {status.rate_hz.get(name, 0):.0f}/s"
        for name, reading in status.latest.items()
    )
    bad = status.counters.bad_checksum + status.counters.malformed
    click.echo(f"{status.elapsed_s:5.0f} s  {latest}  bad lines {bad}", err=True)
