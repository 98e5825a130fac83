"""A user's own files over HTTP: sent as they are, read in a process that has little time and memory, and kept nowhere."""

import json
from collections.abc import Callable
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response

from revline.errors import InvalidInputError
from revline.web.answers import Answer, answer_file
from revline.web.desk import Desk
from revline.web.security import FILE_KINDS, client_of
from revline.web.state import parse_state

Name = Annotated[str, Query(max_length=80, description="of the file, for messages; it is only repeated")]
StateText = Annotated[str, Query(max_length=8192, description="state that it is compared with, as JSON")]


def upload_routes(desk_of: Callable[[Request], Desk]) -> APIRouter:
    """Make the routes.

    Args:
        desk_of: finds what a request's server shares.
    """
    routes = APIRouter(prefix="/files", tags=["files"])

    @routes.post("/{kind}", summary="Check, show, fit and compare a file", response_model=None, openapi_extra=_body())
    async def read(request: Request, kind: Literal["response", "log", "engine"], name: Name = "", state: StateText = "{}") -> Response:
        """Read a frequency response (CSV), a recorded log (CSV) or an engine file (TOML); nothing of it is kept."""
        entries = parse_state(_parse_state(state)).model_dump(exclude_none=True)
        content = await request.body()
        client = client_of(request.scope, request.headers)
        found: Answer = await desk_of(request).readers.ask(client.name, answer_file, kind, name, entries, content)
        return Response(found.body, status_code=found.status, media_type=found.kind)

    return routes


def _body() -> dict[str, Any]:
    """What is sent, for the API's description: the file as it is."""
    content = {kind: {"schema": {"type": "string", "format": "binary"}} for kind in FILE_KINDS}
    return {"requestBody": {"required": True, "description": "the file itself, at most 5 MB", "content": content}}


def _parse_state(text: str) -> dict[str, Any]:
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError) as error:
        message = f"state is no JSON: {error}; leave it out for the state that a page begins with"
        raise InvalidInputError(message, control="state") from error
    if not isinstance(entries, dict):
        message = f"state is a JSON {type(entries).__name__}; send an object"
        raise InvalidInputError(message, control="state")
    return entries
