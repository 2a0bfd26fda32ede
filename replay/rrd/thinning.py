"""Keep a recording within its budget by leaving things out, and say what was left out.

What a reading costs is known only once some are written. So the writer reports the size of the
file from time to time. Where the rest of the session would not fit, the next stage is taken: the
exact values are kept at fewer readings where they are what takes the room, then the differences
are not drawn, then fewer readings are shown. Where it turns out cheaper, stages are taken back.
All readings are mapped in any case.
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


@dataclass(slots=True)
class Thinning:
    """Which readings are shown (every ``every``-th at least), and which with exact values."""

    budget_bytes: float
    every: int = 1
    left_out: str = ""
    _stages: tuple[_Stage, ...] = _WHERE_EXACT_IS_DEAR
    _stage: int = 0
    _costs: dict[int, float] = field(default_factory=dict)  # bytes a reading, by stage
    _strictest: tuple[int, _Stage] = (0, _WHERE_EXACT_IS_DEAR[0])
    _seen: int = 0
    _seen_then: int = 0
    _bytes_then: int = 0
    _shown_now: bool = field(default=True)

    def next_is_shown(self) -> bool:
        """Count one more reading; whether it is to be shown."""
        every = self.every * self._stages[self._stage].every
        self._shown_now = self._seen % every == 0
        self._seen += 1
        return self._shown_now

    @property
    def exact(self) -> bool:
        """Whether the newest reading gets its exact values."""
        return (
            self._shown_now and (self._seen - 1) % self._exact_every(self._stages[self._stage]) == 0
        )

    @property
    def tells_all(self) -> bool:
        """Whether every reading shown gets them."""
        stage = self._stages[self._stage]
        return self._exact_every(stage) == self.every * stage.every

    @property
    def changes(self) -> bool:
        """Whether what a reading changed is drawn by itself."""
        return self._stages[self._stage].changes

    def review(
        self, size_bytes: int, done: float, owed_bytes: int = 0, exact_share: float = 1.0
    ) -> str:
        """Take another stage when the file would outgrow its budget, or an earlier one again.

        ``size_bytes`` is the file so far, ``done`` the part of the session's time that is mapped
        (0 .. 1), ``owed_bytes`` what the end will add however little is shown, ``exact_share`` the
        part of what was written lately that is exact values. Returns what was decided as a
        sentence, or nothing.
        """
        seen, grown = self._seen - self._seen_then, size_bytes - self._bytes_then
        self._seen_then, self._bytes_then = self._seen, size_bytes
        if not seen or not 0.0 < done < 1.0:
            return ""
        to_come = self._seen * (1.0 - done) / done
        room = max(self.budget_bytes * (1.0 - _RESERVE) - size_bytes - owed_bytes, 0.0)
        before = self._stage
        if before == 0:
            self._choose_stages(exact_share)
        self._costs[before] = grown / seen
        cost = self._costs[before] * to_come
        if cost > room:
            stages = 2 if cost > 3.0 * room else 1
            self._stage = min(before + stages, len(self._stages) - 1)
        elif before and self._cost_before(before) * to_come < room:
            self._stage = before - 1
        if self._stage == before:
            return ""
        now = self._stages[self._stage]
        if self._stage >= self._strictest[0]:
            self._strictest = (self._stage, now)
        self.left_out = self._sentence(self._strictest[1], "in a part of it")
        if self._stage == 0:
            return "From here on nothing is left out again."
        return self._sentence(now, "from here on")

    def _choose_stages(self, exact_share: float) -> None:
        stages = _WHERE_EXACT_IS_DEAR if exact_share > _DEAR else _WHERE_EXACT_IS_CHEAP
        if stages is not self._stages:
            self._stages = stages
            self._costs.clear()

    def _cost_before(self, stage: int) -> float:
        """What a reading costs a stage earlier: what it did cost, or a guess if that is more."""
        guess = self._costs[stage] * self._stages[stage].saves
        return max(self._costs.get(stage - 1, 0.0), guess)

    def _exact_every(self, stage: _Stage) -> int:
        return self.every * max(stage.exact, stage.every)

    def _sentence(self, stage: _Stage, where: str) -> str:
        every = self.every * stage.every
        said = ["every reading is shown" if every == 1 else f"one reading of {every} is shown"]
        if self._exact_every(stage) != every:
            said.append(f"exact values are kept at one of {self._exact_every(stage)} readings")
        if not stage.changes:
            said.append("the differences that readings made are not drawn")
        told = f"{', '.join(said[:-1])} and {said[-1]}" if len(said) > 1 else said[0]
        return (
            f"To stay under {self.budget_bytes / 1e6:g} MB, this file leaves something out: "
            f"{where} {told}. All readings go into the map."
        )
