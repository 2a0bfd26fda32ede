"""A protocol of one's own, in one file: what works, and what is reported when it does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorder.errors import BadInput
from recorder.protocols import Protocol, make_protocol
from recorder.protocols.reports import Fault, LogReport, Packet, RangeReport

LINES = """
from recorder.protocols import LineProtocol
from recorder.protocols.reports import LogReport, RangeReport

class Mine(LineProtocol):
    name = "mine"
    default_baud = 4800

    def read(self, line):
        word, number = line.split()
        if word == "both":
            return [RangeReport("a", int(number)), RangeReport("b", int(number))]
        return RangeReport(word, 1 / int(number)) if word != "what" else None
"""

BYTES = """
from recorder.protocols import Packet, Protocol
from recorder.protocols.reports import RangeReport

class Mine(Protocol):
    name = "bytes"

    def feed(self, data):
        return [Packet(bytes([b]), RangeReport("ping", b / 100)) for b in data]

    def close(self):
        return []
"""


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "mine.py"
    path.write_text(text, encoding="utf-8")
    return str(path)


def loaded(tmp_path: Path, text: str) -> Protocol:
    return make_protocol(written(tmp_path, text))


def test_lines_need_one_method(tmp_path: Path) -> None:
    protocol = loaded(tmp_path, LINES)
    assert (protocol.name, protocol.default_baud, protocol.checked) == ("mine", 4800, False)
    data = b"x\nping 2\nboth 3\nwhat 1\nping 0\nping\n\xff\n"
    _, ping, both, *bad = protocol.feed(data)
    assert ping == Packet(b"ping 2\n", RangeReport("ping", 0.5))
    assert both.report == RangeReport("a", 3)
    assert both.more == (RangeReport("b", 3),)
    assert [packet.fault for packet in bad] == [Fault.UNKNOWN_KIND] + 3 * [Fault.MALFORMED]
    assert protocol.greeting() == b""


def test_bytes_need_two(tmp_path: Path) -> None:
    protocol = loaded(tmp_path, BYTES)
    assert (protocol.default_baud, protocol.checked) == (115200, True)
    assert [packet.report for packet in protocol.feed(b"\x32")] == [RangeReport("ping", 0.5)]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "defines 0 protocols"),
        (LINES + BYTES, "defines 2 protocols"),
        (LINES.replace('name = "mine"', "pass"), "needs a name"),
        (LINES.replace("def read", "def reed"), "needs a method read"),
        (BYTES.replace("def close", "def clothes"), "needs a method close"),
        (
            BYTES.replace("def close", "def __init__(self, x):\n        pass\n    def close"),
            "fails",
        ),
        (LINES + "\n1 / 0\n", "line 15: ZeroDivisionError"),
        ("def", "line 1"),
    ],
)
def test_what_cannot_be_used_is_reported_in_one_line(
    tmp_path: Path, text: str, reason: str
) -> None:
    text = text.replace(LINES + BYTES, LINES + BYTES.replace("class Mine", "class Other"))
    with pytest.raises(BadInput, match=reason) as caught:
        loaded(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(BadInput, match="no such file"):
        make_protocol("nowhere/mine.py")


def test_a_log_line_is_a_report_like_any_other(tmp_path: Path) -> None:
    text = LINES.replace("word, number = line.split()", "return LogReport(line)")
    _, packet = loaded(tmp_path, text).feed(b"\nhello there\r\n")
    assert packet.report == LogReport("hello there")
