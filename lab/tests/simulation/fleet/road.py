"""A fleet behind real agents in SUMO: a road of three segments, plans for it, and the world."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import libsumo

from slipstream.messages import (
    DrivingAdvice,
    Estimate,
    KinematicFeatures,
    Message,
    PlannedSegment,
    PlannedStop,
    SegmentState,
    VehicleAdvice,
    VehiclePlan,
    VehicleSensing,
)
from slipstream.vehicle_types import PRESETS
from slipstream_lab.simulation.fleet.brakes import Reality
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg
from slipstream_lab.simulation.fleet.exchange import Exchange
from slipstream_lab.simulation.fleet.world import FleetWorld
from slipstream_lab.simulation.signals import SignalController
from slipstream_lab.simulation.sumo.session import SumoSession
from slipstream_lab.simulation.sumo.vehicle_types import TYPES
from vehicle_agent.agent import AgentParameters

LENGTHS: Mapping[str, float] = {"a": 3000.0, "b": 1500.0, "c": 1000.0}
LIMIT_MPS = 30.0
SERVICE_S = 20.0


def ns(seconds: float) -> int:
    """A moment of the simulation as on the wire."""
    return round(seconds * 1e9)


def write_line(folder: Path, limit_mps: float = LIMIT_MPS) -> tuple[Path, Path]:
    """Net and route file: three segments of two lanes in a line, the fleet's type, nobody else."""
    lines, begin = [], 0.0
    ends = {"a": "01", "b": "12", "c": "23"}
    for name, length in LENGTHS.items():
        lanes = "".join(
            f'<lane id="{name}_{i}" index="{i}" speed="{limit_mps}" length="{length}" '
            f'shape="{begin},{3.2 * i} {begin + length},{3.2 * i}"/>'
            for i in range(2)
        )
        one, other = tuple(ends[name])
        lines.append(f'<edge id="{name}" from="{one}" to="{other}" priority="1">{lanes}</edge>')
        begin += length
    at = 0.0
    for number, length in enumerate([0.0, *LENGTHS.values()]):
        at += length
        kind = "dead_end" if number in (0, 3) else "priority"
        before = ["", "a_0 a_1", "b_0 b_1", "c_0 c_1"][number]
        request = '<request index="0" response="00" foes="00"/>'
        request += '<request index="1" response="00" foes="00"/>'
        lines.append(
            f'<junction id="{number}" type="{kind}" x="{at}" y="0" incLanes="{before}" '
            f'intLanes="" shape="{at},0 {at},6">{request if kind == "priority" else ""}</junction>'
        )
    for one, other in (("a", "b"), ("b", "c")):
        lines += (
            f'<connection from="{one}" to="{other}" fromLane="{lane}" toLane="{lane}" '
            'dir="s" state="M"/>'
            for lane in range(2)
        )
    net, routes = folder / "line.net.xml", folder / "line.rou.xml"
    net.write_text(
        f'<net version="1.20"><location netOffset="0,0" convBoundary="0,0,{begin},10" '
        'origBoundary="0,0,1,1" projParameter="!"/>' + "".join(lines) + "</net>"
    )
    routes.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    return net, routes


def segments(
    path: Sequence[str],
    leg: int = 0,
    place: int | None = None,
    limit_mps: float = LIMIT_MPS,
) -> tuple[PlannedSegment, ...]:
    """Planned segments of the line; with a place, in the platoon p."""
    return tuple(
        PlannedSegment(
            segment=name,
            entry_ns=0,
            exit_ns=0,
            speed_mps=limit_mps,
            platoon=None if place is None else "p",
            place=place,
            gap_m=2.0 if place else None,
            leg=leg,
            length_m=LENGTHS[name],
            speed_limit_mps=limit_mps,
            lanes=2,
        )
        for name in path
    )


def stop(name: str, time_s: float = 0.0) -> PlannedStop:
    """A stop of a plan."""
    return PlannedStop(stop=name, node=name, arrival_ns=ns(time_s), departure_ns=ns(time_s))


def plan(
    planned: Sequence[PlannedSegment],
    *stops: str,
    vehicle: str = "van",
    cycle: int = 1,
    depart_s: float = 0.0,
    continues: int | None = None,
    advice: DrivingAdvice | None = None,
) -> VehiclePlan:
    """A plan from the depot by way of stops and back; one that continues another names its own
    first place.
    """
    places = stops if continues is not None else ("depot", *stops)
    return VehiclePlan(
        vehicle=vehicle,
        cycle=cycle,
        issued_ns=ns(depart_s),
        valid_until_ns=ns(100_000),
        depart_ns=ns(depart_s),
        stops=tuple(stop(name, depart_s) for name in (*places, "depot")),
        segments=tuple(planned),
        distance_m=sum(segment.length_m or 0.0 for segment in planned),
        energy_kwh=1.0,
        advice=advice or DrivingAdvice(),
        continues=continues,
    )


def state(segment: str, time_s: float, y_e: int | None) -> SegmentState:
    """What an RSU has seen of a segment."""
    features = KinematicFeatures(
        mean_speed_mps=Estimate(value=12.0),
        mean_acceleration_mps2=Estimate(value=0.0),
        density_veh_per_m=Estimate(value=0.02),
        speed_std_mps=Estimate(value=0.5),
        acceleration_variance_m2ps4=Estimate(value=0.1),
    )
    return SegmentState(
        rsu="rsu-01",
        segment=segment,
        sequence=round(time_s * 10),
        time_ns=ns(time_s),
        window_s=60.0,
        features=features,
        y_e=y_e,  # type: ignore[arg-type]
        reason=None if y_e is not None else "uncertain",
        vehicles=5,
        frames=600,
        coverage=1.0,
    )


@dataclass
class Flags:
    """y_e of segments, as the RSUs tell it and as it is."""

    y_e: dict[str, int | None] = field(default_factory=dict)

    def is_open(self, segment: str) -> bool:
        """Whether it is stable."""
        return self.y_e.get(segment) == 1

    def is_turbulent(self, segment: str) -> bool:
        """Whether it is turbulent."""
        return self.y_e.get(segment) == 0


class Recorded(Exchange):
    """The exchange, and what vehicles sensed and were advised in the last step.

    Attributes:
        sensed: by vehicle.
        advised: by vehicle.
        silent: vehicles whose agents give no advice.
    """

    def __init__(self, *arguments: object, **named: object) -> None:
        super().__init__(*arguments, **named)  # type: ignore[arg-type]
        self.sensed: dict[str, VehicleSensing] = {}
        self.advised: dict[str, VehicleAdvice] = {}
        self.silent: set[str] = set()

    def advise(self, sensing: VehicleSensing) -> VehicleAdvice | None:
        """The agent's, unless it is silent."""
        self.sensed[sensing.vehicle] = sensing
        if sensing.vehicle in self.silent:
            return None
        advice = super().advise(sensing)
        if advice is not None:
            self.advised[sensing.vehicle] = advice
        return advice


@dataclass
class Running:
    """A running world.

    Attributes:
        session: of SUMO.
        exchange: of the agents.
        world: of the vehicles.
        flags: of the segments; told to the vehicles each second.
        sent: what vehicles sent to the dispatcher.
        legs: that have ended.
        collisions: counted.
    """

    session: SumoSession
    exchange: Recorded
    world: FleetWorld
    flags: Flags
    sent: list[Message]
    legs: list[DrivenLeg] = field(default_factory=list)
    collisions: int = 0
    _told_s: float = -1.0

    def step(self) -> list[DrivenLeg]:
        """One step."""
        now_s = self.session.time_s
        if now_s - self._told_s >= 1.0:
            self._told_s = now_s
            self.exchange.send_states(
                state(segment, now_s, y_e) for segment, y_e in self.flags.y_e.items()
            )
        self.exchange.begin_step()
        ended = self.world.step()
        self.legs += ended
        self.collisions += int(libsumo.simulation.getCollidingVehiclesNumber())
        return ended

    def until(self, holds: Callable[[], bool], limit_s: float = 900.0) -> None:
        """Step until something holds."""
        end_s = self.session.time_s + limit_s
        while not holds():
            assert self.session.time_s < end_s, "it never came to hold"
            self.step()

    def steps_for(self, seconds: float) -> Iterator[None]:
        """Step for a time."""
        end_s = self.session.time_s + seconds
        while self.session.time_s < end_s - 1e-6:
            self.step()
            yield

    def gap_m(self, vehicle: str) -> float | None:
        """To the vehicle ahead, as sensed in the last step; None: nobody is there."""
        ahead = self.exchange.sensed[vehicle].ahead
        return None if ahead is None else ahead.gap_m


@contextmanager
def running(
    files: tuple[Path, Path],
    vehicles: Sequence[str] = ("van",),
    *,
    step_s: float = 0.5,
    lengths_m: Mapping[str, float] = LENGTHS,
    yard: str = "a",
    intersections: Sequence[str] = (),
    pace: float = 1.0,
    service_s: Callable[[str], float | None] = lambda stop: SERVICE_S,
    reality: Reality | None = None,
    preset: str = "paper_car",
) -> Iterator[Running]:
    """A world without background; `preset` is its vehicles' type."""
    net, routes = files
    options = [
        *("--net-file", str(net), "--route-files", str(routes), "--step-length", f"{step_s:g}"),
        *("--xml-validation", "never", "--no-warnings", "true", "--no-step-log", "true"),
        *("--collision.action", "warn", "--default.speeddev", "0"),
    ]
    flags, sent = Flags(), list[Message]()
    kind = PRESETS[preset]
    reality = reality or Reality.of_day(kind, "dry", ideal=False, seed=1)
    parameters = AgentParameters(
        kind.profile.physics,
        kind.length_m or TYPES["cav"].length_m,
        kind.max_speed_mps,
        drafting=kind.drafting,
        interval_s=step_s,
        stale_after_s=10.0,
        braking=reality.braking,
        others_mps2=reality.others_mps2,
    )
    with SumoSession(options, files) as session:
        exchange = Recorded(
            dict.fromkeys(vehicles, parameters),
            SignalController(intersections, False),
            intersections,
            lambda: session.time_s,
            sent.append,
            parameters.stale_after_s,
            loss=reality.loss,
            latency_s=reality.latency_s,
        )
        world = FleetWorld(
            session,
            dict.fromkeys(vehicles, yard),
            kind,
            lengths_m,
            exchange,
            flags,
            service_s,
            step_s,
            lambda: exchange.now_ns,
            5.0,
            pace,
            reality=reality,
        )
        yield Running(session, exchange, world, flags, sent)
