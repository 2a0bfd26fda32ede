"""How two maps differ: figures that are exact, laws that hold for any grids, verdicts in words."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from diff_maps import GEOMETRY, layer, room, source
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mapping.grid import GridGeometry
from recorder.errors import BadInput
from replay.diff.alignment import align
from replay.diff.cells import cell_figures
from replay.diff.comparing import Report, report
from replay.diff.layers import FREE, OCCUPIED, UNKNOWN, Line, MapLayer, Outline, Source, value_layer
from replay.diff.lines import border_figures, line_figures
from replay.diff.report_text import as_json, summary
from replay.diff.verdict import (
    OTHER,
    SAME,
    SAME_ROOM,
    WALL_MOVED,
    LayerVerdict,
    sharpest_first,
)

ROWS, COLS = 9, 12
ORDINARY = st.floats(0, 1, width=32)
GRIDS = arrays(np.float32, (ROWS, COLS), elements=ORDINARY | st.just(np.float32("nan")))
TOLERANCES = st.sampled_from([0.0, 1e-6, 0.01, 0.3])
LAWS = settings(max_examples=60, deadline=None)


def compared(a: np.ndarray, b: np.ndarray, tolerance: float = 0.0) -> Report:
    return report(source(layer(a)), source(layer(b)), tolerance=tolerance)


@LAWS
@given(GRIDS, TOLERANCES)
def test_a_map_is_the_same_as_itself(grid: np.ndarray, tolerance: float) -> None:
    found = compared(grid, grid.copy(), tolerance)
    assert not found.differs
    assert found.verdict.kind == SAME
    cells = found.layers[0].cells
    assert (cells.differ, cells.class_changed, cells.worst) == (0, 0, ())
    assert cells.occupied_iou in (None, 1.0)


@LAWS
@given(GRIDS, GRIDS, TOLERANCES)
def test_both_ways_give_the_same_counts(a: np.ndarray, b: np.ndarray, tolerance: float) -> None:
    there = compared(a, b, tolerance).layers[0].cells
    back = compared(b, a, tolerance).layers[0].cells
    for name in ("compared", "seen", "differ", "class_changed", "occupied_iou"):
        assert getattr(there, name) == getattr(back, name)
    assert (there.occupied_a, there.occupied_b) == (back.occupied_b, back.occupied_a)
    # As text, since NaN is not equal to itself.
    assert [str((c.row, c.col, c.a, c.b)) for c in there.worst] == [
        str((c.row, c.col, c.b, c.a)) for c in back.worst
    ]


@LAWS
@given(GRIDS, GRIDS, TOLERANCES)
def test_counts_are_those_of_a_slow_look(a: np.ndarray, b: np.ndarray, tolerance: float) -> None:
    differ, worst = 0, 0.0
    for p, q in zip(a.ravel().tolist(), b.ravel().tolist(), strict=True):
        if math.isnan(p) and math.isnan(q):
            continue
        away = math.inf if math.isnan(p) or math.isnan(q) else abs(p - q)
        differ += away > tolerance
        worst = max(worst, away)
    cells = compared(a, b, tolerance).layers[0].cells
    assert cells.differ == differ
    if differ:
        assert abs(cells.worst[0].difference) == worst


@LAWS
@given(
    arrays(np.float32, (ROWS, COLS), elements=st.floats(0, 1, width=32)),
    st.integers(0, ROWS - 1),
    st.integers(0, COLS - 1),
    st.floats(1e-6, 0.5),
    st.sampled_from([-3, 0, 4]),
    st.sampled_from([-2, 0, 5]),
)
def test_one_changed_cell_is_named(
    grid: np.ndarray, row: int, col: int, by: float, up: int, right: int
) -> None:
    """Whatever the cell, and wherever the other map's origin lies."""
    changed = grid.astype(np.float64)
    changed[row, col] += by if changed[row, col] <= 0.5 else -by
    wide = np.full((ROWS + 10, COLS + 10), 0.5)
    wide[5 : 5 + ROWS, 5 : 5 + COLS] = changed
    wide = wide[5 - max(up, 0) :, 5 - max(right, 0) :]
    size = GEOMETRY.resolution_m
    x, y = GEOMETRY.origin_m
    corner = (x - max(right, 0) * size, y - max(up, 0) * size)
    other = layer(wide, geometry=GridGeometry(corner, size, *wide.shape))
    found = report(source(layer(grid)), source(other))
    (cell,) = found.layers[0].cells.worst
    assert found.layers[0].cells.differ == 1
    assert (cell.row, cell.col) == (row, col)
    assert (cell.a, cell.b) == (float(grid[row, col]), float(changed[row, col]))
    centre = GridGeometry((x, y), size, ROWS, COLS).centres_of(np.array([[row, col]]))[0]
    assert (cell.x_m, cell.y_m) == pytest.approx(tuple(centre))
    where = f"worst x {cell.x_m:.3f} m, y {cell.y_m:.3f} m (row {row}, col {col} of A): "
    assert where in "\n".join(summary(found))


def test_what_lies_beyond_a_grid_was_never_seen() -> None:
    grid = room()
    part = layer(
        grid[5:55, 5:75],
        geometry=GridGeometry((-0.2 + 5 * 0.02, 0.4 + 5 * 0.02), 0.02, 50, 70),
    )
    assert not report(source(layer(grid)), source(part)).differs
    grid[2, 3] = 0.9
    found = report(source(layer(grid)), source(part)).layers[0].cells
    assert (found.differ, found.worst[0].row, found.worst[0].col) == (1, 2, 3)
    assert (found.worst[0].a, found.worst[0].b) == (pytest.approx(0.9), 0.5)
    back = report(source(part), source(layer(grid))).layers[0].cells
    assert (back.worst[0].row, back.worst[0].col) == (-3, -2)


@pytest.mark.parametrize(
    ("geometry", "words"),
    [
        (GridGeometry((-0.2, 0.4), 0.03, 60, 80), "0.02 m in A and 0.03 m in B"),
        (GridGeometry((-0.19, 0.4), 0.02, 60, 80), "not a whole number of cells"),
        (GridGeometry((900.0, 900.0), 0.02, 60, 80), "too far apart"),
    ],
)
def test_grids_that_cannot_lie_on_each_other(geometry: GridGeometry, words: str) -> None:
    a, b = layer(room()), layer(room(), geometry=geometry)
    with pytest.raises(BadInput, match=words) as refused:
        align(a, b)
    assert "\n" not in str(refused.value)


def test_iou_and_class_changes_by_hand() -> None:
    a = np.full((2, 4), 0.5, np.float32)
    b = a.copy()
    a[0] = [0.9, 0.9, 0.9, 0.1]
    b[0] = [0.9, 0.9, 0.1, 0.5]
    cells = cell_figures(align(layer(a), layer(b)), 0.0)
    assert (cells.occupied_a, cells.occupied_b) == (3, 2)
    assert cells.occupied_iou == pytest.approx(2 / 3)
    assert (cells.seen, cells.class_changed, cells.class_changed_share) == (4, 2, 0.5)
    assert cells.differ == 2


def layer_of(kind: str, values: np.ndarray, extra: dict[str, np.ndarray] | None = None) -> MapLayer:
    grid = GridGeometry((0.0, 0.0), 0.1, *values.shape)
    return value_layer("ping", kind, grid, values, extra=extra)


@pytest.mark.parametrize(
    ("kind", "values", "classes"),
    [
        ("probability", [0.5, 0.4, 0.6, 0.52, np.nan], [UNKNOWN, FREE, OCCUPIED, UNKNOWN, UNKNOWN]),
        ("odds", [1.0, 0.1, 9.0, 1.05, np.inf], [UNKNOWN, FREE, OCCUPIED, UNKNOWN, OCCUPIED]),
        ("count", [0, 2, 10, 5, 6], [UNKNOWN, FREE, OCCUPIED, UNKNOWN, OCCUPIED]),
        ("certainty", [0, 3, 15, 7.5, 9], [UNKNOWN, FREE, OCCUPIED, UNKNOWN, OCCUPIED]),
        ("binary", [0, 1, 0, 1, 0], [UNKNOWN, OCCUPIED, UNKNOWN, OCCUPIED, UNKNOWN]),
    ],
)
def test_classes_of_each_unit(kind: str, values: list[float], classes: list[int]) -> None:
    layer = layer_of(kind, np.array([values], np.float32))
    assert layer.classes[0].tolist() == classes


def test_masses_use_what_is_unknown() -> None:
    extra = {"occupied": np.array([[0.0, 0.2, 0.6]]), "unknown": np.array([[1.0, 0.1, 0.1]])}
    layer = layer_of("mass", extra["occupied"], extra)
    assert layer.classes[0].tolist() == [UNKNOWN, FREE, OCCUPIED]


def test_units_that_differ_are_compared_by_class() -> None:
    odds = np.array([[1.0, 9.0, 0.1]], np.float32)
    found = report(
        source(layer(np.array([[0.5, 0.9, 0.9]], np.float32))), source(layer(odds, kind="odds"))
    )
    assert found.layers[0].by_class
    assert [(c.col, c.a, c.b) for c in found.layers[0].cells.worst] == [(2, "occupied", "free")]
    assert any("classes are compared" in note for note in found.notes)


def test_layers_go_by_name() -> None:
    ping, dirrs = layer(room()), layer(room(), name="dirrs")
    both, one = source(ping, dirrs), source(ping)
    assert report(both, one).only_a == ("dirrs",)
    assert report(both, one).differs
    assert not report(both, replace(one, single=True)).differs
    assert not report(both, one, only=["ping"]).differs
    with pytest.raises(BadInput, match="no layer 'fused' in both: A has ping, dirrs, B has ping"):
        report(both, one, only=["fused"])
    with pytest.raises(BadInput, match="no layer in common"):
        report(one, source(dirrs))
    renamed = report(source(ping, single=True), source(dirrs, single=True))
    assert not renamed.differs
    assert "layer ping of A is compared with layer dirrs of B" in renamed.notes


def test_lines_that_moved_came_and_went() -> None:
    a = [Line("grid", (0, 0), (2, 0)), Line("grid", (0, 1), (2, 1)), Line("grid", (5, 5), (5, 6))]
    b = [
        Line("grid", (2, 0), (0, 0)),
        Line("grid", (0, 1.2), (2, 1.2)),
        Line("raw", (5, 5), (5, 6)),
    ]
    found = line_figures(a, b, 1e-6)
    assert found.same == 1  # the same ends, run the other way
    (moved,) = found.moved
    assert (moved.a, moved.b) == (a[1], b[1])
    assert moved.offset_m == pytest.approx(0.2)
    assert moved.ends_m == pytest.approx(0.2)
    assert moved.turned_rad == pytest.approx(0.0)
    assert found.vanished == (a[2],)
    assert found.appeared == (b[2],)
    assert line_figures(a, b, 0.3).same == 2
    turned = line_figures([a[0]], [Line("grid", (0, -0.1), (2, 0.1))], 0.0).moved[0]
    assert turned.turned_rad == pytest.approx(math.atan(0.1))
    assert turned.offset_m == pytest.approx(0.0)


def test_borders_that_moved_came_and_went() -> None:
    def square(x: float, y: float, side: int = 5, *, outer: bool = True) -> Outline:
        cells = [(i, 0) for i in range(side)] + [(i, side) for i in range(side)]
        return Outline(outer, (np.array(cells, float) + 0.5) * 0.02 + (x, y))

    a = [square(0, 0), square(1, 0), square(2, 0), square(3, 0)]
    b = [square(0, 0), square(1.04, 0), square(9, 9), square(3, 0, outer=False)]
    found = border_figures(a, b, 0.02)
    assert found.same == 1
    (moved,) = found.moved
    assert moved.most_m == pytest.approx(0.04)
    assert len(found.appeared_m) == len(found.vanished_m) == 2
    reordered = Outline(True, a[0].points_m[::-1])
    assert border_figures([a[0]], [reordered], 0.02).same == 1


def test_noise_is_not_a_wall() -> None:
    found = compared(room(noise=1, seed=1), room(noise=1, seed=2))
    assert found.verdict.kind == SAME_ROOM
    assert found.verdict.text.startswith("same room, these cells differ")
    assert found.layers[0].cells.differ > 50


@pytest.mark.parametrize("cells", [-8, 6])
def test_a_wall_that_moved_is_found(cells: int) -> None:
    found = compared(room(noise=1, seed=1), room(right_col=65 + cells, noise=1, seed=2))
    assert found.verdict.kind == WALL_MOVED
    change = found.verdict.changes[0]
    assert change.what == "moved"
    assert change.moved_m == pytest.approx(abs(cells) * 0.02, abs=0.02)
    assert change.from_m is not None
    assert change.to_m is not None
    wall_x = GEOMETRY.origin_m[0] + 66 * 0.02
    assert [end[0] for end in change.from_m] == pytest.approx([wall_x] * 2, abs=0.03)
    assert [end[0] for end in change.to_m] == pytest.approx([wall_x + cells * 0.02] * 2, abs=0.03)
    assert found.verdict.text.startswith("a wall moved by 0.1")


def test_a_wall_that_came_or_went_is_found() -> None:
    gone = compared(room(noise=1, seed=1), room(box=False, noise=1, seed=2)).verdict
    assert (gone.kind, [change.what for change in gone.changes]) == (WALL_MOVED, ["vanished"])
    assert gone.changes[0].from_m is not None
    ends = np.array(gone.changes[0].from_m)
    assert ends.mean(axis=0) == pytest.approx([-0.2 + 36 * 0.02, 0.4 + 27 * 0.02], abs=0.03)
    come = compared(room(box=False, noise=1, seed=1), room(noise=1, seed=2)).verdict
    assert [change.what for change in come.changes] == ["appeared"]


def face_of_a_thing(col: int, unseen: slice) -> np.ndarray:
    """The room with one face of a thing, behind which nothing was seen."""
    values = room(box=False)
    values[20:40, unseen] = 0.5
    values[20:40, col : col + 2] = 0.95
    return values


def test_opposite_faces_of_a_thing_are_not_one_wall() -> None:
    left, right = face_of_a_thing(28, slice(28, 38)), face_of_a_thing(44, slice(34, 44))
    found = compared(left, right).verdict
    assert sorted(change.what for change in found.changes) == ["appeared", "vanished"]
    same_side = compared(left, face_of_a_thing(44, slice(44, 54))).verdict
    assert [change.what for change in same_side.changes] == ["moved"]
    assert same_side.changes[0].moved_m == pytest.approx(16 * 0.02, abs=0.01)


def test_short_pieces_are_reported_with_a_may() -> None:
    a, b = room(box=False), room(box=False)
    a[26:28, 28:38] = 0.95
    (short,) = compared(a, b).verdict.changes
    assert not short.sure
    assert compared(a, b).verdict.text.startswith("a wall may have vanished: (")
    assert f"a short piece of {short.length_m:.2f} m" in compared(a, b).verdict.text
    a[26:28, 28:58] = 0.95
    (long,) = compared(a, b).verdict.changes
    assert long.sure
    assert compared(a, b).verdict.text.startswith("a wall vanished: (")


def sharp_and_blurred(
    sharp: np.ndarray, blurred: np.ndarray, *, widths: bool = True
) -> Source:  # fmt: skip
    """A layer of a narrow beam and one of a wide beam; the wide one comes first."""
    narrow, wide = layer(sharp, name="dirrs"), layer(blurred, name="fused")
    if widths:
        narrow = replace(narrow, beam_width_rad=0.03)
    return source(wide, narrow)


@pytest.mark.parametrize("widths", [True, False])
def test_the_sharpest_layer_decides(widths: bool) -> None:
    """What a blurred layer holds of a place that the sharp one saw is not reported."""
    calm, changed = room(right_col=65), room(right_col=65, box=False)
    quiet = report(
        sharp_and_blurred(calm, calm, widths=widths),
        sharp_and_blurred(calm, changed, widths=widths),
    )
    assert [c.what for layer in quiet.layers for c in layer.verdict.changes] == ["vanished"]
    assert (quiet.verdict.kind, quiet.verdict.changes) == (SAME_ROOM, ())
    result = report(
        sharp_and_blurred(calm, calm, widths=widths),
        sharp_and_blurred(changed, calm, widths=widths),
    ).verdict
    assert [(c.what, c.layer) for c in result.changes] == [("vanished", "dirrs")]


def test_blurred_layers_decide_where_the_sharp_one_saw_nothing() -> None:
    calm, changed = room(), room(box=False)
    sharp = room(box=False)
    sharp[20:34, 24:48] = 0.5
    inside = report(sharp_and_blurred(sharp, calm), sharp_and_blurred(sharp, changed)).verdict
    assert [(c.what, c.layer) for c in inside.changes] == [("vanished", "fused")]
    # An echo beyond the walls that the sharp layer saw: only the blurred one is free out there.
    out_there, ghost = room(right_col=40), room(right_col=40)
    small = room(right_col=40)
    for blurred in (out_there, ghost):
        blurred[5:55, 42:78] = 0.05
    ghost[12:48, 66:68] = 0.95
    found = report(sharp_and_blurred(small, ghost), sharp_and_blurred(small, out_there))
    seen = [c.what for each in found.layers for c in each.verdict.changes]
    assert seen == ["vanished"]
    assert (found.verdict.kind, found.verdict.changes) == (SAME_ROOM, ())


def test_sharpness_is_the_width_of_the_beam_and_fused_comes_last() -> None:
    def verdict(depth_m: float, width_rad: float | None = None) -> LayerVerdict:
        return LayerVerdict(0.06, 0.06, 1.0, 1.0, depth_m, (), width_rad)

    verdicts = {"ping": verdict(0.01, 0.6), "fused": verdict(0.001), "dirrs": verdict(0.03, 0.05)}
    assert sharpest_first(verdicts) == ["dirrs", "ping", "fused"]
    unknown = {name: replace(each, beam_width_rad=None) for name, each in verdicts.items()}
    assert sharpest_first(unknown) == ["ping", "dirrs", "fused"]
    blind = verdicts | {"dirrs": verdict(math.inf, 0.05)}
    assert sharpest_first(blind) == ["ping", "fused", "dirrs"]


def test_values_are_reported_in_three_digits() -> None:
    grid = np.full((ROWS, COLS), 0.25, np.float32)
    changed = grid.astype(np.float64)
    changed[2, 3] = 1.03150734e-12
    assert ": 0.25 in A, 1.03e-12 in B" in "\n".join(summary(compared(grid, changed)))
    changed[2, 3] = 0.25 + 1e-6
    assert ": 0.25 in A, 0.25 in B, 1e-06 apart" in "\n".join(summary(compared(grid, changed)))


def test_a_map_that_was_pushed_along_is_reported() -> None:
    grid = room()
    pushed = np.full_like(grid, 0.05)
    pushed[8:, 8:] = np.where(grid == 0.5, np.float32(0.05), grid)[:-8, :-8]
    found = compared(grid, pushed).verdict
    assert found.kind == OTHER
    assert "B moved by -0.16, -0.16 m would cover 100%" in found.text


def test_plain_values_hold_the_same_as_the_lines() -> None:
    grid = room()
    changed = grid.copy()
    changed[20, 30] = np.nan
    plain = as_json(compared(grid, changed))
    assert plain["differs"] is True
    cells = plain["layers"]["ping"]
    assert cells["differ"] == 1
    assert cells["worst"][0]["row"] == 20
    assert cells["worst"][0]["b"] == "nan"
    assert cells["worst"][0]["difference"] == "inf"
