"""What a cycle found out of its vehicles, and platoons that it does not have, as it is stored."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Final, Literal

from pydantic import TypeAdapter

RefusalReason = Literal["turbulent", "unknown", "apart", "not_worth", "missed"]


@dataclass(frozen=True)
class VehicleAccount:
    """One vehicle in one cycle. Energies and times are 0 where it does not drive.

    Attributes:
        stops: that it serves, in order.
        driven_kwh: by the plan, with what its platoons are expected to save.
        alone_kwh: of the same drive with nobody near.
        driving_s: time on the road by the plan.
        waiting_s: for other vehicles, at stops and hubs; and at its depot, beyond the time at which
            it leaves in the baseline.
        platooned_m: way on which it is expected to be in a close platoon.
        baseline_stops: that it serves in the baseline, the plan without platooning.
        baseline_kwh: likewise.
        baseline_driving_s: likewise.
    """

    vehicle: str
    stops: tuple[str, ...]
    driven_kwh: float
    alone_kwh: float
    driving_s: float
    waiting_s: float
    platooned_m: float
    baseline_stops: tuple[str, ...]
    baseline_kwh: float
    baseline_driving_s: float


@dataclass(frozen=True)
class RefusedPlatoon:
    """Two vehicles that pass the same segments and are in no platoon there.

    Attributes:
        vehicles: who enters first, and who comes next.
        segments: in the order of the first one's way.
        reason: "turbulent": the gate is closed as traffic is turbulent; "unknown": closed for
            another reason; "apart": the two are not there together, and their times do not allow
            it; "not_worth": they could be, and that would cost more than it saves; "missed": it
            would have been worth it, but no solver came to it, or it would leave a carrier with
            less than alone.
        detail: reason of the closed gate; where the two are close in time, why they make no
            platoon all the same; that a solver could have chosen it so, by another way or
            departure; None otherwise.
        saving_kwh: of a close platoon of the two there; where a meeting was tried, what all
            platoons of the vehicle that moves would save more.
        apart_s: between their entries where these are closest.
        cost_kwh: of the cheapest way to meet; None: none was tried, or there is none.
    """

    vehicles: tuple[str, str]
    segments: tuple[str, ...]
    reason: RefusalReason
    detail: str | None
    saving_kwh: float
    apart_s: float
    cost_kwh: float | None = None


TourObstacle = Literal[
    "carrier",
    "pinned",
    "skill",
    "capacity",
    "far",
    "late",
    "loaded",
    "no_way",
    "charge",
    "window",
    "shift",
    "break",
]
"""Why a tour takes no stop. "far": it was not tried, as others are nearer; "late": the tour is late
as it is; "loaded": it has a first stop that is not planned. The others are what its name says.
"""


@dataclass(frozen=True)
class OfferedTour:
    """A tour that had not begun when a stop was to be put into one.

    Attributes:
        vehicle: whose tour it is.
        obstacle: why no place in it takes the stop; None: one does.
        detail: of the obstacle, in words; None: it says all.
        cost_kwh: what the tour costs more with the stop in its cheapest place, time at its price;
            None: there is no place, or none was tried.
        stops: of the tour with the stop there, in order; none without a place.
    """

    vehicle: str
    obstacle: TourObstacle | None
    detail: str | None
    cost_kwh: float | None = None
    stops: tuple[str, ...] = ()


@dataclass(frozen=True)
class InsertedStop:
    """A stop that was to be put into a tour between cycles.

    Attributes:
        vehicle: whose tour has it now; None: none.
        stops: of that tour, in order; stops that came later may be between them by now.
        tours: that were offered, in the order of the fleet.
    """

    stop: str
    vehicle: str | None
    stops: tuple[str, ...]
    tours: tuple[OfferedTour, ...]


@dataclass(frozen=True)
class CycleFacts:
    """What a cycle's words are made of beside its report and plans.

    Attributes:
        made: vehicles that it made plans for that were to be sent; some may have reported meanwhile
            so that theirs was not.
        accounts: of its vehicles.
        refused: platoons that it does not have.
        inserted: stops that were to be put into tours, of an insertion between cycles.
    """

    made: tuple[str, ...] = ()
    accounts: tuple[VehicleAccount, ...] = ()
    refused: tuple[RefusedPlatoon, ...] = ()
    inserted: tuple[InsertedStop, ...] = ()


_FACTS: Final = TypeAdapter(CycleFacts)
_FIELDS: Final = ("made", "accounts", "refused", "inserted")


def facts_data(facts: CycleFacts) -> dict[str, Any]:
    """The fields that a cycle's record has of them, as JSON has them."""
    data: dict[str, Any] = _FACTS.dump_python(facts, mode="json")
    return data


def facts_of(record: bytes) -> CycleFacts:
    """The facts of a cycle's record (`storage.CycleInputs.record`).

    Raises:
        ValueError: they cannot be read by this version.
    """
    own = json.loads(record)
    try:
        return _FACTS.validate_python({name: own[name] for name in _FIELDS})
    except (KeyError, TypeError) as error:
        raise ValueError(f"its record cannot be read: {error!r}") from None
