"""What a request holds that VROOM does not read: it changes no answer, but it is said."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple, get_args, get_origin

from pydantic import BaseModel

from dispatcher_daemon.service.vroom.schema import Request, VroomJob
from slipstream.config import mend_of_unknown
from slipstream.errors import MAX_FAULTS, InputError

_INDICES: Final = ("location_index", "start_index", "end_index")
_OPTIONS_MEND: Final = "ask for geometry and choose_eta beside the request"


class _Unread(NamedTuple):
    table: tuple[str, ...]
    """Keys down to the table, without rows."""
    path: str
    key: str
    problem: str
    mend: str


def unread(request: object, source: str) -> list[str]:
    """A line for each key that is not read, the same one of all rows of a table together; at most
    `MAX_FAULTS`.
    """
    if not isinstance(request, Mapping):
        return []
    has_matrices = bool(request.get("matrices") or request.get("matrix"))
    alike: dict[tuple[object, ...], list[_Unread]] = {}
    for one in _walk(request, Request, (), (), has_matrices):
        alike.setdefault((one.table, one.key, one.problem), []).append(one)
    lines = []
    for first, *others in list(alike.values())[:MAX_FAULTS]:
        more = f", in {len(others)} other rows neither" if others else ""
        lines.append(str(InputError(source, first.problem + more, first.mend, key=first.path)))
    return lines


def _walk(
    data: object,
    annotation: Any,
    table: tuple[str, ...],
    path: tuple[str, ...],
    has_matrices: bool,
) -> Iterator[_Unread]:
    model = _model_in(annotation)
    if model is None:
        return
    if isinstance(data, list | tuple):
        for number, row in enumerate(data):
            yield from _walk(row, annotation, table, (*path, str(number)), has_matrices)
    elif isinstance(data, Mapping) and _is_named(annotation):
        for name, row in data.items():
            yield from _walk(row, model, table, (*path, name), has_matrices)
    elif isinstance(data, Mapping):
        for key, value in data.items():
            here = (*path, key)
            reason = _reason(key, data, model, has_matrices)
            if reason is not None:
                yield _Unread(table, ".".join(here), key, *reason)
            elif key in model.model_fields:
                inner = model.model_fields[key].annotation
                yield from _walk(value, inner, (*table, key), here, has_matrices)


def _reason(
    key: str, row: Mapping[str, object], model: type[BaseModel], has_matrices: bool
) -> tuple[str, str] | None:
    """(why a key is not read, what to do); None: it is."""
    fields = model.model_fields
    if key not in fields:
        if model is Request and key == "options":
            return "unknown key, not read", _OPTIONS_MEND
        known = (name for name in fields if name not in row)
        return "unknown key, not read", mend_of_unknown(key, known)
    beside = (row.get(name) for name in ("delivery", "pickup"))
    if model is VroomJob and key == "amount" and any(value is not None for value in beside):
        return "not read beside delivery or pickup", "remove it, the former name of delivery"
    if key == "matrix" and row.get("matrices"):
        return "not read beside matrices", "remove it, their former form"
    if key in _INDICES and not has_matrices:
        return "not read without matrices", "remove it, or give matrices"
    return None


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The table that an annotation has rows of, at any depth."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_model_in(inner) for inner in get_args(annotation))
    return next((model for model in found if model is not None), None)


def _is_named(annotation: Any) -> bool:
    """Whether tables go by names that the user chooses."""
    return any(get_origin(option) is dict for option in (annotation, *get_args(annotation)))
