"""Rendezvous of two vehicles at a distance: whether it saves energy, and at which speeds.

The rear one drives (1 + a) v, the front one (1 − b) v. They have closed a distance d after
T = d / ((a + b) v), the rear one having come x = (1 + a) v T. From there on to where they part,
drafting saves η ½ρC_dA v² on each metre with an open gate. What it costs:

- drag: ½ρC_dA v² ((1 + a)² − 1) on x for the rear one, less by as much for the front one;
- time: the rear one gains a T, the front one loses b T, each second at the price at which v is
  the speed that one would choose: C(v) = E(v) + π t is least at v for π = ρC_dA v³ / η_elec. So
  small changes of speed cost nothing to first order; 5 % cost as much as 1 % of drag;
- speed: nothing. Both change it within what traction and coasting do (see `following_mps`), so the
  energy put into speed is not braked away. Traffic in between may do that: a margin is asked for.

a is limited by the speed limit, over which nobody drives: who drives at it waits to be waited for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from slipstream.energy.traction import VehicleParameters, drag_saving_kwh
from slipstream.spacing import MAX_SLOWDOWN

MAX_SPEEDUP: Final = 0.10
"""Largest share above its own speed."""

_SLOWDOWNS: Final = (0.0, 0.05, 0.1, MAX_SLOWDOWN)

MARGIN_KWH: Final = 0.001
"""Smallest saving of a manoeuvre: a fiftieth of a stop from 13.9 m/s, or 30 m of drafting by two
vehicles at 30 m/s."""

MAX_CLOSING_S: Final = 300.0


@dataclass(frozen=True, slots=True)
class Rendezvous:
    """Speeds, time and gain of a rendezvous.

    Attributes:
        speedup: a, of the rear one.
        slowdown: b, of the front one.
        closing_s: T.
        way_m: x, from where the rear one is now.
        gain_kwh: energy that it saves.
    """

    speedup: float
    slowdown: float
    closing_s: float
    way_m: float
    gain_kwh: float


def best_rendezvous(
    distance_m: float,
    speed_mps: float,
    open_beyond_m: Callable[[float], float],
    drag_reduction: float,
    *,
    max_speedup: float,
    vehicle: VehicleParameters,
    margin_kwh: float = MARGIN_KWH,
) -> Rendezvous | None:
    """The rendezvous with the largest gain; None if none exceeds the margin.

    Args:
        distance_m: d, to be closed.
        speed_mps: v, that both like to drive.
        open_beyond_m: distance with open gates on the shared path, beyond a distance of the rear
            vehicle, m.
        drag_reduction: η that drafting adds, of both vehicles together.
        max_speedup: that the limit leaves the rear one; `MAX_SPEEDUP` bounds it too.
        vehicle: the rear one's physics; those of the front one are not known.
        margin_kwh: to be exceeded.
    """
    best: Rendezvous | None = None
    a_max = max(0.0, min(MAX_SPEEDUP, max_speedup))
    for a in (0.0, a_max / 2, a_max) if a_max > 0 else (0.0,):
        for b in _SLOWDOWNS:
            if (a + b) * MAX_CLOSING_S * speed_mps < distance_m or a + b <= 0:
                continue
            closing_s = distance_m / ((a + b) * speed_mps)
            way_m = (1 + a) * speed_mps * closing_s
            saved = drag_saving_kwh(open_beyond_m(way_m), speed_mps, drag_reduction, vehicle)
            gain = saved - manoeuvre_kwh(a, b, speed_mps, closing_s, vehicle)
            if gain > margin_kwh and (best is None or gain > best.gain_kwh):
                best = Rendezvous(a, b, closing_s, way_m, gain)
    return best


def manoeuvre_kwh(
    speedup: float, slowdown: float, speed_mps: float, closing_s: float, vehicle: VehicleParameters
) -> float:
    """What closing costs in drag and time, kWh: see the module."""
    drag_n = vehicle.drag_force_n(speed_mps)
    work_j = 0.0
    for change in (speedup, -slowdown):
        way_m = (1 + change) * speed_mps * closing_s
        work_j += drag_n * ((1 + change) ** 2 - 1) * way_m
        work_j -= 2 * drag_n * speed_mps * change * closing_s
    return vehicle.electrical_kwh(work_j)
