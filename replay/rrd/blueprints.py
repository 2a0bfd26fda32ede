"""How the viewer is laid out when a recording opens: the maps large, what happens as text beside.

Opens paused at the first step. The sensors' maps stand side by side, so that every step shows
something happen; the fused map, the classes and what each reading changed are tabs above. All show
the path and the walls; the whole grid is a tab of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mapping.artifacts import Started
from mapping.fusion import FUSED
from replay.colours import in_place
from replay.rrd import layout
from replay.rrd.axes import WHOLE, Frame, frame_of, whole_frame
from replay.rrd.display_layers import OF_ONE, OF_SEVERAL, TITLES, inks
from replay.rrd.legend import classes_legend_view, legend_view
from replay.rrd.range_plot import range_plot_view

Part: TypeAlias = rrb.View | rrb.Container

MAPS, CHANGES, DISPLAYS = "Maps", "What changed", "Other ways to draw them"
WIDE, MATTERS = "Wide shot", "The readings that matter"
THRESHOLDS = "Thresholds side by side"
LEGEND, MANUAL = "What the colours mean", "How to read it"
RANGES, BY_STEP = "Ranges over seconds", "By step: click to go there"

_PERCENT = (-5.0, 105.0)  # of a belief, with a little air
_BACKGROUND = (13, 13, 13)  # as the viewer's own, unless the browser asks for a light one
_AROUND_CELLS, _AROUND_SHARE = 12, 0.06  # at least so far, each way, around a watched cell
_MAP_AREA = (1.4, 1.0)  # shape of the part of a usual window that the maps get


@dataclass(frozen=True, slots=True)
class Watched:
    """A watched cell: its name, its place, and once known from which step to which it changed."""

    name: str
    at_m: tuple[float, float]
    steps: tuple[int, int] | None = None


def default_blueprint(
    started: Started,
    *,
    probes: Sequence[Watched] = (),
    displays: Sequence[str] = (),
    following: bool = False,
    thresholds: Sequence[float] = (),
) -> rrb.Blueprint:
    """The layout for a grid and its layers.

    Each of ``probes`` has a view of its surroundings, and a plot of its belief over the steps at
    which that changed. ``displays`` are the further ways in which the maps are drawn.
    ``thresholds`` stand side by side in a tab. ``following`` stays at what happened last.
    """
    around = [_around(started, probe.at_m) for probe in probes]
    maps, *others = _tabs(started, displays)
    tabs = [maps, *around, *others, *_threshold_tab(started, thresholds)]
    side = [_plots(probes, started, following=following), _papers(probes, legend=started)]
    return _laid_out(tabs, side, [4, 3, 4], "following" if following else "paused")


def comparison_blueprint(started: Mapping[str, Started]) -> rrb.Blueprint:
    """The layout for several maps of one session, by name, from how each of them starts.

    A tab for each layer shows that layer of every map, at the same scale and at the same place, so
    that the eye can go from one to the next.
    """
    frame = frame_of(*started.values())
    layers = in_place(layer for one in started.values() for layer in one.layers)
    tabs = []
    for layer in layers:
        views: list[rrb.View] = [
            layer_view(layer, frame, name=f"{name}: {layer}", root=layout.root_of(name), of=one)
            for name, one in started.items()
            if layer in one.layers
        ]
        tabs.append(beside(layer, views, frame))
    first = layout.root_of(next(iter(started)))
    papers = _papers((), "Configurations")
    return _laid_out(tabs, [_range_plot(first), papers], [5, 2, 3])


def _laid_out(
    tabs: Sequence[Part],
    side: Sequence[Part],
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


def _tabs(started: Started, displays: Sequence[str]) -> list[Part]:
    """The maps, what changed, and the other ways to look at the maps; each tab has its name."""
    layers = in_place(started.layers)
    sensors = [name for name in layers if name != FUSED] or [FUSED]
    frame, whole = frame_of(started), whole_frame(started.geometry)

    def each(name: str, of: Frame, *, changes: bool = False, kept: bool = False) -> Part:
        views: list[rrb.View] = [
            layer_view(layer, of, displays, changes=changes, kept=kept, of=started)
            for layer in (layers if kept else sensors)
        ]
        return beside(name, views, of, named=name != MAPS)

    tabs: list[Part] = [each(MAPS, frame)]
    if FUSED in layers and FUSED not in sensors:
        tabs.append(layer_view(FUSED, frame, displays, of=started))
        tabs.append(_classes_tab(started, frame))
    tabs.append(each(CHANGES, frame, changes=True))
    if whole != frame:
        tabs.append(each(WIDE, whole))
    tabs.append(each(layout.KEPT_TITLE, frame, kept=True))
    pictures = _display_views(started, displays, frame)
    if pictures:
        tabs.append(beside(DISPLAYS, pictures, frame))
    return tabs


def _around(started: Started, at_m: tuple[float, float]) -> Part:
    """The maps of all sensors around a watched cell: where its readings change it."""
    frame, (x, y) = frame_of(started), at_m
    half = max(_AROUND_CELLS * started.geometry.resolution_m, frame.longer_m * _AROUND_SHARE)
    near = Frame("", (x - half, y - half), (x + half, y + half))
    views: list[rrb.View] = [
        layer_view(layer, near, of=started, name=f"{layer} at ({x:g}, {y:g}) m")
        for layer in in_place(started.layers)
    ]
    return beside(f"Around ({x:g}, {y:g}) m", views, near, named=True)


def _classes_tab(started: Started, frame: Frame) -> rrb.Container:
    """The class map, and what its colours mean."""
    title = layout.CLASSES_TITLE
    classes = _map_view(title, [f"{layout.CLASSES}/**", layout.WALLS], frame)
    return rrb.Vertical(classes, classes_legend_view(started), row_shares=[4, 1], name=title)


def _threshold_tab(started: Started, thresholds: Sequence[float]) -> list[rrb.Container]:
    """A row of pictures for each layer: what is occupied above each threshold."""
    if not thresholds:
        return []
    frame = frame_of(started)
    views = [
        _map_view(f"{layer} > {t:g}", [f"{layout.compared(layer, t)}/**"], frame)
        for layer in in_place(started.layers)
        for t in thresholds
    ]
    return [rrb.Grid(*views, grid_columns=len(thresholds), name=THRESHOLDS)]


def _plots(probes: Sequence[Watched], started: Started, *, following: bool) -> Part:
    """Ranges over time; with watched cells, their beliefs before them.

    The picture of the whole run is drawn at its end; who follows one gets the viewer's own plot.
    """
    beliefs = [
        rrb.TimeSeriesView(
            origin=f"{layout.probe(number)}/belief", name=f"Belief in the cell at {probe.name}",
            axis_x=rrb.TimeAxis(view_range=_steps(probe.steps)),
            axis_y=rrb.ScalarAxis(range=_PERCENT, zoom_lock=True),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightBottom),
        )
        for number, probe in enumerate(probes)
    ]  # fmt: skip
    plots = [_range_plot()] if following else [range_plot_view(started, RANGES), _range_plot()]
    return rrb.Tabs(*beliefs, *plots, active_tab=0)


def _range_plot(root: str = "") -> rrb.View:
    return rrb.TimeSeriesView(
        origin=f"{root}{layout.RANGES}", name=BY_STEP,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop),
    )  # fmt: skip


def _steps(steps: tuple[int, int] | None) -> rr.TimeRange:
    """Some steps and a little before and after; the whole run where they are not known."""
    boundary = rr.TimeRangeBoundary
    if steps is None:
        return rr.TimeRange(start=boundary.infinite(), end=boundary.infinite())
    first, last = steps
    more = max((last - first) // 20, 5)
    return rr.TimeRange(
        start=boundary.absolute(seq=max(first - more, 0)), end=boundary.absolute(seq=last + more)
    )


def _papers(
    probes: Sequence[Watched], config: str = "Configuration", legend: Started | None = None
) -> rrb.Container:
    """What can be read beside the maps; with watched cells, their stories before the rest."""
    stories: list[rrb.View] = []
    for number, probe in enumerate(probes):
        name = probe.name
        stories.append(
            rrb.TextDocumentView(origin=layout.probe_story(number), name=f"Why is {name} so?")
        )
        stories.append(_log(layout.probe_log(number), f"Readings at {name}"))
    if legend is not None:
        stories.append(legend_view(legend, LEGEND))
        stories.append(_log(layout.MATTERS, MATTERS))
    return rrb.Tabs(
        *stories,
        rrb.TextDocumentView(origin=layout.MANUAL, name=MANUAL),
        rrb.TextDocumentView(origin=layout.CONFIG, name=config),
        rrb.TextLogView(origin=layout.NOTICE, name="Left out"),
        active_tab=0,
    )


def _log(entity: str, name: str) -> rrb.TextLogView:
    """A list of readings; a click on a line's step goes there."""
    shown = rrb.TextLogColumns(timeline_columns=[layout.STEP], text_log_columns=["body"])
    return rrb.TextLogView(origin=entity, name=name, columns=shown)


def _display_views(started: Started, displays: Sequence[str], frame: Frame) -> list[rrb.View]:
    """A view for each other way to draw the last layer, or all layers in one picture."""
    last = started.layers[-1]
    sensors = [name for name in started.layers if name != FUSED]
    views: list[rrb.View] = []
    for name in displays:
        if name in OF_ONE:
            entity, title = layout.display(last, name), f"{last}: {TITLES[name]}"
        elif len(sensors) > 1:
            entity, title = layout.display("", name), inks(name, sensors)
        else:
            continue
        views.append(_map_view(title, [entity, layout.WALLS], frame))
    return views


def beside(name: str, views: list[rrb.View], frame: Frame, *, named: bool = False) -> Part:
    """Views in rows and columns, so that the maps come out as large as they can.

    One alone needs no container, unless the tab is to be ``named`` otherwise than the view.
    """
    if len(views) == 1 and not named:
        return views[0]
    return rrb.Grid(*views, grid_columns=_columns(len(views), frame), name=name)


def _columns(count: int, frame: Frame) -> int:
    """Into how many columns that many maps fit best."""
    return max(range(1, count + 1), key=lambda columns: _fit(count, columns, frame))


def _fit(count: int, columns: int, frame: Frame) -> float:
    width, height = np.subtract(frame.high_m, frame.low_m)
    rows = -(-count // columns)
    return float(min(_MAP_AREA[0] / columns / width, _MAP_AREA[1] / rows / height))


def layer_view(
    layer: str,
    frame: Frame,
    displays: Sequence[str] = (),
    *,
    of: Started,
    name: str = "",
    changes: bool = False,
    kept: bool = False,
    root: str = "",
) -> rrb.Spatial2DView:
    """One layer with its overlays; ``changes`` shows what a reading changed, not its evidence.

    ``kept`` shows what the end takes away: cells above the threshold, borders, raw points and
    lines, the path. That, and the other ways to draw the map, lie over it, hidden; switch one on in
    the viewer's list of entities. ``root`` is what one of several maps in the recording lies below.
    """
    pictures = [layout.display(layer, each) for each in displays if each in OF_ONE]
    if layer == FUSED:
        pictures += [layout.display("", each) for each in displays if each in OF_SEVERAL]
    of_layer = [layer, *(s.name for s in of.sensors if s.layer == layer and s.name != layer)]
    contents = [
        *(f"{layout.layer_root(each)}/**" for each in of_layer), layout.ROBOT,
        f"{layout.PATH}/**", layout.KEPT_PATH, layout.WALLS, f"{layout.PROBE_MARKS}/**", *pictures,
    ]  # fmt: skip
    aside = [layout.KEPT_PATH, *map(layout.kept, of_layer)]
    patches = layout.temp(layer) if changes else layout.change(layer)
    hidden = [patches, *pictures, *([] if kept else aside)]
    whole = ": whole grid" if frame.name == WHOLE and frame != frame_of(of) else ""
    more = ": what changed" if changes else ": all that was drawn" if kept else whole
    title = name or f"{layer}{more}"
    overrides = {f"{root}{entity}": rrb.EntityBehavior(visible=False) for entity in hidden}
    return _map_view(title, contents, frame, overrides, root=root)


def _map_view(
    name: str,
    contents: list[str],
    frame: Frame,
    overrides: Mapping[str, rrb.EntityBehavior] | None = None,
    root: str = "",
) -> rrb.Spatial2DView:
    axes = [f"{frame.entity}/**"] if frame.name else []
    return rrb.Spatial2DView(
        origin="/", contents=[root + each for each in (layout.MAP, *axes, *contents)], name=name,
        visual_bounds=frame.bounds, overrides=overrides, background=_BACKGROUND,
    )  # fmt: skip
