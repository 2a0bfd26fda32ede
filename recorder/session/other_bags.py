"""Bags in other containers (``.db3`` of rosbag2, ``.bag`` of ROS 1) copied into MCAP, by rosbags.

The only place that imports rosbags, which is an extra: without it one line says what to install.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

from mcap.writer import CompressionType, Writer

from recorder.errors import BadInput

_WANTED = (
    "Range", "LaserScan", "PoseStamped", "PoseWithCovarianceStamped", "Odometry", "TFMessage",
)  # fmt: skip


def copy_bag(path: Path, target: BinaryIO) -> None:
    """Copy the messages of the types that are read here. Raises BadInput, in one line."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise BadInput(
            f"{path}: a bag that is no MCAP file is read through rosbags: "
            "pip install rosbags, or convert it with ros2 bag convert (rosbags-convert for ROS 1)"
        ) from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(target, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library="rosbags")
    try:
        if path.suffix == ".bag":
            with AnyReader([path], default_typestore=store) as reader:
                _copy(reader, store, writer)
        else:
            _copy_sqlite(path, store, writer)
    except BadInput:
        raise
    except Exception as error:  # rosbags raises whatever its readers happen to
        raise BadInput(f"{path}: rosbags cannot read it: {' '.join(str(error).split())}") from None
    writer.finish()  # type: ignore[no-untyped-call]


def _copy(reader: Any, store: Any, writer: Writer) -> None:
    """All messages of known types, as the standard ROS 2 definitions have them."""
    wanted = [each for each in reader.connections if each.msgtype.rpartition("/")[2] in _WANTED]
    channels: dict[int, int] = {}
    for connection in wanted:
        text, _ = store.generate_msgdef(connection.msgtype, ros_version=2)
        schema = writer.register_schema(connection.msgtype, "ros2msg", text.encode())
        channels[connection.id] = writer.register_channel(connection.topic, "cdr", schema)
    for connection, t_ns, raw in reader.messages(connections=wanted):
        message = reader.deserialize(raw, connection.msgtype)
        _fill_in(message)
        data = bytes(store.serialize_cdr(message, connection.msgtype))
        writer.add_message(channels[connection.id], t_ns, data, t_ns)


def _fill_in(message: Any) -> None:
    """What ROS 1 has no field for."""
    if message.__msgtype__ == "sensor_msgs/msg/Range" and not hasattr(message, "variance"):
        message.variance = 0.0


def _copy_sqlite(path: Path, store: Any, writer: Writer) -> None:
    """A database alone, whether or not its metadata.yaml lies beside it."""
    import sqlite3

    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as database:
        topics = database.execute("SELECT id, name, type, serialization_format FROM topics")
        channels: dict[int, int] = {}
        for number, name, kind, encoding in topics.fetchall():
            if kind.rpartition("/")[2] not in _WANTED or encoding != "cdr":
                continue
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[number] = writer.register_channel(name, "cdr", schema)
        query = "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
        for number, t_ns, data in database.execute(query):
            if number in channels:
                writer.add_message(channels[number], t_ns, data, t_ns)
