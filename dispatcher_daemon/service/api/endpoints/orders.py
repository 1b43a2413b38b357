"""Orders: submit, look up, cancel, pin, release, settle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, FastAPI, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field, RootModel

from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.body import (
    body_of,
    describe_body,
    describe_optional_body,
    json_body,
    optional_body_of,
)
from dispatcher_daemon.service.api.endpoints.control import Why, actor_of
from dispatcher_daemon.service.api.parameters import After, Limit, Name
from dispatcher_daemon.service.api.services import Dispatch
from dispatcher_daemon.service.intake import (
    MAX_AT_ONCE,
    Given,
    OrdersRefused,
    Pin,
    Settlement,
    read_request,
)
from slipstream.http.problems import MEDIA_TYPE, Problem
from slipstream.messages import (
    OrderHistory,
    OrderReceipt,
    OrderRefusal,
    OrderRequest,
    OrderState,
    OrderStatus,
    RefusalKind,
)
from slipstream.orders import ORDER_STATES, OrderRefused

router = APIRouter(prefix="/v1/orders", tags=["orders"])

STATUS: Final[Mapping[RefusalKind, int]] = {
    "invalid": 422,
    "not_found": 404,
    "conflict": 409,
    "too_late": 409,
    "unavailable": 503,
}
_PATH: Final = "/{order:path}"
"""A caller's id may have slashes."""
_WHY: Final = describe_optional_body(Given)


class OrderBatch(
    RootModel[
        OrderRequest
        | Annotated[tuple[OrderRequest, ...], Field(min_length=1, max_length=MAX_AT_ONCE)]
    ]
):
    """One order, or several that are taken all or none."""


class Receipts(BaseModel):
    """Of several orders, in their order."""

    receipts: tuple[OrderReceipt, ...]


class OrderPage(BaseModel):
    """Orders by id: those that have not ended, or ended within a day."""

    orders: tuple[OrderStatus, ...]
    next: str | None = Field(description="`after` of the next page; null: there is none.")


@dataclass(frozen=True)
class _Sent:
    requests: tuple[OrderRequest, ...]
    as_list: bool


async def _orders(request: Request) -> _Sent:
    return await run_in_threadpool(_read, await json_body(request))


def _read(data: object) -> _Sent:
    rows = data if isinstance(data, list) else [data]
    if not 1 <= len(rows) <= MAX_AT_ONCE:
        raise Problem(422, f"{len(rows)} orders at once", f"send 1 to {MAX_AT_ONCE}")
    found, refusals = list[OrderRequest](), list[OrderRefusal]()
    for row in rows:
        try:
            found.append(read_request(row))
        except OrderRefused as refused:
            refusals.append(refused.refusal)
    if refusals:
        raise OrdersRefused(refusals)
    return _Sent(tuple(found), isinstance(data, list))


@router.post(
    "",
    dependencies=[requires("orders")],
    status_code=201,
    response_model=OrderReceipt | Receipts,
    responses={200: {"description": "All were known.", "model": OrderReceipt | Receipts}},
    openapi_extra=describe_body(OrderBatch),
)
def submit(
    dispatch: Dispatch, response: Response, sent: Annotated[_Sent, Depends(_orders)]
) -> OrderReceipt | Receipts:
    """Take one order, or up to 1000, all or none. They are durable when this answers, and are
    planned from the next cycle on. The same order may be sent again: its receipt is the same,
    with its state now; one that has ended stays so.
    """
    taken = dispatch.orders.submit(sent.requests)
    if not any(is_new for _, is_new in taken):
        response.status_code = 200
    receipts = tuple(receipt for receipt, _ in taken)
    return Receipts(receipts=receipts) if sent.as_list else receipts[0]


@router.get("", dependencies=[requires("read")])
def page(
    dispatch: Dispatch,
    state: Annotated[OrderState | None, Query(description="Only orders in it.")] = None,
    after: After = None,
    limit: Limit = 100,
) -> OrderPage:
    """Orders of callers and of the fleet's file, by id."""
    states = ORDER_STATES if state is None else (state,)
    found = dispatch.orders.page(states, after, limit + 1)
    following = found[limit - 1].order if len(found) > limit else None
    return OrderPage(orders=tuple(found[:limit]), next=following)


@router.get(_PATH, dependencies=[requires("read")])
def show(dispatch: Dispatch, order: Name) -> OrderHistory:
    """One order with its life, however long ago it ended, as long as it is stored."""
    return dispatch.orders.show(order)


@router.delete(_PATH, dependencies=[requires("orders")], openapi_extra=_WHY)
def cancel(dispatch: Dispatch, request: Request, order: Name, why: Why) -> OrderStatus:
    """Cancel an order. Refused where a vehicle has left with it, or it has ended."""
    done = dispatch.orders.cancel(order, why.reason)
    return _logged(dispatch, request, "cancel", done, why.reason)


@router.post(
    _PATH + "/pin",
    dependencies=[requires("control")],
    openapi_extra=describe_optional_body(Pin),
)
def pin(
    dispatch: Dispatch, request: Request, order: Name, pin: Annotated[Pin, optional_body_of(Pin)]
) -> OrderStatus:
    """Keep an order for one vehicle; without a body, for the one whose plan has it."""
    done = dispatch.orders.pin(order, pin.vehicle, pin.reason)
    return _logged(dispatch, request, "pin", done, pin.reason)


@router.post(_PATH + "/release", dependencies=[requires("control")], openapi_extra=_WHY)
def release(dispatch: Dispatch, request: Request, order: Name, why: Why) -> OrderStatus:
    """Let any vehicle serve an order that is pinned."""
    done = dispatch.orders.release(order, why.reason)
    return _logged(dispatch, request, "release", done, why.reason)


@router.post(
    _PATH + "/settle",
    dependencies=[requires("control")],
    openapi_extra=describe_body(Settlement),
)
def settle(
    dispatch: Dispatch,
    request: Request,
    order: Name,
    settlement: Annotated[Settlement, body_of(Settlement)],
) -> OrderStatus:
    """Say whether an order was served whose vehicle cannot say so, or is not believed. Refused once
    it has ended.
    """
    done = dispatch.orders.settle(order, served=settlement.served, reason=settlement.reason)
    return _logged(dispatch, request, "settle", done, settlement.reason)


def _logged(
    dispatch: Dispatch, request: Request, kind: str, status: OrderStatus, reason: str | None
) -> OrderStatus:
    dispatch.control.note(kind, f"order/{status.order}", actor_of(request), reason)
    return status


def handle_refusals(app: FastAPI) -> None:
    """Have an application answer refusals of orders as problem documents. That of several has a
    member `refusals`, one for each order that is in the way.
    """

    def one(_request: Request, error: OrderRefused) -> Response:
        return _problem(error.refusal).response()

    def some(_request: Request, error: OrdersRefused) -> Response:
        first, *others = error.refusals
        problem = _problem(first)
        if not others:
            return problem.response()
        rows = [refusal.model_dump(mode="json") for refusal in error.refusals]
        document: dict[str, Any] = {**problem.document, "refusals": rows}
        return JSONResponse(document, problem.status, media_type=MEDIA_TYPE)

    app.add_exception_handler(OrderRefused, one)  # type: ignore[arg-type]
    app.add_exception_handler(OrdersRefused, some)  # type: ignore[arg-type]


def _problem(refusal: OrderRefusal) -> Problem:
    name = "" if refusal.order is None else f"order {refusal.order[:200]!r}: "
    headers = {"Retry-After": "30"} if refusal.kind == "unavailable" else None
    status = STATUS[refusal.kind]
    return Problem(status, name + refusal.problem, refusal.mend, field=refusal.key, headers=headers)
