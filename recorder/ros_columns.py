"""ROS 2 CDR → columns: the messages of one channel decoded together, to the bits of one by one.

What is decoded here is decoded as in :mod:`recorder.ros_types`, the twin of this module; a message
whose bytes are laid out otherwise than those of the others is left to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.clock import NS_PER_S
from recorder.columns import (
    Columns,
    Floats,
    Ints,
    PoseColumns,
    RangeColumns,
    RawColumns,
    ScanColumns,
    TransformColumns,
    elementwise,
)
from recorder.ros_layouts import Definition, Layout, layout_of, parse_definition
from recorder.ros_types import _DIGITS, LEAST_SQUARED, UNIT_LENGTH, named

_MOST_LAYOUTS = 16  # of one channel; one that changes more often is read message by message
_SCALE = 10.0**_DIGITS
_WHOLE_FROM = 2.0**24  # a float32 this large holds no fraction


@dataclass(frozen=True, slots=True)
class Rows:
    """Messages of one channel: where each stands in ``data``; all arrays (N,)."""

    data: bytes
    starts: Ints
    ends: Ints
    row: Ints
    log_ns: Ints
    publish_ns: Ints

    def __len__(self) -> int:
        return len(self.row)

    def where(self, kept: NDArray[np.bool_]) -> Rows:
        """Those for which ``kept`` (N,) is true."""
        return Rows(
            self.data, self.starts[kept], self.ends[kept], self.row[kept], self.log_ns[kept],
            self.publish_ns[kept],
        )  # fmt: skip

    def message(self, at: int) -> bytes:
        """The bytes of one message."""
        return self.data[self.starts[at] : self.ends[at]]


_Read = Callable[[Layout, str, Rows, NDArray[np.void]], list[Columns]]


@dataclass(frozen=True, slots=True)
class _Known:
    layout: Layout
    dtype: np.dtype[np.void]
    read: _Read


class ChannelColumns:
    """Decodes the messages of one channel, many at a time."""

    def __init__(self, type_name: str, definition: bytes, topic: str) -> None:
        self._type, self._topic = type_name, topic
        self._definition = None
        if type_name in _READERS or type_name == _STRING:
            self._definition = parse_definition(type_name, definition.decode(errors="replace"))
        self._known: list[_Known] = []

    def take(self, rows: Rows) -> tuple[list[Columns], Rows]:
        """The columns of those that could be decoded, and the others."""
        columns: list[Columns] = []
        if self._definition is None:
            return columns, rows
        if self._type == _STRING:
            return _read_texts(self._definition, self._topic, rows)
        for known in self._known:
            rows = self._take_alike(known, rows, columns)
        while len(rows) and len(self._known) < _MOST_LAYOUTS:
            fresh = self._learn(self._definition, rows.message(0))
            if fresh is None:
                break
            self._known.append(fresh)
            rows = self._take_alike(fresh, rows, columns)
        return columns, rows

    def _take_alike(self, known: _Known, rows: Rows, columns: list[Columns]) -> Rows:
        """Decode what is laid out as ``known``; the rest."""
        long_enough = rows.ends - rows.starts >= known.layout.size
        fitting = rows if long_enough.all() else rows.where(long_enough)
        if not len(fitting):
            return rows
        found = gathered(fitting.data, fitting.starts, known.dtype)
        alike = known.layout.alike(found)
        if alike.all() and fitting is rows:
            columns += known.read(known.layout, self._topic, rows, found)
            return rows.where(np.zeros(len(rows), np.bool_))
        if alike.any():
            columns += known.read(known.layout, self._topic, fitting.where(alike), found[alike])
            long_enough[long_enough] = alike
            return rows.where(~long_enough)
        return rows

    def _learn(self, definition: Definition, message: bytes) -> _Known | None:
        layout = layout_of(definition, message)
        if layout is None:
            return None
        paths_of, read = _READERS[self._type]
        try:
            return _Known(layout, layout.dtype(paths_of(layout)), read)
        except (KeyError, ValueError):
            return None


def gathered(data: bytes, starts: Ints, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Records (N,) that begin at ``starts`` (N,) of ``data``, which holds them whole."""
    room = len(data) - dtype.itemsize + 1
    # raw bytes are copied eight times as fast as records with fields
    everywhere = np.ndarray((room,), f"V{dtype.itemsize}", data, strides=(1,))
    found: NDArray[np.void] = everywhere[starts].view(dtype)
    return found


def rounded(values: NDArray[np.float32]) -> Floats:
    """``round(float(value), 7)`` of each, to the bit.

    The nearest whole number of 1e-7, divided by 1e7, which is exact to half a unit in the last
    place; only where the product lies too near to the middle of two is it left to Python.
    """
    exact = values.astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = exact * _SCALE
        out: Floats = np.rint(scaled) / _SCALE
        doubt = np.abs(np.abs(scaled - np.floor(scaled)) - 0.5) <= np.abs(scaled) * 2.0**-51
    if doubt.any():
        out[doubt] = [round(value, _DIGITS) for value in exact[doubt].tolist()]
    large = ~(np.abs(exact) < _WHOLE_FROM)
    if large.any():
        out[large] = exact[large]
    return out


def _mostly_one(values: NDArray[np.float32], read: Callable[..., Floats]) -> Floats:
    """``read(values)``; a column that never changes, as limits do not, is read once."""
    if (values == values[0]).all():
        return np.broadcast_to(read(values[:1]), values.shape)
    return read(values)


def _plain(values: NDArray[np.float32]) -> Floats:
    return values.astype(np.float64)


def _t_ns(found: NDArray[np.void], header: str) -> Ints:
    seconds = found[f"{header}.stamp.sec"].astype(np.int64)
    t_ns: Ints = seconds * NS_PER_S + found[f"{header}.stamp.nanosec"]
    return t_ns


def _stamp_paths(layout: Layout, header: str) -> dict[str, str]:
    """Whole seconds were unsigned once."""
    seconds = f"{header}.stamp.sec"
    kind = layout.values[seconds][1]
    return {seconds: kind if kind in ("<i4", "<u4") else "<i4", f"{header}.stamp.nanosec": "<u4"}


def _motion_paths(position: str, rotation: str) -> dict[str, str]:
    paths = [f"{position}.x", f"{position}.y", *(f"{rotation}.{axis}" for axis in "xyzw")]
    return dict.fromkeys(paths, "<f8")


def _motion(
    found: NDArray[np.void], position: str, rotation: str
) -> tuple[tuple[Floats, Floats, Floats], Floats]:
    """x and y in metres and yaw in radians, and how far up the z axis points, (N,) each.

    See :func:`~recorder.ros_types.yaw_and_up`.
    """
    x, y, z, w = (np.ascontiguousarray(found[f"{rotation}.{axis}"]) for axis in "xyzw")
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        squared = x * x + y * y + z * z + w * w
        squared[np.abs(squared - 1.0) <= UNIT_LENGTH] = 1.0
        squared[~((squared >= LEAST_SQUARED) & (squared < np.inf))] = np.nan
        sine, cosine = 2 * (w * z + x * y), squared - 2 * (y * y + z * z)
        up: Floats = (squared - 2 * (x * x + y * y)) / squared
    yaw_rad = elementwise(math.atan2, sine, cosine)
    at_x, at_y = (np.ascontiguousarray(found[f"{position}.{axis}"]) for axis in "xy")
    return (at_x, at_y, yaw_rad), up


def _poses(pose: str, *, by_odometry: bool) -> tuple[Callable[[Layout], dict[str, str]], _Read]:
    position, rotation = f"{pose}.position", f"{pose}.orientation"

    def paths(layout: Layout) -> dict[str, str]:
        return _stamp_paths(layout, "header") | _motion_paths(position, rotation)

    def read(layout: Layout, topic: str, rows: Rows, found: NDArray[np.void]) -> list[Columns]:
        motion, _ = _motion(found, position, rotation)
        t_ns = _t_ns(found, "header")
        return [PoseColumns(topic, rows.row, rows.log_ns, t_ns, *motion, by_odometry)]

    return paths, read


def _range_paths(layout: Layout) -> dict[str, str]:
    names = ("field_of_view", "min_range", "max_range", "range")
    values = {"radiation_type": "u1"} | dict.fromkeys(names, "<f4")
    return _stamp_paths(layout, "header") | values


def _read_ranges(layout: Layout, topic: str, rows: Rows, found: NDArray[np.void]) -> list[Columns]:
    sensor, frame = named(topic, layout.texts["header.frame_id"])
    limits = ("field_of_view", "min_range", "max_range")
    width_rad, min_m, max_m = (_mostly_one(found[name], rounded) for name in limits)
    radiation = np.minimum(found["radiation_type"], 1).astype(np.int64)
    range_m, t_ns = rounded(found["range"]), _t_ns(found, "header")
    return [
        RangeColumns(
            topic, rows.row, rows.log_ns, t_ns, sensor, range_m, width_rad, min_m, max_m,
            radiation, frame,
        )
    ]  # fmt: skip


def _scan_paths(layout: Layout) -> dict[str, str]:
    names = ("angle_min", "angle_increment", "range_min", "range_max", "ranges")
    return _stamp_paths(layout, "header") | dict.fromkeys(names, "<f4")


def _read_scans(layout: Layout, topic: str, rows: Rows, found: NDArray[np.void]) -> list[Columns]:
    sensor, frame = named(topic, layout.texts["header.frame_id"])
    angles = ("angle_min", "angle_increment")
    first_rad, step_rad = (_mostly_one(found[name], _plain) for name in angles)
    min_m, max_m = (_mostly_one(found[name], rounded) for name in ("range_min", "range_max"))
    ranges_m, t_ns = _plain(found["ranges"]), _t_ns(found, "header")
    return [
        ScanColumns(
            topic, rows.row, rows.log_ns, t_ns, sensor, ranges_m, first_rad, step_rad, min_m, max_m,
            frame,
        )
    ]  # fmt: skip


def _transform_names(layout: Layout) -> Iterable[str]:
    return (f"transforms.{number}" for number in range(layout.lengths["transforms"]))


def _transform_paths(layout: Layout) -> dict[str, str]:
    paths: dict[str, str] = {}
    for name in _transform_names(layout):
        motion = _motion_paths(f"{name}.transform.translation", f"{name}.transform.rotation")
        paths |= _stamp_paths(layout, f"{name}.header") | motion
    return paths


def _read_transforms(
    layout: Layout, topic: str, rows: Rows, found: NDArray[np.void]
) -> list[Columns]:
    columns: list[Columns] = []
    for name in _transform_names(layout):
        place, turn = f"{name}.transform.translation", f"{name}.transform.rotation"
        motion, up = _motion(found, place, turn)
        parent = layout.texts[f"{name}.header.frame_id"].lstrip("/")
        child = layout.texts[f"{name}.child_frame_id"].lstrip("/")
        t_ns = _t_ns(found, f"{name}.header")
        static = topic.endswith("tf_static")
        columns.append(
            TransformColumns(topic, rows.row, rows.log_ns, t_ns, *motion, parent, child, static, up)
        )
    return columns


def _read_texts(definition: Definition, topic: str, rows: Rows) -> tuple[list[Columns], Rows]:
    """Lines of text, all of different lengths; those that are not plain ASCII are left."""
    only = definition.fields[0]
    fits = rows.ends - rows.starts >= _TEXT_HEAD.itemsize
    if (len(definition.fields), only.type_name, only.count, only.name) != (
        1,
        "string",
        None,
        "data",
    ):
        fits[:] = False
    fitting = rows.where(fits)
    if not len(fitting):
        return [], rows
    head = gathered(rows.data, fitting.starts, _TEXT_HEAD)
    starts = fitting.starts + _TEXT_HEAD.itemsize
    # the last character of a string is its end
    ends = np.minimum(starts + np.maximum(head["length"].astype(np.int64) - 1, 0), fitting.ends)
    data = rows.data
    plain = [data[a:b].isascii() for a, b in zip(starts.tolist(), ends.tolist(), strict=True)]
    good = (head["kind"] & 1 == 1) & np.array(plain, np.bool_)
    fits[fits] = good
    columns: list[Columns] = []
    if topic == "/serial/raw" and good.any():
        kept = fitting.where(good)
        columns.append(
            RawColumns(
                topic, kept.row, kept.log_ns, kept.publish_ns, data, starts[good], ends[good]
            )
        )
    return columns, rows.where(~fits)


_STRING = "std_msgs/msg/String"
KIND_OF_TYPE: Mapping[str, type[Columns]] = {
    "geometry_msgs/msg/PoseStamped": PoseColumns,
    "geometry_msgs/msg/PoseWithCovarianceStamped": PoseColumns,
    "nav_msgs/msg/Odometry": PoseColumns,
    "sensor_msgs/msg/Range": RangeColumns,
    "sensor_msgs/msg/LaserScan": ScanColumns,
    "tf2_msgs/msg/TFMessage": TransformColumns,
    _STRING: RawColumns,
}
_TEXT_HEAD = np.dtype(
    {"names": ["kind", "length"], "formats": ["u1", "<u4"], "offsets": [1, 4], "itemsize": 8}
)
_READERS: Mapping[str, tuple[Callable[[Layout], dict[str, str]], _Read]] = {
    "geometry_msgs/msg/PoseStamped": _poses("pose", by_odometry=False),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _poses("pose.pose", by_odometry=False),
    "nav_msgs/msg/Odometry": _poses("pose.pose", by_odometry=True),
    "sensor_msgs/msg/Range": (_range_paths, _read_ranges),
    "sensor_msgs/msg/LaserScan": (_scan_paths, _read_scans),
    "tf2_msgs/msg/TFMessage": (_transform_paths, _read_transforms),
}
