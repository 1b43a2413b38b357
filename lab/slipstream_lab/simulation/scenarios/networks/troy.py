"""Troy's arterials: from the tables that the project ships to a plan of the network."""

from __future__ import annotations

import csv
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from slipstream.config import Settings, check
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream_lab.simulation.scenarios.networks.plan import (
    Control,
    Junction,
    NetworkPlan,
    PlannedRoad,
)

_PRIORITIES = {"freeway": 4, "bridge": 3, "arterial": 3, "collector": 2}


class TroyJunction(Settings):
    """A line of ``junctions.csv``; positions in degrees of WGS 84."""

    id: Identifier
    name: str
    lat_deg: Annotated[float, Field(ge=-90, le=90)]
    lon_deg: Annotated[float, Field(ge=-180, le=180)]
    control: Control
    position: Literal["published", "estimated"]


class RoadRow(Settings):
    """A line of ``roads.csv``: lanes are those of one direction."""

    start: Identifier = Field(alias="from")
    end: Identifier = Field(alias="to")
    street: str
    road_class: Literal["freeway", "bridge", "arterial", "collector"] = Field(alias="class")
    lanes: Annotated[int, Field(ge=1, le=6)]
    speed_limit_mps: Annotated[float, Field(gt=0, le=60)]
    one_way: Literal[0, 1]


def troy_plan(folder: Path | None = None) -> NetworkPlan:
    """Troy as the project ships it, or another place whose tables have the same form. Raises
    InputError: a table is missing, malformed or does not fit the other one.
    """
    if folder is None:
        folder = Path(str(resources.files("slipstream_lab.simulation.scenarios") / "data" / "troy"))
    places, roads_csv = folder / "junctions.csv", folder / "roads.csv"
    junctions = tuple(
        Junction(row.id, row.lon_deg, row.lat_deg, row.control)
        for row in (check(_numbers(cells), TroyJunction, where) for where, cells in _rows(places))
    )
    roads = tuple(
        road
        for where, cells in _rows(roads_csv)
        for road in _directions(check(_numbers(cells), RoadRow, where))
    )
    plan = NetworkPlan(
        "troy" if folder.name == "troy" else folder.name, junctions, roads, geographic=True
    )
    plan.check(folder)
    return plan


def _directions(row: RoadRow) -> list[PlannedRoad]:
    ends = [(row.start, row.end)] + ([] if row.one_way else [(row.end, row.start)])
    return [
        PlannedRoad(
            f"{start}-{end}",
            start,
            end,
            row.lanes,
            row.speed_limit_mps,
            _PRIORITIES[row.road_class],
            row.street,
        )
        for start, end in ends
    ]


def _rows(path: Path) -> list[tuple[str, dict[str, str]]]:
    """The rows of a table, each with its label for errors."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read ({error})", "give a CSV file") from None
    if not rows:
        raise InputError(path, "an empty table", "give a line for each")
    return [
        (f"{path}: line {line}", {str(k): str(v) for k, v in row.items() if v is not None})
        for line, row in enumerate(rows, start=2)
    ]


def _numbers(cells: dict[str, str]) -> dict[str, object]:
    """A row's cells, those that are numbers by their column as such."""
    numeric: dict[str, type[float] | type[int]] = {
        **dict.fromkeys(("lat_deg", "lon_deg", "speed_limit_mps"), float),
        **dict.fromkeys(("lanes", "one_way"), int),
    }
    plain: dict[str, object] = dict(cells)
    for key, kind in numeric.items():
        try:
            plain |= {key: kind(cells[key])} if key in cells else {}
        except ValueError:
            continue  # the check says what it should be
    return plain
