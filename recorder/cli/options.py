"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path

import click


class Number(click.FloatRange):
    """A number within bounds, called so in the help and in what is said of "abc"."""

    name = "number"


FILE = click.Path(path_type=Path)

output_session = click.option(
    "-o", "--output", type=FILE, required=True, help="The session to write."
)
force = click.option("--force", is_flag=True, help="Replace the output where it exists.")
quiet = click.option("--quiet", is_flag=True, help="Say nothing but errors.")
