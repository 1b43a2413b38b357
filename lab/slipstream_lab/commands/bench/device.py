"""`slipstream bench device`: whether asking a quantum device is worth its budget."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Final

from slipstream.errors import InputError

if TYPE_CHECKING:
    from slipstream_lab.research.quantum.device import Cell

_SHORT: Final = {"widths": (5, 10), "layers": (1, 2, 5), "shots": 128}
_EXIT_FAULT: Final = 1
_EXIT_INTERRUPTED: Final = 130


def add_to(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = kinds.add_parser(
        "device",
        help="the linear-ramp test: how wide and deep circuits may be on a quantum device",
        description="Weighted MaxCut on chains with a fixed linear QAOA schedule (LR-QAOA), by "
        "width n and depth p, against random sampling at 3 sigma. A device is charged some 6 s "
        "for each circuit of 512 shots; a width's deeper circuits are left out after one that "
        "is not above random. It says whether samples still carry a signal, not whether they are "
        "better than a classical solver's. Exit status 1 where the device fails.",
    )
    command.add_argument(
        "--backend",
        metavar="NAME",
        help="aer:FakeBoston or another fake device (simulated with its noise), aer, ibm:NAME, "
        "ibm:least-busy (default: aer:FakeBoston)",
    )
    command.add_argument(
        "--widths", type=int, nargs="+", metavar="N", help="qubits (default: 5 10 15 20)"
    )
    command.add_argument(
        "--layers", type=int, nargs="+", metavar="P", help="depths (default: 1 2 5 10)"
    )
    command.add_argument("--shots", type=int, metavar="N", help="of each circuit (default: 512)")
    command.add_argument("--seed", type=int, metavar="N", help="of weights and noise (default: 1)")
    command.add_argument("--short", action="store_true", help="two widths, three depths, 128 shots")
    command.add_argument("--json", action="store_true", help="print the cells as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Measure and print; what was measured is printed after Ctrl-C and faults, too."""
    from dispatcher_daemon.solvers.quantum.backends import ServiceFault
    from slipstream.config import check
    from slipstream_lab.research.quantum.backends.opening import open_backend
    from slipstream_lab.research.quantum.device import (
        DeviceTestSettings,
        as_json,
        as_markdown,
        measure,
    )

    names = ("backend", "widths", "layers", "shots", "seed")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    settings = check((_SHORT if options.short else {}) | given, DeviceTestSettings, "bench device")
    try:
        backend = open_backend(settings.backend)
    except ServiceFault as fault:
        raise InputError(
            settings.backend, str(fault), "try again later, or take aer:FakeBoston", key="--backend"
        ) from None
    cells: list[Cell] = []

    def keep(cell: Cell) -> None:
        cells.append(cell)
        if sys.stderr.isatty():
            sys.stderr.write(f"\r\x1b[Kn = {cell.width}, p = {cell.layers}: {cell.r or cell.fault}")
            sys.stderr.flush()

    status = 0
    try:
        measure(backend, settings, keep)
    except KeyboardInterrupt:
        status = _EXIT_INTERRUPTED
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
    if options.json:
        print(json.dumps(as_json(cells, backend.name, backend.kind, settings.seed)))
    else:
        print(as_markdown(cells, backend.name, backend.kind))
    return status or (_EXIT_FAULT if any(c.fault for c in cells) else 0)
