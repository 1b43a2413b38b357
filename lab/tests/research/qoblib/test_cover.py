"""The choice of whole routes has the routing problem's optimum."""

from __future__ import annotations

from itertools import combinations, pairwise, permutations
from pathlib import Path

import numpy as np
import pytest

from lab.tests.research.qoblib.instances import DEMANDS, OPTIMUM, instance_text
from slipstream.errors import InputError
from slipstream_lab.research.instances.matrices import MatrixInstance, read_published
from slipstream_lab.research.qoblib.cover import CoverModel, build_cover, check_answer, count_routes

Case = tuple[MatrixInstance, CoverModel]


def made(folder: Path, text: str, name: str) -> Case:
    """An instance and its model."""
    path = folder / f"{name}.vrp"
    path.write_text(text, encoding="utf-8")
    instance = read_published(path, "qoblib")
    return instance, build_cover(instance, path)


@pytest.fixture
def full(tmp_path: Path) -> Case:
    """All vehicles are full."""
    return made(tmp_path, instance_text(), "full-k3")


@pytest.fixture
def loose(tmp_path: Path) -> Case:
    """The same with a few units to spare."""
    return made(tmp_path, instance_text("loose-k3", 276), "loose-k3")


def test_a_matrix_that_misses_ways_is_refused(tmp_path: Path) -> None:
    """The model knows no route that cannot be driven."""
    instance, _ = made(tmp_path, instance_text(), "full-k3")
    instance.measures["distance"][0, 1] = np.inf
    with pytest.raises(InputError, match="ways are missing"):
        build_cover(instance, tmp_path / "full-k3.vrp")


def length(instance: MatrixInstance, route: tuple[int, ...]) -> float:
    """Of a route by numbers of stops, from the depot and back."""
    of, row = instance.measures["distance"], instance.row
    places = [row[stop.id] for stop in (instance.fleet.stops[n] for n in route)]
    depot = row[instance.fleet.depots[0].id]
    return sum(float(of[a, b]) for a, b in pairwise([depot, *places, depot]))


def all_subsets(least: int, most: int) -> set[frozenset[int]]:
    """Stops that are a vehicle's load, by looking at all."""
    return {
        frozenset(chosen)
        for count in range(len(DEMANDS) + 1)
        for chosen in combinations(range(len(DEMANDS)), count)
        if least <= sum(DEMANDS[i] for i in chosen) <= most
    }


@pytest.mark.parametrize(("which", "least", "most"), [("full", 273, 273), ("loose", 267, 276)])
def test_all_possible_routes_are_listed_in_their_shortest_order(
    request: pytest.FixtureRequest, which: str, least: int, most: int
) -> None:
    """Loads, orders and costs are those that looking at all of them finds."""
    instance, model = request.getfixturevalue(which)
    assert {frozenset(route) for route in model.routes} == all_subsets(least, most)
    for route, cost in zip(model.routes, model.costs, strict=True):
        assert length(instance, route) == cost
        assert cost == min(length(instance, order) for order in permutations(route))


def test_the_qubos_minimum_is_the_cheapest_answer(full: Case) -> None:
    """All states of it; valid ones cost what their routes cost, in the order of the routes."""
    instance, model = full
    size = len(model.routes)
    states = ((np.arange(2**size)[:, None] >> np.arange(size)) & 1).astype(np.int8)
    energies = model.bqm.energies((states, range(size)))
    halved = model.qubo.total.energies((states, list(model.qubo.variables)))
    scale = (energies.max() - energies.min()) / (halved.max() - halved.min())
    assert np.log2(scale) % 1 == 0
    assert halved * scale + float(model.bqm.offset) == pytest.approx(energies)
    valid = model.valid(states)
    assert energies[valid] == pytest.approx(states[valid] @ model.costs)
    assert energies[~valid].min() >= energies.min()
    assert energies.min() == OPTIMUM
    routes = model.chosen(states[energies.argmin()])
    assert check_answer(instance, routes) == (OPTIMUM, None)


def test_no_other_answer_is_cheaper(full: Case) -> None:
    """All ways to cut the stops into three full loads."""
    _, model = full
    cost = dict(zip(map(frozenset, model.routes), model.costs.tolist(), strict=True))
    every = frozenset(range(len(DEMANDS)))
    found = [
        cost[a] + cost[b] + cost[every - a - b]
        for a, b in combinations(cost, 2)
        if not a & b and every - a - b in cost
    ]
    assert min(found) == OPTIMUM


def test_where_loads_leave_room_routes_are_counted(loose: Case) -> None:
    """One row more: as many routes as vehicles."""
    _, model = loose
    assert model.targets.tolist() == [1.0] * len(DEMANDS) + [3.0]
    assert model.rows[-1].all()


def test_answers_are_checked_without_the_model(full: Case) -> None:
    """Each rule by itself."""
    instance, _ = full
    every = list(range(len(DEMANDS)))
    assert check_answer(instance, [every])[1] == "a vehicle is too full"
    assert check_answer(instance, [every[1:]])[1] == "not every stop is served once"
    assert check_answer(instance, [[n] for n in every])[1] == "more routes than vehicles"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (instance_text("bad-k4"), "does not need exactly 4 vehicles"),
        (instance_text("bad-k2"), "does not need exactly 2 vehicles"),
        (
            instance_text("bad-k3").replace("EOF", "TIME_WINDOW_SECTION\n")
            + "\n".join(f"{i} 0 900" for i in range(1, 14)),
            "without time windows",
        ),
    ],
    ids=["idle", "too-few", "windows"],
)
def test_what_routes_cannot_express_is_refused(tmp_path: Path, text: str, said: str) -> None:
    """One line with the file and the mend."""
    path = tmp_path / "bad.vrp"
    path.write_text(text, encoding="utf-8")
    instance = read_published(path, "qoblib")
    with pytest.raises(InputError) as caught:
        count_routes(instance, path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
