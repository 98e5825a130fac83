"""Files that are sent: what is wrong with one is said, a large one is refused before it has come, and none outstays its time or memory."""

import asyncio
import io
import os
import signal
import socket
import time
import zipfile
from collections.abc import Iterator

import httpx
import pytest

from revline.web.workers import GIBIBYTE, Workers

from .serving import Server, end, start

CSV = {"content-type": "text/csv"}
TABLE = "frequency_rad_s,magnitude_db,phase_deg\n" + "".join(f"{0.5 * k},{20.0 - k},{-6.0 * k}\n" for k in range(1, 12))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    running = start("--data", str(tmp_path_factory.mktemp("data")))
    yield running
    _, said = end(running)
    assert "Traceback" not in said


def zipped() -> bytes:
    """A file of a few kilobytes that would unpack to megabytes."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", "0" * 2_000_000)
    return made.getvalue()


@pytest.mark.parametrize(
    ("kind", "content", "words"),
    [
        ("response", b"\x89PNG\r\n\x1a\n\0\0\0", "is no text in UTF-8"),
        ("response", zipped(), "is no text in UTF-8"),
        ("log", b"", "is empty; give a CSV file"),
        ("response", b"frequency_rad_s,magnitude_db,phase_deg\n1,NaN,0\n", "'NaN' is no finite number"),
        ("response", b"a," * 1_000_000 + b"b\n1\n", ""),
        ("engine", b"[" * 1_000_000, "is no valid TOML"),
        ("engine", b"schema = 'revline.engine/9'", "cannot be read"),
    ],
    ids=["png", "zip", "empty", "nan", "columns", "nested", "schema"],
)
def test_files_of_the_wrong_kind_are_clear_problems(server: Server, kind: str, content: bytes, words: str) -> None:
    answer = httpx.post(f"{server.link}api/v1/files/{kind}?name=mine", content=content, headers=CSV, timeout=60)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert words in problem["detail"]
    assert problem["exit_status"] == 2
    assert len(answer.content) < 20_000
    assert "/tmp" not in answer.text  # noqa: S108 - what must not be told


def test_a_response_is_read_with_the_state_it_is_compared_with(server: Server) -> None:
    link = f"{server.link}api/v1/files/response"
    answer = httpx.post(link, params={"name": "bench.csv", "state": '{"throttle_deg": 30.0}'}, content=TABLE, headers=CSV, timeout=60)
    assert answer.status_code == 200
    assert answer.json()["engine"]["throttle_deg"] == 30.0
    for state, words in (("{", "state is no JSON"), ("[]", "state is a JSON list"), ('{"kp": 1e9}', "kp = 1e+09 is outside its range")):
        refused = httpx.post(link, params={"state": state}, content=TABLE, headers=CSV)
        assert (refused.status_code, refused.json()["exit_status"]) == (422, 2)
        assert words in refused.json()["detail"]
    for kind in ("text/plain", "multipart/form-data", "application/x-www-form-urlencoded"):  # what a form can send
        assert httpx.post(link, content=TABLE, headers={"content-type": kind}).status_code == 415
    assert httpx.post(f"{server.link}api/v1/files/..%2fjobs", content=TABLE, headers=CSV).status_code in {404, 405, 422}


def test_a_hundred_megabytes_are_refused_before_they_have_come(server: Server) -> None:
    began = time.monotonic()
    for headers, body in (
        ("Content-Length: 100000000", b""),
        ("Transfer-Encoding: chunked", (b"100000\r\n" + b"0" * 0x100000 + b"\r\n") * 6),
    ):
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as line:
            head = f"POST /api/v1/files/log HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nContent-Type: text/csv\r\n{headers}\r\n\r\n"
            line.sendall(head.encode() + body)
            assert b" 413 " in line.recv(65536).split(b"\r\n")[0], headers
    assert time.monotonic() - began < 5.0
    assert httpx.get(f"{server.link}api/v1/health").status_code == 200


def number() -> int:
    return os.getpid()


def test_a_process_that_is_killed_while_it_rests_is_replaced_unseen() -> None:
    async def run() -> list[int]:
        workers = Workers(count=1, seconds=10.0, memory=2 * GIBIBYTE)
        try:
            found = [await workers.ask(number)]
            os.kill(found[0], signal.SIGKILL)
            found.append(await workers.ask(number))  # before the death is noticed
            os.kill(found[1], signal.SIGKILL)
            await asyncio.sleep(0.5)
            return [*found, await workers.ask(number)]  # and after
        finally:
            workers.stop()

    assert len(set(asyncio.run(run()))) == 3
