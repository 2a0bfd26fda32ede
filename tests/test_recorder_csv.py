"""Rows of numbers: what columns can be, what a row carries, and what is reported of a bad one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.errors import BadInput
from recorder.protocols import make_protocol
from recorder.protocols.csv import Column, CsvProtocol, parse_columns
from recorder.protocols.reports import (
    Fault,
    HeadReport,
    LogReport,
    Packet,
    PoseReport,
    RangeReport,
    Report,
    WheelReport,
)
from recorder.simulator.firmwares import CSV_COLUMNS, CsvFirmware
from recorder.translation import Translator


def rows(columns: str, *lines: bytes) -> list[Packet]:
    """The packets of whole lines, after the first one that nobody trusts."""
    first, *packets = CsvProtocol(parse_columns(columns)).feed(b"\n" + b"\r\n".join([*lines, b""]))
    assert first.fault is Fault.NOISE
    return packets


def reports(packet: Packet) -> list[Report]:
    return [] if packet.report is None else [packet.report, *packet.more]


def test_a_row_worked_by_hand() -> None:
    columns = "t_ms,seq,ping:cm,dirrs:mm,head:deg,left,right,-"
    (packet,) = rows(columns, b"1250,65537,52.3,350,-90,1044,1039,junk")
    assert (packet.seq, packet.device_ms, packet.fault) == (1, 1250, None)
    assert reports(packet) == [
        HeadReport("head", -math.pi / 2),
        WheelReport(1044, 1039),
        RangeReport("ping", pytest.approx(0.523)),
        RangeReport("dirrs", pytest.approx(0.35)),
    ]


def test_a_robot_that_knows_where_it_is() -> None:
    (packet,) = rows("t_s,x:m,y:cm,heading:deg", b"1.5 1.25 80 90")
    assert packet.device_ms == 1500
    assert reports(packet) == [PoseReport(1.25, 0.8, math.pi / 2)]


@pytest.mark.parametrize("text", [b"1,50", b"1;50", b"1\t50", b"1, 50", b"  1   50 ", b"+1,5e1"])
def test_what_may_stand_between_numbers(text: bytes) -> None:
    (packet,) = rows("t_ms,ping:cm", text)
    assert (packet.device_ms, packet.report) == (1, RangeReport("ping", 0.5))


def test_a_sensor_that_sends_nothing_costs_only_itself() -> None:
    missing, nan, nothing, far = rows(
        "t_ms,ping:cm,dirrs:cm", b"1,,30", b"1,nan,30", b"1,0,-1", b"1,inf,30"
    )
    assert reports(missing) == reports(nan) == [RangeReport("dirrs", 0.3)]
    assert missing.invalid == nan.invalid == 1
    assert reports(nothing) == [RangeReport("ping", math.inf), RangeReport("dirrs", math.inf)]
    assert reports(far) == [RangeReport("ping", math.inf), RangeReport("dirrs", 0.3)]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        (b"", Fault.BLANK),
        (b"  ", Fault.BLANK),
        (b"t_ms,ping", Fault.HEADER),
        (b"Ready!", Fault.HEADER),
        (b"1,2,3", Fault.MALFORMED),
        (b"1", Fault.MALFORMED),
        (b"1,5x", Fault.MALFORMED),
        (b"1,ovf", Fault.MALFORMED),
        (b"x,5", Fault.MALFORMED),
        (b"1,1e300", Fault.MALFORMED),
        (b"1,1e9", Fault.MALFORMED),
        (b"-1,5", Fault.MALFORMED),
        (b"1,5\xff", Fault.MALFORMED),
        (b"1,0x10", Fault.MALFORMED),
        (b"1," + b"9" * 300, Fault.OVERLONG),
    ],
)
def test_what_is_wrong_is_counted_by_its_name(line: bytes, fault: Fault) -> None:
    first = rows("t_ms,ping:cm", line)[0]
    assert first.fault is fault
    assert first.report is None


def test_the_first_line_is_not_trusted_as_it_may_lack_its_beginning() -> None:
    protocol = CsvProtocol(parse_columns("t_ms,ping:cm"))
    first, second = protocol.feed(b"50,30\n1251,30\n")  # of "1250,30"
    assert first.fault is Fault.NOISE
    assert second.device_ms == 1251
    assert protocol.feed(b"1252,") == []
    assert protocol.close() == [Packet(b"1252,", fault=Fault.CUT)]
    assert [packet.fault for packet in protocol.feed(b"30\n1253,30\n")] == [Fault.NOISE, None]


@given(st.binary(max_size=400), st.lists(st.integers(1, 30), max_size=40))
@settings(deadline=None)
def test_any_bytes_in_any_pieces_give_the_same_packets(data: bytes, sizes: list[int]) -> None:
    data = data.replace(b"\x00", b"1,2\n")
    whole, pieces = (CsvProtocol(parse_columns("t_ms,ping:cm")) for _ in range(2))
    expected = whole.feed(data) + whole.close()
    packets, at = [], 0
    for size in [*sizes, len(data) + 1]:
        packets += pieces.feed(data[at : at + size])
        at += size
    assert packets + pieces.close() == expected
    assert b"".join(packet.raw for packet in expected) == data


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no column"),
        ("ping", "needs a unit"),
        ("ping:feet", "needs a unit"),
        ("ping:cm,ping:mm", "twice"),
        ("t_ms,t_s,ping:cm", "one time"),
        ("left,ping:cm", "right is missing"),
        ("x:m,y:m", "heading is missing"),
        ("x:m,y:m,heading:m", "cannot be in m"),
        ("x:deg,y:m,heading:deg", "cannot be in deg"),
        ("t_ms,seq,-", "no range"),
        ("t_ms:ms,ping:cm", "no column"),
        ("1:cm", "no column"),
    ],
)
def test_columns_that_cannot_be(text: str, reason: str) -> None:
    with pytest.raises(BadInput, match=reason) as caught:
        parse_columns(text)
    assert "\n" not in str(caught.value)


def test_columns_as_they_are_written() -> None:
    assert parse_columns("t_ms, ping:cm ,-") == (Column("t_ms"), Column("ping", "cm"), Column("-"))


def test_the_simulated_sketch_prints_what_its_columns_name() -> None:
    firmware = CsvFirmware(0.0, np.random.default_rng(0))
    printed = firmware.line(LogReport("boot"), 0)
    for ms, report in (
        (20, RangeReport("ping", 1.5)),
        (45, RangeReport("dirrs", math.inf)),
        (95, RangeReport("dirrs", 0.25)),
    ):
        printed += firmware.line(report, ms * 1_000_000)
    header, first, second = CsvProtocol(parse_columns(CSV_COLUMNS)).feed(b"\n" + printed)[1:]
    assert header.fault is Fault.HEADER
    assert (first.device_ms, second.device_ms) == (45, 95)
    assert reports(first) == [RangeReport("ping", 1.5), RangeReport("dirrs", math.inf)]
    assert reports(second) == [RangeReport("dirrs", 0.25)]


def test_columns_are_for_csv_alone() -> None:
    with pytest.raises(BadInput, match="--columns"):
        make_protocol("csv")
    with pytest.raises(BadInput, match="for csv"):
        make_protocol("rbc", "t_ms,ping:cm")
    with pytest.raises(BadInput, match="did you mean 'echogrid'"):
        make_protocol("ecogrid")
    assert not make_protocol("csv", "ping:cm").checked
    assert not make_protocol("rbc").checked
    assert make_protocol("echogrid").checked


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"50;41", "has not 3 fields"), (b"50,41cm,30x", "'30x' is no number"),
        (b"50,41,30kg", "'30kg' is no number"), (b"50,9e9,300", "out of range"),
        (b"50,41,300,1", "has not 3 fields"), (b"-5,41,300", "-5 ms is out of range"),
        (b"50,41 deg,300 mm", "deg is no unit of ping"), (b"12%,41,3", "'12%' is no number"),
    ],
)  # fmt: skip
def test_a_row_that_is_not_taken_says_why(line: bytes, why: str) -> None:
    (packet,) = rows("t_ms,ping:cm,dirrs:mm", line)
    assert packet.fault is Fault.MALFORMED
    assert why in packet.why
    translator = Translator()
    for each in (packet, Packet(b"x", fault=Fault.MALFORMED, why="later")):
        list(translator.packet(each, 1))
    assert translator.refused.startswith(f"'{line.decode()}': ")
    assert translator.refused.isprintable()


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_the_last_row_counts_when_it_has_its_end(end: bytes) -> None:
    protocol = CsvProtocol(parse_columns("ping:cm,t_ms"))
    packets = protocol.feed(b"1,1" + end + b"40,0" + end + b"41,50" + end) + protocol.close()
    assert [packet.fault for packet in packets] == [Fault.NOISE, None, None]
    assert b"".join(packet.raw for packet in packets) == (b"1,1%b40,0%b41,50%b" % (end, end, end))
    assert protocol.feed(b"42,100" + end + b"4")[0].fault is Fault.NOISE
