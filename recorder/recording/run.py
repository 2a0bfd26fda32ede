"""One recording from a source to a session file: the links, the protocol and the writer together.

A source is a device, an address, ``sim:ROOM``, a simulated robot behind a real serial line, or
``replay:S.mcap``, a session played back in time.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

from recorder.clock import HostClock
from recorder.errors import BadInput
from recorder.inputs import note_input
from recorder.link import Link
from recorder.messages import RawLine
from recorder.playback import (
    ReplayedLink,
    mounts_of,
    playback_of,
    wheels_of,
)
from recorder.protocols import PROTOCOLS, EchogridProtocol, Protocol, make_protocol
from recorder.recording.loop import SessionSink, record
from recorder.recording.options import RecordingOptions
from recorder.recording.status import RecordingStatus
from recorder.sensors import CATALOGUE, DEFAULT_SENSORS
from recorder.session import PartedWriter, read_session
from recorder.tracker import PoseSource, open_tracker
from recorder.translation import RecordingCounters
from recorder.truth import WALLS, WALLS_TYPE, walls_to_geojson
from recorder.versions import own_version

SIMULATED = "sim:"
REPLAYED = "replay:"


def record_line(
    source: str,
    output: Path,
    options: RecordingOptions,
    *,
    stop: threading.Event,
    pause: threading.Event | None = None,
    on_status: Callable[[RecordingStatus], None] | None = None,
    status_period_s: float = 1.0,
    wrap: Callable[[SessionSink], SessionSink] = lambda session: session,
) -> RecordingCounters:
    """Record a serial line and a tracker until ``stop`` is set, the time is over or a disk fails.

    The links are opened before the file is made. ``wrap`` may put something between the recording
    and its file. Raises BadInput, LinkError and OutputExists.
    """
    clock, protocol = HostClock(), make_protocol(options.protocol, options.columns)
    link: Link | ReplayedLink
    tracker: PoseSource | None = None
    if source.startswith(REPLAYED):
        playback = playback_of(read_session(_replayed_file(source)).records)
        link = ReplayedLink(playback, clock=clock)
        tracker = link.tracker
    else:
        link = Link(source, baud=options.baud or protocol.default_baud, clock=clock)
    link.open()
    try:
        if options.tracker is not None:
            tracker = open_tracker(options.tracker, clock=clock, px_per_m=options.px_per_m)
        with PartedWriter(
            output, options.limits, metadata=_metadata(source, options, protocol),
            force=options.force,
        ) as session:  # fmt: skip
            if options.walls is not None:
                session.attach(WALLS, WALLS_TYPE, options.walls)
            return record(
                link, wrap(session), protocol=protocol, clock=clock, stop=stop, tracker=tracker,
                duration_s=options.duration_s, mounts=options.mounts, wheels=options.wheels,
                sensors=options.sensors, on_status=on_status, status_period_s=status_period_s,
                send=link.write, pause=pause,
            )  # fmt: skip
    finally:
        link.close()


def recorded_input(source: str) -> tuple[Path, ...]:
    """The session that a source plays again, if it does."""
    return (_replayed_file(source),) if source.startswith(REPLAYED) else ()


def _replayed_file(source: str) -> Path:
    return note_input(Path(source.removeprefix(REPLAYED)))


@contextmanager
def opened_source(
    source: str, options: RecordingOptions, *, seed: int = 0, speed: float = 1.0
) -> Iterator[tuple[str, RecordingOptions]]:
    """The line behind ``source`` and what is known of it: for ``sim:ROOM`` a robot is started.

    Raises BadInput for an unknown room, a file that is no session, and for what a simulated robot
    or a session brings itself.
    """
    if source.startswith(REPLAYED):
        yield source, _as_recorded(source, options)
        return
    if not source.startswith(SIMULATED):
        yield source, options
        return
    from recorder.simulator.firmwares import CSV_COLUMNS
    from recorder.simulator.robot import WHEELS
    from recorder.simulator.rooms import load_room
    from recorder.simulator.serial_robot import SerialRobot

    _check_not_given(source, options)
    room = load_room(source.removeprefix(SIMULATED))
    columns = options.columns or (CSV_COLUMNS if options.protocol == "csv" else None)
    with SerialRobot(room, seed=seed, speed=speed, protocol=options.protocol) as robot:
        yield (
            robot.device,
            replace(
                options, columns=columns, tracker=robot.tracker_url, px_per_m=None, wheels=WHEELS,
                mounts=robot.mount_transforms(), walls=walls_to_geojson(room.walls_m, room.name),
                source_name=source,
            ),
        )  # fmt: skip


def _check_not_given(source: str, options: RecordingOptions) -> None:
    """Raises BadInput where the user describes a robot that brings its own description."""
    if options.tracker is not None or options.wheels is not None or options.mounts:
        raise BadInput(f"{source} brings its own tracker, wheels and mounts")


def _as_recorded(source: str, options: RecordingOptions) -> RecordingOptions:
    """The options under which the replayed session was recorded."""
    _check_not_given(source, options)
    file = _replayed_file(source)
    session = read_session(file)
    columns = session.metadata.get("columns")
    raw = any(isinstance(record.message, RawLine) for record in session.records)
    return replace(
        options,
        protocol=_protocol_of(file, session.metadata, options) if raw else EchogridProtocol.name,
        columns=str(columns) if raw and columns else options.columns,
        wheels=wheels_of(session.metadata), mounts=mounts_of(session.records),
        walls=session.attachments.get(WALLS),
        source_damage=tuple(f"{file}: {reason}" for reason in session.damage),
    )  # fmt: skip


def _protocol_of(file: Path, metadata: Mapping[str, object], options: RecordingOptions) -> str:
    """The protocol that a session names, if it is built in; a Python file only from the user.

    What stands in a file of data never says what is run.
    """
    if options.protocol.endswith(".py"):
        return options.protocol
    name = metadata.get("protocol", options.protocol)
    if isinstance(name, str) and name in PROTOCOLS:
        return name
    raise BadInput(
        f"{file}: recorded with the protocol {str(name)[:64]!a}, which is not built in: "
        "give its file with --protocol FILE.py"
    )


def _metadata(source: str, options: RecordingOptions, protocol: Protocol) -> dict[str, object]:
    """The metadata of the session: how it was made."""
    usual = {name: CATALOGUE[name].parameters for name in DEFAULT_SENSORS}
    described: dict[str, object] = {
        "protocol": protocol.name,
        "source": options.source_name or source,
        "baud": options.baud or protocol.default_baud,
        "tracker": options.tracker or "",
        "sensors": {
            name: {
                "beam_width_deg": round(math.degrees(sensor.beam_width_rad), 6),
                "min_range_m": sensor.min_range_m,
                "max_range_m": sensor.max_range_m,
                "radiation": sensor.radiation.name.lower(),
            }
            for name, sensor in {**usual, **options.sensors}.items()
        },
        "versions": {"echogrid": own_version(), "python": sys.version.split()[0]},
    }
    unchecked = f"{protocol.name} has no checksum: a damaged number may pass"
    optional = {
        "unchecked": None if protocol.checked else unchecked,
        "columns": options.columns,
        "tracker_px_per_m": options.px_per_m,
        "wheels": None if options.wheels is None else _known(asdict(options.wheels)),
    }
    return described | _known(optional)


def _known(values: Mapping[str, object]) -> dict[str, object]:
    """What there is to know of them."""
    return {name: value for name, value in values.items() if value is not None}
