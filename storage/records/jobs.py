"""The ledger of quantum jobs, written by the dispatcher.

A job is stored before it is submitted, and again at each change of its record.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Final, Literal

from sqlalchemy import delete, or_, select
from sqlalchemy.orm import Session

from storage.models import QuantumJobRow

LedgerState = Literal["intent", "queued", "running", "done", "failed", "cancelled", "lost"]

OPEN_STATES: Final[tuple[LedgerState, ...]] = ("intent", "queued", "running")
"""States in which a job may still use device time."""


@dataclass(frozen=True)
class QuantumJob:
    """One job of a quantum device.

    Attributes:
        tag: unique; also stored by the service with the job.
        job_id: the service's identifier; None until it is known.
        backend: names of the service and of the device.
        kind: "hardware", or "noise-model" for a simulator with a device's noise.
        cycle: number of the cycle that requested it.
        submitted_ns: UTC at which it was first stored, just before its submission.
        updated_ns: UTC of the last change of this record.
        finished_ns: UTC at which it was found to have finished; None before.
        state: "intent": not yet confirmed by the service; "lost": unknown to the service.
        reason: one line on why it failed, was cancelled or was lost; None otherwise.
        estimate_s: device time reserved for it, s.
        usage_s: device time charged, s; None while unknown.
        shots: number of samples requested.
        circuit: hash of the circuit.
        variables: hash of the meaning of its variables.
        chain_order: qubit q carries variable ``chain_order[q]``.
        variant: name of the variant of the algorithm.
        layers: number of QAOA layers, p.
        two_qubit_depth: layers of two-qubit gates after compilation; None if unknown.
        two_qubit_gates: number of two-qubit gates after compilation; None if unknown.
        train_s: time to train the angles, s.
        answer: "used" by a cycle; "unfit": read, but no sample gave feasible routes; "late": too
            late for any cycle; None: not read yet, or no answer.
        answer_cycle: number of the cycle that read the answer.
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
        """True while it may still use device time."""
        return self.state in OPEN_STATES


def save(session: Session, job: QuantumJob) -> None:
    """Add a job, or update its record."""
    session.merge(QuantumJobRow(**asdict(job) | {"chain_order": list(job.chain_order)}))


def since(session: Session, finished_ns: int) -> list[QuantumJob]:
    """Jobs that are open or finished at ``finished_ns`` or later, oldest first."""
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


def latest(session: Session, limit: int) -> tuple[QuantumJob, ...]:
    """The last ``limit`` jobs, latest first."""
    query = (
        select(QuantumJobRow)
        .order_by(QuantumJobRow.submitted_ns.desc(), QuantumJobRow.tag)
        .limit(limit)
    )
    return tuple(map(quantum_job, session.scalars(query)))


def prune(session: Session, before_ns: int) -> None:
    """Delete the jobs that finished before ``before_ns``."""
    session.execute(
        delete(QuantumJobRow).where(
            QuantumJobRow.state.not_in(OPEN_STATES), QuantumJobRow.finished_ns < before_ns
        )
    )


def quantum_job(row: QuantumJobRow) -> QuantumJob:
    """Read a job back from its row."""
    values = {field.name: getattr(row, field.name) for field in fields(QuantumJob)}
    return QuantumJob(**values | {"chain_order": tuple(values["chain_order"])})
