"""The tracker: its units, its clock, and lines that no tracker should send."""

from __future__ import annotations

import json
import math
import threading

import pytest
from fake_links import Collector, ManualClock, ScriptedSource, TcpServer
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.clock import NS_PER_S, HostClock
from recorder.errors import BadInput, LinkError
from recorder.link import LinkEvent, LinkState, Received
from recorder.tracker import (
    MAX_LINE_BYTES,
    BadTrackerLine,
    TrackedPose,
    Tracker,
    open_tracker,
    read_pose,
)

NOW_NS = 1_700_000_000 * NS_PER_S
NOW_S = NOW_NS / NS_PER_S


def line(**fields: object) -> bytes:
    return json.dumps({"x": 1.0, "y": 2.0, "heading_deg": 90.0} | fields).encode()


def good(data: bytes, arrival_ns: int = NOW_NS, units_per_m: float = 1.0) -> TrackedPose:
    tracked = read_pose(data, arrival_ns, units_per_m)
    assert isinstance(tracked, TrackedPose), tracked
    return tracked


def test_metres_and_pixels() -> None:
    at = good(line(x=1.5, y=-2, heading_deg=-90)).pose.world_from_base
    assert (at.x_m, at.y_m) == (1.5, -2.0)
    assert at.heading_rad == pytest.approx(-math.pi / 2)
    at = good(line(x=450, y=300), units_per_m=300.0).pose.world_from_base
    assert (at.x_m, at.y_m) == (1.5, 1.0)


def test_headings_are_wrapped() -> None:
    assert good(line(heading_deg=270)).pose.world_from_base.heading_rad == pytest.approx(
        -math.pi / 2
    )


@pytest.mark.parametrize(
    ("t_s", "t_ns", "dated_by_arrival"),
    [
        (NOW_S - 0.25, NOW_NS - NS_PER_S // 4, False),
        (NOW_S, NOW_NS, False),
        (NOW_S + 0.25, NOW_NS, False),  # never later than its arrival
        (NOW_S - 3.0, NOW_NS, True),
        (NOW_S + 3.0, NOW_NS, True),
        (12.5, NOW_NS, True),  # seconds since the tracker was started
        (1e300, NOW_NS, True),
        ("noon", NOW_NS, True),
        (None, NOW_NS, True),
    ],
)
def test_its_time_is_used_while_it_is_plausible(
    t_s: object, t_ns: int, dated_by_arrival: bool
) -> None:
    tracked = good(line(t_s=t_s))
    assert tracked.pose.t_ns == t_ns
    assert tracked.arrival_ns == NOW_NS
    assert tracked.dated_by_arrival is dated_by_arrival


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"hello",
        b"[1, 2, 3]",
        b"null",
        b'{"x": 1, "y": 2}',
        b'{"x": 1, "y": 2, "heading_deg": NaN}',
        b'{"x": 1, "y": Infinity, "heading_deg": 0}',
        b'{"x": "1", "y": 2, "heading_deg": 0}',
        b'{"x": true, "y": 2, "heading_deg": 0}',
        b'{"x": 1e9, "y": 2, "heading_deg": 0}',
        b'{"x": 1, "y": 2, "heading_deg": 1e300}',
        b'{"x": 1' + b"0" * 400 + b', "y": 2, "heading_deg": 0}',
        b"[" * MAX_LINE_BYTES,
        b'{"x": \xff}',
        line(padding="x" * MAX_LINE_BYTES),
    ],
)
def test_lines_without_a_pose_are_reported_not_raised(data: bytes) -> None:
    assert isinstance(read_pose(data, NOW_NS), BadTrackerLine)


@given(st.binary(max_size=60))
@settings(deadline=None)
def test_no_bytes_raise(data: bytes) -> None:
    assert isinstance(read_pose(data, NOW_NS), BadTrackerLine)


def played(chunks: list[bytes | LinkEvent]) -> list[object]:
    clock = ManualClock(NOW_NS)
    events = [c if isinstance(c, LinkEvent) else Received(c, NOW_NS) for c in chunks]
    return list(Tracker(ScriptedSource(clock, events)).events(threading.Event()))


@given(st.lists(st.integers(1, 20), max_size=30))
@settings(deadline=None)
def test_how_the_bytes_arrive_does_not_matter(sizes: list[int]) -> None:
    stream = line(x=1) + b"\r\n\n" + line(x=2) + b"\nnoise\n" + line(x=3) + b"\n"
    chunks: list[bytes | LinkEvent] = []
    rest = stream
    for size in sizes:
        chunks.append(rest[:size])
        rest = rest[size:]
    events = played([*chunks, rest])
    assert [
        event.pose.world_from_base.x_m if isinstance(event, TrackedPose) else None
        for event in events
    ] == [1.0, 2.0, None, 3.0]


def test_half_a_line_does_not_join_the_next_connection() -> None:
    again = LinkEvent(LinkState.REOPENED, NOW_NS, "")
    events = played([b'{"x": 1, "y"', again, line(x=7) + b"\n"])
    assert events[0] == again
    (tracked,) = events[1:]
    assert isinstance(tracked, TrackedPose)
    assert tracked.pose.world_from_base.x_m == 7.0


def test_an_endless_line_takes_no_memory() -> None:
    events = played([b"x" * 1000] * 50 + [b"\n" + line() + b"\n"])
    assert isinstance(events[-1], TrackedPose)
    assert all(isinstance(event, BadTrackerLine) for event in events[:-1])
    assert len(events) == 50 // 2 + 1


def test_over_tcp_through_a_hang_up() -> None:
    server = TcpServer()
    tracker = open_tracker(f"tcp://127.0.0.1:{server.port}", clock=HostClock(), px_per_m=100.0)
    collector = Collector(tracker)  # type: ignore[arg-type]
    server.accept()
    server.send(line(x=100) + b"\n" + b'{"x": 2')
    with collector.changed:
        assert collector.changed.wait_for(lambda: len(collector.events) == 2, 20)
    server.hang_up()
    server.accept()
    server.send(line(x=300) + b"\n")
    with collector.changed:
        assert collector.changed.wait_for(lambda: len(collector.events) == 5, 20)
    collector.finish()
    server.close()
    poses = [event for event in collector.events if isinstance(event, TrackedPose)]
    assert [tracked.pose.world_from_base.x_m for tracked in poses] == [1.0, 3.0]
    assert collector.states == ["opened", "lost", "reopened"]


def test_addresses_and_scales_that_cannot_be() -> None:
    clock = ManualClock()
    for url in ("localhost:5000", "http://localhost:5000", "tcp://localhost"):
        with pytest.raises(BadInput):
            open_tracker(url, clock=clock)
    for px_per_m in (0.0, -300.0, math.nan):
        with pytest.raises(BadInput):
            open_tracker("udp://127.0.0.1:0", clock=clock, px_per_m=px_per_m)


def test_a_tracker_that_is_not_there() -> None:
    server = TcpServer()
    server.close()
    with pytest.raises(LinkError, match="nobody listens"):
        open_tracker(f"tcp://127.0.0.1:{server.port}", clock=ManualClock())
