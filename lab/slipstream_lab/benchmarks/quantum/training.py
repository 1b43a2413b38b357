"""How long LC-QAOA takes to train, without a device: `python -m
slipstream_lab.benchmarks.quantum.training`.

Times are of `prepare_model`: chain order, angles, and the exact energy of the result. 25 qubits are
the named instances; 500 are the vehicles of a generated city, in route form.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Final

from dispatcher_daemon.forms import QuboModel, build_model
from dispatcher_daemon.settings import LcQaoaSettings, LcQaoaVariant
from dispatcher_daemon.solvers.quantum import RESTARTS, prepare_model
from slipstream_lab.benchmarks.aims import Check, check_table, machine
from slipstream_lab.benchmarks.quantum.blocks import city_part
from slipstream_lab.research.quantum.case import named_cases, open_case

LARGE: Final = 500
CITY: Final = (200, 1000, 2000)
"""Vehicles, stops, segments."""
_SEED: Final = 1


@dataclass(frozen=True)
class Timing:
    """Training of one kind of circuit.

    Attributes:
        qubits: of each circuit.
        variant: of LC-QAOA.
        restarts: of multi-angle training, 100 iterations each.
        evaluations: of the objective, by circuit.
        train_s: by circuit.
        aim_s: at most; None where there is no aim.
        paper_s: with the device in the loop.
    """

    qubits: int
    variant: LcQaoaVariant
    restarts: int
    evaluations: tuple[int, ...]
    train_s: tuple[float, ...]
    aim_s: float | None
    paper_s: float | None


def measure(instances: int, layers: int, iterations: int, large: int) -> Iterator[Timing]:
    """All timings.

    Args:
        large: qubits of the large circuit; 0: none.
    """
    small = [open_case(name).model for name in named_cases(instances)]
    warm_up = LcQaoaSettings(layers=1, iterations=2)
    prepare_model(small[0], warm_up, seed=_SEED, deadline=float("inf"))
    kinds: tuple[tuple[LcQaoaVariant, int], ...] = (("trained", 1), ("multi-angle", 1))
    for variant, restarts in kinds:
        aim_s = 2.0 if variant == "trained" else None
        yield _timing(small, variant, layers, iterations, restarts, aim_s, 31.34)
    yield _timing(small, "multi-angle", layers, iterations, RESTARTS, None, None)
    if large:
        model = build_model(city_part(_SEED, CITY, large).problem)
        for variant, restarts in kinds:
            yield _timing([model], variant, layers, iterations, restarts, 60.0, None)


def _timing(
    models: Sequence[QuboModel],
    variant: LcQaoaVariant,
    layers: int,
    iterations: int,
    restarts: int,
    aim_s: float | None,
    paper_s: float | None,
) -> Timing:
    settings = LcQaoaSettings(variant=variant, layers=layers, iterations=iterations)
    times, evaluations = [], []
    for model in models:
        began = time.perf_counter()
        prepared = prepare_model(
            model, settings, seed=_SEED, deadline=float("inf"), restarts=restarts
        )
        times.append(time.perf_counter() - began)
        evaluations.append(prepared.evaluations)
    return Timing(
        len(models[0].variables),
        variant,
        restarts,
        tuple(evaluations),
        tuple(times),
        aim_s,
        paper_s,
    )


def check_of(timing: Timing, layers: int) -> Check:
    """One row: the slowest circuit against the aim."""
    kind = timing.variant if timing.restarts == 1 else f"{timing.variant}, {timing.restarts} starts"
    paper = "" if timing.paper_s is None else f" (the paper, on the device: {timing.paper_s:g} s)"
    worst = max(timing.train_s)
    calls = sum(timing.evaluations) / len(timing.evaluations)
    return Check(
        f"training, {timing.qubits} qubits, p = {layers}, {kind}, {calls:.0f} evaluations{paper}",
        f"{median(timing.train_s):.2f} s, at most {worst:.2f} s of {len(timing.train_s)}",
        "–" if timing.aim_s is None else f"≤ {timing.aim_s:g} s",
        None if timing.aim_s is None else worst <= timing.aim_s,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; exit status 0 if all aims are reached."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.training", description=__doc__
    )
    parser.add_argument("--instances", type=int, choices=range(1, 21), default=20, metavar="N")
    parser.add_argument("--layers", type=int, choices=range(1, 6), default=2, metavar="P")
    parser.add_argument("--iterations", type=int, default=100, metavar="N")
    parser.add_argument("--large", type=int, default=LARGE, metavar="QUBITS", help="0: none")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    found = list(measure(options.instances, options.layers, options.iterations, options.large))
    found_checks = [check_of(timing, options.layers) for timing in found]
    if options.json:
        print(json.dumps({"machine": machine(), "timings": [asdict(t) for t in found]}))
    else:
        print("\n".join(check_table(found_checks)))
    return 1 if any(check.reached is False for check in found_checks) else 0


if __name__ == "__main__":
    sys.exit(main())
