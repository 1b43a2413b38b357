"""What another day's movements cost, recorded."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dispatcher_daemon.fleet.learning import HOURS, History
from slipstream.energy.consumption import steady_energy_kwh
from slipstream.roads.sumo_net import load_network
from slipstream_lab.simulation.closed_loop import history_recording as recording
from slipstream_lab.simulation.closed_loop.history_recording import history_of, record_history
from slipstream_lab.simulation.scenarios.day import DaySpec
from slipstream_lab.simulation.scenarios.scenario import BackgroundTraffic, load_scenario
from slipstream_lab.simulation.sumo.vehicle_types import TYPES


@pytest.mark.long
@pytest.mark.process
def test_a_day_is_recorded(tmp_path: Path) -> None:
    """A minute of cars and a truck on the built-in net gives the cars' whole passages."""
    net = Path(str(resources.files("slipstream") / "data" / "demo.net.xml"))
    network = load_network(net)
    way = [next(iter(network.segments))]
    while len(way) < 4:
        way.append(network.follows[way[-1]][0])
    routes = tmp_path / "some.rou.xml"
    kinds = "".join(TYPES[kind].xml() for kind in ("car", "truck"))
    vehicles = "".join(
        f'<vehicle id="{i}" type="{kind}" route="way" depart="{at}" departSpeed="max"/>'
        for i, (kind, at) in enumerate((("car", 0), ("truck", 8), ("car", 16)))
    )
    routes.write_text(
        f'<routes>{kinds}<route id="way" edges="{" ".join(way)}"/>{vehicles}</routes>'
    )
    day = DaySpec(net, (routes,), tuple(network.segments), end_s=900.0)
    history = record_history(day, network)
    assert history.movements == tuple(sorted(pairwise(way[1:])))
    assert history.count[:, 0].tolist() == [2.0, 2.0]
    for (a, _), loss, seconds in zip(
        history.movements, history.loss_kwh[:, 0] / 2, history.seconds[:, 0] / 2, strict=True
    ):
        segment = network.segments[a]
        assert loss > 0.8 * steady_energy_kwh(segment.length_m, 0.8 * segment.speed_limit_mps)
        assert 0.9 * segment.free_flow_s < seconds < segment.free_flow_s + 90.0


def test_a_recorded_history_is_not_recorded_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is there is taken as it is, but none of other traffic or another net."""
    troy = load_scenario("troy")
    recorded: list[object] = []

    def record(order: DaySpec, *_: object) -> History:
        recorded.append(order)
        return History((), *(np.zeros((0, HOURS)) for _ in range(4)))

    monkeypatch.setattr(recording, "record_history", record)
    monkeypatch.setattr(
        recording, "prepare", lambda *_: BackgroundTraffic((tmp_path / "r.xml",), ())
    )
    path = history_of(troy, 3, tmp_path, signals="fixed")
    assert history_of(troy, 3, tmp_path, signals="fixed") == path
    assert len(recorded) == 1
    busier = replace(troy, demand=load_scenario("corridor").demand)
    assert history_of(busier, 3, tmp_path, signals="fixed") != path
    assert len(recorded) == 2
