"""Settings of the dispatcher."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from dispatcher_daemon.cluster_settings import ClusterSettings
from slipstream.admission import Rsus
from slipstream.config import BusSettings, ServiceSettings, Settings
from slipstream.freshness import FUTURE_TOLERANCE_S, STALE_AFTER_S
from slipstream.messages import DrivingAdvice
from slipstream.plugins import plugin_names
from slipstream.spacing import ADVISED_GAP_M

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
    return plugin_names(SOLVER_ENTRY_POINTS, BUILT_IN_SOLVERS)


def _known_solver(name: str) -> str:
    # Built-in names first: to know the others, all installed packages are looked through.
    if name not in BUILT_IN_SOLVERS and name not in (names := solver_names()):
        raise ValueError(f"there is no such solver, there are {', '.join(names)}")
    return name


SolverName = Annotated[str, AfterValidator(_known_solver)]

HARDWARE_SOLVER: Final[SolverName] = "lc-qaoa"
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
    shots: int = Field(
        default=4096, ge=1, le=1_000_000, description="Number of samples of the circuit."
    )
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
        description="Maximum number of energy evaluations in training, for each restart.",
    )
    restarts: int = Field(
        default=16,
        ge=1,
        le=10_000,
        description="Number of starting points of training with an angle for each gate.",
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
        description="Share of the samples, lowest energies first, whose mean energy the variant "
        "trained minimises (CVaR); 1: all energies.",
    )
    order: Literal["heavy", "random"] = Field(
        default="heavy",
        description="Order of the chain: along heavy couplings, or drawn at random.",
    )
    backend: str = Field(
        default="aer",
        pattern=r"^aer(|:Fake[A-Za-z0-9]+(|\+fractional))$",
        description="Simulator: aer, or aer:FakeBoston with that device's noise. A device is set "
        "in hardware.backend, where a budget holds.",
    )


class QaoaSettings(Settings):
    """QAOA with all couplings, on an exactly simulated state."""

    variant: Literal["x", "xy"] = Field(
        default="x",
        description="Mixer: x on all 2^n states; xy keeps one option of each vehicle (route form "
        "only).",
    )
    layers: int = Field(default=2, ge=1, le=20, description="Depth p.")
    shots: int = Field(
        default=4096, ge=1, le=1_000_000, description="Number of samples of the circuit."
    )
    angles: Literal["transferred", "trained", "ramp"] = Field(
        default="transferred",
        description="transferred: the linear ramp of delta_beta and delta_gamma without training; "
        "trained: all 2p angles from that ramp on, by COBYLA; ramp: only the ramp's two heights.",
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
        default=100,
        ge=1,
        le=100_000,
        description="Maximum number of state evaluations in training.",
    )
    alpha: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="Share of the probability, lowest energies first, whose mean energy training "
        "minimises (CVaR); 1: all of it.",
    )
    pairs: Literal["ring", "chain"] = Field(
        default="ring", description="Pairs of options that the xy mixer acts on."
    )


class HardwareSettings(Settings):
    """A quantum device beside the solvers: its jobs, budget and circuit breaker."""

    renamed: ClassVar[Mapping[str, str]] = {
        "most_pending": "max_pending_jobs",
        "most_poll_s": "max_poll_s",
        "call_limit_s": "call_timeout_s",
        "give_up_after_s": "job_timeout_s",
        "faults": "fault_threshold",
        "rest_s": "open_s",
        "most_rest_s": "max_open_s",
    }

    backend: str = Field(
        default="",
        pattern=r"^(|ibm:[A-Za-z0-9_-]+|fake:Fake[A-Za-z0-9]+)$",
        description="ibm:NAME, ibm:least-busy, or for a trial without an account fake:FakeBoston; "
        "empty: no device.",
    )
    shots: int = Field(default=4096, ge=1, le=100_000, description="Number of samples of a job.")
    budget_s_per_day: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="Maximum device time in any 24 hours, s. A job's estimate is reserved before "
        "it is submitted.",
    )
    max_pending_jobs: int = Field(
        default=2, ge=1, le=100, description="Maximum number of jobs at the service at once."
    )
    jobs_per_cycle: int = Field(
        default=1, ge=1, le=100, description="Maximum number of jobs that one cycle submits."
    )
    wait_s: float = Field(
        default=3.0,
        ge=0,
        allow_inf_nan=False,
        description="How long a cycle waits for the device once all other solvers are done, s: in "
        "all its blocks together, and never into the last fifth of its deadline.",
    )
    poll_s: float = Field(
        default=1.0,
        gt=0,
        allow_inf_nan=False,
        description="Time from submitting a job to its first poll, s; it grows by half with each "
        "poll.",
    )
    max_poll_s: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="Maximum time between two polls of a job, s; at least 3600 s where only its "
        "charge is not known yet.",
    )
    call_timeout_s: float = Field(
        default=20.0,
        gt=0,
        allow_inf_nan=False,
        description="Maximum time of one call of the service, s; a longer one is ended with its "
        "process.",
    )
    job_timeout_s: float = Field(
        default=1800.0,
        gt=0,
        allow_inf_nan=False,
        description="Maximum age of a pending job, s; an older one is cancelled. An answer that is "
        "unused for so long is recorded as late.",
    )
    lost_after_s: float = Field(
        default=300.0,
        gt=0,
        allow_inf_nan=False,
        description="Time after which a job that the service does not know is given up, s.",
    )
    fault_threshold: int = Field(
        default=3,
        ge=1,
        le=1000,
        description="Number of faults, without a good answer in between, that opens the circuit "
        "breaker. While it is open no job is submitted.",
    )
    open_s: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="First open time of the circuit breaker, s; it doubles each time the breaker "
        "opens again.",
    )
    max_open_s: float = Field(
        default=3600.0,
        gt=0,
        allow_inf_nan=False,
        description="Maximum open time of the circuit breaker, s, and its open time after refused "
        "credentials.",
    )

    @model_validator(mode="after")
    def _limits_are_above(self) -> Self:
        for low, high in (("poll_s", "max_poll_s"), ("open_s", "max_open_s")):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low} must not be above {high}")
        return self


class SearchSettings(Settings):
    """Length of the search for base routes, in iterations, so that a result can be repeated."""

    renamed: ClassVar[Mapping[str, str]] = {"most_penalty_kwh": "max_penalty_kwh"}

    rounds: int = Field(
        default=15, ge=0, le=10_000, description="Number of rounds after the first search."
    )
    iterations_per_stop: int = Field(
        default=16,
        ge=1,
        le=100_000,
        description="Iterations of iterated local search for each stop, in each round.",
    )
    iterations_to_feasible: int = Field(
        default=20_000,
        ge=1,
        description="Maximum number of iterations of the first search, which ends with the first "
        "feasible routes.",
    )
    max_penalty_kwh: float = Field(
        default=0.1,
        gt=0,
        le=1000,
        allow_inf_nan=False,
        description="Maximum penalty of one unit of excess load, or of 0.1 s of lateness, "
        "before the routes are feasible, kWh. Where vehicles carry few units, it has to reach the "
        "energy of some detours.",
    )
    part_stops: int = Field(
        default=250, ge=10, description="Maximum mean number of stops of a round's parts."
    )
    workers: int = Field(
        default=2, ge=1, le=256, description="Number of parts searched in parallel."
    )
    time_limit_s: float = Field(
        default=20.0,
        gt=0,
        allow_inf_nan=False,
        description="Time after which the search ends early, s.",
    )


class CitySettings(Settings):
    """The route form: base routes, blocks and sweeps."""

    renamed: ClassVar[Mapping[str, str]] = {"most_sweeps": "max_sweeps"}

    search: SearchSettings = Field(
        default=SearchSettings(), description="The search of base routes."
    )
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
        default=25, ge=4, le=200, description="Maximum number of variables of one block."
    )
    options: int = Field(
        default=5, ge=2, le=50, description="Options of each vehicle of a full block."
    )
    ways: int = Field(
        default=3,
        ge=1,
        le=20,
        description="Number of cheapest paths of each leg that the options contain.",
    )
    ways_legs: int = Field(
        default=100,
        ge=0,
        description="Maximum number of legs of a fleet whose options contain several paths of a "
        "leg; finding them takes time.",
    )
    wave: int = Field(default=8, ge=1, description="Number of blocks that are solved in parallel.")
    max_sweeps: int = Field(default=20, ge=0, description="Maximum number of sweeps.")
    patience: int = Field(
        default=3,
        ge=1,
        description="Number of sweeps in a row without improvement after which the search ends; "
        "each has other blocks.",
    )
    block_deadline_s: float = Field(
        default=5.0,
        gt=0,
        allow_inf_nan=False,
        description="Deadline of the solvers of one batch of parallel blocks, s.",
    )
    solvers: tuple[SolverName, ...] = Field(
        default=("exact",),
        min_length=1,
        description="Solvers of each block; the best answer is taken.",
    )


class PriceSettings(Settings):
    """What the objective weighs against energy (``[prices]``), in one currency."""

    energy_kwh: float = Field(
        default=0.30, gt=0, le=1e6, allow_inf_nan=False, description="A kWh of energy."
    )
    driving_hour: float = Field(
        default=0.60,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="An hour of driving, such as a wage. 0: only energy counts.",
    )
    waiting_hour: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="An hour of waiting for other vehicles at the depot, within the departure "
        "window, or at a hub. 0: a wait is free. At a stop it costs as much as driving.",
    )

    @property
    def price_of_time_kw(self) -> float:
        """Of driving: kWh an hour."""
        return self.driving_hour / self.energy_kwh

    @property
    def price_of_waiting_kw(self) -> float:
        """Of waiting: kWh an hour."""
        return self.waiting_hour / self.energy_kwh


class OrderSettings(Settings):
    """Orders that callers submit."""

    plan_ahead_s: float = Field(
        default=7200.0,
        ge=0,
        le=86_400,
        allow_inf_nan=False,
        description="An order is planned from so long before its window opens, s: longer than the "
        "way there, and not so long that vehicles wait at its door.",
    )


class FeedSettings(Settings):
    """Who publishes the feeds for road authorities (``[feeds]``)."""

    publisher: str = Field(
        default="slipstream",
        min_length=1,
        max_length=200,
        description="Name of the organisation that publishes: DATEX II's national identifier, "
        "WZDx's publisher.",
    )
    country: str = Field(
        default="ZZ",
        pattern="^[A-Za-z]{2}$",
        description="Its country, two letters of ISO 3166; ZZ: none.",
    )
    information_status: Literal["real", "test", "technicalExercise", "securityExercise"] = Field(
        default="test",
        description="What DATEX II publications say of themselves. Set real once what cameras see "
        "may be acted on.",
    )


class ApiSettings(Settings):
    """The HTTP API on 127.0.0.1 (`[api]`), see docs/api.md."""

    port: int = Field(
        default=0, ge=0, le=65535, description="Port on 127.0.0.1; 0: the API is not served."
    )
    tokens: Path | None = Field(
        default=None,
        description="File of bearer tokens, see `slipstream token new`; a plain name is first "
        "looked for among systemd's credentials. Without it only callers of this machine are "
        "served, and they may only read.",
    )


class DispatcherSettings(Settings):
    """All settings of the dispatcher; the defaults run the built-in demo."""

    bus: BusSettings = Field(default=BusSettings(), description="The zenoh bus.")
    service: ServiceSettings = Field(
        default=ServiceSettings(), description="Metrics and log of the service."
    )
    api: ApiSettings = Field(default=ApiSettings(), description="The HTTP API.")
    orders: OrderSettings = Field(
        default=OrderSettings(), description="Orders that callers submit."
    )
    network: str = Field(default="demo", min_length=1, description="A SUMO net, or 'demo'.")
    fleet: str = Field(default="demo", min_length=1, description="A fleet file, or 'demo'.")
    database_url: str = Field(
        default="sqlite:///slipstream.db",
        min_length=1,
        description="SQLAlchemy URL of the database: SQLite or PostgreSQL.",
    )
    keep_days: float = Field(
        default=90.0,
        gt=0,
        allow_inf_nan=False,
        description="Age from which cycles are deleted, days.",
    )
    keep_mb: float = Field(
        default=10_000.0,
        ge=100,
        allow_inf_nan=False,
        description="Size of an SQLite database with its log and reserve, MB (10^6 bytes), above "
        "which the oldest cycles are deleted.",
    )
    interval_s: float = Field(
        default=30.0,
        gt=0,
        allow_inf_nan=False,
        description="Time from one cycle's start to the next one's, s.",
    )
    deadline_s: float = Field(
        default=10.0,
        gt=0,
        allow_inf_nan=False,
        description="Time that the solvers have in a cycle, s. Vehicles leave no sooner than this "
        "after the cycle starts, so that plans are out before.",
    )
    sync_window_s: float = Field(
        default=3.0,
        ge=0,
        allow_inf_nan=False,
        description="Maximum time between two vehicles' entries to a segment at which they can "
        "platoon there, s.",
    )
    rsus: Rsus | None = Field(
        default=None,
        description='The segments that each RSU watches, as `rsu-1 = ["avenue_east"]`; states of '
        "others are refused. Without it any RSU may open any gate.",
    )
    stale_after_s: float = Field(
        default=STALE_AFTER_S,
        gt=0,
        allow_inf_nan=False,
        description="Age from which a SegmentState is ignored, s.",
    )
    future_tolerance_s: float = Field(
        default=FUTURE_TOLERANCE_S,
        ge=0,
        allow_inf_nan=False,
        description="A SegmentState dated further ahead of this clock is refused, s.",
    )
    stops_at_signals: float = Field(
        default=0.0,
        ge=0,
        le=100,
        allow_inf_nan=False,
        description="Expected number of full stops in a passage of a segment that ends at traffic "
        "lights, which no camera measures.",
    )
    gap_m: float = Field(
        default=ADVISED_GAP_M,
        gt=0,
        allow_inf_nan=False,
        description="Gap advised to followers, m; while they drive they keep 0.1 s more.",
    )
    advice: DrivingAdvice = Field(
        default=DrivingAdvice(),
        description="Advice in plans for signals, turns and stops. Without a value_of_time_kw of "
        "its own it takes the price of driving.",
    )
    objective: Literal["energy", "paper"] = Field(
        default="energy",
        description="What a route costs. energy: its drive with all changes of speed, expected "
        "stops and turbulence, and the price of its time; paper: its segments at planning speed, "
        "as in the paper.",
    )
    prices: PriceSettings = Field(
        default=PriceSettings(), description="Of energy and of time, for the objective energy."
    )
    form: Literal["auto", "arc", "route"] = Field(
        default="auto",
        description="arc: the paper's form; route: the route form; auto: arc for up to two "
        "vehicles and eight stops.",
    )
    solvers: tuple[SolverName, ...] = Field(
        default=("exact", "lc-qaoa"),
        min_length=1,
        description="Solvers that run in parallel; the best answer is taken. Fleets of "
        "many blocks use city.solvers instead.",
    )
    city: CitySettings = Field(default=CitySettings(), description="The route form.")
    gamma: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Penalty weight of the QUBO, kWh; None: computed per instance.",
    )
    lc_qaoa: LcQaoaSettings = Field(default=LcQaoaSettings(), description="The solver lc-qaoa.")
    qaoa: QaoaSettings = Field(default=QaoaSettings(), description="The solver qaoa.")
    hardware: HardwareSettings = Field(
        default=HardwareSettings(), description="A quantum device beside the solvers."
    )
    feeds: FeedSettings = Field(
        default=FeedSettings(), description="The feeds for road authorities."
    )
    cluster: ClusterSettings = Field(
        default=ClusterSettings(), description="Other machines that solve."
    )
    seed: int = Field(default=1, ge=0, lt=2**32, description="Seed of everything random.")

    @property
    def priced_advice(self) -> DrivingAdvice:
        """`advice`; where it has no price of time of its own, at that of driving time."""
        if "value_of_time_kw" in self.advice.model_fields_set:
            return self.advice
        price_kw = self.prices.price_of_time_kw
        return self.advice.model_copy(update={"value_of_time_kw": price_kw})

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
        if self.hardware.backend and HARDWARE_SOLVER not in asked:
            raise ValueError(
                f"hardware.backend runs circuits of {HARDWARE_SOLVER}: add it to solvers"
            )
        return self
