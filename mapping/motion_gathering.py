"""The poses, mounts and turning frames of a session, gathered from its columns: whole, or live."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain

import numpy as np

from mapping.config import MappingConfig
from mapping.tracks import Frames, Motions, MotionTrack, is_sane
from recorder.clock import NS_PER_S
from recorder.columns import Block, Ints, MotionColumns, PoseColumns, TransformColumns
from recorder.errors import BadInput
from recorder.geometry import IDENTITY, SE2
from recorder.messages import Transform

WARM_UP_S = 2.0  # until then it is not known which sensors and which poses a live session has
_KEPT_NS = 60 * NS_PER_S  # of a live track, behind the newest message
_ALWAYS_NS = (1 << 62) - 1


def in_order(columns: Sequence[MotionColumns]) -> tuple[Ints, Motions, Ints]:
    """Times, motions and rows of several columns in the order of the session."""
    t_ns = np.concatenate([each.t_ns for each in columns])
    row = np.concatenate([each.row for each in columns])
    motions = Motions.joined([Motions.of(each) for each in columns])
    if len(columns) > 1:
        order = np.argsort(row, kind="stable")
        return t_ns[order], motions[order], row[order]
    return t_ns, motions, row


class MotionGatherer:
    """Collects poses and transforms: the tracks of a session as far as it has come."""

    def __init__(self, max_gap_ns: int, heading_offset_rad: float = 0.0) -> None:
        """``heading_offset_rad`` is added to the headings of poses."""
        self.max_gap_ns = max_gap_ns
        self._turn = SE2(0.0, 0.0, heading_offset_rad)
        self.static: dict[str, Transform] = {}
        self.parents: dict[str, str] = {}
        self.moving: dict[str, list[tuple[Ints, Motions]]] = {}
        self.poses: dict[bool, list[tuple[Ints, Motions]]] = {False: [], True: []}
        self.bad_poses = {False: 0, True: 0}  # by whether they are dead reckoning

    def take(self, block: Block) -> None:
        """Note the poses, mounts and turning frames of a block."""
        for by_odometry in (False, True):
            columns = [c for c in block.of(PoseColumns) if c.by_odometry is by_odometry]
            if columns:
                t_ns, motions, _ = in_order(columns)
                sane = motions.sane()
                self.bad_poses[by_odometry] += int((~sane).sum())
                motions = motions[sane]
                if self._turn != IDENTITY:
                    motions = motions @ self._turn
                self.poses[by_odometry].append((t_ns[sane], motions))
        transforms = block.of(TransformColumns)
        for child in dict.fromkeys(each.child for each in transforms):
            of_child = [each for each in transforms if each.child == child]
            self._take_static([each for each in of_child if each.static])
            self._take_moving(child, [each for each in of_child if not each.static])

    def _take_static(self, columns: Sequence[TransformColumns]) -> None:
        """The last one of a frame counts."""
        found = [zip(each.row.tolist(), each.messages(), strict=True) for each in columns]
        for _, mount in sorted(chain.from_iterable(found), key=lambda pair: pair[0]):
            if is_sane(mount.parent_from_child):
                self.static[mount.child] = mount

    def _take_moving(self, child: str, columns: Sequence[TransformColumns]) -> None:
        sane = [kept for each in columns if len(kept := each[Motions.of(each).sane()])]
        if not sane:
            return
        t_ns, motions, _ = in_order(sane)
        self.moving.setdefault(child, []).append((t_ns, motions))
        self.parents[child] = max(sane, key=lambda each: int(each.row[-1])).parent

    def track(self, *, by_odometry: bool) -> MotionTrack:
        """All poses so far, sorted by their times."""
        return MotionTrack.empty(self.max_gap_ns).with_more(self.poses[by_odometry])

    def frames(self) -> Frames:
        """All mounts and turning frames so far."""
        empty = MotionTrack.empty(self.max_gap_ns)
        moving = {
            child: (self.parents[child], empty.with_more(parts))
            for child, parts in self.moving.items()
        }
        return Frames(self.static, moving)


class LiveMotion:
    """Poses and frames of a session that goes on."""

    def __init__(self, config: MappingConfig) -> None:
        if config.pose.odom_start == "tracker":
            raise BadInput('pose.odom_start = "tracker" needs a finished session, not a live one')
        if any(config.pose.drift_per_min):
            raise BadInput("pose.drift_per_min needs a finished session, not a live one")
        if config.pose.smooth:
            raise BadInput("pose.smooth needs a finished session, not a live one: it looks ahead")
        self._config = config
        self._gap_ns = round(config.pose.max_gap_s * NS_PER_S)
        self._tracks = {
            False: MotionTrack.empty(self._gap_ns),
            True: MotionTrack.empty(self._gap_ns),
        }
        self._first_ns: int | None = None
        self.frames = Frames({}, {})
        self.newest_ns = 0
        self.bad_poses = 0

    def take(self, block: Block) -> None:
        """Sort in the poses and frames of a block."""
        if not block.columns:
            return
        if self._first_ns is None:
            first = min(block.columns, key=lambda each: int(each.row[0]))
            self._first_ns = int(first.t_ns[0])
        newest_ns = max(int(each.t_ns.max()) for each in block.columns)
        self.newest_ns = max(self.newest_ns, newest_ns)
        news = MotionGatherer(self._gap_ns, math.radians(self._config.pose.heading_offset_deg))
        news.take(block)
        self.bad_poses += sum(news.bad_poses.values())
        for by_odometry, parts in news.poses.items():
            self._tracks[by_odometry] = self._tracks[by_odometry].with_more(parts)
        moving = dict(self.frames.moving)
        for child, parts in news.moving.items():
            _, track = moving.get(child, ("", MotionTrack.empty(self._gap_ns)))
            moving[child] = news.parents[child], track.with_more(parts)
        self.frames = Frames({**self.frames.static, **news.static}, moving)

    @property
    def is_warm(self) -> bool:
        """Whether enough has come to know which sensors and poses there are."""
        return (
            self._first_ns is not None and self.newest_ns - self._first_ns >= WARM_UP_S * NS_PER_S
        )

    @property
    def track(self) -> MotionTrack:
        """The poses in force: those of a finished session with the same messages."""
        if self._config.pose.fixed is not None:
            return fixed_track(self._config, -_ALWAYS_NS, _ALWAYS_NS)
        by_odometry = self._config.pose.topic == "/odom" or not len(self._tracks[False].t_ns)
        return self._tracks[by_odometry]

    def ripe(self, t_ns: Ints, track: MotionTrack) -> int:
        """For how many of the first waiting readings waiting on could change nothing."""
        reach_ns = [each.t_ns[-1] if len(each.t_ns) else -_ALWAYS_NS for each in
                    (track, *(moving for _, moving in self.frames.moving.values()))]  # fmt: skip
        ripe = (self.newest_ns - t_ns > self._gap_ns) | (t_ns <= min(reach_ns))
        return len(ripe) if ripe.all() else int(np.argmin(ripe))

    def forget(self, oldest_ns: int) -> None:
        """Let go of what no reading will ask for, now and then, so that it costs nothing."""
        before_ns = oldest_ns - _KEPT_NS
        self._tracks = {key: _shortened(track, before_ns) for key, track in self._tracks.items()}
        moving = {
            child: (parent, _shortened(track, before_ns))
            for child, (parent, track) in self.frames.moving.items()
        }
        self.frames = Frames(self.frames.static, moving)


def _shortened(track: MotionTrack, before_ns: int) -> MotionTrack:
    useless = int(np.searchsorted(track.t_ns, before_ns))
    return track.since(useless) if useless > len(track.t_ns) // 2 else track


def fixed_track(config: MappingConfig, first_ns: int, last_ns: int) -> MotionTrack:
    """A robot that stands still, from one time to another."""
    assert config.pose.fixed is not None
    x_m, y_m, heading_deg = config.pose.fixed
    motions = Motions.same(SE2(x_m, y_m, math.radians(heading_deg)), 2)
    return MotionTrack(np.array([first_ns, last_ns]), motions, last_ns - first_ns + 1)
