"""Sessions to be played back."""

from __future__ import annotations

from pathlib import Path

from recorder.messages import Message, Record, topic_of
from recorder.session import SessionWriter
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room
from recorder.truth import WALLS, WALLS_TYPE, walls_to_geojson


def records_of(messages: list[tuple[int, Message]]) -> list[Record]:
    return [Record(topic_of(message), log_ns, message) for log_ns, message in messages]


def simulated(duration_s: float = 6.0) -> list[Record]:
    return records_of(list(simulate(load_room("room"), duration_s=duration_s, seed=4)))


def session_file(file: Path, duration_s: float) -> list[Record]:
    records = simulated(duration_s)
    with SessionWriter(file, metadata={"wheels": {"ticks_per_m": 2.0, "track_m": 0.1}}) as session:
        room = load_room("room")
        session.attach(WALLS, WALLS_TYPE, walls_to_geojson(room.walls_m, room.name))
        for each in records:
            session.write(each.message, log_ns=each.log_ns)
    return records
