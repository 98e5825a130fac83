"""Daily work, one session per kind of check; `nox` alone runs what CI runs. All use the pinned environment that make keeps."""

import nox

nox.options.default_venv_backend = "none"
nox.options.error_on_external_run = False
nox.options.sessions = ["tests", "lint", "types", "docs", "study"]


@nox.session
def fmt(session: nox.Session) -> None:
    """Format, and mend what can be mended."""
    session.run("make", "--silent", ".venv/.dev")
    session.run(".venv/bin/ruff", "format")
    session.run(".venv/bin/ruff", "check", "--fix")


@nox.session
def lint(session: nox.Session) -> None:
    """Style, spelling and layers."""
    session.run("make", "style", "architecture")


@nox.session
def types(session: nox.Session) -> None:
    """Types of src and tests."""
    session.run("make", "types")


@nox.session
def tests(session: nox.Session) -> None:
    """Every test, or those given after --."""
    if session.posargs:
        session.run("make", "--silent", ".venv/.dev")
        session.run(".venv/bin/python", "-m", "pytest", *session.posargs)
    else:
        session.run("make", "test")


@nox.session
def docs(session: nox.Session) -> None:
    """The documentation, without a warning."""
    session.run("make", "docs")


@nox.session
def study(session: nox.Session) -> None:
    """The whole study, checked against published and converged values."""
    session.run("make", "study", "acceptance")


@nox.session
def bench(session: nox.Session) -> None:
    """Speed, against the budgets."""
    session.run("make", "bench")
