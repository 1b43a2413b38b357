from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from .conftest import Api

MATRIX = [[0, 100, 300], [100, 0, 200], [300, 200, 0]]
REQUEST: dict[str, Any] = {
    "vehicles": [{"id": 7, "start_index": 0, "end_index": 0, "capacity": [2]}],
    "jobs": [
        {"id": 1, "location_index": 2, "service": 30, "delivery": [1]},
        {"id": 2, "location_index": 1, "service": 30, "delivery": [1]},
        {"id": 3, "location_index": 1, "delivery": [1]},
    ],
    "matrices": {"car": {"durations": MATRIX}},
}


@pytest.mark.process
@pytest.mark.slow
def test_a_request_in_vrooms_format_is_answered_at_once(serve: Callable[..., Api]) -> None:
    """What fits is on the route, the rest unassigned with its reason; refusals have VROOM's code
    beside the problem document's members.
    """
    api = serve(tokens=True)
    answer = api.ask("POST", "/v1/vroom?deadline_s=2", "controller", REQUEST)
    assert answer.status == 200
    assert answer.json["code"] == 0
    assert answer.json["summary"]["unassigned"] == 1
    (route,) = answer.json["routes"]
    jobs = {step["id"] for step in route["steps"] if step["type"] == "job"}
    (left,) = answer.json["unassigned"]
    assert jobs | {left["id"]} == {1, 2, 3}
    assert left["reason"]
    unknown = api.ask("POST", "/v1/vroom", "controller", {**REQUEST, "depots": []})
    assert (unknown.status, unknown.json["status"], unknown.json["code"]) == (422, 422, 2)
    assert "depots" in unknown.json["error"]
    assert unknown.headers["content-type"] == "application/problem+json"
    # The demo's roads are on no map.
    places = {
        "vehicles": [{"id": 1, "start": [2.0, 48.0]}],
        "jobs": [{"id": 1, "location": [2, 48]}],
    }
    refused = api.ask("POST", "/v1/vroom", "controller", places)
    assert (refused.status, refused.json["detail"]) == (422, refused.json["error"])
