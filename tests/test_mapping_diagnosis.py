"""What is wrong with a session: planted faults are named, with amounts; sound ones are not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.config import load_config
from mapping.diagnosis.case import Case, case_of
from mapping.diagnosis.causes.interface import Cause, Evidence
from mapping.diagnosis.causes.silence import Silence
from mapping.diagnosis.causes.table import CAUSES
from mapping.diagnosis.diagnosing import Diagnosis, diagnose, merged
from mapping.diagnosis.facing import acceptance, likeliest_edges, walls_of
from mapping.diagnosis.first_sight import AT_ONCE, at_first_sight
from mapping.diagnosis.fitting import Fit, fit
from mapping.diagnosis.hypothesis import (
    Hypothesis,
    Number,
    Session,
    bias_of,
    drift_of_poses,
    heading_of_poses,
    offset_of_poses,
    scale_of,
    x_of,
    y_of,
    yaw_of,
)
from mapping.diagnosis.own_walls import expected_echoes
from mapping.diagnosis.patches import Points, ThinBeams, find_patches
from mapping.diagnosis.pose_quality import heading_noise_rad, is_rough, jumps, relocations
from mapping.diagnosis.pruning import needed
from mapping.diagnosis.search import errors_asked
from mapping.diagnosis.slopes import Met, differences, slopes
from mapping.placed_session import place_session
from mapping.readings import Readings
from mapping.scoring.held_out import Gain
from mapping.tracks import Motions, MotionTrack
from recorder.columns import ALL, Block, Choice, blocks_of
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Range, Record, topic_of
from recorder.sensors import CATALOGUE
from recorder.simulator.faults import SOUND, RunFaults, SensorFaults
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

DURATION_S = 100.0


class Kept:
    """Messages as a session that can be gone through again and again."""

    def __init__(self, messages: list[Message]) -> None:
        self._blocks = list(blocks_of(Record(topic_of(m), m.t_ns, m) for m in messages))

    def blocks(self, choice: Choice = ALL) -> Iterator[Block]:
        return map(choice.of, self._blocks)


def messages(
    faults: RunFaults | None = None, room: str = "cluttered", seed: int = 2
) -> tuple[Message, ...]:
    if faults is None:
        return sound_messages()
    run = simulate(ROOMS[room], duration_s=DURATION_S, seed=seed, faults=faults)
    return tuple(message for _, message in run)


@lru_cache(maxsize=1)
def sound_messages() -> tuple[Message, ...]:
    run = simulate(ROOMS["cluttered"], duration_s=DURATION_S, seed=2)
    return tuple(message for _, message in run)


@lru_cache(maxsize=4)
def sound_case() -> Case:
    config = load_config()
    return case_of(place_session(list(messages()), config), config)


def of_sensor(name: str, **faults: object) -> RunFaults:
    return replace(SOUND, sensors={name: SensorFaults(**faults)})  # type: ignore[arg-type]


def found_in(all_messages: tuple[Message, ...]) -> Diagnosis:
    return diagnose(Kept(list(all_messages)), load_config())


@pytest.mark.parametrize(
    ("hypothesis", "setting"),
    [
        (Hypothesis(offset_s=0.13), "pose.offset_s=0.13"),
        (
            Hypothesis().with_sensor("dirrs", x_m=0.02, y_m=-0.03, yaw_rad=math.radians(7.0)),
            "sensors.dirrs.mount=[-0.0112,-0.03,7]",
        ),
        (Hypothesis(heading_rad=math.radians(8.0)), "pose.heading_offset_deg=8"),
        (
            Hypothesis(x_mps=0.03 / 60.0, y_mps=-0.02 / 60.0, heading_radps=math.radians(2.0) / 60),
            "pose.drift_per_min=[-0.03,0.02,-2]",
        ),
        (Hypothesis().with_sensor("ping", scale=1.04), "sensors.ping.range_scale=1.04"),
        (Hypothesis().with_sensor("dirrs", bias_m=0.02), "sensors.dirrs.range_bias_m=0.02"),
    ],
)
def test_a_hypothesis_places_readings_as_its_setting_would(
    hypothesis: Hypothesis, setting: str
) -> None:
    some = list(messages())
    placed = place_session(some, load_config())
    session = Session(Readings.joined(list(placed)), placed.placement)
    supposed = session.under(hypothesis)
    truly = Readings.joined(list(place_session(some, load_config([], [setting]))))
    mine, its = np.intersect1d(
        supposed.t_ns * 2 + supposed.sensor, truly.t_ns * 2 + truly.sensor, True, True
    )[1:]
    assert len(mine) > 0.98 * len(truly)
    start, other = supposed.world_from_sensor[mine], truly.world_from_sensor[its]
    assert start.x_m == pytest.approx(other.x_m, abs=1e-9)
    assert start.y_m == pytest.approx(other.y_m, abs=1e-9)
    assert np.cos(start.heading_rad - other.heading_rad) == pytest.approx(1.0)
    assert supposed.ranges_m[mine] == pytest.approx(truly.ranges_m[its])


@settings(max_examples=6, deadline=None)
@given(
    yaw_deg=st.floats(-12.0, 12.0), y_m=st.sampled_from([0.0, 0.03]),
    scale=st.sampled_from([1.0, 1.03]),
)  # fmt: skip
def test_walls_tell_how_a_thin_beam_is_turned(yaw_deg: float, y_m: float, scale: float) -> None:
    """Whatever else is wrong and mended, the yaw that was planted is what is found more."""
    case = sound_case()
    wrong = Hypothesis().with_sensor(
        "dirrs", yaw_rad=math.radians(yaw_deg), y_m=y_m, scale=1.0 / scale
    )
    known = Hypothesis().with_sensor("dirrs", y_m=-y_m, scale=scale)
    planted = Session(case.session.under(wrong), case.placed.placement)
    twisted = replace(case, session=planted)
    number = yaw_of("dirrs")
    found = fit(twisted.beams(["dirrs"]), [number], known)
    assert not found.failed
    assert math.degrees(found.value(number)) == pytest.approx(-yaw_deg, abs=1.0)


@pytest.mark.parametrize("seed", range(8))
def test_no_point_counts_whose_beam_may_have_met_another_wall(seed: int) -> None:
    """At a corner of two walls of one square; elsewhere points count."""
    rng = np.random.default_rng(seed)
    start = rng.uniform([-0.9, -0.9], [-0.3, -0.3], (400, 2))
    aim = np.where(rng.random(400)[:, None] < 0.5, 1.0, 0.0)
    along = rng.uniform(-0.4, 0.0, 400)
    at_m = np.where(aim > 0.5, np.column_stack([np.zeros(400), along]),
                    np.column_stack([along, np.zeros(400)]))  # fmt: skip
    way = at_m - start
    range_m = np.hypot(*way.T)
    heading_rad = np.arctan2(way[:, 1], way[:, 0])
    measured_m = range_m * (1.0 + 0.01 * rng.standard_normal(400))
    at_m = start + (measured_m / range_m)[:, None] * way
    row, spread_m = np.arange(400), np.full(400, 0.01)
    points = Points(row, row, at_m + 0.45, heading_rad, measured_m, spread_m, np.full(400, 9.0),
                    np.zeros(400, np.int64))  # fmt: skip
    patches = find_patches(points)
    used = patches.weight > 0
    of_other = (np.abs(patches.normal[:, 0]) > 0.7) != (aim[:, 0] > 0.5)
    assert patches.weight[of_other].sum() < 1e-3 * patches.weight.sum()
    assert not used[np.abs(along) < 0.02].any()
    assert used[np.abs(along) > 0.25].mean() > 0.9


@pytest.mark.parametrize("number", [offset_of_poses(), yaw_of("dirrs"), y_of("dirrs")])
def test_of_a_sound_session_the_walls_ask_for_nothing(number: Number) -> None:
    found = fit(sound_case().beams(["dirrs"]), [number])
    assert not found.failed
    assert abs(found.value(number)) < 1.5 * number.least


def test_a_factor_is_not_pretended_by_the_noise_of_the_ranges() -> None:
    """Slopes at measured ranges would find 3 % too much here."""
    found = fit(sound_case().beams(["dirrs"]), [scale_of("dirrs")])
    assert found.value(scale_of("dirrs")) == pytest.approx(1.0, abs=0.015)


def test_a_sound_session_has_no_suspects() -> None:
    found = found_in(messages())
    assert [suspect.text for suspect in found.suspects] == []
    assert found.gain is None
    assert found.fix == {}
    assert found.config == load_config()


def test_late_poses_and_a_turned_mount_are_named_together_and_mended() -> None:
    faults = replace(of_sensor("dirrs", mount=SE2(0.0, 0.0, math.radians(-9.0))), pose_delay_s=0.12)
    found = found_in(messages(faults))
    by_cause = {suspect.cause: suspect for suspect in found.suspects}
    assert {"pose-time", "mount"} <= set(by_cause)
    assert found.suspects[0].cause in ("pose-time", "mount")
    assert by_cause["pose-time"].value == pytest.approx(-0.12, abs=0.015)
    assert math.degrees(by_cause["mount"].value or 0.0) == pytest.approx(-9.0, abs=1.5)
    assert found.config.pose.offset_s == pytest.approx(-0.12, abs=0.015)
    assert found.gain is not None
    assert found.gain.low > 0.0
    assert by_cause["mount"].plots[0].line is not None


def test_a_sonar_against_walls_tells_its_cone() -> None:
    edges, config = [], load_config()
    for width_deg in (19.0, 38.0, 76.0):
        some = messages(of_sensor("ping", beam_width_deg=width_deg), "l-room")
        case = case_of(place_session(list(some), config), config)
        seen = acceptance(case, Hypothesis(), "ping", walls_of(case, Hypothesis()))
        assert seen is not None
        edges.append(math.degrees(2.0 * seen.half_width_rad))
    assert edges[0] < 30.0 < edges[1] < 60.0 < edges[2]


@settings(max_examples=10, deadline=None)
@given(yaw_deg=st.floats(-14.0, 14.0), edge_deg=st.floats(20.0, 55.0), seed=st.integers(0, 99))
def test_edges_of_a_share_are_found(yaw_deg: float, edge_deg: float, seed: int) -> None:
    angle = np.radians(np.arange(-75.0, 76.0, 2.0))
    off = math.radians(edge_deg) - np.abs(angle - math.radians(yaw_deg))
    share = 0.1 + 0.7 / (1.0 + np.exp(-off / math.radians(3.0)))
    count = np.full(len(angle), 200.0)
    hits = np.random.default_rng(seed).binomial(200, share).astype(np.float64)
    found_yaw, found_edge, _ = likeliest_edges(angle, hits, count)
    assert math.degrees(found_yaw) == pytest.approx(yaw_deg, abs=1.5)
    assert math.degrees(found_edge) == pytest.approx(edge_deg, abs=2.5)


def test_one_edge_tells_the_width_of_a_cone_that_sits_as_stated() -> None:
    angle = np.radians(np.arange(-75.0, 76.0, 2.0))
    count = np.full(len(angle), 50.0)
    count[angle < math.radians(-40.0)] = 0.0  # to that side walls were never so far aslant
    hits = np.where(angle < math.radians(50.0), 45.0, 2.0) * (count > 0.0)
    _, edge_rad, _ = likeliest_edges(angle, hits, count, np.zeros(1))
    assert math.degrees(edge_rad) == pytest.approx(50.0, abs=2.5)


@pytest.mark.parametrize("name", ["dirrs", "ping"])
def test_slopes_in_closed_form_are_those_of_placing_anew(name: str) -> None:
    case = sound_case()
    at = Hypothesis(0.05).with_sensor(
        name, x_m=0.01, y_m=0.02, yaw_rad=0.1, scale=1.02, bias_m=0.01
    )
    readings = case.session.under(at)
    rows = case.rows_of(name)
    rows = rows[np.isfinite(readings.ranges_m[rows])]
    heading = readings.world_from_sensor.heading_rad[rows]
    way = np.column_stack([np.cos(heading), np.sin(heading)])
    away = heading + np.linspace(-1.0, 1.0, len(rows))
    normal = np.column_stack([np.cos(away), np.sin(away)])
    range_m = readings.ranges_m[rows]
    for met in (
        Met(rows, rows, normal, way, range_m),
        Met(rows, rows, normal, normal, range_m, True),
    ):
        for make in (x_of, y_of, yaw_of, scale_of, bias_of):
            number = make(name)
            of_mount = slopes(case.session, at, [number], readings, met)[:, 0]
            assert of_mount == pytest.approx(
                differences(case.session, at, number, readings, met), abs=1e-4
            )
        drifts = [drift_of_poses(key, 100.0) for key in ("heading_radps", "x_mps", "y_mps")]
        for number in (heading_of_poses(), *drifts):
            of_poses = slopes(case.session, at, [number], readings, met)[:, 0]
            assert of_poses == pytest.approx(
                differences(case.session, at, number, readings, met), rel=1e-3, abs=1e-3
            )


def test_a_bias_of_one_sensor_shows_against_the_cones_of_the_other() -> None:
    faults = of_sensor("dirrs", bias_m=0.02)
    found = found_in(messages(faults, "l-room"))
    suspect = found.suspects[0]
    assert (suspect.cause, suspect.unit) == ("range", "m")
    assert suspect.value is not None
    against = suspect.value * (1.0 if suspect.subject == "dirrs" else -1.0)
    assert against == pytest.approx(0.02, abs=0.006)
    assert suspect.error is not None


def test_the_fewest_numbers_that_explain_a_fit_are_needed() -> None:
    """Two that feign each other: the one that is there is kept; neither, where nothing is."""
    numbers = (offset_of_poses(), yaw_of("dirrs"), scale_of("dirrs"))
    covariance = np.array([[1e-4, 1.9e-4, 0.0], [1.9e-4, 4e-4, 0.0], [0.0, 0.0, 1e-5]])
    away = Hypothesis(0.12).with_sensor("dirrs", yaw_rad=0.003, scale=1.001)
    assert needed(Fit(away, numbers, covariance, 1000), 4) == numbers[:1]
    nothing = Hypothesis(0.01).with_sensor("dirrs", yaw_rad=0.018)
    assert needed(Fit(nothing, numbers, covariance, 1000), 4) == ()


def other_channel(message: Message) -> Message:
    if not isinstance(message, Range):
        return message
    name = "dirrs" if message.sensor == "ping" else "ping"
    return CATALOGUE[name].parameters.reading(message.t_ns, name, message.range_m)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_swapped_channels_are_named_with_when(share: float) -> None:
    every = messages()
    first = int(share * len(every))
    swapped = (*every[:first], *map(other_channel, every[first:]))
    found = found_in(swapped)
    assert [suspect.cause for suspect in found.suspects] == ["channels"]
    suspect = found.suspects[0]
    assert suspect.value == pytest.approx(DURATION_S * share, abs=3.0)
    assert (suspect.settings is None) is bool(share)  # no setting mends half a session
    if not share:
        mended = place_session(list(swapped), found.config)
        sound = place_session(list(every), load_config())
        for name in ("ping", "dirrs"):
            assert mended.counts.used[name] == sound.counts.used[name]
            assert mended.sensors[name].max_range_m == sound.sensors[name].max_range_m


def test_a_stuck_sensor_is_seen_at_once() -> None:
    faults = of_sensor("ping", stuck_s=(50.0, 80.0))
    placed = place_session(list(messages(faults)), load_config())
    assert "ping is stuck" in at_first_sight(placed, load_config())
    assert at_first_sight(place_session(list(messages()), load_config()), load_config()) == ""


def blinded(
    sensor: str, first_s: float, last_s: float, every: tuple[Message, ...]
) -> tuple[Message, ...]:
    """A sensor sees nothing from one time to another."""
    start_ns = min(m.t_ns for m in every if isinstance(m, Range))
    return tuple(
        replace(m, range_m=math.inf)
        if isinstance(m, Range) and m.sensor == sensor
        and first_s <= (m.t_ns - start_ns) * 1e-9 < last_s
        else m
        for m in every
    )  # fmt: skip


@pytest.mark.parametrize("sensor", ["dirrs", "ping"])
def test_a_sensor_that_is_stuck_at_no_echo_is_seen(sensor: str) -> None:
    placed = place_session(list(blinded(sensor, 50.0, 75.0, messages())), load_config())
    (found,) = Silence().suspects(Evidence.of(placed, load_config()))
    assert found.subject == sensor
    assert "see nothing" in found.text
    assert any(first <= 51.0 and last >= 74.0 for first, last in found.seconds)


def test_late_poses_do_not_hide_that_a_sensor_is_stuck() -> None:
    late = blinded("dirrs", 40.0, 60.0, messages(replace(SOUND, pose_delay_s=0.3)))
    placed = place_session(list(late), load_config())
    assert not list(Silence().suspects(Evidence.of(placed, load_config())))
    suspects = found_in(late).suspects
    assert any(each.cause == "pose-time" for each in suspects)
    (stuck,) = (each for each in suspects if each.cause == "silence")
    assert (stuck.subject, stuck.sure) == ("dirrs", "likely")
    assert any(first <= 41.0 and last >= 59.0 for first, last in stuck.seconds)


def test_a_few_seconds_without_an_echo_are_not_called_stuck() -> None:
    placed = place_session(list(blinded("dirrs", 50.0, 52.5, messages())), load_config())
    assert not list(Silence().suspects(Evidence.of(placed, load_config())))


def test_a_sonar_that_sits_turned_and_shifted_is_mended_whole() -> None:
    faults = of_sensor("ping", mount=SE2(0.0, 0.04, math.radians(10.0)))
    found = found_in(messages(faults, "room"))
    assert {each.unit for each in found.suspects if each.subject == "ping"} >= {"m", "rad"}
    _, y_m, yaw_deg = found.fix["sensors"]["ping"]["mount"]
    assert y_m == pytest.approx(0.04, abs=0.015)
    assert yaw_deg == pytest.approx(10.0, abs=4.0)


@pytest.mark.parametrize(
    ("together", "on_walls", "errors"),
    [
        (Gain(0.01, 0.005, 0.02), Gain(0.0, -0.1, 0.1), 6.5),  # the score gains by all
        (Gain(-0.03, -0.05, -0.01), Gain(0.1, 0.05, 0.2), 6.5),  # points fit walls better
        (Gain(-0.01, -0.02, 0.01), Gain(0.01, 0.005, 0.02), 7.0),  # neither
        (Gain(-0.03, -0.05, -0.01), Gain(0.1, -0.05, 0.2), 16.0),  # the score surely loses
    ],
)
def test_how_sure_a_number_must_be_where_the_score_gains_nothing_by_it(
    together: Gain, on_walls: Gain, errors: float
) -> None:
    assert errors_asked(together, on_walls) == errors


def test_where_poses_are_missing_their_time_tells_nothing() -> None:
    case, number = sound_case(), offset_of_poses()
    at, rows = Hypothesis(), case.rows_of("dirrs")
    readings = case.session.under(at)
    ones = np.ones((len(rows), 2)) * math.sqrt(0.5)
    met = Met(rows, rows, ones, ones, np.full(len(rows), 0.3))
    slope = slopes(case.session, at, [number], readings, met)[:, 0]
    step_s = case.session.pose_interval_s
    known = case.session.has_poses(rows, -step_s) & case.session.has_poses(rows, step_s)
    assert not known.all()  # before the first pose, or after the last
    assert (slope[~known] == 0.0).all()
    assert np.abs(slope[known]).max() > 0.0


def test_noisy_poses_do_not_shorten_a_delay() -> None:
    """Between two poses their noise averages out, which must not draw the readings there."""
    faults = replace(SOUND, pose_delay_s=0.05, pose_noise_m=0.01, pose_noise_deg=2.0)
    late = next(s for s in found_in(messages(faults, "room", 4)).suspects if s.unit == "s")
    assert late.value == pytest.approx(-0.05, abs=0.01)


def test_points_are_drawn_evenly_from_all_beams() -> None:
    case = sound_case()
    few, every = (ThinBeams(case.session, ["dirrs"], case.block, most).axis for most in (200, 9999))
    assert len(few) == 200
    assert set(few) < set(every)
    assert few.tolist() == sorted(set(few))
    assert len(set(np.diff(np.searchsorted(every, few)))) > 1  # not every k-th
    with_cone = ThinBeams(case.session, ["dirrs", "ping"], case.block, 200).axis
    assert len(set(with_cone) & set(every)) == 100  # as many of either


def test_where_a_sensor_saw_two_echoes_it_expects_one_again() -> None:
    placed = place_session(list(messages()), load_config())
    expected = expected_echoes(Readings.joined(list(placed)), "dirrs")
    assert expected is not None
    assert expected.expected[expected.echo].mean() > 0.7
    assert expected.echo[expected.expected].mean() > 0.9
    assert expected_echoes(Readings.joined(list(placed)), "nobody") is None


def track(heading_rad: np.ndarray, x_m: np.ndarray | None = None) -> MotionTrack:
    count = len(heading_rad)
    x_m = np.linspace(0.0, 1.0, count) if x_m is None else x_m
    motions = Motions(x_m, np.zeros(count), heading_rad)
    return MotionTrack(np.arange(count) * 100_000_000, motions, 500_000_000)


@settings(max_examples=20, deadline=None)
@given(noise_deg=st.floats(0.5, 15.0), seed=st.integers(0, 99))
def test_noise_of_headings_is_measured_through_a_steady_turn(noise_deg: float, seed: int) -> None:
    noise = math.radians(noise_deg) * np.random.default_rng(seed).standard_normal(2000)
    measured = heading_noise_rad(track(0.1 * np.arange(2000) + noise), 0.5)
    assert math.degrees(measured) == pytest.approx(noise_deg, rel=0.15)


def test_jumps_are_steps_that_no_robot_makes() -> None:
    x_m = np.linspace(0.0, 1.0, 300)
    assert len(jumps(track(np.zeros(300), x_m), 0.5)) == 0
    x_m = x_m.copy()
    x_m[[50, 120, 200]] += 0.8
    assert len(jumps(track(np.zeros(300), x_m), 0.5)) == 6
    assert len(relocations(track(np.zeros(300), x_m), 0.5)) == 0
    assert is_rough(track(np.zeros(300), x_m), 0.5)


def test_a_robot_that_was_carried_does_not_jump() -> None:
    x_m = np.linspace(0.0, 1.0, 300)
    x_m[150:] += 2.0
    carried = track(np.zeros(300), x_m)
    assert relocations(carried, 0.5).tolist() == [149]
    assert len(jumps(carried, 0.5)) == 0


def test_too_few_readings_are_refused() -> None:
    with pytest.raises(BadInput, match="too few"):
        diagnose(Kept(list(messages()[:100])), load_config())


def test_every_cause_has_a_name_of_its_own() -> None:
    assert len({cause.name for cause in CAUSES}) == len(CAUSES)
    assert all(cause.title for cause in CAUSES)


def test_a_look_at_first_sight_takes_every_cause_that_needs_no_search() -> None:
    at_once = [type(cause) for cause in CAUSES if type(cause).suspects is not Cause.suspects]
    assert [type(cause) for cause in AT_ONCE] == at_once


def test_settings_are_laid_over_each_other() -> None:
    parts: list[dict[str, Any]] = [{"a": {"b": 1, "c": 2}}, {"a": {"b": 3}, "d": 4}]
    assert merged(parts) == {"a": {"b": 3, "c": 2}, "d": 4}
