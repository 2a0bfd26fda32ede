"""Many sources in one queue: nothing that had come is left behind, and nobody waits for ever."""

from __future__ import annotations

import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from recorder.recording import inbox
from recorder.recording.inbox import Inbox


def numbers(count: int) -> Callable[[threading.Event], Iterator[int]]:
    """A source that brings 0, 1, 2 ... and ends, whatever it is asked."""
    return lambda halt: iter(range(count))


def until_halted(halt: threading.Event) -> Iterator[int]:
    """A source that brings a number, and is silent until it is asked to end."""
    yield 7
    halt.wait(60)


def test_all_that_all_sources_bring_comes_in_their_order() -> None:
    with Inbox({"a": numbers(500), "b": until_halted}) as box:
        found = [
            (name, event) for name, event in box.events(threading.Event()) if event is not None
        ]
    assert [event for name, event in found if name == "a"] == list(range(500))
    assert [event for name, event in found if name == "b"] == [7]


def test_what_had_come_before_the_stop_is_brought_to_a_slow_taker(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A full queue and a taker that needs much longer than a silent source is waited for."""
    monkeypatch.setattr(inbox, "_DRAIN_S", 0.3)
    monkeypatch.setattr(inbox, "_QUEUE_LENGTH", 30)
    stop, found = threading.Event(), []
    with Inbox({"a": numbers(40)}) as box:
        for _, event in box.events(stop):
            if event is not None:
                stop.set()
                found.append(event)
                time.sleep(0.02)
    assert found == list(range(40))


def test_a_source_that_does_not_end_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox, "_DRAIN_S", 0.05)
    stop, never = threading.Event(), threading.Event()
    stop.set()

    def deaf(halt: threading.Event) -> Iterator[int]:
        never.wait(60)
        yield 1

    with Inbox({"deaf": deaf}) as box:
        assert [event for _, event in box.events(stop) if event is not None] == []
    never.set()


def test_a_source_that_goes_on_for_ever_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox, "_LONGEST_DRAIN_S", 0.2)
    stop = threading.Event()
    stop.set()

    def endless(halt: threading.Event) -> Iterator[int]:
        while not over.is_set():
            yield 1

    over = threading.Event()
    with Inbox({"endless": endless}) as box:
        events = [event for _, event in box.events(stop)]
        assert not over.is_set(), "it was left alone while it was still going on"
    over.set()
    assert 1 in events


def test_what_a_source_raises_comes_out_and_the_others_end() -> None:
    def broken(halt: threading.Event) -> Iterator[int]:
        yield 1
        raise ZeroDivisionError

    with Inbox({"broken": broken, "other": until_halted}) as box:
        events = [event for name, event in box.events(threading.Event()) if name == "broken"]
    assert events[0] == 1
    assert isinstance(events[1], ZeroDivisionError)


def test_the_interpreter_is_left_as_it_was() -> None:
    before = sys.getswitchinterval()
    with Inbox({"a": numbers(3)}) as box:
        assert sys.getswitchinterval() < before
        assert gc.get_freeze_count() > 0  # what was imported is not searched for garbage
        assert len([1 for _, event in box.events(threading.Event()) if event is not None]) == 3
    assert sys.getswitchinterval() == before
    assert gc.get_freeze_count() == 0


def test_two_at_once_leave_the_interpreter_as_it_was() -> None:
    before = sys.getswitchinterval()
    first, second = (Inbox({"a": lambda halt: iter([1])}) for _ in range(2))
    first.__enter__()
    second.__enter__()
    first.__exit__()
    assert sys.getswitchinterval() < before, "the second one is at work"
    assert gc.get_freeze_count() > 0
    second.__exit__()
    assert sys.getswitchinterval() == before
    assert gc.get_freeze_count() == 0


def test_what_somebody_else_froze_stays_so() -> None:
    gc.freeze()
    try:
        with Inbox({"a": lambda halt: iter([1])}):
            pass
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()
