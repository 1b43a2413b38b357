"""The page's tables of one moment after the other, and what has changed between two; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from dashboard.live import Snapshot
from dashboard.settings import Factors
from dashboard.view.dispatcher import SILENT_AFTER_S
from dashboard.view.model import VehicleView
from dashboard.view.roads import road_limits
from dashboard.view.rsus import rsu_views
from dashboard.view.troubles import Trouble, bus_trouble, of_alarms, troubles
from dashboard.view.vehicles import vehicle_views
from dashboard.web.tables import rows
from dashboard.web.tables.levels import raised, raised_row, worst_by_row
from dashboard.web.tables.orders import Serving, changes_ns, order_row, servings
from dashboard.web.tables.road_table import RoadTable, identical
from dashboard.web.tables.rows import TABLES, Moment, Row, Rows, Scene, TourRow, ms
from slipstream.freshness import STALE_AFTER_S, age_s, fault
from slipstream.messages import CycleReport, VehiclePlan
from slipstream.orders import ENDED, OrderRecord

Partners = dict[tuple[str, str], list[str]]
OWN_ALARMS: Final = ("bus", "dispatcher", "database")
"""Subjects whose trouble the dispatcher may not be able to tell of: the page tells it."""
UNHEARD_AFTER_S: Final = 10.0
"""An RSU of the settings has so long to be heard first, from the page's start or since the bus
answers again, s: units that start with the page load their detector before."""
SETTLE_S: Final = 5.0
"""For so long after an outage of the bus silence tells nothing, s: each sender tries again to reach
the router within a second."""

_KnownOrder = tuple[OrderRecord, Serving | None, int | None, Row]
"""An order, its vehicle, UTC at which the clock changes its row, and that."""


class PageTables:
    """The tables of the latest moment; of roads only what has changed is made anew.

    Args:
        stale_after_s: age above which RSU health is stale, s, and road data where the dispatcher
            publishes no limit.
        rsus: roads by RSU, as far as the settings have them: listed though they were never heard.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        stale_after_s: float = STALE_AFTER_S,
        factors: Factors = rows.NO_FACTORS,
        rsus: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        self._scene, self._stale_after_s = scene, stale_after_s
        self._factors = factors
        self._rsus = dict(rsus or {})
        self._roads = RoadTable(self._rsus)
        self._down_ns: int | None = None
        self._answers_ns: int | None = None
        self._tours: dict[str, tuple[TourRow, tuple[bool, ...], list[list[int]]]] = {}
        self._partners: tuple[tuple[int, ...], tuple[VehiclePlan, ...], Partners] = (), (), {}
        self._orders: dict[str, _KnownOrder] = {}
        self._order_table: Rows = {}
        self._cycles: tuple[tuple[CycleReport, ...], Rows] = (), {}
        self._last_energy: Row | None = None
        self.moment: Moment = {
            "t": 0,
            "seq": 0,
            "live": True,
            **{table: {} for table in TABLES},
            "status": None,
            "energy": None,
            "next_cycle": None,
            "paused": False,
            "dispatcher_heard": False,
        }

    def update(
        self,
        snapshot: Snapshot,
        now_ns: int,
        *,
        energy: Mapping[str, Any] | None = None,
        pictured: bool = True,
    ) -> dict[str, Any] | None:
        """Bring `moment` up to a snapshot.

        Args:
            energy: what is saved today, this week, in total, and since when; None: not known.

        Returns:
            What has changed, as a browser gets it; None: nothing.
        """
        roads, stale_after_s = self._roads, self._stale_after_s
        roads.update(snapshot, now_ns, road_limits(snapshot.dispatcher, stale_after_s))
        rsus = rsu_views(snapshot.rsus, now_ns, stale_after_s, keep=self._rsus)
        vans = vehicle_views(snapshot, now_ns, roads.open, self._scene.vehicles)
        down = bus_trouble(snapshot, now_ns)
        unheard = self._unheard(snapshot, now_ns, down)
        wrong = troubles(
            snapshot,
            roads.standing,
            rsus,
            vans,
            now_ns,
            settling=self._down_ns is not None and age_s(self._down_ns, now_ns) < SETTLE_S,
            unheard=[name for name, overdue in unheard.items() if overdue],
        )
        heard = self._is_planning(snapshot, now_ns, wrong)
        rsu_rows = {rsu.rsu: rows.rsu_row(rsu, self._scene, pictured) for rsu in rsus}
        for name, overdue in unheard.items():
            rsu_rows[name] = rows.unheard_rsu_row(self._rsus[name], self._scene, overdue)
        if down is not None:
            rsu_rows = {n: raised_row(row, "warn", down.text) for n, row in rsu_rows.items()}
        alarms = () if snapshot.alarms is None else snapshot.alarms.alarms
        worst = worst_by_row((*wrong, *of_alarms(alarms)))
        new: Moment = {
            "vehicles": raised(
                self._vehicle_rows(vans, heard, snapshot.drafting_kwh),
                worst.get("vehicles"),
            ),
            "roads": raised(roads.rows, worst.get("roads")),
            "rsus": raised(dict(sorted(rsu_rows.items())), worst.get("rsus")),
            "orders": raised(self._order_rows(snapshot, vans, heard, now_ns), worst.get("orders")),
            "cycles": self._cycle_rows(snapshot),
            "alarms": self._alarm_rows(snapshot, wrong, now_ns),
            "status": status(wrong),
            "energy": self._energy(snapshot, energy),
            "next_cycle": _next_cycle(snapshot, heard),
            "paused": snapshot.dispatcher is not None and snapshot.dispatcher.paused,
            "dispatcher_heard": down is None and self._is_heard(snapshot, now_ns),
        }
        return self._take(new, ms(now_ns) or 0)

    def _is_heard(self, snapshot: Snapshot, now_ns: int) -> bool:
        health = snapshot.dispatcher
        if health is None:
            return False
        return fault(health.time_ns, now_ns, stale_after_s=SILENT_AFTER_S) is None

    def _is_planning(self, snapshot: Snapshot, now_ns: int, wrong: Sequence[Trouble]) -> bool:
        """Whether the dispatcher is heard, and nothing keeps it from planning."""
        if not self._is_heard(snapshot, now_ns):
            return False
        return not any(t.level == "bad" and t.subject in ("bus", "dispatcher") for t in wrong)

    def _unheard(self, snapshot: Snapshot, now_ns: int, down: Trouble | None) -> dict[str, bool]:
        """RSUs of the settings that were never heard, and whether they should have been by now."""
        if down is not None:
            self._down_ns = now_ns
        if down is not None or self._answers_ns is None:
            self._answers_ns = now_ns
        overdue = age_s(self._answers_ns, now_ns) > UNHEARD_AFTER_S
        return {name: overdue for name in self._rsus if name not in snapshot.rsus}

    def _take(self, new: Moment, t: int) -> dict[str, Any] | None:
        old = self.moment
        changed: dict[str, Any] = {"set": {}, "del": {}}
        for table in TABLES:
            before, after = old[table], new[table]
            roads = self._roads
            as_told = before is roads.before and after is roads.rows
            if table == "roads" and roads.changes is not None and as_told:
                told, gone = roads.changes, []
            else:
                told, gone = _changes(before, after), [n for n in before if n not in after]
            if told:
                changed["set"][table] = told
            if gone:
                changed["del"][table] = gone
        for key in ("status", "energy", "next_cycle", "paused", "dispatcher_heard"):
            if old[key] != new[key]:
                changed[key] = new[key]
        if len(changed) == 2 and not changed["set"] and not changed["del"]:
            old["t"] = t
            return None
        seq = old["seq"] + 1
        self.moment = {"t": t, "seq": seq, "live": old["live"], **new}
        return {"t": t, "seq": seq, **changed}

    def _vehicle_rows(
        self,
        vans: tuple[VehicleView, ...],
        heard: bool,
        drafting_kwh: Mapping[tuple[str, int], float],
    ) -> Rows:
        known, self._tours = self._tours, {}
        plans, made = tuple(van.plan for van in vans if not van.idle), {}
        key = tuple(map(id, plans))
        if self._partners[0] != key:
            # The plans are kept with their ids, so that no other one gets these.
            self._partners = key, plans, rows.platoons(plans)
        for van in vans:
            tour, was_open, drawn = known.get(van.vehicle) or (None, (), [])
            if tour is None or (tour.plan is not van.plan and tour.plan != van.plan):
                tour, drawn = TourRow.of(van.plan, self._scene), []
            is_open = tuple(road in van.open_roads for road in tour.shared)
            if not drawn or was_open != is_open:
                drawn = tour.drawn(van.open_roads)
            self._tours[van.vehicle] = tour, is_open, drawn
            saved_kwh = drafting_kwh.get((van.vehicle, van.plan.cycle))
            row = rows.vehicle_row(van, tour, drawn, self._scene, self._partners[2], saved_kwh)
            if not heard and (row["level"] == "ok" or row["state"] == "planned"):
                # Nobody plans for it any more, or its place cannot be confirmed.
                row["level"] = "warn"
            made[van.vehicle] = row
        return made

    def _order_rows(
        self, snapshot: Snapshot, vans: tuple[VehicleView, ...], heard: bool, now_ns: int
    ) -> Rows:
        serving = servings(vans, snapshot.plans)
        oldest_ns = now_ns - round(rows.ENDED_ORDERS_FOR_S * 1e9)
        shown = sorted(
            (order for order in snapshot.orders if not order.ended or order.since_ns > oldest_ns),
            key=lambda order: (order.ended, -order.since_ns),
        )
        known, self._orders = self._orders, {}
        same = len(known) == min(len(shown), rows.MAX_ORDERS)
        for order in shown[: rows.MAX_ORDERS]:
            # One that has ended is judged by no vehicle, whose plan may change each few seconds.
            name, by = order.order, None if order.ended else serving.get(order.vehicle or "")
            before = known.get(name)
            # Orders and plans are replaced, never changed.
            if (
                before is None
                or before[0] is not order
                or before[1] != by
                or _is_due(before, now_ns)
            ):
                row = order_row(order, by, self._scene, now_ns)
                before = order, by, changes_ns(order, row, by, now_ns), row
                same = False
            self._orders[name] = before
        if not same:
            self._order_table = {name: entry[3] for name, entry in self._orders.items()}
        if heard:
            return self._order_table
        # Nobody plans for what is open any more.
        return {
            name: {**row, "level": "warn"}
            if row["level"] == "ok" and row["state"] not in ENDED
            else row
            for name, row in self._order_table.items()
        }

    def _cycle_rows(self, snapshot: Snapshot) -> Rows:
        shown = tuple(snapshot.cycles[-rows.MAX_CYCLES :])
        if not identical(self._cycles[0], shown):
            self._cycles = shown, {str(report.cycle): rows.cycle_row(report) for report in shown}
        return self._cycles[1]

    def _alarm_rows(self, snapshot: Snapshot, wrong: tuple[Trouble, ...], now_ns: int) -> Rows:
        told = () if snapshot.alarms is None else snapshot.alarms.alarms
        made = {alarm.id: rows.alarm_row(alarm) for alarm in told}
        in_force = {alarm.subject for alarm in told if alarm.ended_ns is None}
        for trouble in wrong:
            if trouble.subject not in OWN_ALARMS or trouble.subject in in_force:
                continue
            name = f"page/{trouble.subject}/{trouble.level}"
            before = self.moment["alarms"].get(name, {}).get("since")
            made[name] = rows.own_alarm_row(trouble, before or ms(trouble.since_ns) or ms(now_ns))
        return made

    def _energy(self, snapshot: Snapshot, told: Mapping[str, Any] | None) -> Row:
        reports = (report for report in reversed(snapshot.cycles) if report.energy is not None)
        # A cycle without a vehicle to plan has no energy, and leaves the last figures standing.
        last = next((r for r in reports if r.energy and r.energy.baseline_kwh > 0), None)
        if last is not None and last.energy is not None:
            self._last_energy = rows.cycle_energy(last.energy, self._factors)
        unknown = {"today": None, "week": None, "total": None, "since": None}
        return {**unknown, **(told or {}), "last_cycle": self._last_energy}


def _is_due(known: _KnownOrder, now_ns: int) -> bool:
    return known[2] is not None and now_ns > known[2]


def _changes(before: Rows, after: Rows) -> Rows:
    """New rows, and the fields that differ of those that were there before."""
    told = {}
    for name, row in after.items():
        known = before.get(name)
        if known is None:
            told[name] = row
        elif known is not row and known != row:
            told[name] = {key: value for key, value in row.items() if known[key] != value}
    return told


def status(wrong: Sequence[Trouble], well: str = "All is well") -> Row:
    """The banner: the worst first, with the number of things that are wrong; `well` of none."""
    items = [
        {"subject": t.subject, "level": t.level, "text": t.text, "since": ms(t.since_ns)}
        for t in wrong
    ]
    return {
        "level": wrong[0].level if wrong else "ok",
        "text": wrong[0].text if wrong else well,
        "count": len(items),
        "items": items,
    }


def _next_cycle(snapshot: Snapshot, heard: bool) -> int | None:
    health = snapshot.dispatcher
    return None if health is None or not heard else ms(health.next_cycle_ns)
