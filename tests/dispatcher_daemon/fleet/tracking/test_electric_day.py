"""A van with a small battery under way for a morning: it charges, and serves every order once."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.tracking import FleetTracker
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.messages import VehiclePlan

_SPEC = importlib.util.spec_from_file_location(
    "electric_fleet_drive", Path(__file__).parent / "fleet_drive.py"
)
assert _SPEC is not None
assert _SPEC.loader is not None
fleet_drive = importlib.util.module_from_spec(_SPEC)
sys.modules["electric_fleet_drive"] = fleet_drive
_SPEC.loader.exec_module(fleet_drive)

S = 10**9
CYCLES = 80
SETTINGS = DispatcherSettings(
    solvers=("exact",),
    form="route",
    city=CitySettings(
        search=SearchSettings(rounds=1, iterations_per_stop=20, time_limit_s=5.0),
        second_rounds=0,
        max_sweeps=2,
    ),
)


def test_a_van_charges_on_its_way_and_serves_every_order_once(
    town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]],
) -> None:
    """While it is on its way to charge it is left alone; no plan goes below its reserve."""
    own_type = {"battery_kwh": 0.6, "battery_reserve": 0.1}
    problem, snapshot = town(["30", "33", "03", "22"], [{"id": "v", "own_type": own_type}])
    charging = [{"id": "fast", "node": "21", "power_kw": 30.0}]
    file = Fleet.model_validate(problem.fleet.model_dump() | {"charging_stops": charging})
    tracker, van = FleetTracker(problem.network), fleet_drive.Van("v", "00-01")
    now_ns, sent, reasons = snapshot.now_ns, list[VehiclePlan](), set[str]()
    for number in range(1, CYCLES + 1):
        tracker.list_fleet(file, now_ns)
        situation = tracker.situation(file, number, now_ns, SETTINGS.deadline_s)
        reasons |= set(situation.left_out.values())
        plans: tuple[VehiclePlan, ...] = ()
        if situation.fleet is not None:
            seen = TrafficSnapshot(now_ns, snapshot.segments, ())
            cycle = Cycle(
                RoutingProblem(problem.network, situation.fleet),
                seen,
                SETTINGS,
                number,
                now_ns,
                number,
                commitments=situation.commitments,
            )
            result = run_cycle(cycle, solve_in_process([ExactSolver()]))
            assert result.report.status != "failed", result.report.reason
            plans = tracker.admissible(result.plans)
            reference_ns = now_ns + round(SETTINGS.deadline_s * S)
            tracker.publish(plans, situation.fleet.stop_by_id, reference_ns, now_ns)
            sent += plans
        for second in range(30):
            now_ns += S
            if second == 2:
                for plan in plans:
                    van.offer(plan, now_ns)
            position, progress = van.step(now_ns)
            if van.answer is not None:
                tracker.on_acknowledgement(van.answer, now_ns)
                van.answer = None
            tracker.on_position(position, now_ns)
            tracker.on_progress(progress, now_ns)
        if {order.state for order in tracker.book.orders.values()} == {"served"}:
            break
    assert {order.state for order in tracker.book.orders.values()} == {"served"}
    assert "is on its way to charge or to a hub, or stands there" in reasons
    charged = [stop for plan in sent for stop in plan.stops if stop.charged_kwh > 0]
    assert charged
    assert all(stop.stop == "fast" for stop in charged)
    charges = [stop.charge_kwh for plan in sent for stop in plan.stops]
    assert all(charge is not None and charge >= 0.06 - 1e-4 for charge in charges)
    assert set(van.refused) <= {"elsewhere", "not on this way"}
