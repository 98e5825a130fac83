"""The server as a process: it starts, answers, says what is wrong, gives up what takes too long, and ends without leaving a child."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from revline.web import app
from revline.web.answers import answer_parts
from revline.web.app import page_folder
from revline.web.views import find_share
from revline.web.workers import GIBIBYTE, WorkerError, Workers
from tests.benchmarks.loading import load_script
from tests.web.serving import PROGRAM, Server, end, start


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    running = start()
    yield running
    status, said = end(running)
    assert status in {0, -signal.SIGTERM}
    assert "Traceback" not in said


def post(server: Server, path: str, body: Any) -> httpx.Response:
    return httpx.post(f"{server.link}api/v1/{path}", json=body, timeout=30)


def test_a_view_is_answered_with_numbers(server: Server) -> None:
    answer = post(server, "view", {"state": {"throttle_deg": 30}, "parts": ["point", "margins", "words"]})
    assert answer.status_code == 200
    record = answer.json()
    assert list(record["parts"]) == ["point", "margins", "words"]
    assert record["parts"]["point"]["throttle_deg"] == 30.0
    assert record["parts"]["words"]["verdict"].startswith("stable")
    assert 0.0 < record["seconds"] < 30.0


@pytest.mark.parametrize(
    ("body", "control", "words"),
    [
        ({"state": {"kp": 1e9}}, "kp", "kp = 1e+09 is outside its range; give 10000 or less"),
        ({"state": {"parts": []}}, "parts", "there is no 'parts'"),
        ({"parts": ["nix"]}, "parts", "a view has no part 'nix'; it has point, response"),
        ({"parts": "point"}, "parts", "parts = 'point': input should be a valid list"),
        ({"state": {"parameters": {"rotation.inertia": None}}}, "parameters.rotation.inertia", "input should be a valid number"),
        ({"file": "/etc/passwd"}, "file", "there is no 'file'"),
    ],
)
def test_what_is_wrong_is_told_as_on_the_command_line(server: Server, body: Any, control: str, words: str) -> None:
    answer = post(server, "view", body)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert words in problem["detail"]
    assert (problem["control"], problem["exit_status"]) == (control, 2)


def test_numbers_that_are_none_are_refused(server: Server) -> None:
    for text in ('{"state": {"kp": NaN}}', '{"state": {"kp": Infinity}}', '{"state": {"kp": 1e999}}', "{", ""):
        answer = httpx.post(f"{server.link}api/v1/view", content=text, headers={"content-type": "application/json"})
        assert answer.status_code == 422, text
        assert answer.json()["exit_status"] == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            '{"state": {"kp": 1,}}',
            "the request is no JSON: Expecting property name enclosed in double quotes at character 19; send a JSON object",
        ),
        ("{", "the request is no JSON: Expecting property name enclosed in double quotes at character 1"),
        ("", "the request has no content; send a JSON object"),
        ("[1]", "the request = [1]: input should be a valid dictionary or object"),
    ],
)
def test_what_is_no_json_is_told_so_and_no_control_is_blamed(server: Server, text: str, words: str) -> None:
    problem = httpx.post(f"{server.link}api/v1/view", content=text, headers={"content-type": "application/json"}).json()
    assert words in problem["detail"]
    assert "control" not in problem


HALVES = (r'{"state": {"\ud800": 1}}', r'{"\ud800": 1}', r'{"parts": ["\ud800"]}', r'{"state": {"engine": "\ud800"}}')


@pytest.mark.parametrize("text", HALVES)
def test_half_a_character_is_told_as_what_it_is(server: Server, text: str) -> None:
    answer = httpx.post(f"{server.link}api/v1/view", content=text, headers={"content-type": "application/json"})
    assert answer.status_code == 422
    assert "d800" in answer.json()["detail"]


@pytest.mark.parametrize("text", ["[" * 50_000, '{"state": {"kp": ' + "1" * 5000 + "}}"], ids=["deep", "long"])
def test_what_cannot_be_read_is_not_said_to_be_nowhere(server: Server, text: str) -> None:
    answer = httpx.post(f"{server.link}api/v1/trim", content=text, headers={"content-type": "application/json"})
    assert answer.status_code == 400
    assert answer.json()["detail"].startswith("the request cannot be read: ")


def test_a_page_that_is_built_anew_is_not_mixed_with_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files served are those that there were when the server began."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("old")
    (tmp_path / "assets" / "old.js").write_text("1")
    monkeypatch.setattr(app, "page_folder", lambda: tmp_path)
    transport = httpx.ASGITransport(app=FastAPI(routes=app.page_routes().routes))
    (tmp_path / "assets" / "old.js").unlink()
    (tmp_path / "index.html").write_text("new")

    async def fetch() -> list[str]:
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return [(await client.get(path)).text for path in ("/", "/assets/old.js")]

    assert asyncio.run(fetch()) == ["old", "1"]


def test_nothing_of_the_machine_is_read_by_a_path(server: Server) -> None:
    for path in ("../pyproject.toml", "..%2f..%2fetc%2fpasswd", "assets/../../app.py", "%2e%2e/app.py", "/etc/passwd"):
        with socket.create_connection(("127.0.0.1", server.port)) as line:  # a client of ours would tidy the path
            line.sendall(f"GET /{path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n".encode())
            answer = b""
            while part := line.recv(65536):
                answer += part
        assert b" 404 " in answer.split(b"\r\n")[0], path


def test_the_api_describes_itself_without_other_machines(server: Server) -> None:
    record = httpx.get(f"{server.link}api/v1/openapi.json").json()
    named = ("health", "parameters", "view", "study-file", "engine-file", "trim", "loop", "jobs")
    assert set(record["paths"]) >= {f"/api/v1/{name}" for name in named}
    state = record["components"]["schemas"]["State"]["properties"]
    assert state["kp"]["description"] == "proportional gain [deg/(rad/s)]"
    assert (state["kp"]["minimum"], state["kp"]["maximum"]) == (-1e4, 1e4)
    for path in ("docs", "redoc", "api/v1/docs"):
        assert httpx.get(f"{server.link}{path}").status_code == 404


def test_the_page_is_served_compressed_and_kept_by_its_name(server: Server) -> None:
    answer = httpx.get(server.link)
    if not (page_folder() / "index.html").is_file():
        assert answer.status_code == 503
        assert "make page" in answer.text
        return
    assert answer.status_code == 200
    assert answer.headers["cache-control"] == "no-cache"
    script = next(part.split('"')[0] for part in answer.text.split('src="/') if part.startswith("assets/"))
    found = httpx.get(f"{server.link}{script}", headers={"accept-encoding": "gzip"})
    assert found.headers["content-encoding"] == "gzip"
    assert "immutable" in found.headers["cache-control"]
    sizes = [
        len(httpx.get(f"{server.link}{p.relative_to(page_folder()).as_posix()}").content) for p in page_folder().rglob("*") if p.is_file()
    ]
    assert sum(sizes) < 400_000
    assert "<style" not in answer.text
    assert "<script>" not in answer.text


def test_files_of_a_state(server: Server) -> None:
    study = post(server, "study-file", {"state": {"throttle_deg": 20}})
    assert study.headers["content-type"].startswith("application/toml")
    assert "throttle_deg = 20.0" in study.text
    engine = post(server, "engine-file", {"state": {"parameters": {"rotation.inertia": 0.3}}})
    assert "inertia = 0.3 # kg m2" in engine.text
    refused = post(server, "study-file", {"state": {"throttle_deg": 2}})
    assert (refused.status_code, refused.json()["exit_status"]) == (422, 1)
    assert httpx.get(f"{server.link}api/v1/parameters?engine=nix").json()["detail"].startswith("there is no built-in engine 'nix'")


def test_the_newest_of_a_client_s_requests_is_answered(server: Server) -> None:
    """Twelve moves of a slider at once: no request fails otherwise than by being overtaken, and the last is answered."""

    async def run() -> list[httpx.Response]:
        async with httpx.AsyncClient(timeout=60) as client:

            async def move(k: int) -> httpx.Response:
                await asyncio.sleep(0.01 * k)
                body = {"state": {"throttle_deg": 20.0 + k}, "parts": ["point", "margins"]}
                return await client.post(f"{server.link}api/v1/view", json=body, headers={"x-client": "one"})

            return await asyncio.gather(*(move(k) for k in range(12)))

    answers = asyncio.run(run())
    assert {answer.status_code for answer in answers} == {200, 409}
    assert answers[-1].json()["parts"]["point"]["throttle_deg"] == 31.0
    overtaken = next(answer for answer in answers if answer.status_code == 409)
    assert overtaken.json()["type"] == "/problems/superseded"


def test_eight_pages_move_sliders_and_each_gets_all_of_its_last_state(server: Server) -> None:
    """A short run of `benchmarks/workbench_load.py`; what it takes is measured there, what must always hold is tried here."""
    load = load_script("workbench_load")
    found = asyncio.run(load.run(server.port, server.process.pid, 8, 3.0, load.MIXES["mixed"], whole=False))
    assert (found.failed, found.lost) == ([], [])
    assert all(client.answered == len(client.moved) > 3 for client in found.clients)
    assert len(found.waits) == sum(len(client.moved) for client in found.clients)
    assert max(found.memory) < found.memory[0] + 150.0
    shown = found.clients[3]
    assert shown.parts["point"]["throttle_deg"] == pytest.approx(shown.state["throttle_deg"], rel=1e-9)
    assert json.loads(answer_parts(shown.state, ["margins"])["margins"]) == shown.parts["margins"]


def test_a_port_that_is_taken_is_said_with_the_remedy(server: Server) -> None:
    done = subprocess.run([*PROGRAM, "--port", str(server.port)], capture_output=True, text=True, check=False)  # noqa: S603 - our own program
    assert done.returncode == 2
    assert f"cannot listen at 127.0.0.1 port {server.port}: address already in use; give another --port" in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--host", "0.0.0.0"), "--host 0.0.0.0 can be reached from other machines; add --allow-remote"),  # noqa: S104 - what is refused
        (("--host", "my.machine"), "--host 'my.machine' is no address"),
        (("--host", "203.0.113.9", "--allow-remote"), "cannot listen at 203.0.113.9"),
    ],
)
def test_other_addresses_are_refused_or_asked_for(options: tuple[str, ...], words: str) -> None:
    done = subprocess.run([*PROGRAM, "--port", "0", *options], capture_output=True, text=True, check=False)  # noqa: S603 - our own program
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_other_machines_come_in_with_the_token_and_ctrl_c_ends_it() -> None:
    running = start("--host", "0.0.0.0", "--allow-remote")  # noqa: S104 - behind a token
    try:
        token = httpx.URL(running.link).params["token"]
        here = f"http://127.0.0.1:{running.port}/api/v1/health"
        assert httpx.get(here).status_code == 401
        assert httpx.get(here, headers={"authorization": f"Bearer {token}"}).json()["program"] == "revline"
    finally:
        status, said = end(running, signal.SIGINT)
    assert status == 0
    assert "Traceback" not in said


def slow(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def hoard() -> int:
    return len(bytearray(3 * GIBIBYTE))


@pytest.mark.parametrize(
    ("function", "arguments", "kind"),
    [(slow, (30.0,), "took-too-long"), (die, (), "process-ended"), (hoard, (), "out-of-memory")],
)
def test_what_takes_too_long_dies_or_hoards_is_given_up_and_replaced(function: Any, arguments: tuple[float, ...], kind: str) -> None:
    async def run() -> float:
        workers = Workers(count=1, seconds=2.0, memory=2 * GIBIBYTE)
        try:
            with pytest.raises(WorkerError) as caught:
                await workers.ask(function, *arguments)
            assert (caught.value.problem["type"], caught.value.problem["status"]) == (f"/problems/{kind}", 503)
            return await workers.ask(slow, 0.01)
        finally:
            workers.stop()

    assert asyncio.run(run()) == 0.01


def test_a_process_that_gives_no_answer_is_the_problem_of_its_parts_alone() -> None:
    async def lost() -> dict[str, bytes]:
        raise WorkerError("took-too-long", "the answer took too long", "it took longer than 1 s")

    found = asyncio.run(find_share(lost(), ["map", "cycle"]))
    assert set(found) == {"map", "cycle"}
    assert all(b'"type":"/problems/took-too-long"' in body for body in found.values())
