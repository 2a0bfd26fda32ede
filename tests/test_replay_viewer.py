"""The recording in the real viewer: what one sees is what the map holds, and nothing leaks out."""

from __future__ import annotations

import http.client
import os
import signal
import subprocess
import sys
import time
import urllib.parse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from made_run import MadeRun
from PIL import Image
from viewer_support import Browser, Patiently, headless

from mapping.artifacts import Artifact, MergedGrid, Started, TempGrid
from mapping.beams import Beam
from mapping.grid import GridGeometry
from recorder.errors import BadInput
from replay import viewer
from replay.rrd import layout
from replay.rrd.batches import quiet_reader
from replay.rrd.catalogue import Catalogue, runs_in
from replay.rrd.headless import HeadlessViewer
from replay.rrd.program import LOCAL, free_ports, is_listening, viewer_environment
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.web import WebViewer
from replay.rrd.writer import RrdWriter

REPOSITORY = Path(__file__).parents[1]
# Narrow beams all round: the walls come out dark. Their lines are not drawn, so as not to help.
RUN = MadeRun(sensors=(("dirrs", 6.0),), readings=180, turn_rad=0.25, knows_walls=False)


@pytest.fixture(scope="module")
def artifacts() -> list[Artifact]:
    return list(RUN.artifacts())


@pytest.fixture(scope="module")
def path(artifacts: list[Artifact], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("viewer") / "made.rrd"
    with RrdWriter(path, RunDrawer(), name="made") as writer:
        for artifact in artifacts:
            writer(artifact)
    return path


@pytest.fixture(scope="module")
def shown(path: Path) -> Iterator[HeadlessViewer]:
    with headless(path) as viewer:
        yield viewer


def near(image: Image.Image, colour: tuple[int, ...], within: int = 12) -> np.ndarray:
    """Which pixels have about that colour."""
    pixels = np.asarray(image).astype(int)
    return np.abs(pixels - np.array(colour[:3])).max(axis=-1) <= within


def reddish(image: Image.Image) -> np.ndarray:
    """Which pixels show red over grey; the orange of beams and points is not that."""
    red, green, blue = np.moveaxis(np.asarray(image).astype(int), -1, 0)
    return (red > np.maximum(green, blue) + 15) & (green <= blue + 5)


class Scale:
    """From pixels of a view to metres, by where the empty map of the first step lies."""

    def __init__(self, empty: Image.Image) -> None:
        rows, cols = np.nonzero(near(empty, layout.NEVER_SEEN))
        geometry = RUN.geometry
        self.cell_px = (cols.max() + 1 - cols.min()) / geometry.cols
        self.left, self.bottom = cols.min(), rows.max() + 1
        self.tall = (rows.max() + 1 - rows.min()) / self.cell_px / geometry.rows

    def metres(self, mask: np.ndarray) -> np.ndarray:
        """Centres of the pixels of a mask, (N, 2), metres: x right, y up."""
        rows, cols = np.nonzero(mask)
        metre = self.cell_px / RUN.geometry.resolution_m
        offset = np.column_stack([cols + 0.5 - self.left, self.bottom - rows - 0.5])
        return offset / metre + RUN.geometry.origin_m


@pytest.mark.viewer
def test_it_opens_paused_at_the_first_step(path: Path) -> None:
    with headless(path) as viewer:
        assert viewer.now == ("step", 0)
        assert {"dirrs", "fused", "What this step does"} <= set(viewer.views)
        time.sleep(1.0)
        assert viewer.now == ("step", 0)


@pytest.mark.viewer
def test_no_view_complains_at_any_kind_of_step(
    shown: HeadlessViewer, artifacts: list[Artifact]
) -> None:
    first_of_each: dict[type, int] = {}
    for step, artifact in enumerate(artifacts):
        first_of_each.setdefault(type(artifact), step)
    assert len(first_of_each) == 11
    for step in sorted({*range(8), *first_of_each.values(), len(artifacts) - 1}):
        shown.go_to(step)
        shown.screenshot()
        assert shown.complaints == [], step


@pytest.mark.viewer
def test_cells_are_square_and_the_whole_grid_is_seen(shown: HeadlessViewer) -> None:
    shown.go_to(0)
    picture = shown.screenshot("dirrs")
    scale = Scale(picture)
    assert scale.tall == pytest.approx(1.0, abs=0.02)
    rows, cols = np.nonzero(near(picture, layout.NEVER_SEEN))
    assert 0 < rows.min() < rows.max() < picture.height - 1
    assert 0 < cols.min() < cols.max() < picture.width - 1


@pytest.mark.viewer
def test_the_dark_cells_are_the_walls(shown: HeadlessViewer, artifacts: list[Artifact]) -> None:
    shown.go_to(0)
    scale = Scale(shown.screenshot("dirrs"))
    merged = [i for i, a in enumerate(artifacts) if isinstance(a, MergedGrid)]
    shown.go_to(merged[-1])
    picture = shown.screenshot("dirrs")
    pixels = np.asarray(picture).astype(int)
    grey = np.ptp(pixels, axis=-1) <= 6
    inside = scale.metres(np.ones(grey.shape, bool))
    low, high = np.array(RUN.geometry.origin_m), np.array(RUN.geometry.origin_m)
    high = high + RUN.geometry.size_m
    on_map = ((inside > low) & (inside < high)).all(axis=-1).reshape(grey.shape)
    dark = scale.metres(grey & on_map & (pixels.max(axis=-1) < 85))
    assert len(dark) > 500
    (left, bottom), (right, top) = RUN.walls_m[0, 0], RUN.walls_m[1, 1]
    to_each = np.abs(
        np.column_stack(
            [dark[:, 0] - left, dark[:, 0] - right, dark[:, 1] - bottom, dark[:, 1] - top]
        )
    )
    band = 0.12  # metres: what a 5 % band at these ranges can be off
    assert (to_each.min(axis=1) < band).mean() > 0.97
    assert ((to_each < band).sum(axis=0) > 50).all(), "each of the four walls is seen"
    light = scale.metres(grey & on_map & (pixels.min(axis=-1) > 200))
    clear = (light > [left + 0.1, bottom + 0.1]) & (light < [right - 0.1, top - 0.1])
    assert len(light) > 500
    assert clear.all(axis=-1).mean() > 0.9


@pytest.mark.viewer
@pytest.mark.parametrize("number", [3, 7, 12])
def test_a_reading_is_drawn_where_it_speaks(
    shown: HeadlessViewer, artifacts: list[Artifact], number: int
) -> None:
    """Red where the obstacle may be, at the right place and not upside down."""
    shown.go_to(0)
    scale = Scale(shown.screenshot("dirrs"))
    step = next(
        i for i, a in enumerate(artifacts) if isinstance(a, TempGrid) and a.beam.number == number
    )
    shown.go_to(step)
    patch = reddish(shown.screenshot("dirrs"))
    found = scale.metres(patch)
    temp = artifacts[step]
    assert isinstance(temp, TempGrid)
    window = temp.window
    rows_cols = np.argwhere(temp.band) + np.array([window.row0, window.col0])
    expected = temp.geometry.centres_of(rows_cols)
    gaps = np.linalg.norm(expected[:, None] - found[None], axis=-1).min(axis=1)
    assert (gaps < temp.geometry.resolution_m / 2).mean() > 0.7, "its cells are red"
    shown.go_to(step + 1)
    still = reddish(shown.screenshot("dirrs"))
    assert still.sum() < 0.5 * patch.sum(), "the patch goes once it is merged"


@pytest.mark.viewer
def test_stepping_back_shows_what_was_there(shown: HeadlessViewer) -> None:
    pictures = {}
    for step in (6, 7, 8, 9, 300, 8, 6, 9, 7):
        shown.go_to(step)
        picture = np.asarray(shown.screenshot("dirrs")).astype(int)
        if step in pictures:
            assert (np.abs(picture - pictures[step]).max(axis=-1) > 8).mean() < 0.001, step
        pictures[step] = picture
    assert (np.abs(pictures[9] - pictures[300]).max(axis=-1) > 8).mean() > 0.02


@pytest.mark.viewer
def test_the_reading_timeline_shows_a_whole_reading(
    shown: HeadlessViewer, artifacts: list[Artifact]
) -> None:
    merged = [i for i, a in enumerate(artifacts) if isinstance(a, MergedGrid)]
    shown.go_to(merged[20])
    by_step = np.asarray(shown.screenshot("dirrs")).astype(int)
    shown.go_to(20, timeline="reading")
    by_reading = np.asarray(shown.screenshot("dirrs")).astype(int)
    shown.go_to(0)
    assert (np.abs(by_step - by_reading).max(axis=-1) > 8).mean() < 0.001


@pytest.mark.viewer
def test_a_step_becomes_a_picture(path: Path, shown: HeadlessViewer, tmp_path: Path) -> None:
    out = tmp_path / "step.png"
    assert viewer.screenshot(path, 5, out, view="dirrs") == []
    with Image.open(out) as picture:
        assert min(picture.size) > 200
        assert near(picture.convert("RGB"), layout.NEVER_SEEN).mean() > 0.1
    with pytest.raises(BadInput, match="no view 'sonar'; there are"):
        shown.screenshot("sonar")


@pytest.mark.viewer
def test_it_listens_here_only_and_reports_nothing(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        (tmp_path / variable).mkdir()
        monkeypatch.setenv(variable, str(tmp_path / variable))
    monkeypatch.delenv("CI", raising=False)
    with HeadlessViewer(path) as viewer:
        viewer.screenshot()
        connections = psutil.Process(viewer.process_id).net_connections()
        assert {each.laddr.ip for each in connections if each.laddr} <= {"127.0.0.1"}
        assert all(each.raddr.ip == "127.0.0.1" for each in connections if each.raddr)
    assert not list(tmp_path.rglob("*analytics*"))


def test_a_window_needs_a_display(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(BadInput, match="--web") as caught:
        viewer.open_viewer(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(BadInput, match="no such file"):
        viewer.open_viewer(path.with_name("none.rrd"))


def test_a_window_is_started_quiet_and_local(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[tuple[list[str], dict[str, Any]]] = []
    monkeypatch.setattr(
        viewer.subprocess, "Popen", lambda command, **options: started.append((command, options))
    )
    monkeypatch.setenv("DISPLAY", ":0")
    viewer.open_viewer(path)
    ((command, options),) = started
    assert Path(command[0]).is_file()
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert int(command[command.index("--port") + 1]) > 1023
    assert command[-1] == str(path.resolve())
    assert options["env"]["CI"] == "true"
    assert options["start_new_session"]


def test_the_environment_is_ours_but_for_the_statistics() -> None:
    added = dict(set(viewer_environment().items()) - set(os.environ.items()))
    assert set(added) <= {"CI", "RERUN_APP_ONLY"}


def test_free_ports_are_free() -> None:
    ports = free_ports(3)
    assert len(set(ports)) == 3
    assert not any(is_listening(port) for port in ports)


def fetch(url: str) -> http.client.HTTPResponse:
    parts = urllib.parse.urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=10.0)
    connection.request("GET", parts.path or "/")
    return connection.getresponse()


def test_the_page_is_served_here_and_may_not_talk_elsewhere(path: Path) -> None:
    with WebViewer(path) as web:
        assert web.url.startswith("http://127.0.0.1:")
        answer = fetch(web.url)
        page = answer.read().decode()
        policy = answer.getheader("Content-Security-Policy", "")
        source = urllib.parse.parse_qs(urllib.parse.urlsplit(web.url).query)["url"][0]
        data_port = urllib.parse.urlsplit(source.removeprefix("rerun+")).port
        assert answer.status == 200
        assert "<canvas" in page
        allowed = set(policy.replace(";", " ").split()) - {"blob:", "data:"}
        assert not any("//" in each and "127.0.0.1" not in each for each in allowed)
        assert "connect-src 'self'" in policy
        assert is_listening(data_port or 0)
        assert fetch(web.url.split("?")[0] + "no/such/thing").status == 404
    assert not is_listening(data_port or 0)
    assert not is_listening(urllib.parse.urlsplit(web.url).port or 0)


def test_asked_by_another_name_the_page_is_not_given(path: Path) -> None:
    """Of a page elsewhere whose name leads here, a browser would take it for its own."""
    with WebViewer(path) as web:
        parts = urllib.parse.urlsplit(web.url)
        for host, status in (("elsewhere.invalid", 421), ("", 421), ("localhost", 200)):
            connection = http.client.HTTPConnection(LOCAL, parts.port, timeout=10.0)
            connection.request("GET", "/", headers={"Host": host})
            assert connection.getresponse().status == status
            connection.close()


@pytest.fixture(scope="module")
def folder(path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs, the second of another size; a copy, one that was cut off, and something else."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "first.rrd").write_bytes(path.read_bytes())
    (folder / "first again.rrd").write_bytes(path.read_bytes())
    (folder / "cut.rrd").write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (folder / "session.mcap").write_bytes(b"")
    geometry = GridGeometry((1.0, -1.0), 0.02, 70, 80)
    with RrdWriter(folder / "second.rrd", RunDrawer("[grid]"), name="second") as writer:
        for artifact in MadeRun(geometry, readings=6).artifacts():
            writer(artifact)
    return folder


def test_of_a_folder_only_whole_recordings_are_shown_and_each_once(
    folder: Path, tmp_path: Path
) -> None:
    runs = runs_in(folder)
    assert [file.name for file in runs.files] == ["first again.rrd", "second.rrd"]
    assert any("cut.rrd" in reason for reason in runs.left_out)
    assert "first.rrd is a copy of first again.rrd" in runs.left_out
    with pytest.raises(BadInput, match="no recording"):
        viewer.open_viewer(tmp_path, web=True)


def test_a_folder_is_served_here_only(folder: Path) -> None:
    files = runs_in(folder).files
    before = psutil.Process().net_connections()
    with Catalogue(files) as catalogue:
        catalogue.lay_out_table(files)
        port = urllib.parse.urlsplit(catalogue.url.removeprefix("rerun+")).port
        mine = [each for each in psutil.Process().net_connections() if each not in before]
        listening = {each.laddr for each in mine if each.status == psutil.CONN_LISTEN}
        assert listening == {(LOCAL, port)}
    assert not is_listening(port or 0)


def test_a_recording_states_what_its_run_was(folder: Path) -> None:
    found: dict[str, Any] = {}
    for chunk in quiet_reader(folder / "second.rrd").stream().filter(content="/__properties/run"):
        found |= chunk.to_record_batch().to_pydict()
    assert found["configuration"] == [["[grid]"]]
    assert found["cells"] == [["80 x 70"]]
    assert found["readings"] == [[6]]
    assert found["dropped"] == [[2]]
    assert found["sensors"] == [["ping, dirrs"]]


@pytest.mark.viewer
def test_a_folder_is_a_table_with_a_picture_of_each_run(folder: Path) -> None:
    files = runs_in(folder).files
    with Catalogue(files) as catalogue:
        catalogue.lay_out_table(files)
        with headless(catalogue.url) as shown:
            picture = shown.screenshot()
            end = time.monotonic() + 60.0
            while islands(near(picture, layout.NEVER_SEEN)) < 2 and time.monotonic() < end:
                time.sleep(1.0)
                picture = shown.screenshot()
            assert islands(near(picture, layout.NEVER_SEEN)) == 2
            assert shown.complaints == []


def islands(mask: np.ndarray) -> int:
    """Groups of columns with many such pixels, with a gap between each and the next."""
    columns = np.flatnonzero(mask.sum(axis=0) > 20)
    return 1 + int((np.diff(columns) > 60).sum()) if len(columns) else 0


@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_a_signal_ends_all_servers(path: Path, how: signal.Signals, status: int) -> None:
    program = (
        # A shell's background jobs, and what they start, get no Ctrl-C unless they ask for it.
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from replay.viewer import open_viewer; "
        "open_viewer(sys.argv[1], web=True, browser=False,"
        " announce=lambda url: print(url, flush=True)); print('ended', flush=True)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(path)],
        cwd=REPOSITORY, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    children = psutil.Process(process.pid).children(recursive=True)
    assert children
    process.send_signal(how)
    assert process.stdout.readline().strip() == ("ended" if status == 0 else "")
    assert process.wait(10.0) == status
    assert not psutil.wait_procs(children, timeout=5.0)[1]
    assert not is_listening(urllib.parse.urlsplit(url).port or 0)


@pytest.mark.viewer
def test_the_browser_shows_the_empty_map_first(path: Path) -> None:
    with WebViewer(path) as web:
        browser = Browser(f"{web.url}&renderer=webgl", size=(900, 700))
        try:
            Patiently(browser).until(
                lambda picture: near(picture, layout.NEVER_SEEN).mean() >= 0.1, "the empty map"
            )
        finally:
            browser.close()


@pytest.mark.viewer
def test_a_page_without_our_policy_would_be_caught_talking_elsewhere(tmp_path: Path) -> None:
    """The check that nothing leaves the machine can fail: here something would."""
    page = tmp_path / "page.html"
    page.write_text('<link rel="stylesheet" href="https://elsewhere.invalid/style.css">')
    browser = Browser(page.as_uri())
    try:
        end = time.monotonic() + 120.0
        while "elsewhere.invalid" not in browser.hosts_elsewhere():
            assert time.monotonic() < end
            time.sleep(0.2)
    finally:
        browser.close()


def test_a_made_run_has_all_kinds_of_artifacts(artifacts: list[Artifact]) -> None:
    """The tests above step through each kind; this holds that none is missing."""
    assert isinstance(artifacts[0], Started)
    assert sum(isinstance(a, Beam) for a in artifacts) == RUN.readings
