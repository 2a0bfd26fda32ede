"""Readings placed as columns are, to the bit, the beams placed one by one: finished and live."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_live_placing import LivePlacer
from naive_placing import Placed, place
from naive_poses import Track

from mapping.beams import Beam
from mapping.config import MappingConfig, load_config
from mapping.pipeline import box_of
from mapping.placed_session import PlacedSession, Source
from mapping.placer import Placer
from mapping.readings import Readings
from mapping.sensor_model import stretch_of
from mapping.tracks import Motions, MotionTrack
from recorder.columns import Block, Choice, block_of
from recorder.errors import BadInput
from recorder.geometry import SE2, interpolate, wrap_angle
from recorder.messages import (
    Message,
    Odometry,
    Pose,
    Radiation,
    Range,
    Record,
    Scan,
    Transform,
    topic_of,
)
from recorder.session import read_session
from recorder.session.columns import OpenSession
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared"
NS = 1_000_000_000
STEPPED_BACK = "clock stepped back (reading kept)"
CONFIGURATIONS = [
    [],
    ["pose.topic=/odom"],
    ["pose.topic=/odom", "pose.odom_start=tracker"],
    ["pose.rides_on=head"],
    ["pose.fixed=[1, 2, 90]"],
    ["pose.max_gap_s=0.05"],
    ["pose.max_gap_s=1e9"],
    ["sensors.ping.mount=[0.1, 0, 30]", "sensors.*.no_echo=empties", "sensors.*.model=regions"],
]


def config(*settings_: str) -> MappingConfig:
    return load_config((), settings_, None)


def blocks(messages: Sequence[Message], each: int) -> Iterator[Block]:
    """The messages as columns, so many at a time."""
    for first in range(0, len(messages), each):
        part = messages[first : first + each]
        yield block_of((Record(topic_of(m), m.t_ns, m) for m in part), first)


def source(messages: Sequence[Message], each: int) -> Source:
    def found(choice: Choice) -> Iterator[Block]:
        return map(choice.of, blocks(messages, each))

    return found


def assert_same_beams(found: Sequence[Beam], wanted: Sequence[Beam]) -> None:
    assert len(found) == len(wanted)
    for a, b in zip(found, wanted, strict=True):
        for name in ("number", "t_ns", "sensor", "layer", "world_from_base", "world_from_sensor",
                     "beam_width_rad", "reach_m"):  # fmt: skip
            assert repr(getattr(a, name)) == repr(getattr(b, name)), name
        np.testing.assert_array_equal(a.bearings_rad, b.bearings_rad)
        np.testing.assert_array_equal(a.ranges_m, b.ranges_m)


def outcome(run: Callable[[], object]) -> object:
    try:
        return run()
    except BadInput as error:
        return str(error)


def assert_placed_the_same(
    session_: Sequence[Message | Record], configuration: MappingConfig, found_in: Source
) -> Placed | None:
    records = [r if isinstance(r, Record) else Record(topic_of(r), r.t_ns, r) for r in session_]
    wanted = outcome(lambda: place(records, configuration))
    session = outcome(lambda: PlacedSession(found_in, configuration))
    counts = outcome(lambda: session.counts if isinstance(session, PlacedSession) else session)
    if not isinstance(wanted, Placed):
        assert (counts if isinstance(session, PlacedSession) else session) == wanted
        return None
    assert isinstance(session, PlacedSession), session
    assert_same_beams([b for readings in session for b in readings.beams()], wanted.beams)
    assert list(session.sensors.items()) == list(wanted.sensors.items())
    assert session.counts.readings == wanted.readings
    assert list(session.counts.used.items()) == list(wanted.used.items())
    assert list(session.counts.dropped.items()) == list(wanted.dropped.items())
    times = [beam.t_ns for beam in wanted.beams]
    assert (session.counts.first_ns, session.counts.last_ns) == (min(times), max(times))
    boxes = [b.bounds_m(stretch_of(wanted.sensors[b.sensor])) for b in wanted.beams]
    low, high = box_of(session)
    np.testing.assert_array_equal(low, np.min([box[0] for box in boxes], axis=0))
    np.testing.assert_array_equal(high, np.max([box[1] for box in boxes], axis=0))
    return wanted


@pytest.mark.parametrize("settings_", CONFIGURATIONS)
@pytest.mark.parametrize("name", ["room", "l-room"])
def test_the_logs(name: str, settings_: list[str]) -> None:
    path = ROOT / "logs" / f"{name}.mcap"
    records = read_session(path).records
    assert assert_placed_the_same(records, config(*settings_), OpenSession(path).blocks)


@pytest.mark.real_data
@pytest.mark.parametrize("folder", ["cases", "cases/rosbag_folder", "data/rooms"])
def test_files_of_other_people(folder: str) -> None:
    files = sorted((SHARED / folder).glob("*.mcap"))
    assert files
    for file in files:
        records = read_session(file).records
        for settings_ in CONFIGURATIONS[: 7 if "cases" in folder else 1]:
            assert_placed_the_same(records, config(*settings_), OpenSession(file).blocks)


@pytest.mark.parametrize("settings_", CONFIGURATIONS)
@pytest.mark.parametrize("sensors", [("ping", "dirrs"), ("lidar",), ("lidar", "ping", "dirrs")])
def test_simulated_drives(sensors: tuple[str, ...], settings_: list[str]) -> None:
    run = simulate(
        load_room("room"), duration_s=6.0, seed=2, head_sweep_deg=60.0, sensors=sensors,
    )  # fmt: skip
    messages = [message for _, message in run]
    wanted = assert_placed_the_same(messages, config(*settings_), source(messages, 77))
    assert wanted is not None or "max_gap_s=0.05" in settings_[0]


def test_what_is_too_large_to_keep_is_read_again() -> None:
    path = ROOT / "logs" / "room.mcap"
    kept = PlacedSession(OpenSession(path).blocks, config())
    reads = 0

    def counted(choice: Choice) -> Iterator[Block]:
        nonlocal reads
        reads += 1
        yield from OpenSession(path).blocks(choice)

    again = PlacedSession(counted, config(), kept_bytes=0)
    for _ in range(2):
        found = [beam for readings in again for beam in readings.beams()]
        assert_same_beams(found, [beam for readings in kept for beam in readings.beams()])
    assert reads == 3
    assert again.counts == kept.counts


# messages of any kind, in any order

TIMES = st.integers(0, 40).map(lambda tick: tick * NS // 10)
MOTIONS = st.builds(
    SE2, st.sampled_from([0.0, -0.0, 1.0, 2e6, math.nan]), st.floats(-3, 3),
    st.floats(-7, 7) | st.sampled_from([math.pi, -math.pi, math.inf]),
)  # fmt: skip
DISTANCES = st.sampled_from([0.5, 1.0, 3.99, 4.0, 0.01, 0.0, -1.0, math.inf, -math.inf, math.nan])
SENSORS = st.sampled_from(["ping", "ping_left", "eye"])
MESSAGES: st.SearchStrategy[Message] = st.one_of(
    st.builds(Pose, TIMES, MOTIONS),
    st.builds(Odometry, TIMES, MOTIONS),
    st.builds(
        Range, TIMES, SENSORS, DISTANCES, st.just(0.6), st.just(0.02), st.just(4.0),
        st.just(Radiation.ULTRASOUND),
    ),
    st.builds(
        Scan, TIMES, st.sampled_from(["lidar", "eye"]),
        st.lists(DISTANCES, max_size=4).map(lambda values: np.array(values, np.float64)),
        st.just(-0.1), st.just(0.1), st.just(0.05), st.just(12.0),
    ),
    st.builds(
        Transform, TIMES, st.sampled_from(["base_link", "head", "arm"]),
        st.sampled_from(["head", "ping", "arm", "lidar"]), MOTIONS, st.booleans(),
    ),
)  # fmt: skip
SESSIONS = st.lists(MESSAGES, max_size=60)


@settings(deadline=None, max_examples=400)
@given(SESSIONS, st.sampled_from(CONFIGURATIONS), st.integers(1, 30))
def test_any_messages(messages: list[Message], settings_: list[str], each: int) -> None:
    assert_placed_the_same(messages, config(*settings_), source(messages, each))


@settings(deadline=None, max_examples=200)
@given(SESSIONS, st.sampled_from([c for c in CONFIGURATIONS if len(c) != 2]))
def test_any_messages_live(messages: list[Message], settings_: list[str]) -> None:
    """Message by message, with each step's beams, against the placer that takes objects."""
    one, many = LivePlacer(config(*settings_)), Placer(config(*settings_))
    for message, block in zip(messages, blocks(messages, 1), strict=True):
        assert_same_beams(list(many.take(block).beams()), one.take(message))
    assert_same_beams(list(many.finish().beams()), one.finish())
    assert many.sensors == one.sensors
    assert many.readings == one.readings
    assert many.used == one.used
    dropped = many.dropped
    dropped.pop(STEPPED_BACK, None)
    assert dropped == one.dropped


@pytest.mark.parametrize("each", [1, 10, 100])
@pytest.mark.parametrize("settings_", [[], ["pose.topic=/odom"], ["pose.rides_on=head"]])
def test_live_gives_the_readings_of_the_finished_session(each: int, settings_: list[str]) -> None:
    run = simulate(load_room("room"), duration_s=8.0, seed=3, head_sweep_deg=60.0)
    messages = [message for _, message in run]
    placer = Placer(config(*settings_))
    found = [b for block in blocks(messages, each) for b in placer.take(block).beams()]
    early = len(found)
    found += placer.finish().beams()
    wanted = place(messages, config(*settings_))
    assert_same_beams(found, wanted.beams)
    assert placer.dropped == wanted.dropped
    assert early > len(found) / 2


def test_a_live_session_forgets_its_track() -> None:
    placer = Placer(config())
    reading = Range(0, "ping", 1.0, 0.6, 0.02, 4.0, Radiation.ULTRASOUND)
    longest = 0
    for step in range(4000):
        messages = [Pose(step * NS // 10, SE2(0, 0, 0)), replace(reading, t_ns=step * NS // 10)]
        for block in blocks(messages, 2):
            placer.take(Block(tuple(replace(c, row=c.row + 2 * step) for c in block.columns)))
        assert placer._live is not None
        longest = max(longest, len(placer._live.track.t_ns))
    assert placer.used["ping"] == 4000
    assert longest < 1300  # twice a minute of ten poses a second


def test_a_scan_without_beams_beside_one_with_two() -> None:
    """As many ranges as readings, and still not one each."""
    ranges = (np.array([0.5, 0.5]), np.array([]))
    scans = [Scan(0, "lidar", each, -0.1, 0.1, 0.05, 12.0) for each in ranges]
    messages = [Pose(0, SE2(0.0, 0.0, 0.0)), *scans]
    wanted = assert_placed_the_same(messages, config(), source(messages, 10))
    assert wanted is not None
    assert wanted.dropped == {"no usable beam": 1}


def test_dead_reckoning_needs_a_finished_session() -> None:
    with pytest.raises(BadInput, match="finished session"):
        Placer(config("pose.odom_start=tracker"))


# the parts

FINITE = st.floats(-1e6, 1e6)
ANGLES = st.floats(-100, 100) | st.sampled_from([0.0, -0.0, math.pi, -math.pi, 3 * math.pi])
SANE = st.builds(SE2, FINITE, FINITE, ANGLES)


def columns_of(motions: Sequence[SE2]) -> Motions:
    values = np.array([(m.x_m, m.y_m, m.heading_rad) for m in motions], np.float64).reshape(-1, 3)
    return Motions(*values.T.copy())


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(SANE, SANE), min_size=1, max_size=20))
def test_motions_are_those_of_single_ones(pairs: list[tuple[SE2, SE2]]) -> None:
    a, b = columns_of([one for one, _ in pairs]), columns_of([two for _, two in pairs])
    for i, (one, two) in enumerate(pairs):
        assert repr((a @ b).one(i)) == repr(one @ two)
        assert repr((a @ two).one(i)) == repr(one @ two)
        assert repr(b.after(one).one(i)) == repr(one @ two)
        assert repr(a.inverse().one(i)) == repr(one.inverse())


@settings(deadline=None, max_examples=200)
@given(
    st.lists(st.tuples(st.integers(-(1 << 61), 1 << 61) | TIMES, SANE), max_size=12),
    st.lists(st.integers(-(1 << 61), 1 << 61) | TIMES, min_size=1, max_size=20),
    st.sampled_from([0.05, 1.0, 4e9]),
    st.integers(1, 5),
)
def test_a_track_is_the_track_of_single_poses(
    stamped: list[tuple[int, SE2]], times: list[int], gap_s: float, each: int
) -> None:
    one = Track.of(stamped, gap_s)
    many = MotionTrack.empty(round(gap_s * NS))
    for first in range(0, len(stamped), each):
        part = stamped[first : first + each]
        t_ns = np.array([t for t, _ in part], np.int64)
        many = many.with_more([(t_ns, columns_of([pose for _, pose in part]))])
    motions, known = many.at(np.array(times, np.int64))
    for i, t_ns in enumerate(times):
        wanted = one.at(t_ns)
        assert known[i] == (wanted is not None)
        assert wanted is None or repr(motions.one(i)) == repr(wanted)


def test_the_shorter_arc_and_the_wrap_are_those_of_single_angles() -> None:
    a, b = SE2(0, 0, 3.0), SE2(1, 0, -3.0)
    track = MotionTrack(np.array([0, NS]), columns_of([a, b]), NS)
    motions, _ = track.at(np.array([NS // 3]))
    assert motions.one(0) == interpolate(a, b, (NS // 3) / NS)
    assert motions.one(0).heading_rad == wrap_angle(motions.one(0).heading_rad)


def test_stretches_of_readings_and_their_points() -> None:
    messages = [m for _, m in simulate(load_room("room"), duration_s=3.0, seed=1,
                                       sensors=("lidar", "ping"))]  # fmt: skip
    beams = place(messages, config()).beams
    session = PlacedSession(source(messages, 10_000), config())
    [readings] = list(session)
    for first, end in ((0, 0), (0, 5), (3, 20), (10, len(readings))):
        assert_same_beams(list(readings[first:end].beams()), beams[first:end])
    points, row = readings.points_m()
    np.testing.assert_array_equal(points, np.concatenate([beam.points_m for beam in beams]))
    np.testing.assert_array_equal(
        row, np.repeat(np.arange(len(beams)), [len(beam.points_m) for beam in beams])
    )
    assert not readings.beam(0).ranges_m.flags.writeable
    assert len(Readings.none()) == 0
    with pytest.raises(ValueError, match="order"):
        readings[::2]
