"""Messages ↔ ROS 2 CDR. The only place that imports mcap_ros2.

Our own messages are written with the ROS 2 definitions of :mod:`recorder.ros_definitions`; what is
read is decoded with the definition that its file carries, never with an assumed one.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

from recorder.clock import NS_PER_S
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import (
    BASE_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    Diagnostics,
    Message,
    OccupancyGrid,
    Odometry,
    Path,
    Pose,
    Radiation,
    Range,
    RawLine,
    Scan,
    Transform,
)
from recorder.ros_definitions import DEFINITIONS

# A float32 holds about seven digits: those that it does not hold are noise of the conversion.
_DIGITS = 7
UNIT_LENGTH = 1e-6  # so far from one the square of a length may be by rounding alone
LEAST_SQUARED = 1e-12
_LITTLE_ENDIAN = b"\0\1\0\0"  # what CDR begins with


def type_name(message: Message) -> str:
    """The ROS 2 type that a message is written as."""
    return _TYPES[type(message)][0]


def encode(message: Message) -> bytes:
    """A message as CDR, with the definition of :func:`type_name`."""
    name, fields = _TYPES[type(message)]
    content = fields(message)
    return content if isinstance(content, bytes) else bytes(_encoder(name)(content))


class Decoder:
    """Decodes the messages of one channel: ``decode(data, topic, publish_ns)`` → messages."""

    def __init__(self, name: str, definition: bytes) -> None:
        """Raises BadInput where the definition cannot be read."""
        self._read = _READERS.get(name)
        self.known = self._read is not None
        if not self.known:
            return
        try:
            self._decode = generate_dynamic(name, definition.decode())[name]
        except Exception as error:  # the library raises whatever its parser happens to
            raise BadInput(f"{name}: the message definition cannot be read: {error}") from None

    def decode(self, data: bytes, topic: str, publish_ns: int) -> list[Message]:
        """The messages that one record holds (a TFMessage holds several).

        Raises BadInput where the bytes are not such a message.
        """
        if self._read is None:
            return []
        try:
            return self._read(self._decode(data), topic, publish_ns)
        except Exception as error:  # as above: struct, Unicode, index and value errors alike
            raise BadInput(f"{topic}: a message cannot be decoded: {error}") from None


@cache
def _encoder(name: str) -> Callable[[dict[str, Any]], bytes]:
    encoder: Callable[[dict[str, Any]], bytes] = serialize_dynamic(name, DEFINITIONS[name])[name]
    return encoder


def _stamp(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // NS_PER_S, "nanosec": t_ns % NS_PER_S}


def _header(t_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": _stamp(t_ns), "frame_id": frame}


def _quaternion(heading_rad: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": math.sin(heading_rad / 2), "w": math.cos(heading_rad / 2)}


def _pose(pose: SE2) -> dict[str, Any]:
    return {
        "position": {"x": pose.x_m, "y": pose.y_m, "z": 0.0},
        "orientation": _quaternion(pose.heading_rad),
    }


def _pose_fields(m: Any) -> dict[str, Any]:
    return {"header": _header(m.t_ns, MAP_FRAME), "pose": _pose(m.world_from_base)}


def _odometry_fields(m: Any) -> dict[str, Any]:
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    unknown = [0.0] * 36
    return {
        "header": _header(m.t_ns, ODOM_FRAME),
        "child_frame_id": BASE_FRAME,
        "pose": {"pose": _pose(m.odom_from_base), "covariance": unknown},
        "twist": {"twist": {"linear": zero, "angular": zero}, "covariance": unknown},
    }


def _range_cdr(m: Range) -> bytes:
    """A reading as bytes: hundreds come each second, and the library takes ten times as long."""
    frame = (m.frame or m.sensor).encode() + b"\0"
    stamp = _stamp(m.t_ns)
    head = struct.pack("<iII", stamp["sec"], stamp["nanosec"], len(frame)) + frame
    head += bytes([min(int(m.radiation), 1)])
    values = m.beam_width_rad, m.min_range_m, m.max_range_m, m.range_m, 0.0
    return _LITTLE_ENDIAN + head + bytes(-len(head) % 4) + struct.pack("<5f", *values)


def _scan_fields(m: Any) -> dict[str, Any]:
    last = m.angle_min_rad + m.angle_increment_rad * (len(m.ranges_m) - 1)
    return {
        "header": _header(m.t_ns, m.frame or m.sensor),
        "angle_min": m.angle_min_rad,
        "angle_max": last,
        "angle_increment": m.angle_increment_rad,
        "time_increment": 0.0,
        "scan_time": 0.0,
        "range_min": m.min_range_m,
        "range_max": m.max_range_m,
        "ranges": [float(r) for r in m.ranges_m],
        "intensities": [],
    }


def _transform_fields(m: Any) -> dict[str, Any]:
    motion = m.parent_from_child
    rotation = _quaternion(motion.heading_rad)
    if m.up < 0.0:  # rolled by 180 degrees first
        rotation = {"x": rotation["w"], "y": rotation["z"], "z": 0.0, "w": 0.0}
    transform = {
        "translation": {"x": motion.x_m, "y": motion.y_m, "z": 0.0},
        "rotation": rotation,
    }
    stamped = {"header": _header(m.t_ns, m.parent), "child_frame_id": m.child}
    return {"transforms": [{**stamped, "transform": transform}]}


def _diagnostics_fields(m: Any) -> dict[str, Any]:
    values = [{"key": key, "value": str(value)} for key, value in m.counters.items()]
    status = {"level": 0, "name": m.name, "message": "", "hardware_id": "", "values": values}
    return {"header": _header(m.t_ns, ""), "status": [status]}


def _occupancy_cdr(m: OccupancyGrid) -> bytes:
    """A map as bytes: it has millions of cells, which the library would write one by one."""
    frame = MAP_FRAME.encode() + b"\0"
    stamp = _stamp(m.t_ns)
    head = struct.pack("<iII", stamp["sec"], stamp["nanosec"], len(frame)) + frame
    head += bytes(-len(head) % 4)
    rows, cols = m.percent.shape
    head += struct.pack("<iIfII", stamp["sec"], stamp["nanosec"], m.resolution_m, cols, rows)
    head += bytes(-len(head) % 8)
    head += struct.pack("<7dI", *m.origin_m, 0.0, 0.0, 0.0, 0.0, 1.0, m.percent.size)
    return _LITTLE_ENDIAN + head + np.ascontiguousarray(m.percent, np.int8).tobytes()


def _path_fields(m: Path) -> dict[str, Any]:
    return {"header": _header(m.t_ns, MAP_FRAME), "poses": [_pose_fields(p) for p in m.poses]}


_TYPES: dict[type, tuple[str, Callable[[Any], dict[str, Any] | bytes]]] = {
    Pose: ("geometry_msgs/msg/PoseStamped", _pose_fields),
    Odometry: ("nav_msgs/msg/Odometry", _odometry_fields),
    Range: ("sensor_msgs/msg/Range", _range_cdr),
    Scan: ("sensor_msgs/msg/LaserScan", _scan_fields),
    Transform: ("tf2_msgs/msg/TFMessage", _transform_fields),
    RawLine: ("std_msgs/msg/String", lambda m: {"data": m.text}),
    Diagnostics: ("diagnostic_msgs/msg/DiagnosticArray", _diagnostics_fields),
    OccupancyGrid: ("nav_msgs/msg/OccupancyGrid", _occupancy_cdr),
    Path: ("nav_msgs/msg/Path", _path_fields),
}


def _t_ns(header: Any) -> int:
    return int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)


def _se2(position: Any, q: Any) -> SE2:
    """A planar pose; of a rotation in space, its yaw; NaN where it is no rotation."""
    return SE2(float(position.x), float(position.y), yaw_and_up(q.x, q.y, q.z, q.w)[0])


def yaw_and_up(x: float, y: float, z: float, w: float) -> tuple[float, float]:
    """The heading of the x axis, radians, and the share of the z axis that still points up.

    Of a quaternion of any length, as if it had length one: many drivers round theirs, or send
    sums. One of length zero, or that is not finite, is no rotation: both are NaN.
    """
    squared = x * x + y * y + z * z + w * w
    if abs(squared - 1.0) <= UNIT_LENGTH:  # nothing to divide by, so that nothing is rounded
        squared = 1.0
    elif not LEAST_SQUARED <= squared < math.inf:
        return math.nan, math.nan
    yaw_rad = math.atan2(2 * (w * z + x * y), squared - 2 * (y * y + z * z))
    return yaw_rad, (squared - 2 * (x * x + y * y)) / squared


def _read_pose(m: Any, topic: str, publish_ns: int) -> list[Message]:
    return [Pose(_t_ns(m.header), _se2(m.pose.position, m.pose.orientation))]


def _read_pose_with_covariance(m: Any, topic: str, publish_ns: int) -> list[Message]:
    pose = m.pose.pose
    return [Pose(_t_ns(m.header), _se2(pose.position, pose.orientation))]


def _read_odometry(m: Any, topic: str, publish_ns: int) -> list[Message]:
    pose = m.pose.pose
    return [Odometry(_t_ns(m.header), _se2(pose.position, pose.orientation))]


def _sensor_name(topic: str, frame: str) -> str:
    """``/range/NAME`` → NAME; on other people's topics the frame, then the topic, names it."""
    for prefix in ("/range/", "/scan/"):
        if topic.startswith(prefix):
            return topic.removeprefix(prefix)
    return (frame or topic.strip("/")).replace("/", "_")


def named(topic: str, frame_id: str) -> tuple[str, str]:
    """A sensor and its frame, "" where the frame is called as the sensor.

    A leading slash is a habit of ROS 1 that names the same frame.
    """
    frame = frame_id.lstrip("/")
    sensor = _sensor_name(topic, frame)
    return sensor, "" if frame == sensor else frame


def _read_range(m: Any, topic: str, publish_ns: int) -> list[Message]:
    sensor, frame = named(topic, m.header.frame_id)
    return [
        Range(
            t_ns=_t_ns(m.header),
            sensor=sensor,
            range_m=round(float(m.range), _DIGITS),
            beam_width_rad=round(float(m.field_of_view), _DIGITS),
            min_range_m=round(float(m.min_range), _DIGITS),
            max_range_m=round(float(m.max_range), _DIGITS),
            radiation=Radiation(min(int(m.radiation_type), 1)),
            frame=frame,
        )
    ]


def _read_scan(m: Any, topic: str, publish_ns: int) -> list[Message]:
    ranges = np.asarray(m.ranges, np.float32).astype(np.float64)
    ranges.flags.writeable = False
    sensor, frame = named(topic, m.header.frame_id)
    return [
        Scan(
            t_ns=_t_ns(m.header),
            sensor=sensor,
            ranges_m=ranges,
            angle_min_rad=float(m.angle_min),
            angle_increment_rad=float(m.angle_increment),
            min_range_m=round(float(m.range_min), _DIGITS),
            max_range_m=round(float(m.range_max), _DIGITS),
            frame=frame,
        )
    ]


def _read_transforms(m: Any, topic: str, publish_ns: int) -> list[Message]:
    return [_read_transform(t, static=topic.endswith("tf_static")) for t in m.transforms]


def _read_transform(t: Any, *, static: bool) -> Transform:
    at, q = t.transform.translation, t.transform.rotation
    yaw_rad, up = yaw_and_up(q.x, q.y, q.z, q.w)
    return Transform(
        t_ns=_t_ns(t.header),
        parent=t.header.frame_id.lstrip("/"),
        child=t.child_frame_id.lstrip("/"),
        parent_from_child=SE2(float(at.x), float(at.y), yaw_rad),
        static=static,
        up=up,
    )


def _read_raw(m: Any, topic: str, publish_ns: int) -> list[Message]:
    return [RawLine(publish_ns, m.data)] if topic == "/serial/raw" else []


def _read_diagnostics(m: Any, topic: str, publish_ns: int) -> list[Message]:
    return [
        Diagnostics(_t_ns(m.header), s.name, {v.key: v.value for v in s.values}) for s in m.status
    ]


_READERS: dict[str, Callable[[Any, str, int], list[Message]]] = {
    "geometry_msgs/msg/PoseStamped": _read_pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _read_pose_with_covariance,
    "nav_msgs/msg/Odometry": _read_odometry,
    "sensor_msgs/msg/Range": _read_range,
    "sensor_msgs/msg/LaserScan": _read_scan,
    "tf2_msgs/msg/TFMessage": _read_transforms,
    "std_msgs/msg/String": _read_raw,
    "diagnostic_msgs/msg/DiagnosticArray": _read_diagnostics,
}
