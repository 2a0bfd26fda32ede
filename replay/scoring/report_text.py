"""The score of a map as a table for people and as JSON for programs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mapping.scoring.cells import CellScore
from mapping.scoring.lines import LineScore
from replay.json_values import json_object
from replay.scoring.judging import ScoreReport
from replay.tables import text_table

_LEAST_GLASS_M = 0.05


def summary(report: ScoreReport) -> list[str]:
    """What the score comes to, line by line."""
    lines = []
    if report.layers:
        lines += [f"{report.path.name} against {report.truth_name}", f"judged over {report.basis}"]
        lines += ["", *text_table(_cell_rows(report))]
        glass = [
            f"{each.score.layer} {each.score.cells.glass_m:.1f} m" for each in report.layers
            if each.score.cells.glass_m >= _LEAST_GLASS_M
        ]  # fmt: skip
        if glass:
            lines += ["", f"glass that light went through, not judged: {', '.join(glass)}"]
        found = _line_rows(report)
        if len(found) > 1:
            lines += ["", *text_table(found, left=(0, 1))]
    elif report.held_out:
        lines += [f"{report.path.name}: no walls are known (--walls), so only without truth"]
    if report.held_out:
        lines += ["", *text_table(_held_out_rows(report))]
    return [*lines, *(f"note: {note}" for note in report.notes)]


def as_json(report: ScoreReport) -> dict[str, Any]:
    """The same figures by name; what could not be judged is null."""
    return {
        "map": str(report.path),
        "truth": report.truth_name or None,
        "judged_over": report.basis or None,
        "layers": {
            each.score.layer: {
                **json_object(each.score.cells, nulls=True),
                "lines": {line.source: json_object(line, nulls=True) for line in each.score.lines},
            }
            for each in report.layers
        },
        "held_out": {each.of: json_object(each, nulls=True) for each in report.held_out},
        "notes": list(report.notes),
    }


def _cell_rows(report: ScoreReport) -> list[list[str]]:
    rows = [
        [each.score.layer, *(show(each.score.cells) for _, show in _CELL_COLUMNS)]
        for each in report.layers
    ]
    return [["layer", *(title for title, _ in _CELL_COLUMNS)], *rows]


def _line_rows(report: ScoreReport) -> list[list[str]]:
    rows = [
        [each.score.layer, line.source, *(show(line) for _, show in _LINE_COLUMNS)]
        for each in report.layers
        for line in each.score.lines
    ]
    return [["lines of", "from", *(title for title, _ in _LINE_COLUMNS)], *rows]


def _held_out_rows(report: ScoreReport) -> list[list[str]]:
    rows = [["without truth", "readings", "log-likelihood", "95 % interval"]]
    for each in report.held_out:
        interval = f"{_number(each.low, 3)} .. {_number(each.high, 3)}"
        rows.append([each.of, f"{each.readings:,}", _number(each.log_likelihood, 3), interval])
    return rows


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{100.0 * value:.0f} %"


def _cm(value: float) -> str:
    return "-" if math.isnan(value) else f"{100.0 * value:.1f} cm"


def _within(line: LineScore, number: int) -> str:
    each = line.within[number]
    shares = (each.completeness, each.correctness)
    return "/".join("-" if math.isnan(share) else f"{100.0 * share:.0f}" for share in shares)


_CELL_COLUMNS: tuple[tuple[str, Callable[[CellScore], str]], ...] = (
    ("log-loss", lambda c: _number(c.log_loss, 3)),
    ("free", lambda c: _number(c.log_loss_free, 3)),
    ("walls", lambda c: _number(c.log_loss_walls, 3)),
    ("Brier", lambda c: _number(c.brier, 3)),
    ("AUC", lambda c: _number(c.auc, 3)),
    ("IoU", lambda c: _percent(c.iou)),
    ("calibration", lambda c: _number(c.calibration_error, 3)),
    ("off wall", lambda c: _cm(c.wall_distance_median_m)),
    ("95 %", lambda c: _cm(c.wall_distance_p95_m)),
    ("wall found", lambda c: _percent(c.wall_found)),
    ("ghosts", lambda c: f"{c.ghost_m2:.2f} m2"),
)  # fmt: skip
_LINE_COLUMNS: tuple[tuple[str, Callable[[LineScore], str]], ...] = (
    ("lines", lambda s: str(s.lines)),
    ("metres", lambda s: f"{s.length_m:.1f}"),
    ("2 cm", lambda s: _within(s, 0)),
    ("5 cm", lambda s: _within(s, 1)),
    ("10 cm", lambda s: _within(s, 2)),
    ("lines/wall", lambda s: _number(s.fragmentation, 1)),
    ("offset", lambda s: _cm(s.offset_m)),
    ("turned", lambda s: "-" if math.isnan(s.angle_deg) else f"{s.angle_deg:.1f} deg"),
    ("false", lambda s: str(s.false_lines)),
)  # fmt: skip
