"""Predicted time and energy of a leg by its departure second: a drive through known signals.

A vehicle alone on its road follows the IDM, dv/dt = a (1 − (v/v₀)⁴), which has closed forms:
v² = v₀² tanh(2as/v₀² + c), t = v₀/(2a) [atan x + artanh x] with x = v/v₀, and
∫v² ds = v₀⁴/(2a) ln cosh(2as/v₀² + c). It brakes at a constant rate before turns and stop lines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from slipstream.energy.traction import PAPER_CAR, VehicleParameters
from vehicle_agent.signals.timings import Green


class Movement(NamedTuple):
    """A signal group of an intersection."""

    intersection: str
    group: int


Greens = Callable[[Movement], Sequence[Green]]
"""What is known of a movement, soonest first."""

_NEAR_DESIRED: Final = 0.9995
"""Of the desired speed: the IDM comes no nearer in finite time."""

_ITERATIONS: Final = 6

_ACCELERATION_MPS2: Final = 1.8
"""The IDM's largest one."""
_BRAKING_MPS2: Final = 1.0
"""Before turns and the end."""
_SLOWING_MPS2: Final = 1.5
"""Before a signal that turns green while it comes near."""
_STARTUP_S: Final = 1.5
"""From green to passing the stop line, where others may stand before."""
YIELDING_MPS: Final = 3.0
"""Where the vehicle may have to give way."""
_LATE_S: Final = 1.0
"""After the end of green it still passes."""
_UNKNOWN_WAIT_S: Final = 4.0
"""Wait at a signal whose state at the arrival is unknown."""


class RoadPart(NamedTuple):
    """A part of a path with one desired speed, > 0, the movement through the signal at its end, if
    there is one, and the speed allowed there.
    """

    length_m: float
    speed_mps: float
    movement: Movement | None = None
    end_mps: float = math.inf


class PredictedDrive(NamedTuple):
    """Predicted drive from rest to rest."""

    duration_s: float
    energy_kwh: float


class Gain(NamedTuple):
    """Driving on towards a desired speed: speed at the end, time, ∫v² ds."""

    speed_mps: float
    seconds: float
    squares_m3ps2: float


def drive_on(speed_mps: float, desired_mps: float, length_m: float) -> Gain:
    """The IDM alone on a road; a vehicle that is faster than it likes drops to that at once."""
    if length_m <= 0:
        return Gain(speed_mps, 0.0, 0.0)
    v0, a = desired_mps, _ACCELERATION_MPS2
    x0 = min(speed_mps / v0, _NEAR_DESIRED)
    c = math.atanh(x0 * x0)
    rate = 2 * a / (v0 * v0)
    y = rate * length_m + c
    x1 = max(x0, min(math.sqrt(math.tanh(y)), _NEAR_DESIRED))
    seconds = v0 / (2 * a) * (_time_integral(x1) - _time_integral(x0))
    if x1 == _NEAR_DESIRED:
        # Beyond the speed that counts as reached, it cruises.
        left_m = length_m - (math.atanh(x1 * x1) - c) / rate
        seconds += max(0.0, left_m) / (x1 * v0)
    squares = v0 * v0 / rate * (_log_cosh(y) - _log_cosh(c))
    return Gain(x1 * v0, seconds, squares)


def _time_integral(x: float) -> float:
    return math.atan(x) + math.atanh(x)


def _log_cosh(y: float) -> float:
    return y + math.log1p(math.exp(-2 * y)) - math.log(2)


def predict_drive(
    way: Sequence[RoadPart],
    depart_s: float,
    greens: Greens,
    vehicle: VehicleParameters = PAPER_CAR,
) -> PredictedDrive:
    """A leg from rest to rest, by what is known of movements."""
    rolling_n, drag = vehicle.rolling_force_n, vehicle.drag_factor_kgpm
    now_s, speed, work_j = depart_s, 0.0, 0.0
    for stretch, cap in zip(way, _caps(way), strict=True):
        gain, braked_m = _towards(speed, stretch, cap)
        work_j += 0.5 * vehicle.mass_kg * max(0.0, gain.speed_mps**2 - speed**2)
        work_j += rolling_n * (stretch.length_m - braked_m) + drag * gain.squares_m3ps2
        now_s += gain.seconds
        speed = gain.speed_mps
        if braked_m > 0:
            now_s += 2 * braked_m / (speed + cap)
            speed = cap
        if stretch.movement is None:
            continue
        waiting_s, protected = wait_s(greens(stretch.movement), now_s)
        b = _SLOWING_MPS2
        slowest = max(0.0, speed - math.sqrt(2 * b * speed * waiting_s))
        if not protected:
            slowest = min(slowest, YIELDING_MPS)
        if slowest < speed:
            work_j -= _traction_free_j(speed, slowest, b, stretch.length_m, vehicle)
            now_s += max(waiting_s, _braking_loss_s(speed, slowest, b))
            speed = slowest
    return PredictedDrive(now_s - depart_s, vehicle.electrical_kwh(max(0.0, work_j)))


def wait_s(greens: Sequence[Green], arrival_s: float) -> tuple[float, bool]:
    """Wait at a stop line, and whether the movement is protected then."""
    protected = True
    for green in greens:
        protected = green.protected
        if arrival_s <= green.end_s + _LATE_S:
            return max(0.0, green.begin_s + _STARTUP_S - arrival_s), protected
    return _UNKNOWN_WAIT_S, protected


def _caps(way: Sequence[RoadPart]) -> list[float]:
    """The highest speed at the end of each stretch from which the next ones can be driven."""
    caps = [0.0] * len(way)
    after = 0.0
    for number in range(len(way) - 1, -1, -1):
        stretch = way[number]
        after = caps[number] = min(after, stretch.end_mps)
        after = min(
            stretch.speed_mps, math.sqrt(after * after + 2 * _BRAKING_MPS2 * stretch.length_m)
        )
    return caps


def _towards(speed_mps: float, stretch: RoadPart, cap_mps: float) -> tuple[Gain, float]:
    """Drive on, then brake to a cap: the drive before braking, and the braking distance."""
    length_m = stretch.length_m
    gain = drive_on(speed_mps, stretch.speed_mps, length_m)
    if gain.speed_mps <= cap_mps:
        return gain, 0.0
    braked_m = 0.0
    for _ in range(_ITERATIONS):
        # The later it brakes, the faster it is, the earlier it must: halfway between both.
        needed_m = (gain.speed_mps**2 - cap_mps**2) / (2 * _BRAKING_MPS2)
        braked_m = min(length_m, 0.5 * (braked_m + needed_m))
        gain = drive_on(speed_mps, stretch.speed_mps, length_m - braked_m)
    return gain, braked_m


def _traction_free_j(
    speed: float, slower: float, braking_mps2: float, length_m: float, vehicle: VehicleParameters
) -> float:
    """Work against rolling and drag that is not needed where a vehicle brakes, J."""
    braked_m = min(length_m, (speed * speed - slower * slower) / (2 * braking_mps2))
    return (vehicle.rolling_force_n + vehicle.drag_factor_kgpm * speed * speed) * braked_m


def _braking_loss_s(speed: float, slower: float, braking_mps2: float) -> float:
    """Time that braking takes longer than driving on over the same distance, s."""
    if speed <= slower:
        return 0.0
    return (speed - slower) ** 2 / (2 * braking_mps2 * speed)
