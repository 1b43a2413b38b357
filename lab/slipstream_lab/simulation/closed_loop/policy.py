"""The policy of an arm: levers of its dispatcher and vehicles, gating, noise, pace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from dispatcher_daemon.settings import AdviceSettings

Lever = Literal["routes", "departures", "platoons", "eco_approach", "coasting", "priority"]

LEVERS: Final[tuple[Lever, ...]] = (
    "routes",
    "departures",
    "platoons",
    "eco_approach",
    "coasting",
    "priority",
)
"""routes: costs of movements with their stops, instead of the paper's costs of segments;
departures: the second that a vehicle leaves at; platoons: which vehicles follow which, and the gap;
eco_approach: speed towards signals by their broadcast timing; coasting: rolling out before turns
and stops, within a time budget; priority: asking signals for green."""

WITHOUT_PRIORITY: Final = frozenset(LEVERS) - {"priority"}


def installed_levers(advice: AdviceSettings) -> frozenset[Lever]:
    """Levers of a dispatcher with this advice. It has not "routes": what roads cost beyond their
    lengths and limits it learns on its way, not on another day.
    """
    has: dict[Lever, bool] = {
        "departures": advice.departure_window_s > 0,
        "platoons": True,
        "eco_approach": advice.eco_approach,
        "coasting": advice.coasting_budget > 0,
        "priority": advice.signal_priority,
    }
    return frozenset(lever for lever, on in has.items() if on)


Gating = Literal["rsu", "open", "random"]
"""Which segments platoons may form on: those that RSUs report as stable; all that are watched; as
many as are reported, elsewhere (see `gates.open_gates`)."""


@dataclass(frozen=True)
class WaitingPrices:
    """What an hour of waiting for other vehicles costs, kWh, by the objective of energy; None: as
    driving time does. The paper's objective has no price of waiting.

    Attributes:
        standing_kw: at a stop that has been served; None: `waiting_kw` if that is more.
    """

    waiting_kw: float | None = None
    standing_kw: float | None = None


AS_DRIVING: Final = WaitingPrices()


@dataclass(frozen=True)
class Policy:
    """An arm.

    Attributes:
        noise: the paper's, on the six features: each times 1 + noise · N(0, 1).
        pace: the fleet's desired speed over the limit, in every arm 1 but in those that the
            baseline is slowed or hurried in to compare at equal travel time.
        installed: whether its dispatcher is set as an installation's is by default, which has
            `installed_levers`.
        brakes: of its vehicles: those of their type, or the paper's, which act at once.
    """

    name: str
    levers: frozenset[Lever] = frozenset()
    search: Literal["time", "energy"] = "energy"
    gating: Gating = "rsu"
    noise: float = 0.0
    pace: float = 1.0
    coasting_budget: float = AdviceSettings().coasting_budget
    solver: str = "exact"
    installed: bool = False
    brakes: Literal["type", "ideal"] = "type"
