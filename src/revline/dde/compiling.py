"""Compilation of a kernel from plain functions, and its place in the cache on disk.

Compiled code is kept under a digest of all it computes with, so that an edit in any file, also a user's, is never answered
with old code. Each kernel has files of its own: processes that compile different kernels at once do not disturb each other.
"""

import functools
import hashlib
import sys
from collections.abc import Callable, Mapping
from enum import Enum
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numba
from numba.extending import overload

from revline.dde import memory
from revline.equations import equation_digest, reached_functions

Kernel = Callable[[Any], int]
Part = Callable[..., Any]


def compile_kernel(make_loop: Callable[[Any], Kernel], parts: Mapping[str, Part], equations: tuple[Part, ...], layout: str) -> Kernel:
    """Compile a loop over some parts; compilation itself happens at the first call, or its result is read from disk.

    Args:
        make_loop: makes the loop from an object whose attributes are the parts.
        parts: functions by name.
        equations: functions that become part of who calls them.
        layout: text that stands for the types which the parts are compiled for.
    """
    inlined = reached_functions(*equations)
    intrinsics = [entry.__wrapped__ for entry in vars(memory).values() if hasattr(entry, "__wrapped__")]
    digest = equation_digest(make_loop(SimpleNamespace(**parts)), *parts.values(), *intrinsics, _register.__wrapped__)
    name = f"kernel_{hashlib.sha256(f'{digest} {layout}'.encode()).hexdigest()[:16]}"
    for function in inlined:
        _register(function, equation_digest(function), Inlining.FORCED)
    for function in reached_functions(make_loop(SimpleNamespace(**parts)), *parts.values()):
        if function not in inlined:
            _register(function, name if function in parts.values() else equation_digest(function), Inlining.FREE)
    module = ModuleType(f"{__name__}.{name}")  # known by this name to the cache: it stands for all that the loop computes with
    vars(module).update(parts)
    sys.modules[module.__name__] = module
    loop = make_loop(module)
    loop.__qualname__ = name
    jit: Any = numba.njit  # its types leave out _nrt: without it nothing is allocated and no references are counted
    compiled: Kernel = jit(cache=True, nogil=True, error_model="numpy", _nrt=False)(loop)
    return compiled


class Inlining(Enum):
    """Whether a function must become part of who calls it."""

    FORCED = "forced"
    FREE = "free"


@functools.cache
def _register(function: Part, digest: str, inlining: Inlining) -> Part:
    """Let compiled code call a plain function, under a name that no other function has; once per function.

    The linker knows functions by name alone. Two of one name, compiled by different processes, would be taken for one another where both
    come from the disk.
    """
    named = FunctionType(function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__)
    named.__kwdefaults__ = function.__kwdefaults__
    named.__module__ = function.__module__
    named.__qualname__ = f"{function.__qualname__}_{digest}"
    options: dict[str, Any] = {"no_cfunc_wrapper": True}
    if inlining is Inlining.FORCED:
        options["forceinline"] = True

    @overload(function, jit_options=options, strict=False)
    def implement(*_: Any, **__: Any) -> Part:
        return named

    return function
