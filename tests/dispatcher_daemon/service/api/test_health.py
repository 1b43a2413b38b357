from __future__ import annotations

from collections.abc import Callable

import pytest

from .conftest import Api


def test_health_is_what_feeds_the_watchdog(serve: Callable[..., Api]) -> None:
    """200 while cycles come, 503 with the reason when not; without a token in both cases."""
    live = [True]
    api = serve(tokens=True, is_live=lambda: live[0])
    assert (api.get("/healthz").status, api.get("/healthz").json) == (200, {"status": "live"})
    live[0] = False
    answer = api.get("/healthz")
    assert (answer.status, answer.headers["content-type"]) == (503, "application/problem+json")
    assert "hangs" in answer.json["detail"]


def test_a_dispatcher_without_a_solver_is_no_sound_one(serve: Callable[..., Api]) -> None:
    """/healthz is 503 with the reason, as what it sends are baselines only."""
    api = serve(solver_fault=lambda: "no solver works (exact: BrokenProcessPool)")
    answer = api.get("/healthz")
    assert answer.status == 503
    assert answer.json["detail"] == "no solver works (exact: BrokenProcessPool)"


def test_readiness_names_each_condition(serve: Callable[..., Api]) -> None:
    """503 as soon as one is not met, with all of them."""
    why: list[str | None] = [None]
    api = serve(checks={"bus": lambda: why[0], "cycle": lambda: None})
    assert api.get("/readyz").status == 200
    why[0] = "no router answers"
    answer = api.get("/readyz")
    assert answer.status == 503
    assert answer.json == {
        "ready": False,
        "paused": False,
        "checks": {
            "bus": {"ok": False, "detail": "no router answers"},
            "cycle": {"ok": True, "detail": None},
        },
    }


def test_readiness_says_what_is_awaited(serve: Callable[..., Api]) -> None:
    """Just after the start it is no reason for 503."""
    api = serve(checks={"rsus": lambda: None}, awaited=lambda: {"rsus": "none heard yet"})
    answer = api.get("/readyz")
    assert answer.status == 200
    assert answer.json["checks"] == {"rsus": {"ok": True, "detail": "none heard yet"}}


def test_metrics_are_the_process_own(serve: Callable[..., Api]) -> None:
    """The page is what the metrics port serves."""
    answer = serve().get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    assert b"slipstream_dispatcher_api_requests_total" in answer.body


@pytest.mark.parametrize(
    "path",
    [
        *("/healthz", "/readyz", "/metrics", "/v1/vehicles", "/v1/vehicles/van-a", "/v1/orders"),
        *("/v1/cycles", "/v1/segments", "/v1/alarms", "/v1/vehicles/nobody", "/v1/nothing"),
    ],
)
def test_head_is_get_without_the_body(serve: Callable[..., Api], path: str) -> None:
    """On every path: the same status, type and length."""
    api = serve()
    asked, got = api.ask("HEAD", path), api.get(path)
    assert (asked.status, asked.body) == (got.status, b"")
    assert asked.headers["content-type"] == got.headers["content-type"]
    if path != "/metrics":
        assert asked.headers["content-length"] == got.headers["content-length"]


@pytest.mark.slow
def test_head_of_what_has_no_end_ends(serve: Callable[..., Api]) -> None:
    """The event stream begins and is over; the place among those who listen is free again."""
    api = serve()
    for _ in range(100):
        asked = api.ask("HEAD", "/v1/events")
        assert (asked.status, asked.headers["content-type"].partition(";")[0]) == (
            200,
            "text/event-stream",
        )


def test_head_needs_the_token_that_get_needs(serve: Callable[..., Api]) -> None:
    """And a path without GET has no HEAD."""
    api = serve(tokens=True)
    assert api.ask("HEAD", "/v1/vehicles").status == 401
    assert api.ask("HEAD", "/v1/vehicles", "reader").status == 200
    assert api.ask("HEAD", "/v1/control/pause", "reader").status == 405


@pytest.mark.parametrize(
    "path", ["/v1/vehicles", "/v1/orders", "/v1/cycles", "/readyz", "/v1/feeds"]
)
def test_a_slash_at_the_end_changes_nothing(serve: Callable[..., Api], path: str) -> None:
    """One that belongs to an id is percent-encoded."""
    api = serve()
    assert api.get(f"{path}/").status == api.get(path).status
    assert api.get("/v1/vehicles/van-a/").json == api.get("/v1/vehicles/van-a").json
    assert api.get("/v1/vehicles/van-a%2F").status == 404
