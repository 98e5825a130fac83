"""What the repository as a whole keeps to: no foreign words, claims with tests, pinned packages, faithful copies, fragments in form."""

import ast
import filecmp
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "src" / "revline" / "studies" / "reference"
ORIGINALS = ROOT.parent / "shared"  # where the checkout has its originals beside it

# Written with classes of one letter, so that this file does not hold what it forbids.
FOREIGN = re.compile(
    r"(?:^|[^\w.])/(?:wor[k]|far[m]|roo[t]|hom[e]/\w+|mn[t]|Users)/"
    r"|pypi\.or[g]|pythonhosted\.or[g]|registry\.npmj[s]|files\.pythonhoste[d]"
    r"|https?://[^ ]*(?:/simpl[e]/|/package[s]/|\.wh[l]\b|\.tg[z]\b|\.de[b]\b)"
    r"|(?:extra-)?index-ur[l]\s*[= ]\s*http|find[-_]link[s]\s*[= ]\s*\S*/"
    r"|suba[g]ent|developers?.? sessi[o]n",
    re.IGNORECASE | re.MULTILINE,
)
CHANGE_KINDS = ("added", "changed", "fixed", "removed")
FRAGMENT = re.compile(r"^[a-z0-9][a-z0-9-]*\.(?:" + "|".join(CHANGE_KINDS) + r")\.md$")


def repository_files() -> list[Path]:
    """All files under version control; outside of a checkout, all that are no results or caches."""
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S607 - git from PATH, as everywhere
    if done.returncode == 0 and done.stdout:
        paths = [ROOT / name for name in done.stdout.split("\0") if name]
    else:
        made = {".venv", ".git", "out", "_build", "_generated", "__pycache__", "build", "dist"}
        paths = [path for path in ROOT.rglob("*") if not made & set(path.parts)]
    return sorted(path for path in paths if path.is_file() and not path.is_symlink())


def foreign_words(text: str) -> list[str]:
    """Words that name a machine, a package host or a workplace."""
    return [match.group().strip() for match in FOREIGN.finditer(text)]


def claimed_tests(text: str) -> list[str]:
    """Tests named in the claims' table, as path::name; a row without one gives an empty text."""
    rows = [line for line in text.splitlines() if line.startswith("|")][2:]
    return [name for row in rows for name in (re.findall(r"`(tests/[\w/]+\.py::\w+)`", row) or [""])]


def stands(name: str) -> bool:
    """Whether a test named as path::function stands in the tests."""
    path, _, function = name.partition("::")
    if not function or not (ROOT / path).is_file():
        return False
    tree = ast.parse((ROOT / path).read_text())
    return any(isinstance(node, ast.FunctionDef) and node.name == function for node in ast.walk(tree))


def pins(text: str) -> dict[str, set[str]]:
    """Pinned versions by name."""
    found: dict[str, set[str]] = {}
    for name, version in re.findall(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", text, re.MULTILINE):
        found.setdefault(canonicalize_name(name), set()).add(version)
    return found


def unmet(requirement: str, pinned: dict[str, set[str]]) -> bool:
    """Whether no pinned version, or one outside the range, stands for a requirement."""
    wanted = Requirement(requirement)
    versions = pinned.get(canonicalize_name(wanted.name), set())
    return not versions or not all(wanted.specifier.contains(version) for version in versions)


def requirement_text(name: str) -> str:
    return (ROOT / "requirements" / f"{name}.txt").read_text()


def test_the_repository_speaks_of_the_project_alone() -> None:
    files = repository_files()
    assert len(files) > 30
    found = [
        f"{path.relative_to(ROOT)}: {word}" for path in files for word in foreign_words(path.read_bytes().decode("utf-8", errors="ignore"))
    ]
    assert found == []


@pytest.mark.parametrize(
    "planted",
    [
        "see /wor" + "k/shared",
        "cd /roo" + "t/project",
        "--index-ur" + "l https://host.example/x",
        "https://pypi.or" + "g/project/x",
        "http://host.example/simpl" + "e/numpy",
        "https://host.example/a-1.0.wh" + "l",
        "written by a suba" + "gent",
        "PIP_FIND_LINK" + "S=/opt/wheels",
    ],
)
def test_planted_foreign_words_are_found(planted: str) -> None:
    assert foreign_words(planted) != []


@pytest.mark.parametrize(
    "sound", ["rework/this", "https://doi.org/10.25549/usctheses-c16-662", "src/root/x", "/etc/hosts", "a framework / b"]
)
def test_ordinary_words_pass(sound: str) -> None:
    assert foreign_words(sound) == []


def test_each_claim_names_tests_that_exist() -> None:
    names = claimed_tests((ROOT / "docs" / "claims.md").read_text())
    assert names
    assert [name for name in names if not stands(name)] == []


def test_planted_claims_are_found() -> None:
    head = "| claim | test |\n|---|---|\n"
    here = f"tests/architecture/{Path(__file__).name}"
    assert [stands(name) for name in claimed_tests(f"{head}| true | `{here}::test_planted_claims_are_found` |")] == [True]
    assert [stands(name) for name in claimed_tests(f"{head}| no such test | `{here}::test_nothing` |")] == [False]
    assert [stands(name) for name in claimed_tests(f"{head}| no such file | `tests/none.py::test_x` |")] == [False]
    assert [stands(name) for name in claimed_tests(f"{head}| nothing named | seen by eye |")] == [False]


def test_every_requirement_is_pinned_with_hashes_and_without_hosts() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    groups = project["dependency-groups"]
    run = [*project["project"]["dependencies"], *project["project"]["optional-dependencies"]["report"], *groups["build"]]
    development = [*run, *(entry for entry in groups["dev"] if isinstance(entry, str))]
    for name, wanted in (("run", run), ("dev", development), ("bench", groups["bench"])):
        text = requirement_text(name)
        assert [entry for entry in wanted if unmet(entry, pins(text))] == []
        blocks = re.split(r"\n(?=[A-Za-z0-9])", text)[1:]
        assert [block.splitlines()[0] for block in blocks if "--hash=sha256:" not in block] == []
        assert not re.search(r"://|--(?:index|extra|find|trusted)", text)


def test_a_missing_or_old_pin_is_found() -> None:
    pinned = pins("numpy==1.26.0 \\\n    --hash=sha256:0\nScikit_X==2.0 ; python_full_version < '3.12' \\\n")
    assert pinned == {"numpy": {"1.26.0"}, "scikit-x": {"2.0"}}
    assert unmet("numpy>=2.0", pinned)
    assert unmet("scipy", pinned)
    assert not unmet("scikit-x>=1", pinned)


def test_what_runs_is_pinned_alike_for_developers() -> None:
    run, development = pins(requirement_text("run")), pins(requirement_text("dev"))
    assert {name: development.get(name) for name in run} == run


def test_what_benchmarks_need_is_pinned_alike_for_developers() -> None:
    """Peers are added to a developer's environment, which must stay what it is."""
    bench, development = pins(requirement_text("bench")), pins(requirement_text("dev"))
    shared = bench.keys() & development.keys()
    assert {"numpy", "scipy", "numba"} <= shared
    assert {name: bench[name] for name in shared} == {name: development[name] for name in shared}


def test_change_fragments_have_the_form() -> None:
    names = [path.name for path in (ROOT / "changelog.d").iterdir() if path.name != "README.md"]
    assert [name for name in names if not FRAGMENT.match(name)] == []
    assert not FRAGMENT.match("Some change.md")
    assert not FRAGMENT.match("engine.improved.md")


def test_tests_and_studies_read_one_set_of_reference_tables() -> None:
    assert (ROOT / "tests" / "reference").resolve() == REFERENCE.resolve()
    assert {path.name for path in REFERENCE.iterdir()} >= {"table_4_1.csv", "linear_models.toml", "controllers.toml", "figures.csv"}


@pytest.mark.skipif(not ORIGINALS.is_dir(), reason="the originals do not lie beside this checkout")
@pytest.mark.parametrize(("original", "copy"), [("reference", "src/revline/studies/reference"), ("acceptance", "tests/acceptance")])
def test_copies_equal_their_originals(original: str, copy: str) -> None:
    names = [path.name for path in (ORIGINALS / original).iterdir() if path.is_file()]
    assert names
    _, differing, missing = filecmp.cmpfiles(ORIGINALS / original, ROOT / copy, names, shallow=False)
    assert (differing, missing) == ([], [])
