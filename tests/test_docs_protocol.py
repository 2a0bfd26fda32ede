"""The page on the protocol describes what the code does: its tables, its examples, its C."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import zlib
from pathlib import Path

import pytest

from recorder.clock import NS_PER_S
from recorder.protocols import PROTOCOLS, make_protocol
from recorder.protocols.echogrid import KINDS, EchogridProtocol, encode
from recorder.protocols.reports import (
    Fault,
    HeadReport,
    HelloReport,
    LogReport,
    PoseReport,
    RangeReport,
    WheelReport,
)
from recorder.tracker import TrackedPose, read_pose

PAGE = (Path(__file__).parent.parent / "docs" / "protocol.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found, f"the page has no {language}"
    return found


def test_the_examples_are_right_to_the_last_digit() -> None:
    *_, examples = blocks("text")
    lines = examples.splitlines()
    packets = EchogridProtocol().feed("".join(line + "\r\n" for line in lines).encode())
    assert [packet.report for packet in packets] == [
        HelloReport(1, "boebot", "1.0.2"),
        LogReport("boot, battery 7.4 V"),
        RangeReport("ping", 0.523),
        RangeReport("dirrs", math.inf),
        RangeReport("ping", -math.inf),
        HeadReport("head", -math.pi / 2),
        WheelReport(1044, 1039),
        PoseReport(1.25, 0.8, math.pi / 2),
    ]
    assert {line[1:4] for line in lines} == set(KINDS)
    for packet in packets:
        assert packet.report is not None
        assert packet.seq is not None
        assert packet.device_ms is not None
        assert encode(packet.report, packet.seq, packet.device_ms) == packet.raw


def test_every_line_on_the_page_is_sound() -> None:
    lines = [line for block in blocks("text") for line in block.splitlines()]
    for line in lines:
        (packet,) = EchogridProtocol().feed(line.encode() + b"\n")
        assert packet.fault is None, line


def test_the_table_of_kinds_is_that_of_the_code() -> None:
    table = dict(re.findall(r"^\| `([A-Z]{3})` \| ([^|]+) \| [^|]+ \|$", PAGE, re.MULTILINE))
    for kind, layout in KINDS.items():
        assert table[kind] == layout.values


def test_every_fault_is_explained() -> None:
    for fault in Fault:
        assert f"| `{fault.value}` |" in PAGE


def test_the_c_code_gives_the_same_checksum(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        if os.environ.get("CI") == "true":
            pytest.fail("no C compiler: apt install gcc")
        pytest.skip("no C compiler: apt install gcc")
    bodies = ["123456789", "RNG,2,60,ping,523", "LOG,1,12,boot, battery 7.4 V", ""]
    main = "#include <stdio.h>\nint main(int n, char **body)\n{\n    for (int i = 1; i < n; i++)\n"
    main += '        printf("%08lX\\n", (unsigned long)crc32(body[i]));\n    return 0;\n}\n'
    source = tmp_path / "crc.c"
    source.write_text(blocks("c")[0] + main)
    program = tmp_path / "crc"
    subprocess.run([compiler, "-Wall", "-Werror", "-o", program, source], check=True)
    printed = subprocess.run([program, *bodies], check=True, capture_output=True, text=True).stdout
    assert printed.split() == [f"{zlib.crc32(body.encode()):08X}" for body in bodies]
    assert printed.startswith("CBF43926")


def test_the_rows_are_read_as_the_page_describes() -> None:
    (block,) = blocks("csv")
    columns = re.search(r"--columns (\S+)", PAGE)
    assert columns is not None
    protocol = make_protocol("csv", columns.group(1))
    header, *rows = protocol.feed(b"\n" + block.encode())[1:]
    assert header.fault is Fault.HEADER
    assert [row.device_ms for row in rows] == [1250, 1300, 1350]
    assert [[row.report, *row.more] for row in rows] == [
        [RangeReport("ping", pytest.approx(0.523)), RangeReport("dirrs", pytest.approx(0.35))],
        [RangeReport("ping", pytest.approx(0.521))],
        [RangeReport("ping", math.inf), RangeReport("dirrs", pytest.approx(0.348))],
    ]


def test_the_protocol_of_ones_own_works_as_it_stands(tmp_path: Path) -> None:
    (example,) = blocks("python")
    path = tmp_path / "my_robot.py"
    path.write_text(example)
    protocol = make_protocol(str(path))
    assert (protocol.name, protocol.default_baud) == ("my-robot", 57600)
    packets = protocol.feed(b"cut\r\nS 523\r\nI 81\r\nbattery low\r\nS 5x\r\n")
    assert [packet.report for packet in packets[1:4]] == [
        RangeReport("ping", 0.523),
        RangeReport("dirrs", 0.081),
        LogReport("battery low"),
    ]
    assert [packet.fault for packet in packets[::4]] == [Fault.NOISE, Fault.MALFORMED]


def test_the_table_of_protocols_is_that_of_the_code() -> None:
    table = {
        name: (checked == "yes", int(baud))
        for name, checked, baud in re.findall(
            r"^\| \[`(\w+)`\]\([^)]+\) \| [^|]+ \| (yes|no) \| (\d+) \|$", PAGE, re.MULTILINE
        )
    }
    assert table == {n: (p.checked, p.default_baud) for n, p in PROTOCOLS.items()}


def test_every_link_within_the_page_leads_somewhere() -> None:
    headings = re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}
    targets = set(re.findall(r"\]\(#([^)]+)\)", PAGE))
    assert targets
    assert targets <= anchors


def test_the_tracker_line_is_a_pose() -> None:
    (line,) = blocks("json")
    arrival_ns = 1_767_225_600 * NS_PER_S + NS_PER_S // 2
    tracked = read_pose(line.encode(), arrival_ns)
    assert isinstance(tracked, TrackedPose)
    assert tracked.pose.t_ns == arrival_ns - NS_PER_S // 4
    assert tracked.pose.world_from_base.x_m == 1.25
