"""Faults that are planted in sessions for ``diagnose``, and what it must then name.

A fault is planted in the simulator, or into a recorded session, whose stated mounts, stamps and
ranges are changed such that its readings are those of a robot with the fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from mapping.diagnosis.causes.channels import Exchanged, Swap
from mapping.diagnosis.causes.interface import Suspect
from mapping.placed_session import HasBlocks
from recorder.columns import ALL, Block, Choice, Columns, PoseColumns, RangeColumns, blocks_of
from recorder.columns import TransformColumns as Mounts
from recorder.geometry import SE2
from recorder.messages import Range, Record, topic_of
from recorder.sensors import CATALOGUE
from recorder.session.columns import open_session
from recorder.simulator.faults import SOUND, RunFaults, SensorFaults
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

TEN_MS, ONE_DEG, FIVE_MM, HALF_PERCENT = 0.010, math.radians(1.0), 0.005, 0.005
BEAM_WITHIN = 1.25  # times: how near the width of a cone must be found
SWAP_WITHIN_S = 5.0
OUT_WITHIN_S = 3.0  # of a sensor's silence: so much may be missed of it, and so much named besides
OUT_S = 20.0  # how long a sensor is stuck or dead


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong: ``kind`` with its amount, in seconds, radians, metres or times.

    ``late``: a pose shows where the robot was so long before its stamp. ``yaw``, ``ahead``,
    ``left``: where the sensor truly sits, against what is stated. ``scale``, ``bias``: ranges read
    too long. ``beam``: how many times as wide as stated. ``swap``: two channels under each other's
    names from then on. ``stuck``: repeats itself for 20 s from then on. ``talk``: a share.
    ``heading``: headings are so much too large; ``turning``, ``wandering``: headings or
    places drift by so much a second. ``random``: a share of ranges that are any. ``noisy``: each
    heading is off by that, and each place by 1 cm. ``dead``: says nothing for 20 s from then on.
    """

    kind: str
    sensor: str = ""
    amount: float = 0.0

    def is_named(self, suspect: Suspect) -> bool:
        """Whether a suspect is this fault, with the right sensor and the right sign."""
        known = suspect.cause == _CAUSES[self.kind] and self.sensor in (suspect.subject, "")
        if self.kind == "ahead" and suspect.cause == "range" and suspect.unit == "m":
            known = suspect.subject == self.sensor  # which cannot be told from a shift
        known = known and suspect.unit == _UNITS.get(self.kind, suspect.unit)
        return known and self.excess(suspect) * self.planted >= 0.0

    def is_right(self, suspect: Suspect) -> bool:
        """Whether it is named by the right amount, too."""
        if not self.is_named(suspect):
            return False
        off = abs(self.excess(suspect) - self.planted)
        if self.kind == "beam":
            times = (1.0 + self.excess(suspect)) / self.amount
            return 1.0 / BEAM_WITHIN <= times <= BEAM_WITHIN
        if self.kind in ("stuck", "dead"):
            return self._is_then(suspect)
        return off <= _WITHIN.get(self.kind, math.inf)

    def _is_then(self, suspect: Suspect) -> bool:
        """Whether the stretches that it shows are the one in which the sensor was out."""
        named_s = sum(end - first for first, end in suspect.seconds)
        first_s, end_s = self.amount, self.amount + OUT_S
        both_s = sum(
            max(0.0, min(end, end_s) - max(first, first_s)) for first, end in suspect.seconds
        )
        return both_s > OUT_S - OUT_WITHIN_S and named_s - both_s < OUT_WITHIN_S

    @property
    def planted(self) -> float:
        """How much differs from nothing."""
        return self.amount - self._neutral

    def excess(self, suspect: Suspect) -> float:
        """What a suspect says of it, in the same unit."""
        value = suspect.value or 0.0
        backwards = self.kind in ("late", "heading") or (
            self.kind == "ahead" and suspect.cause == "range"
        )
        return -value if backwards else value - self._neutral

    @property
    def _neutral(self) -> float:
        return 1.0 if self.kind in ("scale", "beam") else 0.0


_CAUSES = {
    "late": "pose-time", "yaw": "mount", "ahead": "mount", "left": "mount", "scale": "range",
    "bias": "range", "beam": "beam", "swap": "channels", "stuck": "silence", "talk": "cross-talk",
    "heading": "heading", "turning": "drift", "wandering": "drift", "random": "wrong-echoes",
    "noisy": "poses", "dead": "silence",
}  # fmt: skip
_UNITS = {"yaw": "rad", "ahead": "m", "left": "m", "scale": "times", "bias": "m", "beam": "times",
          "heading": "rad", "turning": "rad/s", "wandering": "m/s", "random": "share",
          "noisy": "rad", "talk": "share", "stuck": "share", "dead": "s"}  # fmt: skip
_WITHIN = {
    "late": TEN_MS, "yaw": ONE_DEG, "ahead": FIVE_MM, "left": FIVE_MM, "scale": HALF_PERCENT,
    "bias": FIVE_MM, "swap": SWAP_WITHIN_S, "heading": ONE_DEG, "noisy": ONE_DEG,
    "turning": 0.3 * ONE_DEG / 60.0, "wandering": 0.01 / 60.0,
}  # fmt: skip
Faults = tuple[Fault, ...]


def has_amount(fault: Fault) -> bool:
    """Whether an amount of it is checked: of cross-talk and of random ranges none is."""
    return fault.kind in (*_WITHIN, "beam", "stuck", "dead")


@dataclass(frozen=True, slots=True)
class Planted:
    """A row of the table: which faults a run of each seed has."""

    name: str
    faults: Callable[[int], Faults]
    sensors: tuple[str, ...] = ("ping", "dirrs")
    recorded: bool = True  # can be planted into a recorded session as well
    mounts: Mapping[str, SE2] = field(default_factory=dict)


def _count(seed: int) -> int:
    """Counts such that no room always meets the same amount or sign."""
    return seed + seed // 8


def _sign(seed: int) -> int:
    count = _count(seed)
    return 1 if (count + count // 4) % 2 == 0 else -1


def _of(amounts: Sequence[float]) -> Callable[[int], float]:
    return lambda seed: amounts[_count(seed) % len(amounts)] * _sign(seed)


_delay = _of((0.05, 0.1, 0.15, 0.2))
_yaw = _of([math.radians(v) for v in (2.0, 5.0, 10.0, 15.0)])
_wide_yaw = _of([math.radians(v) for v in (5.0, 8.0, 10.0, 15.0)])
_shift = _of((0.01, 0.02, 0.03, 0.05))


def _one(kind: str, sensor: str, amount: Callable[[int], float]) -> Callable[[int], Faults]:
    return lambda seed: (Fault(kind, sensor, amount(seed)),)


def _factor(seed: int) -> float:
    return 1.0 + 0.03 * _sign(seed)


def _bias(seed: int) -> float:
    return 0.02 * _sign(seed)


def _five_deg(seed: int) -> float:
    return 5.0 * ONE_DEG * _sign(seed)


def _noisy(seed: int) -> float:
    return 5.0 * ONE_DEG


PLANTED = (
    Planted("none", lambda seed: ()),
    Planted("poses 50 to 200 ms late or early", _one("late", "", _delay)),
    Planted("infrared turned 2 to 15 degrees", _one("yaw", "dirrs", _yaw)),
    Planted("infrared shifted 1 to 5 cm sideways", _one("left", "dirrs", _shift)),
    Planted("infrared shifted 1 to 5 cm ahead or back", _one("ahead", "dirrs", _shift)),
    Planted("sonar turned 5 to 15 degrees", _one("yaw", "ping", _wide_yaw)),
    Planted("infrared scale 3 %", _one("scale", "dirrs", _factor)),
    Planted("sonar scale 3 %", _one("scale", "ping", _factor)),
    Planted("infrared bias 2 cm", _one("bias", "dirrs", _bias)),
    Planted("sonar bias 2 cm", _one("bias", "ping", _bias)),
    Planted("sonar beam half as wide", _one("beam", "ping", lambda seed: 0.5)),
    Planted("sonar beam twice as wide", _one("beam", "ping", lambda seed: 2.0)),
    Planted("channels swapped", _one("swap", "dirrs", lambda seed: 0.0)),
    Planted("channels swapped midway", _one("swap", "dirrs", lambda seed: 100.0)),
    Planted("infrared stuck for 20 s", _one("stuck", "dirrs", lambda seed: 60.0)),
    Planted("sonar stuck for 20 s", _one("stuck", "ping", lambda seed: 60.0)),
    Planted("15 % cross-talk of two sonars", _one("talk", "", lambda seed: 0.15),
            sensors=("ping_left", "ping", "dirrs"), recorded=False,
            mounts={"ping_left": SE2(0.0, 0.044, math.pi / 2)}),
    Planted("headings 5 degrees off", _one("heading", "", _five_deg), recorded=False),
    Planted("headings 5 degrees off, two infrared", _one("heading", "", _five_deg), recorded=False,
            sensors=("ping", "dirrs", "dirrs_left"),
            mounts={"dirrs_left": SE2(0.0, 0.03, math.pi / 2)}),
    Planted("headings drift by 2 degrees a minute",
            _one("turning", "", lambda seed: 2.0 * ONE_DEG / 60.0 * _sign(seed)), recorded=False),
    Planted("places drift by 5 cm a minute", _one("wandering", "", lambda seed: 0.05 / 60.0),
            recorded=False),
    Planted("each heading 5 degrees off, each place 1 cm", _one("noisy", "", _noisy),
            recorded=False),
    Planted("infrared dead for 20 s", _one("dead", "dirrs", lambda seed: 60.0)),
    Planted("half of the sonar's ranges at random", _one("random", "ping", lambda seed: 0.5),
            recorded=False),
    Planted("late and infrared turned", lambda seed: (
        Fault("late", "", _delay(seed + 1)), Fault("yaw", "dirrs", _yaw(seed)))),
    Planted("late and infrared bias", lambda seed: (
        Fault("late", "", _delay(seed)), Fault("bias", "dirrs", _bias(seed + 1)))),
    Planted("infrared turned and shifted sideways", lambda seed: (
        Fault("yaw", "dirrs", _yaw(seed)), Fault("left", "dirrs", _shift(seed + 2)))),
    Planted("late, and the beam twice as wide", lambda seed: (
        Fault("late", "", _delay(seed)), Fault("beam", "ping", 2.0))),
    Planted("infrared turned, and the channels swapped", lambda seed: (
        Fault("yaw", "dirrs", _yaw(seed)), Fault("swap", "dirrs"))),
    Planted("late, and the infrared stuck", lambda seed: (
        Fault("late", "", _delay(seed)), Fault("stuck", "dirrs", 60.0))),
)  # fmt: skip


class Kept:
    """Blocks as a session that can be gone through again and again."""

    def __init__(self, blocks: list[Block]) -> None:
        self._blocks = blocks

    def blocks(self, choice: Choice = ALL) -> Iterator[Block]:
        """What of it is wanted."""
        return map(choice.of, self._blocks)


def simulated(planted: Planted, seed: int, duration_s: float) -> HasBlocks:
    """One simulated run with the faults, in the first eight rooms in turn."""
    room = ROOMS[list(ROOMS)[seed % 8]]
    faults = planted.faults(seed)
    run = simulate(
        room, duration_s=duration_s, seed=1000 + seed, sensors=planted.sensors,
        faults=_as_run(faults), mounts=planted.mounts,
    )  # fmt: skip
    records = [Record(topic_of(message), log_ns, message) for log_ns, message in run]
    dead = [each for each in faults if each.kind == "dead"]
    records = [each for each in records if not any(map(partial(_is_lost, records[0], each), dead))]
    blocks = list(blocks_of(records))
    for fault in faults:
        if fault.kind == "swap":
            blocks = _swapped(blocks, records[0].log_ns + round(fault.amount * 1e9))
    return Kept(blocks)


def _is_lost(first: Record, record: Record, fault: Fault) -> bool:
    """Whether a record is a range of the sensor that is dead then."""
    since_s = (record.log_ns - first.log_ns) * 1e-9 - fault.amount
    mine = isinstance(record.message, Range) and record.message.sensor == fault.sensor
    return mine and 0.0 <= since_s < OUT_S


def _swapped(blocks: list[Block], from_ns: int) -> list[Block]:
    """The ranges of sonar and infrared ranger under each other's names from then on."""
    first = {c.sensor: c[:1] for b in reversed(blocks) for c in b.of(RangeColumns) if len(c)}
    swap = Swap("dirrs", "ping", from_ns, int(np.iinfo(np.int64).max), whole=False)
    return list(Exchanged(Kept(blocks), (first["dirrs"], first["ping"]), swap).blocks())


def _as_run(faults: Faults) -> RunFaults:
    run, sensors = SOUND, dict[str, SensorFaults]()
    for each in faults:
        name, mine = each.sensor, sensors.get(each.sensor, SensorFaults())
        match each.kind:
            case "late":
                run = replace(run, pose_delay_s=each.amount)
            case "talk":
                run = replace(run, cross_talk=each.amount)
            case "heading":
                run = replace(run, heading_bias_deg=math.degrees(each.amount))
            case "turning":
                run = replace(run, pose_drift_degpmin=60.0 * math.degrees(each.amount))
            case "wandering":
                run = replace(run, pose_drift_mpmin=60.0 * each.amount)
            case "noisy":
                run = replace(run, pose_noise_m=0.01, pose_noise_deg=math.degrees(each.amount))
            case "random":
                sensors[name] = replace(mine, random=each.amount)
            case "yaw" | "ahead" | "left":
                sensors[name] = replace(mine, mount=_moved(each) @ mine.mount)
            case "scale":
                sensors[name] = replace(mine, scale=each.amount)
            case "bias":
                sensors[name] = replace(mine, bias_m=each.amount)
            case "beam":
                known_deg = CATALOGUE[name].beam_width_deg
                sensors[name] = replace(mine, beam_width_deg=known_deg * each.amount)
            case "stuck":
                sensors[name] = replace(mine, stuck_s=(each.amount, each.amount + OUT_S))
    return replace(run, sensors=sensors)


def _moved(fault: Fault) -> SE2:
    return SE2(*(fault.amount if fault.kind == k else 0.0 for k in ("ahead", "left", "yaw")))


def recordings(folder: Path) -> list[Path]:
    """Those with exact poses and those with noisy ones."""
    return sorted(folder.glob("*_[AB].mcap"))


def recorded(planted: Planted, seed: int, folder: Path) -> HasBlocks:
    """A recorded session with the faults: those with exact poses and with noisy ones in turn."""
    files = recordings(folder)
    blocks = list(open_session(files[seed % len(files)]).blocks())
    start_ns = min(int(c.t_ns.min()) for b in blocks for c in b.of(RangeColumns) if len(c))
    for fault in planted.faults(seed):
        from_ns = start_ns + round(fault.amount * 1e9)
        if fault.kind == "swap":
            blocks = _swapped(blocks, from_ns)
            continue
        last: dict[str, float] = {}
        blocks = [
            Block(tuple(part for c in b.columns for part in _spoiled(c, fault, from_ns, last)))
            for b in blocks
        ]
    return Kept(blocks)


def _spoiled(
    columns: Columns, fault: Fault, from_ns: int, last: dict[str, float]
) -> Iterator[Columns]:
    """Columns with a fault; ``last`` is what a stuck sensor has measured last."""
    if isinstance(columns, PoseColumns) and fault.kind == "late":
        later_ns = round(fault.amount * 1e9)
        yield replace(columns, t_ns=columns.t_ns + later_ns, log_ns=columns.log_ns + later_ns)
    elif isinstance(columns, Mounts) and columns.child == fault.sensor and _moved(fault) != SE2(
        0.0, 0.0, 0.0
    ):  # fmt: skip
        stated = [m @ _moved(fault).inverse() for m in columns.motions()]
        x_m, y_m, heading_rad = np.array([(m.x_m, m.y_m, m.heading_rad) for m in stated]).T
        yield replace(columns, x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    elif isinstance(columns, RangeColumns) and columns.sensor == fault.sensor:
        if fault.kind == "dead":
            late_ns = columns.t_ns - from_ns
            columns = columns[(late_ns < 0) | (late_ns >= OUT_S * 1e9)]
        yield _read(columns, fault, from_ns, last)
    else:
        yield columns


def _read(
    columns: RangeColumns, fault: Fault, from_ns: int, last: dict[str, float]
) -> RangeColumns:
    range_m = columns.range_m
    match fault.kind:
        case "scale":
            range_m = range_m * fault.amount
        case "bias":
            range_m = range_m + fault.amount
        case "beam":  # what is stated is wrong, not what is
            return replace(columns, beam_width_rad=columns.beam_width_rad / fault.amount)
        case "stuck":
            before, held = columns.t_ns < from_ns, columns.t_ns < from_ns + round(OUT_S * 1e9)
            if before.any():
                last["range_m"] = float(range_m[before][-1])
            range_m = np.where(~before & held, last.get("range_m", math.inf), range_m)
    far = np.isfinite(range_m) & (range_m > columns.max_range_m)
    return replace(columns, range_m=np.where(far, math.inf, range_m))
