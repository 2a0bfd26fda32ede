"""How many threads a map takes."""

from __future__ import annotations

import os

import pytest

from replay import mapping_run


@pytest.mark.parametrize(
    ("load", "threads"), [(0.0, 4), (0.4, 4), (0.6, 3), (2.0, 2), (3.9, 1), (50.0, 1)]
)
def test_busy_processors_are_left_alone(
    load: float, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mapping_run, "cores", lambda: 4)
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 9.0, 9.0), raising=False)
    assert mapping_run.idle_cores() == threads


def test_where_no_load_is_known_all_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapping_run, "cores", lambda: 4)
    monkeypatch.delattr(os, "getloadavg", raising=False)
    assert mapping_run.idle_cores() == 4
