"""How the viewer is laid out when a recording opens: the maps large, what happens in words beside.

Opens paused at the first step. The sensors' maps stand side by side, so that every step shows
something happen; the fused map, the classes and what each reading changed are tabs above.
"""

from __future__ import annotations

import rerun.blueprint as rrb

from mapping.artifacts import Started
from mapping.fusion import FUSED
from mapping.grid import GridGeometry
from replay.rrd import layout

_MARGIN = 0.02  # of the grid's size, around it
_WORTH = 0.8  # the sensors' maps may shrink to this, for all maps to be seen together
_MAP_AREA = (1.4, 1.0)  # shape of the part of a usual window that the maps get
_TIMELINES = (layout.STEP, layout.READING, layout.TIME)


def default_blueprint(started: Started) -> rrb.Blueprint:
    """The layout for a grid and its layers."""
    sensors = [name for name in started.layers if name != FUSED] or [FUSED]
    geometry = started.geometry
    maps = [_layer_view(name, geometry) for name in sensors]
    together = []
    if FUSED in started.layers and FUSED not in sensors:
        together.append(_layer_view(FUSED, geometry, name="fused"))
        together.append(
            _map_view("classes: where the sensors agree", [f"{layout.CLASSES}/**"], geometry)
        )
    room_for_all = _scale(len(maps) + 2, geometry) >= _WORTH * _scale(len(maps), geometry)
    tabs: list[rrb.View | rrb.Container]
    if together and room_for_all:
        tabs = [_beside("Maps", [*maps, *together], geometry)]
    else:
        tabs = [_beside("Maps", maps, geometry), *together]
    changes = [_layer_view(name, geometry, changes=True) for name in sensors]
    tabs.append(_beside("What changed", changes, geometry))
    beside = rrb.Vertical(
        rrb.TextDocumentView(origin=layout.EXPLANATION, name="What this step does"),
        rrb.TimeSeriesView(
            origin=layout.RANGES, name="Range of each reading, metres",
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
        ),
        rrb.Tabs(
            rrb.TextDocumentView(origin=layout.LEGEND, name="What the colours mean"),
            rrb.TextDocumentView(origin=layout.CONFIG, name="Configuration"),
            rrb.TextLogView(origin=layout.NOTICE, name="Left out"),
        ),
        row_shares=[4, 3, 4],
    )  # fmt: skip
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(*tabs, active_tab=0), beside, column_shares=[7, 3]),
        rrb.TimePanel(timeline=layout.STEP, play_state="paused", state="collapsed", fps=4.0),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _beside(name: str, views: list[rrb.View], geometry: GridGeometry) -> rrb.View | rrb.Container:
    """Views in rows and columns, so that the maps come out as large as they can."""
    if len(views) == 1:
        return views[0]
    return rrb.Grid(*views, grid_columns=_columns(len(views), geometry), name=name)


def _columns(count: int, geometry: GridGeometry) -> int:
    """Into how many columns that many maps fit best."""
    return max(range(1, count + 1), key=lambda columns: _fit(count, columns, geometry))


def _scale(count: int, geometry: GridGeometry) -> float:
    """How large that many maps are drawn, together, at best."""
    return _fit(count, _columns(count, geometry), geometry)


def _fit(count: int, columns: int, geometry: GridGeometry) -> float:
    width, height = geometry.size_m
    rows = -(-count // columns)
    return min(_MAP_AREA[0] / columns / width, _MAP_AREA[1] / rows / height)


def _layer_view(
    layer: str, geometry: GridGeometry, *, name: str = "", changes: bool = False
) -> rrb.Spatial2DView:
    """One layer with its overlays; ``changes`` shows what a reading changed, not what it says."""
    hidden = layout.temp(layer) if changes else layout.change(layer)
    contents = [f"{layout.layer_root(layer)}/**", layout.ROBOT, layout.PATH, layout.WALLS]
    overrides = {
        hidden: rrb.EntityBehavior(visible=False),
        layout.points(layer): _from_the_start(),
        layout.PATH: _from_the_start(),
    }
    title = name or (f"{layer}: what changed" if changes else layer)
    return _map_view(title, contents, geometry, overrides)


def _map_view(
    name: str,
    contents: list[str],
    geometry: GridGeometry,
    overrides: dict[str, rrb.EntityBehavior | rrb.VisibleTimeRanges] | None = None,
) -> rrb.Spatial2DView:
    """A view of the map plane, y up, that the whole grid just fits into."""
    (x, y), (width, height) = geometry.origin_m, geometry.size_m
    margin = _MARGIN * max(width, height)
    bounds = rrb.VisualBounds2D(
        x_range=[x - margin, x + width + margin], y_range=[-(y + height) - margin, -y + margin]
    )
    return rrb.Spatial2DView(
        origin="/", contents=[layout.MAP, *contents], name=name, visual_bounds=bounds,
        overrides=overrides,
    )  # fmt: skip


def _from_the_start() -> rrb.VisibleTimeRanges:
    """All that an entity ever showed up to the current step, on whichever timeline."""
    boundary = rrb.TimeRangeBoundary
    return rrb.VisibleTimeRanges([
        rrb.VisibleTimeRange(name, start=boundary.infinite(), end=boundary.cursor_relative(seq=0))
        for name in _TIMELINES
    ])  # fmt: skip
