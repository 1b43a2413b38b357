"""Refusals as problem documents (RFC 9457): status, title, detail, and which field to mend how."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Final

from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from slipstream.errors import InputError

if TYPE_CHECKING:
    from fastapi import FastAPI
    from fastapi.exceptions import RequestValidationError

MEDIA_TYPE: Final = "application/problem+json"


class ProblemDocument(BaseModel):
    """What every refusal answers with."""

    type: str = Field(description="about:blank: the status says what kind of problem it is.")
    title: str = Field(description="The status in words.")
    status: int = Field(description="HTTP status.")
    detail: str = Field(description="What is wrong, in one line.")
    field: str | None = Field(
        default=None, description="Dotted key in the body, parameter or header that is wrong."
    )
    mend: str | None = Field(default=None, description="What the caller can do about it.")


PROBLEM_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    "default": {
        "description": "A refusal.",
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemDocument"}}},
    }
}
"""What each operation declares beside its success."""


class Problem(Exception):
    """A refusal; raise it anywhere below the application.

    Args:
        mend: what the caller can do about it; None: nothing but to try again.
        field: key of the body, parameter or header that is wrong; None: none of them.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        mend: str | None = None,
        *,
        field: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.mend = mend
        self.field = field
        self.headers = dict(headers or {})

    @property
    def document(self) -> dict[str, object]:
        """The JSON of the answer."""
        whole = ProblemDocument(
            type="about:blank",
            title=HTTPStatus(self.status).phrase,
            status=self.status,
            detail=_one_line(self.detail),
            field=None if self.field is None else _one_line(self.field),
            mend=None if self.mend is None else _one_line(self.mend),
        )
        return whole.model_dump(exclude_none=True)

    def response(self) -> Response:
        """The answer."""
        return JSONResponse(self.document, self.status, self.headers, MEDIA_TYPE)


FAULT: Final = Problem(500, "a fault of the server's own, which its log tells")


def from_input_error(error: InputError, status: int = 422) -> Problem:
    """The refusal of what a body or parameter says."""
    return Problem(status, error.problem, error.mend, field=error.key)


def handle_problems(
    app: FastAPI,
    *,
    paths: str,
    unavailable: tuple[type[Exception], ...] = (),
) -> None:
    """Have an application answer its refusals, and the framework's, as problem documents.

    Args:
        paths: page of the documentation that has its paths.
        unavailable: what is raised where something that it needs does not answer now: HTTP 503.
    """
    # It takes half a second to import, and refusals are raised by what needs no framework.
    from fastapi.exceptions import RequestValidationError

    def problem(_request: Request, error: Problem) -> Response:
        return error.response()

    def bad_input(_request: Request, error: InputError) -> Response:
        return from_input_error(error).response()

    def bad_parameter(_request: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        # The first part says where it stood: path, query, header.
        name = ".".join(str(part) for part in first["loc"][1:]) or None
        return Problem(422, first["msg"], "mend the value", field=name).response()

    def of_framework(request: Request, error: HTTPException) -> Response:
        details = {
            404: (f"nothing is at {request.url.path[:200]}", f"see {paths} for the paths"),
            405: (f"{request.method[:20]} is not for this path", "use a method that Allow names"),
        }
        detail, mend = details.get(error.status_code, (str(error.detail), None))
        return Problem(error.status_code, detail, mend, headers=error.headers).response()

    def later(_request: Request, error: Exception) -> Response:
        return Problem(503, str(error), "try again later", headers={"Retry-After": "5"}).response()

    def fault(_request: Request, _error: Exception) -> Response:
        # The guard around the application logs it.
        return FAULT.response()

    handlers: Mapping[type[Exception], Any] = {
        Exception: fault,
        Problem: problem,
        InputError: bad_input,
        RequestValidationError: bad_parameter,
        HTTPException: of_framework,
        **dict.fromkeys(unavailable, later),
    }
    for kind, handler in handlers.items():
        app.add_exception_handler(kind, handler)


def _one_line(text: str) -> str:
    # What a caller's JSON says may be no text that can be encoded.
    return " ".join(text.split())[:1000].encode("utf-8", "replace").decode()
