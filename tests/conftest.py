"""What holds for all tests: properties are not timed, for machines are busy, and a session builds few kernels."""

import os
import signal
import sys
from collections.abc import Iterator

import pytest
from hypothesis import settings

from revline.cli import THREADS

for _name in THREADS:
    os.environ.setdefault(_name, "1")  # before the first test imports numpy, as the command line does

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

MOST_KERNELS = 16
"""Kernels that one session may build: each costs seconds where the cache is cold. Parameters and inputs need no new ones."""


@pytest.fixture(scope="session", autouse=True)
def _heed_interruptions() -> Iterator[None]:
    """Heed interruptions where a shell started the tests in the background, which ignores them: tests of them would wait for ever."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session", autouse=True)
def _few_kernels() -> Iterator[None]:
    """Fail a session that builds too many kernels: share a system by its parameters instead."""
    yield
    kernel = sys.modules.get("revline.dde.kernel")
    if kernel is not None:
        built = kernel.specialise.cache_info().currsize
        assert built <= MOST_KERNELS, f"{built} kernels were built where {MOST_KERNELS} suffice; share systems by their parameters"
