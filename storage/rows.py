"""Maps messages to rows and back; the two directions are exact inverses.

Columns have the names of the messages' fields, so a new scalar field of a message needs a column in
`storage.models` and a migration, and nothing here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from slipstream.energy.ledger import PlanEnergy
from slipstream.messages import (
    CarrierSummary,
    CycleReport,
    EnergySummary,
    Gate,
    SolverReport,
    Unserved,
    VehiclePlan,
)
from storage.models import CycleRow, PlanRow, SolverRunRow

_MAPPED_FIELDS = {"solvers", "gates", "energy", "unserved", "carriers", "plans"}
"""Fields of a CycleReport that `cycle_row` maps one by one."""
_CYCLE_FIELDS = tuple(name for name in CycleReport.model_fields if name not in _MAPPED_FIELDS)
_ENERGY_FIELDS = tuple(EnergySummary.model_fields)
_SOLVER_FIELDS = tuple(SolverReport.model_fields)
_PLAN_FIELDS = tuple(VehiclePlan.model_fields)
_BY_SEGMENT = ("driven_kwh", "saved_drag_kwh")


def cycle_row(
    report: CycleReport,
    plans: Sequence[VehiclePlan],
    energies: Mapping[str, PlanEnergy] | None = None,
) -> CycleRow:
    """Build the row of a cycle with its solver runs and plans; its gates are stored as traffic."""
    energy_of = energies or {}
    energy = report.energy.model_dump() if report.energy else {}
    return CycleRow(
        **report.model_dump(include=set(_CYCLE_FIELDS)),
        **energy,
        plan_count=report.plans,
        unserved=[stop.model_dump() for stop in report.unserved],
        carriers=[carrier.model_dump() for carrier in report.carriers],
        solver_runs=[
            SolverRunRow(position=position, **run.model_dump())
            for position, run in enumerate(report.solvers)
        ],
        plans=[
            PlanRow(
                **plan.model_dump(mode="json"),
                status="published",
                status_ns=report.started_ns,
                segment_energy=_plan_energy_values(energy_of.get(plan.vehicle)),
            )
            for plan in plans
        ],
    )


def cycle_report(row: CycleRow, gates: Sequence[Gate] = ()) -> CycleReport:
    """Read a CycleReport back from its row and its gates."""
    energy = None
    if row.baseline is not None:
        energy = EnergySummary.model_validate(_fields(row, _ENERGY_FIELDS))
    return CycleReport.model_validate(
        {
            **_fields(row, _CYCLE_FIELDS),
            "plans": row.plan_count,
            "solvers": tuple(
                SolverReport.model_validate(_fields(run, _SOLVER_FIELDS)) for run in row.solver_runs
            ),
            "gates": tuple(gates),
            "energy": energy,
            "unserved": tuple(Unserved.model_validate(stop) for stop in row.unserved),
            "carriers": tuple(CarrierSummary.model_validate(of_one) for of_one in row.carriers),
        }
    )


def vehicle_plan(row: PlanRow) -> VehiclePlan:
    """Read a VehiclePlan back from its row."""
    # Not strict: JSON has lists where the message has tuples.
    return VehiclePlan.model_validate(_fields(row, _PLAN_FIELDS), strict=False)


def plan_energy(row: PlanRow) -> PlanEnergy | None:
    """Read a PlanEnergy back from its plan's row; None: there is none."""
    if row.segment_energy is None:
        return None
    values: dict[str, Any] = dict(row.segment_energy)
    for name in _BY_SEGMENT:
        values[name] = tuple(float(value) for value in values[name])
    return PlanEnergy(**values)


def _plan_energy_values(energy: PlanEnergy | None) -> dict[str, Any] | None:
    if energy is None:
        return None
    # To a milliwatt hour: with all digits they would be a third of a plan's row.
    rounded = {name: [round(kwh, 6) for kwh in getattr(energy, name)] for name in _BY_SEGMENT}
    return asdict(energy) | rounded


def _fields(row: object, names: Sequence[str]) -> dict[str, object]:
    return {name: getattr(row, name) for name in names}
