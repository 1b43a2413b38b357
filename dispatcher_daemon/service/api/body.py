"""Request bodies: JSON that is held to a model as strictly as a settings file is."""

from __future__ import annotations

from typing import Any, Final, TypeVar

from fastapi import Depends, Request
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

from slipstream.config import check, parse_json
from slipstream.errors import InputError
from slipstream.http.problems import Problem, from_input_error

SOURCE: Final = "body"
S = TypeVar("S", bound=BaseModel)

_DEFINITIONS: Final = "x-body-definitions"
_COMPONENTS: Final = "#/components/schemas/"


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


def body_of(model: type[S], joint: str | None = None) -> Any:
    """A dependency that gives the request's body as a model: unknown keys and wrong types are
    refused with 422, what is no JSON with 400, any other media type with 415.

    Args:
        joint: key that is named where several do not fit together; None: none is.
    """

    def checked(data: object) -> S:
        try:
            return check(data, model, SOURCE)
        except InputError as error:
            raise InputError(SOURCE, error.problem, error.mend, key=error.key or joint) from None

    async def read(request: Request) -> S:
        return await run_in_threadpool(checked, await json_body(request))

    return Depends(read)


def optional_body_of(model: type[S]) -> Any:
    """As `body_of`; without a body, the model's defaults."""

    async def read(request: Request) -> S:
        if not await request.body():
            return model()
        return await run_in_threadpool(check, await json_body(request), model, SOURCE)

    return Depends(read)


def describe_body(model: type[BaseModel], prefix: str = "") -> dict[str, Any]:
    """The `openapi_extra` of an operation whose body is read by `body_of` or `json_body`.

    Args:
        prefix: of its definitions' names, where others have the same.
    """
    schema = model.model_json_schema(ref_template=f"{_COMPONENTS}{prefix}{{model}}")
    found = {**schema.pop("$defs", {}), model.__name__: schema}
    definitions = {prefix + name: definition for name, definition in found.items()}
    reference = {"$ref": _COMPONENTS + prefix + model.__name__}
    return {
        "requestBody": {"required": True, "content": {"application/json": {"schema": reference}}},
        _DEFINITIONS: definitions,
    }


def describe_optional_body(model: type[BaseModel]) -> dict[str, Any]:
    """The same of an operation that may be called without a body."""
    operation = describe_body(model)
    operation["requestBody"]["required"] = False
    return operation


def collect_definitions(document: dict[str, Any]) -> None:
    """Put what `describe_body` refers to among the components of an OpenAPI document."""
    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    for operations in document["paths"].values():
        for operation in operations.values():
            schemas.update(operation.pop(_DEFINITIONS, {}))
