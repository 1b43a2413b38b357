"""The physics beside SUMO's Energy model, in a process of its own: libsumo may end it."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from slipstream.energy.consumption import PAPER_CAR, VehicleParameters, stack_traces, trace_energies

NET: Final = Path(__file__).resolve().parents[3] / "slipstream" / "data" / "demo.net.xml"
STEP_S: Final = 0.5
SUMO_AIR_DENSITY_KGPM3: Final = 1.2041

# What the paper's model leaves out is switched off; SUMO's air density cannot be set.
ROUTES: Final = f"""<routes>
    <vType id="car" emissionClass="Energy/unknown" mass="{PAPER_CAR.mass_kg}" carFollowModel="IDM">
        <param key="has.battery.device" value="true"/>
        <param key="frontSurfaceArea" value="{PAPER_CAR.frontal_area_m2}"/>
        <param key="airDragCoefficient" value="{PAPER_CAR.drag_coefficient}"/>
        <param key="rollDragCoefficient" value="{PAPER_CAR.rolling_resistance}"/>
        <param key="propulsionEfficiency" value="{PAPER_CAR.powertrain_efficiency}"/>
        <param key="recuperationEfficiency" value="0"/>
        <param key="constantPowerIntake" value="0"/>
        <param key="rotatingMass" value="0"/>
        <param key="radialDragCoefficient" value="0"/>
        <param key="stoppingThreshold" value="0"/>
    </vType>
    <flow id="there" type="car" begin="0" end="200" period="8"
          from="depot_road_east" to="dock_street_east"/>
    <flow id="back" type="car" begin="0" end="200" period="11"
          from="depot_road_east" to="depot_road_west" via="avenue_east">
        <stop edge="avenue_east" endPos="900" duration="5"/>
    </flow>
</routes>
"""

DRIVE: Final = """
import json, sys
import libsumo
net, routes, step_s = sys.argv[1:]
libsumo.start(["sumo", "-n", net, "-r", routes, "--step-length", step_s, "--seed", "1",
               "--no-step-log", "true", "--no-warnings", "true"])
drives = {}
while libsumo.simulation.getMinExpectedNumber() > 0:
    libsumo.simulationStep()
    for name in libsumo.vehicle.getIDList():
        speed = libsumo.vehicle.getSpeed(name)
        wh_per_s = libsumo.vehicle.getElectricityConsumption(name)
        drives.setdefault(name, []).append((speed, wh_per_s))
libsumo.close()
print(json.dumps(list(drives.values())))
"""


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    """Speed in m/s and SUMO's consumption in Wh/s of each vehicle, step by step, shape (n, 2)."""
    if find_spec("libsumo") is None:
        pytest.skip("libsumo is not installed")
    routes = tmp_path_factory.mktemp("sumo") / "cars.rou.xml"
    routes.write_text(ROUTES)
    done = subprocess.run(
        [sys.executable, "-c", DRIVE, str(NET), str(routes), str(STEP_S)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return [np.array(drive) for drive in json.loads(done.stdout.splitlines()[-1])]


def ratios(drives: list[np.ndarray], vehicle: VehicleParameters) -> tuple[float, np.ndarray]:
    """Our energy over SUMO's: of all vehicles together, and of each."""
    # A vehicle is put on the road with a speed: its first sample has no step before it.
    sumo_kwh = np.array([drive[1:, 1].sum() * STEP_S for drive in drives]) / 1e3
    traces = stack_traces([drive[:, 0] for drive in drives])
    ours_kwh = trace_energies(traces, STEP_S, vehicle=vehicle).total_kwh
    return float(ours_kwh.sum() / sumo_kwh.sum()), ours_kwh / sumo_kwh


@pytest.mark.process
def test_sumos_energy_model_agrees_within_half_a_percent(drives: list[np.ndarray]) -> None:
    """The paper's car in stop-and-go traffic, 0.5 s steps (measured: 1.0029)."""
    assert len(drives) > 30
    assert min(drive[:, 0].min() for drive in drives) < 0.1
    together, _ = ratios(drives, PAPER_CAR)
    assert together == pytest.approx(1.0, abs=0.005)


@pytest.mark.slow
def test_what_is_left_is_sumos_air(drives: list[np.ndarray]) -> None:
    """In SUMO's thinner air every single drive agrees within 0.2 % (measured: 0.17 %)."""
    thin = VehicleParameters(air_density_kgpm3=SUMO_AIR_DENSITY_KGPM3)
    together, each = ratios(drives, thin)
    assert together == pytest.approx(1.0, abs=0.002)
    assert np.abs(each - 1).max() < 0.002
