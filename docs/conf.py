"""Settings of the documentation, and the two pages written from the code at each build: public names and modules."""

import ast
import inspect
import pkgutil
import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
SOURCE = HERE.parent / "src"
sys.path.insert(0, str(SOURCE))

import revline  # noqa: E402 - found through the path above

project = "revline"
author = "The revline developers"
copyright = author  # noqa: A001 - Sphinx reads this name
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "sphinxcontrib.bibtex"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "revline"
html_static_path: list[str] = []
html_show_sourcelink = False

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_custom_sections = ["Source"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
python_maximum_signature_line_length = 100

bibtex_bibfiles = ["sources.bib"]
bibtex_default_style = "unsrt"
bibtex_reference_style = "author_year"

nitpick_ignore_regex = [
    # Pages are built without a network, so names outside of revline have no page to point to.
    (r"py:.*", r"(?!revline[.$]).*"),
    # Type variables and parameter specifications, named by one capital letter, have no page.
    (r"py:(class|obj)", r"revline\.(\w+\.)*[A-Z]"),
]

# Records may share the name of a field; a text that names it means its own record's.
suppress_warnings = ["ref.python"]

GENERATED = HERE / "_generated"
MARKED = re.compile(r"(``.+?``|`[^`]+`_?)")


def public_page() -> str:
    """Each public name with the first line of its text."""
    homes = {name: home for home, names in vars(revline)["_HOMES"].items() for name in names}
    lines = ["# Public names", "", "What `revline.__all__` names, and nothing else, is public.", "", "| name | what |", "|---|---|"]
    for name in revline.__all__:
        value = getattr(revline, name)
        role = "class" if isinstance(value, type) else "func" if callable(value) else "data"
        text = (inspect.getdoc(value) or "").splitlines() if role != "data" else []
        first = text[0].replace("|", r"\|") if text else ""
        lines.append(f"| {{py:{role}}}`{name} <{homes[name]}.{name}>` | {first} |")
    return "\n".join(lines) + "\n"


def modules_page() -> str:
    """Each module with all that it documents, for readers of the code."""
    names = sorted(info.name for info in pkgutil.walk_packages(revline.__path__, "revline.") if not info.ispkg or has_members(info.name))
    lines = ["# Modules", "", "All modules, for readers of the code; only the [public names](public.md) are promised to stay.", ""]
    for name in names:
        if not name.endswith("__main__"):
            lines += [f"## {name}", "", "```{eval-rst}", f".. automodule:: {name}", "```", ""]
    return "\n".join(lines) + "\n"


def has_members(package: str) -> bool:
    """Whether a package's own file defines anything."""
    text = (SOURCE / Path(*package.split(".")) / "__init__.py").read_text()
    return any(isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Assign) for node in ast.parse(text).body)


def write_pages(_: Sphinx) -> None:
    """Write both pages; an unchanged page keeps its time, so that it is not built again."""
    GENERATED.mkdir(exist_ok=True)
    for name, text in (("public.md", public_page()), ("modules.md", modules_page())):
        path = GENERATED / name
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def keep_bars(_app: Sphinx, _what: str, _name: str, _value: object, _options: object, lines: list[str]) -> None:
    """Docstrings are plain text: |G| is a magnitude there, and no substitution."""
    for number, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            parts = MARKED.split(line)
            lines[number] = "".join(part if MARKED.fullmatch(part) else part.replace("|", r"\|") for part in parts)


def setup(app: Sphinx) -> None:
    """Have the pages written before Sphinx looks for them, and docstrings read as plain text."""
    app.connect("config-inited", lambda application, _: write_pages(application))
    app.connect("autodoc-process-docstring", keep_bars, priority=900)  # after the sections were read
