"""Whether entangling gates help LC-QAOA's training or sampling, at equal processor time.

    OPENBLAS_NUM_THREADS=1 python -m slipstream_lab.benchmarks.quantum.gates [--seeds N] [--out DIR]

One run trains one circuit with an angle for each gate (p = 2) from as many starts as fit the
processor time of its encoding, keeps the start with the least mean energy, and samples it without
noise. Arms: with entangling gates; the marginals of the same circuit; without entangling gates;
uniform random starts with one-flip descent; tabu search read by read. Results are stored as they
come, seed by seed over all instances: the same command goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import RouteProblem, build_model
from dispatcher_daemon.settings import LcQaoaSettings, LcQaoaVariant
from dispatcher_daemon.solvers import Bits, TabuSolver, descend
from dispatcher_daemon.solvers.quantum import prepare_model
from dispatcher_daemon.solvers.quantum.chain import ChainState
from slipstream_lab.benchmarks.quantum.gates_report import tables
from slipstream_lab.benchmarks.quantum.variants import VariantCase, arc_cases, route_cases, score
from slipstream_lab.research.quantum.controls import uniform_bits, uniform_choices
from slipstream_lab.research.quantum.store import Record, Store

INSTANCES: Final = 20
SHOTS: Final = 512
LAYERS: Final = 2
_SEEDS: Final = 1000
"""An instance's seed is this times the run's and its number."""
_READS: Final = 32
_BATCH: Final = 256
"""Random starts that are descended together."""

STARTS: Final = {
    ("compact", "gates"): 16,
    ("compact", "product"): 37,
    ("full", "gates"): 8,
    ("full", "product"): 13,
    ("one-hot", "gates"): 16,
    ("one-hot", "product"): 16,
}
"""Training starts of one run by encoding and arm: fixed numbers, so that a seed gives the same
result on every machine, chosen so that both arms of an encoding take about the same time."""
RANDOM_S: Final = {"compact": 2.0, "full": 2.5, "one-hot": 1.5}
"""Processor time after which random starts give up, s."""

ARMS: Final = {
    "compact": ("gates", "product", "random", "tabu"),
    "full": ("gates", "product", "random", "tabu"),
    "one-hot": ("gates", "product", "random"),
}


@lru_cache(maxsize=8)
def cases(encoding: str, count: int) -> list[VariantCase]:
    """Instances in an encoding.

    25 (compact) and 56 (full) variables of the same published instances; 25 route options of
    generated cities (one-hot).
    """
    if encoding == "one-hot":
        return route_cases(count)
    if encoding == "compact":
        return arc_cases(count)
    both = cases("compact", count)
    return [replace(c, model=build_model(c.model.problem, encoding="full")) for c in both]


def optimal_rows(case: VariantCase, bits: Bits) -> npt.NDArray[np.bool_]:
    """Which rows of bits select an optimal solution; auxiliary bits are not read."""
    chosen = bits[:, : case.valid.shape[1]]
    return np.asarray((chosen[:, None] == case.valid[case.best][None]).all(axis=2).any(axis=1))


def train_and_sample(case: VariantCase, encoding: str, arm: str, seed: int) -> Record:
    """One run of a trained circuit, with samples of its state and of its marginals.

    Returns:
        ``train_s`` and ``sample_s`` of processor time; hits among ``SHOTS`` samples, raw and after
        one-flip descent, of circuit and marginals; whether the ``likeliest`` bits are optimal; the
        exact ``p_optimal`` of both.
    """
    variant: LcQaoaVariant = "multi-angle" if arm == "gates" else "product"
    if encoding == "one-hot":
        variant = "one-hot-multi-angle" if arm == "gates" else "one-hot-product"
    starts = STARTS[encoding, arm]
    settings = LcQaoaSettings(variant=variant, layers=LAYERS)
    began = time.process_time()
    prepared = prepare_model(case.model, settings, seed=seed, deadline=math.inf, restarts=starts)
    trained = time.process_time()
    bits = np.empty((SHOTS, len(prepared.order)), dtype=np.int8)
    bits[:, list(prepared.order)] = ChainState(prepared.ansatz).sample(SHOTS, seed)
    sampled = time.process_time()
    exact = score(case, prepared)
    return {
        "starts": starts,
        "train_s": trained - began,
        "sample_s": sampled - trained,
        "energy": prepared.energy,
        "likeliest": bool(exact.rounded),
        "circuit": _hits(case, bits, seed) | {"p_optimal": exact.optimal},
        "marginals": _hits(case, prepared.marginals.sample(SHOTS, seed), seed)
        | {"p_optimal": exact.independent},
    }


def _hits(case: VariantCase, bits: Bits, seed: int) -> Record:
    return {
        "raw": int(optimal_rows(case, bits).sum()),
        "descended": int(optimal_rows(case, descend(case.model, bits, seed)).sum()),
    }


def random_starts(case: VariantCase, encoding: str, seed: int) -> Record:
    """Uniform bits (one-hot: uniform options), descended, until one is optimal."""
    n = len(case.model.variables)
    source = uniform_bits(n)
    if isinstance(case.model.problem, RouteProblem):
        groups = [group for group in case.model.problem.options_of.values() if group]
        source = uniform_choices(n, groups)
    began, drawn = time.process_time(), 0
    while True:
        bits = source.sample(_BATCH, seed * 1_000_003 + drawn)
        hits = np.flatnonzero(optimal_rows(case, descend(case.model, bits, seed)))
        spent = time.process_time() - began
        if len(hits):
            return {"hit": True, "cpu_s": spent, "starts": drawn + int(hits[0]) + 1}
        drawn += _BATCH
        if spent >= RANDOM_S[encoding]:
            return {"hit": False, "cpu_s": spent, "starts": drawn}


def tabu_reads(case: VariantCase, encoding: str, seed: int) -> Record:
    """Reads of the dispatcher's tabu search that end in the optimum, raw and repaired."""
    solver = TabuSolver(reads=_READS, encoding="full" if encoding == "full" else "reduced")
    began = time.process_time()
    # Seeds of reads follow each other.
    found = solver.solve(case.model.problem, 600.0, _READS * seed).samples
    if found is None or found.shots != _READS:
        raise RuntimeError("tabu search did not make all of its reads")
    counts = {
        stage: round(found.share(histogram, case.optimum_kwh) * _READS)
        for stage, histogram in (("raw", found.raw), ("repaired", found.repaired))
    }
    return {"reads": _READS, "cpu_s": time.process_time() - began, **counts}


def run_one(case: VariantCase, encoding: str, arm: str, seed: int) -> Record:
    """One run of an arm; fields by arm."""
    if arm == "random":
        return random_starts(case, encoding, seed)
    if arm == "tabu":
        return tabu_reads(case, encoding, seed)
    return train_and_sample(case, encoding, arm, seed)


def measure(
    store: Store, encodings: Sequence[str], instances: int, seeds: int, say: Callable[[str], None]
) -> None:
    """All runs that the store lacks, seed by seed, so that an interrupted table is a fair one."""
    by_encoding = {encoding: cases(encoding, instances) for encoding in encodings}
    for seed in range(1, seeds + 1):
        for encoding, several in by_encoding.items():
            for number, case in enumerate(several, start=1):
                # The instances are alike: with one seed for all, one start would be lucky for all.
                own = _SEEDS * seed + number
                for arm in ARMS[encoding]:
                    row = f"{encoding}/{arm}/{seed}"
                    if store.get(row, case.name) is None:
                        store.put(row, case.name, run_one(case, encoding, arm, own))
        say(f"seed {seed} of {seeds}")


def stamp() -> dict[str, Any]:
    """What results depend on besides instance, arm and seed."""
    starts = {f"{encoding}/{arm}": count for (encoding, arm), count in STARTS.items()}
    return {"shots": SHOTS, "layers": LAYERS, "starts": starts, "random_s": RANDOM_S}


def stored(store: Store, encoding: str, instances: int, seeds: int) -> list[Record]:
    """Records of an encoding by arm, of the pairs of instance and seed that have every arm."""
    found = []
    for case in cases(encoding, instances):
        for seed in range(1, seeds + 1):
            by_arm = {a: store.get(f"{encoding}/{a}/{seed}", case.name) for a in ARMS[encoding]}
            if all(record is not None for record in by_arm.values()):
                found.append({"instance": case.name, "seed": seed, **by_arm})
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is missing and print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.gates", description=__doc__
    )
    parser.add_argument("--instances", type=int, choices=range(1, 21), default=20, metavar="N")
    parser.add_argument("--seeds", type=int, default=10, metavar="N", help="of each (default: 10)")
    parser.add_argument("--encodings", nargs="+", choices=ARMS, default=list(ARMS))
    parser.add_argument("--short", action="store_true", help="two instances, one seed")
    parser.add_argument("--stored", action="store_true", help="measure nothing, show what there is")
    parser.add_argument("--out", type=Path, default=Path(".slipstream/bench-gates"), metavar="DIR")
    options = parser.parse_args(arguments)
    instances, seeds = (2, 1) if options.short else (options.instances, options.seeds)
    with Store(options.out / "gates.jsonl", stamp(), read_only=options.stored) as store:
        if not options.stored:
            say = lambda line: print(line, file=sys.stderr, flush=True)  # noqa: E731
            measure(store, options.encodings, instances, seeds, say)
        runs = {e: stored(store, e, instances, seeds) for e in options.encodings}
    print("\n".join(tables(runs)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
