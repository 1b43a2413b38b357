from __future__ import annotations

import itertools
import json
import math
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dispatcher_daemon.service.vroom import RoutingEngine, solve_vroom
from dispatcher_daemon.traffic.snapshot import take_snapshot
from slipstream.roads import Segment, build_network
from slipstream.roads.projection import Projection

DURATIONS = [[0, 300, 420, 610], [310, 0, 250, 500], [400, 260, 0, 330], [600, 480, 350, 0]]


def request(**changes: Any) -> dict[str, Any]:
    """Three jobs around one depot, by a matrix."""
    jobs = [{"id": 10 * i, "location_index": i, "service": 60} for i in (1, 2, 3)]
    return {
        "vehicles": [{"id": 7, "start_index": 0, "end_index": 0}],
        "jobs": jobs,
        "matrices": {"car": {"durations": DURATIONS}},
        **changes,
    }


def solved(data: Any, **options: Any) -> dict[str, Any]:
    """An answer of code 0."""
    answer = solve_vroom(data, options.pop("engine", None), 20, 1, **options)
    assert answer["code"] == 0, answer
    return answer


def test_the_cheapest_order_is_found_and_all_of_a_route_adds_up() -> None:
    """Against every order of the jobs."""
    answer = solved(request())
    best = min(
        sum(DURATIONS[a][b] for a, b in itertools.pairwise([0, *order, 0]))
        for order in itertools.permutations((1, 2, 3))
    )
    (route,) = answer["routes"]
    assert answer["summary"]["cost"] == route["cost"] == route["duration"] == best
    assert route["service"] == 180
    assert route["steps"][-1]["arrival"] == best + 180
    assert [s["type"] for s in route["steps"]] == ["start", "job", "job", "job", "end"]


def test_the_documented_example_with_a_matrix_has_vrooms_cost() -> None:
    """The second example of VROOM's documentation, figures as they stand there; it says 5,461."""
    durations = [
        [0, 2104, 197, 1299],
        [2103, 0, 2255, 3152],
        [197, 2256, 0, 1102],
        [1299, 3153, 1102, 0],
    ]
    answer = solved(
        {
            "vehicles": [{"id": 0, "start_index": 0, "end_index": 3}],
            "jobs": [{"id": 1414, "location_index": 1}, {"id": 1515, "location_index": 2}],
            "matrices": {"car": {"durations": durations}},
        }
    )
    (route,) = answer["routes"]
    assert answer["summary"]["cost"] == route["duration"] == 5461
    assert [step.get("id") for step in route["steps"]] == [None, 1414, 1515, None]
    assert [step["arrival"] for step in route["steps"]] == [0, 2104, 4359, 5461]


def test_times_are_rounded_down_after_the_speed_factor() -> None:
    """By hundredths of a second, as VROOM keeps them."""
    vehicle = {"id": 7, "start_index": 0, "end_index": 1, "speed_factor": 0.7}
    job = {"id": 1, "location_index": 2}
    answer = solved(request(vehicles=[vehicle], jobs=[job]))
    # A second takes 1.43 s: 420 s are 600.6 s, 260 s are 371.8 s.
    arrivals = [step["arrival"] for step in answer["routes"][0]["steps"]]
    assert arrivals == [0, 600, 972]
    assert answer["summary"]["cost"] == 972


def test_prices_count_hours_kilometres_tasks_and_the_vehicle() -> None:
    """Travel and tasks are rounded down each."""
    metres = [[1000 * abs(a - b) for b in range(4)] for a in range(4)]
    costs = {"fixed": 50, "per_hour": 720, "per_km": 3, "per_task_hour": 360}
    vehicle = {"id": 7, "start_index": 0, "end_index": 0, "costs": costs}
    data = request(
        vehicles=[vehicle],
        jobs=[{"id": 1, "location_index": 1, "service": 100, "setup": 20}],
        matrices={"car": {"durations": DURATIONS, "distances": metres}},
    )
    (route,) = solved(data)["routes"]
    assert route["distance"] == 2000
    assert route["cost"] == 50 + math.floor((300 + 310) * 0.2 + 2 * 3) + 12


def test_setup_counts_once_for_tasks_at_one_place() -> None:
    """The second task begins where the first one was."""
    jobs = [{"id": i, "location_index": 1, "setup": 100, "service": 10} for i in (1, 2)]
    (route,) = solved(request(jobs=jobs))["routes"]
    assert [step["setup"] for step in route["steps"]] == [0, 100, 0, 0]


def test_the_more_important_job_is_served_and_the_other_one_has_its_reason() -> None:
    """One place for four jobs, one of which nobody can serve."""
    vehicle = {"id": 7, "start_index": 0, "end_index": 0, "max_tasks": 1}
    jobs = [{"id": i, "location_index": i, "priority": 10 * i} for i in (1, 2, 3)]
    jobs.append({"id": 4, "location_index": 1, "skills": [5]})
    answer = solved(request(vehicles=[vehicle], jobs=jobs))
    assert [s["id"] for s in answer["routes"][0]["steps"] if s["type"] == "job"] == [3]
    reasons = {row["id"]: row["reason"] for row in answer["unassigned"]}
    assert reasons[4] == "no vehicle has its skills"
    assert set(reasons) == {1, 2, 4}
    assert "full" in reasons[1]


def test_described_routes_get_the_times_that_break_least() -> None:
    """Windows may be missed, by as little as possible; all else that is broken is named."""
    steps = [{"type": "job", "id": 10}, {"type": "job", "id": 20}]
    vehicle = {"id": 7, "start_index": 0, "end_index": 0, "capacity": [1]}
    vehicle |= {"time_window": [1000, 2500], "steps": steps}
    jobs = [
        {"id": 10, "location_index": 1, "delivery": [1], "time_windows": [[1200, 1250]]},
        {"id": 20, "location_index": 2, "delivery": [1], "time_windows": [[2300, 2400]]},
    ]
    answer = solved(request(vehicles=[vehicle], jobs=jobs), choose_eta=True)
    (route,) = answer["routes"]
    wrong = {v["cause"]: v.get("duration") for v in route["violations"]}
    # From 1000 s on it is 50 s late, or leaves 50 s early; back by 2500 s it leaves the second job
    # by 2100 s, 200 s early, or is back 200 s late.
    assert wrong.pop("load") is None
    assert set(wrong) <= {"delay", "lead_time"}
    assert sum(wrong.values()) == 250
    refused = solve_vroom(
        request(vehicles=[vehicle | {"steps": [{"type": "job", "id": 99}]}], jobs=jobs), None, 5, 1
    )
    assert refused["code"] == 2
    assert "unknown job 99" in refused["error"]


NO_WAY = (None, 2**31 - 1, 2**31, 2**32 - 1)
"""What routing engines answer where no way leads."""


@pytest.mark.parametrize("no", NO_WAY)
@pytest.mark.parametrize("name", ["durations", "distances", "costs"])
def test_no_way_is_driven_where_a_matrix_has_none(name: str, no: int | None) -> None:
    """In whichever matrix it is missing; the task is left out with its reason, also one that counts
    most, and the others are served.
    """
    matrices: dict[str, Any] = {
        key: [list(row) for row in DURATIONS] for key in ("durations", "distances", "costs")
    }
    for i in range(4):
        matrices[name][3][i] = matrices[name][i][3] = no
    data = request(matrices={"car": matrices})
    data["jobs"][2]["priority"] = 100
    answer = solved(data)
    (route,) = answer["routes"]
    best = min(300 + 250 + 400, 420 + 260 + 310)
    assert [s["id"] for s in route["steps"] if s["type"] == "job"] in ([10, 20], [20, 10])
    assert route["cost"] == route["duration"] == route["distance"] == best
    (left,) = answer["unassigned"]
    assert (left["id"], left["reason"]) == (30, "no way leads there and back")


def test_a_direct_way_may_be_missing_where_another_one_leads() -> None:
    """A job that is reached by way of another one only; staying at a place needs no way."""
    durations = [[None, 10, None], [20, None, 5], [7, None, 2**31 - 1]]
    jobs = [{"id": i, "location_index": i} for i in (1, 2, 2)]
    jobs[2]["id"] = 3
    data = request(jobs=jobs, matrices={"car": {"durations": durations}})
    answer = solved(data)
    assert (answer["summary"]["cost"], answer["unassigned"]) == (22, [])
    pair = {"id": 1, "location_index": 1}, {"id": 1, "location_index": 2}
    back = {"pickup": pair[1], "delivery": pair[0]}
    answer = solved({**data, "jobs": [], "shipments": [{"pickup": pair[0], "delivery": pair[1]}]})
    assert answer["summary"]["cost"] == 22
    data = {**data, "jobs": [], "shipments": [back]}
    data["vehicles"] = [{"id": 7, "start_index": 2, "end_index": 1}]
    durations[2][0] = None
    reasons = {row["reason"] for row in solved(data)["unassigned"]}
    assert reasons == {"no way leads there and back"}


@pytest.mark.parametrize("no", NO_WAY)
def test_described_routes_over_a_missing_way_are_refused_by_its_ends(no: int | None) -> None:
    """In plan mode, and as the start of a search."""
    durations = [[0 if a == b else 10 for b in range(4)] for a in range(4)]
    durations[1][3] = no  # type: ignore[call-overload]
    steps = [{"type": "job", "id": 10}, {"type": "job", "id": 30}]
    data = request(
        vehicles=[{"id": 7, "start_index": 0, "steps": steps}],
        matrices={"car": {"durations": durations}},
    )
    refused = solve_vroom(data, None, 5, 1, choose_eta=True)
    assert refused["code"] == 2
    assert "vehicles.7.steps: no way leads from job 10 to job 30" in refused["error"]
    assert "no way leads" in solve_vroom(data, None, 5, 1)["error"]


@pytest.mark.parametrize("zero", [0, 1_740_999_600])
def test_a_route_that_keeps_its_windows_has_no_violations_in_plan_mode(zero: int) -> None:
    """Whatever the clock that its times are of, with and without a window of a task."""

    def windows(*of: tuple[int, int]) -> list[list[int]]:
        return [[zero + start, zero + end] for start, end in of]

    pause = {"id": 1, "service": 600, "time_windows": windows((4000, 6000), (7000, 9000))}
    vehicle: dict[str, Any] = {"id": 7, "start_index": 0, "end_index": 1, "breaks": [pause]}
    vehicle |= {"time_window": [zero, zero + 15000], "speed_factor": 1.7}
    jobs = [
        {"id": 1, "location_index": 1, "setup": 98, "service": 273},
        {"id": 2, "location_index": 2, "setup": 35, "service": 184},
        {"id": 3, "location_index": 3, "service": 45},
    ]
    jobs[0]["time_windows"] = windows((1710, 3978), (4322, 7184), (7994, 10855))
    jobs[1]["time_windows"] = windows((1144, 1861), (3460, 6413), (7687, 8029))
    data = request(vehicles=[vehicle], jobs=jobs)
    (route,) = solved(data)["routes"]
    vehicle["steps"] = [
        {"type": step["type"], **({"id": step["id"]} if "id" in step else {})}
        for step in route["steps"]
    ]
    answer = solved(data, choose_eta=True)
    assert answer["summary"]["violations"] == []
    assert answer["routes"][0]["steps"][-1]["arrival"] <= route["steps"][-1]["arrival"]
    vehicle["time_window"] = [zero + 20000, zero + 30000]
    late = solved(data, choose_eta=True)["summary"]["violations"]
    assert {one["cause"] for one in late} <= {"delay", "lead_time"}
    assert late


@st.composite
def requests(draw: st.DrawFn) -> dict[str, Any]:
    """Small requests with every rule."""
    size = 6
    entry = st.integers(0, 900)
    durations = [[0 if a == b else draw(entry) for b in range(size)] for a in range(size)]
    window = st.tuples(st.integers(0, 5000), st.integers(0, 3000)).map(
        lambda pair: [pair[0], sum(pair)]
    )
    windows = st.lists(window, min_size=1, max_size=2)
    row, amount = st.integers(0, size - 1), st.integers(0, 3).map(lambda n: [n])

    def step(number: int) -> dict[str, Any]:
        found = {"id": number, "location_index": draw(row), "service": draw(st.integers(0, 300))}
        found["setup"] = draw(st.sampled_from((0, 0, 120)))
        if draw(st.booleans()):
            found["time_windows"] = draw(windows)
        if draw(st.booleans()):
            found["service_per_type"] = {"b": draw(st.integers(0, 300))}
        return found

    skills = st.sampled_from(([], [], [], [1], [2]))
    jobs = [
        {**step(n), draw(st.sampled_from(("delivery", "pickup"))): draw(amount)}
        | {"skills": draw(skills), "priority": draw(st.sampled_from((0, 0, 5)))}
        for n in range(draw(st.integers(0, 5)))
    ]
    shipments = [
        {"pickup": step(n), "delivery": step(n), "amount": draw(amount), "skills": draw(skills)}
        for n in range(draw(st.integers(0 if jobs else 1, 2)))
    ]
    vehicles = []
    for n in range(draw(st.integers(1, 3))):
        vehicle: dict[str, Any] = {"id": n, "capacity": [draw(st.integers(2, 9))], "skills": [1, 2]}
        vehicle["skills"] = draw(st.sampled_from(([1], [1, 2], [1, 2])))
        vehicle["type"] = draw(st.sampled_from(("a", "b")))
        ends = draw(st.sampled_from((("start",), ("end",), ("start", "end"))))
        vehicle |= {f"{end}_index": draw(row) for end in ends}
        if draw(st.integers(0, 2)) == 0:
            vehicle["time_window"] = draw(window)
        if draw(st.integers(0, 3)) == 0:
            vehicle["max_tasks"] = draw(st.integers(1, 6))
        if draw(st.integers(0, 3)) == 0:
            vehicle["max_travel_time"] = draw(st.integers(500, 4000))
        if draw(st.booleans()):
            vehicle["breaks"] = [
                {"id": 0, "service": 200, "time_windows": draw(windows)}
                | draw(st.sampled_from(({}, {"max_load": [2]})))
            ]
        vehicles.append(vehicle)
    matrices = {"car": {"durations": durations}}
    return {"vehicles": vehicles, "jobs": jobs, "shipments": shipments, "matrices": matrices}


def within(moment: int, windows: list[list[int]] | None) -> bool:
    """Whether a moment is in a window."""
    return windows is None or any(start <= moment <= end for start, end in windows)


def check_route(data: dict[str, Any], route: dict[str, Any]) -> list[tuple[str, int]]:
    """Tasks of a route that breaks no rule; from its text alone."""
    durations = data["matrices"]["car"]["durations"]
    vehicle = next(v for v in data["vehicles"] if v["id"] == route["vehicle"])
    specs = {("job", job["id"]): (job, job) for job in data["jobs"]}
    for shipment in data["shipments"]:
        for kind in ("pickup", "delivery"):
            specs[kind, shipment[kind]["id"]] = shipment[kind], shipment
    first, *inner, last = route["steps"]
    assert (first["type"], last["type"]) == ("start", "end")
    tasks = [(s["type"], s["id"]) for s in inner if s["type"] != "break"]
    load = sum(specs[t][0].get("delivery", [0])[0] for t in tasks if t[0] == "job")
    assert first["load"] == [load]
    assert load <= vehicle["capacity"][0]
    over, place, travelled = first["arrival"], vehicle.get("start_index"), 0
    taken, pending = 0, 0
    for step in [*inner, last]:
        assert step["violations"] == []
        begin = step["arrival"] + step["waiting_time"]
        travel = step["duration"] - travelled
        assert step["arrival"] - over == travel >= 0
        travelled, over = step["duration"], begin + step["setup"] + step["service"]
        pending += travel
        if step["type"] == "break":
            (pause,) = vehicle["breaks"]
            taken += 1
            assert within(begin, pause["time_windows"])
            assert step["service"] == 200
            assert load <= pause.get("max_load", [99])[0]
            continue
        if step["type"] == "end":
            there = vehicle.get("end_index")
        else:
            spec, shared = specs[step["type"], step["id"]]
            there = spec["location_index"]
            assert within(begin, spec.get("time_windows"))
            assert set(shared["skills"]) <= set(vehicle["skills"])
            own = spec.get("service_per_type", {}) if vehicle["type"] == "b" else {}
            assert step["service"] == own.get("b", spec["service"])
            assert step["setup"] == (0 if there == place else spec["setup"])
            if step["type"] == "job":
                load += spec.get("pickup", [0])[0] - spec.get("delivery", [0])[0]
            else:
                load += shared["amount"][0] * (1 if step["type"] == "pickup" else -1)
            assert step["load"] == [load]
            assert load <= vehicle["capacity"][0]
        assert pending == (0 if None in (place, there) else durations[place][there])
        pending, place = 0, there
    assert taken == len(vehicle.get("breaks", ()))
    assert len(tasks) <= vehicle.get("max_tasks", 99)
    assert route["duration"] == travelled <= vehicle.get("max_travel_time", 10**9)
    assert within(first["arrival"], [vehicle.get("time_window", [0, 10**9])])
    assert within(last["arrival"], [vehicle.get("time_window", [0, 10**9])])
    for kind, number in tasks:
        if kind == "delivery":
            assert tasks.index(("pickup", number)) < tasks.index((kind, number))
    return tasks


@pytest.mark.long
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(requests())
def test_routes_keep_every_rule_and_every_task_is_served_once_or_has_a_reason(
    data: dict[str, Any],
) -> None:
    """What every answer says is checked from its own text."""
    answer = solve_vroom(data, None, 0.5, 1)
    assert answer["code"] == 0, answer
    served = [task for route in answer["routes"] for task in check_route(data, route)]
    left = [(row["type"], row["id"]) for row in answer["unassigned"]]
    assert all(row["reason"] for row in answer["unassigned"])
    asked = [("job", job["id"]) for job in data["jobs"]]
    asked += [(k, s[k]["id"]) for s in data["shipments"] for k in ("pickup", "delivery")]
    assert sorted(served + left) == sorted(asked)


@pytest.mark.long
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(requests(), st.data())
def test_whatever_is_in_a_request_is_answered_with_a_code(
    data: dict[str, Any], draw: st.DataObject
) -> None:
    """Junk in one place of a request: never an internal error."""
    text = json.dumps(data)
    junk = draw.draw(
        st.sampled_from(
            (None, -1, 2**70, 1e400, "x", [], {}, [[]], True, [1, "2"], {"id": 1}, "\0", [[5, 1]])
        )
    )
    node: Any = json.loads(text)
    parent, key = [node], 0
    while isinstance(parent[key], dict | list) and parent[key] and draw.draw(st.integers(0, 4)):
        parent = parent[key]
        keys = sorted(parent) if isinstance(parent, dict) else range(len(parent))
        key = draw.draw(st.sampled_from(list(keys)))
    parent[key] = junk
    answer = solve_vroom(node, None, 0.2, 1)
    assert answer["code"] in (0, 2), answer
    if answer["code"] == 2:
        assert len(answer["error"].splitlines()) == 1


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"jobs": [{"id": 1, "location_index": 9}]}, "jobs.1.location_index: row 9 of 4"),
        ({"jobs": [{"id": 1, "location": [2.0, 48.0]}]}, "jobs.1.location_index: no index"),
        ({"jobs": [{"id": 1, "location_index": 1}] * 2}, "jobs: id 1 is given twice"),
        ({"matrices": None}, "coordinates, but no roads"),
        ({"vehicles": [{"id": 1}]}, "no start or end"),
        (
            {"vehicles": [{"id": 1, "start_index": 0, "max_distance": 5}]},
            "vehicles.0.max_distance: distances are not known",
        ),
    ],
)
def test_what_is_not_supported_or_faulty_is_refused_by_name(
    changes: dict[str, Any], named: str
) -> None:
    """One line that names the key."""
    answer = solve_vroom(request(**changes), None, 5, 1)
    assert answer["code"] == 2
    assert named in answer["error"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"options": {"g": True}}, "options: unknown key, not read; ask for geometry"),
        ({"vehicles": [{"id": 7, "start_index": 0, "name": "Bob"}]}, "vehicles.0.name: unknown"),
        ({"jobs": [{"id": 1, "location_index": 1, "priorty": 5}]}, "did you mean priority?"),
        ({"jobs": [{"id": 1, "location_index": 1, "amount": [], "pickup": []}]}, "jobs.0.amount"),
        ({"matrix": [[5, 5], [5, 5]]}, "matrix: not read beside matrices"),
        ({"matrices": {"car": {"durations": DURATIONS, "unit": "s"}}}, "matrices.car.unit"),
        (
            {
                "vehicles": [
                    {
                        "id": 7,
                        "start_index": 0,
                        "costs": {"per_minute": 1},
                        "breaks": [{"id": 1, "note": ""}],
                        "steps": [{"type": "job", "id": 10, "arrival": 5}],
                    }
                ]
            },
            "vehicles.0.costs.per_minute vehicles.0.breaks.0.note vehicles.0.steps.0.arrival",
        ),
    ],
)
def test_what_vroom_does_not_read_is_said_and_changes_nothing(
    changes: dict[str, Any], said: str
) -> None:
    """Keys of other programs, misspelt ones, and former names beside present ones."""
    answer = solved(request(**changes))
    told = " ".join(answer.pop("warnings"))
    if said.startswith("vehicles.0.costs"):
        assert all(key in told for key in said.split())
    else:
        assert said in told
    assert "warnings" not in solved(request())


def test_a_key_of_many_rows_is_said_once_and_a_refusal_says_it_too() -> None:
    """The misspelling is what helps."""
    jobs = [{"id": i, "locatoin_index": 1} for i in range(30)]
    answer = solve_vroom(request(jobs=jobs), None, 5, 1)
    assert answer["code"] == 2
    (line,) = answer["warnings"]
    assert line == (
        "request: jobs.0.locatoin_index: unknown key, not read, in 29 other rows neither; "
        "did you mean location_index?"
    )
    many = solved(request(**{f"x{i}\n": 1 for i in range(100)}))["warnings"]
    assert len(many) == 20
    assert all(line.isprintable() for line in many)


def test_an_index_counts_for_nothing_without_matrices() -> None:
    """With coordinates over roads: as VROOM's documentation says."""
    engine = road_engine()
    start = coordinates(engine, "a")
    data = {
        "vehicles": [{"id": 1, "start": start, "start_index": 3, "end": start}],
        "jobs": [{"id": 5, "location": coordinates(engine, "c"), "location_index": 9}],
    }
    answer = solved(data, engine=engine)
    assert answer["routes"][0]["distance"] == 12_000
    assert len(answer["warnings"]) == 2
    assert all("not read without matrices" in line for line in answer["warnings"])


def road_engine(minimise: Any = "time") -> RoutingEngine:
    """A square of roads at the mouth of a river, driven one way round but for one side."""
    projection = Projection("+proj=utm +zone=30 +ellps=WGS84 +units=m", (0.0, 0.0))
    x, y = projection.place_m(47.28, -2.20)
    at = {"a": (x, y), "b": (x + 3000, y), "c": (x + 3000, y + 3000), "d": (x, y + 3000)}
    pairs = (("a", "b"), ("b", "c"), ("c", "d"), ("d", "a"), ("b", "a"))
    roads = [
        Segment(f"{i}{j}", i, j, math.dist(at[i], at[j]), 20.0, 1, (at[i], at[j])) for i, j in pairs
    ]
    network = build_network("mouth", roads, at, projection=projection)
    snapshot = take_snapshot(network, (), 0, stale_after_s=5)
    return RoutingEngine(network, snapshot, minimise)


def coordinates(engine: RoutingEngine, name: str) -> list[float]:
    """Longitude and latitude of a junction."""
    assert engine.network.projection is not None
    ((latitude, longitude),) = engine.network.projection.degrees([engine.network.junctions[name]])
    return [round(longitude, 6), round(latitude, 6)]


def test_coordinates_are_driven_over_our_roads_with_their_geometry() -> None:
    """One way round the square; with energy as the cost; and from a place that no road is near."""
    engine = road_engine()
    start = coordinates(engine, "a")
    data = {
        "vehicles": [{"id": 1, "start": start, "end": start}],
        "jobs": [{"id": 5, "location": coordinates(engine, "c")}],
    }
    (route,) = solved(data, engine=engine, geometry=True)["routes"]
    assert route["distance"] == 12_000
    # 12 km at 20 m/s, and the stops' braking and speeding up.
    assert 600 < route["duration"] < 660
    assert decoded(route["geometry"]) == [
        tuple(round(v, 5) for v in reversed(coordinates(engine, name))) for name in "abcda"
    ]
    wh = solved(data, engine=road_engine("energy"))["summary"]["cost"]
    assert 500 < wh < 6000
    far = solve_vroom(data | {"jobs": [{"id": 5, "location": [2.35, 48.7]}]}, engine, 5, 1)
    assert far["code"] == 3
    assert "[2.35, 48.7]" in far["error"]


def test_a_location_that_is_served_far_off_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """From the place to the junction, however near the road is; all others are not told."""
    engine = road_engine()
    network = engine.network
    assert network.projection is not None
    (x, y), start = network.junctions["a"], coordinates(engine, "a")
    ((latitude, longitude),) = network.projection.degrees([(x + 1000.0, y + 40.0)])
    data = {
        "vehicles": [{"id": 1, "start": start, "end": start}],
        "jobs": [{"id": 5, "location": [longitude, latitude]}],
    }
    solved(data, engine=engine)
    assert "1 of 2 locations are served more than 200 m away" in caplog.text
    assert "1001 m away, at 'a'" in caplog.text
    caplog.clear()
    solved(data | {"jobs": [{"id": 5, "location": coordinates(engine, "c")}]}, engine=engine)
    assert caplog.text == ""


def decoded(text: str) -> list[tuple[float, float]]:
    """Points of an encoded polyline."""
    values, bits, shift = [], 0, 0
    for char in text:
        chunk = ord(char) - 63
        bits |= (chunk & 0x1F) << shift
        shift += 5
        if not chunk & 0x20:
            values.append(~(bits >> 1) if bits & 1 else bits >> 1)
            bits = shift = 0
    sums = [list(itertools.accumulate(values[i::2])) for i in (0, 1)]
    return [(a / 1e5, b / 1e5) for a, b in zip(*sums, strict=True)]


def test_a_search_may_start_from_described_routes_and_keeps_absolute_times() -> None:
    """A shipment and a job with two windows on one route, by a clock of 1970; a vehicle without a
    window leaves as late as it can.
    """
    pair = {"id": 1, "location_index": 2}, {"id": 1, "location_index": 3}
    windows = [[1_600_000_000, 1_600_000_100], [1_600_009_000, 1_600_009_100]]
    steps = [{"type": kind, "id": 1} for kind in ("pickup", "job", "delivery")]
    vehicle = {"id": 7, "start_index": 0, "end_index": 0, "capacity": [1], "steps": steps}
    data = request(
        vehicles=[vehicle],
        jobs=[{"id": 1, "location_index": 1, "time_windows": windows}],
        shipments=[{"pickup": pair[0], "delivery": pair[1], "amount": [1]}],
    )
    (route,) = solved(data)["routes"]
    assert route["cost"] == min(300 + 250 + 330 + 600, 420 + 330 + 480 + 310, 420 + 260 + 500 + 600)
    assert any(within(s["arrival"], windows) for s in route["steps"] if s["type"] == "job")
    assert route["waiting_time"] == 0
    refused = solve_vroom(data | {"vehicles": [vehicle | {"steps": steps[2:]}]}, None, 5, 1)
    assert "without its other step" in refused["error"]


def test_too_many_places_are_refused_before_their_ways_are_computed() -> None:
    """All profiles count together."""

    class Unused:
        """Roads that nobody may ask."""

        def ways(self, *_: object) -> None:
            raise AssertionError

    places = [[2.0 + 1e-4 * i, 48.0] for i in range(1900)]
    data = {
        "vehicles": [
            {"id": i, "profile": name, "start": places[0]}
            for i, name in enumerate(("car", "truck", "bus", "van"))
        ],
        "jobs": [{"id": i, "location": place} for i, place in enumerate(places)],
    }
    answer = solve_vroom(data, Unused(), 5, 1)  # type: ignore[arg-type]
    assert answer["code"] == 2
    assert "too many: 1900 places with 4 kinds" in answer["error"]
