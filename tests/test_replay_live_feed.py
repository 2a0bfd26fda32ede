"""The feed of a follower: it gets everything, and nothing that befalls it stops the giver."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator

from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Diagnostics, Message, Pose, RawLine
from replay.live.feed import LiveFeed

PATIENCE_S = 60.0


def poses(count: int) -> list[Pose]:
    return [Pose(i, SE2(float(i), 0.0, 0.0)) for i in range(count)]


def add_up(messages: Iterator[Message], is_late: Callable[[], bool]) -> str:
    xs = [m.world_from_base.x_m for m in messages if isinstance(m, Pose)]
    return f"{len(xs)} {sum(xs):.0f}"


def complain(messages: Iterator[Message], is_late: Callable[[], bool]) -> str:
    next(messages)
    raise BadInput("nothing fits")


def die(messages: Iterator[Message], is_late: Callable[[], bool]) -> str:
    next(messages)
    os.kill(os.getpid(), signal.SIGKILL)
    return ""


def hang(messages: Iterator[Message], is_late: Callable[[], bool]) -> str:
    next(messages)
    while True:
        time.sleep(60.0)


def report_when_late(messages: Iterator[Message], is_late: Callable[[], bool]) -> str:
    while not is_late():  # all of them wait: none is taken yet
        time.sleep(0.01)
    for _ in messages:
        pass
    return "late, then not" if not is_late() else "late to the end"


def test_the_follower_gets_every_message_that_a_map_needs() -> None:
    with LiveFeed(add_up) as feed:
        for pose in poses(1000):
            feed.offer(pose)
            feed.offer(RawLine(pose.t_ns, "noise"))
        feed.offer(Diagnostics(0, "recorder"))
        end = feed.finish(PATIENCE_S)
    assert (end.report, end.failure, end.not_followed) == ("1000 499500", "", 0)


def test_a_follower_that_gives_up_reports_why() -> None:
    with LiveFeed(complain) as feed:
        feed.offer(poses(1)[0])
        end = feed.finish(PATIENCE_S)
    assert (end.report, end.failure) == ("", "nothing fits")


def test_a_follower_that_dies_costs_only_what_it_would_have_shown() -> None:
    with LiveFeed(die, capacity=50) as feed:
        feed.offer(poses(1)[0])
        deadline_s = time.monotonic() + PATIENCE_S
        while feed.is_following:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        for pose in poses(500):
            feed.offer(pose)
        end = feed.finish(PATIENCE_S)
    assert end.failure == "its process ended (exit code -9)"
    assert end.not_followed >= 500 - 50


def test_a_follower_that_hangs_is_left_behind() -> None:
    with LiveFeed(hang, capacity=50) as feed:
        for pose in poses(500):
            feed.offer(pose)
        end = feed.finish(2.0)
    assert end.failure == "it did not come to an end in time"
    assert 500 - 51 <= end.not_followed <= 500


def test_a_late_follower_knows_it() -> None:
    with LiveFeed(report_when_late) as feed:
        for pose in poses(300):
            feed.offer(pose)
        end = feed.finish(PATIENCE_S)
    assert end.report == "late, then not"
