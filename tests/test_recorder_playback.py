"""A session that is played back arrives as it was: the same bytes, readings, times and maps."""

from __future__ import annotations

import math
import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_links import Collector, ManualClock
from playback_sessions import records_of, simulated

from mapping.artifacts import Snapshot
from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.clock import NS_PER_S, HostClock
from recorder.errors import BadInput, LinkError
from recorder.geometry import SE2
from recorder.link import Link
from recorder.messages import (
    BASE_FRAME,
    HEAD_FRAME,
    Message,
    Pose,
    Radiation,
    Range,
    RawLine,
    Record,
    Scan,
    Transform,
    topic_of,
)
from recorder.odometry import WheelGeometry
from recorder.playback import (
    FASTEST,
    Playback,
    ReplayedLink,
    check_speed,
    mounts_of,
    playback_of,
    wheels_of,
)
from recorder.playback.outlets import PseudoTerminalOutlet, SerialOutlet, SocketOutlet, open_outlet
from recorder.playback.run import PlayedCounts, play
from recorder.protocols.echogrid import EchogridProtocol
from recorder.protocols.reports import HeadReport, HelloReport, PoseReport, RangeReport
from recorder.recording import record
from recorder.session import SessionWriter, read_session
from recorder.simulator.tracker_server import TrackerServer
from recorder.tracker import open_tracker
from recorder.translation import RecordingCounters

START_NS = 1_700_000_000 * NS_PER_S


class Kept:
    """A session that keeps what is written."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def write(self, message: Message, *, log_ns: int) -> None:
        self.records.append(Record(topic_of(message), log_ns, message))

    def sync(self) -> None:
        pass

    def of(self, kind: type) -> list:
        return [r.message for r in self.records if isinstance(r.message, kind)]


def recorded_again(records: list[Record]) -> tuple[Kept, RecordingCounters]:
    """What a recorder makes of a session that is played back at once."""
    clock, kept = HostClock(), Kept()
    link = ReplayedLink(playback_of(records), clock=clock, speed=FASTEST)
    counters = record(
        link, kept, protocol=EchogridProtocol(), clock=clock, stop=threading.Event(),
        tracker=link.tracker,
        mounts=mounts_of(records),
    )  # fmt: skip
    return kept, counters


def reports_of(playback: Playback) -> list:
    packets = EchogridProtocol().feed(
        b"".join(s.payload for s in playback.transmissions if type(s.payload) is bytes)
    )
    assert all(packet.fault is None for packet in packets)
    return [packet.report for packet in packets]


def final_maps(records: list[Record]) -> dict[str, np.ndarray]:
    config = load_config(settings=["grid.resolution_m=0.04"])
    artifacts = build_maps((r.message for r in records), config)
    return {a.layer.name: a.layer.values for a in artifacts if isinstance(a, Snapshot)}


def test_a_session_without_raw_lines_is_sent_in_echogrid() -> None:
    records = simulated()
    kept, counters = recorded_again(records)
    was = [r.message for r in records if isinstance(r.message, Range)]
    now = kept.of(Range)
    assert [m.sensor for m in now] == [m.sensor for m in was]
    assert counters.gaps == counters.bad_checksum == counters.malformed == 0
    for a, b in zip(was, now, strict=True):
        assert a.range_m == b.range_m or a.range_m == pytest.approx(b.range_m, abs=0.00051)
    # one shift for all, but for what the serial line itself rounds and delays
    shifts = np.array([b.t_ns - a.t_ns for a, b in zip(was, now, strict=True)])
    assert np.ptp(shifts) < 10e6
    assert len(kept.of(Pose)) == sum(isinstance(r.message, Pose) for r in records)


def test_what_was_recorded_comes_out_the_same_and_gives_the_same_map() -> None:
    first, _ = recorded_again(simulated())
    second, counters = recorded_again(first.records)
    lines = [r.text for r in first.of(RawLine)]
    assert [r.text for r in second.of(RawLine)] == lines
    assert len(lines) > 200
    shift_ns = second.of(RawLine)[0].t_ns - first.of(RawLine)[0].t_ns
    assert [replace(m, t_ns=m.t_ns + shift_ns) for m in first.of(Range)] == second.of(Range)
    assert [replace(m, t_ns=m.t_ns + shift_ns) for m in first.of(Pose)] == second.of(Pose)
    logged = [r.log_ns for r in second.records if isinstance(r.message, RawLine | Pose)]
    assert logged == sorted(logged)
    assert counters.ended == "the source ended"
    maps, again = final_maps(first.records), final_maps(second.records)
    assert set(maps) == {"ping", "dirrs", "fused"}
    for name, values in maps.items():
        assert np.array_equal(values, again[name]), name


def test_over_a_pseudo_terminal_nothing_is_lost() -> None:
    """The fast way: the other side cannot keep up, and must not lose a byte for that."""
    recorded, _ = recorded_again(simulated())
    playback = playback_of(recorded.records)
    clock, stop = HostClock(), threading.Event()
    outlet, tracker = PseudoTerminalOutlet(), TrackerServer()
    played: list[PlayedCounts] = []
    player = threading.Thread(
        target=lambda: played.append(
            play(playback, outlet, tracker, speed=FASTEST, clock=clock, stop=stop)
        ),
        daemon=True,
    )
    kept, ended = Kept(), threading.Event()
    link = Link(outlet.name, clock=clock)
    poses = open_tracker(tracker.url, clock=clock)

    class UntilHangUp:
        """The port's events, until it hangs up: a link would wait for it to come back."""

        def events(self, stop: threading.Event):
            for event in link.events(stop):
                yield event
                if getattr(event, "reason", "") and event.state.value == "lost":  # type: ignore[union-attr]
                    return

    player.start()
    counters = record(
        UntilHangUp(), kept, protocol=EchogridProtocol(), clock=clock, stop=ended, tracker=poses
    )
    player.join(60)
    assert played[0].ended == ""
    assert played[0].poses == len(recorded.of(Pose))
    assert counters.gaps == counters.cut == counters.noise == 0
    sent = "".join(line.text for line in recorded.of(RawLine))
    assert "".join(line.text for line in kept.of(RawLine)) == sent
    assert [m.range_m for m in kept.of(Range)] == [m.range_m for m in recorded.of(Range)]
    assert played[0].sent_bytes == len(sent)


def test_over_a_socket_every_byte_arrives() -> None:
    data = [bytes(range(256)) * 40, b"\x00\xff\n", b"$"]
    records = records_of(
        [(START_NS + k, RawLine(START_NS + k, d.decode("latin-1"))) for k, d in enumerate(data)]
    )
    outlet = SocketOutlet("socket://127.0.0.1:0")
    clock, stop = HostClock(), threading.Event()
    collector = Collector(Link(outlet.name, clock=clock))
    seconds: list[float] = []
    counts = play(
        playback_of(records), outlet, None, speed=1.0, clock=clock, stop=stop,
        on_second=seconds.append,
    )  # fmt: skip
    collector.wait_for_data(b"\n$")
    collector.finish()
    assert collector.data == b"".join(data)
    assert counts == PlayedCounts(3, sum(map(len, data)), 0)
    assert seconds == []


def test_a_serial_port_is_written_to() -> None:
    ours, theirs = os.openpty()
    outlet = open_outlet(os.ttyname(theirs), clock=HostClock())
    assert isinstance(outlet, SerialOutlet)
    stop = threading.Event()
    assert outlet.ready(stop)
    outlet.send(b"$LOG,1\r\n")
    assert os.read(ours, 100) == b"$LOG,1\r\n"
    outlet.close()
    with pytest.raises(LinkError, match="takes nothing more"):
        outlet.send(b"x")
    os.close(theirs)
    os.close(ours)


def test_what_cannot_be_opened_is_reported() -> None:
    clock = HostClock()
    with pytest.raises(LinkError, match="no such device"):
        open_outlet("/dev/not-there", clock=clock)
    with pytest.raises(BadInput):
        open_outlet("socket://127.0.0.1:what", clock=clock)
    taken = SocketOutlet("socket")
    with pytest.raises(LinkError, match="cannot listen"):
        open_outlet(taken.name, clock=clock)
    taken.close()


def test_a_reader_that_hangs_up_ends_it() -> None:
    records = records_of([(START_NS, RawLine(START_NS, "x" * 100_000))] * 200)
    outlet, clock = SocketOutlet("socket"), HostClock()
    played: list[PlayedCounts] = []
    player = threading.Thread(
        target=lambda: played.append(
            play(playback_of(records), outlet, None, speed=0.0, clock=clock, stop=threading.Event())
        ),
        daemon=True,
    )
    link = Link(outlet.name, clock=clock)
    link.open()
    player.start()
    link.close()
    player.join(60)
    assert "nobody reads" in played[0].ended
    assert played[0].pieces < 200


def test_stop_is_heeded_before_and_while_it_plays() -> None:
    clock, stop = HostClock(), threading.Event()
    far = [(START_NS, RawLine(START_NS, "a")), (START_NS + 10**13, RawLine(START_NS + 10**13, "b"))]
    playback = playback_of(records_of(far))
    assert playback.duration_s == 10_000.0
    outlet = SocketOutlet("socket")
    collector = Collector(Link(outlet.name, clock=clock))
    played: list[PlayedCounts] = []
    player = threading.Thread(
        target=lambda: played.append(
            play(playback, outlet, None, speed=1.0, clock=clock, stop=stop)
        ),
        daemon=True,
    )
    player.start()
    collector.wait_for_data(b"a")
    stop.set()
    player.join(60)
    collector.finish()
    assert played == [PlayedCounts(1, 1, 0, "stopped")]
    for end in (SocketOutlet("socket"), PseudoTerminalOutlet()):
        counts = play(playback, end, None, speed=1.0, clock=clock, stop=stop)
        assert counts == PlayedCounts(0, 0, 0, "stopped")
    counts = play(playback, None, TrackerServer(), speed=1.0, clock=clock, stop=stop)
    assert counts.ended == "stopped"


def test_times_are_laid_onto_the_hosts_clock() -> None:
    clock = ManualClock(4_000)
    playback = playback_of(records_of([(1_000, RawLine(1_000, "a"))]))
    link = ReplayedLink(playback, clock=clock, speed=2.0)
    clock.t_ns = 5_000
    assert [link.host_ns(t) for t in (1_000, 1_001, 3_000)] == [4_000, 4_000, 5_000]
    stop = threading.Event()
    asked: list[int] = []

    def tick() -> None:
        asked.append(clock.t_ns)
        clock.t_ns += 500

    assert link.wait_for(9_000, stop, tick)
    assert clock.t_ns >= 8_000
    assert len(asked) == 6
    fastest = ReplayedLink(playback, clock=ManualClock(7), speed=FASTEST)
    assert fastest.host_ns(10**12 + 1_000) == 10**12 + 7
    assert fastest.wait_for(10**18, stop)
    stop.set()
    assert not link.wait_for(10**9, stop)


@pytest.mark.parametrize("speed", [-1.0, 0.001, 1e9, math.nan, math.inf])
def test_a_speed_that_makes_no_sense(speed: float) -> None:
    with pytest.raises(BadInput, match="speed"):
        check_speed(speed)


def test_what_a_line_can_carry() -> None:
    head = Transform(START_NS, BASE_FRAME, HEAD_FRAME, SE2(0.0, 0.0, 0.5), static=False)
    mount = Transform(START_NS, HEAD_FRAME, "ping", SE2(0.1, 0.0, 0.0))
    reading = Range(START_NS + 7_000_000, "ping", 1.2345, 0.6, 0.02, 4.0, Radiation.ULTRASOUND)
    nothing = replace(reading, range_m=math.inf)
    scan = Scan(START_NS, "lidar", np.ones(3), 0.0, 0.1, 0.1, 5.0)
    pose = Pose(START_NS, SE2(1.0, 2.0, 3.0))
    records = records_of([(START_NS + 1, m) for m in (mount, head, reading, nothing, scan, pose)])
    playback = playback_of(records)
    assert playback.left_out == {"/scan/lidar": 1}
    hello, turned, seen, unseen = reports_of(playback)
    assert isinstance(hello, HelloReport)
    assert isinstance(turned, HeadReport)
    assert turned.angle_rad == pytest.approx(0.5, abs=1e-4)
    assert seen in (RangeReport("ping", 1.234), RangeReport("ping", 1.235))
    assert unseen == RangeReport("ping", math.inf)
    assert playback.transmissions[-1].payload == pose
    in_line = reports_of(playback_of(records, poses_in_line=True))
    assert isinstance(in_line[-1], PoseReport)
    assert (in_line[-1].x_m, in_line[-1].y_m) == (1.0, 2.0)
    assert mounts_of(records) == (mount,)


def test_poses_that_the_lines_carry_are_not_sent_twice() -> None:
    pose = Pose(START_NS, SE2(1.0, 2.0, 3.0))
    records = records_of([(START_NS, RawLine(START_NS, "$RNG,1\r\n")), (START_NS, pose)])
    assert [type(sent.payload) for sent in playback_of(records).transmissions] == [bytes, Pose]
    records = records_of([(START_NS, RawLine(START_NS, "$POS,1\r\n")), (START_NS, pose)])
    assert [type(sent.payload) for sent in playback_of(records).transmissions] == [bytes]
    with pytest.raises(BadInput, match="nothing"):
        playback_of([])


def test_a_device_alone_has_no_tracker() -> None:
    playback = playback_of(records_of([(START_NS, RawLine(START_NS, "a"))]))
    link = ReplayedLink(playback, clock=HostClock())
    assert link.tracker is None
    assert not link.write(b"hello")
    collector = Collector(link)
    collector.wait_for_data(b"a")
    collector.finish()
    assert collector.states == ["opened"]


def test_the_wheels_come_from_the_session(tmp_path: Path) -> None:
    file = tmp_path / "s.mcap"
    with SessionWriter(file, metadata={"wheels": {"ticks_per_m": 2.0, "track_m": 0.1}}) as session:
        session.write(RawLine(START_NS, "a"), log_ns=START_NS)
    assert wheels_of(read_session(file).metadata) == WheelGeometry(ticks_per_m=2.0, track_m=0.1)
    assert wheels_of({}) is None
