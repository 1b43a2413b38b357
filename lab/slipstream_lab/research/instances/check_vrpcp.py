"""Checks a solution of vehicle routing with cooperative platooning (TYPE VRPCP), by itself.

    python check_vrpcp.py INSTANCE.vrpcp SOLUTION.sol

Needs Python 3.10 and nothing else. Prints ``valid: objective N kWh`` with exit status 0,
``invalid:`` and the rule that is broken with 1, or what is wrong with the instance file with 2.

An instance names its places (0 is the depot), vehicles (from 1), the arcs that each vehicle may
drive with their costs, and pairs of arcs of two vehicles that save energy if both are driven. A
solution has a line ``Route #k: c1 c2 ...`` for each vehicle k and ``Cost N``. It is valid if each
vehicle drives one closed tour over at least one customer by its own arcs, each customer is on one
route once, and the cost is the sum of the arcs less the savings of pairs.
"""

import math
import re
import sys

TOLERANCE = 1e-6
"""Of the stated cost, kWh: as many digits as solutions should have."""

_COLUMNS = {
    "PLACE_SECTION": 2,
    "VEHICLE_SECTION": 2,
    "ARC_SECTION": 5,
    "PLATOON_SECTION": 3,
}


class BadInstance(ValueError):
    """An instance file that cannot be read."""


class Invalid(ValueError):
    """A solution that breaks a rule."""


class VrpcpInstance:
    """What an instance file holds. `arcs`: (number, cost in kWh) by vehicle, start and end."""

    def __init__(self, text: str) -> None:
        """Read the text of a file. Raises BadInstance: with what is wrong."""
        given, rows = _sections(text)
        if given.get("TYPE") != "VRPCP":
            raise BadInstance("TYPE is not VRPCP")
        places = [_whole(row[0]) for row in rows["PLACE_SECTION"]]
        vehicles = [_whole(row[0]) for row in rows["VEHICLE_SECTION"]]
        if places != list(range(len(places))) or vehicles != list(range(1, len(vehicles) + 1)):
            raise BadInstance("places are numbered from 0 on, vehicles from 1 on, in order")
        if len(places) < 2 or not vehicles:
            raise BadInstance("no customer or no vehicle")
        self.customers = len(places) - 1
        self.vehicles = len(vehicles)
        self.arcs: dict[tuple[int, int, int], tuple[int, float]] = {}
        for number, row in enumerate(rows["ARC_SECTION"], 1):
            stated, vehicle, start, end = (_whole(word) for word in row[:4])
            if stated != number:
                raise BadInstance(f"arc {number} has the number {stated}")
            if not 1 <= vehicle <= self.vehicles or start == end:
                raise BadInstance(f"arc {number} has no vehicle, or ends where it starts")
            if max(start, end) > self.customers or (vehicle, start, end) in self.arcs:
                raise BadInstance(f"arc {number} has an unknown place, or is listed twice")
            self.arcs[vehicle, start, end] = (number, _number(row[4]))
        owner = {number: vehicle for (vehicle, _, _), (number, _) in self.arcs.items()}
        self.savings: dict[tuple[int, int], float] = {}
        for row in rows["PLATOON_SECTION"]:
            pair = (_whole(row[0]), _whole(row[1]))
            if not 1 <= pair[0] < pair[1] <= len(owner) or pair in self.savings:
                raise BadInstance(f"pair {pair} has an unknown arc, or is listed twice")
            if owner[pair[0]] == owner[pair[1]]:
                raise BadInstance(f"pair {pair} is of one vehicle")
            self.savings[pair] = _number(row[2])
        for key, count in (
            ("DIMENSION", len(places)),
            ("VEHICLES", len(vehicles)),
            ("ARCS", len(owner)),
            ("PAIRS", len(self.savings)),
        ):
            if given.get(key) != str(count):
                raise BadInstance(f"{key} is {given.get(key)}, the sections have {count}")

    def objective(self, routes: dict[int, list[int]]) -> float:
        """The objective in kWh of routes by vehicle. Raises Invalid: with the rule that they
        break.
        """
        for vehicle in range(1, self.vehicles + 1):
            if not routes.get(vehicle):
                raise Invalid(f"vehicle {vehicle} has no route over a customer")
        unknown = set(routes) - set(range(1, self.vehicles + 1))
        if unknown:
            raise Invalid(f"there is no vehicle {min(unknown)}")
        visits = sorted(stop for stops in routes.values() for stop in stops)
        for customer in range(1, self.customers + 1):
            if visits.count(customer) != 1:
                raise Invalid(f"customer {customer} is visited {visits.count(customer)} times")
        if len(visits) != self.customers:
            raise Invalid("a place is visited that is no customer")
        driven: set[int] = set()
        costs: list[float] = []
        for vehicle, stops in routes.items():
            for start, end in zip([0, *stops], [*stops, 0], strict=True):
                if (vehicle, start, end) not in self.arcs:
                    raise Invalid(f"vehicle {vehicle} has no arc from {start} to {end}")
                number, cost = self.arcs[vehicle, start, end]
                driven.add(number)
                costs.append(cost)
        saved = [s for (a, b), s in self.savings.items() if a in driven and b in driven]
        return math.fsum(costs) - math.fsum(saved)


def check_solution(instance: VrpcpInstance, text: str) -> float:
    """The objective in kWh of a solution file's text. Raises Invalid: with the rule that it
    breaks.
    """
    routes: dict[int, list[int]] = {}
    cost = None
    for number, line in enumerate(text.splitlines(), 1):
        route = re.fullmatch(r"Route #([0-9]{1,9}):((?: +[0-9]{1,9})*) *", line)
        stated = re.fullmatch(r"Cost:? +(\S+) *", line)
        if route:
            vehicle = int(route[1])
            if vehicle in routes:
                raise Invalid(f"line {number}: a second route of vehicle {vehicle}")
            routes[vehicle] = [int(word) for word in route[2].split()]
        elif stated:
            if cost is not None:
                raise Invalid(f"line {number}: a second cost")
            try:
                cost = _number(stated[1])
            except BadInstance as error:
                raise Invalid(f"line {number}: {error}") from None
        elif line.strip():
            raise Invalid(f"line {number} is neither 'Route #k: ...' nor 'Cost N'")
    objective = instance.objective(routes)
    if cost is None:
        raise Invalid("no line 'Cost N'")
    if abs(cost - objective) > TOLERANCE:
        raise Invalid(f"the stated cost is {cost!r}, that of the routes {objective!r}")
    return objective


def _sections(text: str) -> tuple[dict[str, str], dict[str, list[list[str]]]]:
    given: dict[str, str] = {}
    rows: dict[str, list[list[str]]] = {name: [] for name in _COLUMNS}
    section = None
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if line == "EOF":
            return given, rows
        if line in rows:
            section = line
        elif section is None and line:
            key, colon, value = line.partition(":")
            if not colon or key.strip() in given:
                raise BadInstance(f"line {number} is no 'KEY : value', or a second one")
            given[key.strip()] = value.strip()
        elif section is not None and line:
            words = line.split(None, _COLUMNS[section] - 1)
            if len(words) != _COLUMNS[section]:
                raise BadInstance(f"line {number} has not {_COLUMNS[section]} columns")
            rows[section].append(words)
    raise BadInstance("no line EOF: the file is cut off")


def _whole(word: str) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", word):
        raise BadInstance(f"{word!r} is no whole number")
    return int(word)


def _number(word: str) -> float:
    if not re.fullmatch(r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]{1,3})?", word):
        raise BadInstance(f"{word!r} is no number")
    value = float(word)
    if not math.isfinite(value):
        raise BadInstance(f"{word!r} is too large")
    return value


def main(arguments: list[str]) -> int:
    """Check one solution; the exit status."""
    if len(arguments) != 2:
        print("usage: python check_vrpcp.py INSTANCE.vrpcp SOLUTION.sol", file=sys.stderr)
        return 2
    texts = []
    for path in arguments:
        try:
            with open(path, encoding="utf-8-sig") as file:
                texts.append(file.read())
        except (OSError, UnicodeDecodeError) as error:
            print(f"{path}: {error}", file=sys.stderr)
            return 2
    try:
        objective = check_solution(VrpcpInstance(texts[0]), texts[1])
    except BadInstance as error:
        print(f"{arguments[0]}: {error}", file=sys.stderr)
        return 2
    except Invalid as error:
        print(f"invalid: {error}")
        return 1
    print(f"valid: objective {objective:.9f} kWh")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
