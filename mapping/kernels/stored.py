"""Compiled loops on disk: kept by the run that compiled them, and loaded again without numba.

numba keeps what it compiled too, but to load that it has to be imported itself, with half of SciPy:
a good half of a second before the first cell is touched. What it made is object code around a
function that Python can call, and LLVM alone loads that in some milliseconds. A file holds one
function for one set of argument types; its name holds a digest of all that its code depends on,
the processor's features among it, and so does the file: a folder that moves to another machine,
or a home that two of them share, is no danger.
Where anything is not as expected (another platform than 64-bit ELF, a numba that keeps its things
elsewhere) nothing is kept, and numba does it all.
"""

from __future__ import annotations

import builtins
import ctypes
import json
import os
import pickle
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from hashlib import blake2b
from importlib.machinery import ExtensionFileLoader, PathFinder
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

Function = Callable[..., Any]

_ROOT = Path(__file__).resolve().parent.parent.parent
_ELF, _SYMBOL_TABLE, _UNDEFINED = b"\x7fELF\x02\x01", 2, 0
_SECTION, _SYMBOL = struct.Struct("<IIQQQQIIQQ"), struct.Struct("<IBBHQQ")
_CHANGE_NO_CODE = ("NUMBA_CACHE_DIR", "NUMBA_DEBUG_CACHE")
_Unpickle = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)


def file_of(module: str, name: str, kinds: str) -> Path:
    """The file of a function for arguments of some kinds."""
    of_kinds = blake2b(kinds.encode(), digest_size=6).hexdigest()
    return _folder() / f"{module}.{name}-{of_kinds}-{_machine()}-{_sources(module)}.loop"


def load(file: Path) -> Function | None:
    """The function that a file holds; None where there is none, or none that can be loaded."""
    try:
        head, _, code = file.read_bytes().partition(b"\n")
        known = json.loads(head)
    except (OSError, ValueError):
        return None
    if known.get("crc") != zlib.crc32(code) or known.get("machine") != _machine():
        return None  # cut short, or of another processor: that code would end the process
    try:
        return _linked(code, known["function"], known["environment"], known["types"])
    except (AttributeError, ImportError, KeyError, RuntimeError):  # another numba, another LLVM
        return None


def save(file: Path, dispatcher: Any, types: tuple[Any, ...]) -> None:
    """Keep what numba compiled for some types, unless it is of a kind that cannot be loaded."""
    try:
        content = _content(dispatcher, types)
    except (AttributeError, ImportError, LookupError, TypeError, ValueError):  # another numba
        return
    if content is None:
        return
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        part.replace(file)
        for outdated in file.parent.glob(f"{file.name.rpartition('-')[0]}-*.loop"):
            if outdated != file:
                outdated.unlink(missing_ok=True)
    except OSError:  # a full disk, a folder that may only be read: numba may still keep its own
        part.unlink(missing_ok=True)


def _folder() -> Path:
    """Where loops are kept: where numba is told to keep its own, beside the sources, or at home."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(given) / "echogrid"
    beside = Path(__file__).parent / "__pycache__"
    if os.access(beside if beside.exists() else beside.parent, os.W_OK):
        return beside
    return Path.home() / ".cache" / "echogrid"


@cache
def _machine() -> str:
    """A digest of what turns sources into code: versions, processor, and numba's settings."""
    import llvmlite
    from llvmlite import binding as llvm

    version = _numba_folder() / "_version.py"  # importlib.metadata would take half of all the time
    settings = [f"{k}={v}" for k, v in sorted(os.environ.items()) if k.startswith("NUMBA_")]
    parts = (
        version.read_text("utf-8"), llvmlite.__version__, sys.version, llvm.get_process_triple(),
        llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(),
        *(each for each in settings if not each.startswith(_CHANGE_NO_CODE)),
    )  # fmt: skip
    return blake2b("\n".join(parts).encode(), digest_size=6).hexdigest()


@cache
def _sources(module: str) -> str:
    """A digest of all that a loop of the module may call: the files of its package of kernels."""
    parts = module.split(".")
    package = _ROOT.joinpath(*parts[:2] if parts[0] == "mapping" else parts[:-1])
    digest = blake2b(digest_size=6)
    for file in sorted(package.rglob("*.py")):
        digest.update(f"{file.relative_to(package)}\n".encode() + file.read_bytes())
    return digest.hexdigest()


def _content(dispatcher: Any, types: tuple[Any, ...]) -> bytes | None:
    """What to write of a compiled function; None where it could not be loaded."""
    from numba.core.registry import cpu_target

    compiled, kept = dispatcher.overloads[types], dispatcher._cache
    constants = compiled.environment.consts  # the types of arrays that are given back
    if not all(isinstance(each, np.dtype) for each in constants):
        return None
    key = kept._index_key(types, cpu_target.target_context.codegen())
    (_, form, (code, _)), *_ = kept._cache_file.load(key)
    if form != "object" or not code.startswith(_ELF):
        return None
    known = {
        "crc": zlib.crc32(code),
        "machine": _machine(),
        "function": compiled.fndesc.llvm_cpython_wrapper_name,
        "environment": compiled.fndesc.env_name,
        "types": [each.str for each in constants],
    }
    return b"%s\n%s" % (json.dumps(known).encode(), code)


def _linked(code: bytes, function: str, environment: str, types: list[str]) -> Function | None:
    """The function of an object file, put in its place in memory."""
    from llvmlite import binding as llvm

    # The engine first: with it, LLVM knows what the process itself has.
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target().create_target_machine())
    dynamic, symbols = _numba_part("_dynfunc"), _symbols()
    for name in _undefined(code):
        if name in symbols:
            llvm.add_symbol(name, symbols[name])
        elif not llvm.address_of_symbol(name):
            return None  # LLVM would end the process
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    here = sys.modules[__name__]
    known = dynamic.Environment(vars(here))
    known.consts.extend(map(np.dtype, types))
    at = engine.get_global_value_address(environment)
    if not at:
        return None
    ctypes.c_void_p.from_address(at).value = id(known)
    made: Function = dynamic.make_function(
        here, "loop", function, engine.get_function_address(function), known, (engine, known)
    )
    return made


@cache
def _target() -> Any:
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple()


@cache
def _symbols() -> dict[str, int]:
    """Where that lies which numba's code calls: numba's C functions, and Python's constants."""
    helpers, runtime = _numba_part("_helperlib").c_helpers, _numba_part("core.runtime._nrt_python")
    runtime.memsys_use_cpython_allocator()  # as numba does
    found = dict(helpers)  # mathematics, among others
    found |= {f"numba_{name}": at for name, at in helpers.items()}
    for name, at in runtime.c_helpers.items():
        found[name if name.startswith("_") else f"NRT_{name}"] = at
    for name, value in vars(builtins).items():
        if isinstance(value, type) and issubclass(value, BaseException):
            found[f"PyExc_{name}"] = id(value)
    found["_Py_NoneStruct"] = id(None)
    found["numba_unpickle"] = ctypes.cast(_unpickle, ctypes.c_void_p).value or 0
    return found


@_Unpickle
def _unpickle(at: int, size: int, digest: int) -> Any:
    """What numba pickled into the code: the types of an array that is given back."""
    return pickle.loads(ctypes.string_at(at, size))


def _numba_folder() -> Path:
    found = find_spec("numba")
    assert found is not None, "numba is installed with this program"
    assert found.origin is not None
    return Path(found.origin).parent


def _numba_part(name: str) -> ModuleType:
    """A module of numba's that is written in C, without the rest of numba.

    It is entered under its own name, so that numba takes the same one if it comes later.
    """
    full = f"numba.{name}"
    if full in sys.modules:
        return sys.modules[full]
    *inside, last = name.split(".")
    found = PathFinder.find_spec(last, [str(_numba_folder().joinpath(*inside))])
    if found is None or found.origin is None:
        raise ImportError(full)
    loader = ExtensionFileLoader(full, found.origin)
    spec = spec_from_file_location(full, found.origin, loader=loader)
    assert spec is not None
    made = module_from_spec(spec)
    loader.exec_module(made)
    sys.modules[full] = made
    return made


def _undefined(code: bytes) -> Iterator[str]:
    """The names that an object file (64-bit ELF) takes from elsewhere."""
    (table,) = struct.unpack_from("<Q", code, 0x28)
    size, count = struct.unpack_from("<HH", code, 0x3A)
    sections = [_SECTION.unpack_from(code, table + k * size) for k in range(count)]
    for _, kind, _, _, begin, length, link, *_ in sections:
        if kind != _SYMBOL_TABLE:
            continue
        names = sections[link][4]
        for at in range(begin + _SYMBOL.size, begin + length, _SYMBOL.size):
            name, _, _, section, _, _ = _SYMBOL.unpack_from(code, at)
            if section == _UNDEFINED:
                first = names + name
                yield code[first : code.index(b"\0", first)].decode()
