"""Tasks and vehicles of a request in whole numbers: times in hundredths of a second, costs so that
an hour at a price of one an hour is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.service.vroom.schema import (
    Coordinates,
    Request,
    TaskStep,
    VroomBreak,
    VroomVehicle,
)

Ints = npt.NDArray[np.int64]
Windows = tuple[tuple[int, int], ...]
"""(first, last) start, hundredths of a second, in order."""
Kind = Literal["job", "pickup", "delivery"]

PER_SECOND: Final = 100
COST_UNITS: Final = 3600 * PER_SECOND
"""Internal cost of one unit of cost in the answer."""
NO_WAY: Final = 2**50
"""Time and distance where no road leads; more than any sum of others."""
FOREVER: Final = 2**40
"""The end of a window that has none."""


@dataclass(frozen=True)
class Matrices:
    """Ways between places, (from, to), shape (n, n) each; -1 where none leads.

    Attributes:
        distances: m; None: not known.
        costs: instead of what time and distance cost; None: none are given.
    """

    durations: Ints
    distances: Ints | None = None
    costs: Ints | None = None


@dataclass(frozen=True)
class VroomVisit:
    """A job, or one step of a shipment.

    Attributes:
        place: row in the matrices.
        delivery: taken off the vehicle there; a job's is loaded at the vehicle's start.
        pickup: put on the vehicle there; a job's stays to the end.
        partner: number of the shipment's other step; None: a job.
    """

    number: int
    kind: Kind
    step: TaskStep
    place: int
    windows: Windows
    delivery: tuple[int, ...]
    pickup: tuple[int, ...]
    skills: frozenset[int]
    priority: int
    partner: int | None = None

    @property
    def key(self) -> str:
        """Its place in the request."""
        return f"{self.kind} {self.step.id}"


@dataclass(frozen=True)
class VroomPause:
    """A break."""

    spec: VroomBreak
    windows: Windows
    service: int

    def fits(self, load: Sequence[int]) -> bool:
        """Whether it can happen with a load."""
        most = self.spec.max_load
        return most is None or all(a <= b for a, b in zip(load, most, strict=True))


@dataclass(frozen=True, eq=False)
class VroomWays:
    """Travel of vehicles of one profile, speed and price.

    Attributes:
        duration: hundredths of a second, by from and to.
    """

    duration: Sequence[Sequence[int]]
    distance: Sequence[Sequence[int]] | None
    cost: Sequence[Sequence[int]]


@dataclass(frozen=True, eq=False)
class Van:
    """A vehicle with its ways.

    Attributes:
        start: row in the matrices; None: it starts at its first task.
        end: likewise.
        pauses: in the order of their first windows.
    """

    number: int
    spec: VroomVehicle
    ways: VroomWays
    start: int | None
    end: int | None
    window: tuple[int, int]
    pauses: tuple[VroomPause, ...]
    skills: frozenset[int]
    actions: dict[int, tuple[int, int]] = field(default_factory=dict)

    @cached_property
    def kind(self) -> object:
        """Equal for vehicles that differ in nothing but their names."""
        spec = self.spec.model_copy(update={"id": 0, "description": None, "steps": ()})
        return spec.model_dump_json(), self.start, self.end

    def action(self, task: VroomVisit) -> tuple[int, int]:
        """(setup, service) of a task with this vehicle."""
        known = self.actions.get(task.number)
        if known is None:
            step, kind = task.step, self.spec.type
            known = (
                PER_SECOND * step.setup_per_type.get(kind, step.setup),
                PER_SECOND * step.service_per_type.get(kind, step.service),
            )
            self.actions[task.number] = known
        return known


@dataclass(frozen=True)
class VroomProblem:
    """A request with its matrices."""

    request: Request
    tasks: tuple[VroomVisit, ...]
    vans: tuple[Van, ...]
    coordinates: tuple[Coordinates | None, ...]
    by_profile: Mapping[str, Matrices]

    @property
    def amounts(self) -> int:
        """Components of loads."""
        return len(self.request.vehicles[0].capacity)

    @property
    def has_distances(self) -> bool:
        """Whether distances are known of all profiles."""
        return all(of.distances is not None for of in self.by_profile.values())
