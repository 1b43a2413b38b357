"""docs/safety.md: its tables are what the functions give, and the tests that it names exist."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from slipstream.braking import BRAKING, HARDEST_MPS2, Braking, Road
from slipstream.energy.drafting import reductions_at
from slipstream.energy.traction import drag_saving_kwh, steady_energy_kwh
from slipstream.spacing import (
    closing_m,
    driver_gap_m,
    front_limit_mps2,
    least_gap_m,
    longest_string,
    planned_gap_m,
    promised_mps2,
    reaction_s,
)
from slipstream.vehicle_types import PRESETS, VehicleType
from vehicle_agent.platooning.needed_braking import AheadMotion
from vehicle_agent.platooning.speed_commands import leading_gap_m

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text()


def table(header: str) -> list[list[str]]:
    """Rows of the table whose header has some words."""
    lines = PAGE.splitlines()
    (first,) = [n for n, line in enumerate(lines) if line.startswith("|") and header in line]
    rows = []
    for line in lines[first + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def promises(braking: Braking) -> list[float]:
    """Of the third, second and first of four vehicles with gaps of 2 m."""
    found: list[float] = []
    for _ in range(3):
        needed = front_limit_mps2(2.0, braking, found[-1] if found else None)
        found.append(promised_mps2(needed, braking))
    return found


def leading_m(braking: Braking, road: Road, limit: float, speed_mps: float) -> float:
    """Distance that a leader keeps behind traffic of its speed."""
    situation: Any = SimpleNamespace(
        motion=AheadMotion(0.0, speed_mps, bound_mps2=HARDEST_MPS2[road]),
        own=SimpleNamespace(braking=braking, interval_s=0.1, speed_mps=speed_mps),
    )
    return leading_gap_m(situation, limit)


def unannounced(braking: Braking, road: Road) -> list[str]:
    """One row, behind a vehicle of its class."""
    gaps = [least_gap_m(v, braking.greatest_mps2, braking) for v in (13.9, 20.0, 22.2, 30.0)]
    both = braking.guaranteed_mps2, braking.greatest_mps2
    return [
        *(f"{value:.1f}" for value in both),
        f"{reaction_s(braking):.2f}",
        *(f"{gap:.1f}" for gap in gaps),
    ]


def promised(braking: Braking, road: Road) -> list[str]:
    """One row: three limits, and the distance that the leader's asks for."""
    limits = promises(braking)
    distances = [leading_m(braking, road, limits[-1], v) for v in (13.9, 20.0, 30.0)]
    return [*(f"{limit:.2f}" for limit in limits), *(f"{m:.0f}" for m in distances)]


def over_limits(braking: Braking, road: Road) -> list[str]:
    """One row: least gap behind who promises 2 to 4 m/s²."""
    return [f"{least_gap_m(22.2, a, braking):.1f}" for a in (2.0, 2.5, 3.0, 3.5, 4.0)]


def in_a_string(braking: Braking, road: Road) -> list[str]:
    """One row: gaps with which a vehicle between two others keeps its own promise."""
    last, middle, first = promises(braking)
    heard_s = 2 * braking.tolerance * braking.nominal_s + 0.1
    return [
        f"{0.6 + closing_m(22.2, 22.3, ahead, own, late_s):.1f}"
        for late_s in (heard_s, reaction_s(braking))
        for own, ahead in ((last, middle), (middle, first))
    ]


def lengths(braking: Braking, road: Road) -> list[str]:
    """One row: vehicles of a platoon."""
    return [str(longest_string(gap_m, braking)) for gap_m in (1.5, 2.0, 4.0)]


@pytest.mark.parametrize(
    ("header", "row_of"),
    [
        ("guaranteed, m/s² |", unannounced),
        ("| third vehicle of four |", promised),
        ("| 2.0 m/s² | 2.5 |", over_limits),
        ("heard: third vehicle", in_a_string),
        ("most, advised 1.5 m", lengths),
    ],
)
def test_tables_are_what_the_law_gives(header: str, row_of: Any) -> None:
    """Each figure, rounded as it is printed; every real class on dry and wet roads, at least."""
    rows = table(header)
    for name, road, *cells in rows:
        assert cells == row_of(BRAKING[name].on(road), road), f"{name}, {road}"
    shown = {(name, road) for name, road, *_ in rows}
    assert {(name, road) for name in BRAKING for road in ("dry", "wet")} - shown == {
        ("ideal", "wet")
    }


def drafting_left(kind: VehicleType, braking: Braking) -> list[str]:
    """One row: gap and saving of a pair that has promised, unannounced, and as drivers drive."""
    v, physics = 80 / 3.6, kind.profile.physics
    gaps = [planned_gap_m(v, 2.0, braking), least_gap_m(v, braking.greatest_mps2, braking)]
    whole = steady_energy_kwh(1000.0, v, vehicle=physics)
    found = []
    for gap_m in (*gaps, driver_gap_m(v)):
        reductions = reductions_at(kind.drafting, gap_m)
        places = (reductions.at(number, 2) for number in range(2))
        saved = sum(drag_saving_kwh(1000.0, v, eta, physics) for eta in places)
        found += [f"{gap_m:.1f}", f"{100 * saved / 2 / whole:.1f}"]
    return found[:4] + found[5:]


def test_what_drafting_is_left_is_what_the_laws_give() -> None:
    """Of each type of vehicle, by the law that is measured for it."""
    rows = table("promised gap, m |")
    for name, brakes, road, *cells in rows:
        braking = BRAKING[brakes].on(road)  # type: ignore[index]
        assert cells == drafting_left(PRESETS[name], braking), f"{name}, {brakes}, {road}"
    assert {name for name, *_ in rows} == set(PRESETS)


def test_each_hazard_has_an_answer_or_is_open() -> None:
    """Numbered without a gap, with a severity."""
    rows = table("| id | what happens |")
    assert [row[0] for row in rows] == [f"H{n}" for n in range(1, len(rows) + 1)]
    assert all(row[3] in ("S1", "S2", "S3") and row[4] for row in rows)


def test_each_threat_has_a_test() -> None:
    """Numbered without a gap."""
    rows = table("| what it tells | effect")
    assert [row[0] for row in rows] == [f"T{n}" for n in range(1, len(rows) + 1)]
    assert all(re.search(r"`test_\w+`", row[4]) for row in rows)


def test_the_tests_that_are_named_exist() -> None:
    """Some test module defines each."""
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    defined = {
        name
        for room in ("slipstream", "vehicle_agent")
        for path in (ROOT / "tests" / room).rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)\(", path.read_text(), re.MULTILINE)
    }
    assert named
    assert named <= defined
