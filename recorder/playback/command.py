"""The command line that records a session which is played again."""

from __future__ import annotations

import math
import shlex

from recorder.errors import BadInput
from recorder.messages import Pose, RawLine
from recorder.names import FRAME_NAME
from recorder.playback.transmissions import Playback, mounts_of, wheels_of
from recorder.protocols import PROTOCOLS, CsvProtocol, EchogridProtocol, parse_columns
from recorder.session import Session

_RADIUS_M = 0.05  # of a wheel: any will do, as counts a turn go with it


def record_command(session: Session, port: str, tracker_url: str | None) -> str:
    """``echogrid record PORT ...`` with all that the line itself does not carry.

    What the session names is taken only where the command would take it.
    """
    words = ["echogrid", "record", port, "-o", "again.mcap"]
    if tracker_url is not None:
        words += ["--tracker", tracker_url]
    if any(isinstance(record.message, RawLine) for record in session.records):
        words += _as_recorded(session)
    for mount in mounts_of(session.records):
        if FRAME_NAME.fullmatch(mount.child) and FRAME_NAME.fullmatch(mount.parent):
            at = mount.parent_from_child
            name = mount.child if mount.parent == "base_link" else f"{mount.child}@{mount.parent}"
            place = f"{at.x_m:.6g},{at.y_m:.6g},{math.degrees(at.heading_rad):.6g}"
            words += ["--mount", f"{name}={place}"]
    return shlex.join(words)


def poses_unsent(playback: Playback, tracker_url: str | None) -> bool:
    """Whether there are poses that nobody is sent."""
    return tracker_url is None and any(
        isinstance(sent.payload, Pose) for sent in playback.transmissions
    )


def _as_recorded(session: Session) -> list[str]:
    """The options of the protocol and of the wheels under which raw lines were recorded."""
    name, columns = session.metadata.get("protocol"), session.metadata.get("columns")
    words: list[str] = []
    if name not in PROTOCOLS:
        words += ["--protocol", "FILE.py"]
    elif name != EchogridProtocol.name:
        words += ["--protocol", str(name)]
    if name == CsvProtocol.name and isinstance(columns, str):
        try:
            parse_columns(columns)
            words += ["--columns", columns]
        except BadInput:
            pass
    try:
        wheels = wheels_of(session.metadata)
    except BadInput:
        wheels = None
    if wheels is not None:
        counts = wheels.ticks_per_m * 2.0 * math.pi * _RADIUS_M
        numbers = [f"{_RADIUS_M:g}", f"{wheels.track_m:.9g}", f"{counts:.9g}"]
        if wheels.counter_range is not None:
            numbers.append(str(wheels.counter_range))
        words += ["--wheels", ",".join(numbers)]
    return words
