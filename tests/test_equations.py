import importlib.util
import math
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.equations import ALLOWED_FUNCTIONS, equation, equation_digest, reached_functions, trace
from revline.errors import InvalidInputError

GAIN = 2.0
TABLE = np.array([1.0, 2.0])


class Constants(Enum):
    FIRST = 1.5


def traced(function: Callable[[Any, Any], Any], length: int = 3) -> tuple[frozenset[str], ...]:
    return trace(function, (3.0,), ("x", length))


def test_an_equation_stays_the_function_it_is() -> None:
    @equation
    def double(value: float) -> float:
        return 2.0 * value

    assert double(4.0) == 8.0
    assert double.__dict__["is_equation"] is True


def test_each_result_names_what_it_was_computed_from() -> None:
    def f(p: Any, x: Any, u: Any) -> Any:
        a, b, _ = x
        return a * p[0], np.exp(-b) + u[0], 1.0, 2.0 ** (a / b) - (+u[1]), 0.0 * a

    found = trace(f, (3.0,), ("x", 3), ("u", 2))
    assert [" ".join(sorted(names)) for names in found] == ["x0", "u0 x1", "", "u1 x0 x1", "x0"]


@pytest.mark.parametrize("name", sorted(ALLOWED_FUNCTIONS))
def test_an_allowed_function_traces_and_keeps_its_derivative(name: str) -> None:
    function = getattr(np, name)
    count = function.nin
    names = frozenset(f"x{k}" for k in range(count))
    assert traced(lambda _, x: (function(*x[:count]),)) == (names,)

    point, step = (0.7, 1.3)[:count], 1e-30
    for k in range(count):
        bumped = tuple(value + 1j * step * (i == k) for i, value in enumerate(point))
        exact = function(*bumped).imag / step
        above, below = (function(*(v + h * (i == k) for i, v in enumerate(point))) for h in (1e-6, -1e-6))
        assert exact == pytest.approx((above - below) / 2e-6, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("name", ["radians", "absolute", "hypot", "arctan2", "sign", "heaviside", "floor", "rint", "fmax", "greater"])
def test_a_function_without_derivative_is_refused(name: str) -> None:
    function = getattr(np, name)
    with pytest.raises(
        InvalidInputError, match=rf"calls numpy\.{name}, which does not keep derivatives; use one of add, cos, cosh, .*tanh$"
    ):
        traced(lambda _, x: (function(*x[: function.nin]),))


@pytest.mark.parametrize("name", ["interp", "where", "clip", "sum"])
def test_functions_that_are_no_ufunc_are_refused_too(name: str) -> None:
    arguments = {
        "interp": lambda x: (x[0], (0.0, 1.0), (0.0, 1.0)),
        "where": lambda x: (x[0], 1.0, x[1]),
        "clip": lambda x: (x[0], 0.0, 1.0),
    }
    call = arguments.get(name, lambda x: (np.array([x[0], x[1]], dtype=object).reshape(1, 2), 0))
    with pytest.raises(InvalidInputError, match=r"an equation|no floating-point scalar"):
        traced(lambda _, x: (getattr(np, name)(*call(x)),))


def test_a_method_of_a_function_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"calls numpy\.add, which does not keep derivatives"):
        traced(lambda _, x: (np.add.reduce(x[0]),))


DECISIONS: dict[str, Callable[[Any], Any]] = {
    "if": lambda x: 1.0 if x[0] else 0.0,
    "less": lambda x: x[0] < 1.0,
    "less or equal": lambda x: x[0] <= 1.0,
    "greater": lambda x: x[0] > 1.0,
    "greater or equal": lambda x: x[0] >= x[1],
    "equal": lambda x: x[0] == 0.0,
    "unequal": lambda x: x[0] != 0.0,
    "chained": lambda x: 0.0 < x[0] < 1.0,
    "and": lambda x: x[0] and x[1],
    "not": lambda x: not x[0],
    "abs": lambda x: abs(x[0]),
    "min": lambda x: min(x[0], 1.0),
    "max": lambda x: max(1.0, x[0]),
    "sorted": lambda x: sorted(x)[0],
    "in": lambda x: x[0] in (1.0, 2.0),
}


@pytest.mark.parametrize("name", DECISIONS)
def test_a_decision_on_a_value_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=r"decides on a value \(if, <, >, == or abs\); write the limit with numpy\.minimum or"):
        traced(lambda _, x: (DECISIONS[name](x),))


ROUNDINGS: dict[str, Callable[[Any], Any]] = {
    "floor division": lambda x: x[0] // 2.0,
    "division of": lambda x: 2.0 // x[0],
    "remainder": lambda x: x[0] % 2.0,
    "remainder of": lambda x: 2.0 % x[0],
    "divmod": lambda x: divmod(x[0], 2.0)[0],
    "divmod of": lambda x: divmod(2.0, x[0])[0],
    "round": lambda x: round(x[0], 2),
    "int": lambda x: int(x[0]),
    "math.floor": lambda x: math.floor(x[0]),
    "math.ceil": lambda x: math.ceil(x[0]),
    "math.trunc": lambda x: math.trunc(x[0]),
    "index": lambda x: (1.0, 2.0)[x[0]],
}


@pytest.mark.parametrize("name", ROUNDINGS)
def test_rounding_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=r"rounds a value \(//, %, round or int\), which has no derivative; write it without"):
        traced(lambda _, x: (ROUNDINGS[name](x),))


@pytest.mark.parametrize("function", [math.sin, math.fabs, float, complex], ids=lambda f: f.__name__)
def test_a_conversion_is_refused(function: Callable[[Any], Any]) -> None:
    with pytest.raises(
        InvalidInputError, match=r"turns a value into a plain float \(float or a function of math\), .*; use numpy's functions"
    ):
        traced(lambda _, x: (function(x[0]),))


@pytest.mark.parametrize(("result", "shown"), [(0, "0"), (True, "True"), (None, "None"), ("a", "'a'"), (np.ones(2), r"array\(.*")])
def test_a_result_that_is_no_float_is_refused(result: object, shown: str) -> None:
    def bad(p: Any, x: Any) -> Any:  # noqa: ARG001 - the form of all equations
        return 1.0, result

    with pytest.raises(InvalidInputError, match=rf"^equation bad, result 1: {shown} is no floating-point scalar; write 0\.0, not 0$"):
        traced(bad)


@pytest.mark.parametrize(
    "wrap", [list, lambda results: results[0], lambda results: np.array(results, dtype=object)], ids=["list", "bare", "array"]
)
def test_results_that_are_no_tuple_are_refused(wrap: Callable[[Any], Any]) -> None:
    def bad(p: Any, x: Any) -> Any:  # noqa: ARG001 - the form of all equations
        return wrap((x[0], x[1]))

    with pytest.raises(InvalidInputError, match=r"^equation bad returns \w+; return a tuple of scalars, also for one result: \(value,\)$"):
        traced(bad)


FAILURES: dict[str, tuple[Callable[[Any, Any], Any], str]] = {
    "too few": (lambda p, x: (x[5],), "IndexError: tuple index out of range"),  # noqa: ARG005 - the form of all equations
    "unpacking": (lambda p, x: next(a for a, b in (x,)), "ValueError: too many values to unpack (expected 2)"),  # noqa: ARG005 - the form of all equations
    "no such parameter": (lambda p, x: (p.volume + x[0],), "AttributeError: 'tuple' object has no attribute 'volume'"),
    "division": (lambda p, x: (x[0] + 1.0 / (p[0] - 3.0),), "ZeroDivisionError: float division by zero"),
    "call": (lambda p, x: (p[0](x),), "TypeError: 'float' object is not callable"),
    "text": (lambda p, x: (np.exp(x[0]).real,), "AttributeError: 'Traced' object has no attribute 'real'"),  # noqa: ARG005 - the form of all equations
}


@pytest.mark.parametrize("name", FAILURES)
def test_an_equation_that_fails_is_named_with_its_reason(name: str) -> None:
    function, reason = FAILURES[name]
    expected = f"equation <lambda> fails with its parameters and 3 x: {reason}"
    with pytest.raises(InvalidInputError, match=f"^{re.escape(expected)}") as caught:
        trace(function, (3.0,), ("x", 3))
    assert caught.value.__cause__ is not None


@given(st.lists(st.sampled_from("+-*/^"), max_size=8), st.permutations(range(4)))
def test_a_trace_collects_all_operands_of_any_expression(operators: list[str], order: list[int]) -> None:
    def f(p: Any, x: Any) -> Any:
        value = p[0]
        for operator, k in zip(operators, order * 2, strict=False):
            value = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power}[operator](value, x[k])
        return (value,)

    used = frozenset(f"x{k}" for _, k in zip(operators, order * 2, strict=False))
    assert trace(f, (3.0,), ("x", 4)) == (used,)


def load(path: Path, source: str) -> ModuleType:
    """Write a module and import it afresh, as a new process would."""
    path.write_text(source)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    exec(compile(source, str(path), "exec"), module.__dict__)  # noqa: S102 - the module's own loader may take stale bytecode
    return module


CALLEE = """
import numpy as np
from typing import NamedTuple
from enum import Enum
GAIN = 2.0
LIMITS = (1.0, [3.0, 4.0])
NAMES = frozenset(("a", "b", "c", "d"))
HELPER = np.clip
TABLE = np.linspace(0.0, 1.0, 2000)
class Mode(Enum):
    FAST = 1.0
class Fixed:
    offset = 0.5
def inner(value, scale=2.0, *, shift=0.25):
    return scale * value + shift
def middle(value):
    return GAIN * inner(value) + LIMITS[1][0] + TABLE[7] + len(NAMES) + float(callable(HELPER))
def comprehended(values):
    return sum([inner(value) for value in values])
"""
CALLER = """
import callee
from callee import middle, Mode, Fixed
def rate(p, x):
    return (middle(x[0]) * callee.GAIN + Mode.FAST.value + Fixed.offset,)
def listed(p, x):
    return (callee.comprehended(x),)
def unrelated(p, x):
    return (x[0],)
"""


@pytest.fixture(autouse=True)
def _forget_modules() -> Iterator[None]:
    yield
    for name in ("callee", "caller"):
        sys.modules.pop(name, None)


def run(code: str, environment: dict[str, str]) -> str:
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout  # noqa: S603 - our own code


def digests(folder: Path, callee: str, caller: str = CALLER) -> tuple[str, str, str]:
    load(folder / "callee.py", callee)
    module = load(folder / "caller.py", caller)
    return equation_digest(module.rate), equation_digest(module.listed), equation_digest(module.unrelated)


@pytest.mark.parametrize(
    ("old", "new", "listed_too"),
    [
        ("GAIN = 2.0", "GAIN = 2.0000000000000004", False),
        ("[3.0, 4.0]", "[3.5, 4.0]", False),
        ('"c", "d"', '"c", "e"', False),
        ("HELPER = np.clip", "HELPER = np.interp", False),
        ("np.linspace(0.0, 1.0, 2000)", "np.append(np.linspace(0.0, 1.0, 2000)[:-1], 1.0 + 1e-12)", False),
        ("FAST = 1.0", "FAST = 1.5", False),
        ("offset = 0.5", "offset = 0.75", False),
        ("scale * value + shift", "scale * value - shift", True),
        ("scale=2.0", "scale=3.0", True),
        ("shift=0.25", "shift=0.5", True),
        ("return GAIN * inner(value)", "return GAIN / inner(value)", False),
    ],
)
def test_the_digest_changes_with_any_constant_or_callee_in_another_module(tmp_path: Path, old: str, new: str, *, listed_too: bool) -> None:
    assert CALLEE.count(old) == 1
    rate, listed, unrelated = digests(tmp_path, CALLEE)
    changed = digests(tmp_path, CALLEE.replace(old, new))
    assert changed[0] != rate
    assert (changed[1] != listed) is listed_too
    assert changed[2] == unrelated


def test_the_digest_stays_without_a_change(tmp_path: Path) -> None:
    assert digests(tmp_path, CALLEE) == digests(tmp_path, CALLEE + "\nOTHER = 9.0\n", CALLER + "\nOTHER = 9.0\n")


def test_the_digest_sees_names_beyond_the_first_256(tmp_path: Path) -> None:
    many = "\n".join(f"N{k} = 0.0" for k in range(300))
    caller = many + "\nimport callee\ndef rate(p, x):\n    return (" + " + ".join(f"N{k}" for k in range(300)) + " + callee.GAIN + x[0],)\n"
    caller += "listed = unrelated = rate\n"
    assert digests(tmp_path, CALLEE, caller)[0] != digests(tmp_path, CALLEE.replace("GAIN = 2.0", "GAIN = 3.0"), caller)[0]


def test_the_digest_is_the_same_in_another_process(tmp_path: Path) -> None:
    here = digests(tmp_path, CALLEE)
    code = "import caller; from revline.equations import equation_digest as d; print(d(caller.rate), d(caller.listed), d(caller.unrelated))"
    for seed in ("1", "2"):
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[1] / 'src'}"}
        found = run(code, environment)
        assert tuple(found.split()) == here


def test_the_digest_enters_closures_and_recursion() -> None:
    def make(gain: float) -> Callable[[Any, Any], Any]:
        def power(value: Any, times: int) -> Any:
            return gain * value * power(value, times - 1) if times else 1.0

        return lambda _, x: (power(x[0], 3) * GAIN + TABLE[0] + Constants.FIRST.value,)

    assert equation_digest(make(1.0)) == equation_digest(make(1.0))
    assert equation_digest(make(1.0)) != equation_digest(make(2.0))
    assert len(equation_digest(make(1.0), make(2.0))) == 16


def test_a_compiled_function_counts_as_its_python_code() -> None:
    class Compiled:
        def __init__(self, function: Callable[[float], float]) -> None:
            self.py_func = function

        def __call__(self, value: Any) -> Any:
            return self.py_func(value)

    def make(function: Callable[[float], float]) -> Callable[[Any, Any], Any]:
        compiled = Compiled(function)
        return lambda _, x: (compiled(x[0]),)

    double: Callable[[float], float] = lambda value: 2.0 * value  # noqa: E731 - two functions of equal code, apart in their constant
    triple: Callable[[float], float] = lambda value: 3.0 * value  # noqa: E731 - equal but for its constant
    assert equation_digest(make(double)) == equation_digest(make(double))
    assert equation_digest(make(double)) != equation_digest(make(triple))


def test_a_set_in_the_code_does_not_depend_on_the_order_of_hashes() -> None:
    code = "def f(p, x):\n    return (1.0 if 'a' in {'a', 'b', 'c', 'd', 'e'} else x[0],)\n"
    code += "from revline.equations import equation_digest\nprint(equation_digest(f))"
    found = set()
    for seed in ("1", "2", "3"):
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(__file__).parents[1] / "src")}
        found.add(run(code, environment))
    assert len(found) == 1


def test_reached_functions_come_before_their_callers(tmp_path: Path) -> None:
    digests(tmp_path, CALLEE)
    module = sys.modules["caller"]
    names = [function.__name__ for function in reached_functions(module.rate, module.listed, module.rate)]
    assert names == ["inner", "middle", "rate", "comprehended", "listed"]


def test_reached_functions_end_on_recursion() -> None:
    def even(value: float) -> Any:
        return odd(value - 1.0)

    def odd(value: float) -> Any:
        return even(value - 1.0)

    assert {function.__name__ for function in reached_functions(even)} == {"even", "odd"}
