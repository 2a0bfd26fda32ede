"""Readings placed one by one while they arrive, the slow twin: each waits for its next pose.

The rules are those of a finished session (``naive_placing``); only what is not known yet
differs. A reading is placed as soon as the track reaches past its time. One that no pose follows
within ``pose.max_gap_s`` could not be placed later either, and is dropped and counted.
"""

from __future__ import annotations

import bisect
import math
from collections import Counter, deque

from naive_placing import Placed, place_reading
from naive_poses import FrameTree, Track

from mapping.beams import Beam
from mapping.config import MappingConfig, Sensor
from mapping.scan_reach import ScanReach
from mapping.sensors import resolve_sensors
from mapping.tracks import is_sane
from recorder.clock import NS_PER_S
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Odometry, Pose, Range, Scan, Transform

WARM_UP_S = 2.0  # until then it is not known which sensors and which poses there are
_KEPT_NS = 60 * NS_PER_S  # of the track, behind the newest message
_ALWAYS_NS = 1 << 62


class LivePlacer:
    """Takes messages in order of arrival, gives beams in order of their readings."""

    def __init__(self, config: MappingConfig) -> None:
        self.readings = 0
        self.sensors: dict[str, Sensor] = {}
        self.used: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        if config.pose.odom_start == "tracker":
            raise BadInput('pose.odom_start = "tracker" needs a finished session, not a live one')
        self._config = config
        self._gap_ns = round(config.pose.max_gap_s * NS_PER_S)
        self._frames = FrameTree()
        self._poses, self._odometry = self._new_track(), self._new_track()
        self._waiting: deque[Range | Scan] = deque()
        self._first_ns: int | None = None
        self._newest_ns = 0
        self._placed = 0
        self._reach = ScanReach()

    def take(self, message: Message) -> list[Beam]:
        """The beams that can be placed now that this message is known."""
        if self._first_ns is None:
            self._first_ns = message.t_ns
        self._newest_ns = max(self._newest_ns, message.t_ns)
        match message:
            case Pose():
                self._extend(self._poses, message.t_ns, message.world_from_base)
            case Odometry():
                self._extend(self._odometry, message.t_ns, message.odom_from_base)
            case Transform():
                self._take_transform(message)
            case Range() | Scan():
                self.readings += 1
                self._waiting.append(message)
        if self._newest_ns - self._first_ns < WARM_UP_S * NS_PER_S:
            return []
        return self._place(ended=False)

    def finish(self) -> list[Beam]:
        """The last beams: nothing more will come."""
        return self._place(ended=True)

    def placed(self, beams: tuple[Beam, ...]) -> Placed:
        """What has been placed so far, in the form that a finished session has."""
        return Placed(beams, dict(self.sensors), self.readings, dict(self.used), dict(self.dropped))

    def _new_track(self) -> Track:
        return Track([], [], self._gap_ns)

    def _extend(self, track: Track, t_ns: int, pose: SE2) -> None:
        """Sort a pose in (they rarely come late), and forget what no reading will ask for."""
        if not is_sane(pose):
            self.dropped["pose not finite or too far"] += 1
            return
        times, poses = track.t_ns, track.poses
        assert isinstance(times, list)
        assert isinstance(poses, list)
        place = bisect.bisect_right(times, t_ns)
        times.insert(place, t_ns)
        poses.insert(place, pose)
        oldest_ns = self._waiting[0].t_ns if self._waiting else self._newest_ns
        useless = bisect.bisect_left(times, oldest_ns - _KEPT_NS)
        if useless > len(times) // 2:  # now and then, so that it costs nothing
            del times[:useless], poses[:useless]

    def _take_transform(self, message: Transform) -> None:
        if not is_sane(message.parent_from_child):
            return
        if message.static:
            self._frames.static[message.child] = message
            return
        known = self._frames.moving.get(message.child)
        track = self._new_track() if known is None else known[1]
        self._frames.moving[message.child] = (message.parent, track)
        self._extend(track, message.t_ns, message.parent_from_child)

    def _track(self) -> Track:
        """The poses in force: those of a finished session with the same messages."""
        fixed = self._config.pose.fixed
        if fixed is not None:
            pose = SE2(fixed[0], fixed[1], math.radians(fixed[2]))
            return Track([-_ALWAYS_NS, _ALWAYS_NS], [pose, pose], 2 * _ALWAYS_NS)
        if self._config.pose.topic == "/odom" or not self._poses.t_ns:
            return self._odometry
        return self._poses

    def _place(self, *, ended: bool) -> list[Beam]:
        # Those of the first seconds together, so that two of one kind share a layer.
        self.sensors = resolve_sensors(
            self._waiting, self._frames.parent_of, self._config, self.sensors
        )
        track = self._track()
        beams: list[Beam] = []
        while self._waiting and (ended or self._is_ripe(self._waiting[0], track)):
            reading = self._waiting.popleft()
            sensor = self.sensors[reading.sensor]
            outcome = place_reading(
                self._placed, reading, sensor, track, self._frames, self._config, self._reach
            )
            if isinstance(outcome, Beam):
                beams.append(outcome)
                self._placed += 1
                self.used[reading.sensor] += 1
            else:
                self.dropped[outcome] += 1
        return beams

    def _is_ripe(self, reading: Range | Scan, track: Track) -> bool:
        """Whether waiting on could change nothing."""
        if self._newest_ns - reading.t_ns > self._gap_ns:
            return True
        tracks = [track, *(moving for _, moving in self._frames.moving.values())]
        return all(each.t_ns and each.t_ns[-1] >= reading.t_ns for each in tracks)
