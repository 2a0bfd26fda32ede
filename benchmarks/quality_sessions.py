"""The sessions that ``quality`` judges: of our own rooms, and of another simulator."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mapping.scoring.truth import TrueWalls
from recorder.errors import BadInput
from recorder.messages import Message, Pose, Range
from recorder.session import SessionWriter
from recorder.simulator.faults import RunFaults
from recorder.simulator.robot import DEFAULT_START_NS, Robot, simulate
from recorder.simulator.rooms import ROOMS, Room, parse_route
from recorder.truth import read_surfaced_walls

READINGS = 3000  # of each sensor
RATE_HZ = 20.0
THINNED = 6
SENSORS = ("ping", "dirrs")


@dataclass(frozen=True, slots=True)
class Case:
    """A session to judge: ``seen_from`` is the one with its true poses; ``walls`` are known by
    the name of a room, or as a file."""

    group: str
    room: str
    kind: str
    truth: TrueWalls
    walls: str
    session: Path
    seen_from: Path


def simulated(room: str, kinds: Sequence[str], seed: int, folder: Path) -> Iterator[Case]:
    """The kinds of session of a built-in room, made or already in a folder.

    A kind that the room does not allow for is left out: none is far from walls in a corridor.
    """
    of_kind = {}
    for kind in dict.fromkeys(["A", *kinds]):
        of_kind[kind] = folder / f"{room}_{kind}_{seed}.mcap"
        if not of_kind[kind].exists():
            try:
                _write(of_kind[kind], _simulated(room, kind, seed))
            except BadInput:
                del of_kind[kind]
    for kind in filter(of_kind.__contains__, kinds):
        made = _room(room, kind)
        truth = TrueWalls.of(made.walls_m, made.surfaces)
        seen_from = of_kind["A" if kind == "B" else kind]
        yield Case("ours", room, kind, truth, room, of_kind[kind], seen_from)


def _room(name: str, kind: str) -> Room:
    room = ROOMS[name]
    if kind == "D":
        return replace(room, route_m=parse_route("far", room))
    return replace(room, surfaces=("rough",) * len(room.walls_m)) if kind == "E" else room


def _simulated(name: str, kind: str, seed: int) -> list[Message]:
    faults = RunFaults(pose_noise_m=0.01, pose_noise_deg=2.0) if kind == "B" else RunFaults()
    room = _room(name, kind)
    robot = Robot(room, seed=seed)
    pairs = simulate(room, duration_s=READINGS / RATE_HZ, seed=seed, faults=faults)
    messages, count = [], dict.fromkeys(SENSORS, 0)
    for _, message in pairs:
        if isinstance(message, Range):
            count[message.sensor] += 1
            if kind == "C" and count[message.sensor] % THINNED:
                continue
        if isinstance(message, Pose) and kind != "B":
            true = robot.world_from_base(message.t_ns - DEFAULT_START_NS)
            message = replace(message, world_from_base=true)
        messages.append(message)
    return messages


def _write(file: Path, messages: Iterable[Message]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with SessionWriter(file, force=True) as session:
        for message in messages:
            session.write(message, log_ns=message.t_ns)


def others(folder: Path, kinds: Sequence[str]) -> Iterator[Case]:
    """The sessions of another simulator: ROOM_KIND.mcap beside ROOM.geojson."""
    for walls in sorted(folder.glob("*.geojson")):
        for kind in kinds:
            file = folder / f"{walls.stem}_{kind}.mcap"
            if file.exists():
                seen_from = folder / f"{walls.stem}_{'C' if kind == 'C' else 'A'}.mcap"
                truth = TrueWalls.of(*read_surfaced_walls(walls))
                yield Case("other simulator", walls.stem, kind, truth, str(walls), file, seen_from)
