"""Why nobody drove in a platoon."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.measures.evaluation import collect
from slipstream_lab.simulation.evaluation.measures.platoons import no_platoons, why_no_platoon
from slipstream_lab.simulation.evaluation.report.markdown import headlines, report, terminal_summary
from slipstream_lab.simulation.evaluation.runs.store import ArmStore

WATCHED = ("e0_main", "e1_mid", "elsewhere")


def lonely(**changes: object) -> ArmResult:
    """A cooperative arm in which everybody drove alone."""
    arm = make_arm(POLICIES["C"], 1)
    legs = tuple(replace(leg, led_m=0.0, followed_m=0.0) for leg in arm.legs)
    known = {"watched": WATCHED, "opened": ("e0_main",), **changes}
    return replace(arm, legs=legs, **known)  # type: ignore[arg-type]


def of_vehicle(arm: ArmResult, names: set[str]) -> ArmResult:
    """The same with the legs of some vehicles only."""
    return replace(arm, legs=tuple(leg for leg in arm.legs if leg.vehicle in names))


def test_each_condition_that_a_run_did_not_meet_is_told_by_its_figures() -> None:
    """In the order in which a platoon needs them."""
    arm = lonely()
    apart = tuple(
        replace(leg, departed_s=1000.0 * n, arrived_s=1000.0 * n + 400)
        for n, leg in enumerate(arm.legs)
    )
    own_roads = tuple(
        replace(leg, path=("e0_main",) if leg.vehicle == "van-00" else ("e1_leave",))
        for leg in arm.legs
    )
    unplanned = tuple(replace(cycle, planned_platooned_m=0.0) for cycle in arm.cycles)
    together = tuple(
        replace(leg, departed_s=arm.begin_s, arrived_s=arm.begin_s + 900) for leg in arm.legs
    )
    met = replace(arm, legs=together)
    assert [
        why_no_platoon(one)
        for one in (
            of_vehicle(arm, {"van-00"}),
            replace(arm, watched=()),
            replace(arm, watched=("elsewhere",)),
            replace(arm, legs=own_roads),
            replace(arm, opened=("elsewhere",)),
            replace(arm, legs=apart),
            replace(met, cycles=unplanned),
            met,
        )
    ] == [
        "fewer than two vehicles drove (1)",
        "no segment is watched by an RSU",
        "no route has one of the 1 watched segments",
        "no two vehicles' routes share a watched segment (1 of 3 are on a route)",
        "the gates of the 2 watched segments that vehicles share never open",
        "those who share one of the 1 segments with a gate that opens are never on the road "
        "together (10.0 min apart at best)",
        "no plan has two vehicles together on one of the 1 segments that they share and whose gate "
        "opens",
        "platoons were planned and did not form: gates 0.7 km, closing up 0.3 km",
    ]


@pytest.mark.parametrize("platoons", [False, True])
def test_the_report_says_so_first(tmp_path: Path, platoons: bool) -> None:
    """Above all headlines, and on the terminal; not of arms without the lever, nor of one that
    platooned.
    """
    with ArmStore(tmp_path, GROUND, "code") as store:
        store.put(POLICIES["B"], 1, make_arm(POLICIES["B"], 1))
        store.put(POLICIES["C"], 1, make_arm(POLICIES["C"], 1) if platoons else lonely(watched=()))
        evaluation = collect(store, GROUND, (1,))
    text, terminal = report(evaluation, (), None), terminal_summary(evaluation)
    if platoons:
        assert no_platoons(evaluation) == {}
        assert "Nobody drove in a platoon" not in text + terminal
        return
    assert no_platoons(evaluation) == {"C": {1: "no segment is watched by an RSU"}}
    line = "C: seed 1: no segment is watched by an RSU"
    assert terminal.startswith(f"Nobody drove in a platoon: {line}\n")
    assert 0 < text.index(line) < text.index(headlines(evaluation)[0])
