"""Every Python example on the pages of the documentation and in the README runs, and shows what it says it shows."""

import doctest
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    if not {"_build", "_generated"} & set(path.relative_to(ROOT).parts)
)
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OPTIONS = doctest.ELLIPSIS


def blocks(text: str) -> list[tuple[int, str]]:
    """Python blocks of a page with the line they start at."""
    return [(text.count("\n", 0, match.start(1)) + 1, match.group(1)) for match in BLOCK.finditer(text)]


def run_page(name: str, text: str) -> list[str]:
    """Run a page's blocks one after another in one namespace; what differs from what they show comes back."""
    namespace: dict[str, Any] = {"__name__": "example"}
    reports: list[str] = []
    for line, block in blocks(text):
        if ">>>" not in block:
            exec(compile("\n" * (line - 1) + block, name, "exec"), namespace)  # noqa: S102 - the page's own example
            continue
        example = doctest.DocTestParser().get_doctest(block, namespace, f"{name}:{line}", name, line)
        runner = doctest.DocTestRunner(optionflags=OPTIONS)
        runner.run(example, out=reports.append, clear_globs=False)
        namespace.update(example.globs)
    return reports


def test_there_are_pages_with_examples() -> None:
    assert sum(len(blocks(path.read_text())) for path in PAGES) >= 4


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_examples_of_a_page_run(path: Path) -> None:
    assert run_page(path.name, path.read_text()) == []


def test_a_planted_wrong_result_is_found() -> None:
    page = "text\n\n```python\nx = 1\n```\n\n```python\n>>> x + 1\n3\n```\n"
    (report,) = run_page("page", page)
    assert "Expected:\n    3\nGot:\n    2" in report


def test_a_planted_wrong_message_is_found() -> None:
    page = "```python\n>>> raise ValueError('a')\nTraceback (most recent call last):\nValueError: b\n```\n"
    assert len(run_page("page", page)) == 1


def test_a_planted_failing_block_is_found() -> None:
    with pytest.raises(NameError, match="nothing"):
        run_page("page", "```python\nnothing\n```\n")
