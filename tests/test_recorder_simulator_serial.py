"""The simulated robot behind a real pseudo-terminal, and its tracker."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import select
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import serial

from recorder.errors import BadInput, LinkError
from recorder.messages import Pose
from recorder.protocols.echogrid import EchogridProtocol
from recorder.protocols.reports import (
    Fault,
    HeadReport,
    HelloReport,
    LogReport,
    Packet,
    RangeReport,
    WheelReport,
)
from recorder.simulator import serial_robot
from recorder.simulator.pseudo_terminal import LONGEST_WAIT_NS, PseudoTerminal
from recorder.simulator.robot import Robot
from recorder.simulator.rooms import ROOMS
from recorder.simulator.serial_robot import HELLO, Firmware, SerialRobot
from recorder.simulator.tracker_server import TrackerServer

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

ROOM = ROOMS["room"]


def endless(port: serial.Serial) -> Iterator[Packet]:
    """Packet after packet."""
    protocol = EchogridProtocol()
    while data := port.read(max(1, port.in_waiting)):
        yield from protocol.feed(data)
    raise AssertionError("the robot fell silent")


def listen(port: serial.Serial, count: int) -> list[Packet]:
    """The next ``count`` packets of the line."""
    return list(itertools.islice(endless(port), count))


def tracked(url: str, count: int) -> list[dict]:
    host, port = url.removeprefix("tcp://").split(":")
    with socket.create_connection((host, int(port)), timeout=10) as link, link.makefile() as lines:
        return [json.loads(line) for line in itertools.islice(lines, count)]


@pytest.fixture
def robot():
    with SerialRobot(ROOM, seed=3, speed=25.0, head_sweep_deg=40.0) as robot:
        yield robot


@pytest.fixture
def port(robot):
    with serial.Serial(robot.device, 115200, timeout=10, exclusive=True) as port:
        yield port


# --- the line


def test_it_reports_who_it_is_and_then_what_it_measures(robot, port):
    packets = endless(port)
    next(packet for packet in packets if packet.report is not None and packet.seq > 9)
    robot.restart()
    first = next(packet for packet in packets if packet.report == HELLO and packet.seq == 0)
    packets = [first, *itertools.islice(packets, 59)]
    assert all(packet.fault is None for packet in packets)
    assert isinstance(packets[1].report, LogReport)
    kinds = {type(packet.report) for packet in packets}
    assert kinds == {HelloReport, LogReport, RangeReport, HeadReport, WheelReport}
    assert [packet.seq for packet in packets] == list(range(60))
    times_ms = [packet.device_ms for packet in packets]
    assert times_ms == sorted(times_ms)
    assert {p.report.head for p in packets if isinstance(p.report, HeadReport)} == {"head"}


def test_the_line_carries_what_the_simulation_reports(monkeypatch):
    """The sequence number is that of the event a line holds: the robot starts before its reader."""
    monkeypatch.setattr(serial_robot, "HELLO_PERIOD_NS", 10**18)
    twin = (event.report for event in Robot(ROOM, seed=3, head_sweep_deg=40.0).events())
    sent = [HELLO, LogReport("boot")]
    with (
        SerialRobot(ROOM, seed=3, speed=10.0, head_sweep_deg=40.0) as robot,
        serial.Serial(robot.device, timeout=10) as port,
    ):
        packets = [packet for packet in listen(port, 300) if packet.report is not None]
    while len(sent) <= packets[-1].seq:
        sent += [report for report in [next(twin)] if not isinstance(report, Pose)]
    for packet in packets:
        match sent[packet.seq], packet.report:
            case RangeReport(sensor, range_m), RangeReport() as received:
                assert received.sensor == sensor
                assert received.range_m == pytest.approx(range_m, abs=0.00051)
            case HeadReport(head, angle_rad), HeadReport() as received:
                assert received.head == head
                assert received.angle_rad == pytest.approx(angle_rad, abs=0.0001)
            case expected, received:
                assert received == expected
    assert len(packets) > 250


def test_it_reports_again_who_it_is(monkeypatch):
    monkeypatch.setattr(serial_robot, "HELLO_PERIOD_NS", 20_000_000)
    with (
        SerialRobot(ROOM, speed=25.0) as robot,
        serial.Serial(robot.device, timeout=10) as port,
    ):
        hellos = [p for p in listen(port, 400) if p.report == HELLO]
    assert len(hellos) > 3
    assert all(19 <= b.device_ms - a.device_ms <= 30 for a, b in itertools.pairwise(hellos))


def test_the_counters_of_the_device_begin_at_its_boot_and_wrap():
    firmware = Firmware(0.0, np.random.default_rng(0))
    firmware.boot(1_000_000_000)
    protocol = EchogridProtocol()

    def packet_of(report, t_ns):
        (packet,) = protocol.feed(firmware.line(report, t_ns))
        return packet

    first = packet_of(WheelReport(60_000, 65_000), 1_250_000_000)
    assert (first.seq, first.device_ms, first.report) == (0, 250, WheelReport(0, 0))
    assert packet_of(WheelReport(1_000, 65_003), 1_300_000_000).report == WheelReport(6_536, 3)
    for _ in range(65_534):
        last = firmware.line(HELLO, 0)
    (packet,) = protocol.feed(last)
    assert (packet.seq, packet.device_ms) == (65_535, 0)
    assert packet_of(HELLO, 0).seq == 0
    assert packet_of(HELLO, 1_000_000_000 + (2**32 + 5) * 1_000_000).device_ms == 5
    firmware.boot(9_000_000_000)
    again = packet_of(WheelReport(7, 7), 9_001_000_000)
    assert (again.seq, again.device_ms, again.report) == (0, 1, WheelReport(0, 0))


def test_bad_bytes_cost_lines_and_nothing_else():
    with (
        SerialRobot(ROOM, speed=25.0, corrupt_rate=0.01) as robot,
        serial.Serial(robot.device, timeout=10) as port,
    ):
        packets = listen(port, 300)
    good = [packet for packet in packets if packet.report is not None]
    assert 100 < len(good) < 290
    assert {p.fault for p in packets} & {Fault.BAD_CHECKSUM, Fault.NOISE, Fault.CUT}
    assert [p.seq for p in good] == sorted({p.seq for p in good})


def test_unplugged_and_plugged_in_again(robot, port):
    last = listen(port, 20)[-1]
    robot.unplug()
    with pytest.raises(OSError):  # noqa: PT011 - what pyserial raises depends on the moment
        listen(port, 100_000)
    assert not os.path.lexists(robot.device)
    with pytest.raises(serial.SerialException):
        serial.Serial(robot.device)
    robot.unplug()
    robot.replug()
    robot.replug()
    with serial.Serial(robot.device, timeout=10) as again:
        packets = endless(again)
        first = next(packet for packet in packets if packet.report is not None)
        assert first.seq > last.seq
        robot.restart()
        hello = next(packet for packet in packets if packet.seq == 0)
        assert (hello.report, hello.device_ms) == (HELLO, 0)
        wheels = next(p.report for p in packets if isinstance(p.report, WheelReport))
        assert wheels == WheelReport(0, 0)
    assert robot.counts["losses"] < robot.counts["sent"]


def test_nobody_reads_and_the_robot_drives_on(robot):
    """It goes on sending poses, and who comes late gets new lines, not old ones."""
    before = robot.counts["sent"]
    while robot.counts["sent"] < before + 4000:
        tracked(robot.tracker_url, 5)
    with serial.Serial(robot.device, timeout=10) as port:
        first = next(p for p in endless(port) if p.report is not None)
    assert first.seq > 1000
    assert robot.counts["losses"] > 0


def test_the_host_may_talk_and_is_not_made_to_wait(robot, port):
    port.write_timeout = 10
    for _ in range(40):
        port.write(b"?" * 1000)
    assert any(packet.report is not None for packet in listen(port, 10))


def test_nothing_is_left_behind():
    def open_files():
        return sorted(os.listdir("/dev/fd"))

    threads, files = set(threading.enumerate()), open_files()
    with SerialRobot(ROOM, speed=25.0) as robot:
        tracked(robot.tracker_url, 2)
        folder = Path(robot.device).parent
        robot.unplug()
        robot.replug()
    assert set(threading.enumerate()) == threads
    assert open_files() == files
    assert not folder.exists()
    with contextlib.suppress(RuntimeError), SerialRobot(ROOM):
        raise RuntimeError
    assert set(threading.enumerate()) == threads
    assert open_files() == files


def test_a_device_name_of_one_s_own(tmp_path):
    name = tmp_path / "ttyROBOT"
    with SerialRobot(ROOM, speed=25.0, device=name) as robot:
        assert robot.device == str(name)
        assert name.is_symlink()
        files = sorted(os.listdir("/dev/fd"))
        with pytest.raises(LinkError, match="File exists"), SerialRobot(ROOM, device=name):
            pass
        assert sorted(os.listdir("/dev/fd")) == files
        assert name.is_symlink()
    assert not os.path.lexists(name)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"sensors": ("ping", "lidar")}, "no lidar"),
        ({"speed": 0.0}, "speed"),
        ({"speed": float("nan")}, "speed"),
        ({"corrupt_rate": 1.5}, "bad bytes"),
        ({"seed": -1}, "seed"),
        ({"sensors": ("png",)}, "did you mean 'ping'"),
    ],
)
def test_what_cannot_be_simulated_is_refused(options, reason):
    with pytest.raises(BadInput, match=reason):
        SerialRobot(ROOM, **options)


def test_a_terminal_throws_away_what_waited_too_long(tmp_path):
    terminal = PseudoTerminal(tmp_path / "tty")
    try:
        with (tmp_path / "tty").open("rb", buffering=0) as host:
            assert terminal.write(b"old\n", 0)
            assert select.select([host], [], [], 10)[0]  # it takes a moment to get there
            assert terminal.write(b"old too\n", LONGEST_WAIT_NS)
            assert not terminal.write(b"new\n", LONGEST_WAIT_NS + 1)
            assert select.select([host], [], [], 10)[0]
            assert host.read(100) == b"new\n"
        full = [terminal.write(b"x" * 1000, LONGEST_WAIT_NS + 3) for _ in range(200)]
        assert False in full
    finally:
        terminal.close()


def test_it_knows_where_its_sensors_sit(robot):
    """On the head, as it turns."""
    assert robot.mounts() == Robot(ROOM, seed=0, head_sweep_deg=40.0).mounts()
    assert {carrier for carrier, _ in robot.mounts().values()} == {"head"}


# --- the tracker


def test_the_tracker_reports_where_the_robot_is(robot):
    poses = tracked(robot.tracker_url, 20)
    now_s = time.time()
    assert all(set(pose) == {"t_s", "x", "y", "heading_deg"} for pose in poses)
    stamps_s = [pose["t_s"] for pose in poses]
    assert stamps_s == sorted(stamps_s)
    assert now_s - 30.0 < stamps_s[0] <= stamps_s[-1] <= now_s
    np.testing.assert_allclose(np.diff(stamps_s), 0.1 / 25.0, atol=1e-5)
    route_m = ROOM.route_m
    for pose in poses:
        assert route_m[:, 0].min() - 0.05 < pose["x"] < route_m[:, 0].max() + 0.05
        assert route_m[:, 1].min() - 0.05 < pose["y"] < route_m[:, 1].max() + 0.05
        assert -180.0 <= pose["heading_deg"] <= 180.0


def test_several_may_listen_and_leave(robot):
    first = tracked(robot.tracker_url, 3)
    host, port = robot.tracker_url.removeprefix("tcp://").split(":")
    assert host == "127.0.0.1"
    with socket.create_connection((host, int(port))) as rude:
        rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
    second = tracked(robot.tracker_url, 3)
    assert second[0]["t_s"] > first[-1]["t_s"]


def test_a_client_that_does_not_read_is_let_go():
    server = TrackerServer()
    host, port = server.url.removeprefix("tcp://").split(":")
    pose = Robot(ROOM, seed=0).world_from_base(0)
    try:
        with socket.create_connection((host, int(port)), timeout=10) as link:
            server.accept()
            for k in range(200_000):
                server.send(float(k), pose)
            received = b"".join(iter(lambda: link.recv(1 << 16), b""))
        lines = received.split(b"\n")
        stamps_s = [json.loads(line)["t_s"] for line in lines[:-1]]
        assert 100 < len(stamps_s) < 200_000
        assert stamps_s == [float(k) for k in range(len(stamps_s))]
    finally:
        server.close()
