"""How many damaged lines pass with a wrong value: ``python benchmarks/recorder_corruption.py``.

Lines of the ``echogrid`` protocol are damaged in nine ways and read back; each carries its own
number as device time, so a line that passes can be held against what was sent. The seed is fresh
each time and printed; ``--seed`` repeats a run. The bound is the exact Poisson one at 95 %: three
over the number of lines when none passed wrong (the rule of three).
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from recorder.protocols.echogrid import EchogridProtocol

BATCH_LINES = 20_000
DEFAULT_LINES = 10_000_000
CONFIDENCE = 0.95

Stream = NDArray[np.uint8]
Damaged = tuple[Stream, NDArray[np.bool_]]  # the bytes that arrive; which lines were touched


@dataclass(frozen=True, slots=True)
class Tally:
    """Lines that were damaged, and how many of them passed, with the right or a wrong value."""

    damaged: int = 0
    right: int = 0
    wrong: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.damaged + other.damaged, self.right + other.right, self.wrong + other.wrong
        )


@dataclass(frozen=True, slots=True)
class Lines:
    """A batch as one stream: line i is ``data[starts[i]:starts[i + 1]]``."""

    data: Stream
    starts: NDArray[np.int64]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """How many bytes each line has, its end included."""
        return np.diff(self.starts)

    def owners(self) -> NDArray[np.int64]:
        """The line that each byte belongs to."""
        return np.repeat(np.arange(len(self.lengths)), self.lengths)

    def positions(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """One byte of each line, anywhere in it."""
        return self.starts[:-1] + rng.integers(0, self.lengths)


def made_lines(count: int, rng: np.random.Generator) -> list[bytes]:
    """Lines of four kinds; line i has device time i, and sequence number i in 16 bits."""
    ranges_mm = rng.integers(-2, 5000, count).tolist()
    numbers = rng.integers(-(2**15), 2**15, (count, 3)).tolist()
    lines = []
    for i, (mm, (a, b, c)) in enumerate(zip(ranges_mm, numbers, strict=True)):
        bodies = (
            f"RNG,{i & 0xFFFF},{i},ping,{mm}",
            f"RNG,{i & 0xFFFF},{i},dirrs,{mm}",
            f"WHL,{i & 0xFFFF},{i},{a},{b}",
            f"POS,{i & 0xFFFF},{i},{a},{b},{c}",
        )
        body = bodies[i % 4].encode()
        lines.append(b"$%b*%08X\r\n" % (body, zlib.crc32(body)))
    return lines


def _byte_errors(lines: Lines, rng: np.random.Generator, *, bits: bool) -> Damaged:
    """1 % of all bytes: another byte, or one bit of it the other way."""
    data = lines.data.copy()
    hit = rng.random(len(data)) < 0.01
    count = int(hit.sum())
    change = 1 << rng.integers(0, 8, count) if bits else rng.integers(1, 256, count)
    data[hit] ^= change.astype(np.uint8)
    touched = np.zeros(len(lines.lengths), dtype=np.bool_)
    touched[lines.owners()[hit]] = True
    return data, touched


def _one_bit(lines: Lines, rng: np.random.Generator) -> Damaged:
    """One bit of each line."""
    data = lines.data.copy()
    at = lines.positions(rng)
    data[at] ^= (1 << rng.integers(0, 8, len(at))).astype(np.uint8)
    return data, np.ones(len(at), dtype=np.bool_)


def _other_digit(lines: Lines, rng: np.random.Generator) -> Damaged:
    """One character of each line becomes another that may stand in a line: it looks sound."""
    data = lines.data.copy()
    at = lines.starts[:-1] + 1 + rng.integers(0, lines.lengths - 3)
    alphabet = np.frombuffer(b"0123456789ABCDEF,-", dtype=np.uint8)
    new = rng.choice(alphabet, len(at))
    touched = data[at] != new
    data[at] = new
    return data, touched


def _burst(lines: Lines, rng: np.random.Generator) -> Damaged:
    """2 to 40 bytes in a row become random ones, once in every third line or so."""
    data = lines.data.copy()
    touched = np.zeros(len(lines.lengths), dtype=np.bool_)
    owners = lines.owners()
    for at in lines.positions(rng)[::3].tolist():
        end = min(at + int(rng.integers(2, 41)), len(data))
        data[at:end] = rng.integers(0, 256, end - at, dtype=np.uint8)
        touched[owners[at:end]] = True
    return data, touched


def _removed(lines: Lines, first: NDArray[np.int64], last: NDArray[np.int64]) -> Damaged:
    """Without the bytes from ``first`` up to ``last``, excluded, of each pair."""
    change = np.zeros(len(lines.data) + 1, dtype=np.int64)
    np.add.at(change, first, 1)
    np.add.at(change, np.minimum(last, len(lines.data)), -1)
    gone = np.cumsum(change)[:-1] > 0
    touched = np.zeros(len(lines.lengths), dtype=np.bool_)
    touched[lines.owners()[gone]] = True
    return lines.data[~gone], touched


def _cut(lines: Lines, rng: np.random.Generator) -> Damaged:
    """Each line loses its end or its beginning."""
    at = lines.positions(rng)
    tail = rng.random(len(at)) < 0.5
    first = np.where(tail, at, lines.starts[:-1])
    last = np.where(tail, lines.starts[1:], at + 1)
    return _removed(lines, first, last)


def _joined(lines: Lines, rng: np.random.Generator) -> Damaged:
    """From somewhere in a line to somewhere in the next one nothing arrives."""
    at = lines.positions(rng)
    return _removed(lines, at[0:-1:2], at[1::2])


def _bytes_lost_or_added(lines: Lines, rng: np.random.Generator) -> Damaged:
    """In each line one byte is lost, or one is there twice or too many."""
    at = lines.positions(rng)
    lost = rng.random(len(at)) < 0.5
    repeats = np.ones(len(lines.data), dtype=np.int64)
    repeats[at] = np.where(lost, 0, 2)
    data = np.repeat(lines.data, repeats)
    doubled = at[~lost]
    second = np.cumsum(repeats)[doubled] - 1
    noise = rng.random(len(doubled)) < 0.5
    data[second[noise]] = rng.integers(0, 256, int(noise.sum()), dtype=np.uint8)
    return data, np.ones(len(at), dtype=np.bool_)


def _swapped(lines: Lines, rng: np.random.Generator) -> Damaged:
    """Two neighbouring lines swap their ends, or two neighbouring bytes of a line their places."""
    data = lines.data
    pieces, touched = [], np.zeros(len(lines.lengths), dtype=np.bool_)
    starts = lines.starts.tolist()
    for i in range(0, len(starts) - 2, 2):
        a, b = data[starts[i] : starts[i + 1]], data[starts[i + 1] : starts[i + 2]]
        at = int(rng.integers(1, min(len(a), len(b)) - 1))
        if rng.random() < 0.5:
            new_a = np.concatenate([a[:at], b[at:]])
            new_b = np.concatenate([b[:at], a[at:]])
        else:
            new_a, new_b = a.copy(), b.copy()
            for each in (new_a, new_b):
                each[at - 1 : at + 1] = each[at - 1 : at + 1][::-1]
        touched[i] = not np.array_equal(a, new_a)
        touched[i + 1] = not np.array_equal(b, new_b)
        pieces += [new_a, new_b]
    return np.concatenate(pieces), touched


KINDS: Mapping[str, Callable[[Lines, np.random.Generator], Damaged]] = {
    "1 % of the bytes, one bit of each": lambda lines, rng: _byte_errors(lines, rng, bits=True),
    "1 % of the bytes, any byte": lambda lines, rng: _byte_errors(lines, rng, bits=False),
    "one bit in each line": _one_bit,
    "one character looks sound": _other_digit,
    "bursts of 2 to 40 bytes": _burst,
    "cut": _cut,
    "joined": _joined,
    "a byte lost or added": _bytes_lost_or_added,
    "ends or neighbours swapped": _swapped,
}


def try_batch(kind: str, seed: tuple[int, int]) -> Tally:
    """Damage one batch in the way named ``kind``, read it, and compare."""
    rng = np.random.default_rng(seed)
    sent = made_lines(BATCH_LINES, rng)
    lengths = np.array([len(line) for line in sent])
    stream = np.frombuffer(b"".join(sent), dtype=np.uint8)
    lines = Lines(stream, np.concatenate([[0], np.cumsum(lengths)]))
    data, touched = KINDS[kind](lines, rng)
    right = wrong = 0
    for packet in EchogridProtocol().feed(data.tobytes()):
        if packet.report is None:
            continue
        number = packet.device_ms
        assert number is not None
        if number < len(sent) and _content(sent[number]) == (packet.report, packet.seq, number):
            right += bool(touched[number])
        else:
            wrong += 1
    return Tally(int(touched.sum()), right, wrong)


def _content(line: bytes) -> tuple[object, int | None, int | None]:
    (packet,) = EchogridProtocol().feed(line)
    return packet.report, packet.seq, packet.device_ms


def upper_bound(wrong: int, lines: int) -> float:
    """The largest share of wrong lines that fits ``wrong`` of ``lines`` at 95 % (Poisson)."""
    return float(stats.chi2.ppf(CONFIDENCE, 2 * (wrong + 1)) / 2.0 / lines)


def tallies(lines: int, seed: int, workers: int) -> Iterator[tuple[str, Tally]]:
    """Each kind with its tally, once it has its share of ``lines`` damaged lines."""
    share = -(-lines // len(KINDS))
    with multiprocessing.Pool(workers) as pool:
        for number, kind in enumerate(KINDS):
            tally, batch = Tally(), 0
            while tally.damaged < share:
                per_batch = tally.damaged / batch if batch else BATCH_LINES
                count = max(workers, int((share - tally.damaged) / per_batch) + 1)
                tasks = [(kind, (seed, number * 10**6 + i)) for i in range(batch, batch + count)]
                batch += count
                for one in pool.starmap(try_batch, tasks):
                    tally += one
            yield kind, tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lines", type=int, default=DEFAULT_LINES, help="damaged lines in all")
    parser.add_argument("--seed", type=int, help="of an earlier run, to repeat it")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    seed = np.random.SeedSequence().entropy if options.seed is None else options.seed
    print(f"seed {seed}")
    print(f"{'damage':34} {'damaged lines':>13} {'passed right':>13} {'passed wrong':>13}")
    start_s, total = time.perf_counter(), Tally()
    for kind, tally in tallies(options.lines, seed, options.workers):
        total += tally
        print(f"{kind:34} {tally.damaged:13,} {tally.right:13,} {tally.wrong:13,}", flush=True)
    print(f"{'all':34} {total.damaged:13,} {total.right:13,} {total.wrong:13,}")
    bound = upper_bound(total.wrong, total.damaged)
    print(f"wrong: at most {bound:.1e} of the damaged lines (95 %)")
    print(f"{time.perf_counter() - start_s:.0f} s on {options.workers} processes")
    return 1 if total.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
