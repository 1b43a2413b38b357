"""What is asked of a service that runs circuits for others, and how it fails."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement

JobState = Literal["queued", "running", "done", "failed", "cancelled", "lost"]

FaultKind = Literal["unreachable", "refused", "limited", "broken", "garbage"]
"""No answer; credentials or plan refused (401, 403); too many requests or quota used up (429);
the service's own fault (5xx); an answer that makes no sense."""


class ServiceFault(Exception):
    """The service did not do what it was asked.

    Attributes:
        kind: what went wrong, for the decision to try again.
        retry_s: when to, as the service asked (the Retry-After of a 429); None if it did not.
    """

    def __init__(self, kind: FaultKind, line: str, retry_s: float | None = None) -> None:
        super().__init__(line)
        self.kind = kind
        self.retry_s = retry_s

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.kind, str(self), self.retry_s)


@dataclass(frozen=True)
class JobView:
    """A job as the service sees it.

    Attributes:
        state: "lost" if the service does not know the job.
        reason: of a job that failed or was cancelled.
        usage_s: device time that it was charged, s; None while unknown.
        counts: shots by bit string (Qiskit's order: qubit 0 last); only of a job that is done.
    """

    state: JobState
    reason: str | None = None
    usage_s: float | None = None
    counts: Mapping[str, int] | None = None


class JobService(Protocol):
    """A device behind a queue. Every call may raise `ServiceFault`, and may hang."""

    @property
    def name(self) -> str:
        """Name of the device."""
        ...

    def estimate_s(self, circuit: Any, shots: int) -> float:
        """Device time that a job will be charged, s: an upper estimate."""
        ...

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """Where a chain lies on the device; see `Backend.place`."""
        ...

    def two_qubit(self, circuit: Any) -> tuple[int, int]:
        """Layers of two-qubit gates of a circuit as it will run, and their number."""
        ...

    def submit(self, circuit: Any, shots: int, tags: Sequence[str]) -> str:
        """Queue a measured circuit for this device; returns the job's id."""
        ...

    def look(self, job_id: str, *, samples: bool = True) -> JobView:
        """State of a job; with its counts once it is done, if ``samples`` are wanted."""
        ...

    def cancel(self, job_id: str) -> None:
        """Take a job out of the queue; one that is over stays as it is."""
        ...

    def find(self, tag: str) -> list[str]:
        """Ids of the jobs that carry a tag, latest first."""
        ...
