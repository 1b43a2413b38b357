"""Arms that nobody simulated: made up by a rule, for what is done with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from slipstream.energy.consumption import Energy
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.closed_loop.record import (
    ArmResult,
    LoopCycleRecord,
    OrderService,
    Others,
)
from slipstream_lab.simulation.evaluation.runs.provenance import Provenance
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg
from slipstream_lab.simulation.fleet.losses import Losses

GROUND = Provenance(
    "toy", "n" * 64, "d" * 64, "", "f" * 64, "p" * 64, "actuated", 6 * 3600.0, 9 * 3600.0, 0.5
)

_SAVES = {
    "routes": 0.02,
    "departures": 0.01,
    "platoons": 0.02,
    "eco_approach": 0.04,
    "coasting": 0.06,
    "priority": 0.06,
}


def make_arm(policy: Policy, seed: int, legs: int = 24, **changes: Any) -> ArmResult:
    """An arm over three hours of a morning: each lever saves its share of acceleration energy, a
    slower pace saves energy for time, platoons draft."""
    rng = np.random.default_rng([seed])
    saved = sum(_SAVES[lever] for lever in sorted(policy.levers))
    platooned = 0.5 if "platoons" in policy.levers else 0.0
    platooned *= {"rsu": 1.0, "open": 1.5, "random": 0.8}[policy.gating] * (1 - policy.noise)
    driven = []
    for number in range(legs):
        distance_m = float(rng.uniform(1000, 5000))
        due_s = GROUND.begin_s + 10000.0 * number / legs
        travel_s = distance_m / 12.0 / policy.pace * (1 + 0.5 * saved)
        rolling = 0.065e-3 * distance_m
        drag = 0.03e-3 * distance_m * policy.pace**2
        braking = 0.07e-3 * distance_m * policy.pace * (1 - 2 * saved * (1 - policy.noise / 4))
        alone = Energy(rolling + drag + braking, rolling, drag, braking)
        less = 0.1 * platooned * drag
        driven.append(
            DrivenLeg(
                vehicle=f"van-{number % 4:02}",
                round=number // 4,
                leg=0,
                ready_s=due_s,
                due_s=due_s,
                departed_s=due_s + 1.0,
                arrived_s=due_s + travel_s,
                free_s=travel_s * 0.8,
                distance_m=distance_m,
                driven=alone._replace(total_kwh=alone.total_kwh - less, drag_kwh=drag - less),
                alone=alone,
                led_m=platooned * distance_m / 2,
                followed_m=platooned * distance_m / 2,
                stops=round(3 * (1 - saved)),
                waited_s=20.0 * (1 - saved),
                turbulent_s=0.0 if policy.gating == "rsu" else 5.0,
                path=("e0_main", "e1_leave", "e1_mid"),  # of the corridor
                losses=Losses(rolling, drag, braking / 4, braking / 2, braking / 4),
                missed_m={"gates": 30.0, "closing up": 12.0} if platooned else {},
            )
        )
    result = ArmResult(
        scenario=GROUND.scenario,
        seed=seed,
        policy=policy.name,
        begin_s=GROUND.begin_s,
        end_s=GROUND.end_s,
        legs=tuple(driven),
        services=tuple(
            OrderService(f"o{n}", leg.due_s + 1200.0, leg.arrived_s) for n, leg in enumerate(driven)
        ),
        cycles=tuple(
            LoopCycleRecord(
                time_s=GROUND.begin_s + 300.0 * n,
                status="ok",
                vehicles=2,
                planned_kwh=1.0,
                planned_platooned_m=100.0,
                planned_drafting_kwh=0.002,
                open=round(8 * (1 - policy.noise)),
                judged=10,
                watched=12,
                open_turbulent=0 if policy.gating == "rsu" else 1,
            )
            for n in range(36)
        ),
        others=Others(1000, 300.0 + 10 * ("priority" in policy.levers), 60.0, 2.0, 1000),
        disengagements=0 if policy.gating == "rsu" else 3,
        teleports=0,
        collisions=0,
        emergency_stops=0,
        gridlock_s=None,
        unfinished=0,
    )
    return replace(result, **changes)
