"""Bags as other people make them, through their libraries: what several test files are fed with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap_ros2.writer import Writer

from recorder.messages import Message, Odometry, Pose, Range, Scan, Transform

T0_NS = 1_767_225_600_000_000_000
Quaternion = tuple[float, float, float, float]
LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)
LEFT: Quaternion = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))


@dataclass(frozen=True)
class Sent:
    """One message: its type, topic, content, and when it arrived."""

    kind: str
    topic: str
    content: dict[str, Any]
    log_ns: int
    definition: str = "humble"


def stamp(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}


def header(t_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": stamp(t_ns), "frame_id": frame}


def pose_of(x: float, y: float, q: Quaternion) -> dict[str, Any]:
    return {
        "position": {"x": x, "y": y, "z": 0.0},
        "orientation": dict(zip("xyzw", q, strict=True)),
    }


def pose(
    i: int, topic: str = "/pose", at: tuple[float, float] = (1.0, 1.0), q: Quaternion = LEVEL,
    kind: str = "geometry_msgs/msg/PoseStamped", every_ns: int = 100_000_000, child: str = "",
) -> Sent:  # fmt: skip
    """The i-th pose, ten a second."""
    t_ns = T0_NS + i * every_ns
    content: dict[str, Any] = {"header": header(t_ns, "map"), "pose": pose_of(*at, q)}
    if kind != "geometry_msgs/msg/PoseStamped":
        content["pose"] = {"pose": content["pose"], "covariance": [0.0] * 36}
    if kind == "nav_msgs/msg/Odometry":
        zero = {"x": 0.0, "y": 0.0, "z": 0.0}
        content["child_frame_id"] = child or "base_link"
        content["twist"] = {"twist": {"linear": zero, "angular": zero}, "covariance": [0.0] * 36}
    return Sent(kind, topic, content, t_ns)


def reading(
    i: int, topic: str = "/sonar", frame: str = "sonar", d: float = 1.0, **given: Any
) -> Sent:
    """The i-th range, ten a second, 5 ms behind the pose."""
    t_ns = T0_NS + i * 100_000_000 + 5_000_000
    content = {
        "header": header(t_ns, frame), "radiation_type": 0, "field_of_view": 0.26,
        "min_range": 0.02, "max_range": 4.0, "range": d,
    } | given  # fmt: skip
    return Sent("sensor_msgs/msg/Range", topic, content, t_ns)


def transform(
    parent: str, child: str, at: tuple[float, float] = (0.0, 0.1), q: Quaternion = LEFT,
    t_ns: int = T0_NS, topic: str = "/tf_static",
) -> Sent:  # fmt: skip
    """Where a frame stands in another."""
    content = {
        "header": header(t_ns, parent), "child_frame_id": child,
        "transform": {
            "translation": {"x": at[0], "y": at[1], "z": 0.2},
            "rotation": dict(zip("xyzw", q, strict=True)),
        },
    }  # fmt: skip
    return Sent("tf2_msgs/msg/TFMessage", topic, {"transforms": [content]}, t_ns or T0_NS)


def standing(count: int = 40, **given: Any) -> list[Sent]:
    """A robot that stands at (1, 1), heading 0, and sees something at 1 m."""
    poses = [pose(i) for i in range(count)]
    return [*poses, *(reading(i, **given) for i in range(count - 1))]


def bag(path: Path, sent: Sequence[Sent], distribution: str = "humble") -> Path:
    """A bag written with mcap-ros2-support and the definitions of a distribution, from rosbags."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores[f"ROS2_{distribution.upper()}"])
    with path.open("wb") as file:
        writer = Writer(file)
        schemas: dict[str, Any] = {}
        for each in sorted(sent, key=lambda message: message.log_ns):
            if each.kind not in schemas:
                text, _ = store.generate_msgdef(each.kind, ros_version=2)
                schemas[each.kind] = writer.register_msgdef(each.kind, text)
            writer.write_message(
                each.topic, schemas[each.kind], _complete(each, distribution), log_time=each.log_ns,
                publish_time=each.log_ns,
            )  # fmt: skip
        writer.finish()
    return path


def _complete(each: Sent, distribution: str) -> dict[str, Any]:
    if each.kind == "sensor_msgs/msg/Range" and distribution == "jazzy":
        return {"variance": 0.0, **each.content}
    return each.content


@dataclass
class Foreign:
    """Our own messages as somebody else's: other topics, other frames."""

    poses: str = "/robot7/localization"
    readings: str = "/robot7/ultrasound"
    base: str = "robot7/base_footprint"
    sent: list[Sent] = field(default_factory=list)

    def of(self, records: Iterator[tuple[int, Message]]) -> list[Sent]:
        return [each for log_ns, message in records for each in self._one(log_ns, message)]

    def _one(self, log_ns: int, message: Message) -> Iterator[Sent]:
        match message:
            case Pose(t_ns, at):
                content = {
                    "header": header(t_ns, "map"),
                    "pose": {"pose": pose_of(at.x_m, at.y_m, turn(at.heading_rad)),
                             "covariance": [0.0] * 36},
                }  # fmt: skip
                kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
                yield Sent(kind, self.poses, content, log_ns)
            case Range():
                content = {
                    "header": header(message.t_ns, f"/robot7/{message.sensor}_frame"),
                    "radiation_type": int(message.radiation),
                    "field_of_view": message.beam_width_rad, "min_range": message.min_range_m,
                    "max_range": message.max_range_m, "range": message.range_m,
                }  # fmt: skip
                topic = f"{self.readings}/{message.sensor}"
                yield Sent("sensor_msgs/msg/Range", topic, content, log_ns)
            case Scan():
                count = len(message.ranges_m)
                last = message.angle_min_rad + message.angle_increment_rad * (count - 1)
                content = {
                    "header": header(message.t_ns, f"/robot7/{message.sensor}_frame"),
                    "angle_min": message.angle_min_rad, "angle_max": last,
                    "angle_increment": message.angle_increment_rad, "time_increment": 0.0,
                    "scan_time": 0.0, "range_min": message.min_range_m,
                    "range_max": message.max_range_m, "ranges": message.ranges_m.tolist(),
                    "intensities": [],
                }  # fmt: skip
                yield Sent(
                    "sensor_msgs/msg/LaserScan", f"/robot7/lidar/{message.sensor}", content, log_ns
                )
            case Transform():
                at = message.parent_from_child
                yield transform(
                    self.base, f"robot7/{message.child}_frame", (at.x_m, at.y_m),
                    turn(at.heading_rad), message.t_ns,
                )  # fmt: skip
            case Odometry() | _:
                return


def turn(heading_rad: float) -> Quaternion:
    return (0.0, 0.0, math.sin(heading_rad / 2), math.cos(heading_rad / 2))
