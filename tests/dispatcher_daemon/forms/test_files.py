from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dimod
import highspy
import numpy as np
import pytest

from dispatcher_daemon.forms.files import column_names, write_milp
from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import ArcProblem, Problem, RouteOption, RouteProblem
from slipstream_lab.research.models.write import WRITERS

Demo = Callable[..., ArcProblem]

ODD_NAMES = RouteProblem(
    ("van 1", "van:2", "e5"),
    ("a+b", "ü"),
    (
        RouteOption("van 1", ("a+b", "ü"), 1.0),
        RouteOption("van 1", ("a+b",), 0.9),
        RouteOption("van:2", (), 0.0),
        RouteOption("van:2", ("ü",), -0.3),
        RouteOption("e5", (), 0.25),
    ),
    {(0, 2): 0.125, (1, 3): 0.2, (3, 4): -0.05},
)


@pytest.fixture(params=["arc", "route"])
def problem(request: pytest.FixtureRequest, demo_arcs: Demo) -> Problem:
    """One problem of each form; the route problem has names that no format allows."""
    return demo_arcs(avenue_east=1, avenue_west=1) if request.param == "arc" else ODD_NAMES


@pytest.mark.parametrize("ending", [".lp", ".mps"])
def test_the_written_milp_has_the_same_optimum(
    problem: Problem, ending: str, tmp_path: Path
) -> None:
    """HiGHS reads the file back and finds the optimum of the model in memory."""
    path = tmp_path / f"model{ending}"
    WRITERS[ending](build_model(problem), path)
    solver: Any = highspy.Highs()
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("mip_rel_gap", 0.0)
    solver.readModel(str(path))
    solver.run()
    exact = solve_milp(problem, 10.0)
    assert solver.getInfo().objective_function_value == pytest.approx(exact.objective_kwh, abs=1e-9)


def test_column_names_are_distinct_and_plain(problem: Problem) -> None:
    """Each column has a name of its own that all formats allow and that holds its index."""
    names = column_names(problem)
    assert len(set(names)) == len(names)
    assert all(name.isascii() and name.replace("_", "").isalnum() for name in names)
    assert [int(n[1 : n.index("_")]) for n in names[: problem.choices]] == list(
        range(problem.choices)
    )


def test_dimod_reads_the_json(problem: Problem, tmp_path: Path) -> None:
    """The QUBO comes back with its names, energies and γ."""
    model = build_model(problem)
    path = tmp_path / "model.json"
    WRITERS[".json"](model, path)
    document = json.loads(path.read_text())
    assert document["info"]["gamma_kwh"] == model.gamma
    back = dimod.BinaryQuadraticModel.from_serializable(document)
    states = np.random.default_rng(1).integers(0, 2, size=(20, len(model.variables)))
    assert back.energies((states, [str(v) for v in model.variables])) == pytest.approx(
        model.total.energies((states, list(model.variables))), rel=1e-12
    )


def test_coordinates_are_the_qubo(problem: Problem, tmp_path: Path) -> None:
    """x^T Q x plus the offset of the first line is the energy of any state."""
    model = build_model(problem)
    path = tmp_path / "model.coo"
    WRITERS[".coo"](model, path)
    head, *rest = path.read_text().splitlines()
    offset = float(dict(part.split("=") for part in head[2:].split())["offset"])
    matrix = np.zeros((len(model.variables),) * 2)
    for line in rest:
        if not line.startswith("#"):
            i, j, bias = line.split()
            matrix[int(i), int(j)] = float(bias)
    assert np.all(np.tril(matrix, -1) == 0)
    states = np.random.default_rng(2).integers(0, 2, size=(20, len(model.variables)))
    energies = np.einsum("si,ij,sj->s", states, matrix, states) + offset
    assert energies == pytest.approx(
        model.total.energies((states, list(model.variables))), rel=1e-9, abs=1e-9
    )


def test_qs_is_the_qubo_as_a_symmetric_matrix(problem: Problem, tmp_path: Path) -> None:
    """x^T Q x with Q's upper half in the file, plus the offset, is the energy of any state."""
    model = build_model(problem)
    path = tmp_path / "model.qs"
    WRITERS[".qs"](model, path)
    lines = path.read_text().splitlines()
    (offset,) = (float(line.split()[2]) for line in lines if "ObjectiveOffset" in line)
    (n, count), *entries = (line.split() for line in lines if not line.startswith("#"))
    assert (int(n), int(count)) == (len(model.variables), len(entries))
    matrix = np.zeros((int(n), int(n)))
    for i, j, value in entries:
        matrix[int(i) - 1, int(j) - 1] = matrix[int(j) - 1, int(i) - 1] = float(value)
    states = np.random.default_rng(2).integers(0, 2, size=(20, int(n)))
    energies = np.einsum("si,ij,sj->s", states, matrix, states) + offset
    assert energies == pytest.approx(
        model.total.energies((states, list(model.variables))), rel=1e-9, abs=1e-9
    )


def test_a_path_that_cannot_be_written_is_an_os_error(tmp_path: Path) -> None:
    """HiGHS would only say that it failed."""
    with pytest.raises(OSError, match="No such file"):
        write_milp(ODD_NAMES, tmp_path / "none" / "model.lp")
