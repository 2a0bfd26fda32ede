"""Message definitions of ROS 2 (Jazzy), as they are written into a session's schemas.

The texts are those of the ROS packages common_interfaces and geometry2 (Apache-2.0, BSD), in the
concatenated form that the ``ros2msg`` schema encoding wants: a message's own definition, then those
of all messages that it is made of.
"""

from __future__ import annotations

_MESSAGES: dict[str, str] = {
    "geometry_msgs/PoseStamped": """\
std_msgs/Header header
geometry_msgs/Pose pose
""",
    "sensor_msgs/Range": """\
uint8 ULTRASOUND=0
uint8 INFRARED=1
std_msgs/Header header
uint8 radiation_type
float32 field_of_view
float32 min_range
float32 max_range
float32 range
float32 variance
""",
    "tf2_msgs/TFMessage": """\
geometry_msgs/TransformStamped[] transforms
""",
    "nav_msgs/Odometry": """\
std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
""",
    "sensor_msgs/LaserScan": """\
std_msgs/Header header
float32 angle_min
float32 angle_max
float32 angle_increment
float32 time_increment
float32 scan_time
float32 range_min
float32 range_max
float32[] ranges
float32[] intensities
""",
    "diagnostic_msgs/DiagnosticArray": """\
std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
""",
    "nav_msgs/OccupancyGrid": """\
std_msgs/Header header
nav_msgs/MapMetaData info
int8[] data
""",
    "nav_msgs/Path": """\
std_msgs/Header header
geometry_msgs/PoseStamped[] poses
""",
    "std_msgs/String": """\
string data
""",
}

_PARTS: dict[str, str] = {
    "std_msgs/Header": """\
builtin_interfaces/Time stamp
string frame_id
""",
    "nav_msgs/MapMetaData": """\
builtin_interfaces/Time map_load_time
float32 resolution
uint32 width
uint32 height
geometry_msgs/Pose origin
""",
    "geometry_msgs/PoseStamped": """\
std_msgs/Header header
geometry_msgs/Pose pose
""",
    "builtin_interfaces/Time": """\
int32 sec
uint32 nanosec
""",
    "geometry_msgs/Pose": """\
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
""",
    "geometry_msgs/Point": """\
float64 x
float64 y
float64 z
""",
    "geometry_msgs/Quaternion": """\
float64 x
float64 y
float64 z
float64 w
""",
    "geometry_msgs/TransformStamped": """\
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
""",
    "geometry_msgs/Transform": """\
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""",
    "geometry_msgs/Vector3": """\
float64 x
float64 y
float64 z
""",
    "geometry_msgs/PoseWithCovariance": """\
geometry_msgs/Pose pose
float64[36] covariance
""",
    "geometry_msgs/TwistWithCovariance": """\
geometry_msgs/Twist twist
float64[36] covariance
""",
    "geometry_msgs/Twist": """\
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
""",
    "diagnostic_msgs/DiagnosticStatus": """\
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
""",
    "diagnostic_msgs/KeyValue": """\
string key
string value
""",
}


def _parts_of(definition: str) -> list[str]:
    """Names of the messages that a definition is made of, each before those that it is made of."""
    names: dict[str, None] = {}
    for line in definition.splitlines():
        name = line.split()[0].removesuffix("[]")
        if name in _PARTS:
            names |= dict.fromkeys([name, *_parts_of(_PARTS[name])])
    return list(names)


def _whole(definition: str) -> str:
    """A definition with those of all its parts behind it, each once."""
    parts = (f"{'=' * 80}\nMSG: {name}\n{_PARTS[name]}" for name in _parts_of(definition))
    return definition + "".join(parts)


DEFINITIONS: dict[str, str] = {
    name.replace("/", "/msg/"): _whole(definition) for name, definition in _MESSAGES.items()
}
