"""A diagnosis as one HTML page for a lab report: text, settings and plots, no other file needed."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence

import numpy as np

from mapping.diagnosis.causes.interface import Plot, Suspect
from mapping.diagnosis.diagnosing import Diagnosis
from recorder.columns import Floats
from replay.diagnosis.text import gain_text, settings_lines

_WIDTH, _LEFT, _BOTTOM, _TOP = 560, 64, 44, 28
_HEIGHT, _MAP_HEIGHT = 300, 480
_MOST_POINTS = 3000
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 46rem; margin: 2rem auto; padding: 0 1rem;
       color: #1b1f24; background: #fff; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
pre { background: #f3f5f7; padding: .7rem 1rem; overflow-x: auto; }
.sure { color: #57606a; font-weight: normal; } svg { max-width: 100%; height: auto; }
.maps { display: flex; flex-wrap: wrap; } .maps svg { flex: 1 1 20rem; min-width: 0; }
"""


def page(diagnosis: Diagnosis, session: str) -> str:
    """The whole page."""
    name = html.escape(session)
    body = "\n".join(_body(diagnosis, name))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{name}: what is '
        f"wrong with the map</title><style>{_STYLE}</style></head>\n<body>\n{body}\n</body>"
        "</html>\n"
    )


def _body(diagnosis: Diagnosis, name: str) -> Iterator[str]:
    yield f"<h1>{name}: what is wrong with the map</h1>"
    yield (
        f"<p>{diagnosis.readings} readings, judged by the map of the others: mean log-likelihood "
        f"{diagnosis.score:.3f}."
    )
    if diagnosis.gain is not None:
        yield f" With all that was found: {diagnosis.mended:.3f}, {gain_text(diagnosis.gain)}."
    yield "</p>"
    if diagnosis.plots:
        maps = "".join(svg(each, diagnosis.plots) for each in diagnosis.plots)
        yield f'<div class="maps">{maps}</div>'
    if not diagnosis.suspects:
        yield "<p>Nothing was found that makes this map worse.</p>"
    for number, suspect in enumerate(diagnosis.suspects, 1):
        yield from _section(number, suspect)
    for note in diagnosis.notes:
        yield f"<p>Note: {html.escape(note)}</p>"


def _section(number: int, suspect: Suspect) -> Iterator[str]:
    named = suspect.subject and suspect.text.startswith(suspect.subject)  # names stay as they are
    title = suspect.text if named else _sentence(suspect.text)
    yield (
        f"<h2>{number}. {html.escape(title)} "
        f'<span class="sure">{html.escape(suspect.sure)}</span></h2>'
    )
    for each in suspect.evidence:
        yield f"<p>{html.escape(_sentence(each))}.</p>"
    if suspect.gain is not None:
        yield f"<p>Gain in log-likelihood a reading: {gain_text(suspect.gain)}.</p>"
    if suspect.seconds:
        shown = ", ".join(f"{a:.1f} to {b:.1f} s" for a, b in suspect.seconds[:8])
        yield f"<p>Readings that show it: {shown}.</p>"
    if suspect.settings:
        text = "\n".join(settings_lines(suspect.settings))
        yield f"<p>What mends it:</p><pre>{html.escape(text)}</pre>"
    elif suspect.advice:
        yield f"<p>No setting mends it: {html.escape(suspect.advice)}.</p>"
    for plot in suspect.plots:
        yield svg(plot)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def svg(plot: Plot, beside: Sequence[Plot] = ()) -> str:
    """One plot as an inline picture, with the axes of those beside it."""
    shown = [
        values
        for each in (plot, *beside)
        for values in (each.points, each.line)
        if values is not None and len(values)
    ]
    if not shown:
        return ""
    every = np.concatenate(shown)
    x, y = _bounds(every[:, 0]), _bounds(every[:, 1])
    height = _MAP_HEIGHT if plot.is_map else _HEIGHT
    if plot.is_map:
        x, y = _same_scale(x, y, height)
    parts = [_axes(plot, x, y, height)]
    if plot.mark is not None and x[0] <= plot.mark <= x[1]:
        at = _place(np.array([[plot.mark, y[0]]]), x, y, height)[0, 0]
        parts.append(
            f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{_TOP}" y2="{height - _BOTTOM}" '
            'stroke="#bf5700" stroke-dasharray="5 4"/>'
        )
    if plot.points is not None and len(plot.points):
        some = plot.points[:: max(1, len(plot.points) // _MOST_POINTS)]
        dots = "".join(
            f'<circle cx="{across:.1f}" cy="{down:.1f}" r="1.4"/>'
            for across, down in _place(some, x, y, height)
        )
        parts.append(f'<g fill="#2f6f9f" fill-opacity=".45">{dots}</g>')
    if plot.line is not None and len(plot.line):
        at_each = _place(plot.line, x, y, height)
        way = " ".join(f"{across:.1f},{down:.1f}" for across, down in at_each)
        parts.append(f'<polyline points="{way}" fill="none" stroke="#2f6f9f" stroke-width="2"/>')
    return (
        f'<svg viewBox="0 0 {_WIDTH} {height}" width="{_WIDTH}" height="{height}" role="img" '
        f'font-size="12" fill="#1b1f24">{"".join(parts)}</svg>'
    )


def _bounds(values: Floats) -> tuple[float, float]:
    """Where an axis begins and ends: all values but the wildest one in two hundred."""
    low, high = (float(v) for v in np.quantile(values, [0.0025, 0.9975]))
    room = 0.06 * (high - low) or 1.0
    return low - room, high + room


def _same_scale(
    x: tuple[float, float], y: tuple[float, float], height: int
) -> list[tuple[float, float]]:
    """The same middles, and as many metres a point of the picture on both axes."""
    sizes = (_WIDTH - _LEFT - 16, height - _TOP - _BOTTOM)
    scale = max((b - a) / size for (a, b), size in zip((x, y), sizes, strict=True))
    return [
        (0.5 * (a + b - scale * size), 0.5 * (a + b + scale * size))
        for (a, b), size in zip((x, y), sizes, strict=True)
    ]


def _place(points: Floats, x: tuple[float, float], y: tuple[float, float], height: int) -> Floats:
    across = (points[:, 0] - x[0]) / (x[1] - x[0]) * (_WIDTH - _LEFT - 16) + _LEFT
    up = (points[:, 1] - y[0]) / (y[1] - y[0]) * (height - _TOP - _BOTTOM)
    inside = (points[:, 0] >= x[0]) & (points[:, 0] <= x[1])
    inside &= (points[:, 1] >= y[0]) & (points[:, 1] <= y[1])
    return np.column_stack([across, height - _BOTTOM - up])[inside]


def ticks(low: float, high: float) -> Floats:
    """About five round numbers between two."""
    raw = (high - low) / 5.0
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min((s for s in (1.0, 2.0, 5.0, 10.0) if s * power >= raw), default=10.0)
    return np.asarray(
        np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step + 0.0, np.float64
    )


def _axes(plot: Plot, x: tuple[float, float], y: tuple[float, float], height: int) -> str:
    base = height - _BOTTOM
    parts = [
        f'<text x="{_LEFT}" y="16" font-weight="600">{html.escape(plot.title)}</text>',
        f'<path d="M{_LEFT} {_TOP}V{base}H{_WIDTH - 16}" fill="none" stroke="#8c959f"/>',
        f'<text x="{(_LEFT + _WIDTH) / 2}" y="{height - 8}" text-anchor="middle">'
        f"{html.escape(plot.x)}</text>",
        f'<text transform="translate(14 {(base + _TOP) / 2}) rotate(-90)" text-anchor="middle">'
        f"{html.escape(plot.y)}</text>",
    ]
    for value in ticks(*x):
        at = _place(np.array([[value, y[0]]]), x, y, height)[0, 0]
        parts.append(f'<text x="{at:.1f}" y="{base + 16}" text-anchor="middle">{value:g}</text>')
    for value in ticks(*y):
        at = _place(np.array([[x[0], value]]), x, y, height)[0, 1]
        parts.append(
            f'<text x="{_LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{value:g}</text>'
            f'<path d="M{_LEFT} {at:.1f}H{_WIDTH - 16}" stroke="#8c959f" stroke-opacity=".25"/>'
        )
    return "".join(parts)
