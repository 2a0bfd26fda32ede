"""Reading filters: wrong ranges are left out before they reach a map, and each can be looked at."""

from __future__ import annotations

from mapping.filters.neighbours import Neighbours
from mapping.filters.prediction import PredictionFilter
from mapping.filters.rejections import Rejections
from mapping.filters.table import FILTERS, OFF, PREDICTED, Verdicts

__all__ = [
    "FILTERS",
    "OFF",
    "PREDICTED",
    "Neighbours",
    "PredictionFilter",
    "Rejections",
    "Verdicts",
]
