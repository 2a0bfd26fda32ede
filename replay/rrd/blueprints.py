"""How the viewer is laid out when a recording opens: the maps large, what happens as text beside.

Opens paused at the first step. The sensors' maps stand side by side, so that every step shows
something happen; the fused map, the classes and what each reading changed are tabs above.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mapping.artifacts import Started
from mapping.fusion import FUSED
from mapping.grid import GridGeometry
from replay.rrd import layout
from replay.rrd.display_layers import OF_ONE, OF_SEVERAL, TITLES

MAPS, CHANGES, DISPLAYS = "Maps", "What changed", "Other ways to draw them"
THRESHOLDS = "Thresholds side by side"
RANGES = "Range of each reading, metres"

_PERCENT = (-5.0, 105.0)  # of a belief, with a little air
_MARGIN = 0.02  # of the grid's size, around it
_MAP_AREA = (1.4, 1.0)  # shape of the part of a usual window that the maps get
_TIMELINES = (layout.STEP, layout.READING, layout.TIME)


def default_blueprint(
    started: Started,
    *,
    probes: Sequence[str] = (),
    displays: Sequence[str] = (),
    following: bool = False,
    thresholds: Sequence[float] = (),
) -> rrb.Blueprint:
    """The layout for a grid and its layers.

    ``probes`` are the names of the watched cells, ``displays`` the further ways in which the maps
    are drawn. ``thresholds`` stand side by side in a tab. ``following`` stays at what
    happened last.
    """
    tabs = [*_tabs(started, displays), *_threshold_tab(started, thresholds)]
    side = [_plots(probes), _papers(probes)]
    return _laid_out(tabs, side, [4, 3, 4], "following" if following else "paused")


def comparison_blueprint(started: Mapping[str, Started]) -> rrb.Blueprint:
    """The layout for several maps of one session, by name, from how each of them starts.

    A tab for each layer shows that layer of every map, at the same scale and at the same place, so
    that the eye can go from one to the next.
    """
    geometry = _around([one.geometry for one in started.values()])
    layers = list(dict.fromkeys(layer for one in started.values() for layer in one.layers))
    tabs = []
    for layer in layers:
        views: list[rrb.View] = [
            layer_view(layer, geometry, name=f"{name}: {layer}", root=layout.root_of(name))
            for name, one in started.items()
            if layer in one.layers
        ]
        tabs.append(beside(layer, views, geometry))
    first = layout.root_of(next(iter(started)))
    papers = _papers((), "Configurations")
    return _laid_out(tabs, [_range_plot(first), papers], [5, 2, 3])


def _laid_out(
    tabs: Sequence[rrb.View | rrb.Container],
    side: Sequence[rrb.View | rrb.Container],
    side_shares: Sequence[int],
    play_state: Literal["following", "paused"] = "paused",
) -> rrb.Blueprint:
    """The maps large; beside them what the step does, and below that the ``side``."""
    text = rrb.TextDocumentView(origin=layout.EXPLANATION, name="What this step does")
    beside_maps = rrb.Vertical(text, *side, row_shares=list(side_shares))
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(*tabs, active_tab=0), beside_maps, column_shares=[7, 3]),
        rrb.TimePanel(timeline=layout.STEP, play_state=play_state, state="collapsed", fps=4.0),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _tabs(started: Started, displays: Sequence[str]) -> list[rrb.View | rrb.Container]:
    """The maps, what changed, and the other ways to draw the maps; each tab has its name."""
    sensors = [name for name in started.layers if name != FUSED] or [FUSED]
    geometry = started.geometry
    maps = [layer_view(name, geometry, displays) for name in sensors]
    together = []
    if FUSED in started.layers and FUSED not in sensors:
        together.append(layer_view(FUSED, geometry, displays, name="fused"))
        together.append(
            _map_view("classes: where the sensors agree", [f"{layout.CLASSES}/**"], geometry)
        )
    tabs: list[rrb.View | rrb.Container] = [beside(MAPS, maps, geometry), *together]
    changes = [layer_view(name, geometry, changes=True) for name in sensors]
    tabs.append(beside(CHANGES, changes, geometry))
    pictures = _display_views(started, displays)
    if pictures:
        tabs.append(beside(DISPLAYS, pictures, geometry))
    return tabs


def _threshold_tab(started: Started, thresholds: Sequence[float]) -> list[rrb.Container]:
    """A row of pictures for each layer: what is occupied above each threshold."""
    if not thresholds:
        return []
    views = [
        _map_view(f"{layer} > {t:g}", [f"{layout.compared(layer, t)}/**"], started.geometry)
        for layer in started.layers
        for t in thresholds
    ]
    return [rrb.Grid(*views, grid_columns=len(thresholds), name=THRESHOLDS)]


def _plots(probes: Sequence[str]) -> rrb.View | rrb.Container:
    """Ranges over time; with watched cells, their beliefs before them."""
    beliefs = [
        rrb.TimeSeriesView(
            origin=f"{layout.probe(number)}/belief", name=f"Belief in the cell at {name}",
            axis_x=rrb.TimeAxis(view_range=_whole_run()),
            axis_y=rrb.ScalarAxis(range=_PERCENT, zoom_lock=True),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightBottom),
        )
        for number, name in enumerate(probes)
    ]  # fmt: skip
    ranges = _range_plot()
    return rrb.Tabs(*beliefs, ranges, active_tab=0) if beliefs else ranges


def _range_plot(root: str = "") -> rrb.View:
    return rrb.TimeSeriesView(
        origin=f"{root}{layout.RANGES}", name=RANGES,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
    )  # fmt: skip


def _whole_run() -> rr.TimeRange:
    """From the first step to the last, on whichever timeline."""
    return rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())


def _papers(probes: Sequence[str], config: str = "Configuration") -> rrb.Container:
    """What can be read beside the maps; with watched cells, their stories before the rest."""
    stories: list[rrb.View] = []
    for number, name in enumerate(probes):
        stories.append(
            rrb.TextDocumentView(origin=layout.probe_story(number), name=f"Why is {name} so?")
        )
        stories.append(rrb.TextLogView(origin=layout.probe_log(number), name=f"Readings at {name}"))
    return rrb.Tabs(
        *stories,
        rrb.TextDocumentView(origin=layout.LEGEND, name="What the colours mean"),
        rrb.TextDocumentView(origin=layout.CONFIG, name=config),
        rrb.TextLogView(origin=layout.NOTICE, name="Left out"),
        active_tab=0,
    )


def _display_views(started: Started, displays: Sequence[str]) -> list[rrb.View]:
    """A view for each other way to draw the last layer, or all layers in one picture."""
    geometry, last = started.geometry, started.layers[-1]
    sensors = [name for name in started.layers if name != FUSED]
    views: list[rrb.View] = []
    for name in displays:
        if name in OF_ONE:
            entity, title = layout.display(last, name), f"{last}: {TITLES[name]}"
        elif len(sensors) > 1:
            entity, title = layout.display("", name), _inks(name, sensors)
        else:
            continue
        views.append(_map_view(title, [entity, layout.WALLS], geometry))
    return views


def _inks(name: str, sensors: Sequence[str]) -> str:
    """Which sensor is drawn in which ink."""
    first, second, *further = sensors
    if name == "two-colours":
        return f"{first} in red, {second} in blue"
    third = f"{further[0]} in green" if further else "both in green"
    return f"{first} in red, {second} in blue, {third}"


def beside(name: str, views: list[rrb.View], geometry: GridGeometry) -> rrb.View | rrb.Container:
    """Views in rows and columns, so that the maps come out as large as they can."""
    if len(views) == 1:
        return views[0]
    return rrb.Grid(*views, grid_columns=_columns(len(views), geometry), name=name)


def _columns(count: int, geometry: GridGeometry) -> int:
    """Into how many columns that many maps fit best."""
    return max(range(1, count + 1), key=lambda columns: _fit(count, columns, geometry))


def _around(geometries: Sequence[GridGeometry]) -> GridGeometry:
    """A grid about as large as all of them together: what every view shows."""
    low = np.min([each.origin_m for each in geometries], axis=0)
    high = np.max([np.add(each.origin_m, each.size_m) for each in geometries], axis=0)
    resolution = min(each.resolution_m for each in geometries)
    cols, rows = (max(round(float(size) / resolution), 1) for size in high - low)
    return GridGeometry((float(low[0]), float(low[1])), resolution, rows, cols)


def _fit(count: int, columns: int, geometry: GridGeometry) -> float:
    width, height = geometry.size_m
    rows = -(-count // columns)
    return min(_MAP_AREA[0] / columns / width, _MAP_AREA[1] / rows / height)


def layer_view(
    layer: str,
    geometry: GridGeometry,
    displays: Sequence[str] = (),
    *,
    name: str = "",
    changes: bool = False,
    root: str = "",
) -> rrb.Spatial2DView:
    """One layer with its overlays; ``changes`` shows what a reading changed, not its evidence.

    The other ways to draw it lie over it, hidden; switch one on in the viewer's list of entities.
    ``root`` is what one of several maps in the recording lies below.
    """
    pictures = [layout.display(layer, each) for each in displays if each in OF_ONE]
    if layer == FUSED:
        pictures += [layout.display("", each) for each in displays if each in OF_SEVERAL]
    contents = [
        f"{layout.layer_root(layer)}/**", layout.ROBOT, f"{layout.PATH}/**", layout.WALLS,
        f"{layout.PROBE_MARKS}/**", *pictures,
    ]  # fmt: skip
    hidden = [layout.temp(layer) if changes else layout.change(layer), *pictures]
    overrides: dict[str, rrb.EntityBehavior | rrb.VisibleTimeRanges] = {
        **{entity: rrb.EntityBehavior(visible=False) for entity in hidden},
        layout.points(layer): _from_the_start(),
    }
    title = name or (f"{layer}: what changed" if changes else layer)
    below = {f"{root}{entity}": how for entity, how in overrides.items()}
    return _map_view(title, contents, geometry, below, root=root)


def _map_view(
    name: str,
    contents: list[str],
    geometry: GridGeometry,
    overrides: dict[str, rrb.EntityBehavior | rrb.VisibleTimeRanges] | None = None,
    root: str = "",
) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        origin="/", contents=[root + each for each in (layout.MAP, *contents)], name=name,
        visual_bounds=whole_grid(geometry), overrides=overrides,
    )  # fmt: skip


def whole_grid(geometry: GridGeometry) -> rrb.VisualBounds2D:
    """The part of the map plane, y up, that the whole grid just fits into."""
    (x, y), (width, height) = geometry.origin_m, geometry.size_m
    margin = _MARGIN * max(width, height)
    return rrb.VisualBounds2D(
        x_range=[x - margin, x + width + margin], y_range=[-(y + height) - margin, -y + margin]
    )


def _from_the_start() -> rrb.VisibleTimeRanges:
    """All that an entity ever showed up to the current step, on whichever timeline."""
    boundary = rrb.TimeRangeBoundary
    return rrb.VisibleTimeRanges([
        rrb.VisibleTimeRange(name, start=boundary.infinite(), end=boundary.cursor_relative(seq=0))
        for name in _TIMELINES
    ])  # fmt: skip
