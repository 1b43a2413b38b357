"""Solution files of published sets: what they cost, and by which distances they count.

The same set is published with costs of rounded and of exact distances: Solomon's with those cut to
tenths and with double precision, CVRPLIB's rounded to whole numbers, but not those of Christofides,
Mingozzi and Toth or of Golden. A solution's own routes tell which.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, get_args

from slipstream.errors import InputError
from slipstream_lab.research.instances.matrices.instance import MatrixInstance, matrix_instance_from
from slipstream_lab.research.instances.matrices.schema import Rounding
from slipstream_lab.research.instances.matrices.set_files import number_in, set_text

_ROUTE: Final = re.compile(r"route\s*#?\s*\d+\s*:(.*)", re.IGNORECASE)
_WORDS: Final[dict[Rounding, str]] = {
    "none": "distances as they are",
    "nearest": "distances rounded to whole numbers",
    "tenths": "distances cut to tenths",
}
_LEAST: Final = 1e-6


@dataclass(frozen=True)
class Solution:
    """A solution file. `routes`: customers in their order, the first after the depot being 1;
    none: not given.
    """

    cost: float
    decimals: int
    routes: Sequence[Sequence[int]]


def read_solution(path: Path) -> Solution:
    """Read a solution in CVRPLIB's format. Raises InputError: no cost, two, or something that is
    no number.
    """
    cost: tuple[float, int] | None = None
    routes: list[list[int]] = []
    for number, line in enumerate(set_text(path).split("\n"), 1):
        words = line.replace(":", " ").split()
        route = _ROUTE.match(line.strip())
        if route is not None:
            found = [number_in(word, path, number) for word in route[1].split()]
            if not all(customer.is_integer() and customer >= 0 for customer in found):
                problem = "not the numbers of customers"
                raise InputError(path, problem, "mend it", key=f"line {number}")
            routes.append([int(customer) for customer in found])
        elif len(words) == 2 and words[0].lower() == "cost":
            if cost is not None:
                raise InputError(path, "two costs", "remove one", key=f"line {number}")
            digits = words[1].partition(".")[2]
            decimals = len(digits) if digits.isdecimal() else 0
            cost = number_in(words[1], path, number), decimals
    if cost is None:
        raise InputError(path, "no line 'Cost ...'", "give a solution file of CVRPLIB")
    return Solution(*cost, routes)


def with_best_known(data: dict[str, Any], instance: MatrixInstance, path: Path) -> MatrixInstance:
    """The instance with the cost of a solution file, by the distances that the solution counts.

    Where these are no distances of the instance, the cost is not comparable, and says why.
    """
    solution = read_solution(path)
    rounding, comparable, note = _counted(data, instance, solution)
    if rounding is not None:
        data = {**data, "matrix": {**data["matrix"], "euclidean": rounding}}
    best = {"cost": solution.cost, "source": path.name[:200]}
    data = {**data, "best_known": {**best, "comparable": comparable, "note": note}}
    return matrix_instance_from(data, instance.name)


def _counted(
    data: dict[str, Any], instance: MatrixInstance, solution: Solution
) -> tuple[Rounding | None, bool, str]:
    """(how distances are rounded; whether costs compare; how that is known)."""
    own: Rounding | None = instance.file.matrix.euclidean
    customers = sorted(instance.fleet.stop_by_id, key=int)
    served = sorted(customer for route in solution.routes for customer in route)
    if served != list(range(1, len(customers) + 1)):
        whole = {"nearest": 0, "tenths": 1}.get(own or "none")
        if whole is not None and solution.decimals > whole:
            return own, False, f"it has more decimals than {_WORDS[own or 'none']} add up to"
        return own, True, "not checked: the file does not list the routes of all customers"
    routes = [[customers[customer - 1] for customer in route] for route in solution.routes]
    first: tuple[Rounding | None, ...] = (own,)
    others = () if own is None else tuple(r for r in get_args(Rounding) if r != own)
    costs: dict[Rounding | None, float] = {}
    for rounding in (*first, *others):
        costs[rounding] = _cost(data, instance, rounding, routes)
        if abs(costs[rounding] - solution.cost) <= 0.5 * 10**-solution.decimals + _LEAST:
            word = "its distances" if rounding is None else _WORDS[rounding]
            return rounding, True, f"its routes cost it by {word}"
    return own, False, f"its routes cost {costs[own]:.10g} by the instance's distances"


def _cost(
    data: dict[str, Any],
    instance: MatrixInstance,
    rounding: Rounding | None,
    routes: Sequence[Sequence[str]],
) -> float:
    if rounding != instance.file.matrix.euclidean:
        data = {**data, "matrix": {**data["matrix"], "euclidean": rounding}}
        instance = matrix_instance_from(data, instance.name)
    depot = instance.fleet.depots[0].id
    of, row = instance.measures["distance"], instance.row
    return sum(
        float(of[row[a], row[b]]) for route in routes for a, b in pairwise((depot, *route, depot))
    )
