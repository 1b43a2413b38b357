"""Drag reductions by measured gaps, as a pure function."""

from __future__ import annotations

import math

import pytest

from lab.tests.simulation.fleet.road import Flags, segments
from slipstream.energy.consumption import ETA_FOLLOWER, ETA_LEADER
from slipstream.energy.drafting import DragLaw, reductions_at
from slipstream.messages import SensedVehicle, VehicleAdvice, VehicleSensing
from slipstream_lab.simulation.fleet.drafting import (
    CLOSE_GAP_M,
    MIN_SPEED_MPS,
    drafting,
    why_missed,
)

OPEN = Flags({"a": 1, "b": 1})


def sensed(
    name: str,
    ahead: str | None = None,
    gap_m: float = 2.0,
    speed_mps: float = 25.0,
    segment: str = "a",
    *,
    of_fleet: bool = True,
) -> VehicleSensing:
    """A vehicle on the road, behind another one."""
    front = ahead and SensedVehicle(
        track=ahead, vehicle=ahead if of_fleet else None, gap_m=gap_m, speed_mps=speed_mps
    )
    return VehicleSensing(
        vehicle=name,
        time_ns=0,
        on_road=True,
        segment=segment,
        crossing=False,
        lane=0,
        front_m=0.0,
        speed_mps=speed_mps,
        acceleration_mps2=0.0,
        driven_m=0.0,
        ahead=front or None,
        behind=None,
    )


def three(**rear: object) -> dict[str, VehicleSensing]:
    """Three vehicles in close gaps; the last one otherwise if so."""
    return {
        "one": sensed("one"),
        "two": sensed("two", "one"),
        "three": sensed("three", "two", **rear),  # type: ignore[arg-type]
    }


def test_leader_and_followers_have_their_reductions() -> None:
    """The leader's for the first, a follower's for each behind it, none for vehicles alone."""
    found = drafting(three(), {"two": True, "three": True}, OPEN)
    assert found.eta == {"one": ETA_LEADER, "two": ETA_FOLLOWER, "three": ETA_FOLLOWER}
    assert found.places == {"one": 0, "two": 1, "three": 2}
    assert found.turbulent == frozenset()
    assert drafting(three(), {}, OPEN).eta == {}
    # The order in which vehicles are looked at does not matter.
    assert drafting(three(), {"three": True, "two": True}, OPEN).eta == found.eta


@pytest.mark.parametrize(
    "rear",
    [
        pytest.param({"gap_m": CLOSE_GAP_M + 0.1}, id="far"),
        pytest.param({"speed_mps": MIN_SPEED_MPS - 0.1}, id="slow"),
        pytest.param({"segment": "c"}, id="gate closed"),
        pytest.param({"of_fleet": False}, id="behind another car"),
        pytest.param({"ahead": "elsewhere"}, id="behind one that is not on the road"),
        pytest.param({"ahead": None}, id="behind nobody"),
    ],
)
def test_what_is_not_a_close_gap_behind_an_open_gate_is_not_credited(
    rear: dict[str, object],
) -> None:
    """The last one of three has nothing, and the one ahead of it goes on following."""
    vehicles = three()
    own: dict[str, object] = {"ahead": "two", **rear}
    vehicles["three"] = sensed("three", **own)  # type: ignore[arg-type]
    found = drafting(vehicles, {"two": True, "three": True}, OPEN)
    assert found.eta == {"one": ETA_LEADER, "two": ETA_FOLLOWER}


def test_at_the_limits_the_reduction_is_credited() -> None:
    """7.5 m and 5 m/s are enough."""
    rear = sensed("two", "one", gap_m=CLOSE_GAP_M, speed_mps=MIN_SPEED_MPS)
    found = drafting({"one": sensed("one"), "two": rear}, {"two": True}, OPEN)
    assert found.eta == {"one": ETA_LEADER, "two": ETA_FOLLOWER}


def test_who_leaves_has_no_reduction() -> None:
    """Its gap is close still, and counts as exposure where the traffic is turbulent."""
    vehicles = {"one": sensed("one", segment="b"), "two": sensed("two", "one")}
    assert drafting(vehicles, {"two": False}, OPEN).eta == {}
    found = drafting(vehicles, {"two": False}, Flags({"a": 0, "b": 1}))
    assert (found.eta, found.turbulent) == ({}, {"two"})
    found = drafting(vehicles, {"two": False}, Flags({"a": 1, "b": 0}))
    assert found.turbulent == {"one"}


def test_a_leader_beyond_a_closed_gate_is_not_credited() -> None:
    """Its follower is, as long as it is on an open segment."""
    vehicles = {"one": sensed("one", segment="c"), "two": sensed("two", "one")}
    assert drafting(vehicles, {"two": True}, OPEN).eta == {"two": ETA_FOLLOWER}


def test_measured_laws_count_real_gaps_and_places() -> None:
    """A truck leads by the gap behind it; a van follows by its own law and gap, and the last truck
    saves as the last of three. In the middle of four is who has one behind it.
    """
    vehicles = {
        "truck": sensed("truck"),
        "van": sensed("van", "truck", gap_m=4.0),
        "last": sensed("last", "van", gap_m=6.5),
    }
    follows = {"van": True, "last": True}
    found = drafting(vehicles, follows, OPEN, {"truck": "truck", "van": "van", "last": "truck"})
    assert found.eta == {
        "truck": reductions_at("truck", 4.0).leader,
        "van": reductions_at("van", 4.0).middle,
        "last": reductions_at("truck", 6.5).last,
    }
    assert reductions_at("van", 4.0).middle != reductions_at("van", 6.5).middle
    trucks: dict[str, DragLaw] = dict.fromkeys(("truck", "van", "last", "fourth"), "truck")
    vehicles["fourth"] = sensed("fourth", "last", gap_m=5.0)
    found = drafting(vehicles, {**follows, "fourth": True}, OPEN, trucks)
    close = reductions_at("truck", 5.0)
    assert list(found.eta.values()) == [close.middle, close.middle, close.last, close.leader]
    alone = {name: vehicles[name] for name in ("truck", "van")}
    assert drafting(alone, {"van": True}, OPEN, trucks).eta["van"] == close.follower


def test_a_row_that_closes_to_a_ring_is_credited() -> None:
    """Nobody leads it."""
    vehicles = {"one": sensed("one", "two"), "two": sensed("two", "one")}
    found = drafting(vehicles, {"one": True, "two": True}, OPEN)
    assert found.eta == {"one": ETA_FOLLOWER, "two": ETA_FOLLOWER}


def advised(mode: str, partner: str | None = None) -> VehicleAdvice:
    """Advice of a mode."""
    return VehicleAdvice(
        vehicle="two",
        time_ns=0,
        valid_until_ns=1,
        cycle=1,
        leg=0,
        mode=mode,  # type: ignore[arg-type]
        speed_mps=None if mode == "none" else 20.0,
        gap_m=None,
        lane=None,
        partner=partner,
        depart_ns=None,
        green_at=None,
        text="",
        reason=None,
    )


@pytest.mark.parametrize(
    ("advice", "sensing", "is_open", "cause"),
    [
        (advised("follow", "one"), sensed("two", "one", 20.0), True, "closing up"),
        (advised("cruise", "one"), sensed("two"), True, "closing up"),
        (advised("cruise"), sensed("two"), True, "apart"),
        (None, sensed("two"), True, "apart"),
        (advised("open_gap", "one"), sensed("two", "one", 20.0), True, "gates"),
        (advised("open_gap", "one"), sensed("two", "x", of_fleet=False), True, "others between"),
        (advised("follow", "one"), sensed("two", "one", 20.0), False, "gates"),
        (advised("follow", "one"), sensed("two", "one", 20.0, 5.0), True, "queues"),
    ],
)
def test_why_a_planned_platoon_is_not_driven(
    advice: VehicleAdvice | None, sensing: VehicleSensing, is_open: bool, cause: str
) -> None:
    """One cause a moment; none where the plan has no platoon."""
    (planned,) = segments("a", place=1)
    assert why_missed(planned, sensing, advice, math.inf, is_open=is_open) == cause
    (alone,) = segments("a")
    assert why_missed(alone, sensing, advice, math.inf, is_open=is_open) is None
