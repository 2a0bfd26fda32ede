"""Damaged lines: none of them may pass with a value that was not sent. Fresh seeds each run."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.recorder_corruption import BATCH_LINES, KINDS, Tally, try_batch, upper_bound


@pytest.mark.parametrize("kind", KINDS)
def test_no_damage_passes_with_a_wrong_value(kind: str) -> None:
    entropy = np.random.SeedSequence().entropy
    assert isinstance(entropy, int)
    tally = try_batch(kind, (entropy, 0))
    assert tally.wrong == 0, f"seed {entropy}"
    assert tally.damaged > 0.2 * BATCH_LINES, "fewer lines than meant were damaged"
    assert tally.right < 0.1 * tally.damaged, "what is called damage does none"


def test_a_weaker_checksum_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The count of wrong values is not 0 because nobody looks."""
    monkeypatch.setattr("recorder.protocols.echogrid.zlib.crc32", len)
    assert try_batch("one character looks sound", (1, 2)).wrong > 100


def test_the_bound_is_the_rule_of_three() -> None:
    assert upper_bound(0, 10_000_000) == pytest.approx(3e-7, rel=0.01)
    assert upper_bound(1, 1000) == pytest.approx(4.744e-3, rel=0.001)  # a table of Poisson bounds
    assert Tally(1, 2, 3) + Tally(4, 5, 6) == Tally(5, 7, 9)
