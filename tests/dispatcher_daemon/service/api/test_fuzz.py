from __future__ import annotations

import contextlib
import itertools
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest
import schemathesis
from hypothesis import HealthCheck, given, seed, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import checks
from schemathesis.specs.openapi import checks as openapi_checks

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.api import RateLimit, create_app
from dispatcher_daemon.service.api.endpoints import events
from slipstream.http.problems import ProblemDocument
from slipstream_cli.openapi_doc import document

from .conftest import SECRETS, Api, write_tokens

CALLS: Final = int(os.environ.get("FUZZ_CALLS", "100"))
"""10,000 in `make fuzz`."""
EXAMPLES: Final = 2 if CALLS <= 100 else 50
CHECKS: Final = [
    checks.not_a_server_error,
    openapi_checks.status_code_conformance,
    openapi_checks.content_type_conformance,
    openapi_checks.response_schema_conformance,
]
ROOT = Path(__file__).resolve().parents[4]


def test_the_description_is_that_of_the_routes() -> None:
    """docs/openapi.json is current; `make openapi` writes it."""
    assert (ROOT / "docs" / "openapi.json").read_text() == document()


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_nothing_that_is_sent_is_a_fault_of_the_service(
    serve: Callable[..., Api],
    demo: RoutingProblem,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    figure: Callable[[str], None],
) -> None:
    """No 5xx but that the one worker is busy with fleets sent before, each answer as it is
    described, each refusal a problem document; no cycle is stored, and of orders what callers were
    told: those accepted, whole, and as cancelled those that were.
    """
    monkeypatch.setattr(events, "MAX_AGE_S", 0.0)  # Streams end at once.
    api = serve(tokens=True, sockets=True, rate=RateLimit(1e9, 1e9))
    path = tmp_path / "tokens.toml"
    write_tokens(path)
    path.write_text(path.read_text().replace('["read"]', json.dumps(sum(SECRETS.values(), ()))))
    api.dispatcher.run_cycle()
    before = api.get("/v1/cycles", "reader").body
    schema = schemathesis.openapi.from_dict(create_app().openapi())
    operations = [result.ok() for result in schema.get_all_operations()]
    calls = number = busy = 0
    accepted = {order.order for order in api.services.reader.orders()}
    cancelled: set[str] = set()
    node = demo.fleet.stops[0].node

    def learn(method: str, path: str, status: int, body: bytes) -> None:
        """What a caller was told of orders."""
        if status >= 300 or not path.startswith("/v1/orders"):
            return
        told = json.loads(body)
        if (method, path) == ("POST", "/v1/orders"):
            accepted.update(one["order"] for one in told.get("receipts", [told]))
        elif method == "DELETE":
            cancelled.add(told["order"])

    def submit(method: str, path: str, body: object, status: int) -> None:
        answer = api.ask(method, path, "reader", body)
        assert answer.status == status, answer.body
        learn(method, path, answer.status, answer.body)

    def orders_between(round_of: int) -> None:
        """Orders that can be served, one of them cancelled, and a batch that is refused whole."""
        names = [f"fuzz-{round_of}-{place}" for place in range(2)]
        good = [{"id": name, "node": node} for name in names]
        submit("POST", "/v1/orders", good, 201)
        submit("DELETE", f"/v1/orders/{names[0]}", None, 200)
        mixed = [{"id": f"half-{round_of}", "node": node}, {"id": "bad", "node": "nowhere"}]
        submit("POST", "/v1/orders", mixed, 422)

    def fuzz(operation: Any, mode: schemathesis.GenerationMode) -> None:
        @seed(number)
        @settings(
            max_examples=EXAMPLES,
            deadline=None,
            database=None,
            derandomize=False,
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy(generation_mode=mode))
        def call(case: Any) -> None:
            nonlocal calls, busy
            calls += 1
            response = case.call(
                base_url=f"http://127.0.0.1:{api.port}",
                headers={"Authorization": "Bearer reader"},
                timeout=120.0,  # A request in VROOM's format is answered after its deadline.
            )
            sent = response.request
            path = str(sent.path_url).partition("?")[0]
            learn(str(sent.method), path, response.status_code, response.content)
            is_busy = response.status_code == 503 and "retry-after" in response.headers
            busy += is_busy
            case.validate_response(response, checks=CHECKS[1:] if is_busy else CHECKS)
            if response.status_code >= 400:
                ProblemDocument.model_validate_json(response.content)

        # Where an operation takes nothing, nothing can be wrong with what it is given.
        with contextlib.suppress(Unsatisfiable):
            call()

    while calls < CALLS:
        for operation, mode in itertools.product(operations, schemathesis.GenerationMode):
            fuzz(operation, mode)
        orders_between(number)
        number += 1
    figure(f"{calls} calls of {len(operations)} operations, no fault, {busy} busy")
    assert api.get("/v1/cycles", "reader").body == before
    stored = {order.order: order for order in api.services.reader.orders()}
    assert stored.keys() == accepted
    assert {name for name, order in stored.items() if order.state == "cancelled"} == cancelled
    for name, order in stored.items():
        changes = api.services.reader.order_changes(name)
        assert (changes[-1].state, changes[-1].time_ns) == (order.state, order.since_ns)
    assert api.get("/healthz").status == 200
