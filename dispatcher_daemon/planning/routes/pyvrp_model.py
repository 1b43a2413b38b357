"""Translation of a vehicle routing problem to PyVRP's data, and of its solutions back.

PyVRP's data are integers: energies in mWh, times in tenths of a second, rounded so that a plan that
is feasible there is feasible here. Stops that only some vehicles may serve are a load that only
these can take.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyvrp

from dispatcher_daemon.fleet import Stop, Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import Ways
from dispatcher_daemon.planning.roads.charge import battery_of, leg_energy_kwh
from slipstream.vehicle_types import RoutingProfile

MWH_PER_KWH = 1e6
_TENTHS = 10.0
NO_PATH_MWH = 10**12
"""Cost of a path that does not exist: 1 GWh, more than any whole plan."""
_PRIZE_MWH = 10**8
"""Cost of an unserved stop where not all can be served: 100 kWh, more than any detour."""
_NO_LIMIT_TENTHS = 10**9
_UNITS_PER_KG = 1000
_UNITS_PER_STOP = 100
"""Of such a load: penalties count by unit, and no detour may be worth a stop of other vehicles."""
_SAMPLED_LEGS = 50
_ANY = ""
"""Name of vehicles that differ in nothing else; no vehicle has it."""

StopsByVehicle = dict[str, tuple[str, ...]]
"""Stops in order by vehicle."""
Visits = list[tuple[int, list[int]]]
"""(vehicle type, clients in order) of each route in PyVRP's numbers."""


class VrpModel:
    """The translation of one problem to PyVRP and back."""

    def __init__(
        self,
        problem: RoutingProblem,
        travel: Ways,
        vehicles: Sequence[Vehicle],
        stops: Sequence[str],
    ) -> None:
        fleet = problem.fleet
        served = set(stops)
        self._problem, self._travel = problem, travel
        own = [fleet.stop_by_id[name] for name in stops]
        # Number of each vehicle that some stop is kept for.
        named = dict.fromkeys(stop.vehicle for stop in own if stop.vehicle is not None)
        self._kept = {name: number for number, name in enumerate(named)}
        self._bits = range(max(1, (len(named) - 1).bit_length()) if named else 0)
        kinds: dict[Vehicle, list[Vehicle]] = defaultdict(list)
        for vehicle in vehicles:
            if vehicle.first_stop is None:
                changes = {"depot": self._depot(vehicle)}
                if vehicle.id not in self._kept:
                    changes["id"] = _ANY
                kinds[vehicle.model_copy(update=changes)].append(vehicle)
            elif vehicle.first_stop in served:
                kinds[vehicle].append(vehicle)
        self._kinds = list(kinds.items())
        first = {v.first_stop for v in fleet.vehicles}
        self._pooled = [name for name in stops if name not in first]
        # Clients are the starts of vehicles with a first stop, then the pooled stops.
        self._starts = [kind for kind in kinds if kind.first_stop is not None]
        self._fleet = fleet
        self._vehicles = vehicles
        self._masses = any(stop.mass_kg > 0 for stop in own)
        # One stop of each requirement that some vehicle here does not meet.
        self._restricted = {
            requirement: stop
            for requirement, stop in {
                stop.requirement: stop.model_copy(update={"vehicle": None}) for stop in own
            }.items()
            if not all(fleet.may_serve(kind, stop) for kind in kinds)
        }
        nothing = [0] * (1 + self._masses + len(self._restricted) + 2 * len(self._bits))
        every = [nothing, *(self._load(stop) for stop in own)]
        self._unlimited = [sum(loads) for loads in zip(*every, strict=True)]
        profiles = [problem.profile_of(kind) for kind in kinds]
        self._profiles = list(dict.fromkeys(profiles))

    def _depot(self, vehicle: Vehicle) -> str:
        return self._problem.fleet.depot_of(vehicle).id

    def _begin(self, kind: Vehicle) -> tuple[str, float, list[int]]:
        """(place, earliest departure, load delivered before): the depot, or the first stop."""
        depot = self._depot(kind)
        if kind.first_stop is None:
            return depot, kind.ready_s, [0] * len(self._unlimited)
        stop = self._fleet.stop_by_id[kind.first_stop]
        travel = self._travel.of(kind)
        driven_s = travel.duration_s[travel.row[depot], travel.row[stop.id]]
        begins = max(kind.ready_s + driven_s, stop.earliest_s)
        return stop.id, begins + stop.service_s, self._load(stop)

    def demand_exceeds_capacity(self) -> bool:
        """True if the stops' demand or mass cannot be carried by all vehicles together."""
        needed = np.sum([self._load(self._fleet.stop_by_id[s]) for s in self._pooled], axis=0)
        free = np.sum([len(of) * np.array(self._free(kind)) for kind, of in self._kinds], axis=0)
        return bool(np.any(needed > free))

    def _load(self, stop: Stop) -> list[int]:
        """Demand of a stop, its mass if any stop has one, what it asks for, and for whom it is."""
        mass = [math.ceil(stop.mass_kg * _UNITS_PER_KG)] if self._masses else []
        return [
            stop.demand,
            *mass,
            *(_UNITS_PER_STOP * (stop.requirement == r) for r in self._restricted),
            *(_UNITS_PER_STOP * may for may in self._number_bits(stop.vehicle)),
        ]

    def _number_bits(self, vehicle: str | None) -> list[bool]:
        """Two loads for each binary digit of a vehicle's number, one for its 0 and one for its 1:
        fewer than one for each vehicle, as each load costs the search time. Only what has the same
        number has room for all of them; who has no number has room for none.
        """
        number = None if vehicle is None else self._kept.get(vehicle)
        return [
            number is not None and (number >> bit) % 2 == digit
            for bit in self._bits
            for digit in (0, 1)
        ]

    def _free(self, kind: Vehicle) -> list[int]:
        """What a vehicle can take beside its first stop, in the units of `_load`."""
        limits = [kind.capacity]
        if self._masses:
            of = self._fleet.type_of(kind)
            payload_kg = None if of is None else of.payload_kg
            limits.append(None if payload_kg is None else math.floor(payload_kg * _UNITS_PER_KG))
        may = (self._fleet.may_serve(kind, stop) for stop in self._restricted.values())
        limits += [None if yes else 0 for yes in (*may, *self._number_bits(kind.id))]
        loaded = self._begin(kind)[2]
        return [
            # More than all stops together: no limit.
            self._unlimited[i] if limit is None else max(0, limit - loaded[i])
            for i, limit in enumerate(limits)
        ]

    def data(self, required: bool) -> pyvrp.ProblemData:
        """The problem in PyVRP's terms.

        A vehicle with a first stop starts there, when it has served it. It cannot stay idle: a
        client that only its start leads to, at the same place, makes it drive.
        """
        depots, junctions = self._depots(), self._junctions()
        starts = len(depots) + len(junctions)
        matrices = [self._matrices(profile, depots, junctions) for profile in self._profiles]
        at = {place: i for i, place in enumerate(depots)}
        for distance, _ in matrices:
            for number, kind in enumerate(self._starts, starts):
                distance[:, number] = NO_PATH_MWH
                distance[at[self._begin(kind)[0]], number] = 0
            np.fill_diagonal(distance, 0)
        row = self._travel.row
        location = {junction: i for i, junction in enumerate(junctions, len(depots))}
        return pyvrp.ProblemData(
            locations=[pyvrp.Location(0, 0)] * (starts + len(self._starts)),
            clients=[
                *(
                    pyvrp.Client(location=starts + i, delivery=[0] * len(self._unlimited))
                    for i in range(len(self._starts))
                ),
                *(self._client(name, location[row[name]], required) for name in self._pooled),
            ],
            depots=[pyvrp.Depot(location=i) for i in range(len(depots))],
            vehicle_types=[self._vehicle_type(kind, len(of), at) for kind, of in self._kinds],
            distance_matrices=[distance for distance, _ in matrices],
            duration_matrices=[tenths for _, tenths in matrices],
        )

    def _matrices(
        self, profile: RoutingProfile, depots: Sequence[str], junctions: Sequence[int]
    ) -> tuple[Any, Any]:
        """Costs, mWh, and durations, tenths of a second, between locations for one profile.

        PyVRP's type hints know no array of two dimensions.
        """
        travel = self._travel.by_profile[profile]
        ends = [*depots, *(self._begin(kind)[0] for kind in self._starts)]
        rows = [travel.row[place] for place in ends]
        rows[len(depots) : len(depots)] = junctions
        energy = travel.search_cost_kwh[np.ix_(rows, rows)]
        seconds = travel.duration_s[np.ix_(rows, rows)]
        connected = np.isfinite(energy)
        distance = np.where(
            connected, np.rint(np.where(connected, energy, 0) * MWH_PER_KWH), NO_PATH_MWH
        )
        tenths = np.where(connected, np.ceil(np.where(connected, seconds, 0) * _TENTHS), 0)
        np.fill_diagonal(tenths, 0)
        return distance.astype(np.int64), tenths.astype(np.int64)

    def _depots(self) -> list[str]:
        """Depots and first stops: a location each, as only what begins there leads to its start."""
        begins = [self._begin(kind)[0] for kind, _ in self._kinds]
        return list(dict.fromkeys([*(self._depot(kind) for kind, _ in self._kinds), *begins]))

    def _junctions(self) -> list[int]:
        """Rows of the junctions of the pooled stops: all stops of one are at one location."""
        return sorted({self._travel.row[name] for name in self._pooled})

    def _client(self, name: str, location: int, required: bool) -> pyvrp.Client:
        stop = self._fleet.stop_by_id[name]
        return pyvrp.Client(
            location=location,
            delivery=self._load(stop),
            service_duration=_up(stop.service_s),
            tw_early=_up(stop.earliest_s),
            tw_late=_NO_LIMIT_TENTHS if stop.latest_s is None else _down(stop.latest_s),
            required=required,
            prize=0 if required else _PRIZE_MWH,
        )

    def _vehicle_type(self, kind: Vehicle, number: int, at: Mapping[str, int]) -> pyvrp.VehicleType:
        place, begins_s, _ = self._begin(kind)
        latest_s = begins_s
        if kind.depart_by_s is not None:
            latest_s += kind.depart_by_s - kind.ready_s
        early, late = _up(begins_s), max(_up(begins_s), _down(latest_s))
        # PyVRP knows no breaks: they are put into finished routes, and here only cost time.
        rest_s = sum(own.duration_s for own in kind.breaks if own.latest_s > begins_s)
        back = _NO_LIMIT_TENTHS if kind.return_by_s is None else _down(kind.return_by_s - rest_s)
        return pyvrp.VehicleType(
            num_available=number,
            capacity=self._free(kind),
            max_distance=self._range_mwh(kind),
            profile=self._profiles.index(self._problem.profile_of(kind)),
            start_depot=at[place],
            end_depot=at[self._depot(kind)],
            tw_early=early,
            start_late=late,
            tw_late=max(late, back),
        )

    def _range_mwh(self, kind: Vehicle) -> int:
        """About how far a vehicle's charge takes it without charging stops, as a searched cost.

        Costs are not the energies that its battery gives: legs begin and end at rest, and time may
        have a value. So they are compared on the ways from its depot, and the longest range counts:
        hardly a route is lost that the battery lasts for. Finished routes are checked exactly.
        """
        battery = battery_of(self._fleet, kind)
        if battery is None or self._fleet.charging_stops:
            return int(np.iinfo(np.int64).max)
        travel, depot = self._travel.of(kind), self._depot(kind)
        names = [stop.id for stop in self._fleet.stops[:_SAMPLED_LEGS]]
        legs = {name: travel.leg(depot, name) for name in names}
        physics = self._problem.profile_of(kind).physics
        ratios = [
            leg.cost_kwh / leg_energy_kwh(leg, physics)
            for leg in legs.values()
            if leg is not None and leg.path
        ]
        latest_s = kind.ready_s if kind.depart_by_s is None else kind.depart_by_s
        usable_kwh = max(0.0, battery.at_departure_kwh(latest_s) - battery.reserve_kwh)
        if kind.first_stop is not None:
            leg = travel.leg(depot, kind.first_stop)
            usable_kwh -= 0.0 if leg is None else leg_energy_kwh(leg, physics)
        return max(0, int(usable_kwh * max(ratios, default=1.0) * MWH_PER_KWH))

    def visits(self, routes: Mapping[str, Sequence[str]]) -> Visits:
        """Routes by vehicle in PyVRP's numbers; stops that are not asked for are left out."""
        client = {name: i for i, name in enumerate(self._pooled, len(self._starts))}
        start = {kind: [i] for i, kind in enumerate(self._starts)}
        found = []
        for number, (kind, vehicles) in enumerate(self._kinds):
            for vehicle in vehicles:
                pooled = [client[s] for s in routes.get(vehicle.id, ()) if s in client]
                clients = [*start.get(kind, ()), *pooled]
                if clients:
                    found.append((number, clients))
        return found

    def read(self, routes: Visits) -> StopsByVehicle:
        """Routes by vehicle; those of one kind of vehicle are assigned in order."""
        waiting: dict[int, list[tuple[str, ...]]] = defaultdict(list)
        for kind, clients in routes:
            pooled = [i - len(self._starts) for i in clients if i >= len(self._starts)]
            waiting[kind].append(tuple(self._pooled[i] for i in pooled))
        stops: StopsByVehicle = {vehicle.id: () for vehicle in self._vehicles}
        for number, (_, vehicles) in enumerate(self._kinds):
            own = sorted(waiting[number])
            for position, vehicle in enumerate(vehicles):
                visits = own[position] if position < len(own) else ()
                first = () if vehicle.first_stop is None else (vehicle.first_stop,)
                stops[vehicle.id] = (*first, *visits)
        return stops


def _up(seconds: float) -> int:
    return int(np.ceil(seconds * _TENTHS))


def _down(seconds: float) -> int:
    return int(np.floor(seconds * _TENTHS))
