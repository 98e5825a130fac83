"""What every request must pass, and what every answer carries: hosts, origins, kinds, sizes, tokens, and headers for browsers.

The server computes for whoever may reach it; a page of another site in the same browser may reach it too. Hosts are checked against
names that are not this server's (DNS rebinding), origins against requests from other sites, and the kind of content so that no form can
send one.
"""

import asyncio
import contextlib
import secrets
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Mapping, MutableMapping
from http import HTTPStatus
from http.cookies import SimpleCookie
from typing import Any, Final, NamedTuple

from revline.io.json_files import format_compact_json
from revline.web.problems import CONTENT_TYPE, make_problem
from revline.web.turns import machine_of

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

SAFE: Final = ("GET", "HEAD", "OPTIONS")
"""Methods that change and compute nothing."""

FILES: Final = "/api/v1/files/"
JSON_KINDS: Final = ("application/json",)
FILE_KINDS: Final = ("text/csv", "application/toml", "application/octet-stream")
"""Kinds of uploaded files; none that a form can send."""

COOKIE: Final = "revline_token"

LONGEST_NAME: Final = 64
"""Characters of a client's name."""

POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self'",
        "font-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""Content security policy: everything from here, nothing inline."""

HEADERS: Final = (
    ("content-security-policy", POLICY),
    ("x-content-type-options", "nosniff"),
    ("referrer-policy", "no-referrer"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    ("permissions-policy", "camera=(), microphone=(), geolocation=()"),
)


class Rules(NamedTuple):
    """What the server lets in.

    Attributes:
        hosts: values of the Host header that are this server's; none to let any pass, where the token is what counts.
        token: that each request must bring; empty where none is needed.
        largest: bytes of a request's body at most.
        in_flight: requests at once at most; one is counted until its answer is there, however slowly that is read.
        of_machine: requests from one address at once at most, under whatever names.
        of_one: requests of one client at once at most.
        largest_file: bytes of an uploaded file at most.
        patience: seconds in which a request's body must have come.
    """

    hosts: frozenset[str]
    token: str = ""
    largest: int = 256 * 1024
    in_flight: int = 300
    of_machine: int = 200
    of_one: int = 100
    largest_file: int = 5 * 1024 * 1024
    patience: float = 20.0

    def largest_of(self, scope: Scope) -> int:
        """Bytes of a request's body at most."""
        return self.largest_file if scope["path"].startswith(FILES) else self.largest


class Guard:
    """The outermost layer of the server.

    Args:
        app: what is guarded.
        rules: what may pass.
    """

    def __init__(self, app: App, rules: Rules) -> None:
        self._app, self._rules = app, rules
        self._running: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or pass it on and mark the answer."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        refused = self._refusal(scope, headers)
        client = client_of(scope, headers).name
        if refused is None:
            refused = self._crowd(client)
        if refused is not None:
            await self._refuse(send, refused)
            return
        with contextlib.ExitStack() as place:
            self._running[client] += 1
            place.callback(self._leave, client)

            async def answered(message: Message) -> None:
                if message["type"] == "http.response.start":
                    place.close()
                await send(message)

            await self._pass(scope, receive, answered)

    def _leave(self, client: str) -> None:
        self._running[client] -= 1
        if not self._running[client]:
            del self._running[client]

    def _crowd(self, client: str) -> dict[str, Any] | None:
        """Refuse more at once than can be answered, and what would leave no room for others."""
        machine = machine_of(client)
        of_machine = sum(count for name, count in self._running.items() if machine_of(name) == machine)
        for whose, running, most in (
            ("requests", self._running.total(), self._rules.in_flight),
            ("requests from this address", of_machine, self._rules.of_machine),
            ("requests of this client", self._running.get(client, 0), self._rules.of_one),
        ):
            if running >= most:
                detail = f"{running} {whose} are being answered already; try again in a moment"
                return make_problem("too-busy", "too many requests at once", detail, status=HTTPStatus.SERVICE_UNAVAILABLE)
        return None

    def _refusal(self, scope: Scope, headers: MutableMapping[str, str]) -> dict[str, Any] | None:
        rules, host = self._rules, headers.get("host", "")
        if rules.hosts and host not in rules.hosts:
            detail = f"this server is not {host[:100]!r}; open it as {' or '.join(sorted(rules.hosts))}"
            return make_problem("wrong-host", "the host is not this server", detail, status=HTTPStatus.MISDIRECTED_REQUEST)
        if not _own_origin(headers, host):
            detail = "the request comes from a page of another site, which may not use this server"
            return make_problem("wrong-origin", "another site asks", detail, status=HTTPStatus.FORBIDDEN)
        if rules.token and not secrets.compare_digest(_token_of(scope, headers).encode(), rules.token.encode()):
            detail = "this server asks for its token: open the link that `revline serve` printed, or send Authorization: Bearer TOKEN"
            return make_problem("no-token", "the token is missing or wrong", detail, status=HTTPStatus.UNAUTHORIZED)
        return self._content_refusal(scope, headers)

    def _content_refusal(self, scope: Scope, headers: MutableMapping[str, str]) -> dict[str, Any] | None:
        if scope["method"] in SAFE:
            return None
        length = headers.get("content-length", "")
        largest = self._rules.largest_of(scope)
        if length.isdecimal() and int(length) > largest:
            return _too_large(largest)
        if length in {"", "0"} and "transfer-encoding" not in headers and "if-match" in headers:
            return None  # a wish without content; no page of another site can send this header unasked
        kind = headers.get("content-type", "").partition(";")[0].strip().lower()
        known = FILE_KINDS if scope["path"].startswith(FILES) else JSON_KINDS
        if kind not in known:
            detail = f"the content is {kind[:60] or 'of no kind'}; send {' or '.join(known)}"
            return make_problem("wrong-kind", "the kind of content is wrong", detail, status=HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
        return None

    async def _pass(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Read the body, which is small, and pass the request on; mark the answer. Nothing more is done for a client that is gone."""
        try:
            async with asyncio.timeout(self._rules.patience):
                body = await self._read(scope, receive)
        except TimeoutError:
            await self._refuse(send, _too_slow(self._rules.patience))
            return
        if body is None:
            return
        if len(body) > self._rules.largest_of(scope):
            await self._refuse(send, _too_large(self._rules.largest_of(scope)))
            return
        kept, gone = [{"type": "http.request", "body": body, "more_body": False}], asyncio.Event()

        async def replayed() -> Message:
            if kept:
                return kept.pop()
            await gone.wait()
            return {"type": "http.disconnect"}

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = list(message.get("headers", ()))
                given = {name.lower() for name, _ in own}  # a route may have a policy of its own, for what it shows
                message = {
                    **message,
                    "headers": [*own, *(entry for entry in _encoded(HEADERS) if entry[0] not in given), *self._cookie(scope)],
                }
            await send(message)

        answering = asyncio.ensure_future(self._app(scope, replayed, marked))
        watching = asyncio.ensure_future(_watch(receive, gone))
        try:
            await asyncio.wait([answering, watching], return_when=asyncio.FIRST_COMPLETED)
            if not answering.done():
                answering.cancel()
            await asyncio.wait([answering])
            if not answering.cancelled():
                answering.result()
        finally:
            answering.cancel()
            watching.cancel()

    async def _read(self, scope: Scope, receive: Receive) -> bytes | None:
        """Read the body, or one byte more than it may have; none where the client went."""
        parts, size, more = [], 0, scope["method"] not in SAFE
        while more and size <= self._rules.largest_of(scope):
            message = await receive()
            if message["type"] == "http.disconnect":
                return None
            parts.append(message.get("body", b""))
            size, more = size + len(parts[-1]), message.get("more_body", False)
        return b"".join(parts)

    def _cookie(self, scope: Scope) -> list[tuple[bytes, bytes]]:
        """The token as a cookie, for who came with it in the link."""
        token = self._rules.token
        if not token or f"token={token}" not in scope.get("query_string", b"").decode("latin-1"):
            return []
        return [(b"set-cookie", f"{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/".encode("latin-1"))]

    async def _refuse(self, send: Send, problem: dict[str, Any]) -> None:
        body = format_compact_json(problem).encode()
        extra = [("content-type", CONTENT_TYPE), ("content-length", str(len(body))), ("connection", "close")]
        if problem["status"] == HTTPStatus.SERVICE_UNAVAILABLE:
            extra.append(("retry-after", "1"))
        await send({"type": "http.response.start", "status": problem["status"], "headers": _encoded([*HEADERS, *extra])})
        await send({"type": "http.response.body", "body": body})


class Client(NamedTuple):
    """Who asks.

    Attributes:
        name: of the page or program, or its address.
        named: whether it gave its name.
    """

    name: str
    named: bool


def client_of(scope: Scope, headers: Mapping[str, str]) -> Client:
    """Tell clients apart by the name that they give, else by their address."""
    given = headers.get("x-client", "")
    address = (scope.get("client") or ("",))[0]
    return Client(f"{address} {given[:LONGEST_NAME]}", named=True) if given else Client(str(address), named=False)


async def _watch(receive: Receive, gone: asyncio.Event) -> None:
    """Wait until a client is gone; what else it sends is for later."""
    while (await receive())["type"] != "http.disconnect":
        pass
    gone.set()


def _own_origin(headers: MutableMapping[str, str], host: str) -> bool:
    """Whether a request comes from the server's own page, from the address bar, or from a program."""
    origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
    if origin is not None and origin not in {f"http://{host}", f"https://{host}"}:
        return False
    if site in {"none", "same-origin"}:
        return True
    # A link from elsewhere may open the page itself, which then asks for the rest on its own.
    return (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) == ("navigate", "document")


def _token_of(scope: Scope, headers: MutableMapping[str, str]) -> str:
    """The token that a request brings: in its header, its cookie, or the link."""
    kind, _, given = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return given.strip()
    cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    if cookie is not None:
        return cookie.value
    query = scope.get("query_string", b"").decode("latin-1")
    return next((part[6:] for part in query.split("&") if part.startswith("token=")), "")


def _too_slow(limit: float) -> dict[str, Any]:
    detail = f"the request did not come within {limit:g} s; send it at once, or over a faster line"
    return make_problem("too-slow", "the request came too slowly", detail, status=HTTPStatus.REQUEST_TIMEOUT)


def _too_large(limit: int) -> dict[str, Any]:
    detail = f"the request is larger than {limit / 1024:g} KiB; send less"
    return make_problem("too-large", "the request is too large", detail, status=HTTPStatus.REQUEST_ENTITY_TOO_LARGE)


def _encoded(headers: Iterable[tuple[str, str]]) -> list[tuple[bytes, bytes]]:
    return [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers]
