from __future__ import annotations

from collections.abc import Callable

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


def test_metrics_are_the_process_own(serve: Callable[..., Api]) -> None:
    """The page is what the metrics port serves."""
    answer = serve().get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    assert b"slipstream_dispatcher_api_requests_total" in answer.body


def test_head_is_get_without_the_body(serve: Callable[..., Api]) -> None:
    """For probes that ask so: the same status and type; other paths have no HEAD."""
    live = [True]
    api = serve(tokens=True, is_live=lambda: live[0])
    for path in ("/healthz", "/readyz", "/metrics"):
        asked, got = api.ask("HEAD", path), api.get(path)
        assert (asked.status, asked.body) == (200, b""), path
        assert asked.headers["content-type"] == got.headers["content-type"], path
    live[0] = False
    assert (api.ask("HEAD", "/healthz").status, api.ask("HEAD", "/healthz").body) == (503, b"")
    assert api.ask("HEAD", "/v1/vehicles", "reader").status == 405
