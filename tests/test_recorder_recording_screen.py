"""What a recording shows and heeds: the screen, pauses, and a protocol that talks back."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest
from fake_links import ManualClock, ScriptedSource
from scripted_recordings import START_NS, ListSession, ping_line, play, steady_run

from recorder.clock import NS_PER_S
from recorder.geometry import SE2
from recorder.link import LinkEvent, LinkState, Received
from recorder.messages import Diagnostics, Range, RawLine, Transform
from recorder.protocols.echogrid import EchogridProtocol, encode
from recorder.protocols.reports import HelloReport, Packet
from recorder.recording import RecordingStatus, record


def test_status_for_the_screen() -> None:
    seen: list[RecordingStatus] = []
    session = ListSession()
    play(
        [*steady_run(5.0), Received(encode(HelloReport(1, "boe", "2"), 100, 5001), START_NS)],
        session,
        on_status=seen.append,
    )
    assert len(seen) >= 5
    assert seen[2].link_up
    assert seen[2].latest["ping"].range_m > seen[1].latest["ping"].range_m
    assert seen[2].rate_hz["ping"] == pytest.approx(20.0, abs=2.0)
    assert seen[2].elapsed_s == pytest.approx(3.0, abs=0.2)
    assert seen[-1].counters.received == 101
    assert session.of(Diagnostics)[-1].counters["robot"] == "boe"


def test_the_screen_may_be_drawn_more_often_than_counters_are_written() -> None:
    seen: list[RecordingStatus] = []
    session = ListSession()
    play(steady_run(4.0), session, on_status=seen.append, status_period_s=0.2)
    assert 18 <= len(seen) <= 22
    assert len(session.of(Diagnostics)) <= 6
    assert seen[12].rate_hz["ping"] == pytest.approx(20.0, abs=2.0)
    assert seen[-1].missing == {"ping": 0}


def test_the_screen_shows_which_sensor_misses_readings() -> None:
    seen: list[RecordingStatus] = []
    events = steady_run(4.0)
    del events[50:53]
    counters = play(events, ListSession(), on_status=seen.append)
    assert counters.gaps == 3
    assert seen[-1].missing == {"ping": 3}


def test_while_paused_all_is_counted_and_nothing_written_but_that_it_is_paused() -> None:
    pause, session = threading.Event(), ListSession()

    def press_keys(status: RecordingStatus) -> None:
        if 1.0 <= status.elapsed_s < 2.0:
            pause.set()
        else:
            pause.clear()

    counters = play(
        steady_run(4.0), session, pause=pause, on_status=press_keys, status_period_s=0.05
    )
    assert counters.received == 80
    assert counters.gaps == 0
    assert counters.pauses == 1
    assert 18 <= counters.paused_messages <= 22
    assert len(session.of(Range)) == len(session.of(RawLine)) == 80 - counters.paused_messages
    states = [(one.t_ns, one.counters["state"]) for one in session.of(Diagnostics)]
    begin_ns = min(t_ns for t_ns, state in states if state == "paused")
    end_ns = min(t_ns for t_ns, state in states if state == "recording" and t_ns > begin_ns)
    assert end_ns - begin_ns == pytest.approx(NS_PER_S, abs=0.11 * NS_PER_S)
    inside = [m for log_ns, m in session.written if begin_ns < log_ns < end_ns]
    assert all(isinstance(message, Diagnostics) for message in inside)
    assert counters.written == len(session.written)


def test_a_recording_can_begin_paused() -> None:
    pause, session = threading.Event(), ListSession()
    pause.set()
    counters = play(
        steady_run(1.0), session, pause=pause, mounts=[Transform(0, "a", "b", SE2(0.0, 0.0, 0.0))]
    )
    assert counters.received == counters.paused_messages == 20
    assert session.of(Range) == []
    assert len(session.of(Transform)) == 1, "where the sensors sit is known from the beginning"
    assert {one.counters["state"] for one in session.of(Diagnostics)} == {"paused"}


class Chatty(EchogridProtocol):
    """Greets until something is received, and answers each hello."""

    def __init__(self) -> None:
        super().__init__()
        self._received = False

    def feed(self, data: bytes) -> list[Packet]:
        packets = super().feed(data)
        self._received |= bool(packets)
        return [
            replace(packet, reply=b"go") if isinstance(packet.report, HelloReport) else packet
            for packet in packets
        ]

    def greeting(self) -> bytes:
        return b"" if self._received else b"hello?"


def test_a_protocol_may_greet_and_answer() -> None:
    sent: list[bytes] = []
    clock = ManualClock(START_NS)
    later = START_NS + 3 * NS_PER_S
    events: list[Received | LinkEvent] = [
        LinkEvent(LinkState.OPENED, START_NS, ""),
        LinkEvent(LinkState.LOST, START_NS + NS_PER_S // 2, ""),
        LinkEvent(LinkState.REOPENED, START_NS + NS_PER_S, ""),
        Received(b"", later),
        Received(encode(HelloReport(1, "boe", "2"), 0, 0), later),
        Received(ping_line(1, 50), later + 2 * NS_PER_S),
    ]
    record(
        ScriptedSource(clock, events),
        ListSession(),
        protocol=Chatty(),
        clock=clock,
        stop=threading.Event(),
        send=sent.append,
    )
    assert sent[0] == b"hello?", "when the link opens"
    assert sent[1] == b"hello?", "when it opens again"
    assert sent[-2:] == [b"hello?", b"go"], "each second, until it is received"
    assert set(sent[1:-1]) == {b"hello?"}


def test_a_protocol_that_fails_does_not_cost_the_bytes() -> None:
    class Broken(EchogridProtocol):
        def feed(self, data: bytes) -> list[Packet]:
            if b",10," in data:
                raise KeyError("a bug")
            return super().feed(data)

    clock, session = ManualClock(START_NS), ListSession()
    counters = record(
        ScriptedSource(clock, steady_run(1.0)),
        session,
        protocol=Broken(),
        clock=clock,
        stop=threading.Event(),
    )
    assert counters.received == 19
    assert counters.malformed == counters.gaps == 1
    assert session.of(RawLine)[10].text.encode() == ping_line(10, 500, 0.01)


def test_a_screen_that_fails_does_not_cost_the_recording() -> None:
    calls = []

    def broken(status: RecordingStatus) -> None:
        calls.append(status)
        raise BrokenPipeError

    session = ListSession()
    counters = play(steady_run(5.0), session, on_status=broken)
    assert len(calls) == 1
    assert counters.received == len(session.of(Range)) == 100
    assert counters.failure == ""
