"""Two rangers under each other's names, from the start or from some time on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mapping.config import sensor_defaults
from mapping.diagnosis.causes.interface import Cause, Evidence, Plot, Settings, Suspect
from mapping.diagnosis.raw import Channel, channels
from mapping.placed_session import HasBlocks, PlacedSession
from recorder.columns import ALL, Block, Choice, Columns, RangeColumns
from recorder.sensors import CATALOGUE

_BEYOND = 1.05  # times its reach: an infrared ranger reports nothing that far
_FEWEST = 10
_SHARE = 0.03
_WHOLE = 0.9  # of the session: it is swapped from the start to the end


@dataclass(frozen=True, slots=True)
class Swap:
    """Which two channels are swapped, and from when to when (nanoseconds)."""

    short: str
    long: str
    first_ns: int
    end_ns: int
    whole: bool


class Channels(Cause):
    """A channel of short reach that reports what only the other one can see."""

    name, title = "channels", "two channels are swapped"

    def suspects(self, evidence: Evidence) -> Iterator[Suspect]:
        """One for each pair."""
        for swap in swaps(evidence):
            yield _suspect(evidence, swap)


def swaps(evidence: Evidence) -> list[Swap]:
    """Pairs of which the first reports ranges beyond its reach, and the second then none."""
    every, found = channels(evidence), []
    for a in every:
        far_m = _BEYOND * _reach_m(evidence, a)
        beyond = np.isfinite(a.range_m) & (a.range_m > far_m)
        if beyond.sum() < max(_FEWEST, _SHARE * len(a.t_ns)):
            continue
        first, last = np.flatnonzero(beyond)[[0, -1]]
        for b in every:
            if b is a or _reach_m(evidence, b) < 1.5 * far_m:
                continue
            there = (b.t_ns >= a.t_ns[first]) & (b.t_ns <= a.t_ns[last])
            its = np.isfinite(b.range_m) & (b.range_m > far_m)
            if its[there].mean() > 0.3 * beyond[first : last + 1].mean():
                continue  # the other one sees far as well: no swap
            found.append(_bounds(a, b, beyond, its))
    return found


def _reach_m(evidence: Evidence, channel: Channel) -> float:
    known = evidence.placed.sensors.get(channel.sensor)
    kind = CATALOGUE.get(known.kind) if known is not None else None
    return min(channel.max_range_m, kind.max_range_m if kind else math.inf)


def _bounds(a: Channel, b: Channel, beyond: np.ndarray, its: np.ndarray) -> Swap:
    """From the last sound reading before to the first one after; else from end to end.

    Sound is where the channel of long reach sees far.
    """
    first_ns, last_ns = (int(a.t_ns[at]) for at in np.flatnonzero(beyond)[[0, -1]])
    sound_ns = b.t_ns[its]
    before, after = sound_ns[sound_ns < first_ns], sound_ns[sound_ns > last_ns]
    start_ns = (int(before[-1]) + first_ns) // 2 if len(before) > 2 else int(a.start_ns) - 1
    end_ns = (
        (int(after[0]) + last_ns) // 2 if len(after) > 2 else int(max(a.t_ns[-1], b.t_ns[-1])) + 1
    )
    span = max(a.t_ns[-1], b.t_ns[-1]) - a.start_ns
    return Swap(a.sensor, b.sensor, start_ns, end_ns, end_ns - start_ns >= _WHOLE * span)


def _suspect(evidence: Evidence, swap: Swap) -> Suspect:
    start_ns = channels(evidence)[0].start_ns
    from_s, to_s = max(0.0, (swap.first_ns - start_ns) * 1e-9), (swap.end_ns - start_ns) * 1e-9
    when = "all the time" if swap.whole else f"from {from_s:.1f} s to {to_s:.1f} s"
    short = next(each for each in channels(evidence) if each.sensor == swap.short)
    share = np.mean(
        np.isfinite(short.range_m) & (short.range_m > _BEYOND * _reach_m(evidence, short))
    )
    return Suspect(
        "channels", swap.short, f"{swap.short} and {swap.long} are swapped {when}",
        (
            f"{share:.0%} of the ranges of {swap.short} lie beyond the "
            f"{_reach_m(evidence, short):g} m that it reaches, while {swap.long} sees no farther "
            "than that",
        ),
        3.0, "almost certain", settings=_settings(evidence.placed, swap) if swap.whole else None,
        advice="" if swap.whole else (
            f"no setting mends half a session: import or record it anew, or map the parts "
            f"before and after {from_s if from_s > 0 else to_s:.1f} s on their own"
        ),
        value=from_s, unit="s", seconds=((from_s, to_s),),
        plots=tuple(_plot(each) for each in channels(evidence)
                    if each.sensor in (swap.short, swap.long)),
    )  # fmt: skip


def _plot(channel: Channel) -> Plot:
    seen = np.isfinite(channel.range_m)
    seconds = (channel.t_ns - channel.start_ns) * 1e-9
    return Plot(f"ranges of {channel.sensor}", "time (s)", "range (m)",
                points=np.column_stack([seconds[seen], channel.range_m[seen]]))  # fmt: skip


def _settings(placed: PlacedSession, swap: Swap) -> Settings:
    """Each takes the other's topic, and keeps what it is."""
    from mapping.diagnosis.hypothesis import mount_of

    sensors: dict[str, dict[str, object]] = {}
    for name, other in ((swap.short, swap.long), (swap.long, swap.short)):
        sensor = placed.sensors[name]
        mount = mount_of(sensor, placed.placement)
        usual = sensor_defaults(CATALOGUE[sensor.kind])
        sensors[name] = {
            "topic": placed.topics[other], "kind": sensor.kind,
            "beam_width_deg": round(math.degrees(sensor.beam_width_rad), 4),
            "min_range_m": sensor.min_range_m, "max_range_m": sensor.max_range_m,
            "no_echo": usual["no_echo"],
            "mount": [round(mount.x_m, 4), round(mount.y_m, 4),
                      round(math.degrees(mount.heading_rad), 3)],
        }  # fmt: skip
    return {"sensors": sensors}


class Exchanged:
    """A session in which the readings of two rangers bear each other's names for a while."""

    def __init__(self, session: HasBlocks, pair: tuple[RangeColumns, RangeColumns], swap: Swap):
        self._session, self._pair, self._swap = session, pair, swap

    def blocks(self, choice: Choice = ALL) -> Iterable[Block]:
        """The session's, with names exchanged."""
        for block in self._session.blocks(choice):
            yield Block(tuple(part for each in block.columns for part in self._parts(each)))

    def _parts(self, columns: Columns) -> Iterator[Columns]:
        keys = [(each.topic, each.sensor) for each in self._pair]
        if not isinstance(columns, RangeColumns) or (columns.topic, columns.sensor) not in keys:
            yield columns
            return
        as_other = self._pair[1 - keys.index((columns.topic, columns.sensor))]
        inside = (columns.t_ns >= self._swap.first_ns) & (columns.t_ns < self._swap.end_ns)
        if not inside.all():
            yield columns[~inside]
        if inside.any():
            some = columns[inside]
            many = np.zeros(len(some), np.int64)
            yield replace(
                some, topic=as_other.topic, sensor=as_other.sensor, frame=as_other.frame,
                beam_width_rad=as_other.beam_width_rad[many],
                min_range_m=as_other.min_range_m[many], max_range_m=as_other.max_range_m[many],
                radiation=as_other.radiation[many],
            )  # fmt: skip


def exchanged(session: HasBlocks, placed: PlacedSession, swap: Swap) -> Exchanged | None:
    """The session as it should have been; None where its columns are not found."""
    first: dict[str, RangeColumns] = {}
    topics = {placed.topics[name]: name for name in (swap.short, swap.long)}
    for block in session.blocks(ALL):
        for each in block.of(RangeColumns):
            if each.topic in topics and len(each):
                first.setdefault(topics[each.topic], each[:1])
        if len(first) == 2:
            return Exchanged(session, (first[swap.short], first[swap.long]), swap)
    return None
