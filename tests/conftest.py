"""What holds for all tests: properties are not timed, for machines are busy, and a session builds few kernels."""

import os
import signal
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings
from xdist.scheduler.loadscope import LoadScopeScheduling

from revline.cli import THREADS

for _name in THREADS:
    os.environ.setdefault(_name, "1")  # before the first test imports numpy, as the command line does

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

MOST_KERNELS = 25
"""Kernels that one session may build: each costs seconds where the cache is cold. Parameters and inputs need no new ones."""

STUDY = "tests/studies/"
"""Where the tests are that share one computed study, which takes a minute."""

KERNELS = pytest.StashKey[set[str]]()


@pytest.fixture(scope="session", autouse=True)
def _heed_interruptions() -> Iterator[None]:
    """Heed interruptions where a shell started the tests in the background, which ignores them: tests of them would wait for ever."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Where processes share the tests by their modules, begin with those that have slow tests: none is then left over for the end."""
    if hasattr(config, "workerinput"):
        slow = {item.path for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: item.path not in slow)


class SharedStudy(LoadScopeScheduling):  # type: ignore[misc]  # xdist publishes no types
    """Modules are handed out whole, and all about the study to one process, which computes it once."""

    def _split_scope(self, nodeid: str) -> str:
        return STUDY if nodeid.startswith(STUDY) else super()._split_scope(nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> SharedStudy | None:
    """Hand tests out by modules, but for those of the study."""
    return SharedStudy(config, log) if config.getvalue("dist") == "loadscope" else None


def built_kernels() -> set[str]:
    """Names of the kernels that this process has built or read; each is a digest of all that the kernel computes with."""
    return {name for name in sys.modules if name.startswith("revline.dde.compiling.kernel_")}


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:  # noqa: ARG001 - the form of the hook
    """Collect the kernels of a worker that has ended; two that built the same one built one."""
    node.config.stash.setdefault(KERNELS, set()).update(getattr(node, "workeroutput", {}).get("kernels", ()))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a session whose processes built too many different kernels; a worker hands its own over."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["kernels"] = sorted(built_kernels())
        return
    kernels = session.config.stash.setdefault(KERNELS, set())
    kernels.update(built_kernels())
    if len(kernels) > MOST_KERNELS:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how many kernels were built."""
    built = len(config.stash.get(KERNELS, set()))
    terminalreporter.write_line(f"{built} kernels were built, at most {MOST_KERNELS} may be")
    if built > MOST_KERNELS:
        terminalreporter.write_line("FAILED: too many kernels; share systems by their parameters", red=True)
