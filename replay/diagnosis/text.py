"""A diagnosis in lines for the terminal, and as plain values for programs."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import tomlkit

from mapping.diagnosis.causes.interface import Suspect
from mapping.diagnosis.diagnosing import Diagnosis
from mapping.scoring.held_out import Gain

WIDTH = 96


def lines(diagnosis: Diagnosis) -> Iterator[str]:
    """The suspects in order, each with what mends it; and what all of it gains."""
    if not diagnosis.suspects:
        yield f"nothing found that makes this map worse ({diagnosis.readings} readings)"
    for number, suspect in enumerate(diagnosis.suspects, 1):
        yield f"{number}. {suspect.text}: {suspect.sure}"
        if suspect.gain is not None:
            yield f"   gain {gain_text(suspect.gain)}"
        for each in suspect.evidence:
            yield from _wrapped(each)
        if suspect.seconds:
            yield from _wrapped(f"look at {_stretches(suspect)}")
        if suspect.settings:
            yield from (f"   set {line}" for line in settings_lines(suspect.settings))
        elif suspect.advice:
            yield from _wrapped(f"no setting mends it: {suspect.advice}")
    if diagnosis.gain is not None:
        yield (
            f"score without truth {diagnosis.score:.3f}, with what was found "
            f"{diagnosis.mended:.3f}: gain {gain_text(diagnosis.gain)}"
        )


def gain_text(gain: Gain) -> str:
    """With its interval."""
    return f"{gain.mean:+.3f} ({gain.low:+.3f} to {gain.high:+.3f}, 95 %)"


def settings_lines(settings: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """As ``map --set`` takes them."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from settings_lines(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}={_plain(value)}"


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{','.join(f'{each:g}' for each in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _stretches(suspect: Suspect) -> str:
    shown = [f"{first:.1f} to {end:.1f} s" for first, end in suspect.seconds[:4]]
    more = len(suspect.seconds) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _wrapped(text: str) -> Iterator[str]:
    yield from textwrap.wrap(text, WIDTH, initial_indent="   ", subsequent_indent="   ")


def as_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Plain values, the plots left out."""
    return {
        "readings": diagnosis.readings, "score": diagnosis.score, "mended": diagnosis.mended,
        "gain": _gain(diagnosis.gain), "settings": dict(diagnosis.fix),
        "suspects": [
            {
                "cause": each.cause, "subject": each.subject, "text": each.text, "sure": each.sure,
                "cost": each.cost, "value": each.value, "unit": each.unit,
                "gain": _gain(each.gain), "settings": each.settings, "advice": each.advice,
                "evidence": list(each.evidence), "seconds": [list(s) for s in each.seconds],
            }
            for each in diagnosis.suspects
        ],
        "notes": list(diagnosis.notes),
    }  # fmt: skip


def _gain(gain: Gain | None) -> dict[str, float] | None:
    return None if gain is None else {"mean": gain.mean, "low": gain.low, "high": gain.high}


def fix_toml(diagnosis: Diagnosis, session: str) -> str:
    """The configuration that mends it, as ``map --config`` takes it, with why as comments."""
    document = tomlkit.document()
    document.add(tomlkit.comment(f"What `echogrid diagnose {session}` found:"))
    for suspect in diagnosis.suspects:
        document.add(tomlkit.comment(f"{suspect.text} ({suspect.sure})"))
    if not diagnosis.suspects:
        document.add(tomlkit.comment("nothing"))
    settings = diagnosis.config.model_dump(exclude_unset=True, exclude_none=True, mode="json")
    for key, value in settings.items():
        document.add(key, value)
    return tomlkit.dumps(document)
