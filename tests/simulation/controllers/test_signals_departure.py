"""A drive through known signals is foreseen, and the second that suits them best is found."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from simulation.controllers.signals.crossings import Link
from simulation.controllers.signals.departure import DepartureSettings
from simulation.controllers.signals.predicted_drive import (
    DriveParameters,
    RoadPart,
    drive_on,
    predict_drive,
    wait_s,
)
from simulation.controllers.signals.program import Green
from simulation.scenarios.networks.fixed_time import write_fixed_time
from simulation.scenarios.scenario import load_scenario
from simulation.sumo.session import Session
from simulation.sumo.vehicle_types import TYPES
from slipstream.energy import trace_energy

libsumo = pytest.importorskip("libsumo")

LINK = Link("signal", 0)
ALWAYS = (Green(0.0, math.inf, True, True),)


def test_the_closed_forms_are_the_idms_own_integral() -> None:
    """Speed, time and ∫v² ds of a kilometre from rest agree with small steps of the IDM."""
    v, s, t, squares, dt = 0.0, 0.0, 0.0, 0.0, 1e-3
    while s < 1000.0:
        after = v + 1.8 * (1 - (v / 13.4) ** 4) * dt
        s += 0.5 * (v + after) * dt
        squares += (0.5 * (v + after)) ** 3 * dt
        v, t = after, t + dt
    gain = drive_on(0.0, 13.4, 1000.0, 1.8)
    assert gain.speed_mps == pytest.approx(v, rel=2e-3)
    assert gain.seconds == pytest.approx(t, rel=2e-3)
    assert gain.squares_m3ps2 == pytest.approx(squares, rel=2e-3)


def test_a_drive_is_the_same_in_one_stretch_and_in_many() -> None:
    """Cutting a road into pieces changes neither time nor energy."""
    whole = predict_drive([RoadPart(800.0, 13.4)], 0.0, lambda _: (), DriveParameters())
    cut = predict_drive([RoadPart(200.0, 13.4)] * 4, 0.0, lambda _: (), DriveParameters())
    assert cut.duration_s == pytest.approx(whole.duration_s, abs=0.1)
    assert cut.energy_kwh == pytest.approx(whole.energy_kwh, rel=0.01)


def test_a_red_signal_costs_a_stop_and_its_wait() -> None:
    """Against green all the time: the wait, about the kinetic energy, one stop."""
    way = [RoadPart(500.0, 13.4, LINK), RoadPart(500.0, 13.4)]
    free = predict_drive(way, 0.0, lambda _: ALWAYS, DriveParameters())
    red = predict_drive(way, 0.0, lambda _: (Green(70.0, 100.0, True, True),), DriveParameters())
    assert (free.stops, red.stops) == (0.0, 1.0)
    assert 20.0 < red.duration_s - free.duration_s < 45.0
    assert 0.03 < red.energy_kwh - free.energy_kwh < 0.06


def test_waits_hang_on_the_windows() -> None:
    """Before a green, in it, just behind it, between two, and where nothing is known."""
    greens = (Green(10.0, 20.0, True, True), Green(50.0, 60.0, True, False))
    parameters = DriveParameters(startup_s=2.0, late_s=1.0, unknown_wait_s=7.0)
    assert wait_s(greens, 5.0, parameters) == (7.0, True)
    assert wait_s(greens, 11.0, parameters) == (1.0, True)
    assert wait_s(greens, 15.0, parameters) == (0.0, True)
    assert wait_s(greens, 20.9, parameters) == (0.0, True)
    assert wait_s(greens, 30.0, parameters) == (22.0, False)
    assert wait_s(greens, 90.0, parameters) == (7.0, False)


def test_settings_out_of_range_are_refused() -> None:
    """No step of nothing, no pace above what traffic allows."""
    with pytest.raises(ValueError, match="step_s"):
        DepartureSettings(step_s=0.0)
    with pytest.raises(ValueError, match="paces"):
        DepartureSettings(paces=(1.1,))


PATH = (
    *("10th_oakwood-hoosick_10th", "hoosick_10th-hoosick_8th", "hoosick_8th-hoosick_6th"),
    *("hoosick_6th-hoosick_5th", "hoosick_5th-hoosick_river", "hoosick_river-king_river"),
    *("king_river-river_federal", "river_federal-3rd_front", "3rd_front-3rd_broadway"),
)


def test_drives_go_as_foreseen_and_the_chosen_second_costs_less(tmp_path: Path) -> None:
    """Alone in Troy, fixed times: one drive at once, one that begins at the chosen second."""
    from simulation.controllers.signals.departure import DepartureOptimizer
    from simulation.controllers.signals.timing import Signals

    net = load_scenario("troy").net
    types = tmp_path / "types.rou.xml"
    types.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    write_fixed_time(net, tmp_path / "fixed.add.xml")
    options = ["--net-file", str(net), "--route-files", str(types), "--step-length", "0.5"]
    options += ["--additional-files", str(tmp_path / "fixed.add.xml"), "--begin", "25200"]
    options += ["--no-step-log", "true", "--no-warnings", "true"]
    cost_kwh = []
    with Session(options, (net, types)) as session:
        departures = DepartureOptimizer(Signals())
        libsumo.route.add("way", PATH)
        dear = DepartureOptimizer(Signals(), settings=DepartureSettings(value_of_waiting_w=1e6))
        assert dear.best_second(PATH, session.time_s, session.time_s + 32.0) == session.time_s
        for slack_s in (0.0, 32.0):
            # Programs repeat each 80 s.
            session.advance(math.ceil((session.time_s + 1) / 80) * 80 + 10.0)
            now_s = session.time_s
            second_s = departures.best_second(PATH, now_s, now_s + slack_s)
            assert (second_s > now_s) == (slack_s > 0)
            assert second_s <= now_s + slack_s
            predict = departures.predict(PATH, second_s, now_s)
            name = f"after-{slack_s:g}"
            libsumo.vehicle.add(name, "way", typeID="cav", depart=str(second_s), departSpeed="0")
            speeds = [0.0]
            while libsumo.simulation.getMinExpectedNumber() > 0:
                session.advance()
                if name in libsumo.vehicle.getIDList():
                    speeds.append(libsumo.vehicle.getSpeed(name))
            energy_kwh = trace_energy(speeds, 0.5).total_kwh
            assert len(speeds) * 0.5 == pytest.approx(predict.duration_s, rel=0.08)
            assert energy_kwh == pytest.approx(predict.energy_kwh, rel=0.15)
            cost_kwh.append(energy_kwh + len(speeds) * 0.5 * 3000.0 / 3.6e6)
    assert cost_kwh[1] < 0.97 * cost_kwh[0]
