"""Attacks on the server, each tried: other hosts and sites, forms, large bodies, floods, paths, and browsers' rules."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest

from revline.web.security import HEADERS, App, Guard, Receive, Rules, Scope, Send
from revline.web.turns import SupersededError, Turns

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


def test_of_those_that_wait_only_the_newest_is_answered() -> None:
    async def run() -> tuple[list[Any], int]:
        turns, order = Turns(), []
        hold = asyncio.Event()

        async def work(k: int) -> int:
            order.append(k)
            if k == 0:
                await hold.wait()
            return k

        first = asyncio.create_task(turns.take("a", lambda: work(0)))
        await asyncio.sleep(0)
        rest = [asyncio.create_task(turns.take("a", lambda k=k: work(k))) for k in (1, 2, 3)]  # type: ignore[misc]  # loop's values
        other = asyncio.create_task(turns.take("b", lambda: work(9)))
        await asyncio.sleep(0.01)
        hold.set()
        found = await asyncio.gather(first, *rest, other, return_exceptions=True)
        assert order == [0, 9, 3]
        return list(found), turns.clients

    found, left = asyncio.run(run())
    assert [found[0], found[3], found[4]] == [0, 3, 9]
    assert [type(one) for one in found[1:3]] == [SupersededError, SupersededError]
    assert left == 0
    assert json.dumps(found[0]) == "0"
