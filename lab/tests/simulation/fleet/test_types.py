"""A fleet of vans or of trucks: its shape in SUMO, its energies, its gaps and its drafting."""

from __future__ import annotations

from pathlib import Path

import libsumo
import numpy as np
import pytest

from lab.tests.simulation.fleet.road import plan, running, segments, write_line
from slipstream.config import load
from slipstream.energy.consumption import trace_energy
from slipstream.energy.drafting import reductions_at
from slipstream.errors import InputError
from slipstream.spacing import least_gap_m
from slipstream.vehicle_types import PRESETS
from slipstream_lab.simulation.fleet.losses import losses
from slipstream_lab.simulation.scenarios.demand import FleetSettings, draw_deliveries, fleet_at
from slipstream_lab.simulation.scenarios.scenario import load_scenario

STEP_S = 0.5
PROMISED_MPS2 = 2.0


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["van", "truck_40t"])
def test_two_drive_by_the_physics_the_brakes_and_the_drag_law_of_their_type(
    tmp_path: Path, preset: str
) -> None:
    """A pair is close, no nearer than its brakes allow, no faster than it can drive, and drafts as
    was measured for its type.
    """
    kind = PRESETS[preset]
    braking, physics = kind.brakes.on("dry"), kind.profile.physics
    with running(write_line(tmp_path), ["v0", "v1"], step_s=STEP_S, preset=preset) as town:
        town.flags.y_e = dict.fromkeys("abc", 1)
        for place in (0, 1):
            own = plan(segments("abc", 0, place), vehicle=f"v{place}", depart_s=10.0 + place)
            town.exchange.send_plan(own.model_copy(update={"issued_ns": 0}))
        gaps, fastest_mps = [], 0.0
        while town.world.tours_finished < 2:
            town.step()
            for name, advice in town.exchange.advised.items():
                sensed = town.exchange.sensed[name]
                fastest_mps = max(fastest_mps, sensed.speed_mps)
                if advice.mode == "follow" and sensed.speed_mps > 20.0 and sensed.ahead:
                    gaps.append(sensed.ahead.gap_m)
            assert town.session.time_s < 900.0
        kinds = libsumo.vehicletype
        shape = [(kinds.getLength(n), kinds.getWidth(n)) for n in kinds.getIDList() if "cav" in n]
    assert set(shape) == {(kind.length_m, kind.width_m)}
    assert kind.max_speed_mps is not None
    assert fastest_mps < min(30.0, kind.max_speed_mps) + 0.2
    allowed_m = least_gap_m(20.0, PROMISED_MPS2, braking, STEP_S)
    assert town.world.safety.found.collisions == 0
    assert np.median(gaps) == pytest.approx(allowed_m, abs=0.6)
    leader, follower = sorted(town.legs, key=lambda leg: leg.followed_m)
    assert min(leader.led_m, follower.followed_m) > 2000.0
    best = reductions_at(kind.drafting, 0.0)
    for leg, most in ((leader, best.leader), (follower, best.follower)):
        share = 1 - leg.driven.drag_kwh / leg.alone.drag_kwh
        assert 0.3 * most < share <= most
        rolling_j = physics.rolling_force_n * leg.distance_m
        assert sum(leg.losses) == pytest.approx(leg.alone.total_kwh, rel=1e-6)
        assert leg.losses.rolling_kwh == pytest.approx(physics.electrical_kwh(rolling_j), rel=1e-3)


def test_losses_of_a_type_that_recuperates_add_up_to_its_energy() -> None:
    """What braking gives back is no loss."""
    speeds = [*np.linspace(0, 20, 21), *np.linspace(19, 0, 11)]
    for kind in PRESETS.values():
        physics = kind.profile.physics
        whole = trace_energy(speeds, 1.0, 0.0, physics).total_kwh
        assert sum(losses(speeds, 1.0, physics)) == pytest.approx(whole)


@pytest.mark.slow
def test_the_dispatcher_plans_with_the_fleets_type(tmp_path: Path) -> None:
    """As its file has it, or as it is asked for beside the file; charge is not looked at."""
    path = tmp_path / "fleet.toml"
    path.write_text('type = "van"\n')
    for asked, expected in ((None, "van"), ("truck_40t", "truck_40t")):
        scenario = load_scenario("corridor", fleet=path, type=asked)  # type: ignore[arg-type]
        day = draw_deliveries(scenario.fleet, scenario.network, 1)
        fleet = fleet_at(day, 43_200.0, dict.fromkeys(day.vehicles, 43_200.0), ())
        assert fleet is not None
        for vehicle in fleet.vehicles:
            kind = fleet.type_of(vehicle)
            assert kind is not None
            assert kind.profile == PRESETS[expected].profile
            assert kind.battery_kwh is None


def test_a_type_that_is_none_is_refused(tmp_path: Path) -> None:
    """File and key are named, and what there is."""
    path = tmp_path / "fleet.toml"
    path.write_text('type = "lorry"\n')
    with pytest.raises(InputError, match="paper_car") as refused:
        load(path, FleetSettings)
    assert (str(refused.value.source), refused.value.key) == (str(path), "type")
