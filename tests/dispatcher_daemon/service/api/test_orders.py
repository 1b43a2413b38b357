"""Orders over HTTP: what a caller sends, and what it is told."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from slipstream.messages import OrderState

from .asgi import Answer
from .conftest import Api

ORDER = {"id": "o-1", "node": "c2", "latest": "2099-01-01T00:00:00Z"}


@pytest.fixture
def api(serve: Callable[..., Api]) -> Api:
    """With tokens."""
    return serve(tokens=True)


def submit(api: Api, body: object) -> Answer:
    """By a token that may."""
    return api.ask("POST", "/v1/orders", "orderer", body)


def states(api: Api, path: str = "/v1/orders") -> dict[str, OrderState]:
    """State by order, as a reader sees them."""
    return {row["order"]: row["state"] for row in api.get(path, "reader").json["orders"]}


@pytest.mark.slow
def test_an_order_is_taken_once_and_followed_to_its_plan(api: Api) -> None:
    """201 for a new one, 200 with the same receipt for the same again, then its life."""
    first = submit(api, ORDER)
    assert (first.status, first.json["order"], first.json["node"]) == (201, "o-1", "c2")
    again = submit(api, ORDER)
    assert (again.status, again.json) == (200, first.json)
    api.dispatcher.run_cycle()
    told = api.get("/v1/orders/o-1", "reader").json
    assert told["state"] == "planned"
    assert told["vehicle"] in ("van-a", "van-b")
    assert told["arrival_ns"] > time.time_ns()
    assert [step["state"] for step in told["history"]] == ["open", "planned"]
    assert told["request"]["latest"] == 4_070_908_800 * 10**9
    assert submit(api, ORDER).json == {**first.json, "state": "planned"}
    file = api.get("/v1/orders/c1", "reader").json
    assert (file["source"], file["request"], told["source"]) == ("file", None, "api")
    # Planned, and the file names no window: it is whenever, as before.
    assert (file["state"], file["earliest_ns"], file["latest_ns"]) == ("planned", None, None)


def test_a_cancelled_order_that_is_sent_again_says_so(api: Api) -> None:
    """Its receipt has its state: nothing is planned of it, and its caller must not think so."""
    first = submit(api, ORDER)
    assert first.json["state"] == "open"
    assert api.ask("DELETE", "/v1/orders/o-1", "orderer").status == 200
    again = submit(api, ORDER)
    assert (again.status, again.json) == (200, {**first.json, "state": "cancelled"})
    several = submit(api, [ORDER, {**ORDER, "id": "o-2"}])
    assert several.status == 201
    states_told = [row["state"] for row in several.json["receipts"]]
    assert states_told == ["cancelled", "open"]


def test_of_several_orders_all_are_taken_or_none(api: Api) -> None:
    """Each that is in the way is named."""
    rows = [{"id": f"o-{n}", "node": "c2"} for n in range(4)]
    refused = submit(api, [rows[0], {**rows[1], "node": "x"}, {**rows[2], "id": "c1"}])
    assert (refused.status, refused.json["field"]) == (422, "node")
    faults = [(row["order"], row["kind"], row["key"]) for row in refused.json["refusals"]]
    assert faults == [("o-1", "invalid", "node"), ("c1", "conflict", "id")]
    assert states(api) == {}
    assert [row["order"] for row in submit(api, rows).json["receipts"]] == [r["id"] for r in rows]
    assert states(api).keys() == {row["id"] for row in rows}


@pytest.mark.parametrize(
    ("body", "status", "field"),
    [
        ([], 422, None),
        ([ORDER] * 1001, 422, None),
        ({**ORDER, "node": "nowhere"}, 422, "node"),
        ({**ORDER, "latest": "2001-01-01T00:00:00Z"}, 422, "latest"),
        ({**ORDER, "id": "taken", "demand": 2}, 409, "id"),
        ({**ORDER, "id": "c1"}, 409, "id"),
        ({**ORDER, "colour": "red"}, 422, "colour"),
        ("parcel", 422, None),
        (b"{", 400, None),
    ],
)
def test_a_refusal_is_a_problem_document_and_stores_nothing(
    api: Api, body: Any, status: int, field: str | None
) -> None:
    """With its field and what to do."""
    assert submit(api, {**ORDER, "id": "taken"}).status == 201
    headers = {"Content-Type": "application/json"}
    answer = api.ask("POST", "/v1/orders", "orderer", body, headers)
    assert (answer.status, answer.json.get("field")) == (status, field), answer.json
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json["mend"]
    assert states(api) == {"taken": "open"}


def test_each_operation_needs_its_scope(api: Api) -> None:
    """Who may read may not order, who orders may not pin."""
    assert api.ask("POST", "/v1/orders", "reader", ORDER).status == 403
    assert submit(api, ORDER).status == 201
    assert api.ask("DELETE", "/v1/orders/o-1", "reader").status == 403
    assert api.ask("POST", "/v1/orders/o-1/pin", "orderer", {"vehicle": "van-a"}).status == 403
    assert api.ask("POST", "/v1/orders/o-1/release", "orderer").status == 403
    assert api.get("/v1/orders/o-1", "orderer").status == 403
    assert states(api) == {"o-1": "open"}


def test_orders_are_cancelled_pinned_and_released_by_any_id(api: Api) -> None:
    """Names with slashes too; what is not possible says why."""
    name = "a/b c"
    path = "/v1/orders/a%2Fb%20c"
    submit(api, {"id": name, "node": "c2"})
    none = api.ask("POST", f"{path}/pin", "controller")
    assert (none.status, none.json["field"]) == (422, "vehicle")
    pinned = api.ask("POST", f"{path}/pin", "controller", {"vehicle": "van-b"})
    assert (pinned.status, pinned.json["pinned"]) == (200, "van-b")
    assert api.ask("POST", f"{path}/release", "controller").json["pinned"] is None
    assert api.ask("DELETE", path, "orderer").json["state"] == "cancelled"
    assert api.ask("DELETE", path, "orderer").status == 200
    late = api.ask("POST", f"{path}/pin", "controller", {"vehicle": "van-b"})
    assert (late.status, late.json["detail"][:19]) == (409, "order 'a/b c': it i")
    assert api.ask("DELETE", "/v1/orders/none", "orderer").status == 404
    assert api.get("/v1/orders/none", "reader").status == 404


def test_pages_join_without_gap_or_repetition(api: Api) -> None:
    """In the order of ids; a state narrows them."""
    submit(api, [{"id": f"o-{n:02}", "node": "c2"} for n in range(12)])
    api.ask("DELETE", "/v1/orders/o-03", "orderer")
    seen, after = [], "&after=n"
    while after:
        page = api.get(f"/v1/orders?limit=5&state=open{after}", "reader").json
        seen += [row["order"] for row in page["orders"]]
        after = page["next"] and f"&after={page['next']}"
    assert seen == [f"o-{n:02}" for n in range(12) if n != 3]
    assert states(api, "/v1/orders?state=cancelled") == {"o-03": "cancelled"}
    assert api.get("/v1/orders?state=lost", "reader").status == 422


@pytest.mark.parametrize("field", ["id", "node", "\ud800"])
def test_text_that_cannot_be_encoded_is_refused(serve: Callable[..., Api], field: str) -> None:
    """Half a surrogate pair in a value or a key, of one order or of several."""
    api, order = serve(tokens=True), {"id": "o", "node": "A0", field: "\ud800"}
    for body in (order, [order, order]):
        assert api.ask("POST", "/v1/orders", "orderer", body).status == 422
