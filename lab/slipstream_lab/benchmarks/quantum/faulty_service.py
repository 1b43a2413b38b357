"""A simulated device service with injected faults of all known kinds, by seed.

The service's side is a file, so that its jobs and its records go on when whoever calls is killed.
"""

from __future__ import annotations

import json
import os
import random
import sqlite3
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from dispatcher_daemon.solvers.quantum.backends import JobView, ServiceFault
from dispatcher_daemon.solvers.quantum.chain import QubitPlacement
from dispatcher_daemon.solvers.quantum.hardware import ServiceFactory

Weights = Mapping[str, float]

SUBMIT: Final = (
    "ok",
    "unreachable",
    "401",
    "429",
    "500",
    "502 but taken",
    "hangs",
    "hangs but taken",
    "dies but taken",
    "no id but taken",
)
"""Outcomes of a submission."""

JOB: Final = (
    "ok",
    "late",
    "never",
    "fails",
    "lost",
    "usage unknown",
    "wrong width",
    "wrong total",
    "not binary",
    "no samples",
    "no view",
)
"""Outcomes of an accepted job."""

CALL: Final = ("ok", "unreachable", "401", "429", "500", "hangs", "dies")
"""Outcomes of any other call."""

EVERYTHING: Final[dict[str, dict[str, float]]] = {
    "submit": dict.fromkeys(SUBMIT, 1.0) | {"ok": 24.0, "401": 0.5, "hangs": 0.5},
    "job": dict.fromkeys(JOB, 1.0) | {"ok": 24.0, "late": 4.0, "no view": 0.3},
    "call": dict.fromkeys(CALL, 1.0)
    | {"ok": 100.0, "401": 0.2, "429": 0.5, "hangs": 0.7, "dies": 0.7},
}
"""Weights of all outcomes; the faultless ones are the most frequent."""

ESTIMATE_S: Final = 2.0
"""Estimated device time of each job, an upper bound, s."""

_LATE_S: Final = (1.0, 4.0)
_HANG_S: Final = 600.0


class ServiceRecords:
    """The service's records: jobs, outcomes and charges.

    Args:
        path: a file, made if it is not there.
        seed: of all that happens.
        weights: of what may happen, by kind of event; events not named go well.
        queue_s: shortest and longest time from submitting a job to its answer.
    """

    def __init__(
        self,
        path: Path,
        seed: int = 1,
        weights: Mapping[str, Weights] | None = None,
        queue_s: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.path = path
        with _writing(path) as connection:
            connection.execute("CREATE TABLE IF NOT EXISTS about (name PRIMARY KEY, value)")
            connection.execute("CREATE TABLE IF NOT EXISTS seen (what, number)")
            connection.execute(
                "CREATE TABLE IF NOT EXISTS jobs (id PRIMARY KEY, tag, fate, width, shots, "
                "submitted, ready, usage, cancelled)"
            )
            for name, value in (("seed", seed), ("calls", 0), ("queue_s", queue_s)):
                connection.execute(
                    "INSERT OR IGNORE INTO about VALUES (?, ?)", (name, json.dumps(value))
                )
        self.expect(weights or {})

    def expect(self, weights: Mapping[str, Weights]) -> None:
        """Change what may happen from now on."""
        with _writing(self.path) as connection:
            connection.execute(
                "INSERT OR REPLACE INTO about VALUES ('weights', ?)",
                (json.dumps({kind: dict(of_one) for kind, of_one in weights.items()}),),
            )

    def jobs(self) -> list[dict[str, Any]]:
        """All jobs ever taken, oldest first."""
        with _writing(self.path) as connection:
            rows = connection.execute("SELECT * FROM jobs ORDER BY submitted").fetchall()
        return [dict(row) for row in rows]

    def happened(self) -> Counter[str]:
        """How often each event happened, as "kind: event"."""
        with _writing(self.path) as connection:
            rows = connection.execute("SELECT what, count(*) FROM seen GROUP BY what").fetchall()
        return Counter({str(what): int(number) for what, number in rows})

    def charges(self, now: float) -> list[tuple[float, float]]:
        """(UTC s, device time in s) of each charge up to now, in order."""
        return sorted(
            (job["ready"], job["usage"])
            for job in self.jobs()
            if job["ready"] <= now and not (job["cancelled"] or job["fate"] == "never")
        )

    def max_in_a_day_s(self, now: float, day_s: float) -> float:
        """Most that was charged in any window of that length, s."""
        charges = self.charges(now)
        return max(
            (sum(u for t, u in charges if begin <= t < begin + day_s) for begin, _ in charges),
            default=0.0,
        )


def pid_file(path: Path) -> Path:
    """Where the process that opened the service of these records last says its number."""
    return path.with_suffix(".pid")


@dataclass(frozen=True)
class FaultyServiceFactory(ServiceFactory):
    """Opens the service of the `ServiceRecords` at a path, in whatever process."""

    def __call__(self) -> FaultyService:
        """Never fails; says which process it is in."""
        pid_file(Path(self.backend)).write_text(str(os.getpid()), encoding="utf-8")
        return FaultyService(Path(self.backend))


class FaultyService:
    """See `dispatcher_daemon.solvers.quantum.backends.jobs.JobService`."""

    def __init__(self, path: Path) -> None:
        self._path = path

    @property
    def name(self) -> str:
        """Of the device."""
        return "faulty"

    def estimate_s(self, circuit: Any, shots: int) -> float:
        """No job is ever charged more."""
        return ESTIMATE_S

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """A device of one row."""
        return QubitPlacement(tuple(range(n)), (), 1.0)

    def two_qubit(self, circuit: Any) -> tuple[int, int]:
        """Arbitrary depth and number of two-qubit gates."""
        return 4, 2 * (_width(circuit) - 1)

    def submit(self, circuit: Any, shots: int, tags: Sequence[str]) -> str:
        """Submit a job; by the drawn outcome it is accepted, refused, or accepted with an error."""
        with _writing(self._path) as connection:
            event, rng = _draw(connection, "submit")
            job_id = f"job-{_number(connection)}"
            if event == "ok" or event.endswith("but taken"):
                fate, _ = _draw(connection, "job")
                now = time.time()
                low, high = json.loads(_about(connection, "queue_s"))
                wait_s = rng.uniform(low, high)
                if fate == "late":
                    wait_s += rng.uniform(*_LATE_S)
                elif fate == "never":
                    wait_s = _HANG_S
                usage = ESTIMATE_S * rng.uniform(0.3, 1.0)
                connection.execute(
                    "INSERT INTO jobs VALUES (?, ?, ?, ?, ?, ?, ?, ?, NULL)",
                    (job_id, tags[0], fate, _width(circuit), shots, now, now + wait_s, usage),
                )
        _raise_fault(event, rng)
        return "" if event == "no id but taken" else job_id

    def look(self, job_id: str, *, samples: bool = True) -> JobView:
        """State of a job."""
        self._call()
        with _writing(self._path) as connection:
            job = connection.execute("SELECT * FROM jobs WHERE id = ?", (job_id,)).fetchone()
            seed = _about(connection, "seed")
        if job is None or job["fate"] == "lost":
            return JobView("lost")
        now, fate = time.time(), job["fate"]
        if fate == "no view":
            return {"status": "Completed"}  # type: ignore[return-value]
        if job["cancelled"]:
            return JobView("cancelled", "cancelled by its owner", usage_s=0.0)
        if now < job["ready"]:
            return JobView("queued")
        if fate == "fails":
            return JobView("failed", "qubit 7 is\nout of order", usage_s=job["usage"])
        unknown = fate == "usage unknown" and now < job["ready"] + 1.0
        usage_s = None if unknown else job["usage"]
        if not samples:
            return JobView("done", usage_s=usage_s)
        drawn = _samples(job["width"], job["shots"], random.Random(f"{seed} {job_id}"))
        return JobView("done", usage_s=usage_s, counts=_corrupted(drawn, fate))

    def cancel(self, job_id: str) -> None:
        """Take a job out of the queue, if it still is in it."""
        self._call()
        with _writing(self._path) as connection:
            connection.execute(
                "UPDATE jobs SET cancelled = ? WHERE id = ? AND ready > ?",
                (time.time(), job_id, time.time()),
            )

    def find(self, tag: str) -> list[str]:
        """Ids by tag."""
        self._call()
        with _writing(self._path) as connection:
            rows = connection.execute(
                "SELECT id FROM jobs WHERE tag = ? AND fate != 'lost'", (tag,)
            ).fetchall()
        return [row["id"] for row in rows]

    def _call(self) -> None:
        with _writing(self._path) as connection:
            event, rng = _draw(connection, "call")
        _raise_fault(event, rng)


def _raise_fault(event: str, rng: random.Random) -> None:
    if event.startswith("hangs"):
        time.sleep(_HANG_S)
    if event.startswith("dies"):
        os._exit(3)
    if event == "unreachable":
        raise ServiceFault("unreachable", "connection reset by peer")
    if event == "401":
        raise ServiceFault("refused", "401: credentials refused")
    if event == "429":
        raise ServiceFault("limited", "429: too many requests", retry_s=rng.uniform(0.1, 0.5))
    if event.startswith("50"):
        raise ServiceFault("broken", f"{event[:3]}: the service's own fault")


def _samples(width: int, shots: int, rng: random.Random) -> dict[str, int]:
    return dict(Counter(format(rng.getrandbits(width), f"0{width}b") for _ in range(shots)))


def _corrupted(samples: dict[str, int], fate: str) -> dict[str, int] | None:
    if fate == "no samples":
        return None
    first = next(iter(samples))
    if fate == "wrong width":
        return {string + "0": number for string, number in samples.items()}
    if fate == "wrong total":
        return {string: number for string, number in samples.items() if string != first}
    if fate == "not binary":
        return {string.replace("1", "2"): number for string, number in samples.items()}
    return samples


def _width(circuit: Any) -> int:
    return int(circuit.width if hasattr(circuit, "fields") else circuit.num_qubits)


def _draw(connection: sqlite3.Connection, kind: str) -> tuple[str, random.Random]:
    """The drawn outcome, and a random generator for its details."""
    rng = random.Random(f"{_about(connection, 'seed')} {kind} {_number(connection)}")
    weights = json.loads(_about(connection, "weights")).get(kind) or {"ok": 1.0}
    event = rng.choices(list(weights), list(weights.values()))[0]
    connection.execute("INSERT INTO seen VALUES (?, 1)", (f"{kind}: {event}",))
    return event, rng


def _number(connection: sqlite3.Connection) -> int:
    connection.execute("UPDATE about SET value = value + 1 WHERE name = 'calls'")
    return int(_about(connection, "calls"))


def _about(connection: sqlite3.Connection, name: str) -> str:
    return str(
        connection.execute("SELECT value FROM about WHERE name = ?", (name,)).fetchone()["value"]
    )


@contextmanager
def _writing(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(path, timeout=30.0, isolation_level=None)) as connection:
        connection.row_factory = sqlite3.Row
        # What it holds need not survive a power cut, and each call of the service writes.
        connection.execute("PRAGMA synchronous=OFF")
        connection.execute("BEGIN IMMEDIATE")
        try:
            yield connection
            connection.execute("COMMIT")
        except BaseException:
            connection.execute("ROLLBACK")
            raise
