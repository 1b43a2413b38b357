from __future__ import annotations

from itertools import product

import pytest

from dispatcher_daemon.forms.decode import decode
from dispatcher_daemon.forms.problem import ArcProblem, CandidateArc

PLACES = ("d", "a", "b", "c")
PROBLEM = ArcProblem(
    "d",
    PLACES[1:],
    ("v", "w"),
    tuple(CandidateArc(k, i, j, 1.0) for k in "vw" for i, j in product(PLACES, PLACES) if i != j),
)
INDEX = {(a.vehicle, a.start, a.end): n for n, a in enumerate(PROBLEM.arcs)}


def select(*arcs: str) -> set[int]:
    """Arcs such as "v:d>a"."""
    return {INDEX[arc[0], arc[2], arc[4]] for arc in arcs}


GOOD = ("v:d>a", "v:a>b", "v:b>d", "w:d>c", "w:c>d")


def test_routes_are_read_in_driving_order() -> None:
    """A valid selection gives each vehicle's stops in order."""
    decoded = decode(PROBLEM, select(*GOOD))
    assert decoded.routes == {"v": ("a", "b"), "w": ("c",)}
    assert decoded.violations == ()


@pytest.mark.parametrize(
    ("arcs", "fault"),
    [
        ((), "v: does not leave d"),
        (GOOD[1:], "v: does not leave d"),
        ((*GOOD, "v:d>b"), "v: leaves d more than once"),
        (("v:d>a", "v:a>b", "w:d>c", "w:c>d"), "v: stays at b"),
        (("v:d>a", "v:a>d", "v:b>c", "v:c>b", "w:d>c", "w:c>d"), "apart from its tour"),
        (("v:d>a", "v:a>d", "w:d>c", "w:c>d"), "b: served 0 times"),
        ((*GOOD[:3], "w:d>b", "w:b>c", "w:c>d"), "b: served 2 times"),
    ],
)
def test_broken_rules_are_named(arcs: tuple[str, ...], fault: str) -> None:
    """Anything but one tour a vehicle and one visit a stop is refused with the reason."""
    decoded = decode(PROBLEM, select(*arcs))
    assert decoded.routes is None
    assert any(fault in violation for violation in decoded.violations)
