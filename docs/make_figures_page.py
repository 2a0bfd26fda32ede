"""The list of docs/figures.md again, from the table: ``python docs/make_figures_page.py``.

The text around the list is kept; what stands between its two marks is written anew.
"""

from __future__ import annotations

import itertools
from pathlib import Path

from replay.pictures.figures.table import NUMBERED, command_of, map_command_of, stem_of
from replay.tables import markdown_table

PAGE = Path(__file__).resolve().parent / "figures.md"
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"
SESSION = "run.mcap"
LAYERS = {"any": "ping", "narrow": "dirrs"}


def listing() -> str:
    """A table for each of the chapter's headings: number, figure, file, commands."""
    parts = []
    groups = itertools.groupby(NUMBERED.items(), lambda each: each[1].passage)
    for passage, figures in groups:
        rows = [("", "figure", "file", "command")]
        for number, figure in figures:
            commands = command_of(number, SESSION), map_command_of(
                number, SESSION, LAYERS.get(figure.role, "")
            )  # fmt: skip
            text = "<br>".join(f"`{command}`" for command in commands if command)
            rows.append((str(number), figure.title, f"`{stem_of(number)}.png`", text))
        parts.append(f"### {passage}\n\n{markdown_table(rows)}")
    return "\n\n".join(parts)


def with_listing(page: str) -> str:
    """The page with its list as the table of figures is now."""
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise SystemExit(f"{PAGE.name} lacks the marks {BEGIN} and {END}")
    return f"{head}{BEGIN}\n\n{listing()}\n\n{END}{tail}"


if __name__ == "__main__":
    PAGE.write_text(with_listing(PAGE.read_text("utf-8")), "utf-8")
    print(f"wrote {len(NUMBERED)} figures into {PAGE}")
