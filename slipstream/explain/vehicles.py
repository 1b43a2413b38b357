"""Each vehicle of a stored cycle in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from slipstream.explain.facts import CycleFacts, VehicleAccount
from slipstream.explain.words import duration, in_kwh, more_or_less, way
from slipstream.messages import PlannedSegment, VehiclePlan
from slipstream.orders import utc


@dataclass(frozen=True)
class VehicleExplanation:
    """One vehicle of a cycle.

    Attributes:
        vehicle: its id.
        lines: in words.
        account: its figures; None: they are not stored, or not any more.
        platoons: those of its lines that tell of platoons.
    """

    vehicle: str
    lines: tuple[str, ...]
    account: VehicleAccount | None
    platoons: tuple[str, ...] = ()


def explained_vehicles(
    plans: Sequence[VehiclePlan], facts: CycleFacts | None
) -> Iterator[VehicleExplanation]:
    """The vehicles of a cycle, in the order of its fleet."""
    plan_of = {plan.vehicle: plan for plan in plans}
    accounts = {} if facts is None else {one.vehicle: one for one in facts.accounts}
    made = () if facts is None else facts.made
    served_before = {stop: v for v, one in accounts.items() for stop in one.baseline_stops}
    served = {stop: v for v, one in accounts.items() for stop in one.stops}
    for vehicle in dict.fromkeys([*accounts, *plan_of]):
        account, plan = accounts.get(vehicle), plan_of.get(vehicle)
        lines: list[str] = []
        platoons = () if plan is None else tuple(_platoon_lines(plan, plans))
        if account is not None:
            lines += _stop_lines(account, served, served_before)
            lines += _figure_lines(account)
        elif plan is not None:
            stops = [stop.stop for stop in plan.service_stops]
            lines.append(f"serves {', '.join(stops) or 'no stop'}, {in_kwh(plan.energy_kwh)}")
        if plan is not None:
            lines += _break_lines(plan)
            lines += platoons
        elif account is not None and account.driven_kwh > 0:
            lines.append(
                "its new plan was not sent, as it reported something else meanwhile"
                if vehicle in made
                else "its plan says what the one says that it has, so none was sent"
            )
        yield VehicleExplanation(vehicle, tuple(lines), account, platoons)


def _stop_lines(
    account: VehicleAccount, served: dict[str, str], served_before: dict[str, str]
) -> Iterator[str]:
    if not account.stops and account.driven_kwh == 0:
        if account.baseline_stops:
            others = ", ".join(f"{s} ({served.get(s, 'nobody')})" for s in account.baseline_stops)
            yield f"stays where it is; in the baseline it serves what others do now: {others}"
        else:
            yield "stays where it is, in the baseline too: others serve all stops at less cost"
        return
    line = f"serves {', '.join(account.stops) or 'no stop, it drives home'}"
    if account.stops == account.baseline_stops:
        yield f"{line}, as in the baseline"
        return
    if set(account.stops) == set(account.baseline_stops):
        yield f"{line}; in the baseline in the order {', '.join(account.baseline_stops)}"
        return
    yield line
    taken = [s for s in account.stops if s not in account.baseline_stops]
    given = [s for s in account.baseline_stops if s not in account.stops]
    if taken:
        names = ", ".join(f"{s} (from {served_before.get(s, 'nobody')})" for s in taken)
        yield f"more than in the baseline: {names}"
    if given:
        names = ", ".join(f"{s} (to {served.get(s, 'nobody')})" for s in given)
        yield f"less than in the baseline: {names}"


def _figure_lines(account: VehicleAccount) -> Iterator[str]:
    if account.driven_kwh == 0:
        return
    drafting = account.alone_kwh - account.driven_kwh
    line = f"needs {in_kwh(account.driven_kwh)}"
    if drafting > 1e-9:
        line += (
            f", alone on the same way {in_kwh(account.alone_kwh)}: platoons save "
            f"{in_kwh(drafting)} over {account.platooned_m:.0f} m"
        )
    else:
        line += ", as much as alone: it is in no platoon that saves anything"
    yield line
    if account.baseline_kwh > 0:
        change = account.driven_kwh - account.baseline_kwh
        yield (
            f"that is {more_or_less(change)} than in the baseline; it drives for "
            f"{duration(account.driving_s)}, there for {duration(account.baseline_driving_s)}"
        )
    else:
        yield f"it drives for {duration(account.driving_s)}; in the baseline it stays where it is"
    if account.waiting_s >= 0.05:
        yield f"it waits {account.waiting_s:.1f} s longer than in the baseline, to meet others"


def _break_lines(plan: VehiclePlan) -> Iterator[str]:
    for before, stop in pairwise(plan.stops):
        if stop.kind == "break":
            begins = utc(stop.departure_ns - round(1e9 * stop.break_s))
            yield f"has its break of {duration(stop.break_s)} at {before.stop}, from {begins} on"


def _platoon_lines(plan: VehiclePlan, plans: Sequence[VehiclePlan]) -> Iterator[str]:
    members: dict[tuple[str | None, str], list[tuple[int, str]]] = {}
    for one in plans:
        for segment in one.segments:
            if segment.place is not None:
                key = segment.platoon, segment.segment
                members.setdefault(key, []).append((segment.place, one.vehicle))

    def key_of(segment: PlannedSegment) -> tuple[str | None, int | None, tuple[str, ...]]:
        found = sorted(members.get((segment.platoon, segment.segment), ()))
        return segment.platoon, segment.place, tuple(v for _, v in found if v != plan.vehicle)

    for (platoon, place, others), group in groupby(plan.segments, key_of):
        if platoon is None:
            continue
        driven = list(group)
        length_m = sum(segment.length_m or 0.0 for segment in driven)
        who = " and ".join(others) or "a vehicle that has its plan already"
        where = "leads" if place == 0 else f"is at place {(place or 0) + 1} with"
        yield (
            f"{where} {who} in platoon {platoon} on {way([s.segment for s in driven])}"
            + (f", {length_m:.0f} m" if length_m else "")
        )
