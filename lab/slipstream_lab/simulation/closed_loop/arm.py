"""One arm of a day in a subprocess: SUMO, RSUs, dispatcher and fleet."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from slipstream.braking import Road
from slipstream.vehicle_types import PresetName
from slipstream_lab.simulation.closed_loop.policy import AS_DRIVING, Policy, WaitingPrices
from slipstream_lab.simulation.closed_loop.record import ArmResult, OrderService, Others
from slipstream_lab.simulation.rsus import Rsu
from slipstream_lab.simulation.scenarios.day import DaySpec, sumo_options
from slipstream_lab.simulation.scenarios.demand import DAY_S, FleetSettings, draw_deliveries
from slipstream_lab.simulation.scenarios.gridlock import CHECK_S, GridlockWatch
from slipstream_lab.simulation.scenarios.record import read_statistics, read_trips
from slipstream_lab.simulation.scenarios.scenario import Scenario, load_scenario
from slipstream_lab.simulation.sumo import TYPES, Progress, check_files, run_in_subprocess
from storage import Database, open_database
from vehicle_agent.agent import AgentParameters

STEP_S: Final = 0.5
"""Energy from steps of this length is right to 0.2 %."""

_LOOK_S: Final = 5.0
"""Between, nothing but a plan or an order served changes what a standing vehicle is advised."""

_HOME_S: Final = 3600.0
"""After the last order's latest time: who is not at home by then makes the arm less than whole."""


@dataclass(frozen=True)
class ArmSpec:
    """What to simulate.

    Attributes:
        seed: of the fleet's orders, of perception's errors and of the dispatcher's searches.
        fleet: settings of the deliveries, other than the scenario's.
        type: of the fleet's vehicles; None: the fleet's own.
        own_routes: whether the background is the user's: the default fleet is another one then.
        history: what movements cost on another day; the lever "routes" needs it.
        begin_s: simulated, s since midnight; a multiple of 300.
        end_s: orders are released until then. The arm goes on until these are served and everybody
            is at home, an hour after the last one is due at most, and not beyond the day: cut off,
            arms would be compared by what each had not yet driven.
        step_s: of the simulation; a second must be a multiple of it.
        database: SQLite file that is made, with the arm's cycles, plans and energy ledger; None:
            none is. Its times count from midnight of 1970-01-01, UTC.
        road: state of the roads, all day; the agents know it.
    """

    scenario: str
    background: tuple[Path, ...]
    rsus: tuple[Rsu, ...]
    seed: int
    policy: Policy
    net: Path | None = None
    fleet: Path | None = None
    own_routes: bool = False
    additional: tuple[Path, ...] = ()
    history: Path | None = None
    begin_s: float = 0.0
    end_s: float = 86400.0
    step_s: float = STEP_S
    database: Path | None = None
    prices: WaitingPrices = AS_DRIVING
    road: Road = "dry"
    type: PresetName | None = None

    def __post_init__(self) -> None:
        if self.begin_s % 300 or not 0 <= self.begin_s < self.end_s:
            raise ValueError("begin_s must be a multiple of 300 and before end_s")
        if self.history is None and "routes" in self.policy.levers:
            raise ValueError("the lever 'routes' needs a history")


def home_by_s(fleet: FleetSettings, end_s: float) -> float:
    """When an arm ends at the latest whose orders are released until a time, s since midnight."""
    due_s = max(*fleet.wave_due_s, *fleet.express_due_s)
    return max(end_s, min(end_s + due_s + _HOME_S, DAY_S))


def run_arm(order: ArmSpec, progress: Progress | None = None) -> ArmResult:
    """Simulate an arm in another process; same order, same result.

    Raises:
        InputError: a file is no SUMO file or none that fits the net, or SUMO dies of it.
        ModuleNotFoundError: libsumo is not installed.
    """
    net = _scenario(order).net
    check_files(net, (*order.background, *order.additional))
    source = ", ".join(path.name for path in (net, *order.background))
    return run_in_subprocess(simulate_arm, order, source, order.end_s, progress)


def simulate_arm(order: ArmSpec, report_time: Callable[[float], None]) -> ArmResult:
    """Simulate in this process. Raises InputError: SUMO refuses a file."""
    # Imported here: they need libsumo, or take a second to load.
    from slipstream_lab.simulation.closed_loop.dispatching import Dispatching
    from slipstream_lab.simulation.closed_loop.gates import WINDOW_S, SimulatedRoadside
    from slipstream_lab.simulation.closed_loop.history_file import load_history
    from slipstream_lab.simulation.fleet.brakes import Reality
    from slipstream_lab.simulation.fleet.exchange import Exchange
    from slipstream_lab.simulation.fleet.sensing import PREFIX
    from slipstream_lab.simulation.fleet.van import yards
    from slipstream_lab.simulation.fleet.world import FleetWorld
    from slipstream_lab.simulation.signals import SignalController
    from slipstream_lab.simulation.sumo.session import SumoSession

    scenario = _scenario(order)
    network, policy = scenario.network, order.policy
    lengths_m = {name: segment.length_m for name, segment in network.segments.items()}
    deliveries = draw_deliveries(scenario.fleet, network, order.seed)
    orders = {one.id: one for one in deliveries.orders}
    due = {one.id: one for one in deliveries.orders if order.begin_s <= one.release_s < order.end_s}
    over = orders.keys() - due.keys()
    home_s = home_by_s(scenario.fleet, order.end_s)
    history = None if order.history is None else load_history(order.history)
    roadside = SimulatedRoadside(order.rsus, order.seed, policy.noise, policy.gating)
    day = DaySpec(
        scenario.net,
        order.background,
        tuple(network.segments),
        order.additional,
        begin_s=order.begin_s,
        end_s=home_s,
        step_s=order.step_s,
    )
    with (
        tempfile.TemporaryDirectory() as name,
        ThreadPoolExecutor(1) as executor,
        _database(order.database) as database,
    ):
        trips, statistics = Path(name) / "trips.xml", Path(name) / "statistics.xml"
        options = [
            *sumo_options(day),
            *("--tripinfo-output", str(trips), "--statistic-output", str(statistics)),
        ]
        legs = []
        gridlock = GridlockWatch()
        with SumoSession(options, day.files) as session:
            kind, ideal = deliveries.settings.vehicle_type, policy.brakes == "ideal"
            reality = Reality.of_day(kind, order.road, ideal=ideal, seed=order.seed)
            parameters = AgentParameters(
                kind.profile.physics,
                kind.length_m or TYPES["cav"].length_m,
                kind.max_speed_mps,
                order.step_s,
                1.5 * WINDOW_S,
                kind.drafting,
                reality.braking,
                reality.others_mps2,
            )
            exchange = Exchange(
                dict.fromkeys(deliveries.vehicles, parameters),
                SignalController(network.intersections, "priority" in policy.levers),
                network.intersections,
                lambda: session.time_s,
                lambda message: dispatching.receive(message),
                parameters.stale_after_s,
                loss=reality.loss,
                latency_s=reality.latency_s,
                seed=order.seed,
            )
            dispatching = Dispatching(
                deliveries,
                network,
                policy,
                order.seed,
                executor,
                exchange.send_plan,
                roadside,
                history,
                database,
                order.prices,
            )
            world = FleetWorld(
                session,
                yards(deliveries, network),
                kind,
                lengths_m,
                exchange,
                roadside,
                lambda stop: orders[stop].service_s,
                order.step_s,
                lambda: exchange.now_ns,
                _LOOK_S,
                policy.pace,
                reality=reality,
            )

            def is_over(now_s: float) -> bool:
                if now_s < order.end_s:
                    return False
                whole = (
                    world.tours_begun == world.tours_finished and due.keys() <= world.begun_s.keys()
                )
                return whole or now_s >= home_s

            states: object = ()
            while not is_over(now_s := session.time_s):
                if "platoons" in policy.levers and roadside.states is not states:
                    states = roadside.states
                    exchange.send_states(roadside.told)
                if now_s % dispatching.interval_s == 0:
                    dispatching.cycle(now_s, over.union(world.begun_s))
                if now_s % CHECK_S == 0 and now_s > order.begin_s:
                    report_time(now_s)
                    if gridlock.update(now_s):
                        break
                exchange.begin_step()
                legs += world.step()
                roadside.sample(session.time_s)
            ended_s = session.time_s
            dispatching.close(ended_s)
        ended = read_trips(trips)
        counts = read_statistics(statistics, ended)
        end_s = min(ended_s, order.end_s)
        others = [
            trip
            for trip in ended
            if not trip.id.startswith(PREFIX) and trip.depart_s + trip.duration_s <= end_s
        ]
    services = tuple(
        OrderService(one.id, one.latest_s, world.begun_s.get(one.id))
        for one in due.values()
        if one.release_s < end_s
    )
    return ArmResult(
        scenario=order.scenario,
        seed=order.seed,
        policy=policy.name,
        begin_s=order.begin_s,
        end_s=end_s,
        legs=tuple(legs),
        services=services,
        cycles=tuple(dispatching.cycles),
        others=Others(
            arrived=len(others),
            duration_s=_mean([trip.duration_s + trip.delay_s for trip in others]),
            time_loss_s=_mean([trip.time_loss_s for trip in others]),
            stops=_mean([trip.stops for trip in others]),
            trips=world.safety.others.trips,
        ),
        disengagements=world.disengagements,
        teleports=counts.teleports,
        collisions=counts.collisions,
        emergency_stops=counts.emergency_stops,
        gridlock_s=gridlock.since_s,
        unfinished=world.tours_begun - world.tours_finished,
        served_again=len(world.again),
        ended_s=ended_s,
        watched=roadside.watched,
        opened=tuple(sorted(roadside.opened)),
        safety=world.safety.found,
    )


def _scenario(order: ArmSpec) -> Scenario:
    return load_scenario(
        order.scenario,
        net=order.net,
        fleet=order.fleet,
        type=order.type,
        own_routes=order.own_routes,
    )


@contextmanager
def _database(path: Path | None) -> Iterator[Database | None]:
    """A new one in the place of that of an arm that was interrupted."""
    if path is None:
        yield None
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    for old in path.parent.glob(f"{path.name}*"):
        old.unlink()
    with open_database(f"sqlite:///{path.absolute()}") as database:
        yield database


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else 0.0
