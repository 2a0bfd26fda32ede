"""One page with all figures, to be looked at in a browser and printed on A4."""

from __future__ import annotations

import itertools
from html import escape
from typing import TYPE_CHECKING

from recorder.names import printable
from recorder.versions import own_version
from replay.pictures.figures.table import NUMBERED, stem_of

if TYPE_CHECKING:
    from replay.pictures.figures.writing import Made, Outcome

_STYLE = """
@page { size: A4; margin: 15mm; }
body { font-family: "DejaVu Sans", Verdana, sans-serif; color: #1e222c; max-width: 62rem;
  margin: 0 auto; padding: 1rem; line-height: 1.45; }
h1 { margin-bottom: 0.2rem; }
h2 { border-bottom: 1px solid #969eb2; padding-bottom: 0.2rem; margin-top: 2.2rem;
  break-after: avoid; }
figure { margin: 1.6rem 0; break-inside: avoid; }
figure img { display: block; width: 100%; max-height: 165mm; object-fit: contain;
  object-position: left; }
figcaption { margin-top: 0.4rem; }
figcaption b { margin-right: 0.4em; }
code { display: block; font-size: 0.8rem; color: #646a78; overflow-wrap: anywhere;
  margin-top: 0.3rem; }
nav { columns: 2; font-size: 0.9rem; }
nav a { display: block; color: inherit; break-inside: avoid; }
.pale { color: #646a78; }
@media print { nav { display: none; } body { padding: 0; max-width: none; font-size: 10pt; } }
"""


def figures_page(session: str, outcome: Outcome) -> str:
    """The page as HTML; what it shows lies beside it. Names are escaped."""
    name = escape(printable(session))
    count = len(outcome.made)
    links = "".join(
        f'<a href="#figure-{made.number}">{made.number}. '
        f"{escape(NUMBERED[made.number].title)}</a>\n"
        for made in outcome.made
    )
    notes = "".join(f"<p class=pale>{escape(note)}.</p>\n" for note in outcome.notes)
    return (
        "<!DOCTYPE html>\n<html lang=en>\n<meta charset=utf-8>\n"
        '<meta name=viewport content="width=device-width, initial-scale=1">\n'
        f"<title>Figures of {name}</title>\n<style>{_STYLE}</style>\n"
        f"<h1>From readings to walls</h1>\n<p class=pale>{count} figures of {name}, "
        f"made by echogrid {escape(own_version())}.</p>\n{notes}"
        f"<nav>\n{links}</nav>\n{_sections(outcome)}{_left_out(outcome)}</html>\n"
    )


def _sections(outcome: Outcome) -> str:
    parts = []
    for passage, some in itertools.groupby(outcome.made, lambda m: NUMBERED[m.number].passage):
        parts.append(f"<h2>{escape(passage)}</h2>\n")
        parts += [_figure(made) for made in some]
    return "".join(parts)


def _figure(made: Made) -> str:
    figure, caption = NUMBERED[made.number], escape(made.caption)
    commands = "".join(f"<code>{escape(c)}</code>" for c in (made.command, made.map_command) if c)
    return (
        f'<figure id="figure-{made.number}">\n'
        f'<img src="{stem_of(made.number)}.svg" alt="{caption}">\n'
        f"<figcaption><b>Figure {made.number}. {escape(figure.title)}.</b>{caption}"
        f"{commands}</figcaption>\n</figure>\n"
    )


def _left_out(outcome: Outcome) -> str:
    if not outcome.left_out:
        return ""
    lines = "".join(
        f"<li>{number}. {escape(NUMBERED[number].title)}: {escape(printable(why))}</li>\n"
        for number, why in outcome.left_out
    )
    return f"<h2>Left out</h2>\n<ul>\n{lines}</ul>\n"
