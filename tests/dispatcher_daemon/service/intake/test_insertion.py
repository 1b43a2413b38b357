"""Orders that come between cycles are put into tours that have not begun, or say why not."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dispatcher_daemon.fleet import fleet_from
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.replay import replayed
from slipstream.explain import explanation
from slipstream.messages import (
    CycleReport,
    PlanAcknowledgement,
    VehiclePlan,
    VehiclePosition,
    acknowledgement_key,
    position_key,
)
from storage import CycleInputs, Part, StoredCycle, open_reader
from tests.dispatcher_daemon.service.reporting import accept

from .conftest import request
from .desk import SOLVE, Desk, depart, opened

pytestmark = pytest.mark.slow


@pytest.fixture
def vans(town: Callable[..., Any]) -> RoutingProblem:
    """Two vans of one depot, and a stop of the file for each of them."""
    problem, _ = town(
        [
            {"id": "f0", "node": "03", "vehicle": "van-0"},
            {"id": "f1", "node": "30", "vehicle": "van-1"},
        ],
        [{"capacity": 5}, {"capacity": 9}],
    )
    data = problem.fleet.model_dump(mode="json", exclude_none=True)
    return replace(problem, fleet=fleet_from(data, problem.network, "vans"))


def stand(desk: Desk, plan: VehiclePlan) -> None:
    """A vehicle stands at its depot, follows a plan, and has not left."""
    position = VehiclePosition(
        vehicle=plan.vehicle,
        time_ns=time.time_ns(),
        segment="00-01",
        share=0.0,
        speed_mps=0.0,
        on_road=False,
        cycle=plan.cycle,
        leg=0,
    )
    desk.dispatcher.fleet_watch.on_position(position_key(plan.vehicle), position.to_bytes())


def served(plan: VehiclePlan) -> list[str]:
    """Stops of a plan."""
    return [stop.stop for stop in plan.service_stops]


def test_an_order_is_in_a_plan_before_the_next_cycle(vans: RoutingProblem, tmp_path: Path) -> None:
    """In the tour that it costs least in; no other stop changes its vehicle or its turn."""
    with opened(vans, tmp_path) as desk:
        desk.dispatcher.run_cycle()
        (first,), (other,) = desk.bus.plans("van-0"), desk.bus.plans("van-1")
        desk.intake.submit([request("o", node="02", demand=3)])
        desk.dispatcher.insert(["o"])
        told = desk.intake.show("o")
        assert (told.state, told.vehicle, told.cycle) == ("planned", "van-0", first.cycle + 1)
        (_, amended) = desk.bus.plans("van-0")
        assert sorted(served(amended)) == ["f0", "o"]
        assert amended.depart_ns >= first.depart_ns
        assert desk.bus.plans("van-1") == [other]
        report = [m for m in desk.bus.sent if isinstance(m, CycleReport)][-1]
        assert (report.cycle, report.status, report.solver) == (amended.cycle, "ok", "insertion")
        assert {s.stop: desk.state(s.stop) for s in other.service_stops} == {"f1": "planned"}
    with opened(vans, tmp_path) as desk:
        assert desk.state("o") == "planned"


@pytest.mark.parametrize("accepts", [True, False])
def test_a_vehicle_that_has_accepted_may_refuse_what_came_later(
    vans: RoutingProblem, tmp_path: Path, accepts: bool
) -> None:
    """Then it keeps its plan, and the order is open again."""
    with opened(vans, tmp_path) as desk:
        desk.dispatcher.run_cycle()
        (plan,) = desk.bus.plans("van-0")
        accept(desk.dispatcher, plan)
        stand(desk, plan)
        desk.intake.submit([request("o", node="02", vehicle="van-0")])
        desk.dispatcher.insert(["o"])
        amended = desk.bus.plans("van-0")[-1]
        assert served(amended) == ["o", "f0"] or served(amended) == ["f0", "o"]
        answer = PlanAcknowledgement(
            vehicle="van-0",
            time_ns=time.time_ns(),
            cycle=amended.cycle,
            accepted=accepts,
            reason=None if accepts else "full",
        )
        watch = desk.dispatcher.fleet_watch
        watch.on_acknowledgement(acknowledgement_key("van-0"), answer.to_bytes())
        assert desk.state("f0") == "planned"
        assert desk.state("o") == ("planned" if accepts else "open")
        record = watch.vehicles().vehicles["van-0"].accepted
        assert record is not None
        assert record.plan == (amended if accepts else plan)


def test_who_has_left_or_is_full_gets_nothing_more(vans: RoutingProblem, tmp_path: Path) -> None:
    """The order waits for the next cycle, and says so."""
    with opened(vans, tmp_path) as desk:
        desk.dispatcher.run_cycle()
        (plan,) = desk.bus.plans("van-1")
        accept(desk.dispatcher, plan)
        depart(desk, plan)
        desk.intake.submit([request("o", node="02", demand=6), request("p", vehicle="van-1")])
        desk.dispatcher.insert(["o", "p"])
        for name in ("o", "p"):
            told = desk.intake.show(name)
            assert (told.state, told.vehicle) == ("open", None)
            assert str(told.unplanned).startswith("no tour that has not begun may take it")
        assert len(desk.bus.plans("van-0")) == len(desk.bus.plans("van-1")) == 1


def test_what_the_file_has_loaded_counts(town: Callable[..., Any], tmp_path: Path) -> None:
    """A van that the file's stop fills gets no other parcel, by mass as by capacity."""
    problem, _ = town([{"id": "f0", "node": "03", "mass_kg": 800.0}], [{"type": "van"}])
    payload_kg = problem.fleet.type_of(problem.fleet.vehicles[0]).payload_kg
    with opened(problem, tmp_path) as desk:
        desk.dispatcher.run_cycle()
        for name, mass_kg in (("heavy", payload_kg - 700.0), ("light", payload_kg - 900.0)):
            desk.intake.submit([request(name, mass_kg=mass_kg)])
            desk.dispatcher.insert([name])
        assert {name: desk.state(name) for name in ("f0", "heavy", "light")} == {
            "f0": "planned",
            "heavy": "open",
            "light": "planned",
        }


def test_an_insertion_is_told_in_words_and_made_again_the_same(
    vans: RoutingProblem, tmp_path: Path
) -> None:
    """Its tours, costs and obstacles are stored with it; changed inputs give another plan."""
    url = f"sqlite:///{tmp_path / 'a.db'}"
    with opened(vans, tmp_path) as desk, open_reader(url) as reader:
        desk.dispatcher.run_cycle()
        desk.intake.submit(
            [request("o", node="02", demand=3), request("p", demand=5, vehicle="van-0")]
        )
        desk.dispatcher.insert(["o", "p"])
        number = desk.intake.show("o").cycle
        assert number is not None
        cycle = reader.stored_cycle(number)
        assert cycle is not None
        assert cycle.inputs is not None
        told = explanation(cycle.report, cycle.plans, cycle.inputs.record)
        lines = {one.inserted.stop: one.lines for one in told.inserted}
        assert lines["o"][0].startswith("goes to van-0, ")
        assert lines["o"][1].startswith("van-1, ")
        assert lines["p"][0].endswith("more than its capacity of 5")
        assert lines["p"][1] == "van-1: it is kept for van-0"
        own = told.of_vehicle("van-1")
        assert own is not None
        assert len(own.inserted[0].lines) == 2
        assert told.notes == ()

        def again(of: StoredCycle) -> tuple[str, ...]:
            with ThreadPoolExecutor(1) as thread:
                return replayed(of, reader.plan, SOLVE, thread).differences

        assert again(cycle) == ()
        vehicles = json.loads(cycle.inputs.parts["vehicles"].content)
        full = [v | ({"capacity": 1} if v["id"] == "van-0" else {}) for v in vehicles]
        parts = {**cycle.inputs.parts, "vehicles": Part.of(json.dumps(full).encode())}
        changed = replace(cycle, inputs=CycleInputs(cycle.inputs.record, parts))
        assert any(line.startswith("van-0: ") for line in again(changed))


def test_an_insertion_that_takes_too_long_is_dropped(
    vans: RoutingProblem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its plans would begin in the past; the order waits for the next cycle, and says so."""
    with opened(vans, tmp_path) as desk:
        desk.dispatcher.run_cycle()
        desk.intake.submit([request("o", node="02")])
        with monkeypatch.context() as patch:
            patch.setattr("dispatcher_daemon.service.dispatcher.runner.INSERTION_S", 0.0)
            desk.dispatcher.insert(["o"])
        told = desk.intake.show("o")
        assert told.state == "open"
        assert str(told.unplanned).endswith("it waits for the next cycle")
        assert len(desk.bus.plans("van-0")) == 1
        desk.dispatcher.run_cycle()
        assert desk.state("o") == "planned"
