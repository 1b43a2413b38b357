"""Energy and time of turns, from the segments they join or from observed movements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dispatcher_daemon.roads.weights import MIN_COST, Floats, Ints, Weights
from dispatcher_daemon.traffic import Expectations
from slipstream.drive import DrivingStyle
from slipstream.energy import VehicleParameters, stop_energy_kwh

_MIN_MPS = 1e-9
_S_PER_H = 3600.0


@dataclass(frozen=True)
class Basis:
    """Segments and turns as arrays; see `dispatcher_daemon.roads.travel.Roads`."""

    ids: tuple[str, ...]
    turn: Ints
    cost_kwh: Floats
    speed_mps: Floats
    length_m: Floats

    def weights(
        self,
        style: DrivingStyle,
        vehicle: VehicleParameters,
        expected: Expectations | None,
        loss_factor: Floats | float = 1.0,
    ) -> tuple[Weights, Weights, Floats | None]:
        """(energy, kWh; duration, s; time lost before each turn, s, None where nothing is known).

        Without expectations energy is the sum of the segments' costs, and durations are those of
        the drive at planning speeds. With them, losses of movements add up; see `Expectations`.
        Movements that they do not know cost what their segment does.

        Args:
            loss_factor: by which the vehicle's losses differ from the observed vehicles', of each
                segment, shape (m,).
        """
        speed, free_s = self.speed_mps, self.length_m / self.speed_mps
        origin, onto = self.turn
        change_s = _change_s(speed[origin], speed[onto], style)
        begin_s = _change_s(np.zeros(len(speed)), speed, style)
        finish_s = speed / (2 * style.braking_mps2)
        if expected is None:
            return (
                Weights(self.cost_kwh[onto], self.cost_kwh, np.zeros(len(speed))),
                Weights(free_s[onto] + change_s, free_s + begin_s, finish_s),
                None,
            )
        pairs = [(self.ids[a], self.ids[b]) for a, b in self.turn.T.tolist()]
        factor = np.broadcast_to(loss_factor, len(speed))[origin]
        loss = factor * np.array([expected.loss_kwh.get(pair, np.nan) for pair in pairs])
        loss = np.where(np.isnan(loss), self.cost_kwh[origin], loss)
        seconds = np.array([expected.seconds.get(pair, 0.0) for pair in pairs])
        # No movement is faster than the planning speeds allow.
        unhindered_s = free_s[origin] + change_s
        waiting_s = np.maximum(seconds - unhindered_s, 0.0)
        stop_kwh = np.array([stop_energy_kwh(v, vehicle) for v in speed])
        return (
            Weights(loss, np.full(len(speed), MIN_COST), self.cost_kwh + stop_kwh, on_exit=True),
            Weights(
                unhindered_s + waiting_s,
                np.maximum(begin_s, MIN_COST),
                free_s + finish_s,
                on_exit=True,
            ),
            waiting_s,
        )


def objective(
    energy: Weights, time: Weights, search: Literal["energy", "time"], value_of_time_kw: float
) -> Weights:
    """The cost that a search minimises, kWh: energy and the value of time, or time at 1 kW."""
    if search == "time":
        nothing = Weights(0.0 * time.turn, 0.0 * time.begin, 0.0 * time.finish, time.on_exit)
        return nothing.plus(time, 1.0 / _S_PER_H)
    return energy if value_of_time_kw == 0 else energy.plus(time, value_of_time_kw / _S_PER_H)


def _change_s(before_mps: Floats, after_mps: Floats, style: DrivingStyle) -> Floats:
    """Time lost in changing from one speed to another, against an instant change, s.

    Δv²/2av for gaining speed at rate a within the faster segment, likewise for losing it.
    """
    gain = np.maximum(after_mps - before_mps, 0.0)
    loss = np.maximum(before_mps - after_mps, 0.0)
    return np.asarray(
        gain**2 / (2 * style.acceleration_mps2 * np.maximum(after_mps, _MIN_MPS))
        + loss**2 / (2 * style.braking_mps2 * np.maximum(before_mps, _MIN_MPS))
    )
