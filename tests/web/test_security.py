"""Attacks on the server, each tried: other hosts and sites, forms, large bodies, floods, paths, and browsers' rules."""

import asyncio
import contextlib
import select
import socket
import threading
import time
from collections.abc import AsyncIterator, Iterator
from typing import Any

import httpx
import pytest
import uvicorn

from revline.web.connections import PatientProtocol
from revline.web.security import HEADERS, App, Guard, Receive, Rules, Scope, Send

HOST = "127.0.0.1:8765"
RULES = Rules(hosts=frozenset({HOST, "localhost:8765"}), largest=1000, in_flight=3)
JSON = {"content-type": "application/json", "host": HOST}


async def inside(scope: Scope, receive: Receive, send: Send) -> None:
    """What is guarded: answers with what it was sent."""
    body = (await receive())["body"] if scope["method"] == "POST" else b"page"
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": body})


def ask(method: str = "POST", *, rules: Rules = RULES, app: App = inside, path: str = "/x", **options: Any) -> httpx.Response:
    async def run() -> httpx.Response:
        transport = httpx.ASGITransport(app=Guard(app, rules))
        async with httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}") as client:
            return await client.request(method, path, **options)

    return asyncio.run(run())


def refused(answer: httpx.Response, status: int, kind: str, words: str) -> None:
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert (problem["type"], problem["status"]) == (f"/problems/{kind}", status)
    assert words in problem["detail"]


def test_an_own_request_passes_and_is_marked() -> None:
    answer = ask(content=b'{"a": 1}', headers={**JSON, "origin": f"http://{HOST}", "sec-fetch-site": "same-origin"})
    assert (answer.status_code, answer.content) == (200, b'{"a": 1}')
    for name, value in HEADERS:
        assert answer.headers[name] == value
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy


@pytest.mark.parametrize("host", ["evil.example:8765", "127.0.0.1:9999", "127.0.0.1", "", "localhost:8765.evil.example"])
def test_a_name_that_was_bound_to_this_address_is_refused(host: str) -> None:
    """DNS rebinding: the browser believes that the other site's name is this machine's address."""
    refused(ask("GET", headers={"host": host}), 421, "wrong-host", "this server is not")
    refused(ask(content=b"{}", headers={**JSON, "host": host}), 421, "wrong-host", "open it as 127.0.0.1:8765 or localhost:8765")


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://evil.example"},
        {"origin": "null"},
        {"origin": "http://localhost:3000"},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "cors"},
        {"sec-fetch-site": "same-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "image"},
    ],
)
def test_a_page_of_another_site_is_refused(headers: dict[str, str]) -> None:
    refused(ask(content=b"{}", headers={**JSON, **headers}), 403, "wrong-origin", "another site")
    refused(ask("GET", headers={"host": HOST, **headers}), 403, "wrong-origin", "another site")


def test_a_link_from_another_site_opens_the_page() -> None:
    headers = {"host": HOST, "sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    assert ask("GET", headers=headers).text == "page"
    framed = {**headers, "sec-fetch-dest": "iframe"}
    refused(ask("GET", headers=framed), 403, "wrong-origin", "another site")


@pytest.mark.parametrize("kind", ["", "text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"])
def test_what_a_form_can_send_is_refused(kind: str) -> None:
    refused(ask(content=b'{"a": 1}', headers={"host": HOST, "content-type": kind}), 415, "wrong-kind", "send application/json")


def test_a_large_body_is_refused_before_it_is_read() -> None:
    read = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal read
        while read < 100_000_000:
            read += 500
            yield b"x" * 500

    said = {**JSON, "content-length": "100000000"}
    refused(ask(content=endless(), headers=said), 413, "too-large", "larger than 0.976562 KiB")
    assert read <= 500
    refused(ask(content=endless(), headers=JSON), 413, "too-large", "larger than")
    assert read <= 3000


def test_a_flood_is_answered() -> None:
    async def slow(scope: Scope, receive: Receive, send: Send) -> None:
        await asyncio.sleep(0.05)
        await inside(scope, receive, send)

    async def run() -> list[httpx.Response]:
        transport = httpx.ASGITransport(app=Guard(slow, RULES))
        async with httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}") as client:
            return await asyncio.gather(*(client.post("/x", content=b"{}", headers=JSON) for _ in range(10)))

    answers = asyncio.run(run())
    assert [answer.status_code for answer in answers].count(200) == RULES.in_flight
    busy = [answer for answer in answers if answer.status_code != 200]
    refused(busy[0], 503, "too-busy", "try again")
    assert all(answer.headers["retry-after"] == "1" for answer in busy)


REMOTE = Rules(hosts=frozenset(), token="s3cret")  # noqa: S106 - of a test


@pytest.mark.parametrize(
    ("headers", "path"),
    [
        ({}, "/"),
        ({"authorization": "Bearer wrong"}, "/"),
        ({"authorization": "Bearer "}, "/"),
        ({"authorization": "Bearer größer".encode("latin-1")}, "/"),
        ({"cookie": "revline_token=wrong"}, "/"),
        ({}, "/?token=s3cre"),
        ({}, "/?token="),
    ],
)
def test_another_machine_needs_the_token(headers: dict[str, Any], path: str) -> None:
    refused(ask("GET", rules=REMOTE, headers=headers, path=path), 401, "no-token", "the link that `revline serve` printed")


def test_the_token_of_the_link_becomes_a_cookie_that_no_script_reads() -> None:
    answer = ask("GET", rules=REMOTE, path="/?token=s3cret")
    assert answer.text == "page"
    assert answer.headers["set-cookie"] == "revline_token=s3cret; HttpOnly; SameSite=Strict; Path=/"
    again = ask("GET", rules=REMOTE, headers={"cookie": "a=b; revline_token=s3cret"})
    assert "set-cookie" not in again.headers
    assert ask("GET", rules=REMOTE, headers={"authorization": "Bearer s3cret"}).text == "page"


def test_web_sockets_are_not_served() -> None:
    async def run() -> None:
        async def never(*_: Any) -> Any:
            raise AssertionError

        await Guard(inside, RULES)({"type": "websocket", "headers": []}, never, never)

    asyncio.run(run())


def test_one_client_leaves_room_for_others() -> None:
    async def slow(scope: Scope, receive: Receive, send: Send) -> None:
        await asyncio.sleep(0.05)
        await inside(scope, receive, send)

    async def run() -> list[httpx.Response]:
        transport = httpx.ASGITransport(app=Guard(slow, RULES._replace(of_one=2)))
        async with httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}") as client:
            names = ("a", "a", "a", "b")
            return await asyncio.gather(*(client.post("/x", content=b"{}", headers={**JSON, "x-client": name}) for name in names))

    answers = asyncio.run(run())
    assert [answer.status_code for answer in answers] == [200, 200, 503, 200]
    refused(answers[2], 503, "too-busy", "2 requests of this client are being answered already")


def test_invented_names_leave_room_for_other_machines() -> None:
    """One machine asks under a new name each time; another one is let in all the same."""
    released = asyncio.Event()

    async def held(scope: Scope, receive: Receive, send: Send) -> None:
        await released.wait()
        await inside(scope, receive, send)

    async def run() -> tuple[list[httpx.Response], httpx.Response]:
        guard = Guard(held, RULES._replace(in_flight=6, of_machine=4))

        async def ask(machine: str, name: str) -> httpx.Response:
            transport = httpx.ASGITransport(app=guard, client=(machine, 1))
            async with httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}") as client:
                return await client.post("/x", content=b"{}", headers={**JSON, "x-client": name})

        flood = [asyncio.create_task(ask("203.0.113.9", f"name {k}")) for k in range(20)]
        async with asyncio.timeout(5.0):
            while sum(task.done() for task in flood) < 16:
                await asyncio.sleep(0.001)
        other = asyncio.create_task(ask("203.0.113.10", "page"))
        await asyncio.sleep(0.01)
        released.set()
        return await asyncio.gather(*flood), await other

    flood, other = asyncio.run(run())
    assert other.status_code == 200
    assert [answer.status_code for answer in flood].count(200) == 4
    busy = next(answer for answer in flood if answer.status_code != 200)
    refused(busy, 503, "too-busy", "4 requests from this address are being answered already")


class Quick(PatientProtocol):
    patience = 0.5
    pace = 1e9


MEBIBYTE = 2**20
LARGE = 12
"""Mebibytes of a large answer: more than the system holds for a connection."""


@pytest.fixture
def served() -> Iterator[tuple[int, list[str]]]:
    """A server on a real socket that is patient for half a second, and what happened to its requests."""
    happened: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            return
        try:
            await asyncio.sleep(30.0 if scope["path"] == "/long" else 0.0)
        except asyncio.CancelledError:
            happened.append("given up")
            raise
        if scope["path"] == "/large":
            await send({"type": "http.response.start", "status": 200, "headers": []})
            for k in range(LARGE):
                await send({"type": "http.response.body", "body": MEBIBYTE * b"x", "more_body": k < LARGE - 1})
            happened.append("done")
            return
        await inside(scope, receive, send)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        guard = Guard(app, Rules(hosts=frozenset({f"127.0.0.1:{port}"}), patience=0.5, in_flight=2))
        config = uvicorn.Config(guard, http=Quick, log_level="warning", lifespan="off", timeout_graceful_shutdown=1)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        yield port, happened
        server.should_exit = True
        thread.join(10.0)


def begin(port: int, path: str, length: int = 20) -> socket.socket:
    line = socket.create_connection(("127.0.0.1", port), timeout=5.0)
    head = f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
    line.sendall(head.encode())
    return line


def rest(line: socket.socket) -> bytes:
    """All that is answered, up to its end or the line's."""
    answer = b""
    while not answer.endswith((b"}", b"0\r\n\r\n")) and (part := line.recv(65536)):
        answer += part
    return answer


def test_a_body_that_trickles_is_refused_after_a_while_and_its_place_is_free(served: tuple[int, list[str]]) -> None:
    port, _ = served
    began = time.monotonic()
    with begin(port, "/x") as one, begin(port, "/x") as other, begin(port, "/x", 2) as third:
        third.sendall(b"{}")
        assert b"too-busy" in rest(third)  # both places are taken
        with contextlib.suppress(OSError):
            while not select.select([one], [], [], 0.05)[0]:
                one.sendall(b" ")
        answer = rest(one)
        assert answer.startswith(b"HTTP/1.1 408 ")
        assert b"did not come within 0.5 s" in answer
        assert rest(other).startswith(b"HTTP/1.1 408 ")
    assert 0.4 < time.monotonic() - began < 4.0
    with begin(port, "/x", 2) as line:
        line.sendall(b"{}")
        assert rest(line).startswith(b"HTTP/1.1 200 ")


def test_a_connection_without_a_whole_head_is_closed_and_others_are_kept(served: tuple[int, list[str]]) -> None:
    port, _ = served
    began = time.monotonic()
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as silent:
        with socket.create_connection(("127.0.0.1", port), timeout=5.0) as slow:
            for letter in "POST / HTTP/1.1":
                with contextlib.suppress(OSError):
                    slow.sendall(letter.encode())
                time.sleep(0.04)
            assert slow.recv(100) == b""
        assert silent.recv(100) == b""
        assert 0.4 < time.monotonic() - began < 4.0
    with begin(port, "/x", 2) as line:
        line.sendall(b"{}")
        assert rest(line).startswith(b"HTTP/1.1 200 ")
        line.sendall(b"POST /x HTT")  # the next request of a connection that was used
        assert rest(line) == b""


def test_a_client_that_goes_frees_its_place(served: tuple[int, list[str]]) -> None:
    port, happened = served
    lines = [begin(port, "/long", 2) for _ in range(2)]
    for line in lines:
        line.sendall(b"{}")
    with begin(port, "/x", 2) as refused_one:
        refused_one.sendall(b"{}")
        assert b"too-busy" in rest(refused_one)
    for line in lines:
        line.close()
    ends = time.monotonic() + 5.0
    while happened != ["given up", "given up"]:
        assert time.monotonic() < ends
        time.sleep(0.01)
    with begin(port, "/x", 2) as line:
        line.sendall(b"{}")
        assert rest(line).startswith(b"HTTP/1.1 200 ")


def test_who_does_not_read_its_answer_holds_no_place_and_loses_its_connection(served: tuple[int, list[str]]) -> None:
    port, happened = served
    lines = []
    for _ in range(3):  # one more than there are places
        lines.append(begin(port, "/large", 2))
        lines[-1].sendall(b"{}")
        assert lines[-1].recv(15) == b"HTTP/1.1 200 OK"
    began = time.monotonic()
    with begin(port, "/x", 2) as other:
        other.sendall(b"{}")
        assert rest(other).startswith(b"HTTP/1.1 200 ")
        assert time.monotonic() - began < 0.4
    ends = time.monotonic() + 5.0
    while happened != 3 * ["done"]:  # nothing more is done for a connection that is lost
        assert time.monotonic() < ends
        time.sleep(0.01)
    for line in lines:
        with line:
            size = 0
            with contextlib.suppress(ConnectionError):
                while part := line.recv(MEBIBYTE):
                    size += len(part)
            assert size < LARGE * MEBIBYTE


def test_who_reads_steadily_has_all_of_its_answer(served: tuple[int, list[str]]) -> None:
    port, happened = served
    with begin(port, "/large", 2) as line:
        line.sendall(b"{}")
        answer = b""
        while not answer.endswith(b"0\r\n\r\n"):
            answer += line.recv(MEBIBYTE // 2)
            time.sleep(0.02)  # longer in all than the patience for one piece
        assert len(answer) > LARGE * MEBIBYTE
    assert happened == ["done"]
