from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from dispatcher_daemon.fleet.learning import Learned
from dispatcher_daemon.service.api.solving import SolveJob, SolveJobs, vroom
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.errors import InputError

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
def test_a_request_in_vrooms_format_is_answered_at_once(
    serve: Callable[..., Api], jobs: SolveJobs
) -> None:
    """What fits is on the route, the rest unassigned with its reason; refusals have VROOM's code
    beside the problem document's members.
    """
    api = serve(tokens=True, solve_jobs=jobs)
    answer = api.ask("POST", "/v1/vroom?deadline_s=2", "controller", REQUEST)
    assert answer.status == 200
    assert answer.json["code"] == 0
    assert answer.json["summary"]["unassigned"] == 1
    (route,) = answer.json["routes"]
    jobs = {step["id"] for step in route["steps"] if step["type"] == "job"}
    (left,) = answer.json["unassigned"]
    assert jobs | {left["id"]} == {1, 2, 3}
    assert left["reason"]
    faulty = {**REQUEST, "vehicles": [{"id": 7, "strat_index": 0}]}
    wrong = api.ask("POST", "/v1/vroom", "controller", faulty)
    assert (wrong.status, wrong.json["status"], wrong.json["code"]) == (422, 422, 2)
    assert wrong.json["field"] == "vehicles.0"
    assert wrong.json["error"] == f"body: vehicles.0: {wrong.json['detail']}; {wrong.json['mend']}"
    assert "did you mean start_index?" in wrong.json["warnings"][0]
    assert wrong.headers["content-type"] == "application/problem+json"
    # The demo's roads are on no map.
    places = {
        "vehicles": [{"id": 1, "start": [2.0, 48.0]}],
        "jobs": [{"id": 1, "location": [2, 48]}],
    }
    refused = api.ask("POST", "/v1/vroom", "controller", places)
    assert (refused.status, refused.json["code"]) == (422, 3)
    assert refused.json["mend"]
    assert refused.json["detail"] in refused.json["error"]


def test_a_job_that_failed_says_why(serve: Callable[..., Api]) -> None:
    """503 where the network's file has changed; else 500 with the reason."""

    class Failing:
        """A queue whose jobs all fail."""

        def __init__(self, error: Exception) -> None:
            self.error = error

        def submit(self, deadline_s: float, make_task: object) -> SolveJob:
            return SolveJob("j", deadline_s, None, "failed", reason="lost", error=self.error)

        def wait_begun(self, job: SolveJob, within_s: float) -> bool:
            return True

        wait = wait_begun

        def leave(self, job: SolveJob) -> None:
            """Nothing is kept."""

        def close(self) -> None:
            """Nothing runs."""

    changed = Failing(InputError("roads.net", "the file has changed", "restart the dispatcher"))
    told = serve(tokens=True, solve_jobs=changed).ask("POST", "/v1/vroom", "controller", REQUEST)
    assert (told.status, told.json["mend"]) == (503, "restart the dispatcher")
    assert "has changed" in told.json["detail"]
    other = Failing(RuntimeError("lost"))
    told = serve(tokens=True, solve_jobs=other).ask("POST", "/v1/vroom", "controller", REQUEST)
    assert (told.status, told.json["detail"]) == (500, "the job failed: lost")


class _SlowToStart:
    """A queue whose turn comes at once, and whose process takes some time to start."""

    def __init__(self, start_s: float) -> None:
        self.start_s = start_s

    def submit(self, deadline_s: float, make_task: Callable[[], vroom.VroomTask]) -> SolveJob:
        self.left_s = 1e-9 * (make_task().answer_by_ns - time.time_ns()) - self.start_s
        return SolveJob("j", deadline_s, None, "running")

    def wait_begun(self, job: SolveJob, within_s: float) -> bool:
        return True

    def wait(self, job: SolveJob, within_s: float) -> bool:
        if within_s > self.start_s + job.deadline_s:
            job.state, job.result = "done", b'{"code": 0}'
        return job.result is not None

    def leave(self, job: SolveJob) -> None:
        """Nothing is kept."""

    def close(self) -> None:
        """Nothing runs."""


def test_the_first_request_is_answered_however_long_a_process_takes_to_start(
    serve: Callable[..., Api],
) -> None:
    """Within what proxies wait, and with its whole deadline left; else the refusal names no jobs
    that there are not.
    """
    queue = _SlowToStart(30.0)
    told = serve(tokens=True, solve_jobs=queue).ask(
        "POST", "/v1/vroom?deadline_s=10", "controller", REQUEST
    )
    assert (told.status, told.json) == (200, {"code": 0})
    assert queue.left_s > 10
    told = serve(tokens=True, solve_jobs=_SlowToStart(90.0)).ask(
        "POST", "/v1/vroom", "controller", REQUEST
    )
    assert (told.status, told.headers["retry-after"]) == (503, "10")
    assert told.json["detail"].startswith("no answer within 58 s")


def test_a_request_with_matrices_needs_no_roads(monkeypatch: pytest.MonkeyPatch) -> None:
    """And a task whose caller will not wait much longer is short."""
    seconds = []

    def solve(request: object, engine: object, deadline_s: float, *_: object, **__: object) -> Any:
        assert engine is None
        seconds.append(deadline_s)
        return {"code": 0}

    monkeypatch.setattr(vroom, "solve_vroom", solve)
    task = vroom.VroomTask(
        request=REQUEST,
        deadline_s=10.0,
        answer_by_ns=time.time_ns() + 5 * 10**9,
        geometry=False,
        choose_eta=False,
        settings=DispatcherSettings(network="/no/such/file"),
        roads="",
        states=(),
        learned=Learned({}, {}, None),
        now_ns=0,
        seed=1,
    )
    assert task() == b'{"code": 0}'
    assert 3.0 < seconds[0] <= 4.5
