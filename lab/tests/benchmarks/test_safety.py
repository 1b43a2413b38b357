"""Emergency stops of platoons: a few of each kind, and what the report says of them."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from slipstream_lab.benchmarks.safety.__main__ import main
from slipstream_lab.benchmarks.safety.campaign import drawn
from slipstream_lab.benchmarks.safety.rogue import ATTACKS, harm_of
from slipstream_lab.benchmarks.safety.stop import Case, Fault, drive
from slipstream_lab.benchmarks.safety.vehicle import Vehicle


@pytest.mark.long
def test_nobody_touches_in_fifty_stops(tmp_path: Path) -> None:
    """Of each kind of fault; the report counts every one, and the status says that all is well."""
    assert main(["--stops", "50", "--workers", "1", "--out", str(tmp_path)]) == 0
    kinds = json.loads((tmp_path / "report.json").read_text())["kinds"]
    assert {name: kind["stops"] for name, kind in kinds.items()} == {
        "none": 20,
        "agent": 10,
        "router": 10,
        "sensor": 10,
        "calm": 2,
    }
    assert all(kind["least_m"] > 0 and not kind["collisions"] for kind in kinds.values())
    assert kinds["none"]["followers"] == kinds["none"]["members"]
    assert kinds["none"]["mean_gap_m"] < 3.5


@pytest.mark.slow
def test_four_ordinary_cars_stop_at_two_metres_without_using_them_up() -> None:
    """Behind traffic that brakes with 9.8 m/s², one message in twenty lost: nobody brakes harder
    than the one behind, and the leader no harder than it promised.
    """
    outcome = drive(Case(20.0, ("car",) * 4, "dry", 1, 9.8, loss=0.05))
    assert outcome.followers == 3
    assert max(outcome.gaps_m) < 2.7
    assert min(outcome.least_m) > 1.0
    assert outcome.promised_mps2 is not None
    assert -outcome.hardest_mps2[0] <= outcome.promised_mps2
    assert sorted(outcome.hardest_mps2, reverse=True) == list(outcome.hardest_mps2)


@pytest.mark.slow
def test_vehicles_that_brake_as_one_constant_says_would_touch() -> None:
    """The stop can fail: with an agent that takes ordinary brakes for ideal ones, members touch."""
    assert min(drive(Case(22.2, ("ideal",) * 3, "dry", 6, 9.8)).least_m) > 0
    assert min(drive(Case(30.0, ("truck",) * 3, "dry", 6, 9.8, declared="ideal")).least_m) < 0


def test_draws_are_the_same_for_the_same_number() -> None:
    """And of each kind the fault that it is named by."""
    assert drawn(3, "agent") == drawn(3, "agent") != drawn(4, "agent")
    assert drawn(3, "none").fault is None
    fault = drawn(3, "router").fault
    assert isinstance(fault, Fault)
    assert fault.kind == "router"


def test_too_few_stops_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """In one line, with the status of bad input."""
    assert main(["--stops", "3"]) == 2
    assert capsys.readouterr().err == "safety: --stops: 3 are too few; give 50 or more\n"


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("nothing, leading", None),
        ("braking measured", "v1: v0 told of braking that did not come"),
        ("braking told", "v1: v0 told of braking that did not come"),
        ("swinging plans", "v1: v0 told of braking that did not come"),
        ("speeding up told, in the middle", None),
        ("promise broken", "v1: v0 braked harder than it promised"),
    ],
)
def test_a_rogue_costs_some_seconds_once_and_takes_nobody_nearer(
    name: str, reason: str | None
) -> None:
    """By what it tells: a minute of it. With its brake it may touch, once; then it is left."""
    harm = harm_of(name, 75.0)
    assert harm.slowdown_s < 10.0
    assert reason is None or reason in harm.reasons
    if ATTACKS[name].told_only:
        assert harm.above_law_m > -0.15


@pytest.mark.long
def test_honest_vehicles_never_cease_to_believe_one_another() -> None:
    """In stops of every kind, with one message in twenty lost."""
    found = []

    def watch(_now_s: float, cars: list[Vehicle]) -> None:
        found.extend(car.last.distrusts for car in cars if car.last and car.last.distrusts)

    for kind in ("none", "calm", "agent", "router", "sensor"):
        for number in range(5):
            drive(replace(drawn(number, kind), loss=0.05), watch)
    assert found == []
