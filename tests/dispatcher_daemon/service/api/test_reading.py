from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from slipstream.messages import (
    PlanAcknowledgement,
    SegmentState,
    VehiclePosition,
    acknowledgement_key,
    position_key,
)

from .conftest import Api

State = Callable[..., SegmentState]


def _report(api: Api, vehicle: str, cycle: int) -> None:
    """The vehicle acknowledges a plan and says where it stands."""
    answer = PlanAcknowledgement(
        vehicle=vehicle, time_ns=time.time_ns(), cycle=cycle, accepted=True, reason=None
    )
    watch = api.dispatcher.fleet_watch
    watch.on_acknowledgement(acknowledgement_key(vehicle), answer.to_bytes())
    segment = min(api.services.network.segments)
    position = VehiclePosition(
        vehicle=vehicle,
        time_ns=time.time_ns(),
        segment=segment,
        share=0.5,
        speed_mps=0.0,
        on_road=False,
        cycle=cycle,
        leg=0,
    )
    watch.on_position(position_key(vehicle), position.to_bytes())


def test_vehicles_show_position_plan_and_silence(serve: Callable[..., Api]) -> None:
    """A plan is on offer until its vehicle acknowledges it; who never reported is not silent."""
    api = serve()
    assert api.get("/v1/vehicles").json["vehicles"] == []
    api.dispatcher.run_cycle()
    _report(api, "van-a", 1)
    first, second = api.get("/v1/vehicles").json["vehicles"]
    assert (first["id"], first["reports"], first["silent"]) == ("van-a", True, False)
    assert first["position"]["share"] == 0.5
    assert (first["accepted"]["cycle"], first["accepted"]["status"]) == (1, "acknowledged")
    assert first["offered"] is None
    assert (second["reports"], second["silent"], second["position"]) == (False, False, None)
    assert (second["offered"]["status"], second["accepted"]) == ("published", None)
    assert api.get("/v1/vehicles/van-b").json == second


@pytest.mark.slow
def test_pages_follow_each_other_without_gaps(serve: Callable[..., Api]) -> None:
    """`next` of a page leads on to all vehicles, cycles and plans, each once."""
    api = serve()
    for _ in range(3):
        api.dispatcher.run_cycle()

    def all_of(path: str, key: str, parameter: str) -> list[Any]:
        found, following = [], None
        while True:
            query = "" if following is None else f"&{parameter}={following}"
            page = api.get(f"{path}?limit=1{query}").json
            found += page[key]
            following = page["next"]
            if following is None:
                return found

    vehicles = all_of("/v1/vehicles", "vehicles", "after")
    assert [v["id"] for v in vehicles] == ["van-a", "van-b"]
    assert [c["cycle"] for c in all_of("/v1/cycles", "cycles", "before")] == [3, 2, 1]
    history = all_of("/v1/plans/van-a", "history", "before")
    assert [p["cycle"] for p in history] == [3, 2, 1]
    assert [p["status"] for p in history] == ["published", "superseded", "superseded"]


@pytest.mark.slow
def test_cycles_of_a_range_of_time(serve: Callable[..., Api]) -> None:
    """They count by their begin, latest first; pages stay within it, and a range ends after its
    begin.
    """
    api = serve()
    for _ in range(4):
        api.dispatcher.run_cycle()
    begun = {c["cycle"]: c["started_ns"] for c in api.get("/v1/cycles").json["cycles"]}

    def numbers(query: str) -> list[int]:
        return [c["cycle"] for c in api.get(f"/v1/cycles?{query}").json["cycles"]]

    assert numbers(f"from={begun[2]}&until={begun[4]}") == [3, 2]
    assert numbers(f"from={begun[3]}") == [4, 3]
    assert numbers(f"until={begun[3]}") == [2, 1]
    page = api.get(f"/v1/cycles?from={begun[2]}&until={begun[4]}&limit=1").json
    assert ([c["cycle"] for c in page["cycles"]], page["next"]) == ([3], 3)
    page = api.get(f"/v1/cycles?from={begun[2]}&until={begun[4]}&limit=1&before=3").json
    assert ([c["cycle"] for c in page["cycles"]], page["next"]) == ([2], None)
    assert numbers("until=1") == []
    refused = api.get("/v1/cycles?from=2&until=1")
    assert (refused.status, refused.json["field"]) == (422, "from")


def test_plans_and_cycles_are_the_stored_ones(serve: Callable[..., Api], state: State) -> None:
    """What was published is what the API tells, with what became of it; lists have no gates."""
    api = serve()
    api.feed(state("avenue_east", 1, time_ns=time.time_ns(), rsu="rsu-1"))
    api.dispatcher.run_cycle()
    plans = api.get("/v1/plans/van-a").json
    assert plans["accepted"] is None
    (stored,) = plans["history"]
    assert (stored["plan"], stored["status"]) == (plans["offered"]["plan"], "published")
    cycle = api.get("/v1/cycles/1").json
    assert cycle["report"]["gates"]
    (listed,) = api.get("/v1/cycles").json["cycles"]
    assert listed == cycle["report"] | {"gates": []}
    assert plans["offered"]["plan"] in cycle["plans"]
    assert [plan["vehicle"] for plan in cycle["plans"]] == ["van-a", "van-b"]


def test_a_cycle_s_explanation_has_words_and_figures(serve: Callable[..., Api]) -> None:
    """Of the whole cycle and of one vehicle; an unknown cycle or vehicle is a problem."""
    api = serve(tokens=True)
    api.dispatcher.run_cycle()
    path = "/v1/cycles/1/explain"
    assert api.get(path, "orderer").status == 403
    found = api.get(path, "reader").json
    assert [one["vehicle"] for one in found["vehicles"]] == ["van-a", "van-b"]
    assert found["vehicles"][0]["account"]["driven_kwh"] > 0
    assert found["vehicles"][0]["lines"][0].startswith("serves ")
    assert {one["platoon"]["reason"] for one in found["refused"]} == {"unknown"}
    own = api.get(f"{path}?vehicle=van-b", "reader").json
    assert own["vehicles"] == found["vehicles"][1:]
    for missing, field in (
        (f"{path}?vehicle=van-z", "vehicle"),
        ("/v1/cycles/9/explain", "number"),
    ):
        answer = api.get(missing, "reader")
        assert (answer.status, answer.json["field"]) == (404, field)


def test_segments_show_states_and_what_their_gates_would_be(
    serve: Callable[..., Api], state: State
) -> None:
    """A calm road is open, one whose state is old is closed with the reason, as in a cycle."""
    api = serve()
    now_ns = time.time_ns()
    api.feed(state("avenue_east", 1, time_ns=now_ns, rsu="rsu-1"))
    names = sorted(set(api.services.network.segments) - {"avenue_east"})
    api.feed(state(names[0], 1, time_ns=now_ns - 4_000_000_000_000, rsu="rsu-2"))
    page = {s["id"]: s for s in api.get("/v1/segments").json["segments"]}
    assert set(page) == {"avenue_east", names[0]}
    assert (page["avenue_east"]["gate"]["open"], page["avenue_east"]["gate"]["y_e"]) == (True, 1)
    assert [s["rsu"] for s in page["avenue_east"]["states"]] == ["rsu-1"]
    assert (page[names[0]]["gate"]["open"], page[names[0]]["gate"]["reason"]) == (False, "stale")
    unwatched = api.get(f"/v1/segments/{names[1]}").json
    assert (unwatched["states"], unwatched["gate"]["reason"]) == ([], "unwatched")
    assert unwatched["length_m"] == api.services.network.segments[names[1]].length_m


REFUSED = {
    "/v1/vehicles/nobody": (404, "vehicle"),
    "/v1/plans/a%2Fb%3F": (404, "vehicle"),
    "/v1/plans/%00": (422, "vehicle"),
    "/v1/plans/": (404, None),
    f"/v1/vehicles/{201 * 'x'}": (422, "vehicle"),
    "/v1/cycles/7": (404, "number"),
    "/v1/cycles/seven": (422, "number"),
    "/v1/segments/no_road": (404, "segment"),
    "/v1/vehicles?limit=0": (422, "limit"),
    "/v1/cycles?limit=1001": (422, "limit"),
    "/v1/cycles?before=9999999999999999999999": (422, "before"),
    "/v1/vehicles?limits=3": (422, "limits"),
    "/v1/cycles?limit=1&limit=2": (422, "limit"),
    "/v1/events?kinds=plan,weather": (422, "kinds"),
    "/healthz?x=1": (422, "x"),
    "/v1/solve/none": (401, "Authorization"),
    "/v1": (404, None),
    "/docs": (404, None),
}


def test_each_refusal_is_a_problem_document(serve: Callable[..., Api]) -> None:
    """With status, detail, the field that is wrong, and how to mend it."""
    api = serve()
    for path, (status, field) in REFUSED.items():
        answer = api.get(path)
        document = answer.json
        assert answer.headers["content-type"] == "application/problem+json", path
        assert (answer.status, document["status"]) == (status, status), path
        assert (document.get("field"), document["type"]) == (field, "about:blank"), path
        assert document["detail"], path
        assert document["mend"], path


def test_what_the_page_shows_can_be_asked(serve: Callable[..., Api]) -> None:
    """Each address that docs/api.md gives as an example is answered."""
    api = serve(tokens=True)
    api.dispatcher.run_cycle()
    page = (Path(__file__).resolve().parents[4] / "docs" / "api.md").read_text()
    # Calls that change something are of several lines, or say POST.
    asked = [
        line for line in page.splitlines() if line.startswith("curl -s ") and "POST" not in line
    ]
    found = re.findall(r"localhost:8090(/v1/[^\s']*)", "\n".join(asked))
    assert {path.partition("?")[0] for path in found} >= {"/v1/cycles", "/v1/energy", "/v1/log"}
    for path in found:
        assert api.get(path, "reader").status == 200, path


def test_a_method_that_a_path_has_not_is_refused_with_those_it_has(
    serve: Callable[..., Api],
) -> None:
    """405 with `Allow`."""
    api = serve(tokens=True)
    answer = api.ask("PUT", "/v1/solve", "controller", {})
    assert (answer.status, answer.headers["allow"]) == (405, "POST")
    assert answer.json["status"] == 405


def test_a_database_that_fails_costs_its_own_answers_only(
    serve: Callable[..., Api], tmp_path: Any
) -> None:
    """503 that says so for what is stored; what is in memory is told all the same."""
    api = serve()
    api.dispatcher.run_cycle()
    for path in tmp_path.glob("d.db*"):
        path.unlink()
    (tmp_path / "d.db").write_bytes(b"no database" * 1000)
    answer = api.get("/v1/cycles")
    assert (answer.status, answer.headers["retry-after"]) == (503, "5")
    assert "Traceback" not in answer.body.decode()
    assert len(api.get("/v1/vehicles").json["vehicles"]) == 2


def test_a_fault_of_our_own_leaks_nothing(
    serve: Callable[..., Api], caplog: pytest.LogCaptureFixture
) -> None:
    """500 as a problem document; the traceback is in the log, once, and the next request works."""

    def broken() -> str | None:
        raise ZeroDivisionError("a secret of ours")

    api = serve(checks={"broken": broken})
    for _ in range(3):
        answer = api.get("/readyz")
        assert answer.status == 500
        assert b"secret" not in answer.body
        assert answer.json["status"] == 500
    assert [r.exc_info is not None for r in caplog.records if r.levelname == "ERROR"] == [True]
    assert api.get("/healthz").status == 200


def test_reading_does_not_wait_for_a_cycle_that_is_being_stored(serve: Callable[..., Api]) -> None:
    """While the tracker is locked, vehicles are told as they were before."""
    api = serve()
    api.dispatcher.run_cycle()
    before = api.get("/v1/vehicles").json
    with api.dispatcher.fleet_watch._lock:
        assert api.get("/v1/vehicles").json == before
