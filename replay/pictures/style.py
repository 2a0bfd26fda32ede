"""The style sheet of every picture: sizes, colours and line widths, in one place.

Lengths on the paper are in inches, widths of lines in points. The colours of what a map shows are
those of the recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from replay import colours

Colour = tuple[float, float, float]  # 0 to 1


def sensor_colour(sensor: str, sensors: Sequence[str]) -> Colour:
    """The colour of a sensor or layer among all of a session."""
    return _plain(colours.sensor_colours([*sensors, sensor])[sensor])


def _plain(colour: tuple[int, ...]) -> Colour:
    r, g, b = (each / 255.0 for each in colour[:3])
    return r, g, b


INK: Final = _plain((30, 34, 44))
PALE_INK: Final = _plain((100, 106, 120))
FREE: Final = _plain(colours.FREE)
OCCUPIED: Final = _plain(colours.OCCUPIED)
NEVER_SEEN: Final = _plain(colours.NEVER_SEEN)
FOUND_WALL: Final = _plain(colours.LINE)
ABOVE_THRESHOLD: Final = _plain(colours.ABOVE_THRESHOLD)
TRUE_WALL: Final = _plain(colours.TRUE_WALL)
BORDER: Final = _plain(colours.BORDER)
PATH: Final = _plain(colours.ROBOT)
ROBOT: Final = _plain(colours.ROBOT)
MORE_OCCUPIED: Final = _plain(colours.MORE_OCCUPIED)
MORE_FREE: Final = _plain(colours.MORE_FREE)

PAGE_WIDTH: Final = 10.0
MOST_PAGE_HEIGHT: Final = 40.0
TALLEST_PANEL: Final = 6.6
MARGIN: Final = 0.3
AXIS_LEFT, AXIS_BELOW, GAP, PANEL_TITLE = 0.62, 0.52, 0.28, 0.30
LINE: Final = 1.45  # height of a line of text, in heights of its letters
TITLE_PT, TEXT_PT, SMALL_PT = 15.0, 10.5, 8.5
DOTS_PER_INCH: Final = 160

# Nothing of the user's own matplotlibrc counts, so that a picture looks the same everywhere.
STYLE_SHEET: Final[dict[str, Any]] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": TEXT_PT,
    "text.color": INK,
    "axes.edgecolor": PALE_INK,
    "axes.labelcolor": PALE_INK,
    "axes.labelsize": SMALL_PT,
    "axes.linewidth": 0.6,
    "axes.facecolor": FREE,
    "axes.axisbelow": True,
    "xtick.color": PALE_INK,
    "ytick.color": PALE_INK,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "figure.facecolor": FREE,
    "figure.dpi": DOTS_PER_INCH,
    "savefig.dpi": "figure",
    "lines.solid_capstyle": "round",
    "svg.hashsalt": "echogrid",  # else the names inside an SVG are drawn anew each time
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "path.simplify": True,
}
