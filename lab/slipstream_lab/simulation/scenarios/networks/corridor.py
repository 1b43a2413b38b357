"""A motorway corridor, generated: two carriageways, diamond interchanges every few kilometres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Final

from pydantic import Field

from slipstream.config import Settings
from slipstream.errors import InputError
from slipstream_lab.simulation.scenarios.networks.plan import (
    Junction,
    NetworkPlan,
    PlannedRoad,
    Turn,
)

_MEDIAN_M: Final = 12.0
"""From the middle of the motorway to a carriageway's."""
_TERMINAL_M: Final = 250.0
_TOWN_M: Final = 1250.0
_MARGIN_M: Final = 300.0


class CorridorSettings(Settings):
    """Shape of the corridor."""

    length_m: Annotated[float, Field(ge=3000, le=200_000)] = 40_000.0
    spacing_m: Annotated[float, Field(ge=2500, le=20_000)] = Field(
        default=4000.0, description="Between interchanges; the first lies half of it from the end."
    )
    lanes: Annotated[int, Field(ge=2, le=4)] = 2
    speed_mps: Annotated[float, Field(gt=0, le=45)] = 30.0
    ramp_speed_mps: Annotated[float, Field(gt=0, le=45)] = 20.0
    street_speed_mps: Annotated[float, Field(gt=0, le=45)] = 13.9
    deceleration_lane_m: Annotated[float, Field(ge=100, le=1000)] = Field(
        default=250.0, description="Extra lane before an off-ramp."
    )
    ramp_spacing_m: Annotated[float, Field(ge=300, le=2000)] = Field(
        default=600.0, description="From an interchange's off-ramp to its on-ramp."
    )
    acceleration_lane_m: Annotated[float, Field(ge=100, le=1000)] = Field(
        default=350.0, description="Extra lane behind an on-ramp."
    )


def corridor_plan(settings: CorridorSettings) -> NetworkPlan:
    """The plan of a corridor.

    Eastbound segments of interchange k are ``e{k}_leave`` (with the lane of the off-ramp),
    ``e{k}_mid``, ``e{k}_join`` (with the lane of the on-ramp) and ``e{k}_main`` to the next one,
    ``e0_main`` leads in; westbound ones begin with ``w``, counted in their own direction. Ramps end
    at signals, ``s{k}`` south and ``n{k}`` north; towns lie behind, ``ts{k}`` and ``tn{k}``. From a
    ramp traffic turns right or left, not straight on to the next ramp.

    Raises:
        InputError: interchanges do not fit between each other.
    """
    centres = _centres(settings)
    junctions = [
        Junction("west", 0.0, 0.0, "gateway"),
        Junction("east", settings.length_m, 0.0, "gateway"),
    ]
    roads: list[PlannedRoad] = []
    turns: list[Turn] = []
    for way in ("e", "w"):
        for part in _carriageway(settings, way, centres):
            if isinstance(part, Junction):
                junctions.append(part)
            elif isinstance(part, PlannedRoad):
                roads.append(part)
            else:
                turns.append(part)
    for k, x in enumerate(centres, start=1):
        junctions += [
            Junction(f"s{k}", x, -_TERMINAL_M, "signals"),
            Junction(f"n{k}", x, _TERMINAL_M, "signals"),
            Junction(f"ts{k}", x, -_TOWN_M, "gateway"),
            Junction(f"tn{k}", x, _TOWN_M, "gateway"),
        ]
        for a, b in ((f"s{k}", f"n{k}"), (f"s{k}", f"ts{k}"), (f"n{k}", f"tn{k}")):
            roads += [
                PlannedRoad(f"{i}-{j}", i, j, 2, settings.street_speed_mps, 2, f"Road {k}")
                for i, j in ((a, b), (b, a))
            ]
    plan = NetworkPlan("corridor", tuple(junctions), tuple(roads), tuple(turns))
    plan.check("corridor")
    return plan


def _centres(settings: CorridorSettings) -> list[float]:
    count = int(settings.length_m // settings.spacing_m)
    needed = (
        settings.ramp_spacing_m
        + settings.deceleration_lane_m
        + settings.acceleration_lane_m
        + _MARGIN_M
    )
    if count < 1 or needed > settings.spacing_m:
        raise InputError(
            "corridor",
            f"{count} interchanges of {needed:g} m do not fit {settings.length_m:g} m",
            "give a longer corridor, more spacing_m, or shorter lanes",
            key="spacing_m",
        )
    first = (settings.length_m - (count - 1) * settings.spacing_m) / 2
    return [first + k * settings.spacing_m for k in range(count)]


def _carriageway(
    settings: CorridorSettings, way: str, centres: list[float]
) -> Iterator[Junction | PlannedRoad | Turn]:
    """One direction: everything is laid out along its own driving direction, then mirrored."""
    east = way == "e"
    side = -1.0 if east else 1.0
    lanes = settings.lanes
    along = centres if east else [settings.length_m - x for x in reversed(centres)]
    label = "eastbound" if east else "westbound"

    def junction(name: str, at: float) -> Junction:
        x = at if east else settings.length_m - at
        return Junction(name, x, side * _MEDIAN_M, "priority")

    def motorway(name: str, start: str, end: str, count: int) -> PlannedRoad:
        return PlannedRoad(name, start, end, count, settings.speed_mps, 5, f"Motorway {label}")

    before, gate = ("west", "east") if east else ("east", "west")
    previous = f"{way}0_main"
    for k, x in enumerate(along, start=1):
        number = k if east else len(along) + 1 - k
        terminal = f"{'s' if east else 'n'}{number}"
        leave, mid, join, main = (f"{way}{k}_{part}" for part in ("leave", "mid", "join", "main"))
        off, on = f"{way}{k}_off", f"{way}{k}_on"
        half = settings.ramp_spacing_m / 2
        a, b, c, d = (f"{way}{k}{letter}" for letter in "abcd")
        yield junction(a, x - half - settings.deceleration_lane_m)
        yield junction(b, x - half)
        yield junction(c, x + half)
        yield junction(d, x + half + settings.acceleration_lane_m)
        yield motorway(previous, before, a, lanes)
        yield motorway(leave, a, b, lanes + 1)
        yield motorway(mid, b, c, lanes)
        yield motorway(join, c, d, lanes + 1)
        # Two lanes in front of the signals let an off-ramp's queue through.
        for name, start, end, count in ((off, b, terminal, 2), (on, terminal, c, 1)):
            street = f"Ramp {number} {label}"
            yield PlannedRoad(name, start, end, count, settings.ramp_speed_mps, 3, street)
        # The extra lane is the right one: it begins beside the others, and ends without a way on.
        yield Turn(previous, leave, 0, 0)
        for lane in range(lanes):
            yield Turn(previous, leave, lane, lane + 1)
            yield Turn(leave, mid, lane + 1, lane)
            yield Turn(mid, join, lane, lane + 1)
            yield Turn(join, main, lane + 1, lane)
        # Ramps leave and join the motorway at a tangent; as drawn here they have a kink, which
        # would be taken for a bend of 8 to 10 m/s.
        yield Turn(leave, off, 0, 0, settings.ramp_speed_mps)
        yield Turn(leave, off, 0, 1, settings.ramp_speed_mps)
        yield Turn(on, join, 0, 0, settings.ramp_speed_mps)
        # Nor straight on to the on-ramp: that would be a way along the motorway by its exits.
        town, across = (f"t{terminal}", f"n{number}" if east else f"s{number}")
        yield Turn(off, f"{terminal}-{town}", 0, 0)
        yield Turn(off, f"{terminal}-{across}", 1, 1)
        before, previous = d, main
    yield motorway(previous, before, gate, lanes)
