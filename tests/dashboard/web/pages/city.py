"""A made-up city in the shapes of docs/page.md: the same one for the same seed."""

from __future__ import annotations

import math
import random
from typing import Any

MINUTE = 60_000
HOUR = 60 * MINUTE
DAY = 24 * HOUR
T0 = 1_795_000_000_000
"""UTC ms of the first moment: 18 November 2026, 11:06:40."""

Row = dict[str, Any]
Tables = dict[str, dict[str, Row]]
STREETS = (
    "Mill Street",
    "Hoosick Street",
    "River Road",
    "Congress Street",
    "Fifth Avenue",
    "Dock Lane",
)


def network(roads: int = 1000) -> Row:
    """A grid of streets with some bends; each road is one direction of one block."""
    side = max(2, math.ceil(math.sqrt(roads / 4)) + 1)
    step = 150.0
    dice = random.Random(7)
    at = {
        (i, j): (i * step + dice.uniform(-25, 25), j * step + dice.uniform(-25, 25))
        for i in range(side)
        for j in range(side)
    }
    found: list[Row] = []
    for (i, j), (x, y) in at.items():
        for di, dj in ((1, 0), (0, 1)):
            end = at.get((i + di, j + dj))
            if end is None:
                continue
            middle = ((x + end[0]) / 2 + dice.uniform(-9, 9), (y + end[1]) / 2)
            shape = [x, y, *middle, *end]
            back = [*end, *middle, x, y]
            street = STREETS[(i if dj else j) % len(STREETS)]
            for way, points in (("a", shape), ("b", back)):
                found.append(
                    {
                        "id": f"e{i}-{j}{'h' if di else 'v'}{way}",
                        "name": f"{street} {(i if dj else j) + 1}",
                        "shape": [round(value, 1) for value in points],
                        "length_m": 150.0,
                        "limit_kmh": 50.0,
                        "lanes": 1,
                    }
                )
    extent = step * (side - 1)
    return {
        "id": "made-up",
        "bounds": [-40, -40, extent + 40, extent + 40],
        "origin": None,
        "roads": found[:roads],
        "depots": [{"id": "depot", "x": extent / 2, "y": extent / 2}],
    }


def moment(
    net: Row,
    t: int = T0,
    *,
    vans: int = 200,
    rsus: int = 50,
    orders: int = 1000,
    live: bool = True,
) -> Row:
    """The city at a time; some of it is in trouble."""
    dice = random.Random(11)
    roads = net["roads"]
    tables: Tables = {
        "vehicles": {f"van-{i}": van(i, roads, dice, t) for i in range(1, vans + 1)},
        "roads": {road["id"]: watched(i, rsus, dice, t) for i, road in enumerate(roads)},
        "rsus": {f"rsu-{i}": rsu(i, rsus, roads, dice, t) for i in range(1, rsus + 1)},
        "orders": {f"o-{i}": order(i, vans, dice, t) for i in range(1, orders + 1)},
        "cycles": {str(n): cycle(n, dice, t - (120 - n) * 30_000) for n in range(1, 121)},
        "alarms": alarms(t),
    }
    for i in range(1, vans - 1, 25):
        join(tables, f"van-{i}", f"van-{i + 1}", f"p-{i}")
    return {
        "t": t,
        "seq": 1,
        "live": live,
        **tables,
        "status": {
            "level": "bad",
            "text": "rsu-37 has no signal",
            "count": 3,
            "items": [
                {"subject": "rsu/rsu-12", "level": "warn", "text": "rsu-12: picture frozen"},
                {"subject": "rsu/rsu-37", "level": "bad", "text": "rsu-37 has no signal"},
                {"subject": "order/o-3", "level": "warn", "text": "o-3 will be 14 min late"},
            ],
        },
        "energy": {
            "today": energy(41.3),
            "week": energy(231.0),
            "total": energy(1904.0),
            "since": T0 - 40 * DAY,
            "last_cycle": energy(1.9),
        },
        "next_cycle": t + 21_000,
        "paused": False,
        "dispatcher_heard": True,
    }


def van(i: int, roads: list[Row], dice: random.Random, t: int) -> Row:
    """One vehicle on a route of a dozen roads; each twentieth is late, of each sixteen one was
    never heard, and one is silent.
    """
    first = dice.randrange(max(1, len(roads) - 13))
    at = dice.randrange(12)
    shape = roads[first + at]["shape"]
    late = 900.0 if i % 20 == 0 else dice.uniform(-60, 100)
    unheard, silent = i % 16 == 0, i % 16 == 8
    state = "driving" if i % 5 else "stopped"
    text = f"to o-{i}" if i % 5 else f"unloads at o-{i}"
    if unheard:
        state, text = "planned", f"by plan: drives to o-{i}, never heard"
    if silent:
        state, text = "silent", f"last: drives to o-{i}"
    return {
        "x": shape[2],
        "y": shape[3],
        "heading": round(dice.uniform(0, 359)),
        "source": "planned" if unheard else "last" if silent else "reported",
        "state": state,
        "text": text,
        "seen": t - 210_000 if silent else None,
        "road": roads[first + at]["id"],
        "platoon": None,
        "place": None,
        "with": [],
        "next": f"o-{i}",
        "eta": t + 6 * MINUTE,
        "delay_s": None if unheard or silent else round(late),
        "stops_left": 1 + i % 7,
        "level": "idle" if unheard else "bad" if silent else "warn" if late > 600 else "ok",
        "route": [[first + k, 0] for k in range(12)],
        "at": at,
        "colour": i % 12,
        "carrier": "north" if i % 2 else "south",
        "kwh": 4.2,
        "saved_kwh": round(dice.uniform(-0.1, 0.9), 2),
        "km": 18.4,
        "platoon_km": 2.1,
        "charge_kwh": None,
        "cycle": 120,
    }


def join(tables: Tables, leader: str, follower: str, platoon: str) -> None:
    """Two vans drive together."""
    for place, name in enumerate((leader, follower)):
        tables["vehicles"][name].update(platoon=platoon, place=place)
        tables["vehicles"][name]["with"] = [leader, follower]


def watched(i: int, rsus: int, dice: random.Random, t: int) -> Row:
    """One watched road; one in nine is turbulent, one in seventeen unknown."""
    flag = "turbulent" if i % 9 == 4 else "unknown" if i % 17 == 5 else "stable"
    return {
        "flag": flag,
        "why": {"turbulent": "acceleration varies", "unknown": "too few vehicles"}.get(flag),
        "kmh": None if flag == "unknown" else round(dice.uniform(12, 50)),
        "cv": None if flag == "unknown" else round(dice.uniform(0.05, 0.4), 2),
        "vehicles": dice.randrange(12),
        "gate": "open" if flag == "stable" else "closed",
        "gate_why": None if flag == "stable" else flag,
        "rsu": f"rsu-{i % rsus + 1}",
        "stopped": 1 if i == 40 else 0,
        "since": t - dice.randrange(HOUR),
        "level": "warn" if i == 40 else "ok",
    }


def rsu(i: int, rsus: int, roads: list[Row], dice: random.Random, t: int) -> Row:
    """One roadside unit; number 37 has no signal, number 12 a frozen picture."""
    bad, warn = i == 37, i == 12
    segments = [road["id"] for k, road in enumerate(roads) if k % rsus + 1 == i]
    shape = roads[(i * 17) % len(roads)]["shape"]
    return {
        "x": shape[0],
        "y": shape[1],
        "status": "lost" if bad else "degraded" if warn else "ok",
        "level": "bad" if bad else "warn" if warn else "ok",
        "why": "no signal" if bad else "picture frozen" if warn else None,
        "fps": 0.0 if bad else round(dice.uniform(24, 30), 1),
        "latency_ms": round(dice.uniform(15, 60)),
        "skipped_share": 0.001,
        "faults": ["frozen"] if warn else [],
        "segments": segments,
        "vehicles": dice.randrange(30),
        "seen": t - (90_000 if bad else 500),
        "picture": not bad,
    }


def order(i: int, vans: int, dice: random.Random, t: int) -> Row:
    """One order; number 3 will be late, number 5 could not be served."""
    state = ("under_way", "planned", "served", "open")[i % 4]
    late = i == 3
    if i == 5:
        state = "failed"
    earliest = t + dice.randrange(-60, 60) * MINUTE
    return {
        "state": state,
        "level": "bad" if i == 5 else "warn" if late else "idle" if state == "served" else "ok",
        "node": f"n{i}",
        "x": None,
        "y": None,
        "vehicle": None if state == "open" else f"van-{i % vans + 1}",
        "eta": None if state == "open" else earliest + 10 * MINUTE,
        "earliest": earliest,
        "latest": earliest + 30 * MINUTE,
        "late_s": 840 if late else None,
        "late_since": t - 14 * MINUTE if late else None,
        "silent_since": None,
        "pinned": i % 50 == 0,
        "source": "file",
        "why": "nobody at home" if i == 5 else "van-4 is delayed" if late else None,
        "since": t - 20 * MINUTE,
    }


def cycle(n: int, dice: random.Random, t: int) -> Row:
    """One cycle of the dispatcher; each fortieth kept the plans that were there."""
    idle = n % 40 == 0
    return {
        "t": t,
        "status": "fallback" if idle else "optimal",
        "level": "warn" if idle else "ok",
        "why": "deadline" if idle else None,
        "wall_s": round(dice.uniform(1, 9), 1),
        "plans": 200,
        "solver": "exact",
        "variables": 1840,
        "saved_kwh": round(dice.uniform(0.5, 3), 2),
        "saved_share": round(dice.uniform(0.01, 0.08), 3),
        "platoon_km": round(dice.uniform(5, 30), 1),
        "unserved": 1 if idle else 0,
    }


def alarms(t: int) -> dict[str, Row]:
    """Four alarms: one of each severity in force, and one that has ended."""

    def one(severity: str, subject: str, text: str, **more: object) -> Row:
        return {
            "severity": severity,
            "since": t - 25 * MINUTE,
            "subject": subject,
            "text": text,
            "mend": None,
            "ended": None,
            "by": None,
            "acknowledged": None,
            **more,
        }

    return {
        "a-1": one(
            "critical", "rsu/rsu-37", "rsu-37 has no signal", mend="Look at its power and network."
        ),
        "a-2": one("warning", "order/o-3", "o-3 will be 14 min late"),
        "a-3": one("info", "dispatcher", "a cycle took 9 s", by="kim", acknowledged=t - MINUTE),
        "a-4": one("warning", "rsu/rsu-8", "rsu-8 was dark", ended=t - 5 * MINUTE),
    }


def energy(saved: float) -> Row:
    """A sum in which acceleration costs a little."""
    return {
        "baseline": "each vehicle alone on its shortest way",
        "baseline_kwh": round(saved / 0.064, 2),
        "plan_kwh": round(saved / 0.064 - saved, 2),
        "saved_kwh": saved,
        "saved_share": 0.064,
        "distance_kwh": round(saved * 0.7, 3),
        "drag_kwh": round(saved * 0.38, 3),
        "acceleration_kwh": round(saved * -0.08, 3),
        "km": round(saved * 31, 1),
        "platoon_km": round(saved * 4, 1),
        "co2_kg": round(saved * 0.38, 2),
        "money": round(saved * 0.31, 2),
    }


def energy_rows(by: str, begin: int, end: int) -> list[Row]:
    """Sums of the hours or days in a time."""
    step = HOUR if by == "hour" else DAY
    times = range(-(-begin // step) * step, end, step)
    return [{"t": t, **energy(round(2 + math.sin(t / step), 3))} for t in times]


def card(table: str, key: str, row: Row | None, t: int) -> Row | None:
    """The details of a subject; None if there is no such."""
    if table == "roads":
        return {"id": key, **(row or {}), **road_details(t)}
    if row is None:
        return None
    details = {
        "vehicles": van_details,
        "rsus": rsu_details,
        "orders": order_details,
        "cycles": cycle_details,
    }
    return {"n" if table == "cycles" else "id": key, **row, **details[table](t)}


def van_details(t: int) -> Row:
    """A plan of four stops on the first twelve roads."""
    stops = [
        {
            "id": f"o-{k}",
            "node": f"n{k}",
            "x": 0.0,
            "y": 0.0,
            "arrival": t + (k * 9 - 14) * MINUTE,
            "departure": t + (k * 9 - 12) * MINUTE,
            "earliest": t + (k * 9 - 20) * MINUTE,
            "latest": t + (k * 9 - 4) * MINUTE,
            "state": ("served", "served", "planned", "planned")[k - 1],
            "wait_s": 40 if k == 2 else 0,
            "is_hub": k == 4,
            "charged_kwh": None,
        }
        for k in range(1, 5)
    ]
    segments = [
        {
            "road": f"e{k}-0ha",
            "entry": t + (k * 3 - 20) * MINUTE,
            "exit": t + (k * 3 - 17) * MINUTE,
            "kmh": 42.0,
            "platoon": "p-1" if 4 <= k < 8 else None,
            "place": 1 if 4 <= k < 8 else None,
            "gap_m": 8.0 if 4 <= k < 8 else None,
        }
        for k in range(12)
    ]
    plan = {
        "cycle": 120,
        "issued": t - 20 * MINUTE,
        "depart": t - 20 * MINUTE,
        "valid_until": t + 40 * MINUTE,
        "energy_kwh": 4.2,
        "alone_kwh": 4.6,
        "stops": stops,
        "segments": segments,
    }
    return {
        "plan": plan,
        "why_route": ["By River Road: 0.3 kWh less than by Mill Street, 40 s longer."],
        "why_platoon": ["With van-2 on four roads: saves 0.2 kWh for 30 s of waiting."],
        "history": [{"cycle": 119, "issued": t - HOUR, "status": "accepted", "reason": None}],
    }


def road_details(t: int) -> Row:
    """Six features and an hour of them, with a turbulent quarter and a gap."""
    times = [t - HOUR + k * MINUTE for k in range(60)]
    wave = [None if 20 <= k < 24 else 34 + 9 * math.sin(k / 6) for k in range(60)]

    def scaled(factor: float) -> list[float | None]:
        return [None if value is None else round(value * factor, 6) for value in wave]

    features = [
        ("mean speed", 34.0, "km/h", 0.4, None),
        ("mean acceleration", 0.02, "m/s²", 0.01, None),
        ("density", 21.0, "vehicles/km", 1.1, None),
        ("speed spread", 10.5, "km/h", 0.6, 8.5),
        ("acceleration variance", 0.61, "m²/s⁴", 0.06, 0.8),
        ("mean gap", 31.0, "m", 2.3, None),
    ]
    return {
        "name": "River Road 1",
        "length_m": 150.0,
        "limit_kmh": 50.0,
        "p_stable": 0.31,
        "features": [
            {
                "name": name,
                "value": value,
                "unit": unit,
                "standard_error": error,
                "threshold": threshold,
                "crossed": threshold is not None and value > threshold,
            }
            for name, value, unit, error, threshold in features
        ],
        "hour": {
            "t": times,
            **{
                name + suffix: scaled(factor * share)
                for name, factor in (
                    ("kmh", 1),
                    ("acceleration", 0.00002),
                    ("density", 0.6),
                    ("headway", 0.9),
                    ("cv", 0.007),
                    ("variance", 0.018),
                )
                for suffix, share in (("", 1.0), ("_low", 0.92), ("_high", 1.08))
            },
            "flag": [
                "turbulent" if 30 <= k < 45 else "unknown" if 20 <= k < 24 else "stable"
                for k in range(60)
            ],
        },
        "counts": {
            "begin": t - 20 * MINUTE,
            "end": t - 5 * MINUTE,
            "complete": True,
            "watched_share": 0.93,
            "why": "the camera's picture is black",
            "flows": [
                {"kind": "all", "vehicles": 210, "vph": 903.2, "standard_error": 35.1},
                {"kind": "car", "vehicles": 180, "vph": 774.2, "standard_error": 33.0},
                {"kind": "truck", "vehicles": 20, "vph": 86.0, "standard_error": 14.2},
                {"kind": "bus", "vehicles": 8, "vph": 34.4, "standard_error": 12.0},
                {"kind": "motorcycle", "vehicles": 2, "vph": 8.6, "standard_error": 11.4},
            ],
            "kmh": {"value": 41.3, "standard_error": 0.31},
            "v85_kmh": {"value": 49.8, "standard_error": 0.52},
        },
        "refused": [
            {
                "cycle": 118,
                "t": t - 9 * MINUTE,
                "vehicles": ["van-4", "van-9"],
                "why": "gate_closed",
            }
        ],
        "stopped": [],
    }


def rsu_details(t: int) -> Row:
    """Figures of a unit that has run for a day."""
    return {
        "source": "rtsp://camera-1/stream",
        "started": t - DAY,
        "frames": 2_591_000,
        "repeated": 12,
        "decode_errors": 3,
        "reconnects": 1,
        "rss_mb": 312.0,
        "reception": {
            "received": 86_400,
            "missed": 3,
            "duplicates": 0,
            "out_of_order": 1,
            "delay_s": 0.12,
        },
        "calibration": {
            "file": "/etc/slipstream/rsu-5/camera.toml",
            "written": t - 86_400_000,
            "points": 8,
            "residual_px": 0.74,
            "speed_error": 0.021,
        },
    }


def order_details(t: int) -> Row:
    """An order that was put in, planned and begun."""
    states = (("open", None, None), ("planned", "van-1", 118), ("under_way", "van-1", 119))
    return {
        "history": [
            {
                "t": t - (30 - 10 * k) * MINUTE,
                "state": state,
                "reason": None,
                "vehicle": vehicle,
                "cycle": n,
            }
            for k, (state, vehicle, n) in enumerate(states)
        ],
        "demand": 3,
        "mass_kg": 42.0,
        "service_s": 120,
        "skills": ["lift"],
    }


def cycle_details(t: int) -> Row:
    """Two solvers, of which one ran out of time."""
    return {
        "solvers": [
            {
                "solver": "exact",
                "status": "optimal",
                "reason": None,
                "objective_kwh": 29.31,
                "wall_s": 1.2,
            },
            {
                "solver": "tabu",
                "status": "feasible",
                "reason": "deadline",
                "objective_kwh": 29.44,
                "wall_s": 4.0,
            },
        ],
        "unserved": [{"stop": "o-5", "reason": "time_window"}],
        "energy": energy(1.9),
        "explain": {
            "summary": ["Cycle 40: ok", "The plan is that of exact: objective 12.3456 kWh"],
            "vehicles": [
                {"id": f"van-{n}", "lines": ["serves stop-1, as in the baseline"]}
                for n in range(1, 12)
            ],
            "orders": [],
            "refused": ["van-1 and van-2 on River Road: traffic there was turbulent; 0.0300 kWh"],
            "notes": [],
        },
    }
