"""Maps side by side in the real viewer: each view shows its own room, at the same step."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from made_run import MadeRun
from numpy.typing import NDArray
from PIL import Image
from viewer_support import headless

from mapping.artifacts import Artifact, MergedGrid
from mapping.beams import Beam
from mapping.config import load_config
from recorder.messages import Radiation, Range
from replay.comparison import Variant
from replay.comparison_steps import in_step
from replay.rrd import layout
from replay.rrd.blueprints import BY_STEP
from replay.rrd.comparison import comparison_writer
from replay.rrd.headless import HeadlessViewer

PATIENCE = 60  # how often a picture is asked for until it shows what it must
# Rooms of different sizes on one grid; nothing but the cells shows where the walls are.
MARGINS_M = {"wide": 0.15, "middle": 0.35, "small": 0.55}
ROOMS = {
    name: MadeRun(
        sensors=(("dirrs", 6.0),), readings=180, turn_rad=0.25, knows_walls=False,
        wall_margin_m=margin_m,
    )
    for name, margin_m in MARGINS_M.items()
}  # fmt: skip


@pytest.fixture(scope="module")
def runs() -> dict[str, list[Artifact]]:
    return {name: list(room.artifacts()) for name, room in ROOMS.items()}


@pytest.fixture(scope="module")
def path(runs: dict[str, list[Artifact]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("comparison") / "rooms.rrd"
    beams = [a for a in runs["wide"] if isinstance(a, Beam)]
    messages = [Range(b.t_ns, b.sensor, 1.0, 0.1, 0.0, 4.0, Radiation.INFRARED) for b in beams]
    variants = [Variant(name, load_config()) for name in runs]
    with comparison_writer(path, variants, name="rooms") as writer:
        for moment in in_step(runs, messages):
            writer(moment)
    return path


@pytest.fixture(scope="module")
def shown(path: Path) -> Iterator[HeadlessViewer]:
    with headless(path) as viewer:
        yield viewer


def picture_of(viewer: HeadlessViewer, view: str | None = None) -> Image.Image:
    """A picture, asked for again where the viewer has no time to draw it."""
    for _ in range(PATIENCE - 1):
        with contextlib.suppress(TimeoutError):
            return viewer.screenshot(view)
    return viewer.screenshot(view)


def box_in_view(
    viewer: HeadlessViewer, view: str, expected: NDArray[np.float64], within: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The dark box of a view, once it is as expected, or else as it stays."""
    box = np.full(4, np.nan)
    for _ in range(PATIENCE):
        box = dark_box(picture_of(viewer, view))
        if (np.abs(box - expected) <= within).all():
            return box
        time.sleep(0.5)
    return box


def dark_box(picture: Image.Image) -> NDArray[np.float64]:
    """Left, right, low and high of the dark cells, as shares of the picture's grid, or NaN."""
    pixels = np.asarray(picture).astype(int)
    grey = np.ptp(pixels, axis=-1) <= 6
    unseen = np.abs(pixels - np.array(layout.NEVER_SEEN[:3])).max(axis=-1) <= 12
    rows, cols = np.nonzero(unseen)
    top, bottom, left, right = rows.min(), rows.max(), cols.min(), cols.max()
    on_map = np.zeros_like(grey)
    on_map[top : bottom + 1, left : right + 1] = True
    dark_rows, dark_cols = np.nonzero(grey & on_map & (pixels.max(axis=-1) < 85))
    if len(dark_rows) <= 200:
        return np.full(4, np.nan)
    inner_cols = np.percentile((dark_cols - left) / (right - left), [1, 99])
    inner_rows = np.percentile((bottom - dark_rows) / (bottom - top), [1, 99])
    return np.concatenate([inner_cols, inner_rows])


@pytest.mark.viewer
def test_it_opens_paused_with_a_view_for_each_map(path: Path) -> None:
    with headless(path) as viewer:
        assert viewer.now == ("step", 0)
        views = {f"{name}: dirrs" for name in ROOMS} | {f"{name}: fused" for name in ROOMS}
        assert views | {"What this step does", BY_STEP} <= set(viewer.views)


@pytest.mark.viewer
def test_no_view_complains_at_any_kind_of_step(
    shown: HeadlessViewer, runs: dict[str, list[Artifact]]
) -> None:
    first_of_each: dict[type, int] = {}
    for step, artifact in enumerate(runs["wide"]):
        first_of_each.setdefault(type(artifact), step)
    for step in sorted({*first_of_each.values(), len(runs["wide"]) - 1}):
        shown.go_to(step)
        picture_of(shown)
        assert shown.complaints == [], step


@pytest.mark.viewer
def test_each_view_shows_its_own_dark_room(
    shown: HeadlessViewer, runs: dict[str, list[Artifact]]
) -> None:
    merged = [step for step, a in enumerate(runs["wide"]) if isinstance(a, MergedGrid)]
    shown.go_to(merged[-1])
    for name, room in ROOMS.items():
        low = room.walls_m[0, 0] - room.geometry.origin_m
        high = room.walls_m[1, 1] - room.geometry.origin_m
        width, height = room.geometry.size_m
        expected = np.array([low[0] / width, high[0] / width, low[1] / height, high[1] / height])
        within = 0.12 / np.array([width, width, height, height])
        box = box_in_view(shown, f"{name}: dirrs", expected, within)
        assert (np.abs(box - expected) <= within).all(), f"{name}: {box}, not {expected}"
