"""The commands that need a robot or a session alone: record, simulate, import, info."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from recorder.messages import Transform
    from recorder.recording import RecordingStatus
    from recorder.translation import RecordingCounters

FILE = click.Path(path_type=Path)


_output = click.option("-o", "--output", type=FILE, required=True, help="The session to write.")
_force = click.option("--force", is_flag=True, help="Replace the output where it exists.")
_quiet = click.option("--quiet", is_flag=True, help="Say nothing but errors.")


@click.command(
    epilog="Example:  echogrid record /dev/ttyUSB0 -o run.mcap --tracker tcp://host:5005"
)
@click.argument("source")
@_output
@click.option("--protocol", default="echogrid", show_default=True, help="What the robot speaks.")
@click.option("--baud", type=int, help="Speed of the line; default: the protocol's.")
@click.option("--tracker", help="Poses as JSON lines: tcp://HOST:PORT or udp://HOST:PORT.")
@click.option("--tracker-px-per-m", type=float, help="The tracker speaks pixels, so many a metre.")
@click.option("--duration", type=click.FloatRange(min=0), help="Seconds; default: until Ctrl-C.")
@click.option("--seed", type=int, default=0, help="sim: of the simulated robot.")
@_force
@_quiet
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


@click.command(epilog="Example:  echogrid simulate room -o run.mcap --duration 60 --seed 1")
@click.argument("room")
@_output
@click.option("--duration", type=click.FloatRange(min=0.1), default=60.0, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--noise", type=click.FloatRange(0, 10), default=1.0, show_default=True)
@click.option("--sensors", default="ping,dirrs", show_default=True, help="Also: lidar.")
@click.option("--route", default="default", help='"x,y;x,y;..." in metres.')
@click.option("--head-sweep", type=float, default=0.0, help="Degrees that the head turns.")
@_force
@_quiet
def simulate(
    room: str, output: Path, duration: float, seed: int, noise: float, sensors: str, route: str,
    head_sweep: float, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Drive the simulated robot through ROOM (a name or a GeoJSON file) without the wait."""
    from recorder.session import WALLS, SessionWriter
    from recorder.simulator.robot import simulate as run
    from recorder.simulator.room_files import room_to_geojson
    from recorder.simulator.rooms import load_room, parse_route

    place = load_room(room)
    path = None if route == "default" else parse_route(route, place)
    names = tuple(name.strip() for name in sensors.split(",") if name.strip())
    messages = run(
        place, duration_s=duration, seed=seed, noise=noise, sensors=names, route=path,
        head_sweep_deg=head_sweep,
    )  # fmt: skip
    metadata = {"simulated": place.name, "seed": seed, "noise": noise, "duration_s": duration}
    count = 0
    with SessionWriter(output, metadata=metadata, force=force) as session:
        session.attach(WALLS, "application/geo+json", room_to_geojson(place))
        for log_ns, message in messages:
            session.write(message, log_ns=log_ns)
            count += 1
    if not quiet:
        click.echo(f"{output}: {count} messages")
    return 0


@click.command("import", epilog="Example:  echogrid import trace21.trc -o t.mcap --format comp4807")
@click.argument("files", nargs=-1, required=True, type=FILE)
@_output
@click.option("--format", "form", help="comp4807; guessed when left out.")
@click.option("--rate", type=float, default=20.0, show_default=True, help="comp4807: readings/s.")
@click.option("--start", type=float, default=0.0, show_default=True, help="comp4807: UNIX seconds.")
@click.option("--columns", help="comp4807: sensors in the order of the columns, ping,dirrs say.")
@_force
@_quiet
def import_(
    files: tuple[Path, ...], output: Path, form: str | None, rate: float, start: float,
    columns: str | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Turn other people's logs into a session."""
    from recorder.errors import BadInput, OutputExists
    from recorder.importers import IMPORTERS, guess_format
    from recorder.session import SessionWriter

    if output.exists() and not force:
        raise OutputExists(output)
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
        dropped = ", ".join(f"{n} {why}" for why, n in found.dropped.items()) or "nothing"
        click.echo(f"{output}: {len(found.records)} messages; dropped: {dropped}")
    return 0


@click.command(epilog="Example:  echogrid info run.mcap")
@click.argument("file", type=FILE)
def info(file: Path) -> int:
    """What is in a session, and what is wrong with it."""
    from recorder.session import read_session
    from recorder.summary import summary_lines

    session = read_session(file)
    for line in summary_lines(session):
        click.echo(line)
    return 1 if session.damage else 0


COMMANDS = (record, simulate, import_, info)
