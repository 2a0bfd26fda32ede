"""Who maps a session: the kernels, what bounds them, MRPT, and twins in NumPy and plain Python."""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.peers.sessions import Session
from mapping.kernels.batch import fading, lidar, rays, regions, steps
from mapping.kernels.batch.readings import Place, Readings, Scans, ends_of, place_of, scan_axes
from mapping.kernels.batch.region_tables import regions_sensor, tables_of
from mapping.kernels.batch.spans import beam_between, box_of, span_scratch, spans_of_rows, widths_of
from mapping.kernels.batch.threads import band_edges, in_bands, in_parts
from mapping.sensor_model import regions_table

Race = Callable[[], float]
SONAR = {"hit": 0.8, "miss": 0.08, "near": 30.0, "before": 0.01, "behind": 0.1, "fade_m": 0.75}
SHARP = {"hit": 2.2, "miss": 0.85, "near": 0.0, "before": 0.075, "behind": 0.075, "fade_m": 1e9}
LASER = {**SHARP, "before": 0.015, "behind": 0.015}
TWIN_READINGS = 40  # as many as the slow twins take
TIMES = 10  # as often threads get the readings: one thread takes 10 ms and more then
OCTOMAP, OCTOMAP_SCANS = "OctoMap (3D), from Python", 20
MARGIN_M = 4.0  # MRPT 2.5.8 fails where a cone leaves its map


def built_mrpt(folder: Path) -> Path | None:
    """MRPT's harness, compiled; None where MRPT or a compiler is not installed."""
    includes = [f"-isystem{path}" for path in sorted(Path("/usr/include/mrpt").glob("*/include"))]
    libraries = ("maps", "obs", "poses", "math", "core", "rtti", "serialization", "system")
    program = folder / "mrpt_peer"
    command = ["g++", "-O3", "-march=native", "-std=c++17", *includes,
               "-isystem/usr/include/eigen3", str(Path(__file__).with_name("mrpt_peer.cpp")),
               "-o", str(program),
               *(f"-lmrpt-{name}" for name in libraries)]  # fmt: skip
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return program


def mrpt(program: Path, session: Session, kind: int, folder: Path) -> Race:
    """MRPT on a session: kind 0 ranger, 1 scans as thin rays, 2 scans with widening beams."""
    file = folder / f"{session.name.replace(' ', '')}-{kind}.bin"
    (x0, y0), (x1, y1) = session.low_m, session.high_m
    head = [kind, session.resolution_m, x0 - MARGIN_M, x1 + MARGIN_M, y0 - MARGIN_M, y1 + MARGIN_M,
            session.beam_width_rad, session.reach_m, *session.ranges_m.shape]  # fmt: skip
    np.concatenate([head, np.hstack([session.poses, session.ranges_m]).ravel()]).tofile(file)
    process = subprocess.Popen(
        [program, file], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    asked, answers = process.stdin, process.stdout
    assert asked is not None
    assert answers is not None

    def run() -> float:
        asked.write("\n")
        asked.flush()
        return float(answers.readline())

    return run


def cpu(work: Callable[[], object]) -> Race:
    """CPU seconds of this thread."""

    def run() -> float:
        start = time.thread_time()
        work()
        return time.thread_time() - start

    return run


def wall(work: Callable[[], object]) -> Race:
    """Seconds by the clock on the wall."""

    def run() -> float:
        start = time.perf_counter()
        work()
        return time.perf_counter() - start

    return run


@njit(error_model="numpy")
def add_constant(
    cells: NDArray[np.int32], cols: int, place: Place, readings: Readings, half: float
) -> None:
    """What bounds a kernel: the same spans, and a constant added."""
    (spans, doubt), widths = span_scratch(cells.shape[0]), widths_of(np.array([half]))
    xs, ys, headings, _, fronts, bands, _ = readings
    for i in range(xs.size):
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, 0)
        box = box_of(beam, place, cells.shape[0], cols)
        for k in range(spans_of_rows(beam, place, box, np.int64(1), spans, doubt)):
            first = np.uint64(spans[0, k])
            for c in range(spans[3, k] - spans[0, k]):
                cells[box[0] + k, first + np.uint64(c)] += np.int32(3)


def _map_of(session: Session) -> tuple[NDArray[np.int32], NDArray[np.bool_], Place]:
    cols, rows = (
        math.ceil((high - low) / session.resolution_m - 1e-9)
        for low, high in zip(session.low_m, session.high_m, strict=True)
    )
    place = place_of(session.low_m, session.resolution_m)
    return steps.blank(rows, cols), np.zeros((rows, cols), np.bool_), place


def _readings(session: Session, before: float, behind: float) -> Readings:
    x, y, heading = (np.ascontiguousarray(column) for column in session.poses.T)
    ends = ends_of(session.ranges_m[:, 0], session.reach_m, before, behind, True)
    return Readings(x, y, heading, *ends, np.zeros(len(x), np.int32))


def racers_of(
    session: Session, harness: Path | None, folder: Path
) -> tuple[dict[str, Race], dict[str, int]]:
    """Everybody who can map a session, and how many readings the slow ones take."""
    if session.ranges_m.shape[1] > 1:
        racers = _lidar_racers(session, harness, folder)
        return racers, {name: OCTOMAP_SCANS for name in racers if name == OCTOMAP}
    model = SONAR if session.beam_width_rad > 0.3 else SHARP
    cells, observed, place = _map_of(session)
    rows = len(observed)
    readings = _readings(session, model["before"], model["behind"])
    half = session.beam_width_rad / 2.0
    table = np.array([[half, model["hit"], model["miss"], model["near"], model["fade_m"]]])
    job = (cells, observed, place, readings, table)
    racers = {
        "fading": cpu(lambda: fading.add_fading(*job, 0, rows)),
        "limit": cpu(lambda: add_constant(cells, observed.shape[1], place, readings, half)),
    }
    error = 0.1 if session.beam_width_rad > 0.3 else 0.05
    banded = _readings(session, error, error)
    for count in (6, 12, 60):
        factors = regions_table(count)
        tables = tables_of([regions_sensor(session.beam_width_rad, "combined", factors, factors)])
        racers[f"regions {count}"] = cpu(
            lambda tables=tables: regions.add_regions(
                cells, observed, place, banded, *tables, 0, rows
            )
        )
    if harness is not None:
        racers["MRPT cone"] = mrpt(harness, session, 0, folder)
    threaded = _threaded((cells, observed, place), readings, table)
    racers |= threaded
    beliefs = np.zeros(observed.shape)
    racers["NumPy twin"] = cpu(lambda: numpy_twin(beliefs, session, model))
    racers["plain Python twin"] = cpu(lambda: python_twin(beliefs.tolist(), session, model))
    many = dict.fromkeys(threaded, TIMES * len(readings.x_m))
    return racers, {"NumPy twin": TWIN_READINGS, "plain Python twin": 1, **many}


def _threaded(
    target: tuple[NDArray[np.int32], NDArray[np.bool_], Place], readings: Readings,
    table: NDArray[np.float64],
) -> dict[str, Race]:  # fmt: skip
    """`fading` on one thread and on two; the readings some times over, so that there is work."""
    rows, halves = len(target[1]), np.ascontiguousarray(table[:, 0])
    order = np.random.default_rng(0).permutation(np.arange(TIMES * readings.x_m.size))
    many = Readings(*(column[order % column.size] for column in readings))
    job, cut = (*target, many, table), band_edges(many, halves, target[2], rows, 2)[1]
    racers = {
        "lower rows of 2 threads": cpu(lambda: fading.add_fading(*job, 0, cut)),
        "upper rows of 2 threads": cpu(lambda: fading.add_fading(*job, cut, rows)),
    }
    for threads, name in ((1, "1 thread, wall"), (2, "2 threads, wall")):
        racers[name] = wall(lambda threads=threads: in_bands(
            fading.add_fading, *job, edges=band_edges(many, halves, target[2], rows, threads)
        ))  # fmt: skip
    return racers


def _lidar_racers(session: Session, harness: Path | None, folder: Path) -> dict[str, Race]:
    cells, observed, place = _map_of(session)
    x, y, heading = (np.ascontiguousarray(column) for column in session.poses.T)
    ends = ends_of(session.ranges_m, session.reach_m, LASER["before"], LASER["behind"], False)
    half = session.beam_width_rad / 2.0
    row = np.array([half, LASER["hit"], LASER["miss"], LASER["near"], LASER["fade_m"]])
    job = (cells, observed, place, Scans(x, y, heading, *ends),
           scan_axes(session.bearings_rad, half), row)  # fmt: skip
    racers: dict[str, Race] = {
        "nearest axis": cpu(lambda: lidar.add_scans(*job, 0, 1)),
        "thin rays": cpu(lambda: rays.add_rays(*job, 0, 1)),
    }
    if harness is not None:
        racers["MRPT thin rays"] = mrpt(harness, session, 1, folder)
        racers["MRPT widening beams"] = mrpt(harness, session, 2, folder)
    if find_spec("pyoctomap") is not None:
        racers[OCTOMAP] = octomap(session)
    racers["every 2nd row"] = cpu(lambda: lidar.add_scans(*job, 0, 2))
    racers["1 thread, wall"] = wall(lambda: in_parts(lidar.add_scans, *job))
    racers["2 threads, wall"] = wall(lambda: in_parts(lidar.add_scans, *job, threads=2))
    return racers


def octomap(session: Session) -> Race:
    """OctoMap's tree with cells of the same size: the first scans as clouds, every ray cast."""
    pyoctomap = import_module("pyoctomap")
    poses, scans = session.poses[:OCTOMAP_SCANS], session.ranges_m[:OCTOMAP_SCANS]

    def run() -> float:
        tree = pyoctomap.OcTree(session.resolution_m)
        start = time.thread_time()
        for (x, y, heading), ranges in zip(poses, scans, strict=True):
            seen = np.isfinite(ranges)
            angle, d = heading + session.bearings_rad[seen], ranges[seen]
            points = np.column_stack([x + d * np.cos(angle), y + d * np.sin(angle), 0.0 * d])
            tree.insertPointCloud(points, np.array([x, y, 0.0]))
        return time.thread_time() - start

    return run


def numpy_twin(beliefs: NDArray[np.float64], session: Session, model: dict[str, float]) -> None:
    """`fading` over the box of each beam with whole arrays, as one would write it at first."""
    rows, cols = beliefs.shape
    size = session.resolution_m
    column = session.low_m[0] + (np.arange(cols) + 0.5) * size
    row = session.low_m[1] + (np.arange(rows) + 0.5) * size
    for (x, y, heading), (d,) in zip(
        session.poses[:TWIN_READINGS], session.ranges_m[:TWIN_READINGS], strict=True
    ):
        reach = d * (1.0 + model["behind"])
        c = slice(*np.searchsorted(column, [x - reach, x + reach]))
        r = slice(*np.searchsorted(row, [y - reach, y + reach]))
        dx, dy = column[None, c] - x, row[r, None] - y
        rho = np.hypot(dx, dy)
        off = np.abs((np.arctan2(dy, dx) - heading + np.pi) % (2 * np.pi) - np.pi)
        inside = (off <= session.beam_width_rad / 2) & (rho <= reach)
        front = inside & (rho < d * (1.0 - model["before"]))
        near = 1.0 + model["near"] * np.exp(-((rho / 0.35) ** 2))
        miss = -model["miss"] * near / (1.0 + (rho / model["fade_m"]) ** 2)
        hit = model["hit"] / (1.0 + (d / model["fade_m"]) ** 2)
        said = np.where(front, miss, np.where(inside, hit, 0.0))
        beliefs[r, c] = np.clip(beliefs[r, c] + said, -13.8, 13.8)


def python_twin(beliefs: list[list[float]], session: Session, model: dict[str, float]) -> None:
    """The same for the first reading, cell by cell, without any library."""
    (x, y, heading), d, size = (
        session.poses[0].tolist(),
        float(session.ranges_m[0, 0]),
        session.resolution_m,
    )
    reach = d * (1.0 + model["behind"])
    for r, line in enumerate(beliefs):
        dy = session.low_m[1] + (r + 0.5) * size - y
        for c in range(len(line)):
            dx = session.low_m[0] + (c + 0.5) * size - x
            rho = math.hypot(dx, dy)
            off = abs((math.atan2(dy, dx) - heading + math.pi) % (2 * math.pi) - math.pi)
            if rho > reach or off > session.beam_width_rad / 2:
                continue
            if rho < d * (1.0 - model["before"]):
                near = 1.0 + model["near"] * math.exp(-((rho / 0.35) ** 2))
                said = -model["miss"] * near / (1.0 + (rho / model["fade_m"]) ** 2)
            else:
                said = model["hit"] / (1.0 + (d / model["fade_m"]) ** 2)
            line[c] = min(max(line[c] + said, -13.8), 13.8)
