"""What the API says of itself is true: requests made from its own description are answered as described, and never by a fault."""

import statistics
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings

from .serving import Server, end, start

PATHS = ("/health", "/parameters", "/view", "/trim", "/engine-file", "/files/{kind}", "/jobs/{name}", "/jobs/{name}/cancel")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    running = start("--data", str(tmp_path_factory.mktemp("data")))
    yield running
    _, said = end(running)
    assert "Traceback" not in said


@pytest.mark.slow
def test_what_the_description_allows_is_answered_and_never_by_a_fault(server: Server) -> None:
    description = httpx.get(f"{server.link}api/v1/openapi.json").json()
    description["paths"] = {f"/api/v1{path}": description["paths"][f"/api/v1{path}"] for path in PATHS}
    schema = schemathesis.openapi.from_dict(description)
    seen: set[int] = set()

    def answered(case: Any) -> None:
        answer = case.call(base_url=server.link.rstrip("/"), timeout=60)
        seen.add(answer.status_code)
        assert answer.status_code < 500, f"{case.method} {case.path}: {answer.text[:500]}"
        if answer.status_code >= 400:
            assert answer.headers["content-type"][0] == "application/problem+json", f"{case.method} {case.path}"

    quick: Any = settings(
        max_examples=6, derandomize=True, database=None, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
    )
    operations: Any = schema.get_all_operations()
    for found in operations:
        strategy: Any = found.ok().as_strategy()
        bind: Any = given(strategy)
        quick(bind(answered))()
    assert {200, 404} <= seen


def test_a_small_answer_does_not_wait_for_a_packet(server: Server) -> None:
    """Without TCP_NODELAY on the accepted socket the second of two small packets waits 40 ms for the first one's receipt."""
    with httpx.Client() as client:
        waits = []
        for _ in range(15):
            began = time.perf_counter()
            client.get(f"{server.link}api/v1/health")
            waits.append(time.perf_counter() - began)
    assert statistics.median(waits) < 0.03
