"""The command serve: the workbench in a browser, and its API."""

import ipaddress
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from revline.cli.options import JsonOption, QuietOption
from revline.cli.shell import Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.web.security import Rules

LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")
"""What a browser on this machine calls it."""

HostOption = Annotated[
    str, typer.Option("--host", metavar="ADDRESS", help="Address to listen at; 127.0.0.1 is reached from this machine alone.")
]
PortOption = Annotated[int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="Port to listen at; 0 takes a free one.")]
BrowserOption = Annotated[bool, typer.Option("--no-browser", help="Do not open the page in a browser.")]
DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder of the jobs; the user's data folder if left out.", show_default=False),
]
RemoteOption = Annotated[
    bool, typer.Option("--allow-remote", help="Let other machines in, if they have the token of the link that is printed; no encryption.")
]


def serve(
    *,
    host: HostOption = "127.0.0.1",
    port: PortOption = 8765,
    no_browser: BrowserOption = False,
    allow_remote: RemoteOption = False,
    data: DataOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Start the workbench and say where it is once it answers at once; Ctrl-C ends it.

    The page shows the whole chain live: operating point, frequency response, models, gains, margins and the engine's own answer follow
    each move. Nothing leaves this machine. Programs use the same server: /api/v1/openapi.json describes it.
    """
    import secrets
    import webbrowser

    import uvicorn

    from revline.web.app import create, page_folder
    from revline.web.connections import PatientProtocol

    shell = Shell(json=json, quiet=quiet)
    token = _token(host, allow_remote=allow_remote, make=secrets.token_urlsafe)
    listener = _listen(host, port)
    taken = int(listener.getsockname()[1])
    shown = f"[{host}]" if ":" in host else host
    link = f"http://{shown}:{taken}/" + (f"?token={token}" if token else "")
    if not (page_folder() / "index.html").is_file():
        shell.warn("the page was not built: run `make page` in a checkout, or install a released wheel; the API works all the same")

    def ready() -> None:
        shell.show({"link": link, "port": taken, **({"token": token} if token else {})}, f"workbench ready: {link}")
        sys.stdout.flush()
        if not no_browser:
            webbrowser.open(link)

    app = create(_rules(shown, taken, token), ready=ready, data=None if data is None else data.absolute())
    speaks: dict[str, Any] = {"http": PatientProtocol, "server_header": False, "access_log": False, "log_level": "warning"}
    config = uvicorn.Config(app, lifespan="on", timeout_graceful_shutdown=3, **speaks)
    try:
        uvicorn.Server(config).run(sockets=[listener])
    except KeyboardInterrupt:  # uvicorn has ended cleanly, and passes the signal on
        return


def _token(host: str, *, allow_remote: bool, make: Callable[[int], str]) -> str:
    """A token where other machines may come in; refused where they could without being asked for."""
    try:
        loopback = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError as error:
        message = f"--host {host!r} is no address; give 127.0.0.1, or another address of this machine"
        raise InvalidInputError(message) from error
    if loopback:
        return ""
    if not allow_remote:
        message = f"--host {host} can be reached from other machines; add --allow-remote to let them in with a token, or leave --host out"
        raise InvalidInputError(message)
    return make(32)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)  # named, or asyncio leaves small packets to wait 40 ms
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        remedy = f"give another --port, or 0 for a free one: revline serve --port {port + 1}" if port else "give another --host"
        message = f"cannot listen at {host} port {port}: {(error.strerror or str(error)).lower()}; {remedy}"
        raise InvalidInputError(message, port=port) from error
    return listener


def _rules(host: str, port: int, token: str) -> "Rules":
    """What may pass: this machine's names, or whoever has the token."""
    from revline.web.security import Rules

    names = {host, *LOOPBACK_NAMES}
    return Rules(hosts=frozenset() if token else frozenset(f"{name}:{port}" for name in names), token=token)
