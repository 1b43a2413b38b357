"""Measurement of all rows on all instances, and the resulting tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from slipstream_lab.research.quantum.backends.opening import open_backend
from slipstream_lab.research.quantum.case import QuantumCase, named_cases, open_case
from slipstream_lab.research.quantum.report import Table
from slipstream_lab.research.quantum.rows import (
    BenchSettings,
    QuantumRow,
    hardware_rows,
    mitigation_rows,
    sweep_rows,
)
from slipstream_lab.research.quantum.store import Record, Store
from slipstream_lab.research.quantum.summary import Line, summarise

HARDWARE: Final = "hardware"
SWEEP: Final = "sweep"
MITIGATION: Final = "mitigation"
TABLES: Final = (HARDWARE, SWEEP, MITIGATION)

NOTES: Final = (
    "means over the instances ± standard deviation between them; wall is all of a solve: training, "
    "transpilation, sampling, post-processing, on this machine",
    "P_feas and P_opt are shares of all shots; descended and repaired are P_feas / P_opt after "
    "post-processing, which the paper's figures do not have; its one instance is not published",
    "QUBO cost: the answer's after all stages, with no constant left out; the paper's has a unit "
    "and constants that it does not name, so that only gaps to the optimum compare; gap raw: of "
    "the best raw shot, of the instances that have a valid one",
    "optimum: instances of which some shot (raw), or the answer after all stages, is the proven "
    "optimum",
    "controls: the control's share, what the circuit adds to it, ± standard error by the shots, "
    "± by the instances; marginals: the trained circuit's own one-qubit probabilities, sampled "
    "without it",
)

NOT_RUN: Final = "not run"
"""Mark of a row without a result."""

_VERSION: Final = 1
"""Of what is stored; a higher one measures all anew. Raise it when a change to the code would give
another result with the same settings and seed: circuits, training, noise, stages, controls, seeds,
or the named instances."""


def run(
    settings: BenchSettings,
    tables: Sequence[str],
    out: Path | None,
    progress: Callable[[int, int, str], None],
    *,
    stored: bool = False,
) -> list[Table]:
    """The tables asked for (of `TABLES`), with what is stored taken over.

    Args:
        stored: nothing is measured, rows have as many instances as are stored.
        out: folder for the results as they come; None: none is written.
        progress: called with the number of results, the total, and the next row.

    Raises:
        InputError: a back end is unknown, credentials are missing, the folder is not writable, its
            results are damaged, or another run is at them.
        OSError: the disk is full.
        ModuleNotFoundError: a device is named and the extra ``iskay`` is not installed.
    """
    open_backend(settings.noise)
    rows_of: dict[str, list[QuantumRow]] = {}
    if HARDWARE in tables:
        rows_of[HARDWARE] = hardware_rows(settings)
    if SWEEP in tables:
        rows_of[SWEEP] = sweep_rows(settings)
    if MITIGATION in tables:
        rows_of[MITIGATION] = mitigation_rows(settings)
    stamp = settings.model_dump(mode="json", include={"shots", "seed", "iterations"})
    path = None if out is None else out / "results.jsonl"
    rows = {row.key: row for of_table in rows_of.values() for row in of_table}
    names = named_cases(settings.instances)
    with Store(path, {"version": _VERSION, **stamp}, read_only=stored) as store:
        if stored:
            measured = {
                key: [r for name in names if (r := store.get(key, name)) is not None]
                for key in rows
            }
        else:
            measured = _measure(list(rows.values()), names, store, progress)
    titles = {
        HARDWARE: f"The paper's hardware table, {settings.instances} instances of 25 variables",
        SWEEP: f"LC-QAOA by depth, {settings.instances} instances of 25 variables",
        MITIGATION: "Decoupling and twirling against idle and coherent errors (assumed), "
        f"{settings.instances} instances of 25 variables",
    }
    return [
        Table(name, titles[name], tuple(_line(row, measured[row.key]) for row in of_table))
        for name, of_table in rows_of.items()
    ]


def _measure(
    rows: Sequence[QuantumRow],
    names: Sequence[str],
    store: Store,
    progress: Callable[[int, int, str], None],
) -> dict[str, list[Record]]:
    wanted = [row for row in rows if row.measure is not None]
    # Instance by instance, so that an interrupted run has whole instances; slow rows come last.
    pairs = [
        (row, number, name)
        for slow in (False, True)
        for number, name in enumerate(names)
        for row in wanted
        if number < row.most and slow == (row.most < len(names))
    ]
    found: dict[str, list[Record]] = {row.key: [] for row in rows}
    cases: dict[int, QuantumCase] = {}
    for done, (row, number, name) in enumerate(pairs):
        record = store.get(row.key, name)
        if record is None and row.measure is not None:
            progress(done, len(pairs), f"{name}: {row.title}")
            if number not in cases:
                cases = {number: open_case(name)}
            record = store.put(row.key, name, row.measure(cases[number]))
        found[row.key].append(record or {})
    progress(len(pairs), len(pairs), "")
    return found


def _line(row: QuantumRow, records: Sequence[Record]) -> Line:
    if not records:
        return Line(row.key, row.title, NOT_RUN, row.paper, {}, *(None,) * 4, (), reason=row.reason)
    line = summarise(row.key, row.title, row.mark, row.paper, records)
    elsewhere = [r for r in records if r.get("fallback") is not None]
    if elsewhere:
        # Not what was asked for must not pass for it.
        mark = f"{elsewhere[0]['kind']}, {len(elsewhere)} of {len(records)}"
        return replace(line, mark=mark, reason=str(elsewhere[0]["fallback"]))
    return replace(line, reason=row.reason)
