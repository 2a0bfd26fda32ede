"""The chapter's figures: what they show of a session, what is left out, the page, the list."""

from __future__ import annotations

import importlib.util
import itertools
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from echogrid import main
from mapping.config import load_config
from mapping.segments.chains import joined
from mapping.segments.methods import line_method
from mapping.segments.stages import Split
from recorder.session import SessionWriter
from recorder.session.columns import open_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room
from replay.pictures.figures.bench import CHAPTER, Bench
from replay.pictures.figures.figure import Drawing, LeftOut
from replay.pictures.figures.raw_lines import chained, pieces_of
from replay.pictures.figures.table import FIGURES, NUMBERED, map_command_of, stem_of
from replay.pictures.parts import Bars, Chart, Curve, Page, Panel
from replay.pictures.placing import place

SESSION = ROOT / "logs" / "room.mcap"
COARSE = ("grid.resolution_m=0.04",)
CONFIG = load_config(settings=COARSE)


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench(SESSION, CONFIG)


@pytest.fixture(scope="module")
def drawings(bench: Bench) -> dict[str, Drawing]:
    """Every figure of the session that can be drawn, by its slug."""
    return drawn(bench)


def drawn(bench: Bench) -> dict[str, Drawing]:
    found = {}
    for figure in FIGURES:
        try:
            found[figure.slug] = figure.drawn(bench)
        except LeftOut:
            continue
    return found


def a_session(folder: Path, *sensors: str, duration_s: float = 4.0) -> Path:
    file = folder / f"{'-'.join(sensors)}.mcap"
    with SessionWriter(file) as writer:
        run = simulate(load_room("room"), duration_s=duration_s, seed=3, sensors=sensors)
        for log_ns, message in run:
            writer.write(message, log_ns=log_ns)
    return file


def rough_width(text: str, size_pt: float, bold: bool) -> float:
    return len(text) * size_pt * (0.62 if bold else 0.58) / 72.0


def test_the_table_is_in_the_order_of_the_chapter() -> None:
    assert len(FIGURES) >= 40
    slugs = [figure.slug for figure in FIGURES]
    assert len(set(slugs)) == len(slugs)
    assert all(re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", slug) for slug in slugs)
    passages = [passage for passage, _ in itertools.groupby(FIGURES, lambda f: f.passage)]
    once = [passage for passage in passages if passage != "Sensor Models"]
    assert len(set(once)) == len(once), "figures of one heading stand together"


def test_all_can_be_drawn(drawings: dict[str, Drawing]) -> None:
    assert {figure.slug for figure in FIGURES} == set(drawings)


def test_learned_models_are_those_of_the_session(drawings: dict[str, Drawing]) -> None:
    """The area below the learned curve is the share of right readings, as the caption has it."""
    drawing = drawings["learned-model"]
    shares = re.findall(r"([\d.]+) % of its readings are right", drawing.caption)
    for chart, share in zip(drawing.panels, shares, strict=True):
        assert isinstance(chart, Chart)
        bars, *curves = chart.parts
        assert isinstance(bars, Bars)
        assert all(isinstance(curve, Curve) for curve in curves)
        ideal, learned = (np.trapezoid(c.points[:, 1], c.points[:, 0]) for c in curves)  # type: ignore[union-attr]
        assert ideal == pytest.approx(1.0, abs=0.01)
        assert learned == pytest.approx(float(share) / 100.0, abs=0.02)
        assert learned - 0.1 < float((bars.heights * np.diff(bars.edges)).sum()) <= 1.0


def test_every_caption_has_words_and_fits(drawings: dict[str, Drawing]) -> None:
    for slug, drawing in drawings.items():
        assert re.fullmatch(r"(?s)[A-Za-z0-9].{40,420}\.", drawing.caption), (slug, drawing.caption)
        assert "nan" not in drawing.caption.split(), slug
        page = place(
            Page("9. A title", drawing.panels, drawing.caption, columns=drawing.columns),
            rough_width,
        )
        for text in page.texts:
            assert text.x + rough_width(text.text, text.size_pt, text.bold) <= page.width, slug
            assert "…" not in text.text, slug
        assert page.height < 12.0, slug


def test_no_panel_is_empty(drawings: dict[str, Drawing]) -> None:
    for slug, drawing in drawings.items():
        assert drawing.panels
        for panel in drawing.panels:
            assert has_content(panel), (slug, panel.title)


def has_content(panel: Panel | Chart) -> bool:
    """Something that differs from its ground: several colours of cells, or marks besides walls."""
    if isinstance(panel, Chart):
        return len(panel.parts) > 0
    if panel.cells is not None:
        shown = panel.cells.within(panel.frame).pixels.reshape(-1, 3)
        if len(np.unique(shown, axis=0)) > 1:
            return True
    return any(getattr(mark, "label", "") not in ("", "true walls") for mark in panel.marks)


def test_thresholds_of_counts_leave_less_and_less(drawings: dict[str, Drawing]) -> None:
    black = [dark_cells(panel) for panel in drawings["count-thresholds"].panels]
    assert black[0] > black[1] > black[2] > 0
    more = [dark_cells(panel) for panel in drawings["thresholds"].panels]
    assert more[0] >= more[1] >= more[2]


def dark_cells(panel: Panel | Chart) -> int:
    assert isinstance(panel, Panel)
    assert panel.cells is not None
    return int((panel.cells.pixels == 0).all(axis=2).sum())


def test_the_second_grid_counts_a_cell_once(drawings: dict[str, Drawing]) -> None:
    speckled, cured = drawings["speckle-cured"].panels
    shades = [len(np.unique(p.cells.pixels)) for p in (speckled, cured)]  # type: ignore[union-attr]
    assert shades[0] > 2
    assert shades[1] == 2


def test_the_worked_example_of_bayes(drawings: dict[str, Drawing]) -> None:
    """The chapter's 0.5582428486 is single precision."""
    found = [float(word) for word in re.findall(r"0\.\d{10}", drawings["bayes-cell"].caption)]
    assert found == pytest.approx([0.5582428486] * 2, abs=1e-8)


def test_a_figure_shows_the_map_that_its_command_makes(bench: Bench, tmp_path: Path) -> None:
    """Its own map, but for the grid, which here holds path and walls alone."""
    number = next(n for n, f in NUMBERED.items() if f.slug == "infrared-combined")
    words = map_command_of(number, str(SESSION), "dirrs").replace("'", "").split()
    assert words[:2] == ["echogrid", "picture"]
    settings_ = [words[k + 1] for k, word in enumerate(words) if word == "--set"]
    from replay.pictures.opening import Asked, open_views

    config = load_config(settings=[*COARSE, *settings_], preset="chapter")
    (view,) = open_views(SESSION, Asked(view="dirrs"), config)
    layer = bench.layer(bench.narrow, **CHAPTER)
    here, there = layer.geometry, view.cells.geometry
    assert here.resolution_m == there.resolution_m
    offset = np.round((np.array(here.origin_m) - there.origin_m) / here.resolution_m).astype(int)
    rows, cols = slice(max(offset[1], 0), offset[1] + here.rows), slice(offset[0], None)
    theirs = view.cells.pixels[rows, cols][:, : here.cols]
    low = max(-offset[1], 0)
    from replay.pictures.views import grey_pixels

    ours = grey_pixels(layer.probability, layer.observed)[low : low + len(theirs)]
    np.testing.assert_array_equal(ours[:, : theirs.shape[1]], theirs)
    assert (theirs == 255).any()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.01, 0.05, 0.3]))
def test_cuts_leave_pieces_that_follow_each_other(seed: int, epsilon_m: float) -> None:
    """The slow twin: cut at the farthest point of each chord until none is too far."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(0.0, 0.1, (30, 2)), axis=0)
    section = load_config().segments.model_copy(
        update={"epsilon_m": epsilon_m, "merge": "none", "wrap": "off", "min_points": 2}
    )
    stages: list[object] = []
    line_method("split-and-merge").lines(joined([(points, False)]), section, stages.append)
    splits = [each for each in stages if isinstance(each, Split)]
    pieces = pieces_of(joined([(points, False)]), splits)
    assert len(pieces) == len(splits) + 1
    ends = {tuple(end) for piece in pieces.tolist() for end in piece}
    assert ends == {tuple(points[k]) for k in naive_cuts(points, 0, len(points) - 1, epsilon_m)}


def naive_cuts(points: np.ndarray, low: int, high: int, epsilon_m: float) -> set[int]:
    chord = points[high] - points[low]
    normal = np.array([-chord[1], chord[0]]) / max(float(np.hypot(*chord)), 1e-300)
    away = np.abs((points[low : high + 1] - points[low]) @ normal)
    at = low + int(np.argmax(away))
    if away.max() <= epsilon_m or at in (low, high):
        return {low, high}
    return naive_cuts(points, low, at, epsilon_m) | naive_cuts(points, at, high, epsilon_m)


@pytest.mark.parametrize(
    ("sensors", "missing", "there"),
    [
        (("ping",), {"infrared-points", "fusion-weights"}, {"sonar-points", "counts", "himm"}),
        (("dirrs",), {"sonar-points", "classes"}, {"infrared-points", "counts", "lines-infrared"}),
        (("lidar",), {"cone", "sonar-points"}, {"infrared-points", "split-infrared", "himm"}),
    ],
)  # fmt: skip
def test_what_a_session_cannot_have_is_left_out(
    sensors: tuple[str, ...], missing: set[str], there: set[str], tmp_path: Path
) -> None:
    bench = Bench(a_session(tmp_path, *sensors, duration_s=12.0), CONFIG)
    found = set(drawn(bench))
    assert there <= found
    assert not missing & found
    assert bench.laser == (sensors == ("lidar",))
    (figure,) = (f for f in FIGURES if f.slug == "infrared-points")
    assert figure.title_for(laser=bench.laser).startswith("The laser") == bench.laser


@pytest.mark.filterwarnings("error")
def test_a_sensor_that_saw_nothing_has_few_figures(tmp_path: Path) -> None:
    found = drawn(Bench(a_session(tmp_path, "dirrs"), CONFIG))
    assert "normal-distribution" in found
    assert not {"infrared-points", "line-extraction", "borders-infrared"} & set(found)
    assert all(any(map(has_content, each.panels)) for each in found.values())


def test_lines_of_a_laser_are_of_one_scan(tmp_path: Path) -> None:
    bench = Bench(a_session(tmp_path, "lidar"), CONFIG)
    chains, _, _ = chained(bench, bench.narrow)
    assert len(chains.points_m) <= len(bench.typical(bench.narrow).ranges_m)


class Seen(HTMLParser):
    """The pictures, texts and tags of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.pictures: list[dict[str, str | None]] = []
        self.tags: set[str] = set()
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag == "img":
            self.pictures.append(dict(attrs))

    def handle_data(self, data: str) -> None:
        self.words += data


def test_the_command_writes_numbered_files_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "ro<i>om & co.mcap"
    with SessionWriter(session, metadata={}) as file:  # which carries no walls
        for record in open_session(SESSION).records():
            file.write(record.message, log_ns=record.log_ns)
    folder = tmp_path / "deep" / "figures"
    numbers = [next(n for n, f in NUMBERED.items() if f.slug == slug)
               for slug in ("sonar-points", "six-regions", "learned-model")]  # fmt: skip
    arguments = ["figures", str(session), "-o", str(folder), "--set", COARSE[0]]
    only = [word for number in numbers for word in ("--only", str(number))]
    assert main([*arguments, *only]) == 0
    out = capsys.readouterr().out
    assert f"left out: {numbers[2]}. A learned model" in out
    assert "wrote 2 figures" in out
    stems = [stem_of(number) for number in numbers[:2]]
    wanted = {"index.html"} | {f"{stem}.{form}" for stem in stems for form in ("png", "svg")}
    assert {file.name for file in folder.iterdir()} == wanted
    for stem in stems:
        with Image.open(folder / f"{stem}.png") as picture:
            assert picture.width == 1600
            assert len(np.unique(np.asarray(picture.convert("L")))) > 10
        ElementTree.parse(folder / f"{stem}.svg")
    page = Seen((folder / "index.html").read_text("utf-8"))
    assert [picture["src"] for picture in page.pictures] == [f"{stem}.svg" for stem in stems]
    assert "ro<i>om & co.mcap" in page.words
    assert "i" not in page.tags
    assert main([*arguments, *only]) == 2
    before = (folder / f"{stems[0]}.png").read_bytes()
    assert main([*arguments, *only, "--force", "--quiet"]) == 0
    assert (folder / f"{stems[0]}.png").read_bytes() == before
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [(["--only", "1000"], "there is no figure 1000"), (["--set", "no.such=1"], "unknown key")],
)
def test_bad_wishes_are_one_line(
    arguments: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "figures"
    assert main(["figures", str(SESSION), "-o", str(folder), *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert reason in line
    assert not folder.exists()


def test_a_session_that_cannot_be_mapped_leaves_no_folder(tmp_path: Path) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(b"nothing of the kind")
    assert main(["figures", str(bad), "-o", str(tmp_path / "figures")]) == 2
    assert not (tmp_path / "figures").exists()


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("maker", ROOT / "docs" / "make_figures_page.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_list_in_the_docs_is_current(maker: ModuleType) -> None:
    page = (ROOT / "docs" / "figures.md").read_text("utf-8")
    with_listing: Callable[[str], str] = maker.with_listing
    assert with_listing(page) == page, "run docs/make_figures_page.py"
    assert all(f"`{stem_of(number)}.png`" in page for number in NUMBERED)
