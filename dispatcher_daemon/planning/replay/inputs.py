"""A cycle as data that the database keeps, and the same cycle from that data.

Parts that cycles may have in common are apart from what is one cycle's own: roads, settings,
places, vehicles, stops, expected costs, the traffic as it was judged, and the routes that the
search started from. Plans that vehicles follow are stored already and are not stored again; segment
states are not kept as long as inputs, and are not needed.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

from pydantic import TypeAdapter

from dispatcher_daemon.fleet import on_road
from dispatcher_daemon.forms import routing_problem
from dispatcher_daemon.planning.cycle import CycleResult
from dispatcher_daemon.planning.cycle.cycle import cycle_of
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.replay.networks import network_data, network_from
from dispatcher_daemon.planning.replay.parts import (
    PlanOf,
    commitment_data,
    commitment_from,
    expected_data,
    expected_from,
    fleet_from_parts,
    places_data,
    plan_from,
    settings_data,
    table_data,
    traffic_data,
    traffic_from,
)
from dispatcher_daemon.planning.replay.trace import Trace
from dispatcher_daemon.planning.routes import Insertion
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream import __version__
from slipstream.explain import CycleFacts, facts_data
from storage import CycleInputs, Part, StoredCycle

_PACKAGES: Final = (
    "pyvrp",
    "highspy",
    "numpy",
    "scipy",
    "networkx",
    "dimod",
    "dwave-samplers",
    "qiskit",
)
"""A plan depends on their versions."""
_TRACE: Final = TypeAdapter(Trace)


@dataclass(frozen=True)
class CycleRecord:
    """What is one cycle's own, beside its report and what its words are made of.

    Attributes:
        made: vehicles that it made plans for.
        wanted: stops that were to be put into tours between cycles; None: it was a whole cycle.
    """

    trace: Trace
    made: tuple[str, ...]
    versions: Mapping[str, str]
    wanted: tuple[str, ...] | None = None


class InputEncoder:
    """Makes the inputs of cycles; what stays the same from one to the next is encoded once."""

    def __init__(self) -> None:
        self._made: dict[str, tuple[object, Part]] = {}

    def encode(self, cycle: Cycle, trace: Trace, result: CycleResult) -> CycleInputs:
        """The inputs of a cycle."""
        made = tuple(plan.vehicle for plan in result.plans)
        return self._inputs(cycle, trace, CycleFacts(made, result.accounts, result.refused))

    def encode_insertion(
        self, cycle: Cycle, wanted: Sequence[str], result: Insertion
    ) -> CycleInputs:
        """The inputs of an insertion between cycles.

        Args:
            cycle: its `start` has the tours that were offered.
        """
        made = () if result.found is None else tuple(p.vehicle for p in result.found.plans)
        return self._inputs(cycle, Trace(), CycleFacts(made, inserted=result.tried), wanted)

    def _inputs(
        self, cycle: Cycle, trace: Trace, facts: CycleFacts, wanted: Sequence[str] | None = None
    ) -> CycleInputs:
        problem, snapshot, fleet = cycle.problem, cycle.snapshot, cycle.problem.fleet
        parts = {
            "network": self._part("network", problem.network, network_data),
            "settings": self._part("settings", cycle.settings, settings_data),
            "places": self._part("places", fleet, places_data),
            "vehicles": self._part("vehicles", fleet.vehicles, partial(table_data, "vehicles")),
            "stops": self._part("stops", fleet.stops, partial(table_data, "stops")),
            "expected": self._part("expected", snapshot.expected, expected_data),
            "traffic": self._part(
                "traffic", snapshot.segments, partial(traffic_data, problem.network)
            ),
            "start": self._part("start", cycle.start, lambda start: start and dict(start)),
        }
        own = {
            "now_ns": cycle.now_ns,
            "seed": cycle.seed,
            "reference_delay_s": cycle.reference_delay_s,
            "commitments": [commitment_data(own) for own in cycle.commitments],
            "on_road": [[user.vehicle, user.cycle, user.late_s] for user in cycle.on_road],
            "trace": _TRACE.dump_python(trace, mode="json"),
            "versions": versions(),
            "wanted": None if wanted is None else list(wanted),
            **facts_data(facts),
        }
        return CycleInputs(_json(own), parts)

    def _part(self, name: str, of: Any, data: Callable[[Any], object]) -> Part:
        known = self._made.get(name)
        if known is None or known[0] is not of:
            # It is kept with its part: another object may get the place of one that is gone.
            known = self._made[name] = (of, Part.of(_json(data(of))))
        return known[1]


def cycle_record(inputs: CycleInputs) -> CycleRecord:
    """What is a cycle's own.

    Raises:
        ValueError: it cannot be read by this version.
    """
    with _readable():
        own = json.loads(inputs.record)
        return CycleRecord(
            _TRACE.validate_python(own["trace"]),
            tuple(own["made"]),
            own["versions"],
            None if own["wanted"] is None else tuple(own["wanted"]),
        )


def restored_cycle(stored: StoredCycle, plan_of: PlanOf) -> Cycle:
    """The cycle as it was planned.

    Raises:
        ValueError: its inputs are not stored or cannot be read by this version, or a plan is gone.
    """
    inputs = stored.inputs
    if inputs is None:
        raise ValueError("its inputs are not stored")
    with _readable():
        own = json.loads(inputs.record)
        parts = {name: json.loads(part.content) for name, part in inputs.parts.items()}
        network = network_from(parts["network"])
        settings = restored_settings(inputs)
        fleet = fleet_from_parts(parts)
        # What its states said is in the traffic; the states themselves decide nothing more.
        snapshot = TrafficSnapshot(
            own["now_ns"],
            traffic_from(network, parts["traffic"]),
            (),
            expected_from(parts["expected"]),
        )
        following = [plan_from(plan_of, cycle, vehicle) for vehicle, cycle, _ in own["on_road"]]
        late_s = {vehicle: late for vehicle, _, late in own["on_road"]}
        start = parts["start"]
        return cycle_of(
            routing_problem(network, fleet, settings),
            snapshot,
            settings,
            stored.report.cycle,
            seed=own["seed"],
            reference_delay_s=own["reference_delay_s"],
            on_road=on_road(following, own["now_ns"], late_s),
            start=None if start is None else {name: tuple(stops) for name, stops in start.items()},
            commitments=tuple(commitment_from(data, plan_of) for data in own["commitments"]),
        )


def restored_settings(inputs: CycleInputs) -> DispatcherSettings:
    """The settings that a cycle was planned by; those that no plan depends on are the defaults.

    Raises:
        ValueError: they cannot be read by this version.
    """
    with _readable():
        return DispatcherSettings.model_validate(json.loads(inputs.parts["settings"].content))


@contextmanager
def _readable() -> Iterator[None]:
    """What another version has stored may lack anything."""
    try:
        yield
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"its inputs cannot be read: {error!r}") from None


def versions() -> dict[str, str]:
    """Versions of the software that plans depend on, by name."""
    found = {"slipstream": __version__, "python": platform.python_version()}
    found["machine"] = platform.machine()
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _json(data: object) -> bytes:
    return json.dumps(data, separators=(",", ":")).encode()
