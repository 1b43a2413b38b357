"""Energy and time of turns, from the segments they join or from observed movements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dispatcher_daemon.planning.roads.weights import MIN_COST, Floats, Ints, Weights
from dispatcher_daemon.traffic import Expectations
from slipstream.energy.consumption import VehicleParameters, phase_energies, stop_energy_kwh
from slipstream.energy.drive import DrivingStyle

_MIN_MPS = 1e-9
_S_PER_H = 3600.0


@dataclass(frozen=True)
class TurnCosts:
    """What paths cost; see `dispatcher_daemon.planning.roads.travel.Roads`.

    Attributes:
        energy: as the objective counts it, kWh.
        time: s.
        expected: physical energy that is expected of a path whatever the objective, kWh: what it
            takes beyond its drive at planning speeds; where movements were observed, all of it.
        waiting_s: expected delay before each turn, s, shape (t,); None: not known.
        observed: whether movements were.
        exact: whether a path costs its drive and what is expected beyond it; `energy` is that to
            about as much. Otherwise it costs `energy`.
    """

    energy: Weights
    time: Weights
    expected: Weights
    waiting_s: Floats | None = None
    observed: bool = False
    exact: bool = False


@dataclass(frozen=True)
class Basis:
    """Segments and turns as arrays; see `dispatcher_daemon.planning.roads.travel.Roads`.

    Attributes:
        cost_kwh: of the paper's segments, expected stops included, shape (m,).
        held_kwh: of segments at their planning speed, without stops, shape (m,).
        steady_kwh: the same in calm traffic, shape (m,).
        stops: expected at the end of each segment, shape (m,).
    """

    ids: tuple[str, ...]
    turn: Ints
    cost_kwh: Floats
    held_kwh: Floats
    steady_kwh: Floats
    stops: Floats
    speed_mps: Floats
    length_m: Floats
    style: DrivingStyle
    vehicle: VehicleParameters

    def paper_costs(self) -> TurnCosts:
        """The sum of the segments' costs (section III-C), and the drive's time."""
        onto, speed = self.turn[1], self.speed_mps
        free_s, rest = self.length_m / speed, np.zeros(len(speed))
        return TurnCosts(
            Weights(self.cost_kwh[onto], self.cost_kwh, rest),
            Weights(
                free_s[onto] + self._change_s,
                free_s + _change_s(rest, speed, self.style),
                speed / (2 * self.style.braking_mps2),
            ),
            self._beyond(self._stop()[0]),
        )

    def drive_costs(self) -> TurnCosts:
        """The energy of the drive with its changes of speed, from rest to rest, and of the stops
        and the turbulence that are expected on it.

        What gaining speed takes is counted where it is lost again, so that no part is below 0 but
        the begin's. The sum over a path is the energy of `plan_drive` where segments are long
        enough to change speed on. A stop at the end of the last segment is the arrival.
        """
        origin, onto = self.turn
        speed, rest = self.speed_mps, np.zeros(len(self.speed_mps))
        kinetic_kwh = self.vehicle.electrical_kwh(0.5 * self.vehicle.mass_kg) * speed**2
        stop_kwh, stop_s = self._stop()
        lost_kwh = self._turn_kwh + kinetic_kwh[origin] - kinetic_kwh[onto]
        driving = self._driving_s(stop_s)
        return TurnCosts(
            Weights(
                np.maximum(self.held_kwh[origin] + lost_kwh + stop_kwh, MIN_COST),
                self._change_kwh(rest, speed) - kinetic_kwh,
                self.held_kwh + self._change_kwh(speed, rest) + kinetic_kwh,
                on_exit=True,
            ),
            driving,
            self._beyond(stop_kwh),
            stop_s,
            exact=True,
        )

    def observed_costs(
        self, expected: Expectations, loss_factor: Floats | float, *, exact: bool
    ) -> TurnCosts:
        """Losses of movements and their times, as observed; see `Expectations`.

        Args:
            loss_factor: losses by those of the observed vehicles, of each segment, shape (m,).
            exact: whether unknown movements cost what their drive does, or what their segment does.
        """
        origin, speed = self.turn[0], self.speed_mps
        drive = self.drive_costs()
        if exact:
            assert drive.waiting_s is not None
            energy, unknown_s = drive.energy, drive.waiting_s
        else:
            finish_kwh = self.cost_kwh + [stop_energy_kwh(v, self.vehicle) for v in speed]
            energy = Weights(self.cost_kwh[origin], np.full(len(speed), MIN_COST), finish_kwh, True)
            unknown_s = np.zeros(len(origin))
        pairs = [(self.ids[a], self.ids[b]) for a, b in self.turn.T.tolist()]
        factor = np.broadcast_to(loss_factor, len(speed))[origin]
        loss = factor * np.array([expected.loss_kwh.get(pair, np.nan) for pair in pairs])
        counted, physical = (
            replace(of, turn=np.where(np.isnan(loss), of.turn, loss))
            for of in (energy, drive.energy)
        )
        # No movement is faster than the planning speeds allow.
        unhindered_s = self.length_m[origin] / speed[origin] + self._change_s
        seconds = np.array([expected.seconds.get(pair, np.nan) for pair in pairs])
        waiting_s = np.where(np.isnan(seconds), unknown_s, np.maximum(seconds - unhindered_s, 0.0))
        return TurnCosts(counted, self._driving_s(waiting_s), physical, waiting_s, observed=True)

    def _beyond(self, stop_kwh: Floats) -> Weights:
        """What turbulence and expected stops take beyond a drive at planning speeds."""
        turbulence = self.held_kwh - self.steady_kwh
        rest = np.zeros(len(turbulence))
        return Weights(turbulence[self.turn[0]] + stop_kwh, rest, turbulence, on_exit=True)

    @property
    def _change_s(self) -> Floats:
        origin, onto = self.turn
        return _change_s(self.speed_mps[origin], self.speed_mps[onto], self.style)

    @property
    def _turn_kwh(self) -> Floats:
        """Energy of each turn's change of speed, beyond that of holding the speeds."""
        origin, onto = self.turn
        return self._change_kwh(
            self.speed_mps[origin], self.speed_mps[onto], self._rate[origin], self._rate[onto]
        )

    def _driving_s(self, waiting_s: Floats) -> Weights:
        """Durations, with a delay before each turn."""
        speed, free_s = self.speed_mps, self.length_m / self.speed_mps
        begin_s = _change_s(np.zeros(len(speed)), speed, self.style)
        return Weights(
            free_s[self.turn[0]] + self._change_s + waiting_s,
            np.maximum(begin_s, MIN_COST),
            free_s + speed / (2 * self.style.braking_mps2),
            on_exit=True,
        )

    def _stop(self) -> tuple[Floats, Floats]:
        """(kWh, s) of the expected stops before each turn, beyond changing speed without one."""
        origin, onto = self.turn
        before, after = self.speed_mps[origin], self.speed_mps[onto]
        rate, rest = self._rate, np.zeros(len(origin))
        stops = self.stops[origin]
        kwh = self._change_kwh(before, rest, rate[origin], rate[origin])
        kwh = kwh + self._change_kwh(rest, after, rate[onto], rate[onto]) - self._turn_kwh
        seconds = _change_s(before, rest, self.style) + _change_s(rest, after, self.style)
        return stops * np.maximum(kwh, 0.0), stops * np.maximum(seconds - self._change_s, 0.0)

    @property
    def _rate(self) -> Floats:
        """Energy of a metre of each segment at its planning speed in calm traffic, kWh."""
        return self.steady_kwh / self.length_m

    def _change_kwh(
        self,
        before_mps: Floats,
        after_mps: Floats,
        before_rate: Floats | None = None,
        after_rate: Floats | None = None,
    ) -> Floats:
        """Energy of changing speed beyond holding the higher one, kWh; < 0 where it is lost."""
        gains = after_mps > before_mps
        rates = self.style.acceleration_mps2, self.style.braking_mps2
        rate_mps2 = np.where(gains, *rates)
        duration_s = np.abs(after_mps - before_mps) / rate_mps2
        distance_m = np.abs(after_mps**2 - before_mps**2) / (2 * rate_mps2)
        held = np.where(
            gains,
            self._rate if after_rate is None else after_rate,
            self._rate if before_rate is None else before_rate,
        )
        changing = phase_energies(before_mps, after_mps, duration_s, vehicle=self.vehicle)
        return np.asarray(changing.total_kwh - held * distance_m)


def search_weights(
    costs: TurnCosts, search: Literal["energy", "time"], price_of_time_kw: float
) -> Weights:
    """The cost that a search minimises, kWh: energy and the price of time, or time at 1 kW."""
    energy, time = costs.energy, costs.time
    if search == "time":
        nothing = Weights(0.0 * time.turn, 0.0 * time.begin, 0.0 * time.finish, time.on_exit)
        return nothing.plus(time, 1.0 / _S_PER_H)
    return energy if price_of_time_kw == 0 else energy.plus(time, price_of_time_kw / _S_PER_H)


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
