"""The desk between a dispatch cycle and a quantum device: a `Solve` around the solver pool's.

The pool answers all jobs as ever, the device's own solver on a simulator; beside it the device is
asked. When the cycle goes on, the device's answer is taken if it is there, else the simulator's,
with the reason. Whatever the device does, the cycle goes on when the pool's answers are there and
the wait, which leaves a reserve for what comes after the solvers, is over.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

from dispatcher_daemon.hardware.clerk import Clerk
from dispatcher_daemon.hardware.making import meaning
from dispatcher_daemon.hardware.ticket import Ticket
from dispatcher_daemon.solvers.pool import RESERVE, Job, Solve
from dispatcher_daemon.solvers.protocol import Outcome
from slipstream.messages import HardwareHealth


class Desk:
    """A device as a guest; a context manager, and a `Solve`.

    Args:
        solve: the solver pool; must not be closed before the desk.
        clerk: deals with the service; started and stopped with the desk.
        wait_s: how long a cycle waits for the device when the pool is done, over all its calls.
        cycle_s: deadline of a cycle, from its beginning; waiting ends `RESERVE` of it before.
    """

    def __init__(
        self, solve: Solve, clerk: Clerk, wait_s: float, cycle_s: float = math.inf
    ) -> None:
        self._solve = solve
        self._clerk = clerk
        self._wait_s = wait_s
        self._patience_s = wait_s
        self._cycle_s = cycle_s
        self._waits_until = math.inf
        self._cycle = 0

    def begin_cycle(self, number: int) -> None:
        """Say which cycle, which begins now, the next calls belong to."""
        self._waits_until = time.monotonic() + (1 - RESERVE) * self._cycle_s
        self._cycle, self._patience_s = number, self._wait_s
        self._clerk.begin_cycle()

    def __call__(self, jobs: Sequence[Job], deadline_s: float) -> list[Outcome]:
        """See `Solve`."""
        began = time.monotonic()
        ends = min(began + deadline_s, self._waits_until)
        maker = self._clerk.maker
        tickets = {
            position: Ticket(
                job.problem, meaning(job.problem, maker.dialect), job.seed, self._cycle, ends
            )
            for position, job in enumerate(jobs)
            if job.solver == maker.name
        }
        self._clerk.take(tickets.values())
        outcomes = self._solve(jobs, deadline_s)
        for position, ticket in tickets.items():
            waiting = time.monotonic()
            ticket.wait(min(ends - waiting, self._patience_s))
            waited_s = time.monotonic() - waiting
            self._patience_s = max(0.0, self._patience_s - waited_s)
            answer, reason = ticket.close()
            if answer is not None:
                outcomes[position] = replace(answer, wall_s=time.monotonic() - began)
            else:
                outcomes[position] = _instead(outcomes[position], reason)
        return outcomes

    def health(self) -> HardwareHealth:
        """How it stands with the device."""
        return self._clerk.health()

    def close(self) -> None:
        """Stop asking; jobs at the service stay there and are found again."""
        self._clerk.close()

    def __enter__(self) -> Self:
        self._clerk.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _instead(outcome: Outcome, why: str) -> Outcome:
    """The simulator's outcome, with the reason why it is not the device's."""
    if outcome.execution is not None:
        outcome = replace(outcome, execution=replace(outcome.execution, fallback=why))
    if outcome.selected is None:
        said = f"{outcome.reason or outcome.status}; the device: {why}"
        outcome = replace(outcome, reason=said)
    return outcome
