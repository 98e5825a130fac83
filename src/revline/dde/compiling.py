"""Compilation of a kernel from plain functions, and its place in the cache on disk.

Compiled code is kept under a digest of all it computes with, so that an edit in any file, also a user's, is never answered
with old code. Each kernel has files of its own, so that processes which compile different kernels at once do not disturb each
other. Inside, each compiled function bears a name with a digest of its content: kernels from different processes meet in one
program, where of two functions of one name only the first would ever run.
"""

import functools
import hashlib
import sys
from collections.abc import Callable, Mapping
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
        parts: functions by name, made for this kernel alone.
        equations: functions that become part of who calls them.
        layout: text that stands for the types which the parts are made for.
    """
    draft = make_loop(SimpleNamespace(**parts))
    intrinsics = [entry.__wrapped__ for entry in vars(memory).values() if hasattr(entry, "__wrapped__")]
    name = _short(f"{equation_digest(draft, *parts.values(), *intrinsics, compile_kernel, _register.__wrapped__)} {layout}")
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
    jit: Any = numba.njit  # its types leave out _nrt: without it nothing is allocated and no references are counted
    compiled: Kernel = jit(cache=True, nogil=True, error_model="numpy", _nrt=False)(loop)
    return compiled


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


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
