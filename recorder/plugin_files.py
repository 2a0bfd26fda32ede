"""A student's own Python file, run as it stands, with every failure reported in one line.

The file is run as Python: load only files that you trust.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from recorder.errors import BadInput
from recorder.foreign import check_file, reason_of
from recorder.inputs import note_input


def run_file(path: Path) -> ModuleType:
    """Run a Python file; raises BadInput, with the line, when it cannot be read or run."""
    name = f"echogrid_plugin_{path.stem}"
    note_input(path)
    if path.is_dir():
        raise BadInput(f"{path}: a folder, not a Python file")
    if not path.exists():
        raise BadInput(f"{path}: no such file")
    check_file(path, may_be_empty=True)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BadInput(f"{path}: not a Python file (its name must end in .py)")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up there
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise BadInput(f"{path}, line {error.lineno}: {error.msg}") from None
    except SystemExit as error:
        raise BadInput(f"{path}{_line_in(path, error)}: {reason_of(error)}") from None
    except Exception as error:
        line = _line_in(path, error)
        raise BadInput(f"{path}{line}: {type(error).__name__}: {one_line(error)}") from error
    return module


def one_line(error: BaseException) -> str:
    """The text of an error, without line ends."""
    return " ".join(str(error).split())


def _line_in(path: Path, error: BaseException) -> str:
    """Where in the file it went wrong, as ``, line 3``."""
    at, trace = "", error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            at = f", line {trace.tb_lineno}"
        trace = trace.tb_next
    return at
