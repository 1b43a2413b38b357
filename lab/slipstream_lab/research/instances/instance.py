"""Instances: a routing problem with one moment's traffic, read from a file and written to one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import tomli_w

from dispatcher_daemon.fleet import check_fleet
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.config import check, read_data
from slipstream.energy.drive import DrivingStyle
from slipstream.errors import InputError
from slipstream.files import ending_of
from slipstream_lab.research.instances.schema import (
    FORMAT,
    InstanceFile,
    OptimumTable,
    RouteRow,
    StyleTable,
)
from slipstream_lab.research.instances.tables import (
    first_twice,
    network_of,
    network_table,
    snapshot_of,
    traffic_table,
)


@dataclass(frozen=True)
class Optimum:
    """The best solution known. `routes`: stops in order, by vehicle; a vehicle that stays at its
    depot has none.
    """

    form: Literal["arc", "route"]
    objective_kwh: float
    proven: bool
    method: str
    routes: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Instance:
    """A routing problem in the traffic of one moment."""

    name: str
    problem: RoutingProblem
    snapshot: TrafficSnapshot
    provenance: str = ""
    optimum: Optimum | None = None
    sync_window_s: float = 3.0
    energy_optimum: Optimum | None = None

    @property
    def known(self) -> Optimum | None:
        """What is known by the problem's objective."""
        return self.optimum if self.problem.objective == "paper" else self.energy_optimum

    def under(self, objective: Literal["paper", "energy"]) -> Instance:
        """The same roads, fleet and traffic under an objective."""
        return replace(self, problem=replace(self.problem, objective=objective))


_LATER: Final = ("recuperation_efficiency", "vehicle_types", "charging_stops", "hubs", "time_zone")
"""Fields that files have where they differ from the default."""


def load_instance(path: str | Path) -> Instance:
    """Read an instance from a JSON or TOML file.

    Raises:
        InputError: naming file, key and mend: the file is missing or malformed, has a number that
            is not finite or out of range, an id twice, or a reference to something unknown. Stops
            that no vehicle can serve are no error: see `planning.routes.servability`.
    """
    path = Path(path)
    return instance_from(read_data(path), path)


def instance_from(data: object, source: str | Path) -> Instance:
    """Check plain data as an instance; errors as in `load_instance`. `source`: what errors name;
    the path of a SUMO net counts from its folder.
    """
    if isinstance(data, Mapping) and "matrix" in data:
        mend = "take `slipstream solve --instance`, or give a network"
        raise InputError(source, "matrices instead of roads", mend, key="matrix")
    file = check(data, InstanceFile, source)
    network = network_of(file.network, file.name, source)
    check_fleet(file.fleet, network, source, "fleet.")
    problem = RoutingProblem(
        network,
        file.fleet,
        file.vehicle,
        DrivingStyle(**dict(file.style)),
        objective=file.objective,
    )
    return Instance(
        file.name,
        problem,
        snapshot_of(file.traffic, network, source),
        file.provenance,
        _optimum(file, file.optimum, source, "optimum"),
        file.sync_window_s,
        _optimum(file, file.energy_optimum, source, "energy_optimum"),
    )


def write_instance(instance: Instance, path: str | Path) -> None:
    """Write an instance as JSON or TOML, by the path's suffix; read back it is equal.

    The roads are written out, without the ways through junctions and the projection. The states of
    RSUs that a snapshot was made from are not kept.

    Raises:
        InputError: the suffix is another one.
        ValueError: a gate is open without y_e = 1, or closed without a reason.
    """
    path = Path(path)
    ending = ending_of(path)
    if ending not in (".json", ".toml"):
        raise InputError(path, "neither .json nor .toml", "rename it")
    data = _plain(instance)
    text = _as_json(data) if ending == ".json" else tomli_w.dumps(data)
    path.write_text(text, encoding="utf-8")


def instance_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of instance files."""
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, **InstanceFile.model_json_schema()}


def _optimum(
    file: InstanceFile, table: OptimumTable | None, source: str | Path, name: str
) -> Optimum | None:
    if table is None:
        return None
    vehicles = {vehicle.id for vehicle in file.fleet.vehicles}
    repeated = first_twice(row.vehicle for row in table.routes)
    for row in table.routes:
        key = f"{name}.routes.{row.vehicle}"
        unknown = next((stop for stop in row.stops if stop not in file.fleet.stop_by_id), None)
        if row.vehicle not in vehicles:
            raise InputError(source, "unknown vehicle", "name one of the fleet", key=key)
        if row.vehicle == repeated:
            raise InputError(source, "two routes of this vehicle", "remove one", key=key)
        if unknown is not None:
            raise InputError(source, f"no stop {unknown!r}", "name one of the stops", key=key)
    routes = {row.vehicle: row.stops for row in table.routes}
    return Optimum(table.form, table.objective_kwh, table.proven, table.method, routes)


def _plain(instance: Instance) -> dict[str, Any]:
    problem = instance.problem
    file = InstanceFile(
        format=FORMAT,
        name=instance.name,
        provenance=instance.provenance,
        sync_window_s=instance.sync_window_s,
        network=network_table(problem.network),
        fleet=problem.fleet,
        traffic=traffic_table(instance.snapshot, problem.network),
        vehicle=problem.vehicle,
        style=StyleTable(**asdict(problem.style)),
        objective=problem.objective,
        optimum=_table(instance.optimum),
        energy_optimum=_table(instance.energy_optimum),
    )
    data: dict[str, Any] = json.loads(file.model_dump_json(exclude_none=True))
    brief = json.loads(file.model_dump_json(exclude_none=True, exclude_defaults=True))
    # Thousands of rows: what they leave out is in the schema. All else is said, but for fields that
    # the format got after files of it were published.
    for table, later in (
        (data["vehicle"], brief.get("vehicle", {})),
        (data["fleet"], brief["fleet"]),
    ):
        for key in _LATER:
            if key not in later:
                table.pop(key, None)
    for table in ("stops", "vehicles"):
        for row, given in zip(data["fleet"][table], brief["fleet"][table], strict=True):
            for key in ("mass_kg", "skills", "breaks"):
                if key not in given:
                    row.pop(key, None)
    if "objective" not in brief:
        del data["objective"]
    return {**data, "network": brief["network"], "traffic": brief.get("traffic", {})}


def _table(optimum: Optimum | None) -> OptimumTable | None:
    if optimum is None:
        return None
    return OptimumTable(
        form=optimum.form,
        objective_kwh=optimum.objective_kwh,
        proven=optimum.proven,
        method=optimum.method,
        routes=tuple(RouteRow(vehicle=v, stops=s) for v, s in optimum.routes.items()),
    )


def _as_json(data: Mapping[str, Any]) -> str:
    """JSON with a line for each row of a list of tables."""

    def lines(value: object, indent: str) -> str:
        deeper = indent + "  "
        if isinstance(value, Mapping) and any(isinstance(v, dict | list) for v in value.values()):
            parts = [f"{json.dumps(k)}: {lines(v, deeper)}" for k, v in value.items()]
            return _bracketed("{}", parts, indent)
        if isinstance(value, list) and any(isinstance(v, dict) for v in value):
            return _bracketed("[]", [json.dumps(v, ensure_ascii=False) for v in value], indent)
        return json.dumps(value, ensure_ascii=False)

    return lines(data, "") + "\n"


def _bracketed(brackets: str, parts: list[str], indent: str) -> str:
    inner = ",\n".join(f"{indent}  {part}" for part in parts)
    return f"{brackets[0]}\n{inner}\n{indent}{brackets[1]}"
