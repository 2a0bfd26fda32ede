"""Sessions: what is written is read, and a damaged file never gives a wrong reading."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from recorder.errors import BadInput, OutputExists
from recorder.geometry import SE2
from recorder.messages import (
    Diagnostics,
    Message,
    Odometry,
    Pose,
    Radiation,
    Range,
    RawLine,
    Scan,
    Transform,
    topic_of,
)
from recorder.session import SessionWriter, read_session

T_NS = 1_700_000_000_123_456_789
METADATA = {"seed": 3, "noise": 0.5, "name": "Ω room", "nested": {"a": [1, 2]}}
WALLS = b'{"walls": [[0, 0], [1, 0]]}'


def reading(t_ns: int, range_m: float) -> Range:
    return Range(t_ns, "ping", range_m, 0.663, 0.02, 3.3, Radiation.ULTRASOUND)


MESSAGES: list[Message] = [
    Pose(T_NS, SE2(1.25, -2.5, 0.75)),
    Odometry(T_NS + 1, SE2(-0.1, 0.2, -3.0)),
    reading(T_NS + 2, 1.2345),
    reading(T_NS + 3, math.inf),
    reading(T_NS + 4, -math.inf),
    Range(T_NS + 5, "dirrs", 0.456, 0.1, 0.1, 0.8, Radiation.INFRARED),
    Scan(T_NS + 6, "lidar", np.array([0.5, math.inf, 2.25, 3.1]), -1.57, 0.5, 0.1, 12.0),
    Transform(T_NS + 7, "base_link", "ping", SE2(0.044, 0.01, 0.5), static=True),
    Transform(T_NS + 8, "base_link", "head", SE2(0.0, 0.0, -1.0), static=False),
    RawLine(T_NS + 9, "R,ping,123*4F\xff\x01"),
    Diagnostics(T_NS + 10, "recorder", {"written": "12", "gaps": "0"}),
]


def write(path: Path, messages: Iterable[Message]) -> Path:
    with SessionWriter(path, metadata=METADATA) as session:
        session.attach("truth.geojson", "application/geo+json", WALLS)
        for message in messages:
            session.write(message, log_ns=message.t_ns + 1000)
    return path


def assert_same(found: Message, written: Message) -> None:
    assert type(found) is type(written)
    assert found.t_ns == written.t_ns
    for name in written.__dataclass_fields__:
        a, b = getattr(found, name), getattr(written, name)
        if isinstance(b, SE2):
            a, b = (a.x_m, a.y_m, a.heading_rad), (b.x_m, b.y_m, b.heading_rad)
            assert a == pytest.approx(b, abs=1e-12), name
        elif isinstance(b, np.ndarray):
            np.testing.assert_allclose(a, b, rtol=1e-6)
        elif isinstance(b, float):
            assert a == pytest.approx(b, rel=1e-6), name
        else:
            assert a == b, name


def test_every_kind_of_message_comes_back(tmp_path: Path) -> None:
    session = read_session(write(tmp_path / "all.mcap", MESSAGES))
    assert session.damage == ()
    assert len(session.records) == len(MESSAGES)
    for record, message in zip(session.records, MESSAGES, strict=True):
        assert record.topic == topic_of(message)
        assert record.log_ns == message.t_ns + 1000
        assert_same(record.message, message)
    assert {type(m) for m in MESSAGES} == {
        Pose, Odometry, Range, Scan, Transform, RawLine, Diagnostics,
    }  # fmt: skip


def test_metadata_and_attachment_come_back(tmp_path: Path) -> None:
    session = read_session(write(tmp_path / "all.mcap", MESSAGES))
    assert session.metadata == METADATA
    assert session.attachments == {"truth.geojson": WALLS}


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "here.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(OutputExists, match="exists already"):
        SessionWriter(path)
    assert path.read_bytes() == b"precious"
    with SessionWriter(path, force=True) as session:
        session.write(MESSAGES[0], log_ns=T_NS)
    assert len(read_session(path).records) == 1
    assert list(tmp_path.iterdir()) == [path]


def test_a_writer_that_fails_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "failed.mcap"
    broken = (1 // i for i in (0,))
    with pytest.raises(ZeroDivisionError):
        write(path, broken)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_rosbags_opens_it(tmp_path: Path) -> None:
    path = write(tmp_path / "all.mcap", MESSAGES)
    with AnyReader([path]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        ranges = [
            reader.deserialize(data, c.msgtype).range
            for c, _, data in reader.messages()
            if c.topic == "/range/ping"
        ]
    assert counts == dict(Counter(topic_of(m) for m in MESSAGES))
    assert ranges == pytest.approx([1.2345, math.inf, -math.inf])


def test_mcap_ros2_support_opens_it(tmp_path: Path) -> None:
    path = write(tmp_path / "all.mcap", MESSAGES)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = {each.channel.topic: each for each in reader.iter_decoded_messages()}
    assert set(found) == {topic_of(m) for m in MESSAGES}
    pose = found["/pose"].decoded_message
    assert (pose.header.frame_id, pose.pose.position.x) == ("map", 1.25)
    assert found["/scan/lidar"].decoded_message.ranges[2] == 2.25
    assert found["/tf_static"].decoded_message.transforms[0].child_frame_id == "ping"
    assert found["/pose"].message.publish_time == T_NS
    assert found["/pose"].message.log_time == T_NS + 1000


def test_rerun_finds_nothing_to_complain_of(tmp_path: Path) -> None:
    path = write(tmp_path / "all.mcap", MESSAGES)
    checked = subprocess.run(
        [sys.executable, "-m", "rerun", "mcap", "check", "--full", str(path)],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stderr
    lines = [line.split() for line in checked.stdout.splitlines()]
    status = {line[3]: line[0] for line in lines if len(line) > 3 and line[3].startswith("/")}
    assert status == dict.fromkeys({topic_of(m) for m in MESSAGES}, "ok")


def test_a_killed_recording_is_read_up_to_its_last_sync(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    program = textwrap.dedent("""
        import sys, time
        from pathlib import Path
        from recorder.geometry import SE2
        from recorder.messages import Pose
        from recorder.session import SessionWriter
        session = SessionWriter(Path(sys.argv[1]), live=True)
        for i in range(30):
            session.write(Pose(i, SE2(i, 0, 0)), log_ns=i)
        session.sync()
        print("synced", flush=True)
        sys.stdin.read()
    """)
    child = subprocess.Popen(
        [sys.executable, "-c", program, str(path)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == "synced\n"
        child.send_signal(signal.SIGKILL)
    session = read_session(path)
    assert [m.t_ns for m in session.messages()] == list(range(30))
    assert session.damage


def test_a_disk_that_is_slow_to_sync_costs_a_killed_recording_nothing_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system has what was written each second, although one sync takes for ever."""
    disk_done, asked = threading.Event(), threading.Event()

    def sync_of_a_slow_disk(descriptor: int) -> None:
        asked.set()
        disk_done.wait(60)

    path = tmp_path / "slow.mcap"
    with SessionWriter(path, live=True) as session:
        monkeypatch.setattr(os, "fsync", sync_of_a_slow_disk)
        session.write(Pose(T_NS, SE2(0.0, 0.0, 0.0)), log_ns=T_NS)
        assert asked.wait(60)
        for number in range(1, 4):
            session.write(Pose(T_NS + number, SE2(number, 0.0, 0.0)), log_ns=T_NS + number)
            deadline_s = time.monotonic() + 60
            while len(list(read_session(path).messages())) <= number:
                assert time.monotonic() < deadline_s, "it is not in the file"
                time.sleep(0.05)
        assert not disk_done.is_set()
        disk_done.set()


@pytest.mark.parametrize("content", [b"", b"nonsense\n" * 50, b"\x89MCAP0\r\n", bytes(4096)])
def test_what_is_no_session_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    with pytest.raises(BadInput) as caught:
        read_session(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
