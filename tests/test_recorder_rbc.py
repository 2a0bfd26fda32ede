"""The course robot's bytes: hands are shaken, places lost and found, nonsense is no range."""

from __future__ import annotations

import math
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.clock import HostClock
from recorder.link import Link
from recorder.messages import Message, Range
from recorder.protocols.rbc import RbcProtocol, sensor_packet
from recorder.protocols.reports import Fault, HelloReport, LogReport, Packet, RangeReport
from recorder.recording import record
from recorder.simulator.firmwares import RbcFirmware
from recorder.simulator.rooms import load_room
from recorder.simulator.serial_robot import SerialRobot

BOTH = b"\x02\x05\x01\x04\x00\x96\x00\x23"  # 150 and 35 cm


def feed(data: bytes) -> list[Packet]:
    return RbcProtocol().feed(data)


def ranges_m(packets: list[Packet]) -> list[float]:
    reports = [r for p in packets if p.report is not None for r in (p.report, *p.more)]
    return [report.range_m for report in reports if isinstance(report, RangeReport)]


def test_a_packet_worked_by_hand() -> None:
    (packet,) = feed(BOTH)
    assert packet == Packet(BOTH, RangeReport("ping", 1.5), more=(RangeReport("dirrs", 0.35),))
    assert sensor_packet(150, 35) == BOTH


@given(st.integers(1, 500), st.integers(10, 80))
@settings(deadline=None)
def test_what_is_sent_is_read(sonar_cm: int, infrared_cm: int) -> None:
    expected = [cm / 100 for cm in (sonar_cm, infrared_cm) if cm != 111]
    assert ranges_m(feed(sensor_packet(sonar_cm, infrared_cm))) == expected


@pytest.mark.parametrize(
    ("sonar_cm", "infrared_cm", "expected", "invalid"),
    [
        (0, -1, [math.inf, math.inf], 0),
        (111, 50, [0.5], 1),
        (150, 111, [1.5], 1),
        (150, 80, [1.5, 0.8], 0),
        (150, 81, [1.5], 1),
        (150, 9, [1.5], 1),
        (150, 10, [1.5, 0.1], 0),
        (150, 255, [1.5], 1),
        (111, 255, [], 2),
    ],
)
def test_values_that_are_no_measurement(
    sonar_cm: int, infrared_cm: int, expected: list[float], invalid: int
) -> None:
    (packet,) = feed(sensor_packet(sonar_cm, infrared_cm))
    assert ranges_m([packet]) == expected
    assert packet.invalid == invalid
    assert packet.fault is None


@pytest.mark.parametrize(
    ("data", "report", "fault"),
    [
        (b"\x02\x01\x05hello", LogReport("hello"), None),
        (b"\x02\x04\x00", LogReport(""), None),
        (b"\x02\x07", LogReport("input on"), None),
        (b"\x02\x08", LogReport("input off"), None),
        (b"\x02\x09", LogReport("clear"), None),
        (b"\x02\x0c", LogReport("image reset"), None),
        (b"\x02\x05\x02\x03abc", None, Fault.UNKNOWN_KIND),
        (b"\x02\x05\x01\x02ab", None, Fault.UNKNOWN_KIND),
        (b"xyz", None, Fault.NOISE),
    ],
)
def test_other_packets(data: bytes, report: LogReport | None, fault: Fault | None) -> None:
    assert feed(data) == [Packet(data, report, fault=fault)]


@given(st.binary(max_size=200), st.lists(st.integers(1, 9), max_size=60))
@settings(deadline=None, max_examples=300)
def test_any_bytes_in_any_pieces_give_the_same_packets(data: bytes, sizes: list[int]) -> None:
    """It never raises, and nothing is thrown away."""
    data = data.replace(b"\x08", b"\x02\x05\x01\x04")  # more that looks like packets
    whole = RbcProtocol()
    expected = whole.feed(data) + whole.close()
    pieces, at, packets = RbcProtocol(), 0, []
    for size in [*sizes, len(data) + 1]:
        packets += pieces.feed(data[at : at + size])
        at += size
    packets += pieces.close()
    assert b"".join(packet.raw for packet in packets) == data
    good = [packet for packet in packets if packet.fault is None]
    assert good == [packet for packet in expected if packet.fault is None]


@given(st.integers(0, 7))
@settings(deadline=None)
def test_a_lost_byte_costs_two_packets_at_most_and_gives_no_wrong_value(lost: int) -> None:
    stream = BOTH * 2 + BOTH[:lost] + BOTH[lost + 1 :] + BOTH * 3
    found = ranges_m(feed(stream))
    assert set(found) == {1.5, 0.35}
    assert len(found) >= 8


def test_hands_are_shaken_until_packets_come() -> None:
    protocol = RbcProtocol()
    answered = Packet(b"\x08", HelloReport(0, "rbc", "unknown"), reply=b"\x0b")
    assert protocol.greeting() == b"\x0a"
    assert protocol.greeting() == b"\x0a"
    assert protocol.feed(b"\x08") == [answered]
    assert protocol.greeting() == b"\x0a"  # our 11 got lost: the robot sends nothing
    assert protocol.feed(b"\x08") == [answered]
    protocol.feed(BOTH)
    assert protocol.greeting() == b""
    assert protocol.feed(b"\x08") == [Packet(b"\x08", fault=Fault.NOISE)]


def test_a_robot_that_talks_already_is_left_alone() -> None:
    protocol = RbcProtocol()
    protocol.feed(BOTH)
    assert protocol.greeting() == b""


def test_a_robot_that_was_reset_is_greeted_anew() -> None:
    protocol = RbcProtocol()
    protocol.feed(b"\x08" + BOTH)
    for _ in range(20):
        assert protocol.greeting() == b""
        protocol.feed(BOTH)
    sent = [protocol.greeting() for _ in range(7)]
    assert sent == [b"", b"", b"", b"", b"", b"\x0a", b"\x0a"]
    assert protocol.feed(b"\x08")[0].reply == b"\x0b"


def test_after_the_link_was_lost_hands_are_shaken_anew() -> None:
    protocol = RbcProtocol()
    protocol.feed(BOTH + BOTH[:5])
    assert protocol.close() == [Packet(BOTH[:5], fault=Fault.CUT)]
    assert protocol.greeting() == b"\x0a"


def test_the_simulated_robot_wants_its_handshake() -> None:
    import numpy as np

    firmware = RbcFirmware(0.0, np.random.default_rng(0))
    ping, dirrs = RangeReport("ping", 1.5), RangeReport("dirrs", 0.35)
    assert firmware.line(ping, 0) + firmware.line(dirrs, 0) == b""
    assert firmware.receive(b"\x0b") == b""
    assert firmware.receive(b"x\x0a") == b"\x08"
    assert firmware.line(dirrs, 0) == b""
    assert firmware.receive(b"\x0b") == b""
    assert firmware.line(ping, 0) + firmware.line(dirrs, 0) == BOTH
    assert firmware.line(ping, 0) == b""
    assert firmware.line(ping, 0) == sensor_packet(150, 111)
    firmware.boot(0)
    assert firmware.line(dirrs, 0) == b""


class RangesUntil:
    """A session that keeps the readings and ends the recording when there are enough."""

    def __init__(self, enough: int, stop: threading.Event) -> None:
        self.readings: list[Range] = []
        self._enough, self._stop = enough, stop

    def write(self, message: Message, *, log_ns: int) -> None:
        if isinstance(message, Range):
            self.readings.append(message)
        if len(self.readings) >= self._enough:
            self._stop.set()

    def sync(self) -> None:
        pass


def test_it_is_recorded_over_a_real_line() -> None:
    """Without the handshake the robot would stay silent and this would wait in vain."""
    clock, stop = HostClock(), threading.Event()
    session = RangesUntil(40, stop)
    with SerialRobot(load_room("room"), speed=5.0, protocol="rbc") as robot:
        link = Link(robot.device, 9600, clock=clock)
        counters = record(
            link,
            session,
            protocol=RbcProtocol(),
            clock=clock,
            stop=stop,
            send=link.write,
            duration_s=60.0,
        )
    assert counters.ended == "stopped"
    assert {reading.sensor for reading in session.readings} == {"ping", "dirrs"}
    assert all(r.range_m == math.inf or 0.01 <= r.range_m <= 5.0 for r in session.readings)
    assert counters.malformed == counters.cut == 0
