"""What of a session is mapped, as a session of our own would have it: poses, mounts, readings.

Other people's recordings differ in names, frames and habits. What is used is settled by
:mod:`recorder.sources`; here it is put into the form that the placer takes: one track of poses,
the robot's frame called ``base_link``, each sensor's frame called as the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from mapping.config import MappingConfig, Sensor
from mapping.motion_gathering import MotionGatherer
from mapping.tracks import wrapped
from recorder.clock import NS_PER_S
from recorder.columns import (
    Block,
    Columns,
    Floats,
    PoseColumns,
    RangeColumns,
    ScanColumns,
    TransformColumns,
    blocks_of,
)
from recorder.frame_links import FrameLinks, Link
from recorder.messages import BASE_FRAME, HEAD_FRAME, Message, Record
from recorder.numbers import distinct, median
from recorder.sources import (
    FULL_TURN_RAD,
    TF,
    Asked,
    Sources,
    Survey,
    choose,
    is_fixed_distance,
)

_ROBOT = "robot"
_HAIR = 1e-3  # so much farther than its one distance a ranger is taken to see, as a share


def asked_of(config: MappingConfig) -> Asked:
    """What a configuration chooses."""
    topics = {
        name: topic for name, section in config.sensors.items()
        if (topic := getattr(section, "topic", None)) is not None
    }  # fmt: skip
    pose = config.pose
    return Asked(pose.topic, topics, pose.fixed is not None, pose.odom_start == "tracker")


def timed(block: Block, config: MappingConfig) -> Block:
    """A block by the clock that the configuration goes by."""
    if config.pose.stamps == "header":
        return block
    return Block(tuple(replace(each, t_ns=each.log_ns) for each in block.columns))


def without_drift(
    poses: Sequence[PoseColumns], drift_per_min: tuple[float, float, float]
) -> Sequence[PoseColumns]:
    """Poses from which is taken what they drift a minute (x, y in metres, degrees) since the
    first one."""
    times = [int(each.t_ns.min()) for each in poses if len(each)]
    if not any(drift_per_min) or not times:
        return poses
    x_m, y_m, heading_deg = drift_per_min
    out = []
    for each in poses:
        minutes = (each.t_ns - min(times)) / (60.0 * NS_PER_S)
        out.append(replace(
            each, x_m=each.x_m - x_m * minutes, y_m=each.y_m - y_m * minutes,
            heading_rad=wrapped(each.heading_rad - math.radians(heading_deg) * minutes),
        ))  # fmt: skip
    return out


class Selection:
    """The choice for one session. Raises BadInput where it is not clear or not there."""

    def __init__(self, survey: Survey, config: MappingConfig) -> None:
        self.sources: Sources = choose(survey, asked_of(config))
        topic = "/odom" if self.sources.by_odometry else ""
        self.config = config.model_copy(update={"pose": config.pose.model_copy(
            update={"topic": topic})})  # fmt: skip
        self._survey, self._offset_ns = survey, round(config.pose.offset_s * NS_PER_S)
        self._gap_ns = round(config.pose.max_gap_s * NS_PER_S)
        self._turns_head = config.pose.rides_on == "head" or any(
            getattr(section, "mount", None) is not None for section in config.sensors.values()
        )
        self._mirrored = {
            key: self.sources.links.mirrored(key[2], self.sources.base)
            for key in self.sources.names
        }
        self.notes = (*self.sources.notes, *self._notes())

    def motion(self) -> Block:
        """The poses in force, and the mounts and turning frames below the robot's."""
        kept = {self.sources.pose, self.sources.tracker} - {"", TF}
        poses = [
            replace(each, t_ns=each.t_ns + self._offset_ns)
            for topic in kept for each in self._survey.poses[topic].columns
        ]  # fmt: skip
        if self.sources.pose == TF:
            poses.append(self._poses_by_tf())
        corrected: list[Columns] = [*without_drift(poses, self.config.pose.drift_per_min)]
        if self.sources.pose and not self.sources.by_odometry:
            corrected += self._odometry_beside()
        return Block((*corrected, *self._below_base()))

    def _odometry_beside(self) -> Sequence[Columns]:
        """Dead reckoning that can smooth the poses, by its own clock; of several robots none."""
        found = [each.columns for each in self._survey.poses.values() if each.by_odometry]
        return found[0] if len(found) == 1 else ()

    def readings(self, block: Block) -> Block:
        """The readings of a block that are used, by their sensors' names."""
        return Block(tuple(self._used(block)))

    def _used(self, block: Block) -> Iterator[Columns]:
        for each in block.columns:
            if isinstance(each, RangeColumns | ScanColumns):
                key = each.topic, each.sensor, each.frame or each.sensor
                if key in self.sources.names:
                    mended = _as_meant(each, mirrored=self._mirrored[key])
                    yield replace(mended, sensor=self.sources.names[key], frame="")

    def _poses_by_tf(self) -> PoseColumns:
        """Where the transforms have the robot, at each reading's own time."""
        links, base, world = self.sources.links, self.sources.base, self.sources.world
        names = {world: BASE_FRAME, base: _ROBOT}  # the tree stood on its head: world to robot
        path = links.path(base)
        above = (links.links[frame] for frame in path[: path.index(world)])
        columns = (_canonical(link, names, moves=link.moves, flipped=False) for link in above)
        found = MotionGatherer(self._gap_ns)
        found.take(Block(tuple(chain.from_iterable(columns))))
        used = (self._survey.readings[key] for key in self.sources.names)
        t_ns = distinct(np.concatenate([t for source in used for t in source.times]))
        motions, known = found.frames().base_from(_ROBOT, t_ns - self._offset_ns)
        motions, t_ns = motions[known], t_ns[known]
        row = np.arange(len(t_ns))
        at = (motions.x_m, motions.y_m, motions.heading_rad)
        return PoseColumns(TF, row, t_ns, t_ns, *at, by_odometry=False)

    def _below_base(self) -> Iterator[TransformColumns]:
        links, base = self.sources.links, self.sources.base
        above = links.path(base)
        names = self._frame_names()
        for child, link in links.links.items():
            if child in above:
                continue
            moves = link.moves or (
                child == HEAD_FRAME and self._turns_head and not link.columns[-1].static
            )
            yield from _canonical(
                link, names, moves=moves, flipped=links.mirrored(link.parent, base)
            )
        for key, sensor in self.sources.names.items():
            frame = key[2]
            if frame in links and names.get(frame, frame) != sensor:  # several sensors share it
                zero = np.zeros(1)
                at = np.zeros(1, np.int64)
                yield TransformColumns(
                    TF, at, at, at, zero, zero, zero, names.get(frame, frame), sensor, True,
                    np.ones(1),
                )  # fmt: skip

    def _frame_names(self) -> dict[str, str]:
        """What the placer calls the frames: the robot's and those of one sensor each."""
        frames = [key[2] for key in self.sources.names]
        names = {
            key[2]: sensor for key, sensor in self.sources.names.items()
            if frames.count(key[2]) == 1
        }  # fmt: skip
        names[self.sources.base] = BASE_FRAME
        taken = {BASE_FRAME, *self.sources.names.values()}
        for frame in self.sources.links.names:
            if frame in taken and frame not in names:
                names[frame] = f"{frame}'"
        return names

    def _notes(self) -> Iterator[str]:
        if self.sources.pose in self._survey.poses:
            gap_s = self._survey.poses[self.sources.pose].gap_s
        elif self.sources.pose == TF:
            path = self.sources.links.path(self.sources.base)
            gap_s = max((_gap_s(self.sources.links, frame) for frame in path), default=0.0)
        else:
            return
        most_s = self._gap_ns / NS_PER_S
        if gap_s > most_s:
            yield (
                f"the poses of {self.sources.pose} come {gap_s:.2g} s apart, and between poses "
                f"further apart than pose.max_gap_s ({most_s:g}) nothing is mapped: "
                f"--set pose.max_gap_s={1.5 * gap_s:.2g}"
            )

    def mount_notes(self, sensors: Iterable[Sensor]) -> Iterator[str]:
        """Which sensors sit where it is assumed, though there are transforms."""
        frames = {sensor: key[2] for key, sensor in self.sources.names.items()}
        for sensor in sensors:
            section = self.config.sensors.get(sensor.name) or self.config.sensors.get("*")
            if sensor.mount is None or getattr(section, "mount", None) is not None:
                continue
            x_m, y_m = sensor.mount.x_m, sensor.mount.y_m
            at = f"x {x_m:g} m, y {y_m:g} m, {math.degrees(sensor.mount.heading_rad):g} degrees"
            known = ", ".join(self.sources.links.names)
            frame = frames.get(sensor.name, sensor.name)
            yield (
                f"{sensor.name}: no transform has its frame {frame}"
                f"{f' (there are {known})' if known else ''}: it is assumed to sit at {at}; "
                f"sensors.{sensor.name}.mount sets it"
            )


def selected(records: Iterable[Record], config: MappingConfig) -> tuple[list[Message], Selection]:
    """The messages that are mapped, in the form of a session of our own."""
    blocks = [timed(block, config) for block in blocks_of(records)]
    survey = Survey()
    for block in blocks:
        survey.take(block)
    selection = Selection(survey, config)
    parts = [selection.motion(), *map(selection.readings, blocks)]
    return [record.message for part in parts for record in part.records()], selection


def _canonical(
    link: Link, names: dict[str, str], *, moves: bool, flipped: bool
) -> Iterator[TransformColumns]:
    """The transforms of a frame by other names; those of one that does not move, once.

    ``flipped``: its parent hangs upside down, so that left is right.
    """
    sent = [each for each in link.columns if each.static is not moves]
    columns: Sequence[TransformColumns] = sent or link.columns
    if not moves:
        columns = [max(columns, key=lambda each: int(each.row[-1]))[-1:]]
    for each in columns:
        parent, child = (names.get(frame, frame) for frame in (link.parent, link.child))
        turned = replace(each, parent=parent, child=child, static=not moves)
        if flipped:
            turned = replace(turned, y_m=-each.y_m, heading_rad=-each.heading_rad)
        yield turned


def _as_meant(columns: RangeColumns | ScanColumns, *, mirrored: bool) -> RangeColumns | ScanColumns:
    """Readings whose messages state it otherwise than the standard has it."""
    low_m, high_m = columns.min_range_m, columns.max_range_m
    swapped = (high_m < low_m) & (high_m >= 0.0)
    if swapped.any():
        low_m, high_m = np.where(swapped, high_m, low_m), np.where(swapped, low_m, high_m)
        columns = replace(columns, min_range_m=low_m, max_range_m=high_m)
    if isinstance(columns, ScanColumns):
        if mirrored:
            first, step = -columns.angle_min_rad, -columns.angle_increment_rad
            columns = replace(columns, angle_min_rad=first, angle_increment_rad=step)
        return columns
    if is_fixed_distance(float(low_m[0]), float(high_m[0])):
        near = columns.range_m == -np.inf
        columns = replace(columns, range_m=np.where(near, low_m, columns.range_m),
                          max_range_m=high_m * (1.0 + _HAIR))  # fmt: skip
    if (columns.beam_width_rad > FULL_TURN_RAD).any():
        columns = replace(columns, beam_width_rad=_widths_rad(columns.beam_width_rad))
    return columns


def _widths_rad(given: Floats) -> Floats:
    """Widths of over a full turn: in degrees, or (NaN) none."""
    degrees = np.where(given < 359.0, np.radians(given), np.nan)
    out: Floats = np.where(given > FULL_TURN_RAD, degrees, given)
    return out


def _gap_s(links: FrameLinks, frame: str) -> float:
    link = links.links.get(frame)
    if link is None or not link.moves:
        return 0.0
    t_ns = distinct(np.concatenate([each.t_ns for each in link.columns]))
    return median(np.diff(t_ns)) / NS_PER_S if len(t_ns) > 1 else 0.0
