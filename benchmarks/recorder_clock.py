"""How far measurement times are off: ``python benchmarks/recorder_clock.py``.

A device clock that drifts and ticks in milliseconds stamps readings; they arrive through a USB
adapter that hands out bytes each 16 ms, now and then much later, or through a Bluetooth line. The
true times are known, so the error of each estimate is. What all lines of a link need at the least
(here 4 ms) cannot be seen by any clock and is shown as the bias; the spread is without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from recorder.clock import NS_PER_MS, NS_PER_S, DeviceClock

SECONDS, RATE_HZ = 600, 20
SETTLED_S = 15  # the drift is known then
LEAST_DELAY_S = 0.004
START_NS = 1_700_000_000 * NS_PER_S

Delays = Callable[[np.random.Generator, NDArray[np.float64]], NDArray[np.float64]]


def _usb(rng: np.random.Generator, true_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """The adapter's latency timer of 16 ms, and 2 % that come later still."""
    delay_s = rng.uniform(0.0, 0.016, len(true_s))
    late = rng.random(len(true_s)) < 0.02
    delay_s[late] += rng.exponential(0.02, int(late.sum()))
    return delay_s


def _bluetooth(rng: np.random.Generator, true_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slots of 20 ms, and radio noise: 10 % come some 80 ms later."""
    delay_s = (np.ceil(true_s / 0.02) * 0.02 - true_s) + rng.exponential(0.005, len(true_s))
    late = rng.random(len(true_s)) < 0.1
    delay_s[late] += rng.exponential(0.08, int(late.sum()))
    return delay_s


LINKS: Mapping[str, Delays] = {"USB": _usb, "Bluetooth": _bluetooth}
DRIFTS = (0.0, 120e-6, -5e-3, 1e-2)


def errors_ms(
    delays: Delays, drift: float, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors in milliseconds of the arrivals and of the estimates, once the clock has settled."""
    rng = np.random.default_rng(seed)
    count = SECONDS * RATE_HZ
    true_s = np.arange(count) / RATE_HZ + rng.uniform(0.0, 0.5 / RATE_HZ, count)
    device_ms = np.floor(true_s * (1.0 - drift) * 1000.0).astype(np.int64)
    arrival_s = np.maximum.accumulate(true_s + LEAST_DELAY_S + delays(rng, true_s))
    arrival_ns = START_NS + np.round(arrival_s * NS_PER_S).astype(np.int64)
    true_ns = START_NS + np.round(true_s * NS_PER_S).astype(np.int64)
    clock = DeviceClock()
    estimated_ns = np.array(
        [
            clock.estimate(ms, ns).t_ns
            for ms, ns in zip(device_ms.tolist(), arrival_ns.tolist(), strict=True)
        ]
    )
    settled = slice(SETTLED_S * RATE_HZ, None)
    by_arrival = (arrival_ns - true_ns)[settled] / NS_PER_MS
    return by_arrival, (estimated_ns - true_ns)[settled] / NS_PER_MS


def _row(errors: NDArray[np.float64]) -> str:
    bias = float(np.median(errors))
    spread = np.abs(errors - bias)
    rms = float(np.sqrt(np.mean(spread**2)))
    return f"{bias:8.2f} {rms:8.2f} {np.percentile(spread, 99):8.2f} {spread.max():8.2f}"


def main() -> None:
    print(f"{SECONDS} s at {RATE_HZ} readings a second, least delay {1e3 * LEAST_DELAY_S:g} ms")
    print(
        f"{'link':10} {'drift':>8} {'stamp':10} {'bias ms':>8} {'rms ms':>8} {'99 %':>8} {'max':>8}"
    )
    for link, delays in LINKS.items():
        for drift in DRIFTS:
            stamps = dict(zip(("arrival", "estimated"), errors_ms(delays, drift, 1), strict=True))
            for stamp, errors in stamps.items():
                print(f"{link:10} {1e6 * drift:5.0f}ppm {stamp:10} {_row(errors)}")


if __name__ == "__main__":
    main()
