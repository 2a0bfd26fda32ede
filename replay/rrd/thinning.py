"""Keep a recording within its budget by leaving things out, and say what was left out.

What a reading costs is known only once some are written. So the writer reports the size of the
file from time to time. Where the rest of the session would not fit, the next stage is taken: first
the exact values are kept at fewer readings (the pictures stay), then fewer readings are shown.
Where it turns out cheaper, stages are taken back. All readings are mapped in any case.
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


_STAGES = (
    _Stage(1, True, 1, 1.0),
    _Stage(8, True, 1, 4.0),
    _Stage(64, True, 1, 2.0),
    _Stage(512, True, 1, 1.5),
    _Stage(512, False, 1, 1.3),
    *(_Stage(512, False, 2**k, 1.6) for k in range(1, 9)),
)
_RESERVE = 0.05  # of the budget, for what cannot be foreseen


@dataclass(slots=True)
class Thinning:
    """Which readings are shown (every ``every``-th at least), and which with exact values."""

    budget_bytes: float
    every: int = 1
    left_out: str = ""
    _stage: int = 0
    _strictest: int = 0
    _seen: int = 0
    _seen_then: int = 0
    _bytes_then: int = 0
    _shown_now: bool = field(default=True)

    def next_is_shown(self) -> bool:
        """Count one more reading; whether it is to be shown."""
        every = self.every * _STAGES[self._stage].every
        self._shown_now = self._seen % every == 0
        self._seen += 1
        return self._shown_now

    @property
    def exact(self) -> bool:
        """Whether the newest reading gets its exact values."""
        return self._shown_now and (self._seen - 1) % self._exact_every(self._stage) == 0

    @property
    def changes(self) -> bool:
        """Whether what a reading changed is drawn by itself."""
        return _STAGES[self._stage].changes

    def review(self, size_bytes: int, done: float, owed_bytes: int = 0) -> str:
        """Take another stage when the file would outgrow its budget, or an earlier one again.

        ``size_bytes`` is the file so far, ``done`` the part of the session's time that is mapped
        (0 .. 1), ``owed_bytes`` what the end will add however little is shown. Returns what was
        decided as a sentence, or nothing.
        """
        seen, grown = self._seen - self._seen_then, size_bytes - self._bytes_then
        self._seen_then, self._bytes_then = self._seen, size_bytes
        if not seen or not 0.0 < done < 1.0:
            return ""
        to_come = self._seen * (1.0 - done) / done
        room = max(self.budget_bytes * (1.0 - _RESERVE) - size_bytes - owed_bytes, 0.0)
        cost = grown / seen * to_come
        before = self._stage
        if cost > room:
            stages = 2 if cost > 3.0 * room else 1
            self._stage = min(self._stage + stages, len(_STAGES) - 1)
        elif cost * _STAGES[self._stage].saves < room:
            self._stage = max(self._stage - 1, 0)
        self._strictest = max(self._strictest, self._stage)
        if self._stage == before:
            return ""
        self.left_out = self._sentence(self._strictest, "at times ")
        return self._sentence(self._stage, "from here on ")

    def _exact_every(self, stage: int) -> int:
        return self.every * max(_STAGES[stage].exact, _STAGES[stage].every)

    def _sentence(self, stage: int, when: str) -> str:
        exact_every, every = self._exact_every(stage), self.every * _STAGES[stage].every
        shown = "every reading is" if every == 1 else f"only one reading of {every} is"
        kept = "all of them" if exact_every == self.every else f"one of {exact_every}"
        changes = "" if _STAGES[stage].changes else "; what each changed is not drawn by itself"
        return (
            f"To keep this file under {self.budget_bytes / 1e6:g} MB, {when}{shown} shown, and "
            f"exact values are kept at {kept}{changes}. All readings go into the map."
        )
