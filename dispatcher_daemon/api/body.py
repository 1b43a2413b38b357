"""Request bodies: JSON that is held to a settings model as strictly as a settings file is."""

from __future__ import annotations

from typing import Any, Final, TypeVar

from fastapi import Depends, FastAPI, Request
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

from dispatcher_daemon.api.problems import Problem, from_input_error
from slipstream.config import Settings, check, parse_json
from slipstream.errors import InputError

SOURCE: Final = "body"
S = TypeVar("S", bound=Settings)

_DEFINITIONS: Final = "x-body-definitions"


async def json_body(request: Request) -> object:
    """The JSON of a request.

    Raises:
        Problem: 415: it is said to be something else. 400: it is no JSON.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        detail = f"a body of type {kind or 'that is not given'}"
        mend = "send application/json"
        raise Problem(415, detail, mend, field="Content-Type")
    data = await request.body()
    try:
        return await run_in_threadpool(parse_json, data, SOURCE)
    except InputError as error:
        raise from_input_error(error, 400) from None


def body_of(model: type[S]) -> Any:
    """A dependency that gives the request's body as a model: unknown keys and wrong types are
    refused with 422, what is no JSON with 400, any other media type with 415.
    """

    async def read(request: Request) -> S:
        return await run_in_threadpool(check, await json_body(request), model, SOURCE)

    return Depends(read)


def describe_body(model: type[BaseModel]) -> dict[str, Any]:
    """The `openapi_extra` of an operation whose body is read by `body_of` or `json_body`."""
    schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
    definitions = schema.pop("$defs", {})
    return {
        "requestBody": {"required": True, "content": {"application/json": {"schema": schema}}},
        _DEFINITIONS: definitions,
    }


def collect_definitions(document: dict[str, Any]) -> None:
    """Put what `describe_body` refers to among the components of an OpenAPI document."""
    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    for operations in document["paths"].values():
        for operation in operations.values():
            schemas.update(operation.pop(_DEFINITIONS, {}))


def refuse_unknown_parameters(request: Request) -> None:
    """A dependency of every route: query parameters that it does not have, or has once only.

    Raises:
        Problem: 422.
    """
    app: FastAPI = request.app
    names = _query_names(app, request)
    given = [name for name, _ in request.query_params.multi_items()]
    for name in given:
        if name not in names:
            known = f"remove it or use one of: {', '.join(names)}" if names else "remove it"
            raise Problem(422, "unknown query parameter", known, field=name)
        if given.count(name) > 1:
            raise Problem(422, "given twice", "give it once", field=name)


def _query_names(app: FastAPI, request: Request) -> tuple[str, ...]:
    """Query parameters of the operation that a request is for, by the OpenAPI document."""
    route = request.scope["route"]
    operation = app.openapi()["paths"].get(route.path, {}).get(request.method.lower(), {})
    parameters = operation.get("parameters", ())
    return tuple(p["name"] for p in parameters if p["in"] == "query")
