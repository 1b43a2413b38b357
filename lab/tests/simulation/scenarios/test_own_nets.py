"""Nets of a user's own: what is made up around them has their size, and is told."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from slipstream.osm.netconvert import find_netconvert
from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream_cli.main import main
from slipstream_lab.simulation.rsus import load_rsus
from slipstream_lab.simulation.scenarios.defaults import default_demand, default_fleet, rsu_count
from slipstream_lab.simulation.scenarios.demand import FleetSettings, draw_deliveries, draw_trips
from slipstream_lab.simulation.scenarios.networks import cut_network
from slipstream_lab.simulation.scenarios.perception import place_rsus

Capture = pytest.CaptureFixture[str]


def ring(parts: int, length_m: float, limit_mps: float) -> RoadNetwork:
    """A one-way ring without a signal."""
    radius_m = parts * length_m / (2 * math.pi)
    angles = [2 * math.pi * k / parts for k in range(parts)]
    places = {
        f"n{k}": (radius_m * math.cos(a), radius_m * math.sin(a)) for k, a in enumerate(angles)
    }
    segments = []
    for k in range(parts):
        start, end = f"n{k}", f"n{(k + 1) % parts}"
        line = (places[start], places[end])
        segments.append(Segment(f"r{k}", start, end, length_m, limit_mps, 2, line))
    return build_network("ring", segments, places)


def test_a_town_gets_what_it_always_got() -> None:
    """Up to 160 km of road and half an hour of driving nothing is scaled."""
    town = ring(20, 2_000.0, 25.0)
    usual = FleetSettings()
    assert default_fleet(town, usual) == usual
    assert rsu_count(town) == 12
    demand = default_demand(town)
    assert (demand.flows[0].trips, demand.min_trip_m) == (6_800, 800.0)


def test_long_roads_get_more_orders_vehicles_and_time() -> None:
    """450 km at 25 m/s: up to five hours of driving, which no order is due before."""
    region, usual = ring(15, 30_000.0, 25.0), FleetSettings()
    fleet = default_fleet(region, usual)
    assert fleet.orders == round(400 * 450 / 160)
    farthest_s = 14 * 30_000.0 / 25.0
    assert min(fleet.express_due_s) >= farthest_s
    assert fleet.last_release_s + max(fleet.wave_due_s) == pytest.approx(
        usual.last_release_s + max(usual.wave_due_s)
    )
    # 16 tours in the busiest hour, of ten hours each.
    assert 150 < fleet.vehicles < 300
    assert rsu_count(region) == 30


def test_blocks_shorter_than_rsus_watch_get_some_all_the_same() -> None:
    """On 88 m of road a stretch of 68 m; trips between places, however near all are."""
    blocks = ring(12, 88.0, 13.9)
    demand = default_demand(blocks)
    assert len(draw_trips(demand, blocks, 1)) == 500
    rsus = place_rsus(blocks, dict.fromkeys(blocks.segments, 1), rsu_count(blocks))
    assert len(rsus) >= 3
    assert {(s.from_m, s.to_m) for rsu in rsus for s in rsu.watch} == {(0.0, 68.0)}


def test_a_road_between_two_places_has_a_depot_and_customers() -> None:
    """One place each."""
    road = ring(2, 5_000.0, 25.0)
    deliveries = draw_deliveries(default_fleet(road, FleetSettings()), road, 1)
    (depot,) = deliveries.settings.depots
    assert {order.node for order in deliveries.orders} == {"n0", "n1"} - {depot.node}


def _grid(folder: Path) -> Path:
    """Streets of a town that drives on the left, one way each, without signals and internal links;
    the kerb lanes are for buses, one street is closed to cars.
    """
    if find_netconvert() is None:
        pytest.skip("netconvert is not installed")
    size, nodes, edges = 4, [], []
    for x in range(size):
        for y in range(size):
            nodes.append(f'<node id="{x}{y}" x="{320 * x}" y="{320 * y}" type="priority"/>')
            ways = (((x + 1, y) if y % 2 else (x - 1, y)), ((x, y - 1) if x % 2 else (x, y + 1)))
            for to_x, to_y in ways:
                if 0 <= to_x < size and 0 <= to_y < size:
                    edges.append(_street(f"{x}{y}", f"{to_x}{to_y}"))
    edges.append(
        '<edge id="closed" from="00" to="33" numLanes="1" speed="13.9" disallow="passenger"/>'
    )
    (folder / "g.nod.xml").write_text(f"<nodes>{''.join(nodes)}</nodes>")
    (folder / "g.edg.xml").write_text(f"<edges>{''.join(edges)}</edges>")
    net = folder / "grid.net.xml"
    files = ("-n", folder / "g.nod.xml", "-e", folder / "g.edg.xml", "-o", net)
    options = ("--lefthand", "--no-internal-links")
    subprocess.run(
        [str(find_netconvert()), *map(str, files), *options], check=True, capture_output=True
    )
    return net


def _street(start: str, end: str) -> str:
    return (
        f'<edge id="{start}-{end}" from="{start}" to="{end}" numLanes="2" speed="13.9">'
        '<lane index="0" allow="bus"/></edge>'
    )


@pytest.fixture(scope="module")
def grid(made_once: Callable[[str, Callable[[Path], object]], Path]) -> Path:
    """A net as `_grid` has it."""
    return made_once("own-grid", _grid) / "grid.net.xml"


def _fleet(folder: Path) -> Path:
    """Orders all day that are due soon, so that an arm ends soon."""
    path = folder / "fleet.toml"
    path.write_text(
        "orders = 2000\nvehicles = 6\nwave_s = 300.0\nwave_share = 1.0\n"
        f"hours = {[1.0] * 24}\nwave_due_s = [900.0, 1200.0]\nexpress_due_s = [900.0, 1200.0]\n"
        "service_s = [20.0, 40.0]\n"
    )
    return path


def _evaluate(folder: Path, net: Path, *words: str) -> Sequence[str]:
    own = ("--scenario", "grid", "--net", str(net), "--fleet", str(_fleet(folder)))
    return (
        "evaluate",
        *own,
        "--seeds",
        "1",
        "--workers",
        "1",
        "--out",
        str(folder / "out"),
        *words,
    )


@pytest.mark.process
@pytest.mark.long
def test_a_net_of_nobodys_is_driven(grid: Path, tmp_path: Path, capsys: Capture) -> None:
    """Left, one way, no signal, no internal link, bus lanes: arms serve the same orders, and what
    was made up is on the terminal, in the report and in the summary.
    """
    hours = ("--begin", "10", "--hours", "0.25", "--arms", "B,installed")
    assert main([*_evaluate(tmp_path, grid, *hours), "--json"]) == 0
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    arms = summary["arms"]
    assert list(arms) == ["B", "installed"]
    assert summary["refused"] == []
    served = {arm["figures"]["served"]["mean"] for arm in arms.values()}
    assert len(served) == 1
    assert served.pop() >= 10
    assert [line.partition(":")[0] for line in summary["made_up"]] == [
        *("demand", "RSUs"),
        "depots, seed 1",
    ]
    assert "1 closed to cars" in captured.err
    for line in summary["made_up"]:
        assert f"slipstream: made up: {line}\n" in captured.err
        assert f"- made up: {line}\n" in (tmp_path / "out" / "report.md").read_text()


@pytest.mark.process
@pytest.mark.long
def test_a_curve_of_a_net_of_ones_own(grid: Path, tmp_path: Path, capsys: Capture) -> None:
    """Planned on its roads, whose rings fit no common clock, under the bound; then driven with the
    user's fleet scaled, and the same RSUs in all.
    """
    words = ("--density", "6", "--drive", "30", "--arms", "B", "--begin", "10", "--hours", "0.25")
    assert main([*_evaluate(tmp_path, grid, *words), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    for row in document["planned"]:
        shares = row["share_of_ceiling"]
        bound = shares.pop("upper bound")["mean"]
        assert all(share["mean"] <= bound + 1e-9 for share in shares.values())
    (law,) = [line for line in document["made_up"] if line.startswith("driven fleets: ")]
    tours = int(law.split()[2])
    fleet = (tmp_path / "out" / "density-30" / "fleet.toml").read_text()
    assert f"orders = {round(2000 * 30 / tours)}\n" in fleet
    assert f"- {law}" in (tmp_path / "out" / "density.md").read_text()
    assert document["driven"]["30"]["arms"]["B"]["figures"]["served"]["mean"] > 0
    rsus = load_rsus(tmp_path / "out" / "rsus.toml", cut_network(grid)[0])
    assert document["driven"]["30"]["ground"]["rsus"] != ""
    assert len(rsus) > 1
