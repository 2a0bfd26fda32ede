"""Other people's bags: read to the right value, or refused in one line that tells what to do."""

from __future__ import annotations

import csv
import math
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from naive_placing import place
from other_bags import (
    LEFT,
    LEVEL,
    T0_NS,
    Foreign,
    Sent,
    bag,
    header,
    pose,
    reading,
    standing,
    transform,
)

import echogrid
from mapping.artifacts import Snapshot
from mapping.config import load_config
from mapping.pipeline import build_maps
from mapping.placed_session import PlacedSession
from recorder.errors import BadInput
from recorder.session import SessionWriter, read_session
from recorder.session.columns import open_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room


class Mapped:
    """What ``map`` makes of files: its points, its status, and all that it reports."""

    def __init__(self, *arguments: object) -> None:
        self.arguments = [str(each) for each in arguments]

    def run(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> Mapped:
        out = folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        capsys.readouterr()
        self.status = echogrid.main(["map", *self.arguments, "-o", "-", "--export", str(out)])
        read = capsys.readouterr()
        self.text, self.errors = read.out, read.err
        self.points: list[tuple[float, float]] = []
        self.times: list[int] = []
        for file in sorted(out.glob("*.points.csv")):
            with file.open() as lines:
                for row in csv.DictReader(lines):
                    self.points.append((float(row["x_m"]), float(row["y_m"])))
                    self.times.append(int(row["t_ns"]))
        return self


@pytest.fixture
def mapped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., Mapped]:
    return lambda *arguments: Mapped(*arguments).run(tmp_path, capsys)


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("case", "first"),
    [
        (["quat_long.mcap"], (1.0, 2.044)),
        (["two_odoms.mcap", "--set", "pose.topic=/odom_ground_truth_absolute"], (2.044, 1.0)),
        (["two_odoms.mcap", "--set", "pose.topic=/odom"], (4.044, 1.0)),
        (["slash_frame.mcap"], (1.0, 2.1)),
        (["ns_frames.mcap"], (1.0, 2.1)),
        (["tf_1hz.mcap"], (1.0, 2.1)),
        (["pose_1hz.mcap", "--set", "pose.max_gap_s=1.5"], (2.04425, 1.0)),
        (["stamp_zero.mcap", "--stamps", "arrival"], (2.044, 1.0)),
        (["min_over_max.mcap"], (2.044, 1.0)),
        (["fixed_distance.mcap"], (1.094, 1.0)),
        (["fov_360.mcap"], (2.044, 1.0)),
        (["par_pose.mcap", "par_sonar.mcap"], (2.0445, 1.0)),
        (["par_sonar.mcap", "par_pose.mcap"], (2.0445, 1.0)),
        (["tfmini.mcap"], (4.0005, 1.0)),
        (["file.mcap.zstd"], (2.044, 1.0)),
        (["rosbag_folder"], (2.044, 1.0)),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)  # fmt: skip
def test_cases_that_map(
    shared_cases: Path, mapped: Callable[..., Mapped], case: list[str], first: tuple[float, float]
) -> None:
    arguments = [shared_cases / a if (shared_cases / a).exists() else a for a in case]
    run = mapped(*arguments)
    assert run.status == 0, run.errors
    assert run.points[0] == pytest.approx(first, abs=1e-6)


@pytest.mark.real_data
def test_the_case_of_a_scan_upside_down(shared_cases: Path) -> None:
    placed = place(read_session(shared_cases / "scan_upside.mcap").records, load_config())
    y_m = np.concatenate([beam.points_m for beam in placed.beams])[:, 1]
    assert len(y_m) > 1000
    assert np.abs(y_m - 0.5).max() < 1e-3
    assert any("hangs upside down" in note for note in placed.notes)


@pytest.mark.real_data
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_case_of_a_split(
    shared_cases: Path, mapped: Callable[..., Mapped], order: tuple[int, ...]
) -> None:
    run = mapped(*(shared_cases / f"split_{part}.mcap" for part in order))
    assert len(run.times) == 59
    assert max(run.times) == T0_NS + 5_805_000_000
    assert "moved" not in run.errors


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("case", "words"),
    [
        (["two_odoms.mcap"], ["/odom (", "/odom_ground_truth_absolute", "--set pose.topic="]),
        (["two_odoms.mcap", "--set", "pose.topic=/nonsense"], ["/nonsense", "/odom"]),
        (["pose_1hz.mcap"], ["1 s apart", "pose.max_gap_s", "1.5"]),
        (["stamp_zero.mcap"], ["header.stamp is 0", "--stamps arrival"]),
        (["ros1.mcap"], ["/sonar", "sensor_msgs/Range", "ros1msg"]),
    ],
)
def test_cases_that_are_refused(
    shared_cases: Path, mapped: Callable[..., Mapped], case: list[str], words: list[str]
) -> None:
    run = mapped(shared_cases / case[0], *case[1:])
    assert run.status == 2
    assert run.errors.count("\n") == 1
    assert all(word in run.errors for word in words), run.errors


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("case", "status", "words"),
    [
        ("ros1.mcap", 1, ["/sonar: 40 messages of sensor_msgs/Range", "ros1msg"]),
        ("stamp_zero.mcap", 0, ["79 messages, 3.9 s", "--stamps arrival"]),
        ("two_odoms.mcap", 0, ["several sources of poses"]),
        ("fov_360.mcap", 0, ["taken as degrees"]),
        ("min_over_max.mcap", 0, ["lies above max_range"]),
        ("rosbag_folder", 0, ["mapped from poses: /pose"]),
        ("file.mcap.zstd", 0, ["mapped from poses: /pose"]),
    ],
)
def test_what_info_reports_of_the_cases(
    shared_cases: Path, capsys: pytest.CaptureFixture[str], case: str, status: int, words: list[str]
) -> None:
    assert echogrid.main(["info", str(shared_cases / case)]) == status
    text = capsys.readouterr().out
    assert all(word in text for word in words), text


@pytest.mark.real_data
def test_the_case_of_a_far_infrared(shared_cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert echogrid.main(["info", str(shared_cases / "tfmini.mcap")]) == 0
    text = capsys.readouterr().out
    assert "swapped" not in text
    assert "0.8 m" not in text


# others of each kind


def first_point(path: Path, sent: Sequence[Sent], *more: str) -> tuple[float, float]:
    """Where both placers have the first obstacle."""
    file, config = bag(path, sent), load_config((), more)
    beam = place(read_session(file).records, config).beams[0]
    placed = PlacedSession(open_session(file).blocks, config)
    [same] = next(iter(placed)).beam(0).points_m
    np.testing.assert_array_equal(beam.points_m, [same])
    return pytest.approx(tuple(same), abs=1e-6)  # type: ignore[no-any-return]


@pytest.mark.parametrize("length", [1.414, 1e-3, 0.99, 1e4])
@pytest.mark.parametrize("kind", ["nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped",
                                  "geometry_msgs/msg/PoseWithCovarianceStamped"])  # fmt: skip
def test_quaternions_of_any_length(tmp_path: Path, length: float, kind: str) -> None:
    q = tuple(length * value for value in LEFT)
    poses = [pose(i, "/where", q=q, kind=kind) for i in range(20)]  # type: ignore[arg-type]
    ranges = [reading(i) for i in range(19)]
    assert first_point(tmp_path / "q.mcap", [*poses, *ranges]) == (1.0, 2.044)


@pytest.mark.parametrize("q", [(0.0,) * 4, (math.nan, 0.0, 0.0, 1.0), (0.0, 0.0, math.inf, 1.0)])
def test_what_is_no_rotation_drops_its_pose(
    tmp_path: Path, mapped: Callable[..., Mapped], q: tuple[float, ...]
) -> None:
    poses = [pose(i, q=q if i == 10 else LEVEL) for i in range(20)]  # type: ignore[arg-type]
    run = mapped(bag(tmp_path / "q.mcap", [*poses, *(reading(i) for i in range(19))]))
    assert len(run.points) == 19
    assert "pose not finite or too far 1" in run.text


def often(parent: str, child: str, count: int, ns: int, **given: Any) -> list[Sent]:
    """A transform on /tf, each ``ns``."""
    return [
        transform(parent, child, t_ns=T0_NS + i * ns, topic="/tf", **given) for i in range(count)
    ]


HERE: dict[str, Any] = {"at": (0.0, 0.0), "q": LEVEL}
TWICE = (0.0, 0.0, 2 * LEFT[2], 2 * LEFT[3])
MOUNTS: dict[str, list[Sent]] = {
    "a leading slash everywhere": [transform("/base_link", "/eye")],
    "through an arm": [
        transform("base_link", "arm", (0.05, 0.05), LEVEL),
        transform("arm", "eye", (-0.05, 0.05)),
    ],
    "from the footprint": [
        transform("base_footprint", "base_link", **HERE),
        transform("base_link", "eye"),
    ],
    "the footprint alone": [transform("base_footprint", "eye")],
    "a base of another name": [transform("chassis", "eye")],
    "a mount sent often": often("base_link", "eye", 4, 10**9),
    "a mount sent once on tf": often("base_link", "eye", 1, 1),
    "in a namespace": [transform("r/base_link", "r/eye")],
    "a namespaced topic": [transform("base_link", "eye", topic="/r/tf_static")],
    "under odom and map": [
        transform("map", "odom", (5.0, 0.0), LEVEL),
        transform("odom", "base_link", (1.0, 0.0), LEVEL),
        transform("base_link", "eye"),
    ],
    "a rotation of length two": [transform("base_link", "eye", q=TWICE)],
    "without a time": [transform("base_link", "eye", t_ns=0)],
}


@pytest.mark.parametrize("name", MOUNTS)
@pytest.mark.parametrize("topic", ["/range/front", "/u/s1"])
def test_mounts(tmp_path: Path, name: str, topic: str) -> None:
    frame = "r/eye" if name == "in a namespace" else "/eye"
    sent = [*standing(20, topic=topic, frame=frame), *MOUNTS[name]]
    assert first_point(tmp_path / "m.mcap", sent) == (1.0, 2.1)


def test_a_frame_that_moves_is_looked_up_at_the_readings_own_time(
    tmp_path: Path, mapped: Callable[..., Mapped]
) -> None:
    """A turret that goes a centimetre each 100 ms, with the sensor fixed on it."""
    moving = [transform("base_link", "turret", (0.01 * i, 0.0), LEVEL, T0_NS + i * 10**8, "/tf")
              for i in range(21)]  # fmt: skip
    sent = [*standing(20, frame="eye"), *moving, transform("turret", "eye")]
    run = mapped(bag(tmp_path / "t.mcap", sent))
    x_m = np.array(run.points)[:, 0]
    np.testing.assert_allclose(x_m, 1.0 + 0.01 * (np.arange(19) + 0.05), atol=1e-9)


def test_poses_from_tf_at_each_readings_own_time(
    tmp_path: Path, mapped: Callable[..., Mapped]
) -> None:
    """map ← odom jumps about at 2 Hz, odom ← base_link goes at 10 Hz: no topic has poses."""
    above = [
        transform("map", "odom", (1.0, 0.02 * i), LEVEL, T0_NS + i * 4 * 10**8, "/tf")
        for i in range(8)
    ]
    drive = [
        transform("odom", "base_link", (0.1 * i, 1.0), LEVEL, T0_NS + i * 10**8, "/tf")
        for i in range(29)
    ]
    ranges = [reading(i, frame="eye") for i in range(25)]
    run = mapped(
        bag(tmp_path / "tf.mcap", [*above, *drive, *ranges, transform("base_link", "eye")])
    )
    t_s = 0.1 * np.arange(25) + 0.005
    wanted = np.column_stack([1.0 + t_s, 1.0 + 0.05 * t_s + 0.1 + 1.0])
    np.testing.assert_allclose(run.points, wanted, atol=1e-6)


@pytest.mark.parametrize("pitch", [False, True])
def test_a_lidar_upside_down(tmp_path: Path, pitch: bool) -> None:
    """By roll, or by pitch, which also turns it round; on an arm that hangs upright."""
    q = (0.0, 1.0, 0.0, 0.0) if pitch else (1.0, 0.0, 0.0, 0.0)
    step = 0.1
    ranges = [math.inf] * 63
    ranges[16] = 1.0  # 1.6 rad to its left, as it sees it
    scans = []
    for i in range(10):
        t_ns = T0_NS + i * 10**8 + 5_000_000
        content = {
            "header": header(t_ns, "laser"),
            "angle_min": 0.0, "angle_max": 6.2, "angle_increment": step, "time_increment": 0.0,
            "scan_time": 0.0, "range_min": 0.05, "range_max": 12.0, "ranges": ranges,
            "intensities": [],
        }  # fmt: skip
        scans.append(Sent("sensor_msgs/msg/LaserScan", "/scan", content, t_ns))
    sent = [*(pose(i) for i in range(12)), *scans, transform("base_link", "arm", (0.0, 0.0), LEVEL),
            transform("arm", "laser", (0.0, 0.0), q)]  # fmt: skip
    found = first_point(tmp_path / "s.mcap", sent)
    heading = math.pi - 1.6 if pitch else -1.6
    assert found == (1.0 + math.cos(heading), 1.0 + math.sin(heading))


def test_a_tilted_mount_is_reported(tmp_path: Path, mapped: Callable[..., Mapped]) -> None:
    tilt = (0.0, math.sin(0.2), 0.0, math.cos(0.2))
    sent = [*standing(10, frame="eye"), transform("base_link", "eye", q=tilt)]
    assert "eye is tilted by 23 degrees" in mapped(bag(tmp_path / "t.mcap", sent)).errors


def test_a_missing_frame_is_reported_by_map(tmp_path: Path, mapped: Callable[..., Mapped]) -> None:
    sent = [*standing(10, frame="sonar_link"), transform("base_link", "camera")]
    run = mapped(bag(tmp_path / "t.mcap", sent))
    assert run.status == 0
    assert "no transform has its frame sonar_link (there are base_link, camera)" in run.errors
    assert "sensors.sonar_link.mount" in run.errors


def test_two_topics_of_one_frame_are_two_sensors(
    tmp_path: Path, mapped: Callable[..., Mapped]
) -> None:
    near = [reading(i, "/near", "eye", 0.5) for i in range(10)]
    far = [reading(i, "/far/it", "eye", 2.0) for i in range(10)]
    sent = [*(pose(i) for i in range(12)), *near, *far, transform("base_link", "eye")]
    run = mapped(bag(tmp_path / "t.mcap", sent))
    assert "near 10" in run.text
    assert "far_it 10" in run.text


def test_two_bases_of_one_robot(tmp_path: Path) -> None:
    """One sensor hangs on base_link, the other on the base_footprint that it hangs on itself."""
    sent = [
        *standing(10, topic="/a", frame="eye"), *(reading(i, "/b", "ear") for i in range(9)),
        transform("base_footprint", "base_link", **HERE), transform("base_link", "ear"),
        transform("base_footprint", "eye"),
    ]  # fmt: skip
    placed = place(read_session(bag(tmp_path / "b.mcap", sent)).records, load_config())
    assert placed.used == {"eye": 9, "ear": 9}
    for beam in placed.beams:
        assert beam.points_m[0] == pytest.approx((1.0, 2.1))


def test_one_topic_of_two_frames_is_two_sensors(
    tmp_path: Path, mapped: Callable[..., Mapped]
) -> None:
    both = [reading(i, "/ultrasound", "left" if i % 2 else "front", 0.5) for i in range(10)]
    sent = [*(pose(i) for i in range(12)), *both, transform("base_link", "left"),
            transform("base_link", "front", (0.1, 0.0), LEVEL)]  # fmt: skip
    run = mapped(bag(tmp_path / "t.mcap", sent))
    assert "front 5" in run.text
    assert "left 5" in run.text


def test_a_sensor_is_named_by_choice(tmp_path: Path, mapped: Callable[..., Mapped]) -> None:
    path = bag(tmp_path / "t.mcap", standing(10, topic="/u/front", frame="u_front"))
    assert "ping 9" in mapped(path, "--set", "sensors.ping.topic=/u/front").text
    refused = mapped(path, "--set", "sensors.ping.topic=/u/frnt")
    assert refused.status == 2
    assert "did you mean /u/front?" in refused.errors


def two_robots() -> list[Sent]:
    sent: list[Sent] = []
    for robot, x_m in (("a", 1.0), ("b", 5.0)):
        sent += [pose(i, f"/{robot}/odom", (x_m, 1.0), kind="nav_msgs/msg/Odometry")
                 for i in range(12)]  # fmt: skip
        sent += [reading(i, f"/{robot}/sonar", f"{robot}/eye") for i in range(11)]
        sent.append(transform(f"{robot}/base_link", f"{robot}/eye"))
    return sent


def test_several_robots(tmp_path: Path, mapped: Callable[..., Mapped]) -> None:
    path = bag(tmp_path / "two.mcap", two_robots())
    refused = mapped(path)
    assert refused.status == 2
    assert refused.errors.count("\n") == 1
    for word in ("/a/odom", "/b/odom", "/a/sonar", "/b/sonar", "--set pose.topic"):
        assert word in refused.errors
    run = mapped(path, "--set", "pose.topic=/b/odom")
    assert run.points == [pytest.approx((5.0, 2.1))] * 11


def test_goals_are_no_poses(tmp_path: Path) -> None:
    goals = [pose(i, "/goal_pose", (9.0, 9.0)) for i in range(3)]
    sent = [*(pose(i, "/amcl_pose") for i in range(12)), *goals, *(reading(i) for i in range(11))]
    assert first_point(tmp_path / "g.mcap", sent) == (2.044, 1.0)


def test_odometry_beside_a_map_in_tf_is_a_choice(
    tmp_path: Path, mapped: Callable[..., Mapped]
) -> None:
    above = often("map", "odom", 12, 10**8, at=(3.0, 0.0), q=LEVEL)
    base = often("odom", "base_link", 12, 10**8, at=(1.0, 1.0), q=LEVEL)
    odometry = [pose(i, "/odom", kind="nav_msgs/msg/Odometry") for i in range(12)]
    sent = [*above, *base, *odometry, *(reading(i) for i in range(11))]
    path = bag(tmp_path / "c.mcap", sent)
    refused = mapped(path)
    assert refused.status == 2
    assert "/tf (base_link in map)" in refused.errors
    assert mapped(path, "--set", "pose.topic=/tf").points[0] == pytest.approx((5.044, 1.0))
    assert mapped(path, "--set", "pose.topic=/odom").points[0] == pytest.approx((2.044, 1.0))


def test_poses_are_shifted_against_readings(tmp_path: Path) -> None:
    drive = [pose(i, at=(0.1 * i, 1.0)) for i in range(30)]
    sent = [*drive, *(reading(i) for i in range(20))]
    found = first_point(tmp_path / "o.mcap", sent, "pose.offset_s=-0.5")
    assert found == (0.505 + 1.044, 1.0)


@pytest.mark.parametrize("width", [15.0, 26.0, 60.0])
def test_widths_in_degrees(tmp_path: Path, width: float) -> None:
    session = read_session(bag(tmp_path / "w.mcap", standing(10, field_of_view=width)))
    widths_rad = {beam.beam_width_rad for beam in place(session.records, load_config()).beams}
    assert list(widths_rad) == [pytest.approx(math.radians(width))]


def test_a_width_that_none_is_leaves_the_usual_one(
    tmp_path: Path, mapped: Callable[..., Mapped]
) -> None:
    run = mapped(bag(tmp_path / "w.mcap", standing(10, field_of_view=400.0)))
    assert run.status == 0
    assert "which no beam is" in run.errors


# files, parts and neighbours


def test_a_bag_in_three_parts_and_a_folder(tmp_path: Path, mapped: Callable[..., Mapped]) -> None:
    """Readings that arrive after the next file began are not lost, nor is anything moved."""
    sent = [*standing(60, frame="eye"), transform("base_link", "eye", t_ns=0)]
    folder = tmp_path / "run"
    folder.mkdir()
    names = []
    for part in range(3):
        first, last = T0_NS + part * 2 * 10**9 - 10**6, T0_NS + (part + 1) * 2 * 10**9 - 10**6
        names.append(f"run_{part}.mcap")
        bag(folder / names[-1], [m for m in sent if first <= m.log_ns < last])
    listed = "\n".join(f"    - {name}" for name in names)
    (folder / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n{listed}\n"
        "  files:\n" + "\n".join(f"    - path: {name}" for name in names)
    )
    whole = mapped(bag(tmp_path / "whole.mcap", sent))
    assert len(whole.points) == 59
    for run in (mapped(folder), mapped(*(folder / name for name in reversed(names)))):
        assert (run.points, run.times) == (whole.points, whole.times)
        assert "moved" not in run.errors
    (folder / names[1]).unlink()
    missing = mapped(folder)
    assert missing.status == 2
    assert "run_1.mcap, which is not there" in missing.errors


def test_another_drive_at_the_same_time_is_moved_and_reported(
    tmp_path: Path, mapped: Callable[..., Mapped]
) -> None:
    a, b = (bag(tmp_path / f"{name}.mcap", standing(20)) for name in "ab")
    run = mapped(a, b)
    assert len(run.points) == 38
    assert "moved 61.900 s behind" in run.errors


def compressed(path: Path, source: Path, compression: CompressionType) -> Path:
    """A copy of a bag, its chunks compressed so."""
    with source.open("rb") as file, path.open("wb") as target:
        writer = Writer(target, compression=compression)
        writer.start(profile="ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    return path


@pytest.mark.parametrize("compression", list(CompressionType))
def test_chunks(
    tmp_path: Path, mapped: Callable[..., Mapped], compression: CompressionType
) -> None:
    path = compressed(tmp_path / "c.mcap", bag(tmp_path / "a.mcap", standing(20)), compression)
    assert len(mapped(path).points) == 19


@pytest.mark.parametrize("kind", ["zstd", "lz4"])
def test_messages_compressed_one_by_one(
    tmp_path: Path, mapped: Callable[..., Mapped], kind: str
) -> None:
    import lz4.frame

    pack = zstandard.ZstdCompressor().compress if kind == "zstd" else lz4.frame.compress
    plain, path = bag(tmp_path / "a.mcap", standing(20)), tmp_path / "c.mcap"
    with plain.open("rb") as file, path.open("wb") as target:
        writer = Writer(target)
        writer.start(profile="ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(
                channels[channel.id], message.log_time, pack(message.data), message.publish_time
            )
        writer.finish()
    assert mapped(path).points == mapped(plain).points


def test_a_channel_that_cannot_be_decoded_costs_only_itself(
    tmp_path: Path, mapped: Callable[..., Mapped], capsys: pytest.CaptureFixture[str]
) -> None:
    plain, path = bag(tmp_path / "a.mcap", standing(20)), tmp_path / "c.mcap"
    with plain.open("rb") as file, path.open("wb") as target:
        writer = Writer(target)
        writer.start(profile="ros2")
        idl = writer.register_schema("sensor_msgs/msg/Range", "ros2idl", b"module x {};")
        strange = [
            writer.register_channel("/idl", "cdr", idl), writer.register_channel("/bare", "cdr", 0),
            writer.register_channel("/text", "json", 0),
        ]  # fmt: skip
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
            writer.add_message(strange[0], message.log_time, b"\0\1\0\0", message.log_time)
        for each in strange[1:]:
            writer.add_message(each, T0_NS, b"{}", T0_NS)
        writer.finish()
    run = mapped(path)
    assert run.status == 1
    assert len(run.points) == 19
    assert echogrid.main(["info", str(path)]) == 1
    text = capsys.readouterr().out
    assert "/idl: 39 messages of sensor_msgs/msg/Range cannot be decoded" in text
    assert "its definition is in ros2idl" in text
    assert "/bare: 1 messages of no type cannot be decoded" in text


# the same run as ours, by others


def by_rosbags(folder: Path, source: Path, storage: str) -> Path:
    """The messages of a bag, written by rosbags: a folder with its metadata.yaml."""
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as BagWriter
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    with (
        source.open("rb") as file,
        BagWriter(folder, version=9, storage_plugin=StoragePlugin[storage]) as writer,
    ):
        connections = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.topic not in connections:
                connections[channel.topic] = writer.add_connection(
                    channel.topic, schema.name, typestore=store
                )
            writer.write(connections[channel.topic], message.log_time, message.data)
    return folder


def grids(path: Path, *settings: str) -> list[np.ndarray]:
    session = read_session(path)
    steps = build_maps(session.records, load_config((), settings))
    return [s.layer.values for s in steps if isinstance(s, Snapshot) and s.final]


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "own.mcap"
    with SessionWriter(path) as session:
        for log_ns, message in simulate(
            load_room("room"), duration_s=4.0, seed=3, sensors=("ping", "lidar")
        ):
            session.write(message, log_ns=log_ns)
    return path


@pytest.mark.parametrize("distribution", ["humble", "jazzy"])
@pytest.mark.parametrize("written_by", ["mcap-ros2-support", "rosbags", "rosbags db3"])
def test_bags_of_others_map_to_the_same_grid(
    tmp_path: Path, own: Path, distribution: str, written_by: str
) -> None:
    records = ((r.log_ns, r.message) for r in read_session(own).records)
    path = bag(tmp_path / "theirs.mcap", Foreign().of(records), distribution)
    if written_by != "mcap-ros2-support":
        if distribution == "humble":
            pytest.skip("rosbags is handed messages of jazzy")
        storage = "MCAP" if written_by == "rosbags" else "SQLITE3"
        path = by_rosbags(tmp_path / "bag", path, storage)
    ours, theirs = grids(own, "grid.resolution_m=0.05"), grids(path, "grid.resolution_m=0.05")
    assert len(ours) == len(theirs) == 3
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_ros_1_bag(tmp_path: Path, mapped: Callable[..., Mapped]) -> None:
    from rosbags.rosbag1 import Writer as BagWriter
    from rosbags.typesys import Stores, get_typestore

    new, old = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / "old.bag"
    plain = bag(tmp_path / "a.mcap", standing(20))
    with plain.open("rb") as file, BagWriter(path) as writer:
        connections = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            content = new.deserialize_cdr(message.data, schema.name)
            stamp = content.header.stamp
            content.header = old.types["std_msgs/msg/Header"](0, stamp, content.header.frame_id)
            if channel.topic not in connections:
                connections[channel.topic] = writer.add_connection(
                    channel.topic, schema.name, typestore=old
                )
            data = old.serialize_ros1(content, schema.name)
            writer.write(connections[channel.topic], message.log_time, bytes(data))
    run = mapped(path)
    assert run.status == 0, run.errors
    assert run.points == mapped(plain).points


def test_without_rosbags_one_line_names_what_to_install(tmp_path: Path) -> None:
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    code = (
        "import sys; sys.modules['rosbags'] = None; sys.modules['rosbags.highlevel'] = None\n"
        f"import echogrid; sys.exit(echogrid.main(['info', {str(path)!r}]))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert found.returncode == 2
    assert found.stderr.count("\n") == 1
    assert "pip install rosbags" in found.stderr


def test_a_folder_of_nothing(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="without a bag"):
        read_session(tmp_path)
