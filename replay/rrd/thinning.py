"""Keep a recording within its budget by leaving things out, and report what was left out.

What a reading costs is known only once some are written. So the writer reports the size of the
file from time to time. Where the rest of the session would not fit, a later stage is taken: the
exact values are kept at fewer readings where they are what takes the room, then the differences
are not drawn, then fewer readings are shown. Where it turns out cheaper, stages are taken back.
All readings are mapped in any case.

The first readings cost the most: everything they see is new. What is left out cannot be had back,
so early on the rest may seem to be somewhat too much before anything is.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class _Stage:
    """Exact values at one reading of ``exact``; differences drawn or not; one of ``every`` shown.

    ``saves`` is about how many times less it costs than the stage before.
    """

    exact: int
    changes: bool
    every: int
    saves: float


_WHERE_EXACT_IS_DEAR = (
    _Stage(1, True, 1, 1.0),
    _Stage(64, True, 1, 4.0),
    _Stage(512, True, 1, 1.5),
    _Stage(512, False, 1, 1.3),
    *(_Stage(512, False, 2**k, 1.6) for k in range(1, 10)),
)
_WHERE_EXACT_IS_CHEAP = (
    _Stage(1, True, 1, 1.0),
    _Stage(1, False, 1, 1.1),
    *(_Stage(1, False, 2**k, 1.6) for k in range(1, 9)),
    _Stage(512, False, 512, 1.6),
)
_DEAR = 0.4  # share of what is written
_RESERVE = 0.05  # of the budget, for what cannot be foreseen
_REMEMBERED = 0.6  # of what a reading cost at another stage, from the beginning to the end
# Until this part of the session is done, or this part of the budget used, nothing is known yet.
_EARLY, _LITTLE = 0.02, 0.1
_PATIENCE = 0.6  # by how much the rest may seem too much at the very beginning; less and less later


@dataclass(frozen=True, slots=True)
class Detail:
    """How much of one reading is recorded: whether it is drawn, with its exact values, and with
    what it changed. ``left_out`` describes what was left out so far."""

    shown: bool = True
    exact: bool = True
    changes: bool = True
    left_out: str = ""


@dataclass(slots=True)
class Thinning:
    """Which readings are shown (every ``every``-th at least), and which with exact values."""

    budget_bytes: float
    every: int = 1
    left_out: str = ""
    _stages: tuple[_Stage, ...] = _WHERE_EXACT_IS_DEAR
    _stage: int = 0
    _costs: dict[int, float] = field(default_factory=dict)
    _strictest: tuple[int, _Stage] = (0, _WHERE_EXACT_IS_DEAR[0])
    _seen: int = 0
    _seen_then: int = 0
    _bytes_then: int = 0
    _reserved_then: int = 0
    _done_then: float = 0.0

    def next(self) -> Detail:
        """Count one more reading; how much of it is to be recorded.

        One that is not shown has its exact values where all that are shown have theirs.
        """
        stage = self._stages[self._stage]
        every, exact_every = self.every * stage.every, self._exact_every(stage)
        shown = self._seen % every == 0
        exact = self._seen % exact_every == 0 if shown else exact_every == every
        self._seen += 1
        return Detail(shown, exact, stage.changes, self.left_out)

    def review(
        self, size_bytes: int, done: float, reserved_bytes: int = 0, exact_share: float = 1.0
    ) -> str:
        """Take another stage when the file would outgrow its budget, or an earlier one again.

        ``size_bytes`` is the file so far, ``done`` the part of the session's time that is mapped
        (0 .. 1), ``reserved_bytes`` what the end will add however little is shown, ``exact_share``
        the part of what was written lately that is exact values. Returns what was decided as a
        sentence, or nothing.
        """
        seen, grown = self._seen - self._seen_then, size_bytes - self._bytes_then
        self._seen_then, self._bytes_then = self._seen, size_bytes
        if not seen or not 0.0 < done < 1.0:
            return ""
        to_come = self._seen * (1.0 - done) / done
        before = self._stage
        if before == 0:
            self._choose_stages(exact_share)
        cost = grown / seen
        self._remember(cost, done)
        reserved_bytes += self._growth_of_reserved(reserved_bytes, done)
        room = max(self.budget_bytes * (1.0 - _RESERVE) - size_bytes - reserved_bytes, 0.0)
        if done < _EARLY and size_bytes < _LITTLE * self.budget_bytes:
            return ""
        if cost * to_come > room * (1.0 + _PATIENCE * (1.0 - done)):
            self._stage = self._later_stage(cost, room / to_come)
        else:
            self._stage = self._earlier_stage(cost, room / to_come)
        if self._stage == before:
            return ""
        now = self._stages[self._stage]
        if self._stage >= self._strictest[0]:
            self._strictest = (self._stage, now)
        self.left_out = self._sentence(self._strictest[1], "in a part of it")
        if self._stage == 0:
            return "From here on nothing is left out again."
        return self._sentence(now, "from here on")

    def _growth_of_reserved(self, reserved_bytes: int, done: float) -> int:
        """How much more the end will add, if the map goes on growing as it did lately.

        Twice as much at most: a map grows fast at first.
        """
        reserved_then, done_then = self._reserved_then, self._done_then
        self._reserved_then, self._done_then = reserved_bytes, done
        if done_then == 0.0 or done <= done_then:
            return 0
        growth = (reserved_bytes - reserved_then) * (1.0 - done) / (done - done_then)
        return int(min(max(growth, 0.0), reserved_bytes))

    def _choose_stages(self, exact_share: float) -> None:
        stages = _WHERE_EXACT_IS_DEAR if exact_share > _DEAR else _WHERE_EXACT_IS_CHEAP
        if stages is not self._stages:
            self._stages = stages
            self._costs.clear()

    def _remember(self, cost: float, done: float) -> None:
        """Note what a reading costs at this stage; what others cost counts less, the longer ago."""
        for stage in self._costs:
            self._costs[stage] *= _REMEMBERED ** (done - self._done_then)
        self._costs[self._stage] = cost

    def _later_stage(self, cost: float, most: float) -> int:
        """The first stage, after the one that costs so much now, that may cost ``most`` or less."""
        stage = self._stage
        while stage < len(self._stages) - 1:
            stage += 1
            cost /= self._stages[stage].saves
            if cost <= most:
                break
        return stage

    def _earlier_stage(self, cost: float, most: float) -> int:
        """The first stage, up to the one that costs so much now, that may cost ``most`` or less."""
        stage = self._stage
        while stage:
            cost = max(cost * self._stages[stage].saves, self._costs.get(stage - 1, 0.0))
            if cost > most:
                break
            stage -= 1
        return stage

    def _exact_every(self, stage: _Stage) -> int:
        return self.every * max(stage.exact, stage.every)

    def _sentence(self, stage: _Stage, where: str) -> str:
        every = self.every * stage.every
        parts = ["every reading is shown" if every == 1 else f"one reading of {every} is shown"]
        if self._exact_every(stage) != every:
            parts.append(f"exact values are kept at one of {self._exact_every(stage)} readings")
        if not stage.changes:
            parts.append("the differences that readings made are not drawn")
        *but_last, last = parts
        what = f"{', '.join(but_last)} and {last}" if but_last else last
        return (
            f"To stay under {self.budget_bytes / 1e6:g} MB, this file leaves something out: "
            f"{where} {what}. All readings go into the map."
        )
