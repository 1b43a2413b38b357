"""The ledger of jobs given to a quantum device: what is stored of each, written by the dispatcher.

A job is stored before it is submitted, and again whenever something new is known of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Final, Literal

from sqlalchemy import delete, or_, select
from sqlalchemy.orm import Session

from storage.models import QuantumJobRow

LedgerState = Literal["intent", "queued", "running", "done", "failed", "cancelled", "lost"]

OPEN_STATES: Final[tuple[LedgerState, ...]] = ("intent", "queued", "running")
"""A job in one of these may still cost device time."""


@dataclass(frozen=True)
class QuantumJob:
    """One job, as the dispatcher knows it.

    Attributes:
        tag: unique; the service keeps it with the job.
        job_id: the service's; None until it is known.
        backend: name of the service and of the device.
        kind: "hardware", or "noise-model" where a simulator stands in for the device.
        cycle: that it was made for.
        submitted_ns: UTC at which it was stored, just before it was submitted.
        updated_ns: UTC of the last news.
        finished_ns: UTC at which it was found to be over; None before.
        state: "intent": the service has not confirmed it; "lost": given up without a trace.
        reason: of a job that failed, was cancelled or lost, in one line.
        estimate_s: device time reserved for it, s.
        usage_s: device time charged, s; None while unknown.
        shots: number of samples asked for.
        circuit: fingerprint of the circuit.
        variables: fingerprint of what its variables stand for.
        chain_order: qubit q carries variable ``chain_order[q]``.
        variant: of the algorithm.
        layers: depth p.
        two_qubit_depth: layers of two-qubit gates; None if the device's compiler did not tell.
        two_qubit_gates: their number.
        train_s: time for the angles, s.
        answer: "used": a cycle took it; "unfit": a cycle read it, but no sample led to routes;
            "late": no cycle had use for it in time; None: not read yet, or none came.
        answer_cycle: the cycle that read it.
    """

    tag: str
    job_id: str | None
    backend: str
    kind: Literal["noise-model", "hardware"]
    cycle: int
    submitted_ns: int
    updated_ns: int
    finished_ns: int | None
    state: LedgerState
    reason: str | None
    estimate_s: float
    usage_s: float | None
    shots: int
    circuit: str
    variables: str
    chain_order: tuple[int, ...]
    variant: str
    layers: int
    two_qubit_depth: int | None
    two_qubit_gates: int | None
    train_s: float
    answer: Literal["used", "unfit", "late"] | None = None
    answer_cycle: int | None = None

    @property
    def open(self) -> bool:
        """True while it may still cost device time."""
        return self.state in OPEN_STATES


def save(session: Session, job: QuantumJob) -> None:
    """Add a job, or bring what is stored of it up to date."""
    session.merge(QuantumJobRow(**asdict(job) | {"chain_order": list(job.chain_order)}))


def since(session: Session, finished_ns: int) -> list[QuantumJob]:
    """Jobs that are open, and those found to be over at ``finished_ns`` or later; oldest first."""
    query = (
        select(QuantumJobRow)
        .where(
            or_(
                QuantumJobRow.state.in_(OPEN_STATES),
                QuantumJobRow.finished_ns.is_(None),
                QuantumJobRow.finished_ns >= finished_ns,
            )
        )
        .order_by(QuantumJobRow.submitted_ns, QuantumJobRow.tag)
    )
    return [quantum_job(row) for row in session.scalars(query)]


def latest(session: Session, limit: int) -> Sequence[QuantumJob]:
    """The last ``limit`` jobs, latest first."""
    query = (
        select(QuantumJobRow)
        .order_by(QuantumJobRow.submitted_ns.desc(), QuantumJobRow.tag)
        .limit(limit)
    )
    return [quantum_job(row) for row in session.scalars(query)]


def prune(session: Session, before_ns: int) -> None:
    """Delete jobs that were over before that."""
    session.execute(
        delete(QuantumJobRow).where(
            QuantumJobRow.state.not_in(OPEN_STATES), QuantumJobRow.finished_ns < before_ns
        )
    )


def quantum_job(row: QuantumJobRow) -> QuantumJob:
    """Read a job back from its row."""
    values = {field.name: getattr(row, field.name) for field in fields(QuantumJob)}
    return QuantumJob(**values | {"chain_order": tuple(values["chain_order"])})
