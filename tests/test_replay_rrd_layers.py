"""What lies over what in the viewer's map, the trail of dots, and the pictures of readings."""

from __future__ import annotations

import io
import itertools
import math
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import MadeRun
from numpy.typing import NDArray
from PIL import Image

from mapping.grid import GridGeometry
from replay.rrd import layout
from replay.rrd.batches import quiet_reader
from replay.rrd.canvas import TRAIL_BASE, Canvas
from replay.rrd.display_layers import DisplayOverlay
from replay.rrd.pictures import strength_classes, strength_names, strength_png
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.sink import Pack, Sink, Stamp
from replay.rrd.tiles import LayerTiles
from replay.rrd.writer import RrdWriter

OPAQUE_ROOTS = (layout.merged("ping"), layout.merged("fused"), layout.CLASSES, layout.DISPLAY)


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, dict[str, list[object]]]]:
    """All chunks of a recording with several tiles a layer, as entity and columns."""
    path = tmp_path_factory.mktemp("layers") / "made.rrd"
    run = MadeRun(GridGeometry((-31.7, 42.3), 0.02, 170, 290), readings=40)
    display = DisplayOverlay(("grey", "two-colours"), levels=4, budget_mb=100.0)
    with RrdWriter(path, RunDrawer(overlays=[display]), name="made") as writer:
        for artifact in run.artifacts():
            writer(artifact)
    found = []
    for chunk in quiet_reader(path).stream():
        batch: pa.RecordBatch = chunk.to_record_batch()
        found.append((chunk.entity_path, batch.to_pydict()))
    return found


def places(rows: list[tuple[str, dict[str, list[object]]]]) -> dict[str, list[list[float]]]:
    """Where each picture of cells lies (x, y, z in metres), by entity."""
    found: dict[str, list[list[float]]] = {}
    for entity, columns in rows:
        for (place,) in filter(None, columns.get("Transform3D:translation", [])):
            found.setdefault(entity, []).append(place)
    return found


def test_grids_lie_apart_in_their_drawing_order(
    rows: list[tuple[str, dict[str, list[object]]]],
) -> None:
    """The viewer takes what is closer than a millimetre as one plane; see the layout."""
    depths = {
        "never seen": {z for e, p in places(rows).items() if "never_seen" in e for _, _, z in p},
        "tiles": {z for e, p in places(rows).items() if "/merged/t" in e for _, _, z in p},
        "classes": {
            z for e, p in places(rows).items() if e.startswith("/map/classes/t") for _, _, z in p
        },
        "thresholded": {z for e, p in places(rows).items() if "/thresholded/" in e for *_, z in p},
        "display": {z for e, p in places(rows).items() if "/pictures" in e for *_, z in p},
        "patch": {z for e, p in places(rows).items() if "/temp/p" in e for *_, z in p},
    }
    assert [len(each) for each in depths.values()] == [1] * len(depths)
    millimetres = [1000.0 * each.pop() for each in depths.values()]
    assert millimetres == pytest.approx([5.0, 4.0, 3.0, 2.0, 1.0, 0.0], abs=1e-4)


def test_tiles_do_not_touch_and_yet_leave_no_gap_to_be_seen(
    rows: list[tuple[str, dict[str, list[object]]]],
) -> None:
    spans = tile_spans(rows, "/map/layers/ping/merged/t")
    assert len(spans) > 4
    gaps = []
    for one, other in itertools.combinations(spans, 2):
        apart = np.maximum(one[0], other[0]) - np.minimum(one[1], other[1])  # (x, y), metres
        assert (apart > 0.0).any(), "they touch"
        gaps += [float(each) for each in apart if 0.0 < each < 0.5]
    assert gaps
    assert max(gaps) < 0.01 * 0.02, "a hundredth of a cell at most"


def tile_spans(
    rows: list[tuple[str, dict[str, list[object]]]], root: str
) -> list[NDArray[np.float32]]:
    """Lower and upper corner of each tile (2, 2), in the viewer's single precision."""
    spans = []
    for entity, columns in rows:
        if entity.startswith(root) and "Transform3D:translation" in columns:
            ((place,),) = columns["Transform3D:translation"]
            ((scale,),) = columns["Transform3D:scale"]
            ((shape,),) = columns["SegmentationImage:format"]
            corner = np.array(place[:2], np.float32)
            cells = np.array([shape["width"], shape["height"]], np.float32)
            spans.append(np.stack([corner, corner + cells * np.float32(scale[0])]))
    return spans


@pytest.mark.parametrize("root", OPAQUE_ROOTS)
def test_every_number_of_an_opaque_grid_has_an_opaque_colour(
    rows: list[tuple[str, dict[str, list[object]]]], root: str
) -> None:
    tables = [
        columns["AnnotationContext:context"][0][0]
        for entity, columns in rows
        if entity.startswith(root) and "AnnotationContext:context" in columns
    ]
    assert tables
    for table in tables:
        colours = {each["class_id"]: each["class_description"]["info"]["color"] for each in table}
        assert sorted(colours) == list(range(256))
        assert all(colour & 0xFF == 0xFF for colour in colours.values())


@settings(deadline=None)
@given(st.lists(st.integers(0, 5), max_size=200))
def test_a_trail_shows_all_dots_at_any_time_and_writes_each_a_few_times(sizes: list[int]) -> None:
    shown: dict[str, NDArray[np.float64]] = {}
    written = 0

    class Kept(Canvas):
        def add(self, entity: str, pack: Pack, value: Any, size: int = 64) -> None:
            nonlocal written
            shown[entity] = value
            written += len(value)

    geometry = GridGeometry((0.0, 0.0), 1.0, 1, 1)
    canvas, left = Kept(Sink(rr.RecordingStream("test")), geometry, Stamp(0, 0, 0)), 0
    for size in sizes:
        dots = np.arange(left, left + size, dtype=float)[:, None].repeat(2, axis=1)
        left += size
        canvas.leave("/trail", dots, lambda sink, entity: None)
        assert sorted(np.concatenate([*shown.values()])[:, 0]) == list(range(left))
    digits = math.ceil(math.log(max(len(sizes), 2), TRAIL_BASE)) + 1
    assert len(shown) <= digits
    assert written <= left * TRAIL_BASE * digits


@settings(deadline=None, max_examples=40)
@given(
    rows=st.integers(1, 40),
    cols=st.integers(1, 40),
    extra=st.integers(0, 9),
    seed=st.integers(0, 2**31),
)
def test_a_patch_has_the_colours_of_its_classes(
    rows: int, cols: int, extra: int, seed: int
) -> None:
    random = np.random.default_rng(seed)
    classes = strength_classes(
        random.uniform(-0.5, 0.5, (rows, cols)), random.random((rows, cols)) < 0.7
    )
    side = max(rows, cols) + extra
    picture = np.asarray(Image.open(io.BytesIO(strength_png(classes, side))).convert("RGBA"))
    table = {number: colour for number, _, colour in strength_names()}
    expected = np.array([[table[int(each)] for each in row] for row in classes], np.uint8)
    assert picture.shape == (side, side, 4)
    assert np.array_equal(picture[:rows, :cols], expected)
    assert not picture[rows:, :, 3].any()
    assert not picture[:, cols:, 3].any()


def test_what_whole_tiles_will_take_is_estimated_from_some_of_them() -> None:
    geometry = GridGeometry((0.0, 0.0), 0.01, 640, 640)
    state = LayerTiles(layout.tiling_for(geometry))
    state.begin("probability", "bayes")
    assert state.packed_tiles() == (0, 0.0)
    values = np.random.default_rng(3).random(geometry.shape, dtype=np.float32)
    state.see(geometry.whole, np.ones(geometry.shape, bool))
    state.update(geometry.whole, values, values)
    tiles, size = state.packed_tiles()
    assert tiles == 64
    assert size == pytest.approx(values.nbytes, rel=0.02), "noise does not pack"
    state.update(geometry.whole, np.full_like(values, 0.25), values)
    assert state.packed_tiles()[1] < 0.02 * values.nbytes
