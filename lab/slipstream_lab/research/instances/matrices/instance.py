"""An instance with matrices instead of roads: read from a file, written to one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dispatcher_daemon.fleet import Fleet, check_fleet
from dispatcher_daemon.planning.roads import Floats, given_matrices
from slipstream.config import check
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream_lab.research.instances.matrices.schema import MatrixFile, MatrixTable, Measure

_UNITS: Mapping[Measure, str] = {"distance": "m", "duration": "s", "energy": "kWh"}


@dataclass(frozen=True)
class MatrixInstance:
    """A routing problem on given matrices."""

    file: MatrixFile
    network: RoadNetwork

    @property
    def name(self) -> str:
        """For people and tables."""
        return self.file.name

    @property
    def fleet(self) -> Fleet:
        """Depots, stops and vehicles; their nodes are places."""
        return self.file.fleet

    @property
    def minimise(self) -> Measure:
        """What routes minimise."""
        return self.file.matrix.minimise or self.file.matrix.known[0]

    def gap(self, cost: float) -> float | None:
        """By what share a cost is above the best known; None: there is none to compare with."""
        best = self.file.best_known
        return cost / best.cost - 1 if best is not None and best.comparable else None

    @property
    def unit(self) -> str:
        """Of what is minimised."""
        return _UNITS[self.minimise]

    @cached_property
    def straight_m(self) -> Floats:
        """Straight lines between the places, not rounded, shape (n, n)."""
        at = np.array([(place.x_m, place.y_m) for place in self.file.matrix.places])
        return np.asarray(np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)))

    @cached_property
    def measures(self) -> Mapping[Measure, Floats]:
        """What is known of ways, shape (n, n) each; durations are always known; inf in all of them
        where no way leads.
        """
        table = self.file.matrix
        distances, durations, energies = given_matrices(
            table.distances_m, table.durations_s, table.energy_kwh
        )
        found: dict[Measure, Floats] = {}
        if distances is not None:
            found["distance"] = distances
        elif table.euclidean is not None:
            found["distance"] = _rounded(self.straight_m, table)
        size = len(table.places)
        found["duration"] = np.zeros((size, size))
        if durations is not None:
            found["duration"] = durations
        elif table.speed_mps is not None:
            found["duration"] = found["distance"] / table.speed_mps
        if energies is not None:
            found["energy"] = energies
        blocked = np.any([np.isinf(values) for values in found.values()], axis=0)
        return {name: np.where(blocked, np.inf, values) for name, values in found.items()}

    @cached_property
    def row(self) -> dict[str, int]:
        """Row in the matrices by id of a depot or stop."""
        at = {place.id: i for i, place in enumerate(self.file.matrix.places)}
        fleet = self.fleet
        return {name: at[fleet.node(name)] for name in (*fleet.depot_by_id, *fleet.stop_by_id)}


def _rounded(straight_m: Floats, table: MatrixTable) -> Floats:
    if table.euclidean == "nearest":
        return np.floor(straight_m + 0.5)
    if table.euclidean == "tenths":
        # A root that is whole may come out just below it.
        return np.floor(10 * straight_m + 1e-9) / 10
    return straight_m


def has_matrices(data: object) -> bool:
    """Whether plain data of an instance file has matrices instead of roads."""
    return isinstance(data, Mapping) and "matrix" in data


def matrix_instance_from(data: object, source: str | Path) -> MatrixInstance:
    """Check plain data as an instance with matrices. Raises InputError: naming file, key
    and mend; also what only roads can express.
    """
    file = check(data, MatrixFile, source)
    seen: set[str] = set()
    for place in file.matrix.places:
        if place.id in seen:
            key = f"matrix.places.{place.id}"
            raise InputError(source, "two places with this id", "remove one", key=key)
        seen.add(place.id)
    places = {place.id: (place.x_m, place.y_m) for place in file.matrix.places}
    network = RoadNetwork(file.name, {}, places)
    check_fleet(file.fleet, network, source, "fleet.")
    for name in ("charging_stops", "hubs", "vehicle_types"):
        if getattr(file.fleet, name):
            raise InputError(source, "needs roads", "remove it", key=f"fleet.{name}")
    for vehicle in file.fleet.vehicles:
        for name in ("type", "own_type", "charge_kwh", "first_stop"):
            if getattr(vehicle, name) is not None:
                key = f"fleet.vehicles.{vehicle.id}.{name}"
                raise InputError(source, "needs roads", "remove it", key=key)
    return MatrixInstance(file, network)


def write_matrix_instance(instance: MatrixInstance, path: Path) -> None:
    """Write an instance as JSON; read back it is equal. Raises InputError: the file cannot be
    written.
    """
    text = instance.file.model_dump_json(exclude_none=True, exclude_defaults=True)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n", encoding="utf-8")
    except OSError as error:
        mend = "give a folder that can be written"
        raise InputError(path, error.strerror or "not writable", mend) from None
