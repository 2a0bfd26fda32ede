"""The serial protocol: round trips, any split of the stream, noise, and lines that lie."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.errors import BadInput
from recorder.protocols import PROTOCOLS
from recorder.protocols.echogrid import KINDS, MAX_LINE_BYTES, EchogridProtocol, encode
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

INT32 = st.integers(-(2**31), 2**31 - 1)
NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,15}", fullmatch=True)
TEXT = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="$*"))
WORDS = st.text(
    st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="$*,"),
    min_size=1,
    max_size=16,
)
RANGES_M = st.one_of(
    st.just(math.inf), st.just(-math.inf), st.integers(0, 10**6).map(lambda mm: mm / 1000.0)
)
ANGLES_RAD = INT32.map(lambda cdeg: math.radians(cdeg / 100.0))
METRES = INT32.map(lambda mm: mm / 1000.0)
REPORTS: st.SearchStrategy[Report] = st.one_of(
    st.builds(HelloReport, st.integers(0, 99), WORDS, WORDS),
    st.builds(RangeReport, NAMES, RANGES_M),
    st.builds(HeadReport, NAMES, ANGLES_RAD),
    st.builds(WheelReport, INT32, INT32),
    st.builds(PoseReport, METRES, METRES, ANGLES_RAD),
    st.builds(LogReport, TEXT.filter(lambda text: len(text) < 60)),
)
SEQS = st.integers(0, 2**16 - 1)
TIMES_MS = st.integers(0, 2**32 - 1)


def line(body: str | bytes) -> bytes:
    """A line with the right checksum around any body."""
    data = body.encode("ascii") if isinstance(body, str) else body
    return b"$" + data + b"*%08X\r\n" % zlib.crc32(data)


def only(data: bytes) -> Packet:
    (packet,) = EchogridProtocol().feed(data)
    return packet


def test_the_table_names_its_members() -> None:
    for name, protocol in PROTOCOLS.items():
        assert protocol.name == name
        assert protocol.default_baud > 0
        assert protocol().feed(b"") == []
        assert protocol().close() == []


@given(REPORTS, SEQS, TIMES_MS)
@settings(deadline=None)
def test_what_is_sent_is_what_is_read_byte_for_byte(report: Report, seq: int, ms: int) -> None:
    sent = encode(report, seq, ms)
    assert len(sent) <= MAX_LINE_BYTES
    packet = only(sent)
    assert (packet.seq, packet.device_ms, packet.fault) == (seq, ms, None)
    assert packet.raw == sent
    assert packet.report is not None
    assert encode(packet.report, seq, ms) == sent
    assert type(packet.report) is type(report)


@given(st.integers(0, 10**6), INT32, INT32)
@settings(deadline=None)
def test_values_survive_to_the_last_unit(mm: int, mm_signed: int, cdeg: int) -> None:
    angle_rad = math.radians(cdeg / 100.0)
    for report in (
        RangeReport("ping", mm / 1000.0),
        PoseReport(mm_signed / 1000.0, -0.0, angle_rad),
        HeadReport("head", angle_rad),
    ):
        assert only(encode(report, 0, 0)).report == report


def test_an_example_worked_by_hand() -> None:
    # CRC-32 of "123456789" is the published check value of this CRC
    assert line(b"123456789").endswith(b"*CBF43926\r\n")
    packet = only(line("RNG,7,12345,ping,523"))
    assert packet.report == RangeReport("ping", 0.523)
    assert (packet.seq, packet.device_ms) == (7, 12345)
    assert only(line("RNG,7,12345,ping,-1")).report == RangeReport("ping", math.inf)
    assert only(line("RNG,7,12345,ping,-2")).report == RangeReport("ping", -math.inf)
    assert only(line("HED,0,0,head,-9000")).report == HeadReport("head", -math.pi / 2)
    assert only(line("LOG,1,2,a, b, c")).report == LogReport("a, b, c")


def test_hex_of_either_case_and_a_lone_line_feed_are_taken() -> None:
    sent = encode(RangeReport("ping", 1.0), 1, 2)
    lower = sent[:-10] + sent[-10:].lower()
    assert lower != sent
    assert only(lower).report == RangeReport("ping", 1.0)
    assert only(sent.replace(b"\r", b"")).report == RangeReport("ping", 1.0)


@given(st.lists(st.one_of(st.builds(encode, REPORTS, SEQS, TIMES_MS), st.binary(max_size=120))))
@settings(deadline=None, max_examples=200)
def test_nothing_is_lost_and_how_the_bytes_arrive_does_not_matter(pieces: list[bytes]) -> None:
    stream = b"".join(pieces)
    whole, single = EchogridProtocol(), EchogridProtocol()
    at_once = whole.feed(stream) + whole.close()
    one_by_one = [p for byte in stream for p in single.feed(bytes([byte]))] + single.close()
    assert at_once == one_by_one
    assert b"".join(packet.raw for packet in at_once) == stream
    for packet in at_once:
        assert (packet.report is None) != (packet.fault is None)
        assert 0 < len(packet.raw) <= MAX_LINE_BYTES


def test_a_cut_line_costs_only_itself() -> None:
    good = encode(RangeReport("ping", 0.5), 3, 4)
    for cut in range(1, len(good) - 1):
        first, second = EchogridProtocol().feed(good[:cut] + good)
        assert first.raw == good[:cut]
        assert second.report == RangeReport("ping", 0.5)
        complete = cut >= good.index(b"*") + 9
        assert first.fault is (None if complete else Fault.CUT)
        (tail, after) = EchogridProtocol().feed(good[cut:] + good)
        assert tail.fault is Fault.NOISE
        assert after.report == RangeReport("ping", 0.5)


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"\r\n", Fault.NOISE),
        (b"hello\r\n", Fault.NOISE),
        (b"$\r\n", Fault.MALFORMED),
        (b"$RNG,1,2,ping,3\r\n", Fault.MALFORMED),
        (b"$RNG,1,2,ping,3*12\r\n", Fault.MALFORMED),
        (b"$RNG,1,2,ping,3*0000000G\r\n", Fault.MALFORMED),
        (b"$RNG,1,2,ping,3*00000000\r\n", Fault.BAD_CHECKSUM),
        (line("RNG,1,2,ping,3")[:-2] + b" \r\n", Fault.MALFORMED),
        (line("RNG,65536,2,ping,3"), Fault.MALFORMED),
        (line("RNG,-1,2,ping,3"), Fault.MALFORMED),
        (line("RNG,1,4294967296,ping,3"), Fault.MALFORMED),
        (line("RNG,1,2,ping,-3"), Fault.MALFORMED),
        (line("RNG,1,2,ping,1.5"), Fault.MALFORMED),
        (line("RNG,1,2,ping,1e3"), Fault.MALFORMED),
        (line("RNG,1,2,ping,+3"), Fault.MALFORMED),
        (line("RNG,1,2,ping, 3"), Fault.MALFORMED),
        (line("RNG,1,2,ping,1_0"), Fault.MALFORMED),
        (line("RNG,1,2,ping,99999999999"), Fault.MALFORMED),
        (line("RNG,1,2,ping,"), Fault.MALFORMED),
        (line("RNG,1,2,ping"), Fault.MALFORMED),
        (line("RNG,1,2,ping,3,4"), Fault.MALFORMED),
        (line("RNG,1,2,pi/ng,3"), Fault.MALFORMED),
        (line("RNG,1,2,,3"), Fault.MALFORMED),
        (line("RNG,1"), Fault.MALFORMED),
        (line("rng,1,2,ping,3"), Fault.MALFORMED),
        (line(""), Fault.MALFORMED),
        (line(b"LOG,1,2,a\tb"), Fault.MALFORMED),
        (line(b"LOG,1,2,a\x00b"), Fault.MALFORMED),
        (line("LOG,1,2,é".encode()), Fault.MALFORMED),
        (line("RNG,1,2,ping,²".encode()), Fault.MALFORMED),
        (line("XYZ,1,2,3"), Fault.UNKNOWN_KIND),
        (line("XYZ,1,2"), Fault.UNKNOWN_KIND),
    ],
)
def test_what_is_wrong_is_named_and_kept(data: bytes, fault: Fault) -> None:
    packet = only(data)
    assert packet.fault is fault
    assert packet.report is None
    assert packet.raw == data


def test_sound_lines_without_a_report_still_count_in_the_sequence() -> None:
    assert (only(line("XYZ,9,8,1")).seq, only(line("XYZ,9,8,1")).device_ms) == (9, 8)
    assert only(line("RNG,9,8,ping,-3")).seq == 9
    assert only(b"$RNG,9,8,ping,3*00000000\r\n").seq is None


def test_the_longest_line_passes_and_one_byte_more_does_not() -> None:
    overhead = len(line("LOG,1,2,"))
    fits = line("LOG,1,2," + "x" * (MAX_LINE_BYTES - overhead))
    assert len(fits) == MAX_LINE_BYTES
    assert only(fits).report is not None
    over = line("LOG,1,2," + "x" * (MAX_LINE_BYTES - overhead + 1))
    assert [packet.fault for packet in EchogridProtocol().feed(over)] == [
        Fault.OVERLONG,
        Fault.NOISE,
    ]
    with pytest.raises(BadInput, match="longer than 96"):
        encode(LogReport("x" * (MAX_LINE_BYTES - overhead + 1)), 1, 2)


def test_endless_noise_takes_no_memory_and_ends_with_the_next_line() -> None:
    protocol = EchogridProtocol()
    count = sum(len(protocol.feed(b"x" * 1000)) for _ in range(100))
    assert count == 100_000 // MAX_LINE_BYTES
    *_, last = protocol.feed(encode(WheelReport(1, 2), 0, 0))
    assert last.report == WheelReport(1, 2)


def test_a_partial_line_is_a_fault_when_the_link_closes() -> None:
    protocol = EchogridProtocol()
    sent = encode(WheelReport(1, 2), 0, 0)
    assert protocol.feed(sent[:9]) == []
    assert protocol.close() == [Packet(sent[:9], fault=Fault.CUT)]
    assert [p.report for p in protocol.feed(sent)] == [WheelReport(1, 2)]


@pytest.mark.parametrize(
    "report",
    [
        RangeReport("pi,ng", 1.0),
        RangeReport("", 1.0),
        RangeReport("ping", math.nan),
        RangeReport("ping", -0.001),
        RangeReport("ping", -0.0001),
        RangeReport("ping", 1e300),
        PoseReport(math.inf, 0.0, 0.0),
        HeadReport("head", math.nan),
        WheelReport(2**31, 0),
        HelloReport(1, "a,b", "c"),
        HelloReport(-1, "a", "c"),
        LogReport("a$b"),
        LogReport("a*b"),
        LogReport("a\nb"),
        LogReport("é"),
    ],
)
def test_what_no_line_can_carry_is_refused(report: Report) -> None:
    with pytest.raises(BadInput):
        encode(report, 0, 0)


@pytest.mark.parametrize(("seq", "ms"), [(-1, 0), (65536, 0), (0, -1), (0, 2**32)])
def test_numbers_that_do_not_fit_are_refused(seq: int, ms: int) -> None:
    with pytest.raises(BadInput):
        encode(WheelReport(0, 0), seq, ms)


def test_every_report_has_exactly_one_kind() -> None:
    assert len({layout.report for layout in KINDS.values()}) == len(KINDS)
    assert {layout.report for layout in KINDS.values()} == set(Report.__args__)


@given(REPORTS, st.data())
@settings(deadline=None, max_examples=300)
def test_one_flipped_bit_never_passes_with_another_value(
    report: Report, data: st.DataObject
) -> None:
    sent = encode(report, 7, 8)
    bit = data.draw(st.integers(0, len(sent) * 8 - 1))
    noisy = bytearray(sent)
    noisy[bit // 8] ^= 1 << (bit % 8)
    for packet in EchogridProtocol().feed(bytes(noisy)):
        assert packet.report is None or (packet.report, packet.seq) == (only(sent).report, 7)


def corrupted(stream: bytes, rate: float, rng: np.random.Generator) -> bytes:
    """Flips a bit of, deletes, or inserts a byte before, a share ``rate`` of all bytes."""
    data = np.frombuffer(stream, np.uint8)
    hit = rng.random(len(data)) < rate
    what = rng.integers(0, 3, len(data))
    flipped = np.where(hit & (what == 0), data ^ (1 << rng.integers(0, 8, len(data))), data)
    kept = ~(hit & (what == 1))
    inserted = hit & (what == 2)
    positions = np.flatnonzero(inserted)
    noise = rng.integers(0, 256, len(positions))
    order = np.argsort(np.concatenate([np.flatnonzero(kept), positions - 0.5]), kind="stable")
    return np.concatenate([flipped[kept], noise])[order].astype(np.uint8).tobytes()


def test_noise_never_passes_with_a_wrong_value() -> None:
    seed = np.random.SeedSequence().entropy  # fresh each run, and printed when it fails
    rng = np.random.default_rng(seed)
    count = 100_000
    ranges_mm = rng.integers(-2, 5000, count).tolist()
    wheels = rng.integers(-(2**31), 2**31, (count, 2)).tolist()
    bodies = [
        f"RNG,{i & 0xFFFF},{i},ping,{ranges_mm[i]}"
        if i % 2
        else f"WHL,{i & 0xFFFF},{i},{wheels[i][0]},{wheels[i][1]}"
        for i in range(count)
    ]
    sent = [line(body) for body in bodies]
    protocol = EchogridProtocol()
    right = 0
    for packet in protocol.feed(corrupted(b"".join(sent), 0.01, rng)):
        if packet.report is None:
            continue
        assert packet.device_ms is not None
        original = only(sent[packet.device_ms])
        assert (packet.report, packet.seq) == (original.report, original.seq), f"seed {seed}"
        right += 1
    assert count - right > 25_000, "fewer lines than meant were corrupted"
    assert right > 0.6 * count, "noise cost more than the lines that it hit"
