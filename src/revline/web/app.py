"""The HTTP application of the workbench: the page, and the API under a versioned path."""

import asyncio
import mimetypes
import os
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import APIRouter, FastAPI, Header, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware

from revline import __version__
from revline.errors import InvalidInputError, RevlineError
from revline.io.json_files import format_compact_json
from revline.web.answers import LIVE, Answer, answer
from revline.web.asked.registry import ASKED
from revline.web.desk import Desk
from revline.web.job_routes import job_routes, refuse_job
from revline.web.jobs.queue import JobError, Jobs
from revline.web.parameters import list_parameters
from revline.web.problems import CONTENT_TYPE, make_problem, problem_of
from revline.web.questions import Question
from revline.web.security import LONGEST_NAME, App, Client, Guard, Rules, client_of
from revline.web.state import State, as_input_error
from revline.web.turns import SupersededError
from revline.web.upload_routes import upload_routes
from revline.web.view.build import PARTS, WORDS
from revline.web.workers import WorkerError

API: Final = "/api/v1"

TENDING: Final = 0.5
"""Seconds between two looks at the jobs."""

NOT_BUILT: Final = (
    "The page of the workbench is not in this installation: it was not built.\n\n"
    "From a checkout run `make page` (or `make workbench`, which starts the server too); a released wheel has the page in it.\n"
    f"The API works all the same: {API}/openapi.json describes it.\n"
)


class ViewRequest(BaseModel):
    """Parts of the view of a state."""

    model_config = ConfigDict(extra="forbid")

    state: State = State()
    parts: Annotated[list[str], Field(max_length=32, description=f"of {', '.join((*PARTS, WORDS))}")] = list(LIVE)
    whole: Annotated[bool, Field(description="all parts in one answer; if false, some may be left for `later`")] = True


class StateRequest(BaseModel):
    """A state alone."""

    model_config = ConfigDict(extra="forbid")

    state: State = State()


class Problem(BaseModel):
    """Why there is no answer (RFC 9457)."""

    type: str
    title: str
    status: int
    detail: str
    exit_status: Annotated[int | None, Field(description="that of the command line: 2 wrong input, 1 the analysis")] = None
    control: Annotated[str | None, Field(description="key of the state that caused it")] = None
    details: Annotated[dict[str, Any] | None, Field(description="numbers of the text, by name")] = None


def create(rules: Rules | None = None, *, ready: Callable[[], None] | None = None, data: Path | None = None) -> App:
    """Make the application.

    Args:
        rules: what may pass; by default requests to this machine's own names on any port.
        ready: called once views are answered at once.
        data: folder of the jobs; by default the user's data folder.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.state.desk = Desk(data or default_data())
        tasks = [asyncio.create_task(_warm_up(app.state.desk, ready)), asyncio.create_task(_tend(app.state.desk.jobs))]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            app.state.desk.stop()

    app = FastAPI(
        title="revline workbench",
        version=__version__,
        summary="Engine speed control with the transport delay kept exact.",
        openapi_url=f"{API}/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
        responses={422: {"model": Problem}, 503: {"model": Problem}},
    )
    app.include_router(_api())
    app.include_router(page_routes())
    for kind, handler in (
        (RequestValidationError, _invalid),
        (HTTPException, _missing),
        (RevlineError, _refused),
        (WorkerError, _lost),
        (JobError, refuse_job),
        (Exception, _fault),
    ):
        app.add_exception_handler(kind, handler)
    app.add_middleware(GZipMiddleware, minimum_size=2000, compresslevel=1)
    return Guard(app, rules or Rules(hosts=frozenset()))


async def _warm_up(desk: Desk, ready: Callable[[], None] | None) -> None:
    await desk.live.warm_up()
    if ready is not None:
        ready()
    await desk.slow.warm_up()  # not before: it would take its time from those that a page asks first


async def _tend(jobs: Jobs) -> None:
    """Look after the jobs for as long as the server runs."""
    while True:
        try:
            await asyncio.to_thread(jobs.tend)
        except (RevlineError, OSError):  # a folder that cannot be written now is told to who asks for a job
            await asyncio.sleep(10.0 * TENDING)
        await asyncio.sleep(TENDING)


def default_data() -> Path:
    """Where jobs are kept unless told otherwise: the data folder of the XDG base directories, which counts only as an absolute path."""
    given = Path(os.environ.get("XDG_DATA_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".local" / "share") / "revline"


def _desk_of(request: Request) -> Desk:
    desk: Desk = request.app.state.desk
    return desk


def _client_of(request: Request) -> Client:
    return client_of(request.scope, request.headers)


def _api() -> APIRouter:
    routes = APIRouter(prefix=API)

    @routes.get("/health", summary="Whether the server is there")
    async def health() -> dict[str, str]:
        return {"program": "revline", "version": __version__}

    @routes.get("/parameters", summary="What can be set about an engine", response_model=None)
    async def parameters(engine: str = "lee1995") -> Response:
        return _json(format_compact_json(list_parameters(engine)).encode())

    @routes.post("/view", summary="Parts of the view of a state", responses={409: {"model": Problem}}, response_model=None)
    async def view(request: Request, asked: ViewRequest, x_client: Annotated[str, Header(max_length=LONGEST_NAME)] = "") -> Response:
        """Numbers and series of a state; a part that cannot be found is {"problem": ...}, and leaves the others whole.

        Of a client's requests (header X-Client) one is answered at a time, and of those that wait only the newest; the others are
        answered 409. Where `whole` is false, parts may be left for `later`, those that take longer than the others and, while many
        clients wait, any: ask for them again, by their names.
        """
        del x_client  # described here, and read with the address
        client = _client_of(request)
        try:
            body = await _desk_of(request).views.find(client.name, asked.state, asked.parts, newest=client.named, whole=asked.whole)
        except SupersededError:
            problem = make_problem("superseded", "a newer request came", "the client asked for a newer state", status=HTTPStatus.CONFLICT)
            return _problem(problem)
        return _json(body)

    for name, summary in (("study-file", "A study file of a state"), ("engine-file", "An engine file of a state's engine")):
        routes.add_api_route(f"/{name}", _file_route(name), methods=["POST"], summary=summary, response_model=None)
    for name, entry in ASKED.items():
        routes.add_api_route(f"/{name}", _question_route(name, entry.kind), methods=["POST"], summary=entry.summary, response_model=None)
    routes.include_router(job_routes(_desk_of))
    routes.include_router(upload_routes(_desk_of))
    return routes


def _question_route(name: str, kind: type[Question]) -> Callable[..., Any]:
    async def route(request: Request, asked: Any) -> Response:
        body = format_compact_json(asked.model_dump(exclude_unset=True)).encode()
        found: Answer = await _desk_of(request).live.ask(_client_of(request).name, answer, name, body)
        return Response(found.body, status_code=found.status, media_type=found.kind)

    route.__annotations__["asked"] = kind
    route.__name__ = name.replace("-", "_")
    return route


def _file_route(name: str) -> Callable[..., Any]:
    async def route(request: Request, asked: StateRequest) -> Response:
        body = format_compact_json({"state": asked.state.model_dump(exclude_none=True)}).encode()
        found: Answer = await _desk_of(request).live.ask(_client_of(request).name, answer, name, body)
        return Response(found.body, status_code=found.status, media_type=found.kind)

    return route


def page_routes() -> APIRouter:
    """Serve the page as it is built now."""
    routes = APIRouter(include_in_schema=False)
    files = _built_files(page_folder())

    @routes.get("/", response_model=None)
    async def index() -> Response:
        if "index.html" not in files:
            return PlainTextResponse(NOT_BUILT, status_code=HTTPStatus.SERVICE_UNAVAILABLE)
        return Response(files["index.html"], media_type="text/html", headers={"cache-control": "no-cache"})

    @routes.get("/{name:path}", response_model=None)
    async def asset(name: str) -> Response:
        if name not in files:  # names of the build alone, no path of the machine
            raise HTTPException(HTTPStatus.NOT_FOUND)
        held = "public, max-age=31536000, immutable" if name.startswith("assets/") else "no-cache"
        return Response(files[name], media_type=mimetypes.guess_type(name)[0], headers={"cache-control": held})

    return routes


def _built_files(folder: Path) -> Mapping[str, bytes]:
    """Hold the page's files as they are now: one that is built later has other names, and would be half of each."""
    if not folder.is_dir():
        return {}
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def page_folder() -> Path:
    """Where the built page is, if it was built."""
    return Path(str(resources.files("revline.web"))) / "page"


def _json(body: bytes) -> Response:
    return Response(body, media_type="application/json")


def _problem(record: Any) -> Response:
    return Response(format_compact_json(record).encode(), status_code=record["status"], media_type=CONTENT_TYPE)


async def _invalid(request: Request, error: Exception) -> Response:  # noqa: ARG001 - the form of all handlers
    found = _first_error(error)
    control = found.details.get("control")
    return _problem(problem_of(found, control=control if isinstance(control, str) else ""))


def _first_error(error: Any) -> RevlineError:
    """Word what FastAPI refused as the project words its errors."""
    entries: Sequence[Any] = error.errors()
    entry = dict(entries[0])
    if entry["type"] == "json_invalid":
        return InvalidInputError(f"the request is no JSON: {entry['ctx']['error']} at character {entry['loc'][-1]}; send a JSON object")
    if entry["type"] == "missing" and entry["loc"] == ("body",):
        return InvalidInputError("the request has no content; send a JSON object")
    entry["loc"] = tuple(part for part in entry["loc"] if part not in {"body", "state", "query", "header"})
    return as_input_error(entry)


async def _refused(request: Request, error: Exception) -> Response:  # noqa: ARG001 - the form of all handlers
    known: Any = error
    return _problem(problem_of(known, control=str(known.details.get("control", ""))))


async def _lost(request: Request, error: Exception) -> Response:  # noqa: ARG001 - the form of all handlers
    known: Any = error
    return _problem(known.problem)


async def _fault(request: Request, error: Exception) -> Response:  # noqa: ARG001 - the form of all handlers
    """Say that revline is at fault; the server's own output has the traceback."""
    detail = "this is a fault in revline; please report it with the request and the lines that the server printed"
    return _problem(make_problem("fault", "a fault in revline", detail, status=HTTPStatus.INTERNAL_SERVER_ERROR))


async def _missing(request: Request, error: Exception) -> Response:
    known: Any = error
    status = HTTPStatus(known.status_code)
    if status in {HTTPStatus.NOT_FOUND, HTTPStatus.METHOD_NOT_ALLOWED}:
        detail = f"there is nothing at {request.url.path[:200]!r} for {request.method}; {API}/openapi.json lists what there is"
    else:
        detail = f"the request cannot be read: {known.detail}; send JSON of no more depth and digits than a state has"
    return _problem(make_problem(status.phrase.lower().replace(" ", "-"), status.phrase.lower(), detail, status=status))
