"""Long work over HTTP: jobs are asked for, watched, cancelled, resumed and deleted, and their results read."""

from collections.abc import Callable
from http import HTTPStatus
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from revline.io.json_files import format_compact_json, format_json
from revline.web.answers import Answer, answer
from revline.web.desk import Desk
from revline.web.jobs.folder import ENGINE, QUESTIONS, STATE, Kind
from revline.web.problems import CONTENT_TYPE
from revline.web.security import client_of
from revline.web.state import State

RESULT_POLICY: Final = (
    "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""A report shows, with its own styles and pictures, and runs nothing."""

REVISION: Final = r'^"?[0-9]{1,9}"?$'


class JobRequest(BaseModel):
    """What a job is asked to do."""

    model_config = ConfigDict(extra="forbid")

    kind: Literal["study", "sinestream"]
    state: State = State()


class Job(BaseModel):
    """A job."""

    id: str
    kind: Literal["study", "sinestream"]
    status: Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
    created: Annotated[str, Field(description="when it was asked for, in UTC")]
    revision: Annotated[int, Field(description="send it as If-Match with what changes the job")]
    progress: Annotated[float, Field(description="part that is done, 0 to 1")]
    stage: str
    seconds: Annotated[float, Field(description="that it has run [s]")]
    remaining_s: Annotated[float | None, Field(description="that it still needs, about [s]; only while it runs")] = None
    files: Annotated[list[str], Field(description="names of the results, for /jobs/{id}/files/{name}")]
    state: Annotated[dict[str, Any], Field(description="of the page that asked for it")]
    error: Annotated[dict[str, Any] | None, Field(description="why it failed: a problem")] = None


class JobList(BaseModel):
    """All jobs, the newest first."""

    jobs: list[Job]
    warnings: list[str]


class Answered(BaseModel):
    """Why there is no answer (RFC 9457)."""

    type: str
    title: str
    status: int
    detail: str


IfMatch = Annotated[str, Header(alias="If-Match", pattern=REVISION, description="revision of the job that the change is made to")]


def _refusals() -> Any:
    """What a change of a job may be refused with, for the API's description."""
    return {status: {"model": Answered} for status in (404, 409, 412)}


def job_routes(desk_of: Callable[[Request], Desk]) -> APIRouter:
    """Make the routes.

    Args:
        desk_of: finds what a request's server shares.
    """
    routes = APIRouter(prefix="/jobs", tags=["jobs"])

    @routes.post("", status_code=201, response_model=Job, responses={429: {"model": Answered}, 507: {"model": Answered}})
    async def create(request: Request, asked: JobRequest) -> Response:
        """Ask for long work: a study with its report, or sinusoids at all frequencies of the thesis."""
        desk, client = desk_of(request), client_of(request.scope, request.headers)
        state = asked.state.model_dump(exclude_none=True)
        body = format_compact_json({"state": state}).encode()
        files = {STATE: format_json(state)}
        for name, question in ((QUESTIONS, "study-file"), (ENGINE, "engine-file")):
            found: Answer = await desk.live.ask(client.name, answer, question, body)
            if found.status != HTTPStatus.OK:
                return Response(found.body, status_code=found.status, media_type=found.kind)
            files[name] = found.body.decode()
        record = await run_in_threadpool(desk.jobs.create, Kind(asked.kind), files)
        return _json(record, HTTPStatus.CREATED)

    @routes.get("", response_model=JobList)
    def list_all(request: Request) -> Response:
        """List all jobs, the newest first."""
        return _json(desk_of(request).jobs.records())

    @routes.get("/{name}", response_model=Job, responses={404: {"model": Answered}})
    def show(request: Request, name: str) -> Response:
        """Show a job."""
        return _json(desk_of(request).jobs.record(name))

    @routes.post("/{name}/cancel", response_model=Job, responses=_refusals())
    def cancel(request: Request, name: str, if_match: IfMatch) -> Response:
        """Stop a job that waits or runs; what a study has finished is kept."""
        return _json(desk_of(request).jobs.cancel(name, _revision(if_match)))

    @routes.post("/{name}/resume", response_model=Job, responses=_refusals())
    def resume(request: Request, name: str, if_match: IfMatch) -> Response:
        """Let a job that was interrupted or cancelled go on."""
        return _json(desk_of(request).jobs.resume(name, _revision(if_match)))

    @routes.delete("/{name}", status_code=204, responses=_refusals())
    def delete(request: Request, name: str, if_match: IfMatch) -> Response:
        """Remove a job that has ended, with its results."""
        desk_of(request).jobs.delete(name, _revision(if_match))
        return Response(status_code=HTTPStatus.NO_CONTENT)

    @routes.get("/{name}/files/{file:path}", response_class=FileResponse, responses={404: {"model": Answered}})
    def result(request: Request, name: str, file: str) -> Response:
        """Read a result by its name in the job's list of files."""
        return FileResponse(desk_of(request).jobs.file(name, file), headers={"content-security-policy": RESULT_POLICY})

    return routes


async def refuse_job(request: Request, error: Exception) -> Response:  # noqa: ARG001 - the form of all handlers
    """Answer a wish about a job that cannot be met."""
    known: Any = error
    headers = {"retry-after": "30"} if known.problem["status"] == HTTPStatus.TOO_MANY_REQUESTS else None
    return Response(
        format_compact_json(known.problem).encode(), status_code=known.problem["status"], media_type=CONTENT_TYPE, headers=headers
    )


def _revision(given: str) -> int:
    return int(given.strip('"'))


def _json(record: Any, status: int = HTTPStatus.OK) -> Response:
    headers = {"etag": f'"{record["revision"]}"'} if "revision" in record else None
    return Response(format_compact_json(record).encode(), status_code=status, media_type="application/json", headers=headers)
