"""How long LC-QAOA takes to train, without a device: `python -m
slipstream_lab.benchmarks.quantum.training`.

Times are of `prepare_model`: chain order, angles, and the exact energy of the result. 25 qubits are
the named instances; 500 are the vehicles of a generated city, in route form.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Final

from dispatcher_daemon.forms import QuboModel, build_model
from dispatcher_daemon.settings import LcQaoaSettings, LcQaoaVariant
from dispatcher_daemon.solvers.quantum import RESTARTS, prepare_model
from slipstream_lab.benchmarks.aims import Check, check_table
from slipstream_lab.benchmarks.quantum.blocks import city_part
from slipstream_lab.research.quantum.case import named_cases, open_case

LARGE: Final = 500
CITY: Final = (200, 1000, 2000)
"""Vehicles, stops, segments."""
PAPER_S: Final = 31.34
"""The paper's time with the device in the loop, 25 qubits, s."""
_SEED: Final = 1


def measure(instances: int, layers: int, iterations: int, large: int) -> Iterator[Check]:
    """All timings, each circuit's slowest one against its aim.

    Args:
        large: qubits of the large circuit; 0: none.
    """
    small = [open_case(name).model for name in named_cases(instances)]
    warm_up = LcQaoaSettings(layers=1, iterations=2)
    prepare_model(small[0], warm_up, seed=_SEED, deadline=float("inf"))
    trained, single = (
        LcQaoaSettings(variant=v, layers=layers, iterations=iterations) for v in _KINDS
    )
    yield _timing(small, trained, 1, 2.0, f" (the paper, on the device: {PAPER_S:g} s)")
    yield _timing(small, single, 1, None, f" (the paper, on the device: {PAPER_S:g} s)")
    yield _timing(small, single, RESTARTS, None)
    if large:
        model = build_model(city_part(_SEED, CITY, large).problem)
        for settings in (trained, single):
            yield _timing([model], settings, 1, 60.0)


_KINDS: Final[tuple[LcQaoaVariant, LcQaoaVariant]] = ("trained", "multi-angle")


def _timing(
    models: Sequence[QuboModel],
    settings: LcQaoaSettings,
    restarts: int,
    aim_s: float | None,
    beside: str = "",
) -> Check:
    times, calls = [], 0
    for model in models:
        began = time.perf_counter()
        prepared = prepare_model(
            model, settings, seed=_SEED, deadline=float("inf"), restarts=restarts
        )
        times.append(time.perf_counter() - began)
        calls += prepared.evaluations
    kind = settings.variant if restarts == 1 else f"{settings.variant}, {restarts} starts"
    return Check(
        f"training, {len(models[0].variables)} qubits, p = {settings.layers}, {kind}, "
        f"{calls / len(models):.0f} evaluations{beside}",
        f"{median(times):.2f} s, at most {max(times):.2f} s of {len(times)}",
        "–" if aim_s is None else f"≤ {aim_s:g} s",
        None if aim_s is None else max(times) <= aim_s,
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
    options = parser.parse_args(arguments)
    found = list(measure(options.instances, options.layers, options.iterations, options.large))
    print("\n".join(check_table(found)))
    return 1 if any(check.reached is False for check in found) else 0


if __name__ == "__main__":
    sys.exit(main())
