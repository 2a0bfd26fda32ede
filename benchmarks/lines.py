"""Line extraction from simulated scans: quality, time and honesty of the covariances.

    python -m benchmarks.lines [--seed N] [--scans N] [--sigma-m S] [--methods a,b]
                                [--boxes small,middle,large]

Give a seed that was never looked at: the same one gives the same rooms. Angle errors cannot be
expected below "bound": what the noise allows with the beams that hit each wall, for any method that
is not biased. Small boxes (sides of 0.3 to 0.9 m; middle 0.6 to 1.4, large 1.0 to 2.0) have few
beams a side, and so a larger bound. Times are taken in turn with OpenCV's approxPolyDP, which only
splits, on the same clusters. Needs opencv-python-headless.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.made_up_scans import (
    BOXES_M,
    HEADER,
    MIN_BEAMS,
    MIN_LENGTH_M,
    MadeUpScan,
    Score,
    made_up_scan,
    score_lines,
    single_wall_scan,
)
from benchmarks.timing import best_times_s
from mapping.artifacts import Segment
from mapping.beams import Beam
from mapping.config import SegmentsSection
from mapping.segments import LINE_METHODS, segments_from_scan
from mapping.segments.chains import Chains, chains_from_scan
from mapping.segments.ordered import SETTLE_SPLIT, kernel_settings
from recorder.geometry import IDENTITY, wrap_angle

# What Siegwart, Nourbakhsh and Scaramuzza (2011, table 4.4) report of the six, on real scans of
# offices: false positives, and marks for precision. Their data are other ones, so that only the
# order can be compared.
LITERATURE = {
    "split-and-merge": ("10 %", "+++"),
    "incremental": ("6 %", "+++"),
    "line-regression": ("10 %", "+++"),
    "ransac": ("30 %", "++++"),
    "hough": ("30 %", "++++"),
    "em": ("50 %", "++++"),
}


ROUNDS = 60  # a round is short, and other work on the machine disturbs it


def scan_config(method: str, sigma_m: float) -> SegmentsSection:
    """Four standard deviations to the farthest point, and what the score asks for."""
    return SegmentsSection(
        method=method, epsilon_m=4.0 * sigma_m, min_points=MIN_BEAMS, min_length_m=MIN_LENGTH_M
    )


def beam_of(ranges_m: NDArray[np.float64], bearings_rad: NDArray[np.float64]) -> Beam:
    """A scan from the origin."""
    return Beam(
        0, 0, "lidar", "lidar", IDENTITY, IDENTITY, bearings_rad, ranges_m, math.radians(1), 30.0
    )


def quality(scans: list[MadeUpScan], method: str, sigma_m: float) -> tuple[Score, float]:
    """The score of one method, and its time a scan in microseconds, objects and all."""
    score = Score()
    config = scan_config(method, sigma_m)
    spent = 0.0
    for scan in scans:
        beam = beam_of(scan.ranges_m, scan.bearings_rad)
        start = time.perf_counter()
        segments = segments_from_scan(beam, config, sigma_m=sigma_m)
        spent += time.perf_counter() - start
        score_lines(score, scan, _ends(segments))
    return score, 1e6 * spent / len(scans)


def calibration(
    rng: np.random.Generator, count: int, sigma_m: float, *, given: bool
) -> tuple[float, float, int]:
    """Mean squares of the normalised errors of rho and alpha on single walls, and how many.

    ``given``: the noise is given; else it is estimated from the residuals of each line.
    """
    config = scan_config("split-and-merge", sigma_m)
    errors = []
    for _ in range(count):
        ranges, bearings, rho, alpha = single_wall_scan(rng, sigma_m=sigma_m)
        found = segments_from_scan(
            beam_of(ranges, bearings), config, sigma_m=sigma_m if given else None
        )
        if len(found) != 1:
            continue
        one = found[0]
        off = wrap_angle(one.alpha_rad - alpha)
        errors.append(
            (
                (one.rho_m - rho) / math.sqrt(one.covariance[0, 0]),
                off / math.sqrt(one.covariance[1, 1]),
            )
        )
    squares = np.mean(np.square(errors), axis=0)
    return float(squares[0]), float(squares[1]), len(errors)


def _ends(segments: list[Segment]) -> NDArray[np.float64]:
    return np.array([(s.start_m, s.end_m) for s in segments], np.float64).reshape(-1, 2, 2)


def print_times(scans: list[MadeUpScan], sigma_m: float) -> None:
    """The kernel and the clustering beside approxPolyDP, in one run."""
    import cv2

    chains = [chains_from_scan(s.ranges_m, s.bearings_rad, sigma_m=sigma_m) for s in scans]
    together = _together(chains)
    clusters = [
        chain.points_m[a:b].astype(np.float32)
        for chain in chains
        for a, b in zip(chain.offsets[:-1], chain.offsets[1:], strict=True)
    ]
    times = best_times_s(
        {
            "cv2.approxPolyDP (split only)": lambda: [
                cv2.approxPolyDP(cluster, 4.0 * sigma_m, False) for cluster in clusters
            ],
            "kernel, one call for all scans": _kernel_call([together], sigma_m),
            "kernel, one call a scan": _kernel_call(chains, sigma_m),
            "clustering, one call a scan": lambda: [
                chains_from_scan(s.ranges_m, s.bearings_rad, sigma_m=sigma_m) for s in scans
            ],
        },
        rounds=ROUNDS,
    )
    theirs = next(iter(times.values()))
    print(f"\n{len(clusters) / len(scans):.3f} clusters a scan; best of {ROUNDS}")
    print(f"{'':<34}{'us/scan':>9}{'ratio':>8}")
    for name, seconds in times.items():
        print(f"{name:<34}{1e6 * seconds / len(scans):>9.2f}{seconds / theirs:>8.2f}")


def _together(chains: list[Chains]) -> Chains:
    lengths = np.concatenate([np.diff(c.offsets) for c in chains])
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    points = np.concatenate([c.points_m for c in chains])
    return Chains(points, offsets, np.concatenate([c.closed for c in chains]))


def _kernel_call(chains: list[Chains], sigma_m: float):  # type: ignore[no-untyped-def]
    """Split, merge, settle, fit and corners, with buffers made beforehand, as OpenCV has them."""
    from mapping.line_kernels import layout
    from mapping.line_kernels.lines import lines_of_chains

    most = max(len(c.points_m) for c in chains)
    log, found = np.empty((2, most, 4)), np.empty((most // MIN_BEAMS + 1, len(layout.LINE)))
    none = np.empty(0, np.int64)
    settings = kernel_settings(scan_config("split-and-merge", sigma_m), SETTLE_SPLIT)

    def run() -> None:
        for c in chains:
            lines_of_chains(
                c.points_m, c.offsets, c.closed, layout.SPLIT, none, settings, log, found
            )

    return run


def print_quality(
    boxes: str, seed: int, count: int, sigma_m: float, methods: list[str]
) -> list[MadeUpScan]:
    """The table of the methods for rooms with boxes of one size; returns the scans."""
    rng = np.random.default_rng(seed)
    size = BOXES_M[boxes]
    scans = [made_up_scan(rng, sigma_m=sigma_m, box_m=size) for _ in range(count)]
    walls = sum(int(scan.countable.sum()) for scan in scans)
    print(f"\nseed {seed}, {boxes} boxes ({size[0]:g} to {size[1]:g} m): {count} scans of 360")
    print(f"beams, {walls} visible walls, {100 * sigma_m:g} cm noise")
    print(f"{HEADER}{'us/scan':>10}{'false, lit.':>13}{'precision, lit.':>17}")
    for name in methods:
        score, spent_us = quality(scans, name, sigma_m)
        false, precise = LITERATURE[name]
        print(f"{score.row(name)}{spent_us:10.0f}{false:>13}{precise:>17}")
    return scans


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scans", type=int, default=1000)
    parser.add_argument("--sigma-m", type=float, default=0.01)
    parser.add_argument("--methods", default=",".join(LINE_METHODS))
    parser.add_argument("--boxes", default=",".join(BOXES_M))
    options = parser.parse_args()
    sigma_m = options.sigma_m
    methods = options.methods.split(",")
    for number, boxes in enumerate(options.boxes.split(",")):
        scans = print_quality(boxes, options.seed + number, options.scans, sigma_m, methods)
    print_times(scans, sigma_m)
    rng = np.random.default_rng(options.seed)
    print("\ncovariances on single walls: mean square of the normalised errors (1 is right)")
    for given in (True, False):
        rho, alpha, count = calibration(rng, 2 * options.scans, sigma_m, given=given)
        how = "noise given" if given else "noise from the residuals"
        print(f"{how:<26} rho {rho:.3f}   alpha {alpha:.3f}   ({count} walls)")


if __name__ == "__main__":
    main()
