"""A session of ``logs/``, mapped by the real pipeline, in the real viewers: window and browser.

The room is known (its true walls travel with the session), so that what one sees can be measured:
dark cells lie on walls, the beam starts at the robot, changes red and blue where the map has them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image
from scipy.spatial import cKDTree
from viewer_support import Browser, Patiently, Scale, headless, near

from mapping.artifacts import Artifact, Finished, MergedGrid, Started, TempGrid
from mapping.beams import Beam
from mapping.config import MappingConfig, load_config
from mapping.grid import GridGeometry
from mapping.pipeline import build_maps
from mapping.probing import CellProbe
from recorder.session import read_session
from recorder.truth import true_walls
from replay.colours import sensor_colours
from replay.rrd import layout
from replay.rrd.axes import frame_of
from replay.rrd.blueprints import CHANGES, DISPLAYS
from replay.rrd.headless import HeadlessViewer
from replay.rrd.pictures import beam_outline
from replay.rrd.web import WebViewer
from replay.rrd.writer import run_writer

WATCHED = (2.21, 0.21)  # on the right wall of the room
SENSOR = "dirrs"  # narrow beams: its walls come out sharp
SENSOR_COLOUR = sensor_colours([SENSOR])[SENSOR]
OVERLAYS = (layout.WALLS, layout.ROBOT, layout.PATH, layout.points(SENSOR), f"{layout.AXES}/frame")
NEAR_WALL_M = 0.14  # at its reach of 0.8 m: the infrared's band (0.06), its error (0.04), two cells


@pytest.fixture(scope="module")
def config() -> MappingConfig:
    return load_config(settings=["grid.resolution_m=0.02"])


@pytest.fixture(scope="module")
def artifacts(config: MappingConfig) -> list[Artifact]:
    session = read_session(ROOT / "logs" / "room.mcap")
    return list(build_maps(session.messages(), config, walls_m=true_walls(session.attachments)))


@pytest.fixture(scope="module")
def path(
    artifacts: list[Artifact], config: MappingConfig, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("session") / "room.rrd"
    probe = CellProbe(WATCHED)
    with run_writer(path, config, name="room", probes=[probe]) as writer:
        for artifact in artifacts:
            probe(artifact)
            writer(artifact)
    return path


@pytest.fixture(scope="module")
def shown(path: Path) -> Iterator[HeadlessViewer]:
    with headless(path) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def walls_m(artifacts: list[Artifact]) -> np.ndarray:
    """Points all along the true walls, (N, 2), a centimetre apart."""
    started = artifacts[0]
    assert isinstance(started, Started)
    assert len(started.walls_m) == 12
    each = [
        start + np.linspace(0, 1, 1 + round(100 * math.dist(start, end)))[:, None] * (end - start)
        for start, end in started.walls_m
    ]
    return np.concatenate(each)


def dark(image: Image.Image) -> np.ndarray:
    """Grey pixels that are nearly black, but not the viewer's own background."""
    pixels = np.asarray(image).astype(int)
    found: np.ndarray = (np.ptp(pixels, axis=-1) <= 6) & (pixels.max(axis=-1) < 60)
    return found


def share_along(picture: Image.Image, scale: Scale, points_m: np.ndarray, colour: tuple) -> float:
    """What part of some points of the map lies within two pixels of a colour."""
    rows, cols = np.nonzero(near(picture, colour, within=40))
    if not len(rows):
        return 0.0
    gaps, _ = cKDTree(np.column_stack([rows, cols])).query(scale.pixels(points_m))
    return float((gaps <= 2.0).mean())


def outline_points(beam: Beam) -> np.ndarray:
    """Points all along the drawn outline of a beam, (N, 2), metres."""
    pieces = []
    for strip in beam_outline(beam):
        pieces += [
            start + np.linspace(0, 1, 30)[:, None] * (end - start)
            for start, end in itertools.pairwise(strip)
        ]
    return np.concatenate(pieces)


def hidden(viewer: HeadlessViewer, *, on: bool) -> None:
    """Show or hide what lies over the cells."""
    viewer.switch(SENSOR, *OVERLAYS, on=on)


@pytest.fixture(scope="module")
def scale(shown: HeadlessViewer, artifacts: list[Artifact]) -> Scale:
    started = artifacts[0]
    assert isinstance(started, Started)
    shown.go_to(0)
    return Scale.of_view(shown.screenshot(SENSOR), frame_of(started), started.geometry)


def steps_of(artifacts: list[Artifact], kind: type, sensor: str = SENSOR) -> list[int]:
    """Steps at which a kind of artifact of one sensor is shown."""
    return [
        step for step, artifact in enumerate(artifacts)
        if isinstance(artifact, kind)
        and getattr(artifact, "beam", artifact).sensor == sensor
    ]  # fmt: skip


def assert_dark_on_walls(dark_m: np.ndarray, walls_m: np.ndarray) -> None:
    """Dark places are true walls, and the walls that the robot passed are dark."""
    assert len(dark_m) > 300
    to_wall, _ = cKDTree(walls_m).query(dark_m)
    assert (to_wall < NEAR_WALL_M).mean() > 0.97
    tree = cKDTree(dark_m)
    for name, (x0, y0), (x1, y1) in (
        ("bottom", (1.3, 0.0), (2.1, 0.0)),
        ("right, below", (2.2, 0.05), (2.2, 0.2)),
        ("right, above", (2.2, 1.45), (2.2, 1.55)),
        ("top", (1.95, 1.6), (2.15, 1.6)),
        ("side of a box", (1.675, 0.75), (1.675, 0.85)),
    ):
        along = np.linspace(0, 1, 20)[:, None]
        wall = np.array([x0, y0]) + along * np.array([x1 - x0, y1 - y0])
        to_dark, _ = tree.query(wall)
        assert (to_dark < NEAR_WALL_M).mean() > 0.9, name


@pytest.mark.viewer
def test_no_view_complains_in_any_tab(shown: HeadlessViewer, artifacts: list[Artifact]) -> None:
    merged = steps_of(artifacts, MergedGrid)[0]
    for tab in (CHANGES, DISPLAYS, "fused", SENSOR):
        shown.bring_to_front(tab)
        for step in (merged, len(artifacts) - 1):
            shown.go_to(step)
            shown.screenshot()
            assert shown.complaints == [], (tab, step)


@pytest.mark.viewer
def test_the_dark_cells_are_the_true_walls(
    shown: HeadlessViewer, scale: Scale, artifacts: list[Artifact], walls_m: np.ndarray
) -> None:
    hidden(shown, on=False)
    shown.go_to(steps_of(artifacts, MergedGrid)[-1])
    mask = dark(shown.screenshot(SENSOR))
    hidden(shown, on=True)
    places = scale.metres(mask)
    edge_m = 0.05  # beyond the map is the viewer's own dark
    low = np.array(scale.geometry.origin_m) + edge_m
    high = low + scale.geometry.size_m - 2 * edge_m
    inside = ((places > low) & (places < high)).all(axis=-1)
    assert_dark_on_walls(places[inside], walls_m)


@pytest.mark.viewer
def test_stepping_forward_and_back_shows_the_right_reading(
    shown: HeadlessViewer, scale: Scale, artifacts: list[Artifact]
) -> None:
    """The beam is drawn where that reading's beam was, and nowhere else."""
    shown.switch(SENSOR, layout.points(SENSOR), on=False)
    steps = steps_of(artifacts, Beam)
    far_apart = [steps[k] for k in (150, 260, 390, 260)]
    outlines = {step: outline_points(artifacts[step]) for step in far_apart}
    try:
        for step in far_apart:
            shown.go_to(step)
            picture = shown.screenshot(SENSOR)
            shares = {
                each: share_along(picture, scale, points, SENSOR_COLOUR)
                for each, points in outlines.items()
            }
            assert shares.pop(step) > 0.6, step
            assert max(shares.values()) < 0.3, step
    finally:
        shown.switch(SENSOR, layout.points(SENSOR), on=True)


@pytest.mark.viewer
def test_what_changed_is_red_where_more_occupied_and_blue_where_more_free(
    shown: HeadlessViewer, scale: Scale, artifacts: list[Artifact]
) -> None:
    shown.bring_to_front(CHANGES)
    step = max(steps_of(artifacts, MergedGrid), key=lambda step: _both_ways(artifacts[step]))
    merged = artifacts[step]
    assert isinstance(merged, MergedGrid)
    view = f"{SENSOR}: what changed"
    shown.switch(view, *OVERLAYS, layout.beam(SENSOR), on=False)
    shown.go_to(step)
    picture = shown.screenshot(view)
    shown.bring_to_front(SENSOR)
    # The two tabs are laid out alike: the scale of the one is that of the other.
    difference = merged.probability - merged.previous
    corner = np.array([merged.window.row0, merged.window.col0])
    pixels = np.asarray(picture).astype(int)
    for sign, strong, weak in ((1, 0, 2), (-1, 2, 0)):
        cells = np.argwhere(sign * difference > 0.05) + corner
        assert len(cells) > 10
        rows, cols = scale.pixels(merged.geometry.centres_of(cells)).T
        tinted = pixels[rows, cols, strong] > pixels[rows, cols, weak] + 20
        assert tinted.mean() > 0.9, sign


@pytest.mark.viewer
def test_other_ways_to_draw_are_hidden_until_they_are_switched_on(
    shown: HeadlessViewer, scale: Scale, artifacts: list[Artifact]
) -> None:
    hidden(shown, on=False)
    shown.go_to(len(artifacts) - 1)
    reduced = layout.display(SENSOR, "reduced")
    pictures = {}
    for on in (False, True):
        shown.switch(SENSOR, reduced, on=on)
        pictures[on] = np.asarray(shown.screenshot(SENSOR)).astype(int)
    shown.switch(SENSOR, reduced, on=False)
    again = np.asarray(shown.screenshot(SENSOR)).astype(int)
    hidden(shown, on=True)
    grey = np.ptp(pictures[True], axis=-1) <= 3
    inside = np.zeros(grey.shape, bool)
    top = int(scale.bottom - scale.geometry.size_m[1] * scale.px_per_m)
    inside[top + 3 : int(scale.bottom) - 3, int(scale.left) + 3 :] = True
    inside[:, int(scale.left + scale.geometry.size_m[0] * scale.px_per_m) - 3 :] = False
    common = {on: _common_shades(picture[grey & inside][:, 0]) for on, picture in pictures.items()}
    background = 13  # of the viewer itself
    assert len(common[False]) > 5
    gaps = [min(abs(shade - level) for level in (0, 64, 128, 191, 255, background))
            for shade in common[True]]  # fmt: skip
    assert max(gaps) <= 2
    assert len(common[True]) >= 3
    assert (np.abs(again - pictures[False]).max(axis=-1) > 8).mean() < 0.001


def _both_ways(artifact: Artifact) -> int:
    """How many cells a reading made clearly more occupied and more free, whichever are fewer."""
    assert isinstance(artifact, MergedGrid)
    difference = artifact.probability - artifact.previous
    return min(int((difference > 0.05).sum()), int((difference < -0.05).sum()))


def _common_shades(values: np.ndarray) -> list[int]:
    """Shades that at least one pixel of five hundred has."""
    counts = np.bincount(values, minlength=256)
    return [int(shade) for shade in np.nonzero(counts > values.size / 500)[0]]


@pytest.mark.viewer
def test_the_watched_cell_is_marked_at_its_place(shown: HeadlessViewer, scale: Scale) -> None:
    shown.go_to(0)
    found = scale.metres(near(shown.screenshot(SENSOR), layout.PROBE, within=60))
    assert len(found) > 20
    assert found.mean(axis=0) == pytest.approx(WATCHED, abs=0.03)


@pytest.fixture(scope="module")
def maps_alone(
    artifacts: list[Artifact], config: MappingConfig, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """One sensor's readings and nothing after them: the last step is the map, uncovered."""
    path = tmp_path_factory.mktemp("web") / "maps.rrd"
    started = artifacts[0]
    assert isinstance(started, Started)
    nothing_known = np.zeros((0, 2, 2))
    only = Started(
        started.geometry, (SENSOR,), nothing_known, started.first_t_ns, started.last_t_ns
    )
    wanted = {s for kind in (Beam, TempGrid, MergedGrid) for s in steps_of(artifacts, kind)}
    with run_writer(path, config, name="maps") as writer:
        writer(only)
        for step in sorted(wanted):
            writer(artifacts[step])
        writer(Finished(400, {SENSOR: 400}, {}))
    return path


class MapPage(Patiently):
    """What a page shows of a map.

    The page arranges itself anew while it loads, and on a busy machine one sees that. So places are
    measured in each picture by itself, never in one picture for another.
    """

    def __init__(self, browser: Browser, geometry: GridGeometry) -> None:
        super().__init__(browser)
        self.geometry = geometry

    def never_seen(self, picture: Image.Image) -> np.ndarray:
        """The pixels of the map that are of the colour of what was never seen.

        The maps have seven tenths of the page's width; the legend has a swatch of that colour, too.
        """
        found = near(picture, layout.NEVER_SEEN)
        found[:, 7 * found.shape[1] // 10 :] = False
        return found

    def scale(self, picture: Image.Image) -> Scale:
        """Of a picture whose map is never seen at its four sides."""
        return Scale.of(self.never_seen(picture), self.geometry)

    def empty(self, picture: Image.Image) -> bool:
        """A whole rectangle of never seen cells, as wide and high as the map, and no beam."""
        mask = self.never_seen(picture)
        if mask.mean() < 0.1:
            return False
        rows, cols = (np.nonzero(mask.any(axis=axis))[0] for axis in (1, 0))
        inside = mask[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        shape = self.geometry.cols / self.geometry.rows
        is_map = inside.shape[1] / inside.shape[0] == pytest.approx(shape, rel=0.02)
        return is_map and float(inside.mean()) > 0.999

    def shows_beam(self, picture: Image.Image, beam: Beam) -> bool:
        """The beam is drawn where it was; the robot's arrow lies over a part of it."""
        if self.never_seen(picture).mean() < 0.1:
            return False
        points = outline_points(beam)
        return share_along(picture, self.scale(picture), points, SENSOR_COLOUR) > 0.8


@pytest.mark.viewer
def test_the_browser_shows_the_walls_and_steps_both_ways(
    maps_alone: Path, artifacts: list[Artifact], walls_m: np.ndarray
) -> None:
    started = artifacts[0]
    assert isinstance(started, Started)
    first = artifacts[steps_of(artifacts, Beam)[0]]
    assert isinstance(first, Beam)
    with WebViewer(maps_alone) as web:
        browser = Browser(f"{web.url}&renderer=webgl", size=(900, 700))
        page = MapPage(browser, started.geometry)
        try:
            empty = page.until(page.empty, "the empty map")
            assert not page.shows_beam(empty, first)

            def has_beam(picture: Image.Image) -> bool:
                return page.shows_beam(picture, first)

            page.press_until("ArrowRight", page.empty, has_beam, "the first beam")
            back = page.press_until("ArrowLeft", has_beam, page.empty, "the empty map again")
            scale = page.scale(back)  # by now all is loaded, and nothing moves any more

            browser.press("ArrowRight", ctrl_shift=True)
            low = np.array(started.geometry.origin_m)

            def dark_m(picture: Image.Image) -> np.ndarray:
                places = scale.metres(dark(picture))
                inside = (places > low) & (places < low + started.geometry.size_m)
                return places[inside.all(axis=-1)]

            def is_whole(picture: Image.Image) -> bool:
                """The end of the run: the last wall that the robot came to see is dark."""
                places = dark_m(picture)
                top = np.abs(places - [2.1, 1.6]).max(axis=1) < 0.1 if len(places) else []
                return int(np.sum(top)) > 10

            last = page.until(is_whole, "the last wall")
            assert_dark_on_walls(dark_m(last), walls_m)
            assert browser.requests_elsewhere() == []
        finally:
            browser.close()
