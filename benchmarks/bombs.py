"""What files cost that claim, hold or nest too much: ``python -m benchmarks.bombs``.

Each bomb is made, and each command that takes it runs in a process of its own; its exit code, time
and greatest memory go into a table. The bounds are 500 MB and 10 s; the exit code here is 1 where
one is broken, or where a command ends otherwise than with 0, 1 or 2 and one line.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import zstandard
from mcap.writer import CompressionType, Writer

from recorder.geometry import SE2
from recorder.messages import Pose, Radiation, Range
from recorder.ros_definitions import DEFINITIONS
from recorder.session import SessionWriter

MOST_MB, MOST_S = 500, 10.0
_GB = 1 << 30
_YAML = (
    "{image: x.png, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, "
    "free_thresh: 0.2}"
)
_RANGE = "sensor_msgs/msg/Range"
MAGIC = b"\x89MCAP0\r\n"


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def _chunk(data: bytes, claimed: int, crc: int, name: bytes = b"zstd") -> bytes:
    head = struct.pack("<QQQII", 0, 1, claimed, crc, len(name)) + name
    return _record(6, head + struct.pack("<Q", len(data)) + data)


def _mcap(*records: bytes) -> bytes:
    text = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 1) + b"x"
    return MAGIC + _record(1, text) + b"".join(records) + MAGIC


def _zeros(count: int) -> bytes:
    """So many zero bytes, packed."""
    packer = zstandard.ZstdCompressor(level=3).compressobj(size=count)
    piece = bytes(1 << 20)
    return b"".join(packer.compress(piece) for _ in range(count >> 20)) + packer.flush()


def _unpacks_to_4_gb(path: Path) -> None:
    path.write_bytes(_mcap(_chunk(_zeros(4 * _GB), 4 * _GB, 0)))


def _many_chunks(path: Path) -> None:
    """64 chunks of 64 MB, each as it should be."""
    size = 64 << 20
    chunk = _chunk(_zeros(size), size, zlib.crc32(bytes(size)))
    path.write_bytes(_mcap(*[chunk] * 64))


def _lies_small(path: Path) -> None:
    path.write_bytes(_mcap(*[_chunk(_zeros(64 << 20), 1000, 0)] * 64))


def _false_heads(path: Path) -> None:
    head = _chunk(b"", 0, 1)[:57]
    far = struct.pack("<Q", 5_000_000 - 53)
    heads = b"".join(
        head[:1] + struct.pack("<Q", 4_900_000 - 9) + head[9:41] + b"\4\0\0\0zstd" + far
        for _ in range(20_000)
    )
    path.write_bytes(_mcap(b"\xee" * 50, heads, bytes(5_000_000)))


def _wide_schema(path: Path) -> None:
    definition = "\n".join(f"int8 a{i}" for i in range(200_000))
    _with_schema(path, definition, bytes(200_000))


def _many_schemas(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2", "x")
        for i in range(200):
            text = "\n".join(f"int8 a{k}" for k in range(1400)) + f"\n# {i}"
            schema = writer.register_schema(_RANGE, "ros2msg", text.encode())
            channel = writer.register_channel(f"/range/s{i}", "cdr", schema)
            writer.add_message(channel, 0, bytes(1404), 0)
        writer.finish()


def _with_schema(path: Path, definition: str, data: bytes) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "x")
        schema = writer.register_schema(_RANGE, "ros2msg", definition.encode())
        channel = writer.register_channel("/range/ping", "cdr", schema)
        writer.add_message(channel, 0, b"\0\1\0\0" + data, 0)
        writer.finish()


def _deep_metadata(path: Path) -> None:
    text = '{"a":' * 50_000 + "1" + "}" * 50_000
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "echogrid")
        crc = f"{zlib.crc32(text.encode()):08X}"
        writer.add_metadata("echogrid", {"json": text, "crc32": crc})
        _one_reading(writer)
        writer.finish()


def _long_numbers(path: Path) -> None:
    text = json.dumps({"a": 1})[:-1] + ', "b": ' + "9" * 5000 + "}"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "echogrid")
        writer.add_metadata("echogrid", {"json": text, "crc32": f"{zlib.crc32(text.encode()):08X}"})
        _one_reading(writer)
        writer.finish()


def _one_reading(writer: Writer) -> None:
    schema = writer.register_schema(_RANGE, "ros2msg", DEFINITIONS[_RANGE].encode())
    channel = writer.register_channel("/range/ping", "cdr", schema)
    writer.add_message(channel, 0, bytes(64), 0)


def _big_attachment(path: Path) -> None:
    """1 GB that takes no room on the disk."""
    size = _GB
    head = struct.pack("<QQ", 0, 0) + struct.pack("<I", 1) + b"a" + struct.pack("<I", 0)
    with path.open("wb") as file:
        file.write(_mcap()[:-8] + struct.pack("<BQ", 9, size))
        file.write(head + struct.pack("<Q", size - len(head) - 12))
        file.truncate(file.tell() + size)


def _far_apart(path: Path) -> None:
    """Eight readings on 94 million cells."""
    with SessionWriter(path) as writer:
        for i in range(8):
            t_ns = i * 100_000_000
            pose = SE2(96.0 * (i % 2), 96.0 * (i % 2), 0.0)
            reading = Range(t_ns, "ping", 0.5, 0.6, 0.02, 4.0, Radiation.ULTRASOUND)
            writer.write(Pose(t_ns, pose), log_ns=t_ns)
            writer.write(reading, log_ns=t_ns)


def _npz_zeros(path: Path) -> None:
    """4 GB of zeros in 4 MB."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": (1024, 1 << 20)}
    )
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("values.npy", "w", force_zip64=True) as member,
    ):
        member.write(header.getvalue())
        for _ in range(4096):
            member.write(bytes(1 << 20))


def _npz_claim(path: Path) -> None:
    """An array that claims 10^12 numbers."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("values.npy", header.getvalue() + bytes(100))


def _npz_config(path: Path) -> None:
    config = "a" + ".a" * 50_000 + " = 1"
    np.savez(
        path, **{"ping/values": np.zeros((3, 3)), "ping/kind": np.array("probability")},
        origin_m=np.zeros(2), resolution_m=np.array(0.1), config_toml=np.array(config),
    )  # fmt: skip


def _yaml_aliases(path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    path.write_text("\n".join(lines))


def _picture(path: Path) -> None:
    """A picture of 900 million pixels in a few kB."""
    packer, side = zlib.compressobj(), 30_000
    data = b"".join(packer.compress(bytes(1 + side // 8)) for _ in range(side)) + packer.flush()
    head = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", data), (b"IEND", b"")]
    pieces = [
        struct.pack(">I", len(content)) + name + content
        + struct.pack(">I", zlib.crc32(name + content))
        for name, content in parts
    ]  # fmt: skip
    path.with_name("x.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(pieces))
    path.write_text(_YAML)


def _deep_json(folder: Path) -> None:
    folder.mkdir()
    np.savez(
        folder / "ping.npz", values=np.zeros((3, 3), np.float32), origin_m=np.zeros(2),
        resolution_m=np.array(0.1), kind=np.array("probability"), layer=np.array("ping"),
    )  # fmt: skip
    (folder / "ping.borders.json").write_text("[" * 500_000)


def _rrd_claims(path: Path) -> None:
    """Chunks that claim 2 GB each, in a recording of the format's second version."""
    chunk = b"\x10\x02\x18\xff\xff\xff\xff\x07\x20\x01\x2a\x02ab"
    messages = struct.pack("<QQ", 2, len(chunk)) + chunk
    path.write_bytes(b"RRF2\0\x29\0\0\x01\x02\0\0" + messages * 50)


def _toml(path: Path) -> None:
    path.write_text("a" + ".a" * 400_000 + " = 1")


Bomb = tuple[str, str, Callable[[Path], None], tuple[str, ...]]
_SESSION = ("info {bad}", "map {bad} -o -", "diff {bad} {bad}")
_MAP = ("diff {bad} {bad}",)
BOMBS: tuple[Bomb, ...] = (
    ("chunk of 4 GB", "a.mcap", _unpacks_to_4_gb, _SESSION),
    ("64 chunks of 64 MB", "b.mcap", _many_chunks, _SESSION),
    ("chunks that lie", "c.mcap", _lies_small, _SESSION),
    ("20,000 false heads", "d.mcap", _false_heads, _SESSION),
    ("200,000 fields", "e.mcap", _wide_schema, _SESSION),
    ("200 wide schemas", "f.mcap", _many_schemas, _SESSION),
    ("metadata 50,000 deep", "g.mcap", _deep_metadata, _SESSION),
    ("number of 5,000 digits", "h.mcap", _long_numbers, _SESSION),
    ("attachment of 1 GB", "i.mcap", _big_attachment, _SESSION),
    ("94 million cells", "j.mcap", _far_apart, _SESSION),
    ("npz of 4 GB", "k.npz", _npz_zeros, _MAP),
    ("npz claims 10^12", "l.npz", _npz_claim, _MAP),
    ("config_toml in an npz", "m.npz", _npz_config, ("diff {bad} {good}",)),
    ("aliases in YAML", "n.yaml", _yaml_aliases, _MAP),
    ("900 million pixels", "o.yaml", _picture, _MAP),
    ("JSON 500,000 deep", "p", _deep_json, _MAP),
    ("rrd claims 100 GB", "q.rrd", _rrd_claims, ("diff {bad} {bad}", "view {bad}")),
    ("TOML 400,000 deep", "r.toml", _toml, ("map {good} -o - --config {bad}",)),
)


def measured(arguments: list[str]) -> tuple[int, float, float, str]:
    """Exit code, seconds, greatest MB and standard error of one command."""
    begin = time.monotonic()
    with tempfile.TemporaryFile() as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "echogrid", *arguments], stdout=subprocess.DEVNULL, stderr=err
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        err.seek(0)
        text = err.read().decode(errors="replace")
    return process.returncode, time.monotonic() - begin, usage.ru_maxrss / 1024, text


def main() -> int:
    """Make all bombs, or those whose names hold a word, and print the table."""
    words = sys.argv[1:]
    broken = 0
    print("| bomb | bytes | command | exit | s | MB |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        good = folder / "good.mcap"
        measured(["simulate", "room", "-o", str(good), "--duration", "2"])
        measured(["map", str(good), "-o", "-"])  # compiles
        for name, file, make, commands in BOMBS:
            if words and not any(word in name for word in words):
                continue
            bad = folder / file
            make(bad)
            size = sum(f.stat().st_size for f in (bad.iterdir() if bad.is_dir() else [bad]))
            for command in commands:
                parts = [part.format(bad=bad, good=good) for part in command.split()]
                code, taken_s, peak_mb, err = measured(parts)
                well = code in (0, 1, 2) and err.count("\n") <= 1
                fine = well and taken_s <= MOST_S and peak_mb <= MOST_MB
                broken += not fine
                mark = "" if fine else " BROKEN"
                shown = command.format(bad=file, good="good.mcap")
                print(f"| {name} | {size:,} | {shown} | {code} | {taken_s:.1f} | {peak_mb:.0f} |"
                      f"{mark}", flush=True)  # fmt: skip
                if not well:
                    print(err[-500:], file=sys.stderr)
            shutil.rmtree(bad) if bad.is_dir() else bad.unlink()
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
