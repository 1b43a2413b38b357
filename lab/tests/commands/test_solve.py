from __future__ import annotations

import importlib.util
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import dimod
import pytest

from slipstream_cli.main import main

Capture = pytest.CaptureFixture[str]

FLIP = "arc25-01-avenue"


def solve(capsys: Capture, *arguments: str, status: int = 0) -> dict[str, Any]:
    """The JSON that the command prints."""
    assert main(["solve", *arguments, "--json"]) == status
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> str:
    """File of a small generated city, too much for the arc form."""
    from slipstream_lab.research.cities.generator import small_city
    from slipstream_lab.research.instances.instance import write_instance

    path = tmp_path_factory.mktemp("city") / "city.json"
    write_instance(small_city(1), path)
    return str(path)


def test_the_exact_answer_is_the_published_optimum(capsys: Capture) -> None:
    """Objective, energy, saving and routes of a published instance; all parts add up."""
    document = solve(capsys, "--instance", FLIP)
    assert (document["form"], document["variables"], document["choices"]) == ("arc", 25, 16)
    (exact,) = document["solvers"]
    assert (exact["solver"], exact["status"], exact["feasible"]) == ("exact", "optimal", True)
    assert exact["objective_kwh"] == pytest.approx(document["known_optimum_kwh"], abs=1e-6)
    energy, saving = exact["energy"], exact["saving"]
    parts = ("rolling_kwh", "drag_kwh", "acceleration_kwh")
    assert energy["total_kwh"] == pytest.approx(sum(energy[part] for part in parts))
    parts = ("distance_kwh", "drag_kwh", "acceleration_kwh")
    assert saving["total_kwh"] == pytest.approx(sum(saving[part] for part in parts))
    served = [stop for route in exact["routes"].values() for stop in route["stops"]]
    assert sorted(served) == ["c1", "c2", "c3", "c4"]


def test_solvers_in_turn_with_samples_apart(capsys: Capture) -> None:
    """Several solvers, each reported; raw and repaired feasibility of those that sample."""
    document = solve(
        capsys, "--instance", FLIP, "--solver", "tabu", "annealing", "insertion", "--seed", "5"
    )
    tabu, annealing, insertion = document["solvers"]
    for sampler in (tabu, annealing):
        assert sampler["objective_kwh"] == pytest.approx(document["known_optimum_kwh"], abs=1e-6)
        assert 0 < sampler["samples"]["feasible_raw"] <= sampler["samples"]["feasible_repaired"]
        assert sampler["samples"]["qubits"] is None
    assert insertion["samples"] is None
    assert insertion["plan_kwh"] == pytest.approx(document["rivals_kwh"]["insertion"])
    assert insertion["objective_kwh"] > tabu["objective_kwh"]


@pytest.mark.parametrize("form", ["arc", "route"])
@pytest.mark.parametrize("objective", ["paper", "energy"])
def test_the_objective_is_what_is_minimised(
    form: str, objective: str, capsys: Capture, tmp_path: Path
) -> None:
    """The optimum has the least of all solvers, the one that the written model has too; what its
    plan costs at exact times stands beside.
    """
    path = tmp_path / "model.qs"
    asked = ("--instance", FLIP, "--form", form, "--objective", objective)
    document = solve(capsys, *asked, "--solver", "exact", "insertion", "--write", str(path))
    exact, insertion = document["solvers"]
    assert (document["minimises"], exact["status"]) == (objective, "optimal")
    assert exact["objective_kwh"] <= insertion["objective_kwh"] + 1e-9
    written = solve(capsys, "--model", str(path))["solvers"][0]
    assert exact["objective_kwh"] == pytest.approx(written["objective"], abs=1e-9)
    assert main(["solve", *asked, "--solver", "exact"]) == 0
    told = capsys.readouterr().out
    assert f"exact: optimal, objective {exact['objective_kwh']:.6f} kWh, feasible" in told
    assert f"  plan {exact['plan_kwh']:.6f} kWh" in told


def test_energy_does_not_depend_on_what_is_minimised(capsys: Capture) -> None:
    """Without platoons the same routes need the same energy under both objectives."""
    found = [
        solve(capsys, "--instance", "arc25-18-motorway", "--objective", objective)["solvers"][0]
        for objective in ("paper", "energy")
    ]
    routes = [{v: route["stops"] for v, route in one["routes"].items()} for one in found]
    assert routes[0] == routes[1]
    assert found[0]["energy_kwh"] == pytest.approx(found[1]["energy_kwh"])
    assert found[0]["objective_kwh"] != pytest.approx(found[1]["objective_kwh"], rel=1e-3)


def test_gamma_and_encoding_shape_the_model(capsys: Capture) -> None:
    """γ is the bound unless given; the full encoding has the paper's many bits."""
    reduced = solve(capsys, "--instance", "arc14-avenue", "--gamma", "50")
    assert (reduced["gamma_kwh"], reduced["gamma"]) == (50.0, "given")
    full = solve(capsys, "--instance", "arc14-avenue", "--encoding", "full")
    assert full["gamma"] == "bound"
    assert full["variables"] > reduced["variables"]


def test_every_reward_is_explained(capsys: Capture) -> None:
    """Segment, pair, entry times and why 0: each pair earns something or has a reason."""
    document = solve(capsys, "--instance", "arc25-02-avenue", "--explain")
    rewards = document["rewards"]
    assert any(row["saving_kwh"] > 0 for row in rewards)
    assert any("s apart" in (row["reason"] or "") for row in rewards)
    for row in rewards:
        assert (row["saving_kwh"] > 0) == (row["reason"] is None)
        assert row["first"]["vehicle"] != row["second"]["vehicle"]
    assert main(["solve", "--instance", "arc25-02-avenue", "--explain"]) == 0
    out = capsys.readouterr().out
    assert "enters at" in out
    assert "saves 0." in out
    closed = solve(capsys, "--instance", "arc25-18-motorway", "--explain")["rewards"]
    assert any("gate closed (turbulent)" in row["reason"] for row in closed)
    assert not any(row["saving_kwh"] for row in closed)


@pytest.mark.nightly
def test_route_form_stands_beside_its_simple_rivals(capsys: Capture, city: str) -> None:
    """More than two vehicles get the route form; base and greedy plans stand beside the answer."""
    document = solve(capsys, "--instance", city, "--solver", "exact", "tabu")
    assert (document["form"], document["encoding"]) == ("route", None)
    exact = document["solvers"][0]
    assert exact["feasible"]
    rivals = document["rivals_kwh"]
    # Where three vehicles and more change at once, the model is a little off.
    assert exact["plan_kwh"] <= 1.001 * min(rivals.values())
    assert exact["energy"]["total_kwh"] > 0
    served = [stop for route in exact["routes"].values() for stop in route["stops"]]
    assert len(served) == len(set(served)) == 50 - len(document["unserved"])


def test_text_says_what_matters(capsys: Capture) -> None:
    """A person reads objective, feasibility, energy, saving and routes."""
    assert main(["solve", "--instance", FLIP, "--solver", "annealing"]) == 0
    out = capsys.readouterr().out
    for said in ("25 variables", "known optimum", "feasible", "raw", "rolling", "saving", "→"):
        assert said in out


@pytest.mark.slow
def test_published_instances_are_listed(capsys: Capture) -> None:
    """`--list` names them all, with size and optimum, for people and programs."""
    rows = solve(capsys, "--list")["instances"]
    of_25 = [row for row in rows if row["variables"] == 25]
    assert len(of_25) >= 20
    assert all(row["optimum_kwh"] is not None and row["provenance"] for row in rows)
    assert main(["solve", "--list"]) == 0
    out = capsys.readouterr().out
    assert all(row["name"] in out for row in rows)


def test_the_schema_is_published(capsys: Capture) -> None:
    """`--schema` prints a JSON schema that asks for roads and fleet."""
    assert main(["solve", "--schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert {"network", "fleet"} <= set(schema["required"])


def test_models_are_written(capsys: Capture, tmp_path: Path) -> None:
    """The QUBO as dimod JSON and the MILP as LP; nothing is solved unless asked for."""
    qubo, milp = tmp_path / "model.json", tmp_path / "model.lp"
    document = solve(capsys, "--instance", "arc14-avenue", "--write", str(qubo))
    assert document["solvers"] == []
    assert document["written"] == str(qubo)
    bqm = dimod.BinaryQuadraticModel.from_serializable(json.loads(qubo.read_text()))
    assert bqm.num_variables == document["variables"]
    solved = solve(capsys, "--instance", "arc14-avenue", "--write", str(milp), "--solver", "exact")
    assert solved["solvers"][0]["status"] == "optimal"
    assert "x0_" in milp.read_text()
    for ending in ("MPS", "LP", "JSON", "COO", "QS"):
        path = tmp_path / f"MODEL.{ending}"
        solve(capsys, "--instance", "arc14-avenue", "--write", str(path))
        read = solve(capsys, "--model", str(path))
        assert read["solvers"][0]["objective"] == pytest.approx(document["known_optimum_kwh"])


def test_no_plan_is_exit_status_1(capsys: Capture) -> None:
    """A search without the time for its first read gives no plan; that is said."""
    arguments = ("--instance", FLIP, "--solver", "tabu", "--deadline", "1e-9")
    (tabu,) = solve(capsys, *arguments, status=1)["solvers"]
    assert (tabu["status"], tabu["feasible"], tabu["objective_kwh"]) == ("timeout", False, None)
    assert tabu["reason"]


def test_a_stop_that_nobody_can_serve_is_listed_and_the_rest_solved(
    capsys: Capture, tmp_path: Path
) -> None:
    """More demand than any vehicle carries: the stop is named with the reason, in both forms."""
    from slipstream_lab.research.instances import open_instance
    from slipstream_lab.research.instances.instance import write_instance

    instance = open_instance(FLIP)
    fleet = instance.problem.fleet
    heavy = fleet.pooled[0]
    fleet = type(fleet)(
        depots=fleet.depots,
        stops=tuple(
            s.model_copy(update={"demand": 9 if s.id == heavy else 1}) for s in fleet.stops
        ),
        vehicles=tuple(v.model_copy(update={"capacity": 4}) for v in fleet.vehicles),
    )
    path = tmp_path / "heavy.toml"
    write_instance(
        replace(
            instance,
            problem=replace(instance.problem, fleet=fleet),
            optimum=None,
            energy_optimum=None,
        ),
        path,
    )
    for form in ("arc", "route"):
        document = solve(capsys, "--instance", str(path), "--form", form)
        assert list(document["unserved"]) == [heavy]
        (exact,) = document["solvers"]
        assert exact["feasible"]
        served = {stop for route in exact["routes"].values() for stop in route["stops"]}
        assert served == {"c1", "c2", "c3", "c4"} - {heavy}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "--instance"),
        (("--instance", "arc99-nowhere"), "--list"),
        (("--instance", "no/such.json"), "no such file"),
        (("--instance", FLIP, "--gamma", "0"), "above 0"),
        (("--instance", FLIP, "--gamma", "nan"), "above 0"),
        (("--instance", FLIP, "--deadline", "-1"), "above 0"),
        (("--instance", FLIP, "--seed", "-1"), "--seed"),
        (("--instance", FLIP, "--options", "1"), "--options"),
        (("--instance", FLIP, "--solver", "magic"), "magic"),
        (("--instance", FLIP, "--write", "model.xyz"), ".mps"),
        (("--instance", FLIP, "--write", "/no/such/folder/model.lp"), "/no/such/folder/model.lp"),
    ],
)
def test_bad_input_is_one_line(capsys: Capture, arguments: tuple[str, ...], said: str) -> None:
    """A user's mistake is one line on standard error and exit status 2."""
    try:
        status = main(["solve", *arguments])
    except SystemExit as end:
        status = int(end.code or 0)
    assert status == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("slipstream: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err


def test_the_arc_form_refuses_what_it_cannot_express(capsys: Capture, city: str) -> None:
    """Time windows are not in the paper's form; the mend is named."""
    assert main(["solve", "--instance", city, "--form", "arc"]) == 2
    assert "--form route" in capsys.readouterr().err


@pytest.mark.skipif(importlib.util.find_spec("cplex") is not None, reason="CPLEX is installed")
def test_a_missing_cplex_names_its_extra(capsys: Capture) -> None:
    """Who has not installed CPLEX is told how, before anything is solved."""
    assert main(["solve", "--instance", FLIP, "--solver", "exact", "cplex"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "slipstream[cplex]" in captured.err
