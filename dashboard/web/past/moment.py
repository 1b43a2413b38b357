"""The page's tables of a past moment; pure."""

from __future__ import annotations

from typing import cast

from dashboard.live import Snapshot
from dashboard.view.model import VehicleView
from dashboard.view.roads import open_roads
from dashboard.view.troubles import of_alarms
from dashboard.view.vehicles import vehicle_views
from dashboard.web.past import views
from dashboard.web.past.views import Facts
from dashboard.web.tables import rows
from dashboard.web.tables.levels import raised, worst_by_row
from dashboard.web.tables.orders import order_row, servings
from dashboard.web.tables.rows import Moment, Row, Scene, TourRow, ms
from dashboard.web.tables.tables import status
from slipstream.messages import Alarm, Severity
from slipstream.orders import drafting_kwh
from storage import Event


def snapshot_at(facts: Facts) -> Snapshot:
    """The messages that are stored of a moment."""
    return Snapshot(
        plans=facts.plans_in_force,
        cycles=tuple(facts.cycles),
        orders=tuple(facts.orders),
        drafting_kwh=drafting_kwh(facts.plans),
    )


def moment_at(facts: Facts, snapshot: Snapshot, scene: Scene) -> Moment:
    """The tables of a moment; vehicles are where their plans put them."""
    roads = views.road_views(facts)
    names = {*scene.vehicles, *(record.plan.vehicle for record in facts.plans)}
    vans = vehicle_views(snapshot, facts.time_ns, open_roads(roads), names, live=False)
    partners = rows.platoons(van.plan for van in vans if not van.idle)
    alarms = {str(event.alarm): alarm_at(event, facts.time_ns) for event in facts.alarms}
    wrong = sorted(of_alarms(alarms.values()), key=lambda one: one.level != "bad")
    worst = worst_by_row(wrong)

    serving = servings(vans, snapshot.plans)

    def vehicle_row(van: VehicleView) -> Row:
        tour = TourRow.of(van.plan, scene)
        saved_kwh = snapshot.drafting_kwh.get((van.vehicle, van.plan.cycle))
        drawn = tour.drawn(van.open_roads)
        return rows.vehicle_row(van, tour, drawn, scene, partners, saved_kwh)

    return {
        "t": ms(facts.time_ns),
        "seq": 0,
        "live": False,
        "vehicles": raised({van.vehicle: vehicle_row(van) for van in vans}, worst.get("vehicles")),
        "roads": raised({road.segment: rows.road_row(road) for road in roads}, worst.get("roads")),
        "rsus": raised(views.rsu_rows(facts, scene.places), worst.get("rsus")),
        "orders": raised(
            {
                order.order: order_row(
                    order, serving.get(order.vehicle or ""), scene, facts.time_ns
                )
                for order in facts.orders
            },
            worst.get("orders"),
        ),
        "cycles": {
            str(report.cycle): rows.cycle_row(report) for report in facts.cycles[-rows.MAX_CYCLES :]
        },
        "alarms": {name: rows.alarm_row(alarm) for name, alarm in alarms.items()},
        "status": status(wrong, "No alarm was in force"),
        "energy": facts.energy,
        "next_cycle": None,
        "paused": facts.paused,
        "dispatcher_heard": False,
    }


def alarm_at(event: Event, time_ns: int) -> Alarm:
    """An alarm as it was at a moment: what came later was not known."""
    ended_ns, acknowledged_ns = event.ended_ns, event.acknowledged_ns
    acknowledged = acknowledged_ns is not None and acknowledged_ns <= time_ns
    return Alarm(
        id=str(event.alarm),
        severity=cast(Severity, event.severity),
        kind=event.kind,
        subject=event.subject,
        since_ns=event.time_ns,
        ended_ns=None if ended_ns is None or ended_ns > time_ns else ended_ns,
        text=event.text,
        mend=event.mend,
        acknowledged_by=event.acknowledged_by if acknowledged else None,
        acknowledged_ns=acknowledged_ns if acknowledged else None,
    )
