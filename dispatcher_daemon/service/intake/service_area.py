"""Where a fleet can serve at all, and what: what is beyond it is refused when it is submitted."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property

from dispatcher_daemon.fleet import DEPOT, Fleet, Stop, Vehicle, snapper_of
from slipstream.messages import OrderRequest
from slipstream.orders import OrderRefused, utc
from slipstream.roads import RoadNetwork
from slipstream.roads.snapping import NoPlaceError, Snapper
from slipstream.vehicle_types import RoutingProfile

_Rule = tuple[str, Callable[[Vehicle], bool], str, str]
"""Key of the order, whether a vehicle keeps it, what is wrong where none does, and the mend."""


class ServiceArea:
    """The places and loads that some vehicle of a fleet can serve, whatever the traffic.

    Args:
        fleet: of the file; None: it has no vehicle, and any may come.
    """

    def __init__(self, network: RoadNetwork, fleet: Fleet | None) -> None:
        self._network, self._fleet = network, fleet
        self._reached: dict[tuple[str, RoutingProfile], frozenset[str]] = {}

    def take_over(self, before: ServiceArea) -> None:
        """Keep what was computed for a fleet of the same roads: files are often read again."""
        self._reached = before._reached
        if "_snapper" in before.__dict__ and self._profiles() == before._profiles():
            self.__dict__["_snapper"] = before._snapper

    def check(self, request: OrderRequest, now_ns: int) -> str:
        """The junction where vehicles stop for a request.

        Raises:
            OrderRefused: no vehicle could ever serve it, with the field that is in the way.
        """
        name, fleet = request.id, self._fleet
        if request.latest is not None and request.latest <= now_ns:
            closed = f"its window closed at {utc(request.latest)}, and it is {utc(now_ns)}"
            raise OrderRefused("invalid", closed, "give a later one", order=name, key="latest")
        if name == DEPOT or (fleet is not None and _is_place(fleet, name)):
            problem = "a place of the fleet's file has this id"
            raise OrderRefused("conflict", problem, "give another id", order=name, key="id")
        node = self._node(request)
        if fleet is not None:
            stop = Stop(
                id=name,
                node=node,
                demand=request.demand,
                mass_kg=request.mass_kg,
                carrier=request.carrier,
                skills=request.skills,
            )
            self.check_vehicles(stop, request.vehicle)
        return node

    def check_vehicles(self, stop: Stop, vehicle: str | None) -> None:
        """Check that a vehicle of the fleet could serve a stop.

        Args:
            vehicle: the only one that may; None: any.

        Raises:
            OrderRefused: none could, with the field that is in the way.
        """
        fleet = self._fleet
        if fleet is None:
            if vehicle is not None:
                mend = "name one of the fleet's vehicles"
                raise _refused(stop, "vehicle", f"no vehicle {vehicle!r}", mend)
            return
        rules = self._rules(fleet, stop, vehicle)
        # Mostly one of the first vehicles will do.
        if any(all(keep(v) for _, keep, _, _ in rules) for v in fleet.vehicles):
            return
        left = fleet.vehicles
        for key, keep, problem, mend in rules:
            kept = tuple(v for v in left if keep(v))
            if not kept:
                if key == "demand":
                    largest = max((v.capacity or 0 for v in left), default=0)
                    problem = f"{problem} (largest: {largest})"
                raise _refused(stop, key, problem, mend)
            left = kept

    def _rules(self, fleet: Fleet, stop: Stop, vehicle: str | None) -> tuple[_Rule, ...]:
        """What a vehicle has to keep to serve a stop, in the order in which it is told."""
        whose = "vehicle" if vehicle is None else f"vehicle {vehicle!r}"
        return (
            (
                "vehicle",
                lambda v: vehicle in (None, v.id),
                f"no vehicle {vehicle!r}",
                "name one of the fleet's vehicles",
            ),
            (
                "carrier",
                lambda v: stop.carrier in (None, v.carrier),
                f"no {whose} is of carrier {stop.carrier!r}",
                "give a carrier of the fleet, or none",
            ),
            (
                "skills",
                lambda v: set(stop.skills) <= set(v.skills),
                f"no {whose} has all the skills {', '.join(stop.skills)}",
                "ask for less, or give a vehicle the skills",
            ),
            (
                "demand",
                lambda v: v.capacity is None or stop.demand <= v.capacity,
                f"it needs {stop.demand}, more than a vehicle can take",
                "split the order",
            ),
            (
                "mass_kg",
                lambda v: fleet.overload(v, [stop]) is None,
                f"it weighs {stop.mass_kg:g} kg, more than a vehicle may load",
                "split the order",
            ),
            (
                "node",
                lambda v: self._is_reached(v, stop.node),
                f"no {whose} gets from its depot to {stop.node!r} and back",
                "give a place on roads that the vehicles may use",
            ),
        )

    def _node(self, request: OrderRequest) -> str:
        junctions, name = self._network.junctions, request.id
        if request.node is not None:
            if request.node not in junctions:
                problem = f"no junction {request.node!r} in network {self._network.name!r}"
                mend = "name one of its junctions, or give lat and lon"
                raise OrderRefused("invalid", problem, mend, order=name, key="node")
            return request.node
        assert request.lat is not None
        assert request.lon is not None
        try:
            return self._snapper.stop_for(request.lat, request.lon).node
        except NoPlaceError as error:
            raise OrderRefused(
                "invalid", error.problem, error.mend, order=name, key="lat"
            ) from None

    def _profiles(self) -> set[RoutingProfile]:
        fleet = self._fleet
        kinds = [] if fleet is None else [fleet.type_of(vehicle) for vehicle in fleet.vehicles]
        return {RoutingProfile() if kind is None else kind.profile for kind in kinds}

    @cached_property
    def _snapper(self) -> Snapper:
        return snapper_of(self._fleet, self._network)

    def _is_reached(self, vehicle: Vehicle, node: str) -> bool:
        """Whether roads that a vehicle may use lead from its depot to a junction and back; turns
        that are forbidden do not count.
        """
        assert self._fleet is not None
        kind = self._fleet.type_of(vehicle)
        profile = RoutingProfile() if kind is None else kind.profile
        key = self._fleet.depot_of(vehicle).node, profile
        if key not in self._reached:
            out, back = self._links(profile)
            self._reached[key] = _reach(out, key[0]) & _reach(back, key[0])
        return node in self._reached[key]

    def _links(
        self, profile: RoutingProfile
    ) -> tuple[Mapping[str, list[str]], Mapping[str, list[str]]]:
        """Junctions behind each junction, and before each, by roads that a profile may use."""
        out: dict[str, list[str]] = defaultdict(list)
        back: dict[str, list[str]] = defaultdict(list)
        for segment in self._network.segments.values():
            if segment.access.admits(profile):
                out[segment.start].append(segment.end)
                back[segment.end].append(segment.start)
        return out, back


def _refused(stop: Stop, key: str, problem: str, mend: str) -> OrderRefused:
    return OrderRefused("invalid", problem, mend, order=stop.id, key=key)


def _is_place(fleet: Fleet, name: str) -> bool:
    tables = (
        fleet.stop_by_id,
        fleet.depot_by_id,
        fleet.charging_stop_by_id,
        fleet.hub_by_id,
        fleet.break_ids,
    )
    return any(name in table for table in tables)


def _reach(links: Mapping[str, Iterable[str]], start: str) -> frozenset[str]:
    found, waiting = {start}, [start]
    while waiting:
        for following in links.get(waiting.pop(), ()):
            if following not in found:
                found.add(following)
                waiting.append(following)
    return frozenset(found)
