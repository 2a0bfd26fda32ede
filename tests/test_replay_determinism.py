"""The same session and configuration give the same files, bit by bit, wherever they are made.

With one thread or two, with other hash seeds, twice in one process, in a pool of processes.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from mapping.config import load_config
from recorder.session import SessionWriter
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room
from replay.mapping_run import map_session

SETTINGS = (
    "grid.resolution_m=0.04", "rerun.stages_every=60", "segments.method=ransac",
    "sensors.ping.update=dempster-shafer",
)  # fmt: skip
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Digests = dict[str, str]


def exported(session: str, folder: str, settings: tuple[str, ...] = SETTINGS) -> Digests:
    """Map a session into a folder; the digest of each file there."""
    map_session(Path(session), load_config(settings=settings), rrd=None, export=Path(folder))
    return digests(Path(folder))


def digests(folder: Path) -> Digests:
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A few seconds of a simulated run."""
    file = tmp_path_factory.mktemp("session") / "s.mcap"
    with SessionWriter(file) as writer:
        for log_ns, message in simulate(load_room("l-room"), duration_s=5.0, seed=8):
            writer.write(message, log_ns=log_ns)
    return str(file)


@pytest.fixture(scope="module")
def here(session: str, tmp_path_factory: pytest.TempPathFactory) -> Digests:
    """As this process makes them."""
    return exported(session, str(tmp_path_factory.mktemp("here") / "out"))


def test_the_folder_holds_every_kind_of_file(here: Digests) -> None:
    kinds = {name.rpartition(".")[2] for name in here}
    assert {"npz", "pgm", "yaml", "json", "geojson", "csv", "dxf", "svg"} <= kinds
    assert len(here) >= 3 * 8 + 1


def test_twice_in_one_process(session: str, here: Digests, tmp_path: Path) -> None:
    exported(session, str(tmp_path / "other"), (SETTINGS[0], "sensors.*.model=peak"))
    assert exported(session, str(tmp_path / "out")) == here


def test_results_on_the_way_are_no_results(session: str, here: Digests, tmp_path: Path) -> None:
    at_the_end = (SETTINGS[0], *SETTINGS[2:])
    alone = exported(session, str(tmp_path / "out"), at_the_end)
    assert {name for name in here if here[name] != alone.get(name)} == {"summary.json"}
    texts = [
        map_session(Path(session), load_config(settings=each), rrd=None, export=None).segments
        for each in (SETTINGS, at_the_end)
    ]
    assert repr(texts[0]) == repr(texts[1])


@pytest.mark.parametrize(("threads", "hash_seed", "zone"), [(1, 0, "UTC"), (2, 1234, "Asia/Tokyo")])
def test_in_a_process_of_its_own(
    threads: int, hash_seed: int, zone: str, session: str, here: Digests, tmp_path: Path
) -> None:
    environment = {
        **os.environ, **dict.fromkeys(THREADS, str(threads)), "PYTHONHASHSEED": str(hash_seed),
        "TZ": zone, "PYTHONPATH": str(ROOT),
    }  # fmt: skip
    settings = [word for setting in SETTINGS for word in ("--set", setting)]
    run = subprocess.run(
        [sys.executable, "-m", "echogrid", "map", session, "-o", "-", "--quiet",
         "--export", str(tmp_path / "out"), *settings],
        env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert digests(tmp_path / "out") == here


def test_in_two_processes_at_once(session: str, here: Digests, tmp_path: Path) -> None:
    folders = [str(tmp_path / name) for name in ("a", "b")]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        assert list(pool.map(exported, [session] * 2, folders)) == [here, here]


def test_a_later_day_changes_nothing(
    session: str, here: Digests, tmp_path: Path, later: Callable[[], None]
) -> None:
    later()
    assert exported(session, str(tmp_path / "out")) == here


@pytest.fixture
def later(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Whoever asks for the time hears one that is years later."""
    import time

    now = time.time

    def set_clock() -> None:
        monkeypatch.setattr(time, "time", lambda: now() + 1e8)
        monkeypatch.setattr(time, "localtime", lambda *_: time.gmtime(now() + 1e8))

    return set_clock


def test_recordings_read_back_equal(session: str, tmp_path: Path) -> None:
    """An .rrd holds identities of its own; what is read out of it is the same."""
    from replay.rrd.reader import read_rrd

    config = load_config(settings=SETTINGS)
    read = []
    for name in ("a", "b"):
        map_session(Path(session), config, rrd=tmp_path / f"{name}.rrd", export=None)
        read.append(read_rrd(tmp_path / f"{name}.rrd"))
    first, second = read
    assert first.layers == second.layers
    for layer in first.layers:
        assert np.array_equal(first.grid(layer), second.grid(layer))
        assert repr(first.thresholded(layer)) == repr(second.thresholded(layer))
    for one, other in zip(first.grids("ping"), second.grids("ping"), strict=True):
        assert one[0] == other[0]
        assert np.array_equal(one[1], other[1])
    for kind in ("beams", "segments", "borders"):
        one, other = (list(getattr(each, kind)()) for each in read)
        assert repr(one) == repr(other)
        assert one
