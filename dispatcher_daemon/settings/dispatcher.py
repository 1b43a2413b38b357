"""All settings of the dispatcher, and its short sections."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from dispatcher_daemon.settings.city import CitySettings
from dispatcher_daemon.settings.cluster import ClusterSettings
from dispatcher_daemon.settings.effort import EFFORTS, Effort, with_effort
from dispatcher_daemon.settings.hardware import HardwareSettings
from dispatcher_daemon.settings.solvers import (
    HARDWARE_SOLVER,
    LcQaoaSettings,
    QaoaSettings,
    SolverName,
)
from slipstream.config import BusSettings, ServiceSettings, Settings, TunedSettings
from slipstream.freshness import STALE_AFTER_S
from slipstream.messages import DrivingAdvice
from slipstream.prices import PriceSettings
from slipstream.roads.admission import Rsus
from slipstream.spacing import ADVISED_GAP_M


class AdviceSettings(TunedSettings):
    """Advice in plans for signals, turns and stops (``[advice]``)."""

    eco_approach: bool = Field(
        default=True, description="Time the approach to signals by what their RSU broadcasts."
    )
    coasting_budget: float = Field(
        default=0.06,
        ge=0,
        le=0.5,
        allow_inf_nan=False,
        description="Share of a leg's planned time that coasting to turns and stops may add; 0: no "
        "coasting.",
    )
    signal_priority: bool = Field(
        default=False,
        description="Ask signals for green. Needs the city: its signals answer requests where it "
        "grants them.",
    )
    departure_window_s: float = Field(default=0.0, ge=0, le=600, allow_inf_nan=False)
    """A leg driven alone may begin so much later than planned, at the second that suits the signals
    best at the price of driving time, s. Nine are tried, 4 s apart.
    """


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
    bundle_s: float = Field(
        default=300.0,
        ge=0,
        le=3600,
        allow_inf_nan=False,
        description="An order that no vehicle has waits for others until the next multiple of this "
        "time, s, but for a quarter of the time to its window's end at most; 0: not at all. It "
        "joins a tour that has not begun before.",
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


Scope = Literal["read", "orders", "control", "vehicles"]
"""What a caller of the API may do."""


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


class DispatcherSettings(TunedSettings):
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
        description="Size of the database, MB (10^6 bytes), above which the oldest cycles are "
        "deleted: SQLite's file with its log and reserve, PostgreSQL's rows without deleted ones.",
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
    sync_window_s: float = Field(default=3.0, ge=0, allow_inf_nan=False)
    """Maximum time between two vehicles' entries to a segment at which they can platoon there,
    s.
    """
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
    stops_at_signals: float = Field(default=0.0, ge=0, le=100, allow_inf_nan=False)
    """Expected number of full stops in a passage of a segment that ends at traffic lights, which no
    camera measures.
    """
    gap_m: float = Field(
        default=ADVISED_GAP_M,
        gt=0,
        allow_inf_nan=False,
        description="Gap advised to followers, m; they keep a larger one where their brakes need "
        "it.",
    )
    advice: AdviceSettings = Field(
        default=AdviceSettings(), description="Advice in plans for signals, turns and stops."
    )
    objective: Literal["energy", "paper"] = "energy"
    """What a route costs. energy: its drive with all changes of speed, expected stops and
    turbulence, and the price of its time; paper: its segments at planning speed, as in the paper.
    """
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
        "many blocks ask city.solvers for each of them, and these for one a cycle.",
    )
    effort: Effort = Field(
        default="normal",
        description="How much work search and circuits do; in any case the deadline ends it.",
    )
    city: CitySettings = Field(default=CitySettings(), description="The route form.")
    gamma: float | None = None
    """Penalty weight of the QUBO, kWh; None: computed per instance."""
    lc_qaoa: LcQaoaSettings = Field(default=LcQaoaSettings(), description="The solver lc-qaoa.")
    qaoa: QaoaSettings = QaoaSettings()
    """The solver qaoa."""
    hardware: HardwareSettings = Field(
        default=HardwareSettings(), description="A quantum device beside the solvers."
    )
    feeds: FeedSettings = Field(
        default=FeedSettings(), description="The feeds for road authorities."
    )
    cluster: ClusterSettings = Field(
        default=ClusterSettings(), description="Other machines that solve."
    )
    seed: int = Field(default=1, ge=0, lt=2**32)
    """Seed of everything random."""

    @property
    def priced_advice(self) -> DrivingAdvice:
        """`advice` for plans, with the price of driving time."""
        price_kw = self.prices.price_of_time_kw
        return DrivingAdvice(**self.advice.model_dump(), value_of_time_kw=price_kw)

    @model_validator(mode="after")
    def _has_effort(self) -> Self:
        for name, values in EFFORTS[self.effort].items():
            # The model is frozen, and this is a part of its making.
            self.__dict__[name] = with_effort(getattr(self, name), values)
        return self

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
