"""Instance files of the catalogue, each with its proven optimum and provenance."""

from __future__ import annotations

from pathlib import Path

from dispatcher_daemon.arc_form import arc_problem_of
from dispatcher_daemon.formulations import decode
from research.instances.catalogue import CATALOGUE
from research.instances.generator import GENERATOR_VERSION, SYNC_WINDOW_S, generate
from research.instances.instance import Instance, Optimum, write_instance
from research.proofs.proof import prove


def make_instance(name: str) -> Instance:
    """Generate an instance of the catalogue and prove its optimum.

    Raises:
        KeyError: the catalogue has no such name.
        RuntimeError: its QUBO is not exact.
    """
    recipe, seed = CATALOGUE[name]
    drawn = generate(recipe, seed)
    arcs = arc_problem_of(drawn.problem, drawn.snapshot, SYNC_WINDOW_S)
    proof = prove(arcs)
    routes = decode(arcs, proof.found.minimum_selected).routes
    if not proof.holds or routes is None:
        raise RuntimeError(f"{name}: {proof.faults()}")
    return Instance(
        name=name,
        problem=drawn.problem,
        snapshot=drawn.snapshot,
        provenance=f"Slipstream's generator version {GENERATOR_VERSION} (recipe {name!r} of "
        f"research.instances.catalogue, seed {seed}, draw {drawn.draw})",
        optimum=Optimum(
            form="arc",
            # To 1e-9 kWh, so that processors which round differently write the same file.
            objective_kwh=round(arcs.objective_kwh(proof.found.minimum_selected), 9),
            proven=True,
            method=f"all {proof.found.states} states of the reduced QUBO with "
            f"{proof.variables} variables enumerated; the linearised MILP solved by HiGHS agrees",
            routes=routes,
        ),
        sync_window_s=SYNC_WINDOW_S,
    )


def publish(folder: Path) -> None:
    """Write all instances of the catalogue, a JSON file each."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in CATALOGUE:
        write_instance(make_instance(name), folder / f"{name}.json")
