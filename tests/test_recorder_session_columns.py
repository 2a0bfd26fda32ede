"""A session read as columns holds, to the bit, what it holds read message by message."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from mcap_ros2._dynamic import serialize_dynamic

from recorder import ros_types
from recorder.columns import (
    Block,
    Choice,
    OtherColumns,
    PoseColumns,
    RangeColumns,
    RawColumns,
    ScanColumns,
    block_of,
)
from recorder.geometry import SE2
from recorder.messages import (
    Diagnostics,
    Message,
    Odometry,
    Pose,
    Radiation,
    Range,
    RawLine,
    Record,
    Scan,
    Transform,
    topic_of,
)
from recorder.ros_columns import rounded
from recorder.ros_definitions import DEFINITIONS
from recorder.ros_layouts import parse_definition
from recorder.ros_types import encode, type_name
from recorder.session import SessionWriter, read_session
from recorder.session.chunks import message_starts, taken_apart
from recorder.session.columns import ColumnReader, OpenSession, open_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room
from tests.same_records import assert_same_either_way, plain

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared"
T_NS = 1_700_000_000_123_456_789
FRAME = struct.Struct("<BQ")


def of_all_kinds(count: int) -> Iterator[Message]:
    """Messages of all kinds, with texts that are not ASCII and numbers that are none."""
    yield Transform(T_NS, "base_link", "ping", SE2(0.044, -0.0, 0.1))
    for i in range(count):
        t_ns = T_NS + i * 50_000_000
        yield Pose(t_ns, SE2(0.013 * i, -1.0, 0.7 * i))
        yield Odometry(t_ns, SE2(-0.01 * i, 1.0, 0.02 * i))
        d = (0.123_456_78 * i, math.inf, -math.inf, math.nan)[i % 4]
        yield Range(t_ns, "ping", d, 0.663, 0.02, 3.3, Radiation.ULTRASOUND)
        yield Range(t_ns, "dirrs", 1 / 256 + i, 0.1, 0.1, 0.8, Radiation.INFRARED)
        yield Transform(t_ns, "base_link", "head", SE2(0.0, 0.0, 0.1 * i), static=False)
        yield Transform(t_ns, "head", "eye", SE2(0.0, 0.1, 0.1 * i), static=False)
        yield RawLine(t_ns, "$RNG,1,2*00" if i % 3 else "naïve \x00 ü")
        ranges = np.array([0.5, math.inf, math.nan, 0.1 * i])
        yield Scan(t_ns, "lidar", ranges, -0.1, 0.1, 0.05, 12.0)
        yield Diagnostics(t_ns, "recorder", {"received": i})


def write(path: Path, count: int, *, compress: bool = True, each: int = 40) -> Path:
    with SessionWriter(path, metadata={"name": "Ω"}, compress=compress) as session:
        session.attach("truth.geojson", "application/geo+json", b"{}")
        for number, message in enumerate(of_all_kinds(count)):
            session.write(message, log_ns=T_NS + number)
            if number % each == each - 1:
                session.sync()
    return path


@pytest.mark.parametrize("count", [1, 5, 200])
@pytest.mark.parametrize("each", [7, 40, 100_000])
def test_all_kinds_of_messages(tmp_path: Path, count: int, each: int) -> None:
    found = assert_same_either_way(write(tmp_path / "s.mcap", count, each=each))
    assert len(found["records"]) == 9 * count + 1  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["room", "l-room"])
def test_the_logs(name: str) -> None:
    found = assert_same_either_way(ROOT / "logs" / f"{name}.mcap")
    assert len(found["records"]) > 1000  # type: ignore[arg-type]


@pytest.mark.real_data
@pytest.mark.parametrize("folder", ["cases", "cases/rosbag_folder", "data/rooms"])
def test_files_of_other_people(folder: str) -> None:
    files = sorted((SHARED / folder).glob("*.mcap"))
    assert files
    for file in files:
        assert_same_either_way(file, file.name)


def test_only_what_is_rare_is_read_one_by_one(tmp_path: Path) -> None:
    write(tmp_path / "s.mcap", 100)
    blocks = list(ColumnReader(tmp_path / "s.mcap").blocks())
    rows = [c for block in blocks for c in block.columns]
    single = sum(len(c) for c in rows if isinstance(c, OtherColumns))
    assert single == 134  # the diagnostics, and the lines that are not ASCII
    assert sum(len(c) for c in rows if isinstance(c, RawColumns)) == 66
    assert sum(len(c) for c in rows if isinstance(c, ScanColumns)) == 100


@pytest.mark.parametrize("compress", [True, False])
def test_flipped_bits(tmp_path: Path, compress: bool) -> None:
    """One in each few bytes; which, is different in each file."""
    data = write(tmp_path / "s.mcap", 3, compress=compress, each=6).read_bytes()
    for position in range(0, len(data), 37):
        flipped = bytearray(data)
        flipped[position] ^= 1 << position % 8
        (tmp_path / "flip.mcap").write_bytes(flipped)
        assert_same_either_way(tmp_path / "flip.mcap", position)


def test_cut_anywhere(tmp_path: Path) -> None:
    data = write(tmp_path / "s.mcap", 3, each=8).read_bytes()
    for length in range(0, len(data), 101):
        (tmp_path / "cut.mcap").write_bytes(data[:length])
        assert_same_either_way(tmp_path / "cut.mcap", length)


def test_many_things_wrong_at_once(tmp_path: Path) -> None:
    """Bytes changed, lost and doubled, in a file long enough for small chunks to wait together."""
    data = write(tmp_path / "s.mcap", 60, each=20).read_bytes()
    for seed in range(30):
        dice = random.Random(seed)
        bad = bytearray(data)
        for _ in range(dice.randint(1, 4)):
            at = dice.randrange(len(bad))
            match dice.randrange(3):
                case 0:
                    bad[at] ^= dice.randrange(1, 256)
                case 1:
                    del bad[at : at + dice.randrange(1, 400)]
                case _:
                    bad[at:at] = bad[at : at + dice.randrange(1, 400)]
        (tmp_path / "bad.mcap").write_bytes(bad)
        assert_same_either_way(tmp_path / "bad.mcap", seed)


# files of other programs


def written_by_others(
    path: Path,
    messages: list[tuple[str, str, bytes, bytes]],
    *,
    compression: CompressionType = CompressionType.ZSTD,
    chunks: bool = True,
    crcs: bool = True,
    library: str = "others",
    sequence: Callable[[int], int] = lambda number: 0,
) -> Path:
    """A file of (topic, type, definition, data), as another program writes it."""
    with path.open("wb") as file:
        writer = Writer(
            file, chunk_size=2000, compression=compression, use_chunking=chunks, enable_crcs=crcs
        )
        writer.start(profile="ros2", library=library)
        schemas: dict[tuple[str, bytes], int] = {}
        channels: dict[tuple[str, int], int] = {}
        for number, (topic, name, definition, data) in enumerate(messages):
            if (name, definition) not in schemas:
                schemas[name, definition] = writer.register_schema(name, "ros2msg", definition)
            key = topic, schemas[name, definition]
            if key not in channels:
                channels[key] = writer.register_channel(topic, "cdr", key[1])
            writer.add_message(channels[key], T_NS + number, data, T_NS + number, sequence(number))
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def ours(*messages: Message) -> list[tuple[str, str, bytes, bytes]]:
    return [
        (topic_of(m), type_name(m), DEFINITIONS[type_name(m)].encode(), encode(m)) for m in messages
    ]


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunks", [True, False])
@pytest.mark.parametrize("crcs", [True, False])
def test_containers(tmp_path: Path, compression: CompressionType, chunks: bool, crcs: bool) -> None:
    messages = ours(*of_all_kinds(20))
    path = written_by_others(
        tmp_path / "s.mcap", messages, compression=compression, chunks=chunks, crcs=crcs
    )
    found = assert_same_either_way(path)
    assert len(found["records"]) == len(messages)  # type: ignore[arg-type]


def test_numbers_that_leap_back_and_forth_in_our_own_name(tmp_path: Path) -> None:
    dice = random.Random(1)
    path = written_by_others(
        tmp_path / "s.mcap", ours(*of_all_kinds(50)), library="echogrid",
        sequence=lambda number: dice.randrange(1 << 32),
    )  # fmt: skip
    assert "messages are missing" in str(assert_same_either_way(path)["damage"])


def ranges(count: int, frame: Callable[[int], str]) -> Iterator[bytes]:
    for i in range(count):
        yield encode(Range(T_NS + i, frame(i), 0.1 * i, 0.6, 0.02, 4.0, Radiation.ULTRASOUND))


RANGE = "sensor_msgs/msg/Range"
DEFINITION = DEFINITIONS[RANGE]


@pytest.mark.parametrize(
    "frame",
    [
        lambda i: "sonar",
        lambda i: ("front", "left", "a/much/longer/name")[i % 3],
        lambda i: f"frame {i}",  # more than are held
        lambda i: "",
        lambda i: "Ω" * (i % 4),
    ],
)
def test_frames_that_change(tmp_path: Path, frame: Callable[[int], str]) -> None:
    messages = [("/sonar", RANGE, DEFINITION.encode(), data) for data in ranges(100, frame)]
    found = assert_same_either_way(written_by_others(tmp_path / "s.mcap", messages))
    assert len(found["records"]) == 100  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "changed",
    [
        DEFINITION.replace("float32 variance\n", ""),
        "# a comment\n\n" + DEFINITION.replace("range\n", "range  # metres = m\n"),
        DEFINITION.replace("MSG: std_msgs/Header", "MSG: std_msgs/msg/Header"),
        DEFINITION.replace("float32 range\n", "float64 range\n"),
        DEFINITION.replace("float32 min_range", "float32 least_range"),
        DEFINITION.replace("float32 range\n", "float32 range 1.5\n"),
        DEFINITION.replace("string frame_id", "string<=10 frame_id"),
        DEFINITION.replace("string frame_id", "wstring frame_id"),
        DEFINITION.replace("int32 sec", "uint32 sec"),
        DEFINITION.replace("std_msgs/Header header", "Header header"),
        DEFINITION.partition("=====")[0],
        DEFINITION.partition("MSG: builtin")[0].rstrip("=\n") + "\n",
        "uint8[2] more\nfloat64[] many\nstring[] texts\n" + DEFINITION,
        "",
        "nonsense ! here",
    ],
)
def test_the_definition_that_the_file_carries_counts(tmp_path: Path, changed: str) -> None:
    data = list(ranges(50, lambda i: "sonar"))
    messages = [("/sonar", RANGE, changed.encode(), each) for each in data]
    assert_same_either_way(written_by_others(tmp_path / "s.mcap", messages))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data, i: data[: 4 + i % len(data)],
        lambda data, i: data + bytes(i % 9),
        lambda data, i: b"\0\0" + data[2:] if i % 2 else data,  # big-endian
        lambda data, i: b"\0\3\0\3" + data[4:],
        lambda data, i: data[:12] + struct.pack("<I", i % 40) + data[16:],
        lambda data, i: data[:17] + b"\xff" + data[18:] if i % 5 == 0 else data,  # no UTF-8
        lambda data, i: b"",
    ],
)
@pytest.mark.parametrize("kind", [Pose, Odometry, Range, Scan, Transform, RawLine])
def test_messages_that_are_not_what_they_claim(
    tmp_path: Path, spoil: Callable[[bytes, int], bytes], kind: type
) -> None:
    good = [each for each, m in zip(ours(*of_all_kinds(25)), of_all_kinds(25), strict=True)
            if isinstance(m, kind)]  # fmt: skip
    bad = [(t, name, text, spoil(data, i)) for i, (t, name, text, data) in enumerate(good)]
    assert_same_either_way(written_by_others(tmp_path / "s.mcap", bad))


def test_several_transforms_in_one_message(tmp_path: Path) -> None:
    name = "tf2_msgs/msg/TFMessage"
    encoder = serialize_dynamic(name, DEFINITIONS[name])[name]
    messages = []
    for i in range(40):
        transforms = [
            {
                "header": {"stamp": {"sec": i, "nanosec": n}, "frame_id": "odom"},
                "child_frame_id": f"wheel_{n}",
                "transform": {
                    "translation": {"x": 0.1 * i, "y": 0.2, "z": 9.0},
                    "rotation": {"x": 0.1, "y": 0.2, "z": 0.3, "w": 0.4 + i},
                },
            }
            for n in range(i % 4)
        ]
        messages.append(
            ("/tf", name, DEFINITIONS[name].encode(), encoder({"transforms": transforms}))
        )
    found = assert_same_either_way(written_by_others(tmp_path / "s.mcap", messages))
    assert len(found["records"]) == 60  # type: ignore[arg-type]


def test_a_kind_of_pose_is_read_in_bulk_as_soon_as_it_is_read_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "geometry_msgs/msg/PoseWithCovarianceStamped"
    inner = DEFINITIONS["nav_msgs/msg/Odometry"]
    text = inner.replace("string child_frame_id\n", "").replace(
        "geometry_msgs/TwistWithCovariance twist\n", ""
    )

    def read(m: Any, topic: str, publish_ns: int) -> list[Message]:
        [odometry] = ros_types._read_odometry(m, topic, publish_ns)
        assert isinstance(odometry, Odometry)
        return [Pose(odometry.t_ns, odometry.odom_from_base)]

    monkeypatch.setitem(ros_types._READERS, name, read)
    encoder = serialize_dynamic(name, text)[name]
    data = [
        encoder({"pose": {"pose": {"position": {"x": 0.1 * i}, "orientation": {"z": i, "w": 2.0}}}})
        for i in range(30)
    ]
    path = written_by_others(
        tmp_path / "s.mcap", [("/amcl_pose", name, text.encode(), each) for each in data]
    )
    assert len(assert_same_either_way(path)["records"]) == 30  # type: ignore[arg-type]
    kinds = {type(each) for block in ColumnReader(path).blocks() for each in block.columns}
    assert kinds == {PoseColumns}


# the parts


def test_several_files_are_one_session(tmp_path: Path) -> None:
    one, two = write(tmp_path / "one.mcap", 5), write(tmp_path / "two.mcap", 20)
    joined, opened = read_session(one, two), open_session(one, two)
    assert plain(opened.records()) == plain(joined.records)
    assert opened.metadata["files"] == ["one.mcap", "two.mcap"]
    assert (opened.attachments, opened.damage) == (joined.attachments, ())
    choice = Choice(kinds=(ScanColumns,))
    assert len(list(opened.records(choice))) == 25
    assert isinstance(open_session(one), OpenSession)


def test_again_and_only_what_is_wanted(tmp_path: Path) -> None:
    session = OpenSession(write(tmp_path / "s.mcap", 30))
    everything = list(session.records())
    assert plain(r for b in session.blocks() for r in b.records()) == plain(everything)
    first_ns, end_ns = T_NS + 3 * 50_000_000, T_NS + 9 * 50_000_000
    choice = Choice(kinds=(RangeColumns, PoseColumns), t_ns=(first_ns, end_ns))
    found = [record for block in session.blocks(choice) for record in block.records()]
    wanted = [
        record
        for record in everything
        if isinstance(record.message, Range | Pose | Odometry)
        and first_ns <= record.message.t_ns < end_ns
    ]
    assert plain(found) == plain(wanted)
    assert len(found) == 4 * 6
    by_topic = session.blocks(Choice(topics={"/range/ping"}))
    assert {record.topic for block in by_topic for record in block.records()} == {"/range/ping"}
    assert session.reader.messages == 271
    assert session.reader.metadata["name"] == "Ω"


def test_single_messages_as_columns() -> None:
    records = [Record(topic_of(m), T_NS + i, m) for i, m in enumerate(of_all_kinds(20))]
    assert plain(block_of(records).records()) == plain(records)
    assert list(Block(()).records()) == []


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-3, 1e3, 1e8, 1e-30, 1e30]))
def test_rounding_is_that_of_python(seed: int, scale: float) -> None:
    dice = np.random.default_rng(seed)
    values = (dice.normal(0, scale, 500)).astype(np.float32)
    values[:7] = [np.nan, np.inf, -np.inf, 0.0, -0.0, 1 / 256, 3 / 256]
    values[7:20] = (dice.integers(-(2**20), 2**20, 13) / 256).astype(np.float32)
    expected = [round(float(value), 7) for value in values]
    assert [repr(v) for v in rounded(values).tolist()] == [repr(v) for v in expected]


def test_no_float_near_the_middle_of_two_is_rounded_otherwise() -> None:
    """Those that lie within a few units in the last place of k + 0.5 times 1e-7."""
    middle = (np.arange(1, 400_000, 7) + 0.5) * 1e-7
    near = middle.astype(np.float32)
    values = np.concatenate(
        [near, np.nextafter(near, np.float32(1)), np.nextafter(near, np.float32(0))]
    )
    assert rounded(values).tolist() == [round(float(value), 7) for value in values]


def walked(data: bytes, first: int) -> list[int] | None:
    """The twin of ``message_starts``: from one frame to the next."""
    starts, at = [], first
    while at < len(data):
        if at + FRAME.size > len(data):
            return None
        opcode, length = FRAME.unpack_from(data, at)
        if opcode != 5 or length < 22 or at + FRAME.size + length > len(data):
            return None
        starts.append(at)
        at += FRAME.size + length
    return starts


LIKE_FRAMES = st.sampled_from([b"\0", b"\5", b"\x16", b"\x1f", b"\5\x16\0\0\0\0\0\0\0"])
PIECES = st.lists(
    st.lists(LIKE_FRAMES, min_size=22, max_size=60).map(b"".join), min_size=1, max_size=40
)


@settings(deadline=None, max_examples=300)
@given(PIECES, st.booleans(), st.integers(0, 30))
def test_messages_are_found_among_bytes_that_look_like_some(
    pieces: list[bytes], cut: bool, before: int
) -> None:
    data = bytes([5]) * before + b"".join(FRAME.pack(5, len(p)) + p for p in pieces)
    data = data[:-3] if cut else data
    found = message_starts(data, before)
    expected = walked(data, before)
    if expected is None:
        assert found is None
    else:
        assert found is None or found.tolist() == expected


def test_a_chunk_is_taken_apart_in_its_order() -> None:
    frames = b"".join(FRAME.pack(5, 30) + bytes(30) for _ in range(200))
    other = FRAME.pack(0x90, 3) + b"abc"
    [stretch] = taken_apart(frames + other + frames) or []
    assert len(stretch.starts) == 400  # type: ignore[attr-defined]
    assert taken_apart(frames[:-1]) is None
    assert taken_apart(FRAME.pack(5, 21) + bytes(21)) is None


def test_all_of_our_own_definitions_are_understood() -> None:
    assert all(parse_definition(name, text) for name, text in DEFINITIONS.items())


@pytest.mark.parametrize("sweep_deg", [0.0, 60.0])
def test_a_simulated_drive(tmp_path: Path, sweep_deg: float) -> None:
    run = simulate(
        load_room("room"), duration_s=6.0, seed=1, head_sweep_deg=sweep_deg,
        sensors=("ping", "dirrs", "lidar"),
    )  # fmt: skip
    with SessionWriter(tmp_path / "s.mcap") as session:
        for log_ns, message in run:
            session.write(message, log_ns=log_ns)
    found = assert_same_either_way(tmp_path / "s.mcap")
    assert len(found["records"]) > 400  # type: ignore[arg-type]
