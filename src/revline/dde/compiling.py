"""Compilation of a kernel from plain functions, and its place in the cache on disk.

Compiled code is kept under a digest of all it computes with, so that an edit in any file, also a user's, is never answered
with old code. Each kernel has files of its own: processes that compile different kernels at once do not disturb each other.
"""

import functools
import hashlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
from numba.extending import register_jitable

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
    for function in inlined:
        _register_inline(function)
    for function in reached_functions(make_loop(SimpleNamespace(**parts)), *parts.values()):
        if function not in inlined:
            _register(function)
    intrinsics = [entry.__wrapped__ for entry in vars(memory).values() if hasattr(entry, "__wrapped__")]
    digest = equation_digest(make_loop(SimpleNamespace(**parts)), *parts.values(), *intrinsics)
    name = f"kernel_{hashlib.sha256(f'{digest} {layout}'.encode()).hexdigest()[:16]}"
    module = ModuleType(f"{__name__}.{name}")  # known by this name to the cache: it stands for all that the loop computes with
    vars(module).update(parts)
    sys.modules[module.__name__] = module
    loop = make_loop(module)
    loop.__qualname__ = name
    jit: Any = numba.njit  # its types leave out _nrt: without it nothing is allocated and no references are counted
    compiled: Kernel = jit(cache=True, nogil=True, error_model="numpy", _nrt=False)(loop)
    return compiled


@functools.cache
def _register(function: Part) -> Part:
    """Let compiled code call a plain function; once per function."""
    return register_jitable(no_cfunc_wrapper=True)(function)


@functools.cache
def _register_inline(function: Part) -> Part:
    """The same, for functions that become part of who calls them."""
    return register_jitable(no_cfunc_wrapper=True, forceinline=True)(function)
