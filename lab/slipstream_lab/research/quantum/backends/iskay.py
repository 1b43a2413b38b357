"""Kipu Quantum's Iskay, an optimizer hosted behind Qiskit Functions (extra ``iskay``).

It returns one post-selected solution and no counts. The cost that it reports is not
used: the bits are checked, evaluated on the model and post-processed like any sample.
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from dispatcher_daemon.forms import Encoding, Problem, QuboModel, build_model
from dispatcher_daemon.solvers import Bits, Execution, Outcome, Status, answer
from dispatcher_daemon.solvers.quantum.backends import AccountAccess
from dispatcher_daemon.solvers.workers import error_line

log = logging.getLogger(__name__)

FUNCTION = "kipu-quantum/iskay-quantum-optimizer"
MAX_VARIABLES = 156
"""One qubit a variable, on devices of 156."""

_POLL_S = 5.0
_COST_TOLERANCE = 1e-3
_TERMINAL = {"DONE", "ERROR", "CANCELED"}

T = TypeVar("T")


class _ServiceError(Exception):
    """The service gave no usable answer; the message says why."""


class _DeadlineError(Exception):
    """The deadline passed first."""


def qubo_terms(model: QuboModel) -> dict[str, float]:
    """The QUBO as Iskay takes it: ``"()"``, ``"(i,)"`` and ``"(i, j)"``, i counting variables."""
    index = {variable: i for i, variable in enumerate(model.variables)}
    terms = {"()": float(model.total.offset)}
    for variable, bias in model.total.linear.items():
        terms[str((index[variable],))] = float(bias)
    for (u, v), bias in model.total.quadratic.items():
        terms[str(tuple(sorted((index[u], index[v]))))] = float(bias)
    return {key: value for key, value in terms.items() if value != 0}


def solution_bits(result: object, n: int) -> Bits:
    """The bits of a documented answer by variable, shape (1, n).

    ``solution`` holds 0 or 1 by variable's number; ``solution_info`` the measured ``bitstring``,
    whose bit b is variable ``mapping[b]``.

    Raises:
        ValueError: the answer is no such thing, or its parts contradict each other.
    """
    if not isinstance(result, Mapping) or not isinstance(result.get("solution"), Mapping):
        raise ValueError("the answer has no solution")
    values = {str(key): value for key, value in result["solution"].items()}
    # A variable that no term holds is free.
    unknown = values.keys() - {str(i) for i in range(n)}
    if unknown or not all(value in (0, 1) for value in values.values()):
        raise ValueError("its solution is not one of 0 and 1 by variable")
    bits = np.array([int(values.get(str(i), 0)) for i in range(n)], dtype=np.int8)
    info = result.get("solution_info")
    if not isinstance(info, Mapping):
        raise ValueError("it has no solution_info")
    string, mapping = info.get("bitstring"), info.get("mapping")
    if not isinstance(string, str) or set(string) - {"0", "1"} or len(string) != len(values):
        raise ValueError(f"its bit string does not fit its {len(values)} variables")
    if not isinstance(mapping, Mapping):
        raise ValueError("it has no mapping")
    mapped = {str(b): str(variable) for b, variable in mapping.items()}
    if sorted(mapped.values()) != sorted(values) or any(
        values[mapped[str(b)]] != int(bit) for b, bit in enumerate(string)
    ):
        raise ValueError("its bit string and its solution differ")
    if not values:
        raise ValueError("its solution is empty")
    return bits[None, :]


@dataclass(frozen=True)
class IskaySolver:
    """Iskay on an IBM device.

    A job takes minutes and is charged, so a late one is not cancelled; `Outcome.execution` has its
    id, and a solver with that ``job`` reads its answer.

    Attributes:
        access: credentials.
        device: IBM's name of the device.
        shots: of each of its iterations.
        iterations: of the bias field.
        job: id of an earlier job whose answer is read instead of a new one's.
        gamma: penalty weight of the QUBO, kWh; None: computed.
        encoding: of the arc form's subtour terms.
        catalog: opens the catalogue of functions; None: `qiskit_ibm_catalog`'s.
    """

    access: AccountAccess
    device: str
    shots: int = 10_000
    iterations: int = 10
    job: str | None = None
    gamma: float | None = None
    encoding: Encoding = "reduced"
    catalog: Callable[[AccountAccess], Any] | None = None
    poll_s: float = _POLL_S
    name: str = "iskay"

    def warm_up(self) -> None:
        """Import the client.

        Raises:
            ModuleNotFoundError: the extra is not installed.
        """
        if self.catalog is None:
            import qiskit_ibm_catalog  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`."""
        began = time.perf_counter()
        model = build_model(problem, self.gamma, encoding=self.encoding)
        n = len(model.variables)
        if not 0 < n <= MAX_VARIABLES:
            reason = f"Iskay takes 1 to {MAX_VARIABLES} variables, not {n}"
            return Outcome(self.name, "failed", None, time.perf_counter() - began, reason=reason)
        run = _Run(self, began + deadline_s)
        status: Status = "failed"
        try:
            result = run.result(qubo_terms(model), seed)
            bits = solution_bits(result, n)
        except _DeadlineError:
            status, reason = "timeout", f"no answer within {deadline_s:g} s"
            if run.job_id is not None:
                reason += f"; job {run.job_id} goes on, take it up with --job {run.job_id}"
        except _ServiceError as error:
            reason = str(error)
        except ValueError as error:
            reason = f"job {run.job_id}: {error}"
        else:
            self._compare_cost(model, bits, result)
            one = np.ones(1, dtype=np.int64)
            outcome = answer(self.name, model, bits, one, seed, began, qubits=n)
            # One post-selected solution says nothing of shares.
            return replace(outcome, samples=None, execution=self._execution(run))
        execution = self._execution(run) if run.job_id is not None else None
        wall_s = time.perf_counter() - began
        return Outcome(self.name, status, None, wall_s, reason=reason, execution=execution)

    def _execution(self, run: _Run) -> Execution:
        return Execution(
            backend=f"ibm:{self.device}",
            kind="hardware",
            variant="bf-dcqo",
            layers=0,
            two_qubit_depth=None,
            two_qubit_gates=None,
            train_s=0.0,
            sample_s=time.perf_counter() - run.began,
            job=run.job_id,
        )

    def _compare_cost(self, model: QuboModel, bits: Bits, result: Mapping[str, Any]) -> None:
        ours = float(model.total.energies((bits, list(model.variables)))[0])
        theirs = result["solution_info"].get("cost")
        if not isinstance(theirs, int | float) or not math.isclose(
            theirs, ours, rel_tol=_COST_TOLERANCE, abs_tol=_COST_TOLERANCE
        ):
            log.warning("iskay calls the cost of its solution %s, it is %.6f kWh", theirs, ours)


class _Run:
    """One job at the service; every call ends in time."""

    def __init__(self, solver: IskaySolver, ends: float) -> None:
        self.solver = solver
        self.ends = ends
        self.began = time.perf_counter()
        self.job_id: str | None = solver.job

    def result(self, terms: Mapping[str, float], seed: int) -> Any:
        """The answer of a new job, or of the one to take up.

        Raises:
            _DeadlineError: there is none in time.
            _ServiceError: there is none.
        """
        job = self._within(lambda: self._job(terms, seed))
        self.job_id = str(job.job_id)
        while (status := str(self._within(job.status))) not in _TERMINAL:
            left_s = self.ends - time.perf_counter()
            if left_s <= 0:
                raise _DeadlineError
            time.sleep(min(self.solver.poll_s, left_s))
        if status != "DONE":
            why = self._within(job.error_message) if status == "ERROR" else "cancelled"
            raise _ServiceError(self._clean(f"job {self.job_id}: {why or 'failed'}"))
        return self._within(lambda: job.result(wait=False))

    def _job(self, terms: Mapping[str, float], seed: int) -> Any:
        solver = self.solver
        catalog = (solver.catalog or _open_catalog)(solver.access)
        if solver.job is not None:
            return catalog.job(solver.job)
        function = catalog.load(FUNCTION)
        if function is None:
            raise LookupError(f"this account may not run {FUNCTION}")
        return function.run(
            problem=dict(terms),
            problem_type="binary",
            backend_name=solver.device,
            options={
                "shots": solver.shots,
                "num_iterations": solver.iterations,
                "seed_transpiler": seed % 2**31,
                "job_tags": ["slipstream"],
            },
        )

    def _within(self, call: Callable[[], T]) -> T:
        """Result of a call. It runs in a daemon thread, which is abandoned if it does not end."""
        done: queue.SimpleQueue[tuple[T | None, Exception | None]] = queue.SimpleQueue()

        def run() -> None:
            try:
                done.put((call(), None))
            except Exception as error:
                done.put((None, error))

        threading.Thread(target=run, name="iskay", daemon=True).start()
        try:
            value, error = done.get(timeout=max(0.0, self.ends - time.perf_counter()))
        except queue.Empty:
            raise _DeadlineError from None
        if error is not None:
            raise _ServiceError(self._clean(error_line(error)))
        return value  # type: ignore[return-value]

    def _clean(self, line: str) -> str:
        return " ".join(line.split())[:300].replace(self.solver.access.token, "***")


def _open_catalog(access: AccountAccess) -> Any:
    from qiskit_ibm_catalog import QiskitFunctionsCatalog

    instance = None if access.instance == "auto" else access.instance
    return QiskitFunctionsCatalog(token=access.token, instance=instance)
