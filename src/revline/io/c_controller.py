"""A sampled controller as C99: one file without dependency, written from the same equations as the simulation runs.

Compiled without contraction (-ffp-contract=off) and without -ffast-math it computes, in double precision, the same bits.
"""

import math
import re
from collections.abc import Mapping, Sequence
from enum import Enum
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from revline.design.controllers.gain_schedule import ScheduleTables
from revline.errors import InvalidInputError, out_of_range
from revline.io.recorded_operations import Operation, Statement, check_names, flat_parameters, given, named_parameters, write_statements
from revline.sampled import SampledController
from revline.system import Variable

COMPILE: Final = "gcc -std=c99 -O2 -ffp-contract=off -Wall -Wextra -Werror -pedantic -c"
"""How the file is compiled; the flags are part of what is promised."""


class Precision(Enum):
    """Type of all numbers."""

    DOUBLE = "double"
    FLOAT = "float"


LIMITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "minimum": "static real minimum(real a, real b) { return (a != a) ? a : ((b != b) ? b : ((a < b) ? a : b)); }",
        "maximum": "static real maximum(real a, real b) { return (a != a) ? a : ((b != b) ? b : ((a > b) ? a : b)); }",
        "fmin_": "static real fmin_(real a, real b) { return (a != a) ? b : ((b != b) ? a : ((a < b) ? a : b)); }",
        "fmax_": "static real fmax_(real a, real b) { return (a != a) ? b : ((b != b) ? a : ((a > b) ? a : b)); }",
    }
)
"""What limits a number, as the simulation has it: in the first two what is no number stays none, in the others it is passed over."""

FUNCTIONS: Final[Mapping[str, str]] = MappingProxyType({"fmin(": "fmin_(", "fmax(": "fmax_("})


TEMPLATE: Final = """/* {name}: a sampled controller, one file of C99 without dependency.
 *
{head}
 *
 * Compile: {compile} {name}.c
 * Call {name}_start once, where the controller takes over, then {name}_step at each sample. Where they are called, declare them by
 *     #define {capitals}_DECLARATIONS
 *     #include "{name}.c"
 */

#ifndef {capitals}_DECLARED
#define {capitals}_DECLARED

typedef {precision} {name}_real;

/* States between samples. */
typedef struct {{
{states}
}} {name}_state;

/* Outputs of a sample: what drives the plant first, then what it is made of. */
typedef struct {{
{outputs}
}} {name}_output;

{name}_state {name}_start({declared_start});
{name}_output {name}_step({name}_state *state, {declared_step}, {name}_real seconds);

#endif

#ifndef {capitals}_DECLARATIONS

typedef {name}_real real;

#include <float.h>
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "fast-math changes what this file computes; compile without it"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0
#error "numbers are kept with more digits than they have; on x86 compile with -msse2 -mfpmath=sse"
#endif

/* Parameters. */
static const struct {{
{declared}
}} p = {{
{constants}
}};

/* The smaller and the larger of two numbers. */
{limits}

/* States from which the first output is {drives} and what the integral adds in one sample, if nothing moves. What is no finite number
 * counts as rest, and without a measurement the first output is the safe one until there is one. */
{name}_state {name}_start({start_arguments})
{{
    {name}_state state;
{begin}
    return state;
}}

/* One sample, so many seconds after the one before; what is no finite time above 1e-9 s adds nothing to the integral. */
{name}_output {name}_step({name}_state *state, {step_arguments}, real seconds)
{{
    {name}_output output;
{sample}
    return output;
}}

#endif
"""
"""The file, with what differs from controller to controller in braces."""


def write_c_controller(
    controller: SampledController, *, name: str, precision: Precision, about: Mapping[str, str], units: Mapping[str, str]
) -> str:
    """Write a sampled controller as one C99 file.

    Args:
        controller: whose equations and parameters are written.
        name: begins the names of all that the file offers.
        precision: type of all numbers; parameters for rounding must have been made for it.
        about: what the head of the file says, by key.
        units: of the parameters, by name.

    Returns:
        The text of the file: a struct of states, one of outputs, `NAME_start` and `NAME_step`; it is its own header.

    Raises:
        InvalidInputError: the name, or that of a signal, is none in C, or a parameter has no place among numbers of single precision.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,30}", name):
        message = f"{name!r} is no name for C code; give lower-case letters, digits and underscores, beginning with a letter"
        raise InvalidInputError(message, name=name)
    check_names(controller)
    head = "\n".join(f" * {key}: {_comment(value)}" for key, value in about.items())
    parameters = controller.parameters
    pairs = flat_parameters(parameters)
    if precision is Precision.FLOAT:
        _check_single(pairs, units)
        _check_axes(parameters)
    declared = "\n".join(f"    real {field}; /* [{_comment(units.get(field, '1'))}] */" for field, _ in pairs)
    constants = "\n".join(f"    {_literal(float(value))}, /* {field} */" for field, value in pairs)
    begin, sample = _start(controller), _step(controller)
    limits = "\n".join(text for function, text in LIMITS.items() if f"{function}(" in begin + sample)
    stepping = tuple(v.name for v in (*controller.measurements, *controller.commands))
    starting = (*stepping, *(f"{v.name}_now" for v in controller.outputs[: controller.drives]))
    drives = ", ".join(f"{v.name}_now" for v in controller.outputs[: controller.drives])
    return TEMPLATE.format(
        name=name,
        head=head,
        compile=COMPILE,
        precision=precision.value,
        declared=declared,
        constants=constants,
        capitals=name.upper(),
        states=_fields(controller.states, f"{name}_real"),
        outputs=_fields(controller.outputs, f"{name}_real"),
        declared_start=_arguments(f"{name}_real", *starting),
        declared_step=_arguments(f"{name}_real", *stepping),
        start_arguments=_arguments("real", *starting),
        step_arguments=_arguments("real", *stepping),
        limits=limits,
        drives=drives,
        begin=begin,
        sample=sample,
    )


def _check_single(pairs: Sequence[tuple[str, float]], units: Mapping[str, str]) -> None:
    """Refuse what would become infinite or lose its digits: C rounds a constant without a word."""
    limits = np.finfo(np.float32)
    for field, value in pairs:
        if math.isfinite(value) and value != 0.0 and not float(limits.tiny) <= abs(value) <= float(limits.max):
            limit = f"{float(limits.tiny):.3g} to {float(limits.max):.3g} in magnitude, or 0, in single precision"
            raise out_of_range(f"parameter {field}", value, units.get(field, ""), limit, "export in double precision")


def _check_axes(parameters: Any) -> None:
    """Refuse a schedule two of whose nodes become one: what lies between them is divided by their distance."""
    tables = getattr(parameters, "tables", None)
    if isinstance(tables, ScheduleTables):
        for axis, nodes in (("first", tables.first), ("second", tables.second)):
            near = np.flatnonzero(np.diff(np.asarray(nodes, dtype=np.float32)) <= 0.0)
            if near.size:
                low, high = nodes[near[0] : near[0] + 2]
                message = (
                    f"nodes {low!r} and {high!r} of the schedule's {axis} axis are one number in single precision; leave one out, or export"
                    " in double precision"
                )
                raise InvalidInputError(message, low=low, high=high)


def _start(controller: SampledController) -> str:
    y, r, u, _ = _symbols(controller)
    results = controller.start(named_parameters(controller.parameters), y, r, u)
    names = [f"state.{v.name}" for v in controller.states]
    unused = [*controller.measurements, *controller.commands]
    text = _code(write_statements(results, names, _literal), results=frozenset(names))
    silenced = "".join(f"    (void){v.name};\n" for v in unused if not re.search(rf"\b{v.name}\b", text))
    return f"    (void)p;\n{silenced}{text}".rstrip()


def _step(controller: SampledController) -> str:
    y, r, _, t = _symbols(controller)
    xd = tuple(given(f"state->{v.name}") for v in controller.states)
    results = controller.update(named_parameters(controller.parameters), xd, y, r, t)
    count = len(controller.states)
    following = [f"next_{v.name}" for v in controller.states]
    names = [*following, *(f"output.{v.name}" for v in controller.outputs)]
    text = _code(write_statements(results, names, _literal), results=frozenset(names[count:]))
    stored = "\n".join(f"    state->{v.name} = {name};" for v, name in zip(controller.states, following, strict=True))
    silenced = "" if re.search(r"\bseconds\b", text) else "    (void)seconds;\n"
    return f"{silenced}{text}{stored}"


def _symbols(controller: SampledController) -> tuple[tuple[Operation, ...], ...]:
    return (
        tuple(given(v.name) for v in controller.measurements),
        tuple(given(v.name) for v in controller.commands),
        tuple(given(f"{v.name}_now") for v in controller.outputs[: controller.drives]),
        (given("seconds"),),
    )


def _code(statements: tuple[Statement, ...], *, results: frozenset[str]) -> str:
    lines = []
    for statement in statements:
        text = _in_c(statement.expression)
        lines.append(f"    {statement.name} = {text};" if statement.name in results else f"    const real {statement.name} = {text};")
    return "\n".join(lines) + "\n"


def _in_c(text: str) -> str:
    return re.sub(r"\b(fmin|fmax)\(", lambda found: FUNCTIONS[found.group()], text)


def _fields(variables: tuple[Variable, ...], kind: str) -> str:
    return "\n".join(f"    {kind} {v.name}; /* [{_comment(v.unit)}] {_comment(v.description)} */" for v in variables)


def _arguments(kind: str, *names: str) -> str:
    return ", ".join(f"{kind} {name}" for name in names)


def _literal(value: float) -> str:
    """Write a number so that the compiler reads the same bits."""
    if math.isinf(value):
        return "(real)(1.0 / 0.0)" if value > 0.0 else "(real)(-1.0 / 0.0)"
    return f"(real){value!r}" if value >= 0.0 else f"(real)({value!r})"


def _comment(text: str) -> str:
    """Text that can neither end a comment nor begin one in it."""
    return " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *")
