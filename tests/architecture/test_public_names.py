"""`revline.__all__` is the public list: sorted, whole, importable name by name, and cheap until a name is used."""

import ast
import importlib
import inspect
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

import revline

SOURCE = (Path(__file__).parents[2] / "src" / "revline" / "__init__.py").read_text()
HEAVY = ("numba", "scipy.optimize", "matplotlib", "numpy", "typst", "pydantic")


def home_of() -> dict[str, str]:
    homes: Mapping[str, tuple[str, ...]] = vars(revline)["_HOMES"]
    return {name: home for home, names in homes.items() for name in names}


def typed_names(source: str) -> dict[str, str]:
    """Names that type checkers see: those imported under TYPE_CHECKING, with their modules."""
    found = {}
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.If) and isinstance(statement.test, ast.Name) and statement.test.id == "TYPE_CHECKING":
            for line in statement.body:
                assert isinstance(line, ast.ImportFrom)
                found.update({alias.asname or alias.name: str(line.module) for alias in line.names})
    return found


def defined_names(source: str) -> set[str]:
    """Names without underscore that a module binds itself, its imports left out."""
    found: set[str] = set()
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            found.add(statement.name)
        elif isinstance(statement, ast.Assign):
            found |= {target.id for target in statement.targets if isinstance(target, ast.Name)}
    return {name for name in found if not name.startswith("_")}


def natural_order(names: Iterable[str]) -> list[str]:
    """Constants, then classes, then functions, each sorted: the order that the linter keeps too."""
    return sorted(names, key=lambda name: (0 if name.isupper() and len(name) > 1 else 1 if name[0].isupper() else 2, name))


def loaded_by(statement: str, *heavy: str) -> list[str]:
    """Which of some modules a fresh process has loaded after a statement."""
    program = f"{statement}\nimport sys\nprint(*(name for name in {heavy!r} if name in sys.modules))"
    environment = {"PYTHONPATH": str(Path(revline.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)  # noqa: S603 - our own program
    return done.stdout.split()


def test_the_list_is_sorted_and_names_nothing_twice() -> None:
    assert list(revline.__all__) == natural_order(set(revline.__all__))


def test_the_order_is_told_from_disorder() -> None:
    assert natural_order(["b", "A", "LIMIT", "a"]) == ["LIMIT", "A", "a", "b"]


def test_list_table_and_type_checkers_agree() -> None:
    assert set(home_of()) == set(revline.__all__)
    assert typed_names(SOURCE) == home_of()


def test_a_name_missing_for_type_checkers_is_seen() -> None:
    planted = SOURCE.replace("    from revline.equations import equation\n", "")
    assert set(home_of()) - set(typed_names(planted)) == {"equation"}


def test_nothing_else_is_public() -> None:
    assert defined_names(SOURCE) == set()
    assert {name for name in dir(revline) if not name.startswith("_")} >= set(revline.__all__)
    strays = {name for name, value in vars(revline).items() if not name.startswith("_") and not inspect.ismodule(value)}
    assert strays - {"MappingProxyType", "TYPE_CHECKING"} <= set(revline.__all__)


def test_a_stray_public_name_is_seen() -> None:
    assert defined_names("extra = 1\n_own = 2\ndef helper(): ...") == {"extra", "helper"}


@pytest.mark.parametrize("name", revline.__all__)
def test_each_name_comes_from_its_module_with_a_text(name: str) -> None:
    value = getattr(revline, name)
    assert value is getattr(importlib.import_module(home_of()[name]), name)
    assert inspect.getdoc(value)


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="module 'revline' has no attribute 'engin'"):
        _ = revline.engin  # type: ignore[attr-defined]  # the mistake under test


def test_importing_revline_loads_nothing_heavy() -> None:
    assert loaded_by("import revline", *HEAVY) == []


def test_a_heavy_import_is_seen() -> None:
    assert loaded_by("import revline, numpy", *HEAVY) == ["numpy"]


def test_errors_and_units_load_no_numerics() -> None:
    assert loaded_by("from revline import RevlineError, rpm_to_speed", *HEAVY) == []


def test_building_the_engine_loads_no_compiler_and_no_plots() -> None:
    assert loaded_by("import revline; revline.lee1995()", "numba", "scipy.optimize", "matplotlib", "typst") == []
