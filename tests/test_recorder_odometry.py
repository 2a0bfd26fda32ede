"""Wheel counts → poses: arcs, counters that run over, laws of dead reckoning."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.geometry import IDENTITY, SE2, wrap_angle
from recorder.odometry import DeadReckoning, WheelGeometry, arc, count_change

TRACK_M = 0.106
rolled_m = st.floats(-2.0, 2.0)
counts = st.integers(0, 65535)


def assert_close(a: SE2, b: SE2, tolerance: float = 1e-9) -> None:
    assert math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < tolerance
    assert abs(wrap_angle(a.heading_rad - b.heading_rad)) < tolerance


def test_straight_turn_and_quarter_circle():
    assert_close(arc(0.5, 0.5, TRACK_M), SE2(0.5, 0.0, 0.0))
    quarter = math.pi / 2
    assert_close(arc(-quarter * 0.05, quarter * 0.05, 0.1), SE2(0.0, 0.0, quarter))
    # The middle on a circle of 1 m to the left: the wheels on circles of 0.95 and 1.05 m.
    assert_close(arc(quarter * 0.95, quarter * 1.05, 0.1), SE2(1.0, 1.0, quarter))


@given(rolled_m, rolled_m)
@settings(deadline=None)
def test_an_arc_is_the_limit_of_many_small_straight_steps(left_m, right_m):
    steps = 2000
    here = IDENTITY
    turn_rad = (right_m - left_m) / TRACK_M / steps
    for _ in range(steps):
        here = here @ SE2(0.0, 0.0, turn_rad / 2)
        here = here @ SE2((left_m + right_m) / 2 / steps, 0.0, 0.0)
        here = here @ SE2(0.0, 0.0, turn_rad / 2)
    assert_close(here, arc(left_m, right_m, TRACK_M), 1e-3)


@given(rolled_m, rolled_m, st.floats(0.0, 1.0))
@settings(deadline=None)
def test_two_parts_of_an_arc_make_the_whole(left_m, right_m, share):
    first = arc(share * left_m, share * right_m, TRACK_M)
    rest = arc((1 - share) * left_m, (1 - share) * right_m, TRACK_M)
    assert_close(first @ rest, arc(left_m, right_m, TRACK_M))


@given(rolled_m, rolled_m)
@settings(deadline=None)
def test_rolling_back_undoes_an_arc(left_m, right_m):
    assert_close(arc(left_m, right_m, TRACK_M) @ arc(-left_m, -right_m, TRACK_M), IDENTITY)


@given(st.floats(-1.0, 1.0), st.floats(-1e-8, 1e-8))
@settings(deadline=None)
def test_nearly_straight_is_nearly_straight(middle_m, difference_m):
    end = arc(middle_m - difference_m, middle_m + difference_m, TRACK_M)
    assert_close(end, SE2(middle_m, 0.0, 0.0), 1e-6)


@given(counts, st.integers(-32768, 32767))
@settings(deadline=None)
def test_a_counter_may_run_over(before, moved):
    assert count_change(before, (before + moved) % 65536) == moved
    assert count_change(before - 65536, before + moved) == moved


@given(st.lists(st.tuples(*[st.integers(-3000, 3000)] * 2), min_size=1, max_size=40), counts)
@settings(deadline=None)
def test_where_the_counters_began_makes_no_difference(moves, offset):
    geometry = WheelGeometry(ticks_per_m=2000.0, track_m=TRACK_M)
    plain, wrapped = DeadReckoning(geometry), DeadReckoning(geometry)
    assert plain.update(0, 0) == IDENTITY
    assert wrapped.update(offset, offset) == IDENTITY
    sums = itertools.accumulate(moves, lambda a, b: (a[0] + b[0], a[1] + b[1]))
    for left, right in sums:
        here = plain.update(left, right)
        assert wrapped.update((left + offset) % 65536, (right + offset) % 65536) == here


def test_a_restarted_device_does_not_jump():
    dead_reckoning = DeadReckoning(WheelGeometry(ticks_per_m=1000.0, track_m=TRACK_M))
    dead_reckoning.update(20_000, 20_000)
    here = dead_reckoning.update(21_000, 21_000)
    assert_close(here, SE2(1.0, 0.0, 0.0))
    dead_reckoning.restart()
    assert dead_reckoning.update(0, 0) == here
    assert_close(dead_reckoning.update(500, 500), SE2(1.5, 0.0, 0.0))


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_wheels_need_sizes(bad):
    with pytest.raises(ValueError, match="must be above zero"):
        WheelGeometry(bad, 0.1)
    with pytest.raises(ValueError, match="must be above zero"):
        WheelGeometry(1000.0, bad)


PER_TURN = 2.0 * math.pi * 0.08  # metres, of the wheels below: 90 counts a turn
SLOW = WheelGeometry(90 / PER_TURN, 0.4)
RANGES = (256, 360, 1000, 1024, 4096, 9000, 10_000, 32_767, 32_768, 65_536, 100_000, 1 << 32)


def driven(geometry: WheelGeometry, shown: list[int], step_s: float = 0.1) -> DeadReckoning:
    reckoning = DeadReckoning(geometry)
    for i, count in enumerate(shown):
        reckoning.update(count, count, round(i * step_s * 1e9))
    return reckoning


@pytest.mark.parametrize("signed", [False, True], ids=["unsigned", "signed"])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("counter_range", RANGES)
@given(st.lists(st.integers(9, 12), min_size=40, max_size=40), st.integers(5, 30))
@settings(deadline=None, max_examples=10)
def test_where_the_counters_begin_again_is_found_out(
    counter_range: int, direction: int, signed: bool, steps: list[int], wraps_at: int
) -> None:
    """12 ranges, forwards and back, signed or not; each with 10 drives."""
    low = -(counter_range // 2) if signed else 0
    begin = -sum(steps[:wraps_at]) * direction + low
    counts = [begin + direction * count for count in itertools.accumulate([0, *steps])]
    shown = [(count - low) % counter_range + low for count in counts]
    reckoning = driven(SLOW, shown)
    true_m = (counts[-1] - counts[0]) / 90 * PER_TURN
    error_m = abs(reckoning.update(shown[-1], shown[-1], 4_000_000_000).x_m - true_m)
    assert error_m <= 3.001 / 90 * PER_TURN  # a step's spread: the range may be off by that
    assert reckoning.leaps == 0


@given(
    st.sampled_from(RANGES),
    st.lists(st.integers(-100, 100), min_size=1, max_size=60),
    st.integers(0, 1 << 32),
)
@settings(deadline=None)
def test_a_range_that_is_given_is_exact(counter_range: int, steps: list[int], first: int) -> None:
    geometry = WheelGeometry(1000.0, 0.4, counter_range)
    counts = list(itertools.accumulate(steps, initial=first))
    here = driven(geometry, [count % counter_range for count in counts])
    assert_close(here.update(counts[-1], counts[-1]), SE2(sum(steps) / 1000.0, 0.0, 0.0))


@given(st.integers(2_000, 30_000), st.sampled_from([1, -1]), st.integers(0, 30))
@settings(deadline=None)
def test_what_no_wheel_can_do_moves_nothing_and_is_counted(
    leap: int, direction: int, at: int
) -> None:
    counts = [100_000 + 7 * i + (direction * leap if i > at else 0) for i in range(40)]
    reckoning = driven(SLOW, counts)
    assert reckoning.leaps == 1
    here = reckoning.update(counts[-1], counts[-1], 4_000_000_000)
    assert_close(here, SE2(38 * 7 / 90 * PER_TURN, 0.0, 0.0))


@pytest.mark.parametrize("bad", [0, 1, -5, (1 << 32) + 1])
def test_a_range_of_a_counter_has_bounds(bad: int) -> None:
    with pytest.raises(ValueError, match="counter_range"):
        WheelGeometry(1000.0, 0.1, bad)
