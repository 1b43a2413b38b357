"""Settings of the route form and of its search for base routes."""

from __future__ import annotations

from pydantic import Field

from dispatcher_daemon.settings.solvers import SolverName
from slipstream.config import TunedSettings


class SearchSettings(TunedSettings):
    """Length of the search for base routes, in iterations, so that a result can be repeated."""

    rounds: int = 15
    """Number of rounds after the first search."""
    iterations_per_stop: int = 16
    """Iterations of iterated local search for each stop, in each round; 1.6 times as many
    where all stops are searched as one part."""
    iterations_to_feasible: int = 20_000
    """Maximum number of iterations of the first search, which ends with the first feasible
    routes."""
    max_penalty_kwh: float = 0.1
    """Maximum penalty of one unit of excess load, or of 0.1 s of lateness, before the routes
    are feasible, kWh, where stops have five units each or more; as much for a stop where they
    have fewer. Ten times as much where the stops fill all vehicles, or are more than a part has,
    but no more than 1,000."""
    part_stops: int = 250
    """Maximum mean number of stops of a round's parts."""
    workers: int = Field(
        default=2, ge=1, le=256, description="Number of parts searched in parallel."
    )
    time_limit_s: float = Field(
        default=20.0,
        gt=0,
        allow_inf_nan=False,
        description="Time after which the search ends early, s.",
    )


class CitySettings(TunedSettings):
    """The route form: base routes, blocks and sweeps."""

    search: SearchSettings = Field(
        default=SearchSettings(), description="The search of base routes."
    )
    base_share: float = 0.6
    """Share of a deadline that base routes may take."""
    second_rounds: int = 2
    """Rounds of a second search, in which open roads that others use cost less."""
    block_variables: int = 25
    """Maximum number of variables of one block."""
    options: int = Field(default=5, ge=2, le=50)
    """Options of each vehicle of a full block."""
    ways: int = 3
    """Number of cheapest paths of each leg that the options contain."""
    ways_legs: int = 100
    """Maximum number of legs of a fleet whose options contain several paths of a leg; finding
    them takes time."""
    wave: int = 8
    """Number of blocks that are solved in parallel."""
    max_sweeps: int = 20
    """Maximum number of sweeps."""
    patience: int = 3
    """Number of sweeps in a row without improvement after which the search ends; each has
    other blocks."""
    block_deadline_s: float = 5.0
    """Deadline of the solvers of one batch of parallel blocks, s."""
    solvers: tuple[SolverName, ...] = Field(
        default=("exact",),
        min_length=1,
        description="Solvers of each block; the best answer is taken.",
    )
