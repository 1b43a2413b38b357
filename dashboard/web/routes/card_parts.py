"""Parts of the cards; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from dashboard.live import Snapshot
from dashboard.settings import Factors
from dashboard.view import labels
from dashboard.web.past.views import majority
from dashboard.web.routes.vehicle_parts import Part, sentence
from dashboard.web.tables import rows
from dashboard.web.tables.rows import Known, ms
from slipstream import freshness
from slipstream.explain import Explanation
from slipstream.messages import CameraCalibration, CycleReport, SegmentState
from slipstream.orders import OrderChange, OrderRecord
from slipstream.roads import Segment
from storage import RollUp

_FEATURES: Final = (
    ("mean_speed_mps", "mean speed", "km/h", 3.6, None),
    ("mean_acceleration_mps2", "mean acceleration", "m/s²", 1.0, None),
    ("density_veh_per_m", "density", "vehicles/km", 1000.0, None),
    ("speed_std_mps", "speed spread", "km/h", 3.6, "max_speed_cv"),
    (
        "acceleration_variance_m2ps4",
        "acceleration variance",
        "m²/s⁴",
        1.0,
        "max_acceleration_variance_m2ps4",
    ),
    ("mean_gap_m", "mean gap", "m", 1.0, None),
)
"""The six features: field, name, unit, factor to the unit, and which limit of a unit's it has."""


def road_facts(segment: Segment | None) -> Part:
    """What the network says of a road."""
    return {
        "name": None if segment is None else segment.name or None,
        "length_m": None if segment is None else round(segment.length_m, 1),
        "limit_kmh": None if segment is None else round(segment.speed_limit_mps * 3.6),
    }


def _judged_by(road: str, known: Known) -> SegmentState | None:
    """The state that a road is judged by, if it is fresh."""
    row = known.moment["roads"].get(road)
    state = None if row is None else known.snapshot.states.get((road, row["rsu"] or ""))
    if state is None or freshness.fault(state.time_ns, known.now_ns) is not None:
        return None
    return state


def stable_share(road: str, known: Known) -> float | None:
    """Probability that its traffic is stable; None: nothing tells it."""
    state = _judged_by(road, known)
    return None if state is None or state.p_stable is None else round(state.p_stable, 3)


def features(road: str, known: Known) -> list[Part]:
    """The six features of the state that a road is judged by, with the limits that they are
    held against.
    """
    state = _judged_by(road, known)
    measured = None if state is None else state.features
    if state is None or measured is None:
        return []
    limits = _limits_of(known.snapshot, state)
    found = []
    for field, name, unit, factor, limit in _FEATURES:
        estimate = getattr(measured, field)
        if estimate is None:
            continue
        threshold = limits.get(limit or "")
        if threshold is not None and limit == "max_speed_cv":
            # Held against a share of the mean speed.
            threshold *= measured.mean_speed_mps.value
        error = estimate.standard_error
        found.append(
            {
                "name": name,
                "value": round(estimate.value * factor, 3),
                "unit": unit,
                "standard_error": None if error is None else round(error * factor, 3),
                "threshold": None if threshold is None else round(threshold * factor, 3),
                "crossed": threshold is not None and estimate.value > threshold,
            }
        )
    return found


def features_of_minute(minutes: Sequence[RollUp], time_ns: int) -> list[Part]:
    """The same of a past moment: means of its minute. Errors and limits are not stored."""
    minute = next(
        (one for one in minutes if one.began_ns <= time_ns < one.began_ns + one.period_s * 10**9),
        None,
    )
    if minute is None or minute.period_s != 60:
        return []
    return [
        {
            "name": name,
            "value": round(minute.features[field].mean * factor, 3),
            "unit": unit,
            "standard_error": None,
            "threshold": None,
            "crossed": False,
        }
        for field, name, unit, factor, _ in _FEATURES
        if field in minute.features
    ]


def _limits_of(snapshot: Snapshot, state: SegmentState) -> Mapping[str, float | None]:
    health = snapshot.rsus.get(state.rsu)
    limits = None if health is None else health.stability
    return {} if limits is None else limits.model_dump()


_SERIES: Final = (
    ("kmh", "mean_speed_mps", 3.6, 1),
    ("acceleration", "mean_acceleration_mps2", 1.0, 3),
    ("density", "density_veh_per_m", 1000.0, 1),
    ("headway", "mean_gap_m", 1.0, 1),
    ("cv", "speed_std_mps", 1.0, 3),
    ("variance", "acceleration_variance_m2ps4", 1.0, 3),
)
"""Series of the last hour: name, feature, factor to the page's unit, digits."""


def hour(minutes: Sequence[RollUp]) -> Part:
    """The last hour by minutes: of each feature the mean of a minute's states, the least and the
    most. The spread of speed is told as a share of the minute's mean speed, as its limit is.
    """
    told: Part = {"t": [ms(minute.began_ns) for minute in minutes]}
    for name, feature, factor, digits in _SERIES:
        for suffix, which in (("", "mean"), ("_low", "min"), ("_high", "max")):
            told[name + suffix] = [
                _rolled(minute, feature, which, factor, digits, share=name == "cv")
                for minute in minutes
            ]
    return told | {"flag": [majority(minute) for minute in minutes]}


def _rolled(
    minute: RollUp, feature: str, which: str, factor: float, digits: int, *, share: bool
) -> float | None:
    spread = minute.features.get(feature)
    speed = minute.features.get("mean_speed_mps")
    if spread is None or (share and (speed is None or not speed.mean)):
        return None
    value: float = getattr(spread, which)
    return round(value * factor / (speed.mean if share and speed is not None else 1.0), digits)


def refused(road: str, known: Known) -> list[Part]:
    """Whom the last cycle's closed gate keeps apart: those whose plans lead over the road."""
    report = known.snapshot.cycles[-1] if known.snapshot.cycles else None
    gate = next((gate for gate in report.gates if gate.segment == road), None) if report else None
    if report is None or gate is None or gate.open:
        return []
    vehicles = sorted(
        plan.vehicle
        for plan in known.snapshot.plans.values()
        if any(part.segment == road and part.exit_ns > known.now_ns for part in plan.segments)
    )
    if len(vehicles) < 2:
        return []
    return [
        {
            "cycle": report.cycle,
            "t": ms(report.started_ns),
            "vehicles": vehicles,
            "why": labels.gate_reason(gate.y_e, gate.reason),
        }
    ]


def stopped(road: str, known: Known) -> list[Part]:
    """Vehicles that stand on a road as in no queue."""
    return [
        {"lane": one.lane, "along_m": round(one.along_m), "since": ms(one.since_ns)}
        for (segment, _), told in known.snapshot.stopped.items()
        if segment == road and freshness.fault(told.time_ns, known.now_ns) is None
        for one in told.unusual
    ]


def rsu_facts(rsu: str, snapshot: Snapshot) -> Part:
    """What a unit's health and the dispatcher say of it beside its row."""
    health = snapshot.rsus.get(rsu)
    heard = () if snapshot.dispatcher is None else snapshot.dispatcher.rsus
    reception = next((one for one in heard if one.rsu == rsu), None)
    told: Part = {} if health is None else health.model_dump()
    return {
        "source": told.get("source"),
        "started": ms(told.get("started_ns")),
        "frames": told.get("frames"),
        "repeated": told.get("frames_repeated"),
        "decode_errors": told.get("decode_errors"),
        "reconnects": told.get("reconnects"),
        "rss_mb": told.get("rss_mb"),
        "reception": None if reception is None else reception.model_dump(exclude={"rsu"}),
        "calibration": None if health is None else _calibration(health.calibration),
    }


def _calibration(told: CameraCalibration | None) -> Part | None:
    if told is None:
        return None
    error = told.speed_error
    return {
        "file": told.file,
        "written": ms(told.written_ns),
        "points": told.points,
        "residual_px": round(told.residual_px, 2),
        "speed_error": None if error is None else round(error, 4),
    }


def order_step(change: OrderChange) -> Part:
    """One change in an order's life."""
    return {
        "t": ms(change.time_ns),
        "state": change.state,
        "reason": change.reason,
        "vehicle": change.vehicle,
        "cycle": change.cycle,
    }


def order_facts(order: OrderRecord | None) -> Part:
    """What an order asks for beside its row."""
    request = (order.request if order is not None else None) or {}
    return {
        "demand": None if order is None else order.demand,
        "mass_kg": request.get("mass_kg"),
        "service_s": None if order is None else order.service_s,
        "skills": list(request.get("skills", ())),
    }


def cycle_card(report: CycleReport, factors: Factors, words: Explanation | None) -> Part:
    """All about a cycle."""
    energy = None if report.energy is None else rows.cycle_energy(report.energy, factors)
    return {
        "n": report.cycle,
        **rows.cycle_row(report),
        "solvers": [run.model_dump(mode="json") for run in report.solvers],
        "unserved": [one.model_dump(mode="json") for one in report.unserved],
        "energy": energy,
        "explain": None
        if words is None
        else {
            "summary": [sentence(line) for line in words.summary],
            "vehicles": [{"id": one.vehicle, "lines": list(one.lines)} for one in words.vehicles],
            "orders": [
                {"id": one.inserted.stop, "lines": list(one.lines)} for one in words.inserted
            ],
            "refused": [one.line for one in words.refused],
            "notes": list(words.notes),
        },
    }
