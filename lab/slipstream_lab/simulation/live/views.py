"""What each camera has before it in the running simulation."""

from __future__ import annotations

import math
from typing import Final

import libsumo

from slipstream_lab.simulation.sumo_view import Kind, Pose, ViewedVehicle, is_known

RADIUS_M: Final = 320.0
_LOOKS: Final = 64
"""Vehicles of a kind that look differently: a camera keeps the shape of each one."""


class Views:
    """Vehicles around cameras, read once for all of them.

    Vehicles of a kind look like one of 64, by the order in which they come into any view; one of a
    class that has no shape is left out.
    """

    def __init__(self, poses: list[Pose]) -> None:
        self._poses = poses
        self._kinds: dict[str, Kind] = {}
        self._numbers: dict[str, int] = {}
        self._kind_numbers: dict[Kind, int] = {}
        self._seen = 0

    def vehicles_in_view(self) -> list[list[ViewedVehicle]]:
        """The vehicles around each camera after the last step, in the cameras' order."""
        scenes: list[list[ViewedVehicle]] = [[] for _ in self._poses]
        present = libsumo.vehicle.getIDList()
        for name in present:
            x, y = libsumo.vehicle.getPosition(name)
            near = [
                i
                for i, pose in enumerate(self._poses)
                if abs(x - pose.x_m) < RADIUS_M and abs(y - pose.y_m) < RADIUS_M
            ]
            if near and self._is_drawn(name):
                vehicle = self._vehicle(name, x, y)
                for i in near:
                    scenes[i].append(vehicle)
        if len(self._kinds) > 2 * len(present) + 100:
            gone = self._kinds.keys() - set(present)
            for name in gone:
                del self._kinds[name]
                self._numbers.pop(name, None)
        return scenes

    def _is_drawn(self, name: str) -> bool:
        if name not in self._kinds:
            kind = Kind(
                libsumo.vehicle.getVehicleClass(name),
                float(libsumo.vehicle.getLength(name)),
                float(libsumo.vehicle.getWidth(name)),
            )
            self._kinds[name] = kind
            if is_known(kind.vclass):
                group = self._kind_numbers.setdefault(kind, len(self._kind_numbers))
                self._numbers[name] = _LOOKS * group + self._seen % _LOOKS
                self._seen += 1
        return name in self._numbers

    def _vehicle(self, name: str, x_m: float, y_m: float) -> ViewedVehicle:
        kind = self._kinds[name]
        heading = math.radians(90.0 - libsumo.vehicle.getAngle(name))
        back = kind.length_m / 2
        return ViewedVehicle(
            self._numbers[name],
            kind,
            x_m - back * math.cos(heading),
            y_m - back * math.sin(heading),
            heading,
            float(libsumo.vehicle.getSpeed(name)),
            float(libsumo.vehicle.getAcceleration(name)),
        )
