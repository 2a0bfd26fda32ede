"""The red and blue of each reading lie over the cells, wherever on the map the reading is.

A minute's drive all through the room, so that readings lie near each edge of the view: what the
viewer lays over what once depended on how far from the middle of the view it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from viewer_support import Scale, headless

import echogrid
from mapping.artifacts import Artifact, MergedGrid, Started, TempGrid
from mapping.config import load_config
from mapping.grid import Window
from mapping.pipeline import build_maps
from recorder.session import read_session
from replay.rrd import layout
from replay.rrd.axes import frame_of
from replay.rrd.blueprints import CHANGES
from replay.rrd.headless import HeadlessViewer
from replay.rrd.pictures import strength_classes, strength_names
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.writer import RrdWriter

SENSOR = "ping"
MOST = 7  # of the edges and in between, of each kind
FEWEST_CELLS = 200
# The room and a little around it, so that a cell has four pixels or so.
SETTINGS = (
    "grid.resolution_m=0.02", "grid.origin_m=[-0.3, -0.3]", "grid.size_m=[2.8, 2.2]",
)  # fmt: skip
TINT = 20  # by so much of 255 red is over blue, or blue over red


@pytest.fixture(scope="module")
def artifacts(tmp_path_factory: pytest.TempPathFactory) -> list[Artifact]:
    session = tmp_path_factory.mktemp("minute") / "room.mcap"
    arguments = ["simulate", "room", "-o", str(session), "--duration", "60", "--seed", "1"]
    assert echogrid.main([*arguments, "--quiet"]) == 0
    # Of bayes, by which a reading moves many cells each way.
    config = load_config(settings=[*SETTINGS, "sensors.*.update=bayes"])
    return list(build_maps(read_session(session).messages(), config))


@pytest.fixture(scope="module")
def shown(
    artifacts: list[Artifact], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[HeadlessViewer]:
    path = tmp_path_factory.mktemp("recording") / "room.rrd"
    with RrdWriter(path, RunDrawer(), name="room") as writer:
        for artifact in artifacts:
            writer(artifact)
    assert writer.left_out == ""
    with headless(path) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def scale(shown: HeadlessViewer, artifacts: list[Artifact]) -> Scale:
    started = artifacts[0]
    assert isinstance(started, Started)
    shown.go_to(0)
    return Scale.of_view(shown.screenshot(SENSOR), frame_of(started), started.geometry)


@dataclass(frozen=True)
class Patch:
    """What a step must show: its window and the classes (rows, cols) of the window's cells."""

    step: int
    window: Window
    classes: NDArray[np.uint8]

    @property
    def middle(self) -> tuple[float, float]:
        """Row and column of the window's middle."""
        return self.window.row0 + self.window.rows / 2, self.window.col0 + self.window.cols / 2


def patch_of(step: int, artifact: Artifact) -> Patch | None:
    """The reading's patch, if it is one of the sensor's."""
    if isinstance(artifact, TempGrid) and artifact.beam.layer == SENSOR:
        touched = artifact.band | artifact.free
        return Patch(step, artifact.window, strength_classes(artifact.probability - 0.5, touched))
    if isinstance(artifact, MergedGrid) and artifact.layer == SENSOR:
        difference = artifact.probability - artifact.previous
        return Patch(step, artifact.window, strength_classes(difference, difference != 0))
    return None


def all_over_the_map(artifacts: list[Artifact], kind: type[Artifact]) -> list[Patch]:
    """Patches far out on each side, and some in between; each has cells enough."""
    every = [
        patch for step, artifact in enumerate(artifacts)
        if isinstance(artifact, kind) and (patch := patch_of(step, artifact)) is not None
        and (patch.classes > 0).sum() >= FEWEST_CELLS
    ]  # fmt: skip
    outer = [
        end(every, key=lambda patch: patch.middle[axis]) for axis in (0, 1) for end in (min, max)
    ]
    chosen = {each.step: each for each in (*outer, *every[:: len(every) // (MOST - 4)])}
    return [chosen[step] for step in sorted(chosen)]


def tinted(picture: NDArray[np.int_], scale: Scale, patch: Patch, occupied: bool) -> float | None:
    """The share of those cells which are red or blue; None for few cells.

    Weak ones hardly differ from what lies below, so only clear ones count.
    """
    words = "more occupied" if occupied else "more free"
    clear = [code for code, name, _ in strength_names() if name.startswith(words)][3:]
    corner = np.array([patch.window.row0, patch.window.col0])
    cells = np.argwhere(np.isin(patch.classes, clear)) + corner
    if len(cells) < FEWEST_CELLS // 10:
        return None
    rows, cols = scale.pixels(scale.geometry.centres_of(cells)).T
    inside = (rows >= 0) & (rows < picture.shape[0]) & (cols >= 0) & (cols < picture.shape[1])
    rows, cols = rows[inside], cols[inside]  # the view shows the room, not all of the grid
    if len(rows) < FEWEST_CELLS // 10:
        return None
    strong, weak = (0, 2) if occupied else (2, 0)
    pixels = picture[rows, cols]
    return float((pixels[:, strong] > pixels[:, weak] + TINT).mean())


@pytest.mark.viewer
@pytest.mark.parametrize(
    ("kind", "view"), [(TempGrid, SENSOR), (MergedGrid, f"{SENSOR}: what changed")]
)
def test_every_patch_lies_over_the_cells(
    shown: HeadlessViewer,
    scale: Scale,
    artifacts: list[Artifact],
    kind: type[Artifact],
    view: str,
) -> None:
    patches = all_over_the_map(artifacts, kind)
    assert len(patches) >= MOST - 2
    rows, cols = np.array([patch.middle for patch in patches]).T
    assert np.ptp(rows) > 0.3 * scale.geometry.rows
    assert np.ptp(cols) > 0.3 * scale.geometry.cols
    shown.bring_to_front(CHANGES if kind is MergedGrid else SENSOR)
    over = (
        layout.WALLS, layout.ROBOT, layout.PATH, layout.points(SENSOR), layout.beam(SENSOR),
        f"{layout.AXES}/frame",
    )  # fmt: skip
    shown.switch(view, *over, on=False)
    looked_at = 0
    for patch in patches:
        shown.go_to(patch.step)
        picture = np.asarray(shown.screenshot(view)).astype(int)
        for occupied in (True, False):
            share = tinted(picture, scale, patch, occupied)
            if share is not None:
                assert share > 0.8, (patch.step, "more occupied" if occupied else "more free")
                looked_at += 1
    assert looked_at >= len(patches)
