"""What the operator's map is fed with: networks and moments in the form of the page's requests."""

from __future__ import annotations

import gzip
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network

TROY = (
    Path(__file__).parents[4] / "lab/slipstream_lab/simulation/scenarios/data/troy/troy.net.xml.gz"
)
T_MS = 1_795_000_000_000
FLAGS = ("stable", "turbulent", "unknown")


def troy() -> dict[str, Any]:
    """Troy with its street names and three depots."""
    root = ElementTree.fromstring(gzip.decompress(TROY.read_bytes()))
    names = {edge.get("id", ""): edge.get("name") for edge in root.iter("edge")}
    return network_json(load_network(TROY), names, depots=3)


def network_json(
    network: RoadNetwork, names: Mapping[str, str | None], depots: int
) -> dict[str, Any]:
    """The answer of /api/network, and beside it what follows what, as road indices."""
    index = {name: number for number, name in enumerate(network.segments)}
    places = list(network.junctions.values())
    x0, y0, x1, y1 = network.bounds_m()
    return {
        "id": network.name,
        "bounds": [x0, y0, x1, y1],
        "origin": None,
        "roads": [
            {
                "id": road.id,
                "name": names.get(road.id),
                "shape": [value for point in road.shape for value in point],
                "length_m": road.length_m,
                "limit_kmh": road.speed_limit_mps * 3.6,
                "lanes": road.lanes,
            }
            for road in network.segments.values()
        ],
        "depots": [
            {"id": f"depot-{number}", "x": places[at][0], "y": places[at][1]}
            for number, at in enumerate(
                np.linspace(0, len(places) - 1, depots + 2).astype(int).tolist()[1:-1]
            )
        ],
        "follows": [[index[f] for f in network.follows[name]] for name in network.segments],
    }


def moment(
    network: dict[str, Any],
    vehicles: int,
    watched: int,
    rsus: int = 0,
    orders: int = 0,
    seed: int = 1,
) -> dict[str, Any]:
    """A moment of the page: vehicles on drives of 40 roads, a third of them placed by plan."""
    rng = np.random.default_rng(seed)
    roads = network["roads"]
    chosen = [int(i) for i in rng.choice(len(roads), watched, replace=False)]
    rsu_ids = [f"rsu-{number:02}" for number in range(rsus)]
    road_rows = {
        roads[i]["id"]: {
            "flag": FLAGS[n % 3],
            "why": None if n % 3 == 0 else "too few vehicles to tell",
            "kmh": 40.0,
            "gate": "open" if n % 3 == 0 else "closed",
            "gate_why": None,
            "rsu": rsu_ids[n % rsus] if rsus else None,
            "stopped": 0,
            "level": "ok",
        }
        for n, i in enumerate(chosen)
    }
    is_open = {i for n, i in enumerate(chosen) if n % 3 == 0}
    vehicle_rows = {
        f"van-{number:03}": _vehicle(network, rng, number, is_open)
        for number in range(1, vehicles + 1)
    }
    return {
        "t": T_MS,
        "vehicles": vehicle_rows,
        "roads": road_rows,
        "rsus": {name: _rsu(network, chosen[n::rsus], n) for n, name in enumerate(rsu_ids)},
        "orders": {
            f"order-{number}": _order(network, rng, number, vehicles) for number in range(orders)
        },
    }


def _vehicle(
    network: dict[str, Any], rng: np.random.Generator, number: int, is_open: set[int]
) -> dict[str, Any]:
    roads, follows = network["roads"], network["follows"]
    route = [int(rng.integers(len(roads)))]
    while len(route) < 40 and follows[route[-1]]:
        route.append(int(rng.choice(follows[route[-1]])))
    at = min(len(route) - 1, int(rng.integers(12)))
    shape = roads[route[at]]["shape"]
    part = float(rng.uniform(0.1, 0.9))
    x, y = (shape[i] + part * (shape[i + 2] - shape[i]) for i in (0, 1))
    heading = math.degrees(math.atan2(shape[2] - shape[0], shape[3] - shape[1])) % 360
    state = ("driving", "driving", "driving", "stopped", "waiting")[number % 5]
    return {
        "x": x,
        "y": y,
        "heading": heading,
        "source": "planned" if number % 3 == 0 else "reported",
        "state": state,
        "text": "drives to its next stop" if state == "driving" else state,
        "road": roads[route[at]]["id"],
        "platoon": None,
        "place": None,
        "with": [],
        "level": "bad" if number % 17 == 0 else "ok",
        "route": [[road, 1 if road in is_open else 0] for road in route],
        "at": at,
        "colour": number % 12,
    }


def _rsu(network: dict[str, Any], watched: list[int], number: int) -> dict[str, Any]:
    shape = network["roads"][watched[0]]["shape"]
    return {
        "x": (shape[0] + shape[-2]) / 2 + 6,
        "y": (shape[1] + shape[-1]) / 2 + 6,
        "status": "ok",
        "level": ("ok", "ok", "ok", "warn", "ok", "bad", "idle")[number % 7],
        "why": None,
        "fps": 29.9,
        "segments": [network["roads"][i]["id"] for i in watched],
    }


def _order(
    network: dict[str, Any], rng: np.random.Generator, number: int, vehicles: int
) -> dict[str, Any]:
    shape = network["roads"][int(rng.integers(len(network["roads"])))]["shape"]
    return {
        "state": "failed"
        if number % 50 == 4
        else ("planned", "under_way", "open", "served")[number % 4],
        "level": "bad" if number % 50 == 4 else "ok",
        "x": shape[-2],
        "y": shape[-1],
        "vehicle": f"van-{1 + number % vehicles:03}" if vehicles else None,
        "eta": T_MS + 60_000 * number,
        "late_s": None,
        "why": None,
    }
