"""One running SUMO simulation, read around an RSU."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Final

import libsumo
import numpy as np
from libsumo import constants

from slipstream.errors import InputError
from slipstream_lab.simulation.sumo.session import SumoSession
from slipstream_lab.simulation.sumo_view.polylines import distances
from slipstream_lab.simulation.sumo_view.shapes import Kind, is_known
from slipstream_lab.simulation.sumo_view.traffic import STEP_S, State, ViewedVehicle, between

_PLACE: Final = "slipstream-rsu"
_VARIABLES: Final = (
    constants.VAR_POSITION,
    constants.VAR_ANGLE,
    constants.VAR_SPEED,
    constants.VAR_ACCELERATION,
    constants.VAR_LANE_ID,
)


class SumoViewWorld:
    """A simulation as a context manager: `with World(...) as world`.

    Raises:
        InputError: SUMO refuses a file.
        RuntimeError: a simulation already runs in this process.
    """

    def __init__(
        self,
        net: Path,
        routes: tuple[Path, ...],
        additional: tuple[Path, ...],
        seed: int,
        start_s: float = 0.0,
    ) -> None:
        self._routes = ", ".join(map(str, routes))
        options = [
            *("--net-file", str(net), "--route-files", ",".join(map(str, routes))),
            *(("--additional-files", ",".join(map(str, additional))) if additional else ()),
            *("--begin", f"{start_s:g}"),
            *("--step-length", str(STEP_S), "--step-method.ballistic", "true"),
            # Without a duration vehicles jump sideways from lane to lane.
            *("--lanechange.duration", "2.5"),
            *("--seed", str(seed), "--xml-validation", "never"),
            *("--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true"),
        ]
        self._session = SumoSession(options, (net, *routes, *additional))
        self._kinds: dict[str, Kind] = {}
        self._stretch: dict[str, float] = {}

    def __enter__(self) -> SumoViewWorld:
        self._session.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._session.__exit__(kind, error, traceback)

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self._session.time_s

    def advance(self, until_s: float | None = None) -> None:
        """Move by one step, or by steps until a time. Raises InputError: SUMO refuses a vehicle or
        a route.
        """
        self._session.advance(until_s)

    def require_vehicles(self) -> None:
        """Make sure that there is something to see. Raises InputError: no vehicle drives, and none
        is due.
        """
        if libsumo.simulation.getMinExpectedNumber() == 0:
            raise InputError(
                self._routes,
                f"no vehicle drives at {self.time_s:g} s or soon after",
                "give another begin, or a route file with vehicles",
            )

    def subscribe_around(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Ask for the vehicles around a point of the net from now on."""
        libsumo.poi.add(_PLACE, x_m, y_m, (0, 0, 0, 0))
        libsumo.poi.subscribeContext(
            _PLACE, constants.CMD_GET_VEHICLE_VARIABLE, radius_m, list(_VARIABLES)
        )

    def vehicles(self) -> dict[str, State]:
        """The vehicles around the point, by SUMO's ids in a fixed order."""
        around = libsumo.poi.getContextSubscriptionResults(_PLACE)
        states = {}
        for name in sorted(around):
            values = around[name]
            x, y = values[constants.VAR_POSITION]
            if not math.isfinite(x) or abs(x) > 1e9:  # not on the road yet
                continue
            ratio = self._over_ground(values[constants.VAR_LANE_ID])
            states[name] = State(
                float(x),
                float(y),
                math.radians(90.0 - values[constants.VAR_ANGLE]),
                float(values[constants.VAR_SPEED]) * ratio,
                float(values[constants.VAR_ACCELERATION]) * ratio,
            )
        return states

    def kind(self, name: str) -> Kind:
        """What kind of vehicle it is; it must be on the road. Raises InputError: a vehicle class
        that has no shape.
        """
        if name not in self._kinds:
            vclass = libsumo.vehicle.getVehicleClass(name)
            if not is_known(vclass):
                raise InputError(
                    self._routes,
                    f"a vehicle of class {vclass!r} cannot be drawn",
                    "use passenger, delivery, truck, trailer, bus or motorcycle",
                    key=name,
                )
            self._kinds[name] = Kind(
                vclass,
                float(libsumo.vehicle.getLength(name)),
                float(libsumo.vehicle.getWidth(name)),
            )
        return self._kinds[name]

    def _over_ground(self, lane: str) -> float:
        if lane not in self._stretch:
            shape = np.array(libsumo.lane.getShape(lane)) if lane else np.zeros((0, 2))
            drawn = float(distances(shape)[-1]) if len(shape) > 1 else 0.0
            self._stretch[lane] = drawn / libsumo.lane.getLength(lane) if drawn > 1.0 else 1.0
        return self._stretch[lane]


def drive(
    world: SumoViewWorld, begin_s: float, fps: float, frames: int
) -> Iterator[list[ViewedVehicle]]:
    """The vehicles around the world's point in each frame; the first frame is at `begin_s`. Raises
    InputError: SUMO refuses a vehicle or a route, or a vehicle's class has no shape.
    """
    numbers: dict[str, int] = {}
    start_s = round(begin_s / STEP_S) * STEP_S
    world.advance(max(start_s, STEP_S))
    world.require_vehicles()
    step = 0
    before = world.vehicles()
    kinds = {name: world.kind(name) for name in before}
    after = before
    for frame in range(frames):
        # In thousandths of a step, so that no rounding puts a frame before its own step.
        due, rest = divmod(round(frame / fps / STEP_S * 1000), 1000)
        while step < due + (rest > 0):
            world.advance()
            before, after = after, world.vehicles()
            kinds.update({name: world.kind(name) for name in after if name not in kinds})
            step += 1
        elapsed_s = rest / 1000 * STEP_S
        # A frame on a step needs that step alone; others lie between the last two.
        now = (
            after
            if rest == 0
            else {
                name: between(state, after[name], elapsed_s)
                for name, state in before.items()
                if name in after
            }
        )
        yield [
            _vehicle(numbers.setdefault(name, len(numbers) + 1), kinds[name], state)
            for name, state in now.items()
        ]


def _vehicle(number: int, kind: Kind, state: State) -> ViewedVehicle:
    back = kind.length_m / 2
    return ViewedVehicle(
        number,
        kind,
        state.x_m - back * math.cos(state.heading_rad),
        state.y_m - back * math.sin(state.heading_rad),
        state.heading_rad,
        state.speed_mps,
        state.acceleration_mps2,
    )
