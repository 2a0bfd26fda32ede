"""What can go wrong with other people's input, each reported in one line.

``EchogridError`` is the base of everything that is the input's fault, not ours: the command line
prints its message as one line and exits with 2. Anything else is a bug and keeps its traceback.
"""

from __future__ import annotations


class EchogridError(Exception):
    """Base of all errors that a user can cause and mend; the message is one line."""


class BadInput(EchogridError, ValueError):
    """A file, a line or an option that cannot be used, and why."""


class OutputExists(EchogridError, FileExistsError):
    """The output is there already and ``--force`` was not given."""

    def __init__(self, path: object) -> None:
        super().__init__(f"{path} exists already (use --force to replace it)")


class LinkError(EchogridError, ConnectionError):
    """A serial line or a tracker that cannot be opened, or that went away."""
