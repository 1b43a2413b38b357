"""Instance files of the catalogue, each with its proven optima and provenance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dispatcher_daemon.forms import ArcProblem, decode
from dispatcher_daemon.planning.arc_form import arc_problem_of
from slipstream_lab.research.instances.catalogue import CATALOGUE
from slipstream_lab.research.instances.generator import GENERATOR_VERSION, SYNC_WINDOW_S, generate
from slipstream_lab.research.instances.instance import Instance, Optimum, write_instance
from slipstream_lab.research.proofs.proof import prove


def make_instance(name: str) -> Instance:
    """Generate an instance of the catalogue and prove its optimum under both objectives.

    Raises:
        KeyError: the catalogue has no such name.
        RuntimeError: its QUBO is not exact.
    """
    recipe, seed = CATALOGUE[name]
    drawn = generate(recipe, seed)
    exact = replace(drawn.problem, objective="energy")
    return Instance(
        name=name,
        problem=drawn.problem,
        snapshot=drawn.snapshot,
        provenance=f"Slipstream's generator version {GENERATOR_VERSION} (recipe {name!r} of "
        f"slipstream_lab.research.instances.catalogue, seed {seed}, draw {drawn.draw})",
        optimum=_proven(name, arc_problem_of(drawn.problem, drawn.snapshot, SYNC_WINDOW_S)),
        energy_optimum=_proven(name, arc_problem_of(exact, drawn.snapshot, SYNC_WINDOW_S)),
        sync_window_s=SYNC_WINDOW_S,
    )


def _proven(name: str, arcs: ArcProblem) -> Optimum:
    proof = prove(arcs)
    routes = decode(arcs, proof.found.minimum_selected).routes
    if not proof.holds or routes is None:
        raise RuntimeError(f"{name}: {proof.faults()}")
    return Optimum(
        form="arc",
        # To 1e-9 kWh, so that processors which round differently write the same file.
        objective_kwh=round(arcs.objective_kwh(proof.found.minimum_selected), 9),
        proven=True,
        method=f"all {proof.found.states} states of the reduced QUBO with "
        f"{proof.variables} variables enumerated; the linearised MILP solved by HiGHS agrees",
        routes=routes,
    )


def publish(folder: Path) -> None:
    """Write all instances of the catalogue, a JSON file each."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in CATALOGUE:
        write_instance(make_instance(name), folder / f"{name}.json")
