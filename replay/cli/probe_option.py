"""``--probe x,y``: a point of the map, in metres."""

from __future__ import annotations

import click

Point = tuple[float, float]


def _points(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[Point, ...]:
    """The points; a usage error in one line where there are not two numbers."""
    points = []
    for text in given:
        try:
            x, y = (float(part) for part in text.split(","))
        except ValueError:
            raise click.BadParameter(f"{text!r} is not x,y in metres, as in 1.25,0.5") from None
        points.append((x, y))
    return tuple(points)


probe_option = click.option(
    "--probe", "probes", metavar="X,Y", multiple=True, callback=_points,
    help="Why is the cell at x,y (metres) so? Repeatable.",
)  # fmt: skip
