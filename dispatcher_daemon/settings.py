"""Settings of the dispatcher."""

from __future__ import annotations

from typing import Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from slipstream.config import BusSettings, ServiceSettings, Settings
from slipstream.freshness import FUTURE_TOLERANCE_S, STALE_AFTER_S
from slipstream.messages import DrivingAdvice

SolverName = Literal["exact", "cplex", "tabu", "annealing", "insertion", "lc-qaoa", "qaoa"]


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
    shots: int = Field(default=4096, ge=1, le=1_000_000, description="Samples of each circuit.")
    delta_beta: float = Field(
        default=0.3, gt=0, allow_inf_nan=False, description="Height of the mixer's ramp, rad."
    )
    delta_gamma: float = Field(
        default=0.6, gt=0, allow_inf_nan=False, description="Height of the phase's ramp, rad."
    )
    iterations: int = Field(
        default=100,
        ge=1,
        le=100_000,
        description="Evaluations of the energy by training, for each restart.",
    )
    restarts: int = Field(
        default=16,
        ge=1,
        le=10_000,
        description="Starts of the training of variants with an angle for each gate.",
    )
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
        description="Share of the samples, the best ones, whose mean energy the variant trained "
        "minimises (CVaR); 1: all energies.",
    )
    order: Literal["heavy", "random"] = Field(
        default="heavy",
        description="Order of the variables in the chain. heavy: along heavy couplings; random: "
        "drawn.",
    )
    backend: str = Field(
        default="aer",
        pattern=r"^aer(|:Fake[A-Za-z0-9]+(|\+fractional))$",
        description="Simulator: aer, or aer:FakeBoston with that device's noise. A device is set "
        "in the section hardware, where a budget holds.",
    )


class QaoaSettings(Settings):
    """QAOA with all couplings, on an exactly simulated state."""

    variant: Literal["x", "xy"] = Field(
        default="x",
        description="Mixer: x on all 2^n states; xy keeps one option of each vehicle (route form "
        "only).",
    )
    layers: int = Field(default=2, ge=1, le=20, description="Depth p.")
    shots: int = Field(default=4096, ge=1, le=1_000_000, description="Samples of each circuit.")
    angles: Literal["transferred", "trained", "ramp"] = Field(
        default="transferred",
        description="transferred: the linear ramp below as it is; trained: all 2p angles from "
        "there, by COBYLA; ramp: only the ramp's two heights.",
    )
    delta_beta: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Height of the mixer's ramp, rad; not given: as measured for p and mixer.",
    )
    delta_gamma: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Height of the phase's ramp, rad; not given: as measured for p and mixer.",
    )
    iterations: int = Field(
        default=100, ge=1, le=100_000, description="Evaluations of the state by training, at most."
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
    """A quantum device that is asked beside the cycle; without a backend there is none."""

    backend: str = Field(
        default="",
        pattern=r"^(|ibm:[A-Za-z0-9_-]+|fake:Fake[A-Za-z0-9]+)$",
        description="ibm:NAME, ibm:least-busy, or for a trial without an account fake:FakeBoston; "
        "empty: no device.",
    )
    shots: int = Field(default=4096, ge=1, le=100_000, description="Samples of each job.")
    budget_s_per_day: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="Device time that may be used in any 24 hours, s. What a job may take is "
        "reserved beforehand.",
    )
    most_pending: int = Field(
        default=2, ge=1, le=100, description="Jobs that may be pending at the service at once."
    )
    jobs_per_cycle: int = Field(
        default=1, ge=1, le=100, description="Jobs that one cycle may submit."
    )
    wait_s: float = Field(
        default=3.0,
        ge=0,
        allow_inf_nan=False,
        description="How long a cycle waits for the device when all other solvers are done, s. It "
        "counts over all blocks and ends before the last fifth of the deadline.",
    )
    poll_s: float = Field(
        default=1.0,
        gt=0,
        allow_inf_nan=False,
        description="Time until a job is first polled, s. The interval then grows up to the "
        "maximum.",
    )
    most_poll_s: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="Longest interval between two polls of a job, s.",
    )
    call_limit_s: float = Field(
        default=20.0,
        gt=0,
        allow_inf_nan=False,
        description="A call to the service that takes longer is ended with its process, s.",
    )
    give_up_after_s: float = Field(
        default=1800.0,
        gt=0,
        allow_inf_nan=False,
        description="Age at which a job is cancelled, s. An older answer is recorded as late.",
    )
    lost_after_s: float = Field(
        default=300.0,
        gt=0,
        allow_inf_nan=False,
        description="A job that the service does not know for this long is given up, s.",
    )
    faults: int = Field(
        default=3,
        ge=1,
        le=1000,
        description="Faults in a row that open the circuit breaker: no job is then submitted.",
    )
    rest_s: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="First rest of an open circuit breaker, s. Each further rest is twice as long.",
    )
    most_rest_s: float = Field(
        default=3600.0,
        gt=0,
        allow_inf_nan=False,
        description="Longest rest of an open circuit breaker, s. After refused credentials it "
        "applies at once.",
    )

    @model_validator(mode="after")
    def _limits_are_above(self) -> Self:
        for low, high in (("poll_s", "most_poll_s"), ("rest_s", "most_rest_s")):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low} must not be above {high}")
        return self


class SearchSettings(Settings):
    """How long base routes are searched: by iterations, so that a result can be repeated."""

    rounds: int = Field(
        default=15, ge=0, le=10_000, description="Rounds of the search, each over all parts."
    )
    iterations_per_stop: int = Field(
        default=16,
        ge=1,
        le=100_000,
        description="Iterations of local search for each stop in each round.",
    )
    iterations_to_feasible: int = Field(
        default=20_000,
        ge=1,
        description="Iterations of the first search, at most. It ends with the first feasible "
        "routes.",
    )
    most_penalty_kwh: float = Field(
        default=0.1,
        gt=0,
        le=1000,
        allow_inf_nan=False,
        description="Largest penalty for one unit of load too many, or 0.1 s of lateness, while "
        "feasible routes are sought, kWh. Where vehicles carry few units it must exceed the "
        "energy of a detour.",
    )
    part_stops: int = Field(
        default=250,
        ge=10,
        description="Stops of one part of the city. A round searches its parts side by side.",
    )
    workers: int = Field(
        default=2, ge=1, le=256, description="Parts of the city searched side by side."
    )
    time_limit_s: float = Field(
        default=20.0,
        gt=0,
        allow_inf_nan=False,
        description="Time after which the search is ended early, s.",
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
        description="Rounds of a second search, in which open roads that other vehicles use cost "
        "less.",
    )
    block_variables: int = Field(
        default=25, ge=4, le=200, description="Variables of one block, at most."
    )
    options: int = Field(
        default=5, ge=2, le=50, description="Options of each vehicle in a full block."
    )
    ways: int = Field(
        default=3, ge=1, le=20, description="Cheapest ways of each leg that become options."
    )
    ways_legs: int = Field(
        default=100,
        ge=0,
        description="Legs up to which a fleet gets further ways as options. A fleet with more "
        "legs gets only the cheapest way of each.",
    )
    wave: int = Field(default=8, ge=1, description="Blocks that are solved side by side.")
    most_sweeps: int = Field(default=20, ge=0, description="Sweeps over all blocks, at most.")
    patience: int = Field(
        default=3,
        ge=1,
        description="Sweeps in a row without improvement after which the sweeping ends. Each cuts "
        "the fleet into blocks anew.",
    )
    block_deadline_s: float = Field(
        default=5.0,
        gt=0,
        allow_inf_nan=False,
        description="Deadline of the solvers of one wave of blocks, s.",
    )
    solvers: tuple[SolverName, ...] = Field(
        default=("exact",),
        min_length=1,
        description="Solvers asked for each block. The best answer is taken.",
    )


class DispatcherSettings(Settings):
    """Everything that the dispatcher can be told; the defaults run the built-in demo."""

    bus: BusSettings = BusSettings()
    service: ServiceSettings = ServiceSettings()
    network: str = Field(
        default="demo", min_length=1, description="Road network: path of a SUMO net, or 'demo'."
    )
    fleet: str = Field(
        default="demo", min_length=1, description="Path of the fleet file, or 'demo'."
    )
    database_url: str = Field(
        default="sqlite:///slipstream.db",
        min_length=1,
        description="SQLAlchemy URL of the database that cycles are stored in.",
    )
    keep_days: float = Field(
        default=90.0,
        gt=0,
        allow_inf_nan=False,
        description="Age in days at which stored cycles are deleted.",
    )
    interval_s: float = Field(
        default=30.0,
        gt=0,
        allow_inf_nan=False,
        description="Time from one cycle's start to the next's, s.",
    )
    deadline_s: float = Field(
        default=10.0,
        gt=0,
        allow_inf_nan=False,
        description="Time within which a cycle has solved, stored and sent its plans, s. Vehicles "
        "leave no sooner than this after it starts.",
    )
    sync_window_s: float = Field(
        default=3.0,
        ge=0,
        allow_inf_nan=False,
        description="Vehicles whose entries into a segment lie no further apart can platoon "
        "there, s.",
    )
    stale_after_s: float = Field(
        default=STALE_AFTER_S,
        gt=0,
        allow_inf_nan=False,
        description="Age at which a SegmentState no longer counts, s.",
    )
    future_tolerance_s: float = Field(
        default=FUTURE_TOLERANCE_S,
        ge=0,
        allow_inf_nan=False,
        description="A SegmentState dated further ahead of the dispatcher's clock is refused, s.",
    )
    stops_at_signals: float = Field(
        default=0.0,
        ge=0,
        le=100,
        allow_inf_nan=False,
        description="Full stops expected at each passage of a segment that ends at traffic lights. "
        "Cameras do not measure it.",
    )
    gap_m: float = Field(
        default=1.5, gt=0, allow_inf_nan=False, description="Gap advised to followers, m."
    )
    advice: DrivingAdvice = Field(
        default=DrivingAdvice(),
        description="What plans tell vehicles to do at signals, turns and stops.",
    )
    form: Literal["auto", "arc", "route"] = Field(
        default="auto",
        description="arc: the paper's form; route: options of routes; auto: arc for up to two "
        "vehicles and eight stops, else route.",
    )
    solvers: tuple[SolverName, ...] = Field(
        default=("exact", "lc-qaoa"),
        min_length=1,
        description="Solvers asked side by side. The best answer is taken. Fleets of several "
        "blocks ask city.solvers.",
    )
    city: CitySettings = CitySettings()
    gamma: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Penalty weight of the QUBO, kWh; not given: computed per instance.",
    )
    lc_qaoa: LcQaoaSettings = LcQaoaSettings()
    qaoa: QaoaSettings = QaoaSettings()
    hardware: HardwareSettings = HardwareSettings()
    seed: int = Field(default=1, ge=0, lt=2**32, description="Seed of all random draws.")

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
