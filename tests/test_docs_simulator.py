"""The page about the simulator: its lines of Python do what they promise."""

from __future__ import annotations

import re
from pathlib import Path

from recorder.messages import Range

PAGE = Path(__file__).resolve().parent.parent / "docs" / "simulator.md"


def test_the_first_python_of_the_page_drives_the_robot() -> None:
    first, *_ = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert "    ...\n" in first
    names: dict[str, list[object]] = {"messages": []}
    exec(first.replace("    ...\n", "    messages.append(message)\n"), names)
    ranges = [message for message in names["messages"] if isinstance(message, Range)]
    assert {message.sensor for message in ranges} == {"ping", "dirrs"}
    assert len(ranges) > 2000  # 20 a second of each, in 60 s
