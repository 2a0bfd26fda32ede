"""Tables of text, for the terminal and in Markdown, from the same rows: the first is the head."""

from __future__ import annotations

from collections.abc import Container, Sequence

Rows = Sequence[Sequence[object]]


def text_table(rows: Rows, left: Container[int] = (0,)) -> list[str]:
    """Lines of columns that stand under each other; those numbered in ``left`` to the left."""
    cells = [[str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(
            f"{cell:{'<' if number in left else '>'}{width}}"
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]


def markdown_table(rows: Rows, right: Container[int] = ()) -> str:
    """The same in Markdown; the columns numbered in ``right`` to the right."""
    rule = ["--:" if number in right else "---" for number in range(len(rows[0]))]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in (rows[0], rule, *rows[1:]))
