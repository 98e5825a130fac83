"""What every source file of the project keeps to: sizes, no state at module level, no forbidden statement, a reason at every ignore.

Each check is a function from source text to findings, and is shown to find a planted fault before it is trusted.
"""

import ast
import importlib
import io
import pkgutil
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import revline

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
VERBATIM = ROOT / "tests" / "acceptance" / "check_study.py"
OTHERS = sorted(path for folder in ("tests", "benchmarks", "docs") for path in (ROOT / folder).rglob("*.py") if path != VERBATIM)

MODULE_LINES = 400
PAGE_LINES = 300
FUNCTION_LINES = 50

MUTABLE_LITERALS = (ast.List, ast.Dict, ast.Set, ast.ListComp, ast.DictComp, ast.SetComp)
MUTABLE_CALLS = frozenset(
    {"list", "dict", "set", "bytearray", "defaultdict", "deque", "Counter", "OrderedDict", "ChainMap", "SimpleNamespace"}
    | {"array", "asarray", "zeros", "ones", "empty", "full", "eye", "identity", "diag", "arange", "linspace", "logspace", "geomspace"}
    | {"WeakKeyDictionary", "WeakValueDictionary", "local", "StringIO", "BytesIO", "default_rng"}
)
CONTAINERS = frozenset({"MappingProxyType", "tuple"})
SWALLOWERS = frozenset({"frozenset", "len", "sum", "max", "min", "any", "all"})  # elements of a frozenset are hashable
APP = frozenset({"app"})


def called(call: ast.Call) -> str:
    """Last part of a called name."""
    target = call.func
    return target.attr if isinstance(target, ast.Attribute) else getattr(target, "id", "")


def mutable_values(value: ast.AST) -> Iterator[ast.AST]:
    """Parts of an expression that can change later; what a freezing call swallows cannot."""
    if isinstance(value, ast.Lambda):
        return
    if isinstance(value, ast.Subscript):  # what stands in the brackets is a key or a type, as in Callable[[float], None]
        yield from mutable_values(value.value)
        return
    if isinstance(value, ast.Call):
        if called(value) in MUTABLE_CALLS:
            yield value
        if called(value) in SWALLOWERS:
            return
        if called(value) in CONTAINERS:
            for argument in value.args:
                yield from inner_values(argument)
            return
    elif isinstance(value, MUTABLE_LITERALS):
        yield value
    for child in ast.iter_child_nodes(value):
        yield from mutable_values(child)


def inner_values(frozen: ast.AST) -> Iterator[ast.AST]:
    """Mutable parts one level inside what a freezing call froze: their container is safe, they are not."""
    for child in ast.iter_child_nodes(frozen):
        if isinstance(frozen, ast.BinOp):  # a union of containers, itself frozen
            yield from inner_values(child)
        elif not isinstance(child, ast.comprehension):
            yield from mutable_values(child)


def module_statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements that run on import, into branches but not into functions and classes."""
    for statement in body:
        yield statement
        for field in ("body", "orelse", "finalbody"):
            if not isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                yield from module_statements(getattr(statement, field, []))


def names_of(target: ast.AST) -> Iterator[str]:
    for node in ast.walk(target):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def find_module_state(source: str, *, allowed: frozenset[str] = frozenset()) -> list[str]:
    """Names and lines of whatever a module could change after its import."""
    tree = ast.parse(source)
    found = [f"line {node.lineno}: global statement" for node in ast.walk(tree) if isinstance(node, ast.Global)]
    seen: set[str] = set()
    for statement in module_statements(tree.body):
        if isinstance(statement, ast.For | ast.While | ast.AugAssign | ast.With):
            found.append(f"line {statement.lineno}: a module computes in steps when imported; put them in a function")
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
            base = statement.value.func
            if not (isinstance(base, ast.Attribute) and isinstance(base.value, ast.Name) and base.value.id in allowed):
                found.append(f"line {statement.lineno}: a module calls {called(statement.value)} for its effect when imported")
        if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
            continue
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        names = {name for target in targets for name in names_of(target)}
        found += [f"line {statement.lineno}: {name} is assigned twice" for name in sorted(names & seen)]
        seen |= names
        if not names <= allowed:
            found += [f"line {statement.lineno}: {', '.join(sorted(names))} can be changed" for _ in mutable_values(statement.value)]
    return found


def find_forbidden_statements(source: str) -> list[str]:
    """Lines with an assert, a print or a star import."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assert):
            found.append(f"line {node.lineno}: assert")
        elif isinstance(node, ast.ImportFrom) and any(alias.name == "*" for alias in node.names):
            found.append(f"line {node.lineno}: import *")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
            found.append(f"line {node.lineno}: print")
    return found


def code_lines(source: str) -> set[int]:
    """Lines that hold code: no comment, no blank line."""
    idle = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER, tokenize.ENCODING}
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in idle:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return lines


def find_long_functions(source: str, limit: int = FUNCTION_LINES) -> list[str]:
    """Functions with more lines of code than the limit, their docstrings not counted."""
    lines = code_lines(source)
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        own = {line for line in lines if node.lineno <= line <= (node.end_lineno or node.lineno)}
        if ast.get_docstring(node) is not None:
            text = node.body[0]
            own -= set(range(text.lineno, (text.end_lineno or text.lineno) + 1))
        if len(own) > limit:
            found.append(f"line {node.lineno}: {node.name} has {len(own)} lines of code")
    return found


DIRECTIVES = re.compile(r"#\s*(?:noqa|type:\s*ignore|ruff:\s*noqa|mypy:|pragma:)[^#\s]*", re.IGNORECASE)
WITH_REASON = re.compile(
    r"^(?:# noqa: [A-Z]+\d+(?:, ?[A-Z]+\d+)* - \S+.*|# type: ignore\[[\w, -]+\] +# (?:noqa: [A-Z]+\d+(?:, ?[A-Z]+\d+)* - )?(?!noqa)\S+.*)$"
)


def find_bare_ignores(source: str) -> list[str]:
    """Comments that silence a checker without codes and a reason of at least two words."""
    found = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT or not DIRECTIVES.match(token.string):
            continue
        reason = re.split(r" - | # ", token.string)[-1]
        if not WITH_REASON.match(token.string) or len(reason.split()) < 2:
            found.append(f"line {token.start[0]}: {token.string}")
    return found


def walk_package(package: ModuleType = revline) -> list[ModuleType]:
    names = [info.name for info in pkgutil.walk_packages(package.__path__, "revline.") if not info.name.endswith("__main__")]
    return [importlib.import_module(name) for name in names]


def find_mutable_globals(module: ModuleType, *, allowed: frozenset[str] = frozenset()) -> list[str]:
    """Globals of an imported module whose value can be changed, whatever made it."""
    found = []
    for name, value in vars(module).items():
        if name.startswith("__") or name in allowed:
            continue
        changeable = isinstance(value, list | dict | set | bytearray) or (isinstance(value, np.ndarray) and value.flags.writeable)
        if changeable:
            found.append(f"{module.__name__}.{name} is a {type(value).__name__}")
    return found


def allowed_in(path: Path) -> frozenset[str]:
    """The command line's `app` is the one value at module level that commands are added to."""
    return APP if path.relative_to(ROOT / "src" / "revline").as_posix() == "cli/__init__.py" else frozenset()


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_there_are_sources_to_check() -> None:
    assert len(SOURCES) > 10
    assert OTHERS


@pytest.mark.parametrize("path", SOURCES + OTHERS, ids=relative)
def test_modules_are_short(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= MODULE_LINES


def test_the_page_s_modules_are_short() -> None:
    lengths = {path.name: len(path.read_text().splitlines()) for path in (ROOT / "page" / "src").glob("*.ts")}
    assert "main.ts" in lengths
    assert {name: lines for name, lines in lengths.items() if lines > PAGE_LINES} == {}


@pytest.mark.parametrize("path", SOURCES + OTHERS, ids=relative)
def test_functions_are_short_and_ignores_say_why(path: Path) -> None:
    source = path.read_text()
    assert find_long_functions(source) == []
    assert find_bare_ignores(source) == []


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_sources_hold_no_state_and_no_forbidden_statement(path: Path) -> None:
    source = path.read_text()
    assert find_module_state(source, allowed=allowed_in(path)) == []
    assert find_forbidden_statements(source) == []


def test_imported_modules_hold_nothing_that_changes() -> None:
    found = [
        line
        for module in walk_package()
        for line in find_mutable_globals(module, allowed=APP if module.__name__ == "revline.cli" else frozenset())
    ]
    assert found == []


@pytest.mark.parametrize(
    "planted",
    [
        "cache = {}",
        "seen: list[int] = []",
        "names = [n for n in 'ab']",
        "table = (1, [2])",
        "import collections\ncounts = collections.defaultdict(int)",
        "import numpy as np\ngrid = np.linspace(0, 1, 5)",
        "frozen = MappingProxyType({'a': []})",
        "frozen = MappingProxyType({'a': 1} | {'b': []})",
        "if True:\n    cache = dict()",
        "def f():\n    global x\n    x = 1",
        "x = 1\nx = 2",
        "x = 1\nx += 1",
        "for k in range(3):\n    y = k",
        "sys.path.append('here')",
        "app = {}",
    ],
)
def test_planted_state_is_found(planted: str) -> None:
    assert find_module_state(planted) != []


@pytest.mark.parametrize(
    "sound",
    [
        "from types import MappingProxyType\ntable = MappingProxyType({'a': 1, 'b': (2, 3)})",
        "names = frozenset({'a'} | {'b'})",
        "table = MappingProxyType({'a': 1} | {'b': 2})",
        "powers = tuple(2**k for k in range(3))",
        "ordered = tuple([1, 2])",
        "import functools\n@functools.cache\ndef f():\n    made = []\n    return made",
        "class A:\n    def f(self):\n        return [1]",
        "Name = Annotated[float, Unit('m')]",
        "Kernel = Callable[[float, float], None]",
    ],
)
def test_frozen_values_pass(sound: str) -> None:
    assert find_module_state(sound) == []


def test_the_exception_for_the_command_line_is_its_app_alone() -> None:
    assert find_module_state("app = Typer()\napp.add_typer(other)", allowed=APP) == []
    assert find_module_state("app = Typer()\nother = {}", allowed=APP) != []
    assert find_module_state("app = Typer()\nregister(app)", allowed=APP) != []


def test_planted_mutable_global_is_found_at_run_time() -> None:
    module = ModuleType("planted")
    module.__dict__.update(names=["a"], grid=np.zeros(2), limit=1.0)
    assert find_mutable_globals(module) == ["planted.names is a list", "planted.grid is a ndarray"]


@pytest.mark.parametrize("planted", ["assert x", "from math import *", "def f():\n    print(1)"])
def test_planted_statement_is_found(planted: str) -> None:
    assert len(find_forbidden_statements(planted)) == 1


def test_planted_long_function_is_found_and_texts_do_not_count() -> None:
    lines = "\n".join(f"    x{k} = {k}" for k in range(5))
    text = '    """' + "\n" * 60 + '"""'
    assert find_long_functions(f"def f():\n{text}\n    # why\n\n{lines}", limit=6) == []
    assert find_long_functions(f"def f():\n{text}\n{lines}", limit=5) == ["line 1: f has 6 lines of code"]


@pytest.mark.parametrize(
    "planted",
    [
        "x = 1  # noqa",
        "x = 1  # noqa: E501",
        "x = 1  # noqa: E501 - long",
        "x = 1  # type: ignore",
        "x = 1  # type: ignore[assignment]",
        "x = 1  # type: ignore  # the stubs are wrong",
        "x = 1  # type: ignore[assignment]  # noqa: E501",
    ],
)
def test_planted_bare_ignore_is_found(planted: str) -> None:
    assert len(find_bare_ignores(planted)) == 1


@pytest.mark.parametrize(
    "sound",
    [
        "x = 1  # noqa: ARG001 - the form of all equations",
        "x = 1  # noqa: ARG001, E501 - the form of all equations",
        "x = 1  # type: ignore[assignment]  # a traced value has no hash",
        "x = 1  # type: ignore[assignment]  # noqa: E501 - the stubs are wrong",
        "x = '# noqa'",
    ],
)
def test_ignores_with_reasons_pass(sound: str) -> None:
    assert find_bare_ignores(sound) == []
