"""How the fleet's dispatcher is set where its days have to be the same again, byte for byte."""

from __future__ import annotations

from typing import Final

from dispatcher_daemon.settings import (
    AdviceSettings,
    CitySettings,
    DispatcherSettings,
    OrderSettings,
    SearchSettings,
)
from dispatcher_daemon.solvers import BASELINE_SOLVER, ExactSolver, configured_solvers
from dispatcher_daemon.solvers.workers import Solve, solve_in_process
from slipstream_lab.simulation.closed_loop.policy import Policy
from vehicle_agent.signals import DEPARTURE_WINDOW_S

DEFAULT_TIME_WORTH_KW: Final = 10.0
"""Value of driving time in a city at the limit; see `history_file.time_worth_kw`."""

_AMPLE_S: Final = 250.0
"""No cycle of a delivery fleet takes so long, however busy the machine is."""


def evaluation_settings(solver: str = "exact") -> DispatcherSettings:
    """Settings under which iterations end every search, never the clock.

    Give `run_cycle` `reference_s=0` with them: a simulation does not advance during a cycle. By
    default a fleet's times count from `settings.deadline_s` after the cycle's start.
    """
    search = SearchSettings(
        rounds=3,
        iterations_per_stop=30,
        iterations_to_feasible=2000,
        workers=1,
        time_limit_s=_AMPLE_S,
    )
    city = CitySettings(
        search=search,
        second_rounds=1,
        ways=3,
        ways_legs=100,
        wave=1,
        max_sweeps=6,
        patience=2,
        block_deadline_s=_AMPLE_S,
        solvers=(solver,),
    )
    return DispatcherSettings(
        interval_s=300.0,
        deadline_s=_AMPLE_S,
        sync_window_s=3.0,
        gap_m=1.5,
        form="route",
        solvers=("exact",),
        city=city,
        orders=OrderSettings(bundle_s=0.0),
    )


def installed_settings(policy: Policy, seed: int) -> DispatcherSettings:
    """An installation's default settings, with the advice that the policy has.

    But the clock ends no search, so that a day is the same again, and no circuits run beside the
    exact solver, whose answer to a block none of theirs is better than. Vehicles leave `deadline_s`
    of an installation after a cycle begins all the same.
    """
    settings = DispatcherSettings(seed=seed)
    city = settings.city
    search = city.search.model_copy(update={"time_limit_s": _AMPLE_S})
    unhurried = {"search": search, "block_deadline_s": _AMPLE_S}
    changed = {
        "deadline_s": _AMPLE_S,
        "solvers": (BASELINE_SOLVER,),
        "city": city.model_copy(update=unhurried),
        "advice": advice_of(policy),
    }
    return settings.model_copy(update=changed)


def advice_of(policy: Policy) -> AdviceSettings:
    """The advice in an arm's plans."""
    levers = policy.levers
    return AdviceSettings(
        eco_approach="eco_approach" in levers,
        coasting_budget=policy.coasting_budget if "coasting" in levers else 0.0,
        signal_priority="priority" in levers,
        departure_window_s=DEPARTURE_WINDOW_S if "departures" in levers else 0.0,
    )


def evaluation_solve(settings: DispatcherSettings | None = None) -> Solve:
    """The solvers of these settings, in this process; by default the exact one."""
    return solve_in_process([ExactSolver()] if settings is None else configured_solvers(settings))
