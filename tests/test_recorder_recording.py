"""The recording loop: from the bytes of a device to a session, whatever goes wrong."""

from __future__ import annotations

import errno
import json
import threading
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from fake_links import ManualClock, PtyDevice, ScriptedSource, TcpServer
from scripted_recordings import START_NS, ListSession, ping_line, play, steady_run

from recorder.clock import NS_PER_MS, NS_PER_S, HostClock
from recorder.errors import LinkError
from recorder.geometry import SE2
from recorder.link import ByteSource, Link, LinkEvent, LinkState, Received
from recorder.messages import Diagnostics, Message, Odometry, Pose, Range, RawLine, Transform
from recorder.odometry import WheelGeometry
from recorder.protocols.echogrid import EchogridProtocol, encode
from recorder.protocols.reports import HelloReport, WheelReport
from recorder.recording import record
from recorder.simulator.robot import WHEELS
from recorder.simulator.rooms import load_room
from recorder.simulator.serial_robot import SerialRobot
from recorder.tracker import Tracker, open_tracker
from recorder.translation import RecordingCounters


class Background(threading.Thread):
    """A recording in a thread, as a test of real links needs it."""

    def __init__(self, source: ByteSource, session: ListSession, **options: Any) -> None:
        super().__init__(daemon=True)
        self.stop = threading.Event()
        self.counters = RecordingCounters()
        self._record: Callable[[], RecordingCounters] = lambda: record(
            source,
            session,
            protocol=EchogridProtocol(),
            stop=self.stop,
            **options,
        )
        self.start()

    def run(self) -> None:
        self.counters = self._record()

    def finish(self) -> RecordingCounters:
        self.stop.set()
        self.join(20)
        assert not self.is_alive()
        return self.counters


class WatchedLink:
    """A link that lets a test wait for what came in, and for its being opened again."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._changed = threading.Condition()
        self._data = b""
        self._reopened = False

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        for event in self._link.events(stop):
            with self._changed:
                if isinstance(event, Received):
                    self._data += event.data
                else:
                    self._reopened |= event.state is LinkState.REOPENED
                self._changed.notify_all()
            yield event

    def wait_for(self, data: bytes) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: data in self._data, timeout=20)

    def wait_until_reopened(self) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: self._reopened, timeout=20)


def test_everything_that_came_is_in_the_session() -> None:
    session = ListSession()
    counters = play(steady_run(10.0), session)
    assert [reading.range_m for reading in session.of(Range)] == [i / 1000 for i in range(200)]
    assert "".join(raw.text for raw in session.of(RawLine)).encode() == b"".join(
        event.data for event in steady_run(10.0) if isinstance(event, Received)
    )
    assert counters.received == 200
    assert counters.written == len(session.written)
    assert counters.ended == "the source ended"
    assert counters.failure == ""
    assert session.synced == 1


def test_arrival_and_measurement_are_both_kept() -> None:
    session = ListSession()
    play(steady_run(2.0), session)
    for i, (log_ns, reading) in enumerate(
        [(log_ns, message) for log_ns, message in session.written if isinstance(message, Range)]
    ):
        assert log_ns == START_NS + (50 * i + 4) * NS_PER_MS
        assert reading.t_ns == log_ns  # a delay that all lines have cannot be known


def test_counters_are_written_once_a_second_and_in_the_end() -> None:
    session = ListSession()
    counters = play(steady_run(10.0), session)
    diagnostics = session.of(Diagnostics)
    assert 10 <= len(diagnostics) <= 12
    received = [one.counters["received"] for one in diagnostics]
    assert received == sorted(received)
    assert received[-1] == 200
    assert diagnostics[-1].counters["written"] == counters.written - 1  # not counting itself
    times_ns = [one.t_ns for one in diagnostics]
    assert all(b - a >= NS_PER_S for a, b in pairwise(times_ns[:-1]))


def test_mounts_come_first_at_the_time_of_the_beginning() -> None:
    session = ListSession()
    mount = Transform(0, "base_link", "ping", SE2(0.044, 0.0, 0.0))
    play(steady_run(1.0), session, mounts=[mount])
    assert session.written[0] == (
        START_NS,
        Transform(START_NS, "base_link", "ping", SE2(0.044, 0.0, 0.0)),
    )


def test_the_duration_ends_it() -> None:
    session = ListSession()
    counters = play(steady_run(10.0), session, duration_s=3.0)
    assert counters.ended == "the time is over"
    assert len(session.of(Range)) == 60
    assert max(log_ns for log_ns, _ in session.written) <= START_NS + 3 * NS_PER_S


@pytest.mark.parametrize("room", [0, 1, 2, 57, 58])
def test_a_full_disk_ends_it_with_the_reason(room: int) -> None:
    session, whole = ListSession(room), ListSession()
    counters = play(steady_run(10.0), session)
    play(steady_run(10.0), whole)
    assert counters.failure == "No space left on device"
    assert counters.ended == "the session cannot be written"
    assert counters.written == room
    assert [message for _, message in session.written if not isinstance(message, Diagnostics)] == [
        message for _, message in whole.written if not isinstance(message, Diagnostics)
    ][: len(session.written) - len(session.of(Diagnostics))]


def test_a_disk_that_fails_at_the_last_moment() -> None:
    class NoSync(ListSession):
        def sync(self) -> None:
            raise OSError(errno.EIO, "Input/output error")

    assert play(steady_run(1.0), NoSync()).failure == "Input/output error"


def test_a_lost_link_and_a_restarted_device() -> None:
    first = steady_run(2.0)
    cut = START_NS + 2 * NS_PER_S
    events: list[Received | LinkEvent] = [
        *first,
        Received(ping_line(40, 2000)[:12], cut),
        LinkEvent(LinkState.LOST, cut + 1, "gone"),
        LinkEvent(LinkState.REOPENED, cut + NS_PER_S, ""),
        Received(ping_line(0, 3) + ping_line(1, 53), cut + 2 * NS_PER_S),
    ]
    session = ListSession()
    counters = play(events, session)
    assert counters.cut == 1
    assert counters.reconnects == 1
    assert counters.device_restarts == 1
    assert counters.gaps == 0
    assert counters.received == len(session.of(Range)) == 42
    diagnostics = session.of(Diagnostics)[-1]
    assert diagnostics.counters["reconnects"] == 1
    assert session.of(Range)[-1].t_ns <= cut + 2 * NS_PER_S


@pytest.mark.parametrize("step_s", [-3600, -3, 5, 86_400])
def test_a_clock_that_is_set_meanwhile_moves_no_reading(step_s: int) -> None:
    """NTP sets the host's clock in the middle; a tracker that reads that clock is dated by arrival.

    All else comes by the monotonic clock: rates and order are as if nobody had set anything.
    """
    wall, monotonic = [START_NS], [77]
    clock = HostClock(lambda: wall[0], lambda: monotonic[0])

    class Line:
        def events(self, stop: threading.Event) -> Iterator[Received]:
            for number in range(100):
                monotonic[0] += 50 * NS_PER_MS
                wall[0] += 50 * NS_PER_MS + (step_s * NS_PER_S if number == 50 else 0)
                yield Received(ping_line(number, 50 * number), clock.now_ns())
            sent_all.set()

    class Camera:
        def events(self, stop: threading.Event) -> Iterator[Received]:
            assert sent_all.wait(60)
            line = {"t_s": wall[0] / NS_PER_S, "x": 1.0, "y": 2.0, "heading_deg": 0.0}
            yield Received(json.dumps(line).encode() + b"\n", clock.now_ns())

    session, sent_all = ListSession(), threading.Event()
    counters = record(
        Line(), session, protocol=EchogridProtocol(), clock=clock, stop=threading.Event(),
        tracker=Tracker(Camera()),
    )  # fmt: skip
    arrivals_ns = [log_ns for log_ns, one in session.written if isinstance(one, Range)]
    assert {b - a for a, b in pairwise(arrivals_ns)} == {50 * NS_PER_MS}
    assert {b.t_ns - a.t_ns for a, b in pairwise(session.of(Range))} == {50 * NS_PER_MS}
    assert counters.device_restarts == counters.gaps == 0
    assert len(arrivals_ns) == 100
    assert counters.tracker_dated_by_arrival == len(session.of(Pose)) == 1


def test_the_line_that_our_own_stop_cuts_is_kept_but_is_no_fault() -> None:
    session = ListSession()
    counters = play([*steady_run(1.0), Received(b"$RNG,20", START_NS + NS_PER_S)], session)
    assert session.of(RawLine)[-1].text == "$RNG,20"
    assert counters.cut == 0


def test_wheels_and_a_robot_that_names_itself() -> None:
    events: list[Received | LinkEvent] = [
        Received(encode(HelloReport(1, "boe", "2"), 0, 0), START_NS),
        Received(encode(WheelReport(0, 0), 1, 10), START_NS + 10 * NS_PER_MS),
        Received(encode(WheelReport(50, 50), 2, 20), START_NS + 20 * NS_PER_MS),
    ]
    session = ListSession()
    play(events, session, wheels=WheelGeometry(ticks_per_m=100.0, track_m=0.1))
    assert [one.odom_from_base.x_m for one in session.of(Odometry)] == [0.0, 0.5]
    assert session.of(Diagnostics)[-1].counters["robot"] == "boe"


def test_poses_come_in_by_a_link_of_their_own() -> None:
    clock = ManualClock(START_NS)
    rows = [
        Received(b'{"x": %d, "y": 0, "heading_deg": 0}\nrubbish\n' % i, START_NS + i)
        for i in range(5)
    ]
    session = ListSession()
    taken = threading.Event()

    class AfterTheTracker(ScriptedSource):
        def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
            session.wait_for(Pose, 5)
            taken.set()
            yield from super().events(stop)

    counters = record(
        AfterTheTracker(clock, steady_run(1.0)),
        session,
        protocol=EchogridProtocol(),
        clock=clock,
        stop=threading.Event(),
        tracker=Tracker(ScriptedSource(clock, rows)),  # type: ignore[arg-type]
    )
    assert taken.is_set()
    assert counters.poses == 5
    assert counters.tracker_bad_lines == 5
    assert [pose.world_from_base.x_m for pose in session.of(Pose)] == [0, 1, 2, 3, 4]
    assert len(session.of(Range)) == 20


def test_a_link_that_cannot_be_opened_is_reported_in_one_line(tmp_path: Path) -> None:
    clock = HostClock()
    session = ListSession()
    with pytest.raises(LinkError, match="no such device"):
        record(
            Link(str(tmp_path / "nothing"), clock=clock),
            session,
            protocol=EchogridProtocol(),
            clock=clock,
            stop=threading.Event(),
        )


def test_a_source_with_a_bug_is_not_hidden_and_what_came_is_synced() -> None:
    clock = ManualClock(START_NS)

    class Buggy(ScriptedSource):
        def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
            yield from super().events(stop)
            raise ZeroDivisionError

    session = ListSession()
    with pytest.raises(ZeroDivisionError):
        record(
            Buggy(clock, steady_run(1.0)),
            session,
            protocol=EchogridProtocol(),
            clock=clock,
            stop=threading.Event(),
        )
    assert len(session.of(Range)) == 20
    assert session.synced == 1


def test_a_slow_disk_makes_the_link_wait_and_loses_nothing() -> None:
    gate = threading.Event()

    class Slow(ListSession):
        def write(self, message: Message, *, log_ns: int) -> None:
            assert gate.wait(20)
            super().write(message, log_ns=log_ns)

    clock = ManualClock(START_NS)
    count = 6000  # more than the queue holds
    produced = []

    class Watched(ScriptedSource):
        def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
            for event in super().events(stop):
                produced.append(event)
                if len(produced) == 2000:
                    gate.set()
                yield event

    session = Slow()
    events = steady_run(count / 200, rate_hz=200)
    counters = record(
        Watched(clock, events),
        session,
        protocol=EchogridProtocol(),
        clock=clock,
        stop=threading.Event(),
    )
    assert counters.received == count
    assert [one.range_m for one in session.of(Range)] == [i / 1000 for i in range(count)]


def test_an_hour_of_200_readings_a_second_and_the_wraps_in_it() -> None:
    class CountingSession(ListSession):
        count = 0

        def write(self, message: Message, *, log_ns: int) -> None:
            self.count += isinstance(message, Range)

    clock = ManualClock(START_NS)
    count = 3600 * 200 // 10  # a tenth, with ten lines in each piece that is read

    class Hour:
        def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
            for piece in range(count // 10):
                lines = range(10 * piece, 10 * piece + 10)
                data = b"".join(ping_line(i, 50 * i) for i in lines)
                clock.t_ns = START_NS + 50 * lines[-1] * NS_PER_MS
                yield Received(data, clock.t_ns)

    session = CountingSession()
    counters = record(
        Hour(), session, protocol=EchogridProtocol(), clock=clock, stop=threading.Event()
    )
    assert counters.received == session.count == count > 2**16
    assert counters.gaps == counters.device_restarts == counters.duplicates == 0


def test_a_device_and_a_tracker_in_real_time(tmp_path: Path) -> None:
    """A pseudo-terminal that is noisy, unplugged and replugged; a TCP tracker that hangs up."""
    device, server, clock = PtyDevice(tmp_path / "robot"), TcpServer(), HostClock()
    device.plug()
    session = ListSession()
    link = Link(str(device.path), clock=clock)
    link.open()
    tracker = open_tracker(f"tcp://127.0.0.1:{server.port}", clock=clock)
    server.accept()
    watched = WatchedLink(link)
    recording = Background(watched, session, clock=clock, tracker=tracker)

    device.write(b"rest of a line\r\n" + ping_line(0, 0) + ping_line(1, 50)[:-3])
    device.write(ping_line(1, 50)[-3:] + b"$XYZ,2,60*00000000\r\n" + ping_line(3, 100))
    pose = {"t_s": clock.now_ns() / 1e9, "x": 1, "y": 2, "heading_deg": 3}
    server.send(json.dumps(pose).encode() + b"\n")
    session.wait_for(Range, 3)
    session.wait_for(Pose, 1)
    device.write(ping_line(4, 150)[:10])
    watched.wait_for(ping_line(4, 150)[:10])
    device.unplug()
    server.hang_up()
    server.accept()
    device.plug()
    watched.wait_until_reopened()
    server.send(b'{"x": 4, "y": 5, "heading_deg": 6}\n')
    device.write(ping_line(0, 2))
    session.wait_for(Range, 4)
    session.wait_for(Pose, 2)
    counters = recording.finish()
    device.unplug()
    server.close()

    assert counters.ended == "stopped"
    assert counters.received == 4
    assert (counters.noise, counters.bad_checksum, counters.cut) == (1, 1, 1)
    assert (counters.reconnects, counters.tracker_reconnects) == (1, 1)
    assert counters.gaps == 1
    assert counters.device_restarts == 1
    assert counters.poses == 2
    assert counters.failure == ""
    assert session.synced == 1
    log_times_ns = [log_ns for log_ns, message in session.written if isinstance(message, RawLine)]
    assert log_times_ns == sorted(log_times_ns)


def test_the_simulated_robot_is_recorded_like_any_other() -> None:
    clock, session = HostClock(), ListSession()
    with SerialRobot(load_room("room"), speed=5.0, corrupt_rate=0.002) as robot:
        link = Link(robot.device, clock=clock)
        link.open()
        tracker = open_tracker(robot.tracker_url, clock=clock)
        options: dict[str, Any] = {"clock": clock, "tracker": tracker, "wheels": WHEELS}
        recording = Background(link, session, **options)
        session.wait_for(Range, 60)
        robot.restart()
        session.wait_for(Range, 120)
        session.wait_for(Pose, 20)
        counters = recording.finish()
        sent = robot.counts["sent"]
    assert counters.failure == ""
    assert counters.device_restarts == 1
    assert 0 < counters.bad_checksum + counters.malformed < counters.received
    assert counters.received + counters.gaps <= sent
    assert counters.tracker_bad_lines == counters.tracker_dated_by_arrival == 0
    assert {one.sensor for one in session.of(Range)} == {"ping", "dirrs"}
    assert len(session.of(Odometry)) > 10
    for log_ns, message in session.written:
        assert 0 <= log_ns - message.t_ns < NS_PER_S


@pytest.mark.parametrize("flood", [b"\n", b"$", b"noise", b"\xff\x00", b"$RNG,1\n", b"\r\n"])
def test_a_flood_of_what_is_no_line_is_counted_and_not_all_kept(flood: bytes) -> None:
    data = (flood * 4096)[:4096]
    events: list[Received | LinkEvent] = [
        Received(data, START_NS + i * NS_PER_MS) for i in range(100)
    ]
    good = ping_line(0, 1)
    events.append(Received(b"\n" + good, START_NS + 200 * NS_PER_MS))
    session = ListSession()
    counters = play(events, session)
    bad = counters.noise + counters.cut + counters.malformed + counters.overlong
    kept = len(session.of(RawLine)) - 2  # the good line, and our own cut in the end
    assert bad - counters.bad_not_kept == pytest.approx(kept, abs=2)
    assert kept <= 12_001
    assert len(session.of(Range)) == 1
