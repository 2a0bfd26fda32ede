"""Missing readings, by the pace of those that came."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.recording.status import Cadence

STEP_NS = 50_000_000


def missing(times_ns: list[int]) -> int:
    cadence = Cadence()
    for t_ns in times_ns:
        cadence.reading(t_ns)
    return cadence.missing


@given(
    st.sets(st.integers(10, 199)),
    st.lists(st.integers(-8_000_000, 8_000_000), min_size=202, max_size=202),
)
@settings(deadline=None)
def test_what_was_left_out_is_missing_despite_jitter(left_out: set[int], jitter: list[int]) -> None:
    """As long as most of them come: a sensor that sends half as often is a slower sensor."""
    left_out = {i for i in left_out if i % 4 == 0}
    times_ns = [STEP_NS * i + jitter[i] for i in range(202) if i not in left_out]
    assert missing(times_ns) == len(left_out)


def test_a_long_silence_misses_all_that_would_have_come() -> None:
    assert missing([*range(0, 10 * STEP_NS, STEP_NS), 30 * STEP_NS]) == 20


def test_nothing_is_counted_before_the_pace_is_known() -> None:
    assert missing([0, STEP_NS, 40 * STEP_NS]) == 0
    assert missing([5] * 50) == 0
