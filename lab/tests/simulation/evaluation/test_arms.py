"""The plan of arms."""

from __future__ import annotations

from dataclasses import replace

import pytest

from slipstream.errors import InputError
from slipstream_lab.simulation.closed_loop.policy import LEVERS
from slipstream_lab.simulation.evaluation.arms import (
    INSTALLED,
    INSTALLED_IDEAL,
    INSTALLED_OFF,
    INSTALLED_PRIORITY,
    POLICIES,
    QUANTUM,
    SELECTIONS,
    choose,
    only,
    without,
)

_INSTALLED = (INSTALLED_OFF, INSTALLED, INSTALLED_PRIORITY)


def test_each_lever_is_there_alone_and_left_out() -> None:
    """One lever on top of the baseline; every lever but it, which without priority is C."""
    for lever in LEVERS:
        assert POLICIES[only(lever)].levers == {lever}
        assert POLICIES[without(lever)].levers == set(LEVERS) - {lever}
    assert without("priority") == "C"


def test_arms_that_are_compared_differ_in_one_thing_only() -> None:
    """Paces are the baseline's, gating and noise the cooperative arm's; A searches by time."""
    base, cooperative = POLICIES["B"], POLICIES["C"]
    assert (base.levers, base.search, base.pace) == (frozenset(), "energy", 1.0)
    assert POLICIES["A"].search == "time"
    for name, policy in POLICIES.items():
        assert policy.name == name
        if name.startswith("C-"):
            assert policy.levers == cooperative.levers
            changes = (policy.gating != "rsu", policy.noise > 0, policy.solver != "exact")
            assert changes.count(True) == 1
        if policy.pace != 1:
            assert (policy.levers, policy.search) == (base.levers, base.search)


def test_installed_arms_have_the_levers_of_an_installation() -> None:
    """Eco-approach, coasting and platoons by default, and signals asked by the one switch."""
    off, installed, priority = (POLICIES[name] for name in _INSTALLED)
    ideal = POLICIES[INSTALLED_IDEAL]
    assert off.levers == frozenset()
    assert installed.levers == {"platoons", "eco_approach", "coasting"}
    assert priority.levers == installed.levers | {"priority"}
    assert {name for name, policy in POLICIES.items() if policy.installed} == {
        *_INSTALLED,
        INSTALLED_IDEAL,
    }
    assert ideal == replace(installed, name=ideal.name, brakes="ideal")


def test_the_papers_tables_have_the_papers_vehicles() -> None:
    """All arms but the installed ones, and the one that shows what real brakes leave."""
    own = {name for name, policy in POLICIES.items() if policy.brakes == "type"}
    assert own == {INSTALLED, INSTALLED_OFF, INSTALLED_PRIORITY}


def test_selections_and_names_mix_in_the_order_of_the_tables() -> None:
    """Each arm once, the baseline always, names before or after selections alike."""
    assert [p.name for p in choose("C+,A,C+")] == ["A", "B", "C+"]
    assert {p.name for p in choose("noise,A")} == {*SELECTIONS["noise"], "A"}
    assert [p.name for p in choose("all")] == [name for name in POLICIES if name != QUANTUM]
    assert [p.name for p in choose(QUANTUM)] == ["B", QUANTUM]
    paces = {"B-0.88", "B-0.94", "B-1.06"}
    assert {p.name for p in choose("main")} == {"A", "B", *paces, "C", "C+", *_INSTALLED}


@pytest.mark.parametrize(("asked", "said"), [("main,D", "no arm 'D'"), (" , ", "no arm named")])
def test_an_unknown_arm_is_one_line_that_names_those_there_are(asked: str, said: str) -> None:
    """The line names the option, the fault and the choice."""
    with pytest.raises(InputError, match=said) as caught:
        choose(asked)
    assert "--arms" in str(caught.value)
    assert "levers" in str(caught.value)
