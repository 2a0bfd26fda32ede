"""Reading filters leave out the readings that they should, the same ones however they come."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.artifacts import Artifact, Finished, RejectedReading, Snapshot, Started
from mapping.beams import Beam
from mapping.config import MappingConfig, Sensor, load_config
from mapping.filters import FILTERS, Neighbours
from mapping.filters.prediction import TOGETHER
from mapping.filters.table import REJECTING
from mapping.layer_map import LayerMap
from mapping.live_pipeline import build_live_maps
from mapping.pipeline import build_maps
from mapping.placed_session import PlacedSession, place_session
from mapping.prediction import nearest_in_beam_m, nearest_on_axes_m
from mapping.readings import Readings
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, Scan
from recorder.session import read_session
from replay.comparison_steps import in_step
from replay.rrd.explanation import describe

LOGS = Path(__file__).resolve().parent.parent / "logs"
NAMES = tuple(FILTERS)
S = 1_000_000_000


def config(*more: str) -> MappingConfig:
    return load_config((), ["grid.resolution_m=0.04", *more], None)


def sonar(name: str, of: int | None = None, within_m: float = 0.1) -> Sensor:
    placed = place_session(standing([1.0]), config())
    return replace(placed.sensors["ping"], filter=name, filter_of=of, filter_within_m=within_m)


def standing(ranges_m: Sequence[float]) -> list[Message]:
    """A robot that stands still before a wall, and what its sonar measures ten times a second."""
    messages: list[Message] = []
    for number, range_m in enumerate(ranges_m):
        t_ns = S + number * S // 10
        messages.append(Pose(t_ns, SE2(0.0, 0.0, 0.0)))
        messages.append(Range(t_ns, "ping", range_m, 0.66, 0.02, 4.0, Radiation.ULTRASOUND))
    return messages


def slowly(ranges_m: Sequence[float], sensor: Sensor) -> list[bool]:
    """Which are rejected, one by one, by the rules as they are written in the docs."""
    of = sensor.filter_of or {"median": 3, "agree": 2}[sensor.filter]
    found = []
    for at, newest_m in enumerate(ranges_m):
        if at + 1 < of:
            found.append(False)
            continue
        window = list(ranges_m[at + 1 - of : at + 1])
        others = [sorted(window)[(of - 1) // 2]] if sensor.filter == "median" else window[:-1]
        found.append(any(apart(newest_m, each, sensor) for each in others))
    return found


def apart(a_m: float, b_m: float, sensor: Sensor) -> bool:
    if math.isinf(a_m) or math.isinf(b_m):
        return a_m != b_m
    return abs(a_m - b_m) > max(sensor.filter_within_m, sensor.range_error * b_m)


RANGES = st.lists(
    st.one_of(st.floats(0.05, 3.9), st.sampled_from([1.0, 1.05, 2.0, math.inf])), max_size=30
)


@settings(deadline=None, max_examples=150)
@given(RANGES, st.sampled_from(["median", "agree"]), st.integers(1, 6), st.data())
def test_neighbours_are_judged_as_by_hand_whatever_blocks_they_come_in(
    ranges_m: list[float], name: str, of: int, data: st.DataObject
) -> None:
    sensor, neighbours, found = sonar(name, of), Neighbours(), []
    at = 0
    while at < len(ranges_m):
        size = data.draw(st.integers(1, 8))
        part = np.array(ranges_m[at : at + size])
        numbers = np.zeros(len(part), np.int64)
        found += neighbours.take(
            part, numbers, np.ones(len(part), bool), [sensor]
        ).rejected.tolist()
        at += size
    assert found == slowly(ranges_m, sensor)
    if of == 1:
        assert not any(found)


def beams(artifacts: Sequence[Artifact]) -> list[tuple[str, int, float]]:
    return [(a.sensor, a.t_ns, float(a.ranges_m[0])) for a in artifacts if isinstance(a, Beam)]


def maps_of(artifacts: Sequence[Artifact]) -> dict[str, bytes]:
    layers = [a.layer for a in artifacts if isinstance(a, Snapshot) and a.final]
    return {each.name: each.values.tobytes() for each in layers}


def rejected(artifacts: Sequence[Artifact]) -> list[tuple[str, int, float]]:
    found = (a.beam for a in artifacts if isinstance(a, RejectedReading))
    return [(beam.sensor, beam.t_ns, float(beam.ranges_m[0])) for beam in found]


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    return list(read_session(LOGS / "room.mcap").messages())[:1200]


@pytest.mark.parametrize("name", NAMES)
def test_a_live_run_and_one_that_nobody_watches_reject_the_same_readings(
    messages: list[Message], name: str
) -> None:
    plain = list(build_maps(messages, config()))
    fixed = next(a for a in plain if isinstance(a, Started)).geometry
    grid = [
        f"grid.origin_m={list(fixed.origin_m)}",
        f"grid.size_m={[v - 0.01 for v in fixed.size_m]}",
    ]
    chosen = config(f"sensors.*.filter={name}", *grid)
    watched, live = list(build_maps(messages, chosen)), list(build_live_maps(messages, chosen))
    alone = list(build_maps(messages, chosen, watched=False, threads=2))
    ends = [next(a for a in run if isinstance(a, Finished)) for run in (watched, live, alone)]
    assert ends[0].dropped == ends[1].dropped == ends[2].dropped
    assert ends[0].used == ends[1].used == ends[2].used
    assert maps_of(watched) == maps_of(live) == maps_of(alone)
    assert len(rejected(watched)) == ends[0].dropped[FILTERS[name].reason] > 5
    # The stream's first two seconds are merged in silence, until it is known what there is.
    warm_ns = messages[0].t_ns + 3 * S
    late = [each for each in rejected(watched) if each[1] > warm_ns]
    assert [each for each in rejected(live) if each[1] > warm_ns] == late
    # What is kept and what is left out are the readings without a filter, each in their order.
    every, kept, out = beams(plain), beams(watched), rejected(watched)
    assert sorted(kept + out) == sorted(every)
    assert [each for each in every if each in set(kept)] == kept
    assert [each for each in every if each in set(out)] == out
    numbers = [a.number for a in watched if isinstance(a, Beam)]
    assert numbers == list(range(len(numbers)))


@pytest.mark.parametrize("setting", ["sensors.*.filter=off", "sensors.*.filter_of=5"])
def test_without_a_filter_nothing_changes(messages: list[Message], setting: str) -> None:
    plain, off = (list(place_session(messages, c)) for c in (config(), config(setting)))
    assert [r.ranges_m.tobytes() for r in plain] == [r.ranges_m.tobytes() for r in off]
    one = [f"sensors.*.filter={name}" for name in ("median", "agree")]
    for each in one:
        same = list(place_session(messages, config(each, "sensors.*.filter_of=1")))
        assert [r.t_ns.tobytes() for r in plain] == [r.t_ns.tobytes() for r in same]


def test_a_single_wrong_echo_is_a_step_with_its_reason() -> None:
    ranges_m = [2.0, 2.01, 2.0, 0.7, 2.0, 1.99, 2.0]
    run = list(build_maps(standing(ranges_m), config("sensors.ping.filter=median")))
    (step,) = [a for a in run if isinstance(a, RejectedReading)]
    assert (step.beam.number, step.expected_m) == (3, 2.0)
    text = describe(step)
    assert "0.700 m" in text
    assert "median of the last 3 readings of ping is **2.000 m**" in text
    assert 'sensors.ping.filter = "median"' in text
    end = next(a for a in run if isinstance(a, Finished))
    assert end.dropped == {FILTERS["median"].reason: 1}
    (when,) = end.dropped_at
    assert when.t_ns.tolist() == [S + 3 * S // 10]
    # Two in a row must agree: the echo and the one after it go.
    agreed = list(build_maps(standing(ranges_m), config("sensors.ping.filter=agree")))
    assert [each[2] for each in rejected(agreed)] == [0.7, 2.0]


def test_what_saw_nothing_is_a_neighbour_too() -> None:
    ranges_m = [math.inf, math.inf, 1.5, math.inf, math.inf]
    with pytest.raises(BadInput, match="not one reading"):
        list(build_maps(standing(ranges_m), config("sensors.ping.filter=agree")))
    empties = config("sensors.ping.filter=median", "sensors.ping.no_echo=empties")
    run = list(build_maps(standing(ranges_m), empties))
    assert [each[2] for each in rejected(run)] == [1.5]
    assert "is **nothing**" in describe(next(a for a in run if isinstance(a, RejectedReading)))


# Of a robot that stands still, `pooled` does not take fifty equal readings for fifty reasons.
BY_THE_MAP = ("sensors.ping.filter=predicted", "sensors.ping.update=bayes")


def known_wall(*then: float) -> list[Message]:
    return standing([2.0] * (TOGETHER + 1) + list(then))


def test_the_map_is_what_a_reading_is_held_against() -> None:
    chosen = config(*BY_THE_MAP)
    run = list(build_maps(known_wall(0.8, 2.0, 3.5, 2.0), chosen))
    assert [each[2] for each in rejected(run)] == [0.8, 3.5]
    short, through = (a.expected_m for a in run if isinstance(a, RejectedReading))
    assert short == pytest.approx(2.0, abs=0.15)
    assert through == pytest.approx(2.0, abs=0.15)
    assert not rejected(list(build_maps(standing([2.0] * 20 + [0.8, 2.0]), chosen)))  # no map yet


def test_a_room_that_changed_is_believed_the_third_time() -> None:
    chosen = config(*BY_THE_MAP)
    run = list(build_maps(known_wall(0.8, 0.81, 0.8, 0.8, 2.0), chosen))
    assert [each[2] for each in rejected(run)] == [0.8, 0.81]
    once = [*(0.8, 1.3) * 4]  # contradictions that do not agree are no change
    assert len(rejected(list(build_maps(known_wall(*once), chosen)))) >= 4


def slowly_by_the_map(placed: PlacedSession, sensors: tuple[Sensor, ...]) -> list[int]:
    """The times of rejected readings: after each TOGETHER kept of a layer its map is made anew."""
    geometry = next(a for a in build_maps(placed, config()) if isinstance(a, Started)).geometry
    kept: dict[str, list[Readings]] = {}
    rows: dict[str, list[float]] = {}
    found = []
    for reading in each_alone(placed):
        sensor = sensors[reading.sensor[0]]
        mine, beam = kept.setdefault(sensor.layer, []), reading.beam(0)
        measured_m, expected_m = float(reading.ranges_m[0]), math.nan
        known = mine[: len(mine) // TOGETHER * TOGETHER]
        if known:
            made = LayerMap(sensor.layer, sensors, geometry)
            made.merge_many(Readings.joined(known))
            probability = made.layer().probability
            on_axis_m = nearest_on_axes_m(beam, probability > 0.6, geometry)[0]
            nearest_m = nearest_in_beam_m(beam, probability > 0.6, geometry)[0]
            if on_axis_m < measured_m and apart(measured_m, on_axis_m, sensor):
                expected_m = on_axis_m
            elif measured_m < nearest_m < math.inf and apart(measured_m, nearest_m, sensor):
                ((row, col),) = geometry.cells_of(beam.points_m)
                if probability[row, col] < 0.4:
                    expected_m = nearest_m
        alike = rows.setdefault(sensor.name, [])
        if math.isnan(expected_m):
            alike.clear()
        else:
            alike[:] = [each for each in alike if not apart(measured_m, each, sensor)]
            alike.append(measured_m)
        if math.isnan(expected_m) or len(alike) >= 3:
            mine.append(reading)
        else:
            found.append(int(reading.t_ns[0]))
    return found


def each_alone(placed: PlacedSession) -> Iterator[Readings]:
    for readings in placed:
        yield from (readings[row : row + 1] for row in range(len(readings)))


def test_the_map_so_far_is_that_of_the_readings_that_were_kept(messages: list[Message]) -> None:
    placed = place_session(messages, config())
    sensors = tuple(replace(s, filter="predicted") for s in placed.placement.sensors)
    run = list(build_maps(messages, config("sensors.*.filter=predicted")))
    found = [each[1] for each in rejected(run)]
    assert found == slowly_by_the_map(placed, sensors)
    assert found


def test_runs_with_and_without_a_filter_go_in_step() -> None:
    session = standing([2.0, 2.0, 2.0, 0.7, 2.0])
    runs = {
        "before": list(build_maps(session, config())),
        "after": list(build_maps(session, config("sensors.ping.filter=median"))),
    }
    moments = list(in_step(runs, session))
    (moment,) = [m for m in moments if isinstance(m.get("after"), RejectedReading)]
    assert isinstance(moment["before"], Beam)


def test_scans_are_not_filtered() -> None:
    scan = Scan(S, "lidar", np.array([1.0, 2.0]), 0.0, 0.1, 0.02, 10.0)
    session: list[Message] = [Pose(S, SE2(0.0, 0.0, 0.0)), scan]
    with pytest.raises(BadInput, match=r"sensors.lidar.filter: scans are not filtered"):
        place_session(session, config("sensors.lidar.filter=median"))
    assert place_session(session, config("sensors.*.filter=median")).counts.used == {"lidar": 1}


def test_reasons_are_those_of_filters() -> None:
    assert set(REJECTING) == {each.reason for each in FILTERS.values()}
    with pytest.raises(BadInput, match=r"sensors.ping.filter"):
        config("sensors.ping.filter=medium")
