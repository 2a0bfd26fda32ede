"""Clocks: no steps on the host; device time with drift, delay, wrap and restarts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recorder.clock import NS_PER_MS, NS_PER_S, DeviceClock, HostClock

UNIX_NS = 1_700_000_000 * NS_PER_S


def test_the_host_clock_follows_the_monotonic_clock_alone() -> None:
    wall, monotonic = [UNIX_NS], [5]
    clock = HostClock(lambda: wall[0], lambda: monotonic[0])
    assert clock.now_ns() == UNIX_NS
    wall[0] -= 3600 * NS_PER_S  # somebody sets the clock back
    monotonic[0] += 250
    assert clock.now_ns() == UNIX_NS + 250


def test_the_host_clock_has_the_time_of_day() -> None:
    import time

    assert abs(HostClock().now_ns() - time.time_ns()) < NS_PER_S


def simulated_run(
    drift: float, *, boot_ms: int = 0, seconds: int = 600, rate_hz: int = 20, seed: int = 0
) -> tuple[NDArray[np.int64], list[int], NDArray[np.int64]]:
    """True times, device stamps and arrivals behind a USB adapter that waits up to 16 ms."""
    rng = np.random.default_rng(seed)
    count = seconds * rate_hz
    true_s = np.arange(count) / rate_hz + rng.uniform(0, 0.5 / rate_hz, count)
    delay_s = rng.uniform(0.0, 0.016, count)
    late = rng.random(count) < 0.02
    delay_s[late] += rng.exponential(0.02, int(late.sum()))
    device_ms = (boot_ms + np.floor(true_s * (1.0 - drift) * 1000.0).astype(np.int64)) % 2**32
    arrival_ns = np.maximum.accumulate(((true_s + delay_s) * NS_PER_S).astype(np.int64))
    return (true_s * NS_PER_S).astype(np.int64) + UNIX_NS, device_ms.tolist(), arrival_ns + UNIX_NS


def errors_ms(
    true_ns: NDArray[np.int64], device_ms: list[int], arrival_ns: NDArray[np.int64]
) -> NDArray[np.float64]:
    clock = DeviceClock()
    estimates = [
        clock.estimate(ms, ns) for ms, ns in zip(device_ms, arrival_ns.tolist(), strict=True)
    ]
    assert not any(estimate.restarted for estimate in estimates)
    return (np.array([e.t_ns for e in estimates]) - true_ns) / NS_PER_MS


@pytest.mark.parametrize("drift", [0.0, 120e-6, -120e-6, 5e-3, -5e-3, 1e-2])
@pytest.mark.parametrize("boot_ms", [0, 2**32 - 100_000])
def test_drift_delay_and_wrap_leave_errors_of_a_millisecond(drift: float, boot_ms: int) -> None:
    true_ns, device_ms, arrival_ns = simulated_run(drift, boot_ms=boot_ms)
    errors = errors_ms(true_ns, device_ms, arrival_ns)
    by_arrival = (arrival_ns - true_ns) / NS_PER_MS
    settled = errors[300:]  # the first 15 s know no drift yet
    assert np.sqrt(np.mean(settled**2)) < 1.0
    assert np.percentile(np.abs(settled), 99) < 2.0
    assert np.sqrt(np.mean(settled**2)) < 0.1 * np.sqrt(np.mean(by_arrival**2))


@given(
    st.lists(
        st.tuples(st.integers(0, 2**32 - 1), st.integers(0, 20 * NS_PER_S)), min_size=1, max_size=80
    )
)
@settings(deadline=None)
def test_no_time_is_later_than_its_arrival_whatever_the_device_sends(
    steps: list[tuple[int, int]],
) -> None:
    clock, arrival_ns = DeviceClock(), UNIX_NS
    for device_ms, elapsed_ns in steps:
        arrival_ns += elapsed_ns
        estimate = clock.estimate(device_ms, arrival_ns)
        assert estimate.t_ns <= arrival_ns


@given(st.lists(st.integers(-250, 600), min_size=1, max_size=300))
@settings(deadline=None)
def test_a_device_clock_that_staggers_does_no_harm(steps_ms: list[int]) -> None:
    clock, device_ms, arrival_ns = DeviceClock(), 10**6, UNIX_NS
    for step_ms in steps_ms:
        device_ms += step_ms
        arrival_ns += 100 * NS_PER_MS
        assert clock.estimate(device_ms, arrival_ns).t_ns <= arrival_ns
    assert abs(clock.drift) <= 0.02


def test_a_delayed_line_gets_the_time_of_its_measurement() -> None:
    clock = DeviceClock()
    for i in range(10):
        clock.estimate(100 * i, UNIX_NS + 100 * i * NS_PER_MS)
    late = clock.estimate(1000, UNIX_NS + 1300 * NS_PER_MS)
    assert late.t_ns == UNIX_NS + 1000 * NS_PER_MS


def test_a_restart_is_seen_and_time_goes_on() -> None:
    clock = DeviceClock()
    for i in range(200):
        assert not clock.estimate(60_000 + 50 * i, UNIX_NS + 50 * i * NS_PER_MS).restarted
    again_ns = UNIX_NS + 12 * NS_PER_S
    first = clock.estimate(3, again_ns)
    assert first.restarted
    assert first.t_ns == again_ns
    second = clock.estimate(103, again_ns + 130 * NS_PER_MS)
    assert not second.restarted
    assert second.t_ns == again_ns + 100 * NS_PER_MS


@pytest.mark.parametrize("uptime_ms", [1_000, 2**31 + 5, 3_000_000_000, 2**32 - 300_000])
def test_a_restart_is_no_wrap(uptime_ms: int) -> None:
    clock = DeviceClock()
    clock.estimate(uptime_ms, UNIX_NS)
    assert clock.estimate(10, UNIX_NS + NS_PER_S).restarted


def test_a_wrap_is_no_restart() -> None:
    clock = DeviceClock()
    clock.estimate(2**32 - 40, UNIX_NS)
    wrapped = clock.estimate(60, UNIX_NS + 150 * NS_PER_MS)
    assert not wrapped.restarted
    assert wrapped.t_ns == UNIX_NS + 100 * NS_PER_MS


def test_reports_may_overtake_each_other_a_little() -> None:
    clock = DeviceClock()
    clock.estimate(1000, UNIX_NS + 1000 * NS_PER_MS)
    before = clock.estimate(980, UNIX_NS + 1005 * NS_PER_MS)
    assert not before.restarted
    assert before.t_ns == UNIX_NS + 980 * NS_PER_MS


def test_after_an_interruption_the_offset_is_learned_anew() -> None:
    clock = DeviceClock()
    clock.estimate(1000, UNIX_NS)
    clock.forget()  # unplugged for 5 s, and 2 s after its boot when received again
    estimate = clock.estimate(2000, UNIX_NS + 5 * NS_PER_S)
    assert estimate.t_ns == UNIX_NS + 5 * NS_PER_S


def test_hours_of_reports_take_no_more_memory() -> None:
    clock = DeviceClock()
    for i in range(20_000):
        clock.estimate(i * 500, UNIX_NS + i * 500 * NS_PER_MS)
    assert len(clock._least) < 65


@given(
    tick_ms=st.sampled_from([100, 1000]),
    period_ms=st.integers(25, 90),
    boot_ms=st.integers(0, 2**32 - 1),
    seed=st.integers(0, 1000),
)
@settings(deadline=None, max_examples=60)
def test_a_clock_that_is_coarser_than_the_arrivals_dates_nothing(
    tick_ms: int, period_ms: int, boot_ms: int, seed: int
) -> None:
    """60 clocks in whole seconds or tenths: right to 20 ms, where their own times are half off."""
    rng, clock = np.random.default_rng(seed), DeviceClock()
    for i in range(200):
        true_ms = i * period_ms
        ticked_ms = (boot_ms + true_ms // tick_ms * tick_ms) % 2**32
        arrival_ns = UNIX_NS + round((true_ms + rng.uniform(2.0, 8.0)) * NS_PER_MS)
        estimate = clock.estimate(ticked_ms, arrival_ns)
        assert estimate.by_arrival == (i > 0)
        assert abs(estimate.t_ns - UNIX_NS - true_ms * NS_PER_MS) < 20 * NS_PER_MS


@given(
    steps_ms=st.lists(st.integers(1, 400), min_size=30, max_size=120),
    lot=st.integers(10, 200),
    boot_ms=st.integers(0, 2**32 - 1),
)
@settings(deadline=None)
def test_text_that_comes_all_at_once_keeps_its_own_times(
    steps_ms: list[int], lot: int, boot_ms: int
) -> None:
    times_ms = np.cumsum([0, *steps_ms])
    clock, dated = DeviceClock(), list[int]()
    for begin in range(0, len(times_ms), lot):
        arrival_ns = UNIX_NS + begin * 1000  # a file through a socket: microseconds
        part = [int(boot_ms + t) % 2**32 for t in times_ms[begin : begin + lot]]
        clock.look_ahead(part, arrival_ns)
        found = [clock.estimate(device_ms, arrival_ns) for device_ms in part]
        if begin == 0 and times_ms[min(lot, len(times_ms)) - 1] < 1000:
            return  # no more than a delay of one line
        assert all(estimate.ahead for estimate in found)
        dated += [estimate.t_ns for estimate in found]
    own_ns = (times_ms - times_ms[0]) * NS_PER_MS
    assert [t_ns - dated[0] for t_ns in dated] == own_ns.tolist()


def test_what_had_waited_in_a_buffer_is_dated_back_and_then_arrivals_count() -> None:
    clock = DeviceClock()
    waited = list(range(0, 2050, 50))
    clock.look_ahead(waited, UNIX_NS)
    found = [clock.estimate(device_ms, UNIX_NS).t_ns for device_ms in waited]
    assert found == [UNIX_NS - (2000 - device_ms) * NS_PER_MS for device_ms in waited]
    for device_ms in range(2050, 12_000, 50):
        arrival_ns = UNIX_NS + (device_ms - 2000 + 3) * NS_PER_MS
        clock.look_ahead([device_ms], arrival_ns)
        estimate = clock.estimate(device_ms, arrival_ns)
        assert abs(estimate.t_ns - arrival_ns) <= 3 * NS_PER_MS
    assert not estimate.ahead
