"""How the viewer is laid out for several maps of one session: side by side, one view for each.

A tab for each layer shows that layer of every map, at the same scale and at the same place, so that
the eye can go from one to the next. Opens paused at the first step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun.blueprint as rrb

from mapping.artifacts import Started
from mapping.grid import GridGeometry
from replay.rrd import layout
from replay.rrd.blueprints import beside, layer_view
from replay.rrd.prefixed_stream import root_of


def comparison_blueprint(started: Mapping[str, Started]) -> rrb.Blueprint:
    """The layout for the maps of a comparison, by name, from how each of them starts."""
    geometry = _around([one.geometry for one in started.values()])
    layers = list(dict.fromkeys(layer for one in started.values() for layer in one.layers))
    tabs = []
    for layer in layers:
        views: list[rrb.View] = [
            layer_view(layer, geometry, name=view_name(name, layer), root=root_of(name))
            for name, one in started.items()
            if layer in one.layers
        ]
        tabs.append(beside(layer, views, geometry))
    first = root_of(next(iter(started)))
    side = rrb.Vertical(
        rrb.TextDocumentView(origin=layout.EXPLANATION, name="What this step does"),
        rrb.TimeSeriesView(
            origin=f"{first}{layout.RANGES}", name="Range of each reading, metres",
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
        ),
        rrb.Tabs(
            rrb.TextDocumentView(origin=layout.LEGEND, name="What the colours mean"),
            rrb.TextDocumentView(origin=layout.CONFIG, name="Configurations"),
            rrb.TextLogView(origin=layout.NOTICE, name="Left out"),
        ),
        row_shares=[5, 2, 3],
    )  # fmt: skip
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(*tabs, active_tab=0), side, column_shares=[7, 3]),
        rrb.TimePanel(timeline=layout.STEP, play_state="paused", state="collapsed", fps=4.0),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def view_name(name: str, layer: str) -> str:
    """What a map's view of a layer is called."""
    return f"{name}: {layer}"


def _around(geometries: Sequence[GridGeometry]) -> GridGeometry:
    """A grid about as large as all of them together: what every view shows."""
    low = np.min([each.origin_m for each in geometries], axis=0)
    high = np.max([np.add(each.origin_m, each.size_m) for each in geometries], axis=0)
    resolution = min(each.resolution_m for each in geometries)
    cols, rows = (max(round(float(size) / resolution), 1) for size in high - low)
    return GridGeometry((float(low[0]), float(low[1])), resolution, rows, cols)
