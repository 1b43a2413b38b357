"""A job as it begins, what is known of it beside the ledger, and what is told of it in the end."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field

from dispatcher_daemon.hardware.calls import Prepared
from dispatcher_daemon.hardware.ledger import DeviceKind
from dispatcher_daemon.hardware.ticket import Ticket
from dispatcher_daemon.settings import HardwareSettings
from dispatcher_daemon.solvers.protocol import Execution
from storage import QuantumJob

_NS = 1e9


@dataclass
class Care:
    """What is known of a job beside the ledger.

    Attributes:
        next_at: of the next look at it, by the monotonic clock.
        period_s: from that one to the look after it.
        unknown_since: first of the looks in a row at which the service did not know it.
        cancelled: its cancellation was asked for.
        samples: of a job that is done, until they are read.
        tickets: problems that wait for it.
    """

    next_at: float
    period_s: float
    unknown_since: float | None = None
    cancelled: bool = False
    samples: Mapping[str, int] | None = None
    tickets: list[Ticket] = field(default_factory=list)


def intent(
    ticket: Ticket, prepared: Prepared, kind: DeviceKind, settings: HardwareSettings, now_ns: int
) -> QuantumJob:
    """What is stored of a job before it is submitted, under a tag that no other job has."""
    return QuantumJob(
        tag=f"slipstream-{ticket.cycle}-{secrets.token_hex(8)}",
        job_id=None,
        # Of the least busy device the name is only known now.
        backend=f"{settings.backend.partition(':')[0]}:{prepared.backend}",
        kind=kind,
        cycle=ticket.cycle,
        submitted_ns=now_ns,
        updated_ns=now_ns,
        finished_ns=None,
        state="intent",
        reason=None,
        estimate_s=prepared.estimate_s,
        usage_s=None,
        shots=settings.shots,
        circuit=prepared.fingerprint,
        variables=ticket.meaning,
        chain_order=prepared.order,
        variant=prepared.variant,
        layers=prepared.layers,
        two_qubit_depth=prepared.two_qubit_depth,
        two_qubit_gates=prepared.two_qubit_gates,
        train_s=prepared.train_s,
    )


def execution_of(job: QuantumJob) -> Execution:
    """Where and how the circuit of a job ran."""
    return Execution(
        backend=job.backend,
        kind=job.kind,
        variant=job.variant,
        layers=job.layers,
        two_qubit_depth=job.two_qubit_depth,
        two_qubit_gates=job.two_qubit_gates,
        train_s=job.train_s,
        sample_s=((job.finished_ns or job.submitted_ns) - job.submitted_ns) / _NS,
        job=job.job_id,
    )
