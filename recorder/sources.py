"""Which topics of a session are the poses and the readings: by type, and by choice.

Names mean nothing here: what a topic is, its type says. Where several could be meant and none is
chosen, nothing is guessed: it is refused, with the names and what to pass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from recorder.clock import NS_PER_S
from recorder.columns import (
    Block,
    Columns,
    Ints,
    PoseColumns,
    RangeColumns,
    ScanColumns,
    TransformColumns,
)
from recorder.errors import BadInput
from recorder.frame_links import BASES, FrameLinks, basename
from recorder.messages import Range, Scan
from recorder.names import nearest, printable
from recorder.numbers import distinct, median

TF = "/tf"
OWN_POSES = "/pose"
FULL_TURN_RAD = math.tau * (1.0 + 1e-6)
_NOT_THE_ROBOTS = ("goal", "goal_pose", "initialpose", "clicked_pose", "target_pose")
_FIRST_PLAUSIBLE_NS = 86_400 * 365 * NS_PER_S  # earlier times are not counted from 1970


def shown(name: str) -> str:
    """A name as a message can show it."""
    return printable(name, most=120)


@dataclass(frozen=True, slots=True)
class Asked:
    """What somebody chose: the topic of the poses, and that of a sensor by the sensor's name.

    ``fixed``: the robot stands still, no poses are needed; ``with_tracker``: those of a tracker
    are wanted beside dead reckoning.
    """

    pose_topic: str = ""
    sensor_topics: Mapping[str, str] = field(default_factory=dict)
    fixed: bool = False
    with_tracker: bool = False


@dataclass(slots=True)
class PoseTopic:
    """Poses that came on one topic."""

    topic: str
    by_odometry: bool
    columns: list[PoseColumns] = field(default_factory=list)

    def __str__(self) -> str:
        return f"{self.topic} ({'Odometry' if self.by_odometry else 'poses'})"

    @property
    def gap_s(self) -> float:
        """The usual time between two of them."""
        t_ns = distinct(np.concatenate([each.t_ns for each in self.columns]))
        return median(np.diff(t_ns)) / NS_PER_S if len(t_ns) > 1 else 0.0

    @property
    def notes(self) -> Iterator[str]:
        """Whether they lack their times."""
        unstamped = sum(_unstamped(each) for each in self.columns)
        if unstamped:
            yield _stamp_note(self.topic, unstamped, sum(map(len, self.columns)))


def _unstamped(columns: Columns) -> int:
    """How many messages have a stamp of 0, though they arrived in our time."""
    early = (columns.t_ns < NS_PER_S) & (columns.log_ns > _FIRST_PLAUSIBLE_NS)
    return int(early.sum())


def _stamp_note(topic: str, unstamped: int, count: int) -> str:
    return (
        f"{topic}: header.stamp is 0 in {unstamped} of {count} messages; "
        "--stamps arrival takes the times at which they arrived"
    )


@dataclass(slots=True)
class ReadingSource:
    """Readings of one sensor, as its topic and its frame tell it from others."""

    topic: str
    sensor: str
    frame: str
    first: Range | Scan
    times: list[Ints] = field(default_factory=list)
    count: int = 0
    unstamped: int = 0

    @property
    def key(self) -> tuple[str, str, str]:
        """What the columns of this source have in common."""
        return self.topic, self.sensor, self.frame


class Survey:
    """What there is in a session, gathered block by block."""

    def __init__(self) -> None:
        self.poses: dict[str, PoseTopic] = {}
        self.readings: dict[tuple[str, str, str], ReadingSource] = {}
        self.transforms: list[TransformColumns] = []

    def take(self, block: Block) -> None:
        """Note the sources of a block, and keep its poses and transforms."""
        for each in sorted(block.columns, key=lambda columns: int(columns.row[0])):
            if isinstance(each, PoseColumns):
                known = self.poses.setdefault(each.topic, PoseTopic(each.topic, each.by_odometry))
                known.columns.append(each)
            elif isinstance(each, TransformColumns):
                self.transforms.append(each)
            elif isinstance(each, RangeColumns | ScanColumns):
                self._take_readings(each)

    def _take_readings(self, columns: RangeColumns | ScanColumns) -> None:
        frame = columns.frame or columns.sensor
        key = columns.topic, columns.sensor, frame
        if key not in self.readings:
            first = columns[:1].messages()[0]
            self.readings[key] = ReadingSource(*key, first)
        source = self.readings[key]
        source.times.append(columns.t_ns)
        source.count += len(columns)
        source.unstamped += _unstamped(columns)


@dataclass(frozen=True, slots=True)
class Sources:
    """What a map is made of. ``names``: the sensor of each (topic, sensor, frame) that is used.

    ``pose``: the topic of the poses, :data:`TF`, or "" of a robot that stands still; ``tracker``:
    the topic of those that dead reckoning is laid on. ``base`` and ``world`` are frames.
    """

    pose: str
    by_odometry: bool
    tracker: str
    base: str
    world: str
    names: Mapping[tuple[str, str, str], str]
    links: FrameLinks
    why: str
    left_out: tuple[str, ...]
    notes: tuple[str, ...]

    def lines(self) -> Iterator[str]:
        """What would be used, for people."""
        if self.pose == TF:
            yield f"poses: TF, {self.base} in {self.world} ({self.why})"
        elif self.pose:
            yield f"poses: {self.pose} ({self.why})"
        for (topic, _, frame), name in self.names.items():
            path = self.links.path(frame)
            if self.base in path and frame in self.links:
                where = " < ".join(path[: path.index(self.base) + 1])
            else:
                where = f"{frame}, which no transform mounts"
            yield f"readings: {topic} as sensors.{name} (frame {where})"


def choose(survey: Survey, asked: Asked) -> Sources:
    """Settle it. Raises BadInput, in one line, where it is not clear or not there."""
    links = FrameLinks(survey.transforms)
    poses = {
        topic: each for topic, each in survey.poses.items()
        if topic.rpartition("/")[2] not in _NOT_THE_ROBOTS or topic == asked.pose_topic
    }  # fmt: skip
    left_out = [f"{topic}: a goal, not where the robot is" for topic in survey.poses.keys() - poses]
    chosen = _chosen_topics(survey, asked)
    used = _of_one_robot(list(survey.readings.values()), poses, asked, chosen)
    left_out += [f"{s.topic}: of another robot" for s in survey.readings.values() if s not in used]
    base = _base(links, used)
    world = links.world_of(base) if base else ""
    pose, why = _pose(poses, links, asked, base, world)
    known = poses.get(pose)
    by_odometry = known is not None and known.by_odometry
    tracker = ""
    if asked.with_tracker and by_odometry:
        trackers = [topic for topic, each in poses.items() if not each.by_odometry]
        tracker = OWN_POSES if OWN_POSES in trackers else (trackers or [""])[0]
    left_out += [f"{each}: another source of poses" for topic, each in poses.items()
                 if topic not in (pose, tracker) and not asked.fixed]  # fmt: skip
    names = _named(used, chosen)
    notes = [note for source in used for note in _notes(source, names[source.key], links, base)]
    notes += [] if known is None else known.notes
    return Sources(
        pose, by_odometry, tracker, base, world, names, links, why, tuple(left_out), tuple(notes)
    )


def _chosen_topics(survey: Survey, asked: Asked) -> dict[str, str]:
    """The names of sensors by the topics that were chosen for them."""
    topics = list(dict.fromkeys(source.topic for source in survey.readings.values()))
    names: dict[str, str] = {}
    for name, topic in asked.sensor_topics.items():
        if topic not in topics:
            raise BadInput(
                f"sensors.{name}.topic: no readings on {shown(topic)}; {_there(topic, topics)}"
            )
        if topic in names:
            raise BadInput(f"sensors.{name}.topic: {topic} is that of sensors.{names[topic]}")
        names[topic] = name
    return names


def _there(name: str, names: Sequence[str]) -> str:
    near = nearest(name, names)
    hint = "" if near is None else f" (did you mean {near}?)"
    return f"there are {', '.join(names) or 'none'}{hint}"


def _robot_of(source: ReadingSource, poses: Mapping[str, PoseTopic]) -> str:
    """The namespace of a sensor's frame; else that of its topic where poses have it, too."""
    if "/" in source.frame:
        return source.frame.rpartition("/")[0]
    space = source.topic.strip("/").partition("/")[0]
    spaces = {topic.strip("/").partition("/")[0] for topic in poses if topic.count("/") > 1}
    return space if source.topic.count("/") > 1 and len(spaces) > 1 and space in spaces else ""


def _of_one_robot(
    sources: list[ReadingSource], poses: Mapping[str, PoseTopic], asked: Asked,
    chosen: Mapping[str, str],
) -> list[ReadingSource]:  # fmt: skip
    """The readings of the robot that was chosen. BadInput where there are several, and no choice.

    A choice is the topic of its poses, or those of its sensors.
    """
    robots = {robot: [s for s in sources if _robot_of(s, poses) == robot]
              for robot in dict.fromkeys(_robot_of(s, poses) for s in sources)}  # fmt: skip
    if len(robots) < 2:
        return sources
    if chosen:
        kept = [source for source in sources if source.topic in chosen]
        if len({_robot_of(source, poses) for source in kept}) == 1:
            return kept
    space = asked.pose_topic.strip("/").rpartition("/")[0]
    for robot, found in robots.items():
        if robot and (space == robot or space.startswith(f"{robot}/")):
            return found
    listed = "; ".join(
        f"{robot or 'without a name'}: {', '.join(dict.fromkeys(s.topic for s in found))}"
        for robot, found in robots.items()
    )
    first = sources[0]
    raise BadInput(
        f"readings of several robots ({listed}): choose one, by the topic of its poses with "
        f"--set pose.topic=/NAME/... ({', '.join(map(str, poses.values())) or 'none is there'}) "
        f"or by its sensors with --set sensors.{first.sensor}.topic={first.topic}"
    )


def _base(links: FrameLinks, used: Sequence[ReadingSource]) -> str:
    """The robot's frame. Raises BadInput where the sensors sit on several."""
    bases: dict[str, ReadingSource] = {}
    for source in used:
        if source.frame in links:
            bases.setdefault(links.base_on(links.path(source.frame)), source)
    called_so = [base for base in bases if basename(base) in BASES]
    if called_so:  # what hangs on nothing that is called so sits nowhere on a robot
        bases = {base: bases[base] for base in called_so}
    # base_link hangs on base_footprint, or the other way round: one robot
    bases = {base: source for base, source in bases.items()
             if not any(other in links.path(base)[1:] for other in bases)}  # fmt: skip
    if len(bases) > 1:
        listed = ", ".join(f"{source.topic} on {base}" for base, source in bases.items())
        first = next(iter(bases.values()))
        raise BadInput(
            f"the sensors sit on several robots ({listed}): choose those of one with "
            f"--set sensors.{first.sensor}.topic={first.topic}"
        )
    return next(iter(bases)) if bases else links.any_base()


def _pose(
    poses: Mapping[str, PoseTopic], links: FrameLinks, asked: Asked, base: str, world: str
) -> tuple[str, str]:
    """The source of the poses, and why it is; "" where there is none."""
    wanted = TF if asked.pose_topic == "tf" else asked.pose_topic
    if asked.fixed:
        return "", "it stands still"
    if wanted:
        if wanted not in poses and not (wanted == TF and world):
            there = [*map(str, poses)] + ([TF] if world else [])
            raise BadInput(f"pose.topic: no poses on {shown(wanted)}; {_there(wanted, there)}")
        return wanted, "chosen by pose.topic"
    if OWN_POSES in poses:
        return OWN_POSES, "taken where there is one"
    names = [str(each) for each in poses.values()]
    if len(poses) == 1:
        [only] = poses.values()
        in_a_map = world.rpartition("/")[2] == "map"
        if not (only.by_odometry and in_a_map):
            return only.topic, "the only poses"
    if world and (not poses or len(poses) == 1):
        names.append(f"{TF} ({base} in {world})")
    if len(names) > 1:
        raise BadInput(
            f"several sources of poses: {', '.join(names)}; choose one, as with "
            f"--set pose.topic={next(iter(poses))}"
        )
    return (TF, "no topic has poses") if names else ("", "there are none")


def _named(
    used: Sequence[ReadingSource], chosen: Mapping[str, str]
) -> dict[tuple[str, str, str], str]:
    """The name of each sensor: chosen, or its own, or by what tells it from others of that name."""
    names: dict[tuple[str, str, str], str] = {}
    for source in used:
        alike = [each for each in used if each.sensor == source.sensor]
        on_topic = [each for each in used if each.topic == source.topic]
        by_topic = source.topic.strip("/").replace("/", "_")
        by_frame = source.frame.replace("/", "_")
        if source.topic in chosen:
            name = chosen[source.topic]
            name = name if len(on_topic) == 1 else f"{name}_{by_frame}"
        elif len(alike) == 1:
            name = source.sensor
        elif len({each.topic for each in alike}) == len(alike):
            name = by_topic
        else:
            name = by_frame if len({e.frame for e in alike}) == len(alike) else (
                f"{by_topic}_{by_frame}"
            )  # fmt: skip
        names[source.key] = name
    return names


def _notes(source: ReadingSource, name: str, links: FrameLinks, base: str) -> Iterator[str]:
    """What is taken otherwise than it came, or may surprise."""
    first, topic = source.first, source.topic
    if source.unstamped:
        yield _stamp_note(topic, source.unstamped, source.count)
    if isinstance(first, Range) and first.beam_width_rad > FULL_TURN_RAD:
        if is_degrees(first.beam_width_rad):
            yield (
                f"{topic}: field_of_view is {first.beam_width_rad:g}, more than a full turn in "
                f"radians: taken as degrees (sensors.{name}.beam_width_deg sets it)"
            )
        else:
            yield (
                f"{topic}: field_of_view is {first.beam_width_rad:g}, which no beam is: not used "
                f"(sensors.{name}.beam_width_deg sets it)"
            )
    if 0.0 <= first.max_range_m < first.min_range_m:
        yield (
            f"{topic}: min_range {first.min_range_m:g} m lies above max_range "
            f"{first.max_range_m:g} m: taken the other way round"
        )
    if isinstance(first, Range) and is_fixed_distance(first.min_range_m, first.max_range_m):
        yield (
            f"{topic}: a ranger of one distance (REP 117): -Inf is an obstacle at "
            f"{first.max_range_m:g} m, +Inf none"
        )
    if source.frame not in links:
        return
    path = links.path(source.frame)
    for frame in path[: path.index(base)] if base in path else path:
        link = links.links.get(frame)
        if link is not None and not link.is_level:
            yield (
                f"{topic}: {frame} is tilted by {link.tilt_deg:.0f} degrees in {link.parent}: "
                "mapped as if it were level"
            )
    if links.mirrored(source.frame, base):
        yield f"{topic}: {source.frame} hangs upside down: its left is the robot's right"


def is_degrees(beam_width_rad: float) -> bool:
    """Whether a width of over a full turn can be one in degrees: of less than a full turn."""
    return FULL_TURN_RAD < beam_width_rad < 359.0


def is_fixed_distance(min_range_m: float, max_range_m: float) -> bool:
    """Whether a ranger can only tell near from not near."""
    return 0.0 < min_range_m == max_range_m < math.inf
