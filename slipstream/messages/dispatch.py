"""What the dispatcher tells of its cycles and of itself."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from slipstream.messages.base import ROOT, Count, Finite, Identifier, Model, NonNegative, TimeNs

OrderState = Literal["open", "planned", "under_way", "served", "failed", "cancelled"]
"""Of an order's life; see `slipstream.orders`."""


class SolverReport(Model):
    """What one solver did in one cycle; its objective is re-evaluated, never taken over."""

    solver: Identifier
    status: Literal["optimal", "feasible", "infeasible", "timeout", "failed"]
    objective_kwh: Finite | None = Field(description="H_cost − H_platoon of the plan it led to.")
    repaired: bool = Field(description="True if post-processing was needed to get a valid plan.")
    p_feasible_raw: Annotated[float, Field(ge=0, le=1)] | None = None
    p_optimal_raw: Annotated[float, Field(ge=0, le=1)] | None = None
    p_feasible_repaired: Annotated[float, Field(ge=0, le=1)] | None = None
    qubits: Count | None = None
    shots: Count | None = None
    wall_s: NonNegative
    reason: str | None = None
    backend: str | None = Field(default=None, description="Where its quantum circuit ran.")
    backend_kind: Literal["simulated", "noise-model", "hardware"] | None = None
    fallback: str | None = Field(
        default=None, description="Why it is not the device that was asked for."
    )
    two_qubit_depth: Count | None = None


class Gate(Model):
    """Why platooning was open or closed on one watched segment in one cycle."""

    segment: Identifier
    y_e: Literal[0, 1] | None = Field(description="Flag that it was judged by; None: unknown.")
    reason: str | None = Field(description="Code of why it is closed.")
    age_s: NonNegative | None
    speed_mps: NonNegative | None
    open: bool


class EnergySummary(Model):
    """Physical energy of a plan set against the named baseline, and where the saving comes from.

    Driving times are in s, the price that the objective puts on an hour in kWh. Energies are below
    0 where vehicles on their way give back more by braking than they need for what is left.
    """

    baseline: str
    baseline_kwh: Finite
    cooperative_kwh: Finite
    saved_distance_kwh: Finite
    saved_drag_kwh: Finite
    saved_acceleration_kwh: Finite
    platooned_distance_m: NonNegative
    baseline_driving_s: NonNegative | None = None
    cooperative_driving_s: NonNegative | None = None
    price_of_time_kw: NonNegative | None = None

    @property
    def saved_kwh(self) -> float:
        """Less than the baseline's; below 0 where the plan needs more."""
        return self.baseline_kwh - self.cooperative_kwh


class CarrierSummary(Model):
    """What one of several carriers has from a plan set against its own part of the baseline."""

    carrier: Identifier | None = Field(description="Null: vehicles that are given none.")
    baseline_kwh: Finite = Field(description="Physical energy in the baseline.")
    cooperative_kwh: Finite = Field(description="Physical energy by the plans.")
    saved_cost_kwh: Finite = Field(
        description="Energy, time and waiting at their prices, less than alone; below 0 only by "
        "rounding."
    )


class Unserved(Model):
    """A stop that no vehicle visits in this cycle's plans, and why, in words for people."""

    stop: Identifier
    reason: str


class CycleReport(Model):
    """One dispatch cycle as the dashboard and the supervisor see it."""

    cycle: Count
    started_ns: TimeNs
    wall_s: NonNegative
    status: Literal["ok", "baseline", "failed"]
    reason: str | None
    solver: Identifier | None
    objective_kwh: Finite | None
    variables: Count
    solvers: tuple[SolverReport, ...]
    gates: tuple[Gate, ...]
    energy: EnergySummary | None
    plans: Count = Field(description="Plans stored and published.")
    unserved: tuple[Unserved, ...] = Field(default=(), description="Stops that no plan visits.")
    carriers: tuple[CarrierSummary, ...] = Field(
        default=(), description="Where the vehicles are of several."
    )


class HardwareHealth(Model):
    """How the dispatcher stands with its quantum device."""

    backend: str
    pending: Count = Field(description="Jobs that the service has, or may have.")
    used_s: NonNegative = Field(description="Device time charged or reserved in the last day.")
    budget_s: NonNegative
    breaker: Literal["closed", "open", "half-open"]
    line: str | None = Field(description="Why no job would be submitted now; null: one would.")


class RsuReception(Model):
    """How the states of one RSU have arrived since the dispatcher first heard it."""

    rsu: Identifier
    received: Count
    missed: Count = Field(
        description="Sequence numbers that have not come, or whose state a later one superseded "
        "before it was handled."
    )
    duplicates: Count
    out_of_order: Count
    delay_s: Finite | None = Field(
        description="Median of arrival less the state's time, of its latest states; below 0: its "
        "clock is ahead. Null: none was in order."
    )
    delay_spread_s: NonNegative | None = Field(description="Interquartile range of the same.")


class SilentVehicle(Model):
    """A vehicle that has been heard before, and is not now."""

    vehicle: Identifier
    heard_ns: TimeNs = Field(description="When its last message came.")
    segment: Identifier | None = Field(
        description="Of its last position, however old; null: it never sent one."
    )
    share: Annotated[float, Field(ge=0, le=1)] | None = Field(
        description="Of that segment that lay behind it."
    )
    orders: Count = Field(description="That it has by its plan, or has left with.")


class DispatcherHealth(Model):
    """How the dispatcher is doing; counters run from its start."""

    time_ns: TimeNs
    started_ns: TimeNs
    cycles: Count
    cycles_failed: Count
    states_received: Count
    bad_messages: Count
    states_refused: Count = Field(default=0, description="States that were read and not admitted.")
    messages_lost: Count = Field(
        default=0,
        description="Messages too large, too many to handle, or of another version.",
    )
    stops: Count = Field(
        default=0,
        description="Times that the dispatcher itself stood still for seconds.",
    )
    states_missed_here: Count = Field(
        default=0,
        description="States missed because of that, which no RSU is blamed for.",
    )
    rsus: Annotated[tuple[RsuReception, ...], Field(max_length=20)] = Field(
        default=(),
        description="Those with the most states missed, then with the clock furthest off.",
    )
    next_cycle_ns: TimeNs | None
    rss_mb: NonNegative
    hardware: HardwareHealth | None = Field(default=None, description="Null without a device.")
    stale_after_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        default=None,
        description="Age above which its gates ignore a SegmentState, s.",
    )
    future_tolerance_s: NonNegative | None = Field(
        default=None,
        description="How far ahead of its clock a SegmentState may be dated for its gates to use "
        "it, s.",
    )
    vehicles_reporting: Count = Field(
        default=0, description="Vehicles that have ever sent a position, answer or visit."
    )
    vehicles_silent: Count = Field(default=0, description="Those of them that do not now.")
    silent: Annotated[tuple[SilentVehicle, ...], Field(max_length=200)] = Field(
        default=(), description="Those, with most orders first."
    )
    unheard: Annotated[tuple[Identifier, ...], Field(max_length=200)] = Field(
        default=(),
        description="Vehicles that have orders by a plan and have never sent anything: nobody "
        "knows whether they drive.",
    )
    orders: dict[OrderState, Count] = Field(
        default_factory=dict, description="Number of orders by state."
    )
    database_set_aside: str | None = Field(
        default=None,
        description="File that a damaged database became when this dispatcher started.",
    )
    paused: bool = Field(
        default=False,
        description="Somebody has paused it: no cycle runs and no order is put into plans.",
    )
    solver_fault: str | None = Field(
        default=None,
        description="Why it has no solver that works, or no search for routes.",
    )


CYCLE_KEY: Final = f"{ROOT}/dispatcher/cycle"
DISPATCHER_HEALTH_KEY: Final = f"{ROOT}/dispatcher/health"
