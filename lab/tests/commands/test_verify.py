from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from slipstream_cli.main import main

Capture = pytest.CaptureFixture[str]


def test_published_instances_pass(capsys: Capture) -> None:
    """Both weights by default; everything that was found is in the JSON."""
    assert main(["verify", "arc06-valley", "arc14-motorway", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["failed"] == 0
    checks = document["checks"]
    assert [check["name"] for check in checks] == ["arc06-valley"] * 2 + ["arc14-motorway"] * 2
    assert [check["gamma"] for check in checks] == ["bound", "given"] * 2
    assert checks[1]["gamma_kwh"] == 50.0
    assert checks[2]["states"] == 2**14
    assert checks[2]["minimum_kwh"] == pytest.approx(checks[2]["milp_kwh"], abs=1e-7)
    assert all(check["zero_penalty_is_valid"] for check in checks)


def test_a_check_that_fails_is_exit_status_1(capsys: Capture) -> None:
    """γ = 1 Wh is too little; the line says so."""
    assert main(["verify", "arc15-ring", "--gamma", "0.001"]) == 1
    out = capsys.readouterr().out
    assert "FAILS: QUBO minimum" in out
    assert "1 checks, 1 failed" in out


def test_random_problems_of_both_forms(capsys: Capture) -> None:
    """The seed makes them; the same again for the same seed."""
    command = ["verify", "--random", "2", "--seed", "9", "--gamma", "bound", "--json"]
    assert main(command) == 0
    first = json.loads(capsys.readouterr().out)["checks"]
    assert [check["form"] for check in first] == ["arc", "arc", "route", "route"]
    assert [check["encoding"] for check in first] == ["reduced", "reduced", None, None]
    assert main(command) == 0
    again = json.loads(capsys.readouterr().out)["checks"]
    assert [c["minimum_kwh"] for c in again] == [c["minimum_kwh"] for c in first]


def test_a_file_of_ones_own_in_the_papers_encoding(tmp_path: Path, capsys: Capture) -> None:
    """An instance file is taken like a name; the full encoding has its own number of variables."""
    from slipstream_lab.research.instances import open_instance
    from slipstream_lab.research.instances.instance import write_instance

    path = tmp_path / "mine.json"
    write_instance(open_instance("arc08-blocks"), path)
    assert main(["verify", str(path), "--encoding", "full", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["checks"][0]["variables"] == 12


def test_56_variables_in_parts(capsys: Capture) -> None:
    """The full encoding of a 25-variable instance: all 2^56 states by its vehicles' bits."""
    command = ["verify", "arc25-01-avenue", "--encoding", "full", "--json"]
    assert main(command) == 0
    bound, fifty = json.loads(capsys.readouterr().out)["checks"]
    assert bound["states"] == fifty["states"] == 2**56
    assert bound["valid_selections"] == 6


def test_more_than_can_be_looked_at_is_refused(tmp_path: Path, capsys: Capture) -> None:
    """The line says how many variables there are and how many there may be."""
    from slipstream_lab.research.instances import open_instance
    from slipstream_lab.research.instances.instance import write_instance

    instance = open_instance("arc25-01-avenue")
    fleet = instance.problem.fleet
    free = tuple(v.model_copy(update={"first_stop": None}) for v in fleet.vehicles)
    fleet = type(fleet)(name="free", depots=fleet.depots, stops=fleet.stops, vehicles=free)
    path = tmp_path / "free.json"
    write_instance(
        replace(
            instance,
            problem=replace(instance.problem, fleet=fleet),
            optimum=None,
            energy_optimum=None,
        ),
        path,
    )
    assert main(["verify", str(path)]) == 2
    assert "40 variables in the reduced encoding of the arc form" in capsys.readouterr().err


def test_a_published_instance_in_the_route_form(capsys: Capture) -> None:
    """Its options are variables, and there are no others."""
    command = ["verify", "arc25-11-motorway", "--form", "route", "--options", "4", "--json"]
    assert main(command) == 0
    for check in json.loads(capsys.readouterr().out)["checks"]:
        assert (check["form"], check["encoding"]) == ("route", None)
        # Four of each vehicle, and three exchanges that both take part in.
        assert 2 <= check["variables"] == check["choices"] <= 14
        assert check["valid_selections"] >= 1


def test_a_city_is_refused_at_once(tmp_path: Path, capsys: Capture) -> None:
    """Its arcs are not even listed."""
    from slipstream_lab.research.instances import open_instance
    from slipstream_lab.research.instances.instance import write_instance

    small = open_instance("arc08-blocks")
    fleet = small.problem.fleet
    stops = tuple(fleet.stops[0].model_copy(update={"id": f"s{i}"}) for i in range(500))
    large = fleet.model_copy(update={"stops": stops})
    path = tmp_path / "city.json"
    large = type(fleet).model_validate(large.model_dump())
    write_instance(
        replace(
            small, problem=replace(small.problem, fleet=large), optimum=None, energy_optimum=None
        ),
        path,
    )
    assert main(["verify", str(path)]) == 2
    assert "up to 251001 candidate arcs" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "nothing to check"),
        (("arc99",), "arc99: no instance of this name"),
        (("arc06-valley", "--gamma", "nan"), "--gamma: 'nan' is no weight"),
        (("arc06-valley", "--gamma", "-1"), "--gamma: '-1' is no weight"),
        (("arc06-valley", "--options", "0"), "--options: out of range"),
        (("--random", "-1"), "--random: out of range"),
        (("--random", "1", "--seed", "-1"), "--seed: out of range"),
    ],
)
def test_bad_input_is_one_line(arguments: tuple[str, ...], said: str, capsys: Capture) -> None:
    """Exit status 2, and nothing is enumerated before."""
    assert main(["verify", *arguments]) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert len(captured.err.splitlines()) == 1
    assert captured.out == ""
