from __future__ import annotations

import os
import time
import tomllib
from collections.abc import Callable, Iterator
from importlib import resources
from typing import Any

import pytest

from dispatcher_daemon.fleet.learning import Learned
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.api.solving import FullError, SolveJobs
from dispatcher_daemon.service.api.solving.worker import SolveTask
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.errors import InputError
from tests.dispatcher_daemon.service.waiting import wait_for

from .conftest import Api

DEMO: dict[str, Any] = tomllib.loads(
    (resources.files("dispatcher_daemon") / "data" / "demo_fleet.toml").read_text()
)


def _sleep() -> bytes:
    """A worker that hangs."""
    time.sleep(600)
    return b""


def _die() -> bytes:
    """A worker that is killed."""
    os._exit(9)


def _pid() -> bytes:
    """Some work, and who did it."""
    time.sleep(0.3)
    return str(os.getpid()).encode()


@pytest.fixture
def queue() -> Iterator[Callable[..., SolveJobs]]:
    """Factory of queues with a time beyond the deadline."""
    made: list[SolveJobs] = []

    def make(overhead_s: float = 60.0, **others: Any) -> SolveJobs:
        made.append(SolveJobs(overhead_s, **others))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.mark.slow
def test_a_fleet_is_checked_without_planning_it(serve: Callable[..., Api]) -> None:
    """200 for one that fits the roads; else what is wrong with it, by its key, and no job."""
    api = serve(tokens=True)

    def check(body: object) -> Any:
        return api.ask("POST", "/v1/solve?validate_only=true", "controller", body)

    assert check(DEMO).json == {
        "valid": True,
        "vehicles": len(DEMO["vehicles"]),
        "stops": len(DEMO["stops"]),
    }
    stops = [{**DEMO["stops"][0], "node": "nowhere"}, *DEMO["stops"][1:]]
    refused = check({**DEMO, "stops": stops})
    assert (refused.status, refused.json["field"]) == (422, f"stops.{stops[0]['id']}.node")
    assert "junction" in refused.json["mend"]
    strict = check({**DEMO, "stops": [{**DEMO["stops"][0], "service_s": "60"}]})
    assert (strict.status, strict.json["field"]) == (422, f"stops.{stops[0]['id']}.service_s")
    past = api.ask("POST", "/v1/solve?deadline_s=0", "controller", DEMO)
    assert (past.status, past.json["field"]) == (422, "deadline_s")


@pytest.mark.long
@pytest.mark.process
@pytest.mark.slow
def test_a_fleet_is_planned_in_a_process_of_its_own(
    serve: Callable[..., Api], jobs: SolveJobs
) -> None:
    """Submitted, polled at `Location`, done: the plans that a cycle of the same fleet makes."""
    api = serve(tokens=True, solve_jobs=jobs)
    submitted = api.ask("POST", "/v1/solve?deadline_s=5&seed=1", "controller", DEMO)
    assert submitted.status == 202
    address = submitted.headers["location"]
    assert address.endswith(submitted.json["id"])
    assert wait_for(lambda: api.get(address, "controller").json["ended_ns"] is not None)
    answer = api.get(address, "controller").json
    assert (answer["state"], answer["reason"]) == ("done", None)
    api.dispatcher.run_cycle()
    own = [record.plan for record in api.services.reader.latest_plan_records()]
    routes = [[s["stop"] for s in plan["stops"]] for plan in answer["result"]["plans"]]
    assert routes == [[s.stop for s in plan.stops] for plan in own]
    assert answer["result"]["report"]["cycle"] == 0
    assert api.ask("DELETE", address, "controller").json["state"] == "done"


def test_roads_that_have_changed_since_are_not_planned_on(demo: RoutingProblem) -> None:
    """The worker reads the network's file again, and refuses one that is not the dispatcher's."""
    learned = Learned({}, {}, None)
    task = SolveTask(DispatcherSettings(), "other roads", (), learned, 0, 1, demo.fleet)
    with pytest.raises(InputError, match="changed since"):
        task()


@pytest.mark.nightly
@pytest.mark.process
def test_a_worker_that_hangs_or_dies_costs_its_job_only(
    queue: Callable[..., SolveJobs],
) -> None:
    """The job fails with a reason, in time, and the next one runs."""
    hanging = queue(overhead_s=0.5)
    job = hanging.submit(0.5, lambda: _sleep)
    assert wait_for(lambda: job.state == "failed")
    assert job.reason == "no plan within 1 s"
    dying = queue()
    first, second = (dying.submit(1.0, lambda: _die) for _ in range(2))
    assert wait_for(lambda: second.state == "failed")
    assert "ProcessExpired" in str(first.reason)


@pytest.mark.process
@pytest.mark.slow
def test_a_running_job_can_be_cancelled(queue: Callable[..., SolveJobs]) -> None:
    """Its process is ended, and what waited behind it is worked on."""
    line = queue()
    running, waiting = (line.submit(300.0, lambda: _sleep) for _ in range(2))
    assert wait_for(lambda: running.future is not None)
    assert (running.state, waiting.state) == ("running", "waiting")
    assert line.cancel(running.id) is running
    assert wait_for(lambda: waiting.state == "running")
    assert (running.state, running.reason) == ("cancelled", "its caller cancelled it")
    assert line.cancel("nobody") is None


def test_the_queue_is_bounded_and_results_are_forgotten(
    queue: Callable[..., SolveJobs], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond the limit a job is refused; an hour after its end it is gone."""
    monkeypatch.setattr("dispatcher_daemon.service.api.solving.jobs.MAX_WAITING", 2)
    now_ns = [0]
    line = queue(clock=lambda: now_ns[0])

    def never_made() -> Any:
        raise RuntimeError("not to be made")

    with line._condition:  # The queue's own thread waits meanwhile.
        first, second = line.submit(1.0, never_made), line.submit(1.0, never_made)
        with pytest.raises(FullError):
            line.submit(1.0, never_made)
        line.cancel(first.id)
        line.cancel(second.id)
    assert line.get(first.id) is first
    now_ns[0] = round(3601e9)
    assert line.get(first.id) is None


@pytest.mark.process
@pytest.mark.long
def test_a_job_that_its_caller_has_left_is_forgotten_and_costs_no_process(
    queue: Callable[..., SolveJobs],
) -> None:
    """One that waits never runs; one that runs ends by itself, in the process of the next one."""
    line = queue()
    made = []

    def make() -> Any:
        made.append(1)
        return _pid

    first = line.submit(5.0, make)
    assert line.wait(first, 60.0)
    left, waiting, last = (line.submit(5.0, make) for _ in range(3))
    assert line.wait_begun(left, 60.0)
    assert wait_for(lambda: left.future is not None)
    assert not line.wait_begun(waiting, 0.0)
    line.leave(left)
    line.leave(waiting)
    assert line.wait(last, 60.0)
    assert (last.state, last.result) == ("done", first.result)
    assert (left.result, waiting.result, len(made)) == (None, None, 3)
    assert line.get(left.id) is line.get(waiting.id) is None
