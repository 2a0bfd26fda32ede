"""Options that several commands share."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import click

from recorder.inputs import note_input


class Number(click.FloatRange):
    """A finite number within bounds, called so in the help and in the error for "abc"."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """As click does; but "nan" and "inf", which are numbers to Python, are none to people."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a number that can be used.", param, ctx)
        return number


class _Input(click.Path):
    """A file or folder that is read: never a pipe or a device, and never replaced by an output."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Note it; of ``rules.rrd#bayes``, one map of several, the file."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        file, mark, _ = path.name.partition("#")
        note_input(path.with_name(file) if mark and file and not path.exists() else path)
        return path


FILE = click.Path(path_type=Path)
INPUT = _Input(path_type=Path)

output_session = click.option(
    "-o", "--output", type=FILE, required=True, help="The session to write."
)
force = click.option("--force", is_flag=True, help="Replace the output where it exists.")
quiet = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
