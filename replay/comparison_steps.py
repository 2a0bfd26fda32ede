"""Several runs of one session, taken in step: what each makes of the same reading comes together.

A run may leave out readings that another one uses (another range limit, poses that end sooner), or
find more borders. So each artifact is given its place in the session, and at every moment those
runs go on that lie furthest back.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from mapping.artifacts import (
    Artifact,
    Border,
    Classes,
    Finished,
    MergedGrid,
    RawPoints,
    RejectedReading,
    Segment,
    Snapshot,
    Started,
    TempGrid,
    Thresholded,
)
from mapping.beams import Beam
from mapping.fusion import FUSED
from recorder.geometry import SE2, wrap_angle
from recorder.messages import Message, Range, Scan

Moment = dict[str, Artifact]
"""What happens at one step: an artifact of each run that takes part, by the run's name."""
Place = tuple[float, ...]
Reading = tuple[str, int, int]

SAME_PLACE_M = 1e-9  # what is nearer counts as the same pose
_AFTER_ITS_READING, _AT_THE_END = 3.0, math.inf


class SessionOrder:
    """Where each reading stands in the session, by sensor, time and which one of that time."""

    def __init__(self, messages: Iterable[Message]) -> None:
        self._number: dict[Reading, int] = {}
        seen: Counter[tuple[str, int]] = Counter()
        readings = (m for m in messages if isinstance(m, Range | Scan))
        for number, reading in enumerate(readings):
            self._number[_nth(reading.sensor, reading.t_ns, seen)] = number

    def places(self, run: Iterable[Artifact]) -> Iterator[tuple[Place, Artifact]]:
        """The artifacts of a run, each with its place; places never go back."""
        seen: Counter[tuple[str, int]] = Counter()
        reading, layers = -1.0, dict[str, int]()
        place: Place = (-1.0,)
        waiting: list[Artifact] = []
        for artifact in run:
            match artifact:
                case Started():
                    layers = {name: number for number, name in enumerate(artifact.layers)}
                case Beam() | RejectedReading():
                    # one that another run chose otherwise stands where the one before it does
                    beam = artifact if isinstance(artifact, Beam) else artifact.beam
                    name = _nth(beam.sensor, beam.t_ns, seen)
                    reading = float(self._number.get(name, max(reading, 0.0)))
                    place = (reading, 0.0)
                case TempGrid():
                    place = (reading, 1.0)
                case MergedGrid():
                    place = (reading, 2.0)
                case Classes():  # whether this is the end is known once the maps themselves come
                    waiting.append(artifact)
                    continue
                case Snapshot(final=True):
                    reading = _AT_THE_END
            for each in (*waiting, artifact):
                place = max(place, _place_of_result(each, reading, layers) or place)
                yield place, each
            waiting.clear()


def _nth(sensor: str, t_ns: int, seen: Counter[tuple[str, int]]) -> Reading:
    """A reading's name: clocks that stand still give several readings one time."""
    seen[sensor, t_ns] += 1
    return sensor, t_ns, seen[sensor, t_ns]


def _place_of_result(artifact: Artifact, reading: float, layers: Mapping[str, int]) -> Place | None:
    """The stages after a reading, in the order in which the method takes them, layer by layer."""

    def of_layer(stage: float, name: str, *rank: float) -> Place:
        return (*after, stage, float({**layers, FUSED: len(layers)}.get(name, 0)), *rank)

    after = (reading, _AFTER_ITS_READING)
    match artifact:
        case Classes():
            return (*after, 0.0)
        case Snapshot():
            return of_layer(1.0, artifact.layer.name)
        case Thresholded():
            return of_layer(2.0, artifact.layer, 0.0)
        case Border():
            return of_layer(2.0, artifact.layer, 1.0)
        case Segment():
            return of_layer(2.0 if artifact.source == "grid" else 3.0, artifact.layer, 2.0)
        case RawPoints():
            return of_layer(3.0, artifact.layer, 0.0)
        case Finished():
            return (*after, 4.0)
    return None


def in_step(
    runs: Mapping[str, Iterable[Artifact]], messages: Iterable[Message]
) -> Iterator[Moment]:
    """All runs together, moment by moment, in the order of the session.

    ``messages`` are those that the runs were made from. Every artifact of every run comes exactly
    once, and those of one run in their own order.
    """
    order = SessionOrder(messages)
    placed = {name: order.places(run) for name, run in runs.items()}
    heads = {name: head for name, run in placed.items() if (head := next(run, None)) is not None}
    while heads:
        furthest_back = min(place for place, _ in heads.values())
        going = [name for name, (place, _) in heads.items() if place == furthest_back]
        yield {name: heads[name][1] for name in going}
        for name in going:
            head = next(placed[name], None)
            if head is None:
                del heads[name]
            else:
                heads[name] = head


def apart(a: SE2, b: SE2) -> tuple[float, float]:
    """How far two poses are from each other: metres, and radians."""
    turned_rad = abs(wrap_angle(b.heading_rad - a.heading_rad))
    return math.hypot(b.x_m - a.x_m, b.y_m - a.y_m), turned_rad


class Distances:
    """How far the robot of each run is from that of the first, reading by reading."""

    def __init__(self) -> None:
        self.first = ""
        self.largest_m: dict[str, float] = {}
        self.last: dict[str, tuple[float, float]] = {}

    def take(self, moment: Moment) -> None:
        """Look at one moment; those at which no reading begins are passed over."""
        if any(isinstance(artifact, Started) for artifact in moment.values()):
            self.first = next(iter(moment))
        beams = {name: a for name, a in moment.items() if isinstance(a, Beam)}
        if self.first not in beams:
            return
        here = beams.pop(self.first).world_from_base
        for name, beam in beams.items():
            self.last[name] = apart(here, beam.world_from_base)
            self.largest_m[name] = max(self.largest_m.get(name, 0.0), self.last[name][0])

    def sentences(self) -> list[str]:
        """A sentence for each run whose robot is not where the first one has it."""
        return [
            f"{name}: the robot ends {self.last[name][0]:.3f} m and "
            f"{math.degrees(self.last[name][1]):.1f}° from where {self.first} has it "
            f"(at most {largest_m:.3f} m)"
            for name, largest_m in self.largest_m.items()
            if largest_m > SAME_PLACE_M
        ]


def beams_of(moment: Moment) -> list[Beam]:
    """The beams of a moment at which a reading begins; none at any other."""
    return [artifact for artifact in moment.values() if isinstance(artifact, Beam)]
