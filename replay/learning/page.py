"""The verdict on sensors as one HTML page: words, figures and plots, no other file needed."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Sequence

import numpy as np

from mapping.diagnosis.causes.interface import Plot
from mapping.learning.sensors import LearnedSensor
from recorder.columns import Floats
from replay.diagnosis.page import svg
from replay.learning.text import table, verdict

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 46rem; margin: 2rem auto; padding: 0 1rem;
       color: #1b1f24; background: #fff; }
table { border-collapse: collapse; } td, th { padding: .15rem .8rem .15rem 0; text-align: left; }
svg { max-width: 100%; height: auto; }
"""
_STEPS = 200


def page(learned: Sequence[LearnedSensor], sources: Sequence[str]) -> str:
    """The whole page."""
    names = html.escape(", ".join(sources))
    body = "\n".join(part for each in learned for part in _section(each))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>What the sensors are '
        f"like</title><style>{_STYLE}</style></head>\n<body><h1>What the sensors are like</h1>"
        f"<p>Learned from {names}.</p>\n{body}\n</body></html>\n"
    )


def _section(learned: LearnedSensor) -> Iterator[str]:
    yield f"<h2>{html.escape(learned.sensor.name)}</h2>"
    yield f"<p>{html.escape(' '.join(verdict(learned)))}</p>"
    head, *rows = table(learned)
    yield "<table><tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in head) + "</tr>"
    for row in rows:
        yield "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
    yield "</table>"
    for plot in plots(learned):
        yield svg(plot)


def plots(learned: LearnedSensor) -> Iterator[Plot]:
    """Residuals against distance, their histogram with the mixture, hits by angle of incidence."""
    pairs, mixture = learned.pairs, learned.fit.mixture
    seen = np.isfinite(pairs.range_m)
    off_m = (pairs.range_m - pairs.true_m)[seen]
    shown = np.array([
        (b.from_m / 2 + b.to_m / 2, 100 * b.offset_m) for b in learned.by_range
        if not math.isnan(b.offset_m)
    ]).reshape(-1, 2)  # fmt: skip
    yield Plot(
        "each echo: how much too long (line: the median of right ones)", "true distance, m",
        "too long by, cm", np.column_stack([pairs.true_m[seen], 100 * off_m]), shown,
    )  # fmt: skip
    wide_m = 6.0 * float(np.median(mixture.std_m(pairs.true_m)))
    middle_m = float(np.median(mixture.mean_m(pairs.true_m) - pairs.true_m))
    places = np.linspace(middle_m - wide_m, middle_m + wide_m, _STEPS)
    counts, edges = np.histogram(off_m, 60, (places[0], places[-1]))
    density = counts / max(len(off_m), 1) / np.diff(edges)
    yield Plot(
        "how far off the echoes are (dots), and the mixture that was fitted (line)",
        "too long by, cm", "share per cm",
        np.column_stack([50 * (edges[1:] + edges[:-1]), density / 100]),
        np.column_stack([100 * places, _expected(learned, places) / 100]),
    )  # fmt: skip
    shares = np.array([
        (b.from_m / 2 + b.to_m / 2, 100 * b.hit) for b in learned.by_range
    ]).reshape(-1, 2)  # fmt: skip
    yield Plot("how many readings are right", "true distance, m", "%", shares, shares)
    by_angle = np.array([
        ((b.from_deg + b.to_deg) / 2, 100 * b.hit) for b in learned.by_incidence
    ]).reshape(-1, 2)  # fmt: skip
    if len(by_angle):
        yield Plot(
            "the same by the angle to the surface's normal", "angle of incidence, degrees", "%",
            by_angle, by_angle,
        )  # fmt: skip


def _expected(learned: LearnedSensor, off_m: Floats) -> Floats:
    """The density of offsets (M,) that the mixture expects of these readings' echoes."""
    mixture, pairs = learned.fit.mixture, learned.pairs
    d = pairs.true_m[:: max(1, len(pairs.true_m) // 2000), None]
    z, std = d + off_m, mixture.std_m(d)
    hit = np.exp(-0.5 * ((z - mixture.mean_m(d)) / std) ** 2) / (math.sqrt(2 * math.pi) * std)
    within = (z < d) & (z > 0.0)
    cut = -np.expm1(-mixture.short_per_m * d)
    short = np.where(within, mixture.short_per_m * np.exp(-mixture.short_per_m * z) / cut, 0.0)
    total = mixture.hit * hit + mixture.short * short + mixture.random / pairs.reach_m
    return np.asarray(total.mean(axis=0) / max(1.0 - mixture.none, 1e-9))
