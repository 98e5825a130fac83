"""What holds for all tests."""

import sys
from collections.abc import Iterator

import pytest

MOST_KERNELS = 14
"""Kernels that one session may build: each costs seconds where the cache is cold. Parameters and inputs need no new ones."""


@pytest.fixture(scope="session", autouse=True)
def _few_kernels() -> Iterator[None]:
    """Fail a session that builds too many kernels: share a system by its parameters instead."""
    yield
    kernel = sys.modules.get("revline.dde.kernel")
    if kernel is not None:
        built = kernel.specialise.cache_info().currsize
        assert built <= MOST_KERNELS, f"{built} kernels were built where {MOST_KERNELS} suffice; share systems by their parameters"
