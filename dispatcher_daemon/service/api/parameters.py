"""Parameters of paths and queries: their types, and that no unknown one is passed over."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import Path, Query, Request

from slipstream.http.problems import Problem

Name = Annotated[str, Path(min_length=1, max_length=200, pattern=r"^[^\x00]+$")]
"""An id in a path, declared as ``{name:path}``: ids may have any characters, percent-encoded."""
Number = Annotated[int, Path(ge=0, lt=2**62)]
Before = Annotated[int | None, Query(ge=0, lt=2**62, description="Only those before it.")]
After = Annotated[
    str | None,
    Query(min_length=1, max_length=200, description="Only ids behind it: `next` of the last page."),
]
Moment = Annotated[int | None, Query(ge=0, lt=2**62)]
"""UTC, ns."""
MAX_PAGE: Final = 1000
Limit = Annotated[int, Query(ge=1, le=MAX_PAGE, description="Entries of one page.")]


def check_range(begin_ns: int | None, end_ns: int | None) -> None:
    """Check a range of time, as the parameters `from` and `until` give it.

    Raises:
        Problem: 422: it ends before it begins.
    """
    if begin_ns is not None and end_ns is not None and begin_ns > end_ns:
        raise Problem(422, "'from' is later than 'until'", "give an earlier time", field="from")


def refuse_unknown_parameters(request: Request) -> None:
    """A dependency of every route: it refuses query parameters that the route does not
    have, or that are given twice.

    Raises:
        Problem: 422.
    """
    names = [parameter.alias for parameter in request.scope["route"].dependant.query_params]
    given = [name for name, _ in request.query_params.multi_items()]
    for name in given:
        if name not in names:
            known = f"remove it or use one of: {', '.join(names)}" if names else "remove it"
            raise Problem(422, "unknown query parameter", known, field=name)
        if given.count(name) > 1:
            raise Problem(422, "given twice", "give it once", field=name)
