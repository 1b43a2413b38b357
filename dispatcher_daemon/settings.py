"""Settings of the dispatcher."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from slipstream.config import BusSettings, ServiceSettings, Settings
from slipstream.freshness import FUTURE_TOLERANCE_S, STALE_AFTER_S
from slipstream.messages import DrivingAdvice

BUILT_IN_SOLVERS: Final = (
    "exact",
    "cplex",
    "tabu",
    "annealing",
    "insertion",
    "lc-qaoa",
    "qaoa",
)
SOLVER_ENTRY_POINTS: Final = "slipstream.solvers"
"""Group of entry points by which installed packages add solvers; see `solvers.registry`."""


def solver_names() -> tuple[str, ...]:
    """Names of all solvers that a cycle can ask: the built-in ones, then those of packages."""
    added = {point.name for point in entry_points(group=SOLVER_ENTRY_POINTS)}
    return (*BUILT_IN_SOLVERS, *sorted(added.difference(BUILT_IN_SOLVERS)))


def _known_solver(name: str) -> str:
    names = solver_names()
    if name not in names:
        raise ValueError(f"there is no such solver, there are {', '.join(names)}")
    return name


SolverName = Annotated[str, AfterValidator(_known_solver)]

GUEST_SOLVER: Final[SolverName] = "lc-qaoa"
"""The solver whose circuits go to the device that `HardwareSettings` names."""


LcQaoaVariant = Literal[
    "ramp",
    "trained",
    "multi-angle",
    "product",
    "one-hot",
    "one-hot-multi-angle",
    "one-hot-product",
]


class LcQaoaSettings(Settings):
    """Linear-chain QAOA: which circuit, how it is trained, how often it is sampled."""

    variant: LcQaoaVariant = Field(
        default="trained",
        description="ramp: untrained; trained: the paper's, 2p angles by COBYLA; multi-angle: each "
        "gate its own angle; product: the same without entangling gates, its control; one-hot, "
        "one-hot-multi-angle, one-hot-product: the last three with one option of each vehicle by "
        "construction (route form only).",
    )
    layers: int = Field(default=2, ge=1, le=10, description="Depth p; the cost grows with 4^p.")
    shots: int = Field(default=4096, ge=1, le=1_000_000)
    delta_beta: float = Field(
        default=0.3, gt=0, allow_inf_nan=False, description="Height of the mixer's ramp, rad."
    )
    delta_gamma: float = Field(
        default=0.6, gt=0, allow_inf_nan=False, description="Height of the phase's ramp, rad."
    )
    iterations: int = Field(
        default=100, ge=1, le=100_000, description="Evaluations of training, for each restart."
    )
    restarts: int = Field(default=16, ge=1, le=10_000, description="Of every gate its own angle.")
    spread: float = Field(
        default=0.5,
        ge=0,
        allow_inf_nan=False,
        description="Standard deviation of the restarts' angles around the ramp, rad.",
    )
    cvar_share: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="Trained: below 1, the mean of so much of the samples instead of all energies.",
    )
    order: Literal["heavy", "random"] = Field(
        default="heavy", description="Of the chain: along heavy couplings, or drawn."
    )
    backend: str = Field(
        default="aer",
        pattern=r"^aer(|:Fake[A-Za-z0-9]+(|\+fractional))$",
        description="Simulator: aer, or aer:FakeBoston with that device's noise. A device is a "
        "guest, see hardware: there a budget holds.",
    )


class QaoaSettings(Settings):
    """QAOA with all couplings, on an exactly simulated state."""

    variant: Literal["x", "xy"] = Field(
        default="x",
        description="Mixer: x on all 2^n states; xy keeps one option of each vehicle (route form "
        "only).",
    )
    layers: int = Field(default=2, ge=1, le=20, description="Depth p.")
    shots: int = Field(default=4096, ge=1, le=1_000_000)
    angles: Literal["transferred", "trained", "ramp"] = Field(
        default="transferred",
        description="transferred: the linear ramp below as it is; trained: all 2p angles from "
        "there, by COBYLA; ramp: only the ramp's two heights.",
    )
    delta_beta: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Height of the mixer's ramp, rad; None: as measured for p and mixer.",
    )
    delta_gamma: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Height of the phase's ramp, rad; None: as measured for p and mixer.",
    )
    iterations: int = Field(
        default=100, ge=1, le=100_000, description="Of training, each one state, at most."
    )
    alpha: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="Training lowers the mean energy of so much of the probability (CVaR).",
    )
    pairs: Literal["ring", "chain"] = Field(
        default="ring", description="Pairs of options that the xy mixer acts on."
    )


class HardwareSettings(Settings):
    """A quantum device as a guest of the cycle; without a backend there is none."""

    backend: str = Field(
        default="",
        pattern=r"^(|ibm:[A-Za-z0-9_-]+|fake:Fake[A-Za-z0-9]+)$",
        description="ibm:NAME, ibm:least-busy, or for a trial without an account fake:FakeBoston; "
        "empty: no device.",
    )
    shots: int = Field(default=4096, ge=1, le=100_000)
    budget_s_per_day: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="Device time in any 24 hours; what a job may take is reserved beforehand.",
    )
    most_pending: int = Field(default=2, ge=1, le=100, description="Jobs at the service at once.")
    jobs_per_cycle: int = Field(default=1, ge=1, le=100, description="Most that one cycle submits.")
    wait_s: float = Field(
        default=3.0,
        ge=0,
        allow_inf_nan=False,
        description="How long a cycle waits for the device when all other solvers are done, over "
        "all its blocks and never into the last fifth of its deadline.",
    )
    poll_s: float = Field(
        default=1.0, gt=0, allow_inf_nan=False, description="First look at a job; then ever rarer."
    )
    most_poll_s: float = Field(default=60.0, gt=0, allow_inf_nan=False)
    call_limit_s: float = Field(
        default=20.0,
        gt=0,
        allow_inf_nan=False,
        description="A call of the service that takes longer is ended with its process.",
    )
    give_up_after_s: float = Field(
        default=1800.0,
        gt=0,
        allow_inf_nan=False,
        description="Older jobs are cancelled; older answers are recorded as late.",
    )
    lost_after_s: float = Field(
        default=300.0,
        gt=0,
        allow_inf_nan=False,
        description="A job that the service does not know for so long is given up.",
    )
    faults: int = Field(
        default=3, ge=1, le=1000, description="So many in a row, and nothing is submitted for ..."
    )
    rest_s: float = Field(
        default=60.0, gt=0, allow_inf_nan=False, description="... so long, twice as long each time,"
    )
    most_rest_s: float = Field(
        default=3600.0,
        gt=0,
        allow_inf_nan=False,
        description="up to this; refused credentials rest so long at once.",
    )

    @model_validator(mode="after")
    def _limits_are_above(self) -> Self:
        for low, high in (("poll_s", "most_poll_s"), ("rest_s", "most_rest_s")):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low} must not be above {high}")
        return self


class SearchSettings(Settings):
    """How long base routes are searched: by iterations, so that a result can be repeated."""

    rounds: int = Field(default=15, ge=0, le=10_000)
    iterations_per_stop: int = Field(
        default=16, ge=1, le=100_000, description="Of iterated local search, in each round."
    )
    iterations_to_feasible: int = Field(
        default=20_000,
        ge=1,
        description="Most of the first search, which ends with the first routes that are feasible.",
    )
    most_penalty_kwh: float = Field(
        default=0.1,
        gt=0,
        le=1000,
        allow_inf_nan=False,
        description="Most that a unit of load too many, or 0.1 s of lateness, counts for on the "
        "way to feasible routes; where vehicles carry few units, some detours' energy is needed.",
    )
    part_stops: int = Field(
        default=250, ge=10, description="A round searches parts of so many stops side by side."
    )
    workers: int = Field(default=2, ge=1, le=256, description="Parts searched side by side.")
    time_limit_s: float = Field(
        default=20.0, gt=0, allow_inf_nan=False, description="Guard: ends the search early."
    )


class CitySettings(Settings):
    """The route form: base routes, blocks and sweeps."""

    search: SearchSettings = SearchSettings()
    base_share: float = Field(
        default=0.6, gt=0, lt=1, description="Share of a deadline that base routes may take."
    )
    second_rounds: int = Field(
        default=2,
        ge=0,
        le=1000,
        description="Rounds of a second search, in which open roads that others use cost less.",
    )
    block_variables: int = Field(
        default=25, ge=4, le=200, description="Most variables of one block."
    )
    options: int = Field(
        default=5, ge=2, le=50, description="Options of each vehicle of a full block."
    )
    ways: int = Field(
        default=3, ge=1, le=20, description="Cheapest ways of each leg among the options ..."
    )
    ways_legs: int = Field(
        default=100, ge=0, description="... of fleets with at most so many legs: each takes time."
    )
    wave: int = Field(default=8, ge=1, description="Blocks that are solved side by side.")
    most_sweeps: int = Field(default=20, ge=0)
    patience: int = Field(
        default=3, ge=1, description="Sweeps without improvement, each cut anew, that end it."
    )
    block_deadline_s: float = Field(
        default=5.0, gt=0, allow_inf_nan=False, description="For the solvers of one wave."
    )
    solvers: tuple[SolverName, ...] = Field(
        default=("exact",), min_length=1, description="Asked for each block, the best answer wins."
    )


class DispatcherSettings(Settings):
    """Everything that the dispatcher can be told; the defaults run the built-in demo."""

    bus: BusSettings = BusSettings()
    service: ServiceSettings = ServiceSettings()
    network: str = Field(default="demo", min_length=1, description="A SUMO net, or 'demo'.")
    fleet: str = Field(default="demo", min_length=1, description="A fleet file, or 'demo'.")
    database_url: str = Field(default="sqlite:///slipstream.db", min_length=1)
    keep_days: float = Field(
        default=90.0, gt=0, allow_inf_nan=False, description="Older cycles are deleted."
    )
    interval_s: float = Field(
        default=30.0, gt=0, allow_inf_nan=False, description="From one cycle's start to the next's."
    )
    deadline_s: float = Field(
        default=10.0,
        gt=0,
        allow_inf_nan=False,
        description="What the solvers get of a cycle. Vehicles leave no sooner than this after it "
        "starts, so that plans are out before.",
    )
    sync_window_s: float = Field(
        default=3.0,
        ge=0,
        allow_inf_nan=False,
        description="Vehicles that enter a segment no further apart than this can platoon there.",
    )
    stale_after_s: float = Field(
        default=STALE_AFTER_S,
        gt=0,
        allow_inf_nan=False,
        description="An older SegmentState counts for nothing.",
    )
    future_tolerance_s: float = Field(
        default=FUTURE_TOLERANCE_S,
        ge=0,
        allow_inf_nan=False,
        description="A SegmentState dated further ahead of this clock is refused.",
    )
    stops_at_signals: float = Field(
        default=0.0,
        ge=0,
        le=100,
        allow_inf_nan=False,
        description="Full stops that a passage of a segment ending at traffic lights is expected "
        "to cost; no camera tells of it.",
    )
    gap_m: float = Field(
        default=1.5, gt=0, allow_inf_nan=False, description="Gap advised to followers."
    )
    advice: DrivingAdvice = Field(
        default=DrivingAdvice(),
        description="What plans tell vehicles to do at signals, turns and stops.",
    )
    form: Literal["auto", "arc", "route"] = Field(
        default="auto",
        description="The paper's arcs, or routes; auto: arcs for two vehicles and eight stops.",
    )
    solvers: tuple[SolverName, ...] = Field(
        default=("exact", "lc-qaoa"),
        min_length=1,
        description="Asked side by side, best one wins; fleets of many blocks ask city.solvers.",
    )
    city: CitySettings = CitySettings()
    gamma: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Penalty weight of the QUBO, kWh; None: computed per instance.",
    )
    lc_qaoa: LcQaoaSettings = LcQaoaSettings()
    qaoa: QaoaSettings = QaoaSettings()
    hardware: HardwareSettings = HardwareSettings()
    seed: int = Field(default=1, ge=0, lt=2**32)

    @field_validator("solvers")
    @classmethod
    def _each_solver_once(cls, solvers: tuple[SolverName, ...]) -> tuple[SolverName, ...]:
        if len(set(solvers)) < len(solvers):
            raise ValueError("a solver is named twice")
        return solvers

    @model_validator(mode="after")
    def _deadline_fits(self) -> Self:
        if self.deadline_s >= self.interval_s:
            raise ValueError(
                f"deadline_s ({self.deadline_s:g}) must be below interval_s ({self.interval_s:g})"
            )
        return self

    @model_validator(mode="after")
    def _device_has_its_solver(self) -> Self:
        asked = {*self.solvers, *self.city.solvers}
        if self.hardware.backend and GUEST_SOLVER not in asked:
            raise ValueError(f"hardware.backend runs circuits of {GUEST_SOLVER}: add it to solvers")
        return self
