"""Compilation of a kernel from plain functions, and its place in the cache on disk.

Compiled code is kept under a digest of all it computes with, so that an edit in any file, also a user's, is never answered
with old code. Each kernel has files of its own, so that processes which compile different kernels at once do not disturb each
other. Inside, each compiled function bears a name with a digest of its content: kernels from different processes meet in one
program, where of two functions of one name only the first would ever run.
"""

import contextlib
import functools
import hashlib
import pkgutil
import re
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from pickle import PickleError
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
from numba.core.errors import NumbaError
from numba.extending import overload

from revline.equations import equation_digest, reached_functions
from revline.errors import InvalidInputError

UNREADABLE = (OSError, EOFError, PickleError, ValueError, IndexError, KeyError, AttributeError, ImportError)
"""What reading damaged files, or writing to a full disk, raises."""

Kernel = Callable[[Any], int]
Part = Callable[..., Any]


class Cache(Enum):
    """Whether compiled code is kept."""

    ON_DISK = "on disk"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Layout:
    """Types that a kernel is compiled for: of the state's record, of the parameters, and of a sampled controller's, where there is one."""

    state: np.dtype[np.void]
    parameters: Any
    controller: Any = None


def compile_kernel(make_loop: Callable[[Any], Kernel], parts: Mapping[str, Part], equations: tuple[Part, ...], layout: Layout) -> Kernel:
    """Compile a loop over some parts, or read the result of an earlier compilation from disk.

    Args:
        make_loop: makes the loop from an object whose attributes are the parts.
        parts: functions by name, made for this kernel alone.
        equations: functions that become part of who calls them.
        layout: types which the parts are made for.

    Raises:
        InvalidInputError: an equation does what the compiler does not know.
    """
    draft = make_loop(SimpleNamespace(**parts))
    name = _short(f"{equation_digest(draft, *parts.values())} {layout.parameters} {layout.controller} {_recipe()}")
    inlined = frozenset(reached_functions(*equations))
    own = frozenset(parts.values())
    for function in reached_functions(draft, *parts.values()):
        if function is not draft:
            _register(function, name if function in own else equation_digest(function), function in inlined)
    module = ModuleType(f"{__name__}.kernel_{name}")  # known by this name to the cache: it stands for all that the loop computes with
    vars(module).update(parts)
    sys.modules[module.__name__] = module
    loop = make_loop(module)
    loop.__qualname__ = f"kernel_{name}"
    try:
        return _compile_or_load(loop, numba.from_dtype(layout.state)[::1])
    except NumbaError as error:
        names = ", ".join(dict.fromkeys(function.__qualname__ for function in equations))
        message = f"the equations {names} cannot be compiled{_place_in(str(error))}; compute with floats, tuples and numpy's functions only"
        raise InvalidInputError(message) from error


def _place_in(report: str) -> str:
    """Where a compiler's report sees the fault, outside this package and the compiler's own."""
    places = re.findall(r'File "(.+?)", line (\d+)', report)
    outside = [(file, line) for file, line in places if not {"numba", "dde"} & set(Path(file).parts[:-1])]
    return f", see {outside[-1][0]}, line {outside[-1][1]}" if outside else ""


def _compile_or_load(loop: Kernel, argument: Any) -> Kernel:
    """Compile with the cache on disk; where that is damaged anew, and without it where no folder can be written."""
    try:
        return _compile(loop, argument, Cache.ON_DISK)
    except UNREADABLE:
        _drop_files(loop)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        warn_once("no folder for them can be written")
        return _compile(loop, argument, Cache.NONE)
    try:
        return _compile(loop, argument, Cache.ON_DISK)
    except UNREADABLE as error:
        warn_once(f"their files cannot be read or written: {type(error).__name__}")
        return _compile(loop, argument, Cache.NONE)


def _compile(loop: Kernel, argument: Any, cache: Cache) -> Kernel:
    jit: Any = numba.njit  # its types leave out _nrt: without it nothing is allocated and no references are counted
    compiled = jit(cache=cache is Cache.ON_DISK, nogil=True, error_model="numpy", _nrt=False)(loop)
    compiled.compile((argument,))
    kernel: Kernel = compiled
    return kernel


def _drop_files(loop: Kernel) -> None:
    """Remove a kernel's files from the cache; they hold nothing that cannot be made again."""
    jit: Any = numba.njit
    folder = Path(jit(cache=True)(loop).stats.cache_path)
    for file in folder.glob(f"*{loop.__qualname__}*"):
        with contextlib.suppress(OSError):
            file.unlink()


@functools.cache
def warn_once(reason: str) -> None:
    """Warn that compiled code is not kept, once per reason and process."""
    message = f"compiled kernels are not kept, so each start takes seconds: {reason}; set NUMBA_CACHE_DIR to a folder that can be written"
    warnings.warn(message, RuntimeWarning, stacklevel=2)


@functools.cache
def _register(function: FunctionType, tag: str, inlined: bool) -> None:  # noqa: FBT001 - the cache takes no keywords
    """Let compiled code call a plain function, which is compiled under a name with a tag; once per function."""
    code, names, defaults, cells = function.__code__, function.__globals__, function.__defaults__, function.__closure__
    tagged = FunctionType(code, names, function.__name__, defaults, cells)
    tagged.__kwdefaults__, tagged.__module__ = function.__kwdefaults__, function.__module__
    tagged.__qualname__ = f"{function.__qualname__}_{tag}"

    def implement(*_: Any, **__: Any) -> FunctionType:
        return tagged

    options: Any = {"no_cfunc_wrapper": True, "forceinline": inlined}
    overload(function, jit_options=options, strict=False)(implement)


@functools.cache
def _recipe() -> str:
    """Digest of how kernels are compiled: what no equation reaches."""
    sources = (pkgutil.get_data(__package__, name) or b"" for name in ("compiling.py", "memory.py"))
    return _short(repr(tuple(sources)))


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
