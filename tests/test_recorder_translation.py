"""From packets to messages: times, sequence numbers, restarts, sensors and wheels."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.clock import NS_PER_MS, NS_PER_S
from recorder.geometry import SE2
from recorder.link import LinkEvent, LinkState
from recorder.messages import (
    Message,
    Odometry,
    Pose,
    Radiation,
    Range,
    RawLine,
    Transform,
)
from recorder.odometry import WheelGeometry
from recorder.protocols.echogrid import EchogridProtocol, encode
from recorder.protocols.reports import (
    Fault,
    HeadReport,
    HelloReport,
    LogReport,
    Packet,
    PoseReport,
    RangeReport,
    Report,
    WheelReport,
)
from recorder.sensors import SensorParameters
from recorder.tracker import BadTrackerLine, TrackedPose
from recorder.translation import RecordingCounters, Translator

NOW_NS = 1_700_000_000 * NS_PER_S
PING = RangeReport("ping", 1.0)


def packet(report: Report, seq: int | None = 0, ms: int | None = 0) -> Packet:
    return Packet(b"as it came", report, seq, ms)


def translated(translator: Translator, report: Report, seq: int = 0, ms: int = 0) -> list[Message]:
    """Everything but the raw line."""
    pairs = list(translator.packet(packet(report, seq, ms), NOW_NS + ms * NS_PER_MS))
    assert all(log_ns == NOW_NS + ms * NS_PER_MS for log_ns, _ in pairs)
    assert pairs[0][1] == RawLine(NOW_NS + ms * NS_PER_MS, "as it came")
    return [message for _, message in pairs[1:]]


def test_one_line_may_carry_several_things() -> None:
    translator = Translator()
    packet = Packet(
        b"1,50,,30\n",
        RangeReport("ping", 0.5),
        device_ms=1,
        more=(RangeReport("dirrs", 0.3),),
        invalid=1,
    )
    raw, *messages = [message for _, message in translator.packet(packet, NOW_NS)]
    assert raw == RawLine(NOW_NS, "1,50,,30\n")
    assert [(m.sensor, m.range_m, m.t_ns) for m in messages if isinstance(m, Range)] == [
        ("ping", 0.5, NOW_NS),
        ("dirrs", 0.3, NOW_NS),
    ]
    assert translator.tally["received"] == 1
    assert translator.tally["invalid_values"] == 1


def test_every_fault_has_a_counter() -> None:
    names = {field.name for field in dataclasses.fields(RecordingCounters)}
    assert {fault.value for fault in Fault} <= names


def test_ranges_carry_what_is_known_of_their_sensor() -> None:
    translator = Translator()
    assert translated(translator, RangeReport("ping", math.inf)) == [
        Range(NOW_NS, "ping", math.inf, math.radians(38), 0.02, 4.0, Radiation.ULTRASOUND)
    ]
    assert translated(translator, RangeReport("dirrs", -math.inf), 1) == [
        Range(NOW_NS, "dirrs", -math.inf, math.radians(6), 0.1, 0.8, Radiation.INFRARED)
    ]
    assert translator.tally["unknown_sensors"] == 0


def test_unknown_sensors_get_defaults_and_are_counted_by_name() -> None:
    translator = Translator()
    for seq, name in enumerate(["left", "right", "left"]):
        (message,) = translated(translator, RangeReport(name, 0.5), seq)
        assert message == Range(
            NOW_NS, name, 0.5, math.radians(38), 0.02, 4.0, Radiation.ULTRASOUND
        )
    assert translator.tally["unknown_sensors"] == 2


def test_given_sensors_go_before_the_built_in_ones() -> None:
    mine = SensorParameters(0.5, 0.03, 3.0, Radiation.ULTRASOUND)
    translator = Translator(sensors={"ping": mine, "front": mine})
    for seq, name in enumerate(["ping", "front"]):
        (message,) = translated(translator, RangeReport(name, 1.0), seq)
        assert isinstance(message, Range)
        assert (message.beam_width_rad, message.max_range_m) == (0.5, 3.0)
    assert translator.tally["unknown_sensors"] == 0


def test_the_other_reports() -> None:
    translator = Translator()
    assert translated(translator, HeadReport("head", 0.5)) == [
        Transform(NOW_NS, "base_link", "head", SE2(0.0, 0.0, 0.5), static=False)
    ]
    assert translated(translator, PoseReport(1.0, 2.0, 3.0), 1) == [
        Pose(NOW_NS, SE2(1.0, 2.0, 3.0))
    ]
    assert translated(translator, LogReport("hello"), 2) == []
    assert translated(translator, WheelReport(1, 2), 3) == []  # the size of the wheels is not known
    hello = HelloReport(1, "boe", "1.0")
    assert translated(translator, hello, 4) == []
    assert translator.hello == hello
    assert translator.tally["received"] == 5


def test_wheel_counts_become_odometry_and_a_restart_moves_nothing() -> None:
    translator = Translator(wheels=WheelGeometry(ticks_per_m=1000.0, track_m=0.1))
    translated(translator, WheelReport(0, 0), 10, 5000)
    (message,) = translated(translator, WheelReport(500, 500), 11, 5100)
    assert message == Odometry(NOW_NS + 5100 * NS_PER_MS, SE2(0.5, 0.0, 0.0))
    (pair,) = list(translator.packet(packet(WheelReport(7, 7), 0, 20), NOW_NS + 6 * NS_PER_S))[1:]
    assert pair[1] == Odometry(NOW_NS + 6 * NS_PER_S, SE2(0.5, 0.0, 0.0))
    assert translator.tally["device_restarts"] == 1


def test_bad_lines_are_kept_as_they_came_and_counted() -> None:
    translator = Translator()
    raw = bytes(range(256))
    for fault in Fault:
        ((log_ns, message),) = translator.packet(Packet(raw, fault=fault), NOW_NS)
        assert log_ns == NOW_NS
        assert isinstance(message, RawLine)
        assert message.text.encode("latin-1") == raw
        assert translator.tally[fault.value] == 1
    assert translator.tally["received"] == 0


@given(
    st.integers(0, 2**16 - 1),
    st.lists(st.booleans(), min_size=2, max_size=60),
    st.integers(0, 2**32 - 1),
)
@settings(deadline=None)
def test_gaps_are_the_lines_missing_between_the_first_and_the_last_received(
    first_seq: int, received: list[bool], first_ms: int
) -> None:
    translator = Translator()
    for i, arrives in enumerate(received):
        if arrives:
            one = packet(PING, (first_seq + i) % 2**16, (first_ms + 50 * i) % 2**32)
            list(translator.packet(one, NOW_NS + 50 * i * NS_PER_MS))
    indices = [i for i, arrives in enumerate(received) if arrives]
    missing = indices[-1] - indices[0] + 1 - len(indices) if indices else 0
    assert translator.tally["gaps"] == missing
    assert translator.tally["device_restarts"] == 0
    assert translator.tally["duplicates"] == 0


def test_a_line_with_a_bad_checksum_is_also_a_gap() -> None:
    translator = Translator()
    protocol = EchogridProtocol()
    lines = [encode(PING, seq, 50 * seq) for seq in range(3)]
    lines[1] = lines[1].replace(b"1000", b"1001")
    for one in protocol.feed(b"".join(lines)):
        list(translator.packet(one, NOW_NS))
    assert (translator.tally["bad_checksum"], translator.tally["gaps"]) == (1, 1)


def test_sound_lines_of_unknown_kinds_are_no_gap() -> None:
    translator = Translator()
    list(translator.packet(packet(PING, 1, 10), NOW_NS))
    unknown = Packet(b"", None, 2, 20, Fault.UNKNOWN_KIND)
    list(translator.packet(unknown, NOW_NS))
    list(translator.packet(packet(PING, 3, 30), NOW_NS))
    assert translator.tally["gaps"] == 0
    assert translator.tally["unknown_kind"] == 1


def test_a_line_that_came_twice() -> None:
    translator = Translator()
    for _ in range(2):
        list(translator.packet(packet(PING, 1, 10), NOW_NS))
    assert (translator.tally["duplicates"], translator.tally["gaps"]) == (1, 0)


@pytest.mark.parametrize("last_seq", [5, 700, 40_000, 65_535])
def test_a_restart_is_no_gap(last_seq: int) -> None:
    translator = Translator()
    list(translator.packet(packet(PING, last_seq, 600_000), NOW_NS))
    for seq in range(3):
        list(translator.packet(packet(PING, seq, 10 + seq), NOW_NS + NS_PER_S))
    assert translator.tally["device_restarts"] == 1
    assert translator.tally["gaps"] == 0


def test_a_restart_that_only_the_numbers_show() -> None:
    # up for 1 s, off for 5 s, and received after the boot: its clock seems to go on
    translator = Translator()
    list(translator.packet(packet(PING, 20, 1000), NOW_NS))
    pairs = list(translator.packet(packet(PING, 5, 3000), NOW_NS + 7 * NS_PER_S))
    assert translator.tally["device_restarts"] == 1
    assert translator.tally["gaps"] == 0
    assert isinstance(pairs[1][1], Range)
    assert pairs[1][1].t_ns == NOW_NS + 7 * NS_PER_S
    later = list(translator.packet(packet(PING, 6, 3050), NOW_NS + 7 * NS_PER_S + 60 * NS_PER_MS))
    assert isinstance(later[1][1], Range)
    assert later[1][1].t_ns == NOW_NS + 7 * NS_PER_S + 50 * NS_PER_MS


def test_forty_thousand_missing_lines_are_no_restart() -> None:
    translator = Translator()
    list(translator.packet(packet(PING, 20, 1000), NOW_NS))
    half_an_hour_ms = 2_000_000
    after = packet(PING, 40_020, 1000 + half_an_hour_ms + 100)
    list(translator.packet(after, NOW_NS + half_an_hour_ms * NS_PER_MS))
    assert translator.tally["device_restarts"] == 0
    assert translator.tally["gaps"] == 39_999


def test_the_measurement_is_dated_by_the_device() -> None:
    translator = Translator()
    for i in range(20):
        list(translator.packet(packet(PING, i, 50 * i), NOW_NS + 50 * i * NS_PER_MS))
    late_ns = NOW_NS + 1000 * NS_PER_MS + 30 * NS_PER_MS
    (raw, (log_ns, message)) = translator.packet(packet(PING, 20, 1000), late_ns)
    assert log_ns == raw[0] == late_ns
    assert isinstance(message, Range)
    assert message.t_ns == NOW_NS + 1000 * NS_PER_MS


def test_a_protocol_without_times_or_numbers_is_dated_by_its_arrival() -> None:
    translator = Translator()
    for i in range(3):
        (_, (log_ns, message)) = translator.packet(packet(PING, None, None), NOW_NS + i)
        assert isinstance(message, Range)
        assert message.t_ns == log_ns == NOW_NS + i
    assert translator.tally["gaps"] == 0


def test_links_and_the_tracker_are_counted() -> None:
    translator = Translator()
    for state in (LinkState.OPENED, LinkState.LOST, LinkState.REOPENED):
        translator.link_event(LinkEvent(state, NOW_NS, ""))
        assert list(translator.tracker_event(LinkEvent(state, NOW_NS, ""))) == []
    assert list(translator.tracker_event(BadTrackerLine("why"))) == []
    pose = Pose(NOW_NS - 5, SE2(1.0, 2.0, 0.0))
    assert list(translator.tracker_event(TrackedPose(pose, NOW_NS, True))) == [(NOW_NS, pose)]
    assert +translator.tally == {
        "reconnects": 1,
        "tracker_reconnects": 1,
        "tracker_bad_lines": 1,
        "poses": 1,
        "tracker_dated_by_arrival": 1,
    }
