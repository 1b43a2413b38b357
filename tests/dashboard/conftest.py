"""A small world of messages about the demo network, as its daemons would send them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from slipstream.bus import Bus
from slipstream.messages import (
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    CameraCalibration,
    CycleReport,
    DispatcherHealth,
    EnergySummary,
    Estimate,
    Gate,
    KinematicFeatures,
    PlannedSegment,
    PlannedStop,
    RsuHealth,
    SegmentState,
    SolverReport,
    VehiclePlan,
    plan_key,
    preview_key,
    rsu_health_key,
    state_key,
)
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network

S = 1_000_000_000
NOW_NS = 1_795_000_000 * S
ROUTES = {
    "van-a": (
        ("depot_road_east", "mill_street_east"),
        ("mill_link_east", "avenue_east", "hill_link_east"),
        ("hill_link_west", "avenue_west", "gate_west", "depot_road_west"),
    ),
    "van-b": (
        ("depot_road_east", "dock_street_east"),
        ("dock_link_east", "avenue_east", "quay_link_east"),
        ("quay_link_west", "avenue_west", "gate_west", "depot_road_west"),
    ),
}


@dataclass
class World:
    """Makes messages; times are UTC ns."""

    network: RoadNetwork

    def state(
        self,
        segment: str,
        time_ns: int = NOW_NS,
        y_e: int | None = 1,
        reason: str | None = None,
        rsu: str | None = None,
        speed_mps: float = 15.0,
    ) -> SegmentState:
        """What the RSU of a segment sees."""
        spread = 0.05 if y_e == 1 else 0.35
        features = KinematicFeatures(
            mean_speed_mps=Estimate(value=speed_mps, standard_error=0.1),
            mean_acceleration_mps2=Estimate(value=0.01),
            density_veh_per_m=Estimate(value=0.03),
            speed_std_mps=Estimate(value=speed_mps * spread),
            acceleration_variance_m2ps4=Estimate(value=0.08 if y_e == 1 else 1.4),
        )
        return SegmentState(
            rsu=rsu or f"rsu-{segment}",
            segment=segment,
            sequence=time_ns // S,
            time_ns=time_ns,
            window_s=10.0,
            features=None if y_e is None else features,
            y_e=y_e,
            reason=reason or (None if y_e is not None else "too_few_vehicles"),
            vehicles=9,
            frames=300,
            coverage=1.0,
        )

    def health(self, segment: str, time_ns: int = NOW_NS, status: str = "ok") -> RsuHealth:
        """How the RSU of a segment is doing."""
        return RsuHealth(
            rsu=f"rsu-{segment}",
            time_ns=time_ns,
            started_ns=time_ns - 300 * S,
            source="clip.mp4",
            segments=(segment,),
            status=status,
            frames=8991,
            frames_skipped=9,
            decode_errors=0,
            reconnects=0,
            states=290,
            fps=29.97,
            latency_ms_p50=18.2,
            latency_ms_p95=31.0,
            vehicles_in_view=9,
            rss_mb=310.0,
            calibration=CameraCalibration(
                file="camera.toml",
                written_ns=time_ns - 86_400 * S,
                points=8,
                residual_px=0.71,
                speed_error=0.012,
            ),
        )

    def plan(self, vehicle: str, cycle: int, time_ns: int = NOW_NS) -> VehiclePlan:
        """A van's round over its two customers, in a platoon on the eastbound avenue."""
        clock_ns = time_ns + 10 * S
        parts: list[PlannedSegment] = []
        stops: list[PlannedStop] = []
        energy_km = 0.0
        for leg, names in enumerate(ROUTES[vehicle]):
            for name in names:
                segment = self.network.segments[name]
                together = name == "avenue_east"
                end_ns = clock_ns + round(segment.free_flow_s * S)
                parts.append(
                    PlannedSegment(
                        segment=name,
                        entry_ns=clock_ns,
                        exit_ns=end_ns,
                        speed_mps=segment.speed_limit_mps,
                        platoon="east-1" if together else None,
                        place=(0 if vehicle == "van-a" else 1) if together else None,
                        gap_m=8.0 if together and vehicle == "van-b" else None,
                        leg=leg,
                    )
                )
                clock_ns = end_ns
                energy_km += segment.length_m / 1000
            node = self.network.segments[names[-1]].end
            if node != "depot":
                stops.append(
                    PlannedStop(
                        stop=node, node=node, arrival_ns=clock_ns, departure_ns=clock_ns + 30 * S
                    )
                )
                clock_ns += 30 * S
        return VehiclePlan(
            vehicle=vehicle,
            cycle=cycle,
            issued_ns=time_ns,
            valid_until_ns=time_ns + 900 * S,
            depart_ns=time_ns + 10 * S,
            stops=tuple(stops),
            segments=tuple(parts),
            distance_m=energy_km * 1000,
            energy_kwh=0.118 * energy_km,
        )

    def cycle(self, number: int, time_ns: int = NOW_NS, status: str = "ok") -> CycleReport:
        """A dispatch cycle over both vans."""
        baseline = 1.71 + 0.05 * np.sin(number / 3)
        saved = 0.0 if status != "ok" else 0.071
        return CycleReport(
            cycle=number,
            started_ns=time_ns,
            wall_s=1.62,
            status=status,
            reason=None if status == "ok" else "no solver found a better plan",
            solver="exact",
            objective_kwh=1.583,
            variables=25,
            solvers=(
                SolverReport(
                    solver="exact",
                    status="optimal",
                    objective_kwh=1.583,
                    repaired=False,
                    wall_s=0.31,
                ),
                SolverReport(
                    solver="lc-qaoa",
                    status="feasible",
                    objective_kwh=1.583,
                    repaired=True,
                    p_feasible_raw=0.00024,
                    p_optimal_raw=0.0,
                    p_feasible_repaired=1.0,
                    qubits=25,
                    shots=4096,
                    wall_s=0.84,
                    backend="aer",
                    backend_kind="simulated",
                    fallback="job c1 still queued after 8.0 s",
                    two_qubit_depth=8,
                ),
            ),
            gates=(
                Gate(
                    segment="avenue_east", y_e=1, reason=None, age_s=0.6, speed_mps=15.0, open=True
                ),
                Gate(
                    segment="avenue_west",
                    y_e=0,
                    reason="turbulent",
                    age_s=0.8,
                    speed_mps=7.0,
                    open=False,
                ),
            ),
            energy=EnergySummary(
                baseline="each van alone on its cheapest route",
                baseline_kwh=baseline,
                cooperative_kwh=baseline - saved,
                saved_distance_kwh=0.0,
                saved_drag_kwh=saved,
                saved_acceleration_kwh=0.0,
                platooned_distance_m=1996.0 * 2,
            ),
            plans=2,
        )

    def dispatcher(self, time_ns: int = NOW_NS) -> DispatcherHealth:
        """A dispatcher that is well, 18 s before its next cycle."""
        return DispatcherHealth(
            time_ns=time_ns,
            started_ns=time_ns - 600 * S,
            cycles=20,
            cycles_failed=0,
            states_received=1200,
            bad_messages=0,
            next_cycle_ns=time_ns + 18 * S,
            rss_mb=240.0,
        )

    def jpeg(self, shade: int = 120, shift: int = 0) -> bytes:
        """A picture of a road with boxes on it."""
        image = np.full((270, 480, 3), shade, dtype=np.uint8)
        cv2.fillPoly(image, [np.array([[180, 40], [300, 40], [460, 270], [20, 270]])], (95, 90, 88))
        for lane in range(3):
            y = 60 + 60 * lane + shift % 50
            x = 170 + 40 * lane
            cv2.rectangle(image, (x, y), (x + 40, y + 28), (60, 200, 60), 2)
        encoded, data = cv2.imencode(".jpg", image)
        assert encoded
        return bytes(data.tobytes())


class Sender:
    """Publishes a world's messages over a bus, each kind under its own key."""

    def __init__(self, bus: Bus, world: World) -> None:
        self._bus = bus
        self._world = world
        self._publishers: dict[str, object] = {}

    def put(self, key: str, message: object, *, best_effort: bool = False) -> None:
        """Publish under a key."""
        if key not in self._publishers:
            self._publishers[key] = self._bus.publisher(key, best_effort=best_effort)
        self._publishers[key].put(message)  # type: ignore[attr-defined]

    def put_all(self, now_ns: int, cycle: int, tick: int = 0) -> None:
        """Publish one second of the demo: the eastbound avenue stable, the westbound turbulent."""
        world = self._world
        for segment, y_e, speed in (("avenue_east", 1, 15.3), ("avenue_west", 0, 7.1)):
            state = world.state(segment, now_ns, y_e, speed_mps=speed)
            self.put(state_key(state.rsu, segment), state)
            self.put(rsu_health_key(state.rsu), world.health(segment, now_ns))
            self.put(preview_key(state.rsu), world.jpeg(150, tick * 7), best_effort=True)
        self.put(DISPATCHER_HEALTH_KEY, world.dispatcher(now_ns))
        if tick == 0:
            self.put(CYCLE_KEY, world.cycle(cycle, now_ns))
            for vehicle in ROUTES:
                self.put(plan_key(vehicle), world.plan(vehicle, cycle, now_ns))


@pytest.fixture(scope="session")
def world() -> World:
    """The demo network's messages."""
    return World(load_network("demo"))


@pytest.fixture
def make_sender() -> type[Sender]:
    """The class that publishes a world on a bus."""
    return Sender


@pytest.fixture
def now_ns() -> int:
    """The moment that the world's messages are from, UTC ns."""
    return NOW_NS
