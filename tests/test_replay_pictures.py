"""Pictures of maps: what they show of a file, how a page is laid out, and what is refused."""

from __future__ import annotations

import io
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from echogrid import main
from mapping.config import load_config
from mapping.grid import GridGeometry
from recorder.geometry import SE2
from replay.mapping_run import map_session
from replay.pictures import style
from replay.pictures.drawing.pages import page_bytes
from replay.pictures.opening import Asked, open_views
from replay.pictures.parts import (
    Area,
    Box,
    Cells,
    Page,
    Panel,
    RobotMark,
    Strokes,
    Swatch,
    on_one_scale,
)
from replay.pictures.placing import keys_of, place, round_length_m, wrapped
from replay.pictures.views import (
    GREY_SWATCHES,
    MapView,
    around_session,
    frame_around,
    grey_pixels,
)
from replay.pictures.writing import frames_of

SESSION = ROOT / "logs" / "room.mcap"
SETTINGS = ("grid.resolution_m=0.04", "rerun.display=[]", "borders.compare=[]")
CONFIG = load_config(settings=SETTINGS)
UNIT = np.array([[[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [1.0, 1.0]]])
NONE = np.zeros((0, 2, 2))


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the recording and the exported maps of one run."""
    folder = tmp_path_factory.mktemp("mapped")
    map_session(SESSION, CONFIG, rrd=folder / "room.rrd", export=folder / "maps")
    return folder


def the_view(path: Path, **asked: object) -> MapView:
    (view,) = open_views(path, Asked(**asked), CONFIG)  # type: ignore[arg-type]
    return view


def same_map(a: MapView, b: MapView) -> None:
    """But for a fused cell whose sensors cancel to exactly one half: files hold no more of it."""
    assert a.layer == b.layer
    assert a.cells.geometry == b.cells.geometry
    known = (a.cells.pixels != 128).any(axis=2) | (a.layer != "fused")
    assert known.mean() > 0.95
    np.testing.assert_array_equal(a.cells.pixels[known], b.cells.pixels[known])


@pytest.mark.parametrize("reading", [0, 3, 400])
def test_a_reading_looks_the_same_from_the_session_and_from_its_recording(
    mapped: Path, reading: int
) -> None:
    of_session = the_view(SESSION, reading=reading)
    of_recording = the_view(mapped / "room.rrd", reading=reading)
    same_map(of_session, of_recording)
    assert of_session.frame == of_recording.frame == the_view(SESSION).frame
    for view in (of_session, of_recording):
        assert view.over.beam is not None
        assert view.over.beam.number == reading
        assert len(view.over.path_m) <= reading + 1
        assert len(view.over.walls_m) == 12
    assert of_session.over.beam.ranges_m == of_recording.over.beam.ranges_m  # type: ignore[union-attr]


@pytest.mark.parametrize("view", ["ping", "dirrs", "fused", "classes"])
def test_the_end_looks_the_same_from_all_that_hold_it(mapped: Path, view: str) -> None:
    of_session = the_view(SESSION, view=view)
    same_map(of_session, the_view(mapped / "room.rrd", view=view))
    if view != "classes":
        exported = the_view(mapped / "maps", view=view)
        same_map(of_session, exported)
        same_map(exported, the_view(mapped / "maps" / f"{view}.npz"))
        np.testing.assert_allclose(exported.over.found_m, of_session.over.found_m, atol=1e-8)
        assert len(exported.over.path_m) > 10
    assert of_session.over.beam is None


def test_a_step_is_the_same_moment_in_both(mapped: Path) -> None:
    for step in (0, 1, 2, 3, 100):
        a, b = (the_view(f, step=step, view="ping") for f in (SESSION, mapped / "room.rrd"))
        same_map(a, b)
        assert (a.over.beam is None) == (b.over.beam is None) == (step == 0)


def test_map_server_maps_have_three_shades(mapped: Path) -> None:
    view = the_view(mapped / "maps" / "dirrs.yaml")
    shades = {tuple(pixel) for pixel in view.cells.pixels.reshape(-1, 3).tolist()}
    assert shades == {(255, 255, 255), (0, 0, 0), (150, 158, 178)}


def test_a_ghost_makes_no_picture_small() -> None:
    path = np.array([[0.2, 0.2], [0.8, 0.8]])
    ghost = np.array([[[30.0, 30.0], [30.03, 30.0]]])
    walls = np.concatenate([UNIT, UNIT[:, ::-1, ::-1]])
    without, with_ghost = (frame_around(path, NONE, w) for w in (walls, np.vstack([walls, ghost])))
    assert without is not None
    assert with_ghost is not None
    assert with_ghost.width_m < 1.05 * without.width_m
    true = frame_around(path, UNIT, ghost)
    assert true is not None
    assert true.x1 < 1.2
    assert frame_around(NONE[:, 0], NONE, NONE) is None


def test_every_moment_of_a_session_without_walls_has_one_frame() -> None:
    path = np.array([[0.0, 0.0], [1.0, 1.0]])
    points = np.vstack([np.tile([[0.0, 2.0], [3.0, 0.0]], (100, 1)), [[90.0, 90.0]]])
    around = around_session(path, points, NONE)
    frame = frame_around(around, NONE, NONE)
    assert frame is not None
    assert 2.0 < frame.y1 < 3.0 < frame.x1 < 4.0
    np.testing.assert_array_equal(around_session(path, points, UNIT), path)


def test_grey_is_white_free_black_occupied_and_its_own_colour_unseen() -> None:
    probability = np.array([[0.0, 1.0], [0.5, np.nan]])
    seen = np.array([[True, True], [True, False]])
    pixels = grey_pixels(probability, seen).tolist()
    assert pixels == [[[255] * 3, [0] * 3], [[128] * 3, [150, 158, 178]]]


def panel(width_m: float = 2.0, height_m: float = 1.0, at: float = 0.0) -> Panel:
    geometry = GridGeometry((at, at), 0.1, 10, 20)
    cells = Cells(geometry, np.full((10, 20, 3), 200, np.uint8))
    marks = (Strokes(UNIT + at, style.FOUND_WALL, 2.0, "walls found"),
             RobotMark(SE2(at + 0.5, at + 0.5, 1.0), style.ROBOT))  # fmt: skip
    return Panel("a title", Box(at, at, at + width_m, at + height_m), cells, GREY_SWATCHES, marks)


def test_panels_of_one_place_show_the_same_and_those_of_two_have_one_scale() -> None:
    here = on_one_scale((panel(2.0, 1.0), panel(1.0, 2.0)))
    assert {p.frame for p in here} == {Box(0.0, 0.0, 2.0, 2.0)}
    apart = on_one_scale((panel(2.0, 1.0), panel(1.0, 2.0, at=100.0)))
    assert {(p.frame.width_m, p.frame.height_m) for p in apart} == {(2.0, 2.0)}
    assert apart[1].frame.x0 == pytest.approx(99.5)


def test_a_map_without_path_is_framed_as_those_beside_it(mapped: Path) -> None:
    lonely = mapped / "alone.npz"
    lonely.write_bytes((mapped / "maps" / "ping.npz").read_bytes())
    views = [the_view(lonely), the_view(SESSION)]
    assert views[0].placed_frame is None
    assert frames_of(views) == [views[1].frame] * 2


def rough_width(text: str, size_pt: float, bold: bool) -> float:
    return len(text) * size_pt * (0.62 if bold else 0.58) / 72.0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.text("ab cd", max_size=30), min_size=1, max_size=5), st.text("xy z", max_size=300),
    st.floats(0.05, 20.0), st.floats(0.05, 20.0),
)  # fmt: skip
def test_nothing_leaves_the_page_or_lies_on_something_else(
    labels: list[str], caption: str, width_m: float, height_m: float
) -> None:
    swatches = tuple(Swatch(style.FREE, label) for label in labels)
    one = Panel("a panel with a title", Box(0.0, 0.0, width_m, height_m), None, swatches)
    page = place(Page("title", (one,) * len(labels), caption), rough_width)
    right = page.width - style.MARGIN + 1e-6
    for text in page.texts:
        assert text.x + rough_width(text.text, text.size_pt, text.bold) <= right
        assert 0.0 < text.y < page.height
    for spot in page.panels:
        assert spot.x + spot.width <= right
        assert spot.y + spot.height < page.height
        assert spot.height / spot.width == pytest.approx(height_m / width_m)
    lowest = max(spot.y + spot.height for spot in page.panels)
    beside = max(spot.x + spot.width for spot in page.panels)
    for key in page.keys:
        assert key.y > lowest or key.x >= beside
        assert 0.0 < key.y < page.height
    for a in page.panels:
        for b in page.panels:
            apart = a.x + a.width <= b.x or b.x + b.width <= a.x or (
                a.y + a.height <= b.y or b.y + b.height <= a.y
            )  # fmt: skip
            assert a is b or apart


def test_the_legend_names_what_is_there_once() -> None:
    one = panel()
    beam = Area(UNIT[0], style.PATH, "beam of ping")
    two = Panel("", one.frame, one.cells, one.swatches, (*one.marks, beam))
    labels = [key.label for key in keys_of(Page("", (one, two)))]
    assert labels == ["free", "occupied", "never seen", "walls found", "robot", "beam of ping"]


def test_words_are_wrapped_and_cut() -> None:
    lines = wrapped("aa bb " + "c" * 200, 0.5, 10.0, rough_width)
    assert all(rough_width(line, 10.0, False) <= 0.5 for line in lines)
    assert lines[-1].endswith("…")
    assert " ".join(lines).startswith("aa bb c")
    assert [round_length_m(v) for v in (0.19, 0.2, 4.9, 10.0)] == [0.1, 0.2, 2.0, 10.0]


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_the_same_page_gives_the_same_bytes(form: str) -> None:
    page = Page("A <title> & $x_1$ \u202e", (panel(), panel()), "The caption: 100 % “seen”.")
    first = page_bytes(page, form)
    assert page_bytes(page, form) == first
    assert b"20" + b"26-" not in first  # no date
    if form == "png":
        with Image.open(io.BytesIO(first)) as picture:
            assert picture.width == 1600
            assert picture.text["Description"] == page.caption
    elif form == "svg":
        assert "100 %" in "".join(ElementTree.fromstring(first).itertext())
    else:
        assert first.startswith(b"%PDF")


def test_the_map_is_drawn_where_it_lies() -> None:
    """A single black cell is black at its place in the PNG, and the cell beside it is not."""
    pixels = np.full((10, 10, 3), 255, np.uint8)
    pixels[2, 7] = 0
    cells = Cells(GridGeometry((-1.0, 5.0), 0.2, 10, 10), pixels)
    frame = Box(-1.0, 5.0, 1.0, 7.0)
    page = Page("", (Panel("", frame, cells),))
    with Image.open(io.BytesIO(page_bytes(page, "png"))) as read:
        grey = np.asarray(read.convert("L"))
    from replay.pictures.drawing.pages import measured_place

    spot = measured_place(page).panels[0]
    for row, col, shade in ((2, 7, 0), (2, 6, 255), (3, 7, 255), (7, 2, 255)):
        x = spot.x + (col + 0.5) / 10 * spot.width
        y = spot.y + (1.0 - (row + 0.5) / 10) * spot.height
        assert grey[round(y * style.DOTS_PER_INCH), round(x * style.DOTS_PER_INCH)] == shade


def test_the_command_draws_and_says_what(
    mapped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "new" / "slide.png"
    arguments = ["picture", str(mapped / "room.rrd"), "--reading", "7", "-o", str(output)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "reading 7" in printed
    assert "In this reading dirrs saw nothing" in printed
    with Image.open(output) as picture:
        assert picture.width == 1600
    assert main(arguments) == 2
    assert main([*arguments, "--force", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_several_files_are_panels(mapped: Path, tmp_path: Path) -> None:
    output = tmp_path / "both.svg"
    maps, recording = mapped / "maps", mapped / "room.rrd"
    files = [str(maps), "--compare", str(recording), str(maps / "ping.yaml")]
    assert main(["picture", *files, "-o", str(output), "--quiet"]) == 0
    text = "".join(ElementTree.fromstring(output.read_bytes()).itertext())
    assert text.index("maps (") < text.index("room.rrd (") < text.index("ping.yaml (")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["-o", "a.gif"], ".png, .svg or .pdf"),
        (["-o", "a.png", "--step", "3", "--reading", "3"], "give one"),
        (["-o", "a.png", "--view", "pong"], "did you mean 'ping'?"),
        (["-o", "a.png", "--reading", "100000"], "no reading 100000"),
        (["-o", "a.png", "--step", "1000000"], "no step 1000000"),
    ],
)
def test_bad_wishes_are_one_line(
    arguments: list[str], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], mapped: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    for file in (SESSION, mapped / "room.rrd"):
        coarse = ["--set", "grid.resolution_m=0.1"]
        assert main(["picture", str(file), *arguments, *coarse]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert reason in line
    assert list(tmp_path.iterdir()) == []


def test_a_map_has_no_moments(mapped: Path, tmp_path: Path) -> None:
    output = tmp_path / "a.png"
    assert main(["picture", str(mapped / "maps"), "--reading", "1", "-o", str(output)]) == 2
    assert not output.exists()
