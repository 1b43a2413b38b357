"""What docs/page.md promises, as types that answers are held against."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, get_type_hints

from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict

STRICT = ConfigDict(extra="forbid", strict=True)
Ms = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Level = Literal["ok", "warn", "bad", "idle"]


@with_config(STRICT)
class VehicleRow(TypedDict):
    x: Number | None
    y: Number | None
    heading: int | None
    source: Literal["reported", "last", "planned"] | None
    state: Literal["driving", "stopped", "waiting", "depot", "idle", "expired", "planned", "silent"]
    text: str
    seen: Ms | None
    road: str | None
    platoon: str | None
    place: int | None
    with_: Annotated[list[str], Field(alias="with")]
    next: str | None
    eta: Ms | None
    delay_s: Number | None
    stops_left: int
    level: Level
    route: list[Annotated[list[int], Field(min_length=2, max_length=2)]]
    at: int | None
    colour: Annotated[int, Field(ge=0, le=11)]
    carrier: str | None
    kwh: Number
    saved_kwh: Number | None
    km: Number
    platoon_km: Number
    charge_kwh: Number | None
    cycle: int


@with_config(STRICT)
class RoadRow(TypedDict):
    flag: Literal["stable", "turbulent", "unknown"]
    why: str | None
    kmh: int | None
    cv: Number | None
    vehicles: int | None
    gate: Literal["open", "closed"] | None
    gate_why: str | None
    rsu: str | None
    stopped: int
    since: Ms | None
    level: Level


@with_config(STRICT)
class RsuRow(TypedDict):
    x: Number | None
    y: Number | None
    status: str
    level: Level
    why: str | None
    fps: int | None
    latency_ms: int | None
    skipped_share: Number | None
    faults: list[str] | None
    segments: list[str]
    vehicles: int | None
    seen: Ms | None
    picture: bool


@with_config(STRICT)
class OrderRow(TypedDict):
    state: Literal["open", "planned", "under_way", "served", "failed", "cancelled"]
    level: Level
    node: str
    x: Number | None
    y: Number | None
    vehicle: str | None
    eta: Ms | None
    earliest: Ms | None
    latest: Ms | None
    late_s: int | None
    late_since: Ms | None
    silent_since: Ms | None
    pinned: str | None
    source: Literal["file", "api"]
    why: str | None
    since: Ms


@with_config(STRICT)
class CycleRow(TypedDict):
    t: Ms
    status: str
    level: Level
    why: str | None
    wall_s: Number
    plans: int
    solver: str | None
    variables: int
    saved_kwh: Number | None
    saved_share: Number | None
    platoon_km: Number | None
    unserved: int


@with_config(STRICT)
class AlarmRow(TypedDict):
    severity: Literal["critical", "warning", "info"]
    since: Ms
    subject: str
    text: str
    mend: str | None
    ended: Ms | None
    by: str | None
    acknowledged: Ms | None


@with_config(STRICT)
class StatusItem(TypedDict):
    subject: str
    level: Level
    text: str
    since: Ms | None


@with_config(STRICT)
class Status(TypedDict):
    level: Level
    text: str
    count: int
    items: list[StatusItem]


@with_config(STRICT)
class EnergySum(TypedDict):
    baseline: str | None
    baseline_kwh: Number
    plan_kwh: Number
    saved_kwh: Number
    saved_share: Number
    distance_kwh: Number
    drag_kwh: Number
    acceleration_kwh: Number
    km: Number | None
    platoon_km: Number
    co2_kg: Number
    money: Number


@with_config(STRICT)
class Energy(TypedDict):
    today: EnergySum | None
    week: EnergySum | None
    total: EnergySum | None
    since: Ms | None
    last_cycle: EnergySum | None


@with_config(STRICT)
class Moment(TypedDict):
    t: Ms
    seq: int
    live: bool
    vehicles: dict[str, VehicleRow]
    roads: dict[str, RoadRow]
    rsus: dict[str, RsuRow]
    orders: dict[str, OrderRow]
    cycles: dict[str, CycleRow]
    alarms: dict[str, AlarmRow]
    status: Status
    energy: Energy
    next_cycle: Ms | None
    paused: bool
    dispatcher_heard: bool


@with_config(STRICT)
class Delta(TypedDict):
    t: Ms
    seq: int
    set: dict[str, dict[str, dict[str, Any]]]
    del_: Annotated[dict[str, list[str]], Field(alias="del")]
    status: NotRequired[Status]
    energy: NotRequired[Energy]
    next_cycle: NotRequired[Ms | None]
    paused: NotRequired[bool]
    dispatcher_heard: NotRequired[bool]


@with_config(STRICT)
class PlanStop(TypedDict):
    id: str
    node: str
    x: Number | None
    y: Number | None
    arrival: Ms
    departure: Ms
    earliest: Ms | None
    latest: Ms | None
    state: str
    wait_s: int
    is_hub: bool
    charged_kwh: Number


@with_config(STRICT)
class PlanSegment(TypedDict):
    road: str
    entry: Ms
    exit: Ms
    kmh: int
    platoon: str | None
    place: int | None
    gap_m: Number | None


@with_config(STRICT)
class PlanCard(TypedDict):
    cycle: int
    issued: Ms
    depart: Ms
    valid_until: Ms
    energy_kwh: Number
    alone_kwh: Number | None
    stops: list[PlanStop]
    segments: list[PlanSegment]


@with_config(STRICT)
class PlanHistory(TypedDict):
    cycle: int
    issued: Ms
    status: str
    reason: str | None


class VehicleCard(VehicleRow):
    id: str
    plan: PlanCard | None
    why_route: list[str]
    why_platoon: list[str]
    history: list[PlanHistory]


@with_config(STRICT)
class Feature(TypedDict):
    name: str
    value: Number
    unit: str
    standard_error: Number | None
    threshold: Number | None
    crossed: bool


@with_config(STRICT)
class Hour(TypedDict):
    t: list[Ms]
    kmh: list[Number | None]
    kmh_low: list[Number | None]
    kmh_high: list[Number | None]
    acceleration: list[Number | None]
    acceleration_low: list[Number | None]
    acceleration_high: list[Number | None]
    density: list[Number | None]
    density_low: list[Number | None]
    density_high: list[Number | None]
    headway: list[Number | None]
    headway_low: list[Number | None]
    headway_high: list[Number | None]
    cv: list[Number | None]
    cv_low: list[Number | None]
    cv_high: list[Number | None]
    variance: list[Number | None]
    variance_low: list[Number | None]
    variance_high: list[Number | None]
    flag: list[Literal["stable", "turbulent", "unknown"]]


@with_config(STRICT)
class Refused(TypedDict):
    cycle: int
    t: Ms
    vehicles: list[str]
    why: str


@with_config(STRICT)
class Stopped(TypedDict):
    lane: int
    along_m: int
    since: Ms


@with_config(STRICT)
class Measured(TypedDict):
    value: Number
    standard_error: Number | None


@with_config(STRICT)
class Flow(TypedDict):
    kind: Literal["all", "car", "truck", "bus", "motorcycle"]
    vehicles: int
    vph: Number
    standard_error: Number | None


@with_config(STRICT)
class Counts(TypedDict):
    begin: Ms
    end: Ms
    complete: bool
    watched_share: Number
    why: str | None
    flows: list[Flow]
    kmh: Measured | None
    v85_kmh: Measured | None


@with_config(STRICT)
class RoadFacts(TypedDict):
    id: str
    name: str | None
    length_m: Number | None
    limit_kmh: int | None
    p_stable: Number | None
    features: list[Feature]
    hour: Hour
    counts: Counts | None
    refused: list[Refused]


class RoadCard(RoadRow, RoadFacts):
    """Of a watched road; others have no row."""

    stopped: list[Stopped]  # in place of their number


@with_config(STRICT)
class Reception(TypedDict):
    received: int
    missed: int
    duplicates: int
    out_of_order: int
    delay_s: Number | None


@with_config(STRICT)
class RsuCalibration(TypedDict):
    file: str
    written: Ms
    points: int
    residual_px: Number
    speed_error: Number | None


class RsuCard(RsuRow):
    id: str
    source: str | None
    started: Ms | None
    frames: int | None
    repeated: int | None
    decode_errors: int | None
    reconnects: int | None
    rss_mb: Number | None
    reception: Reception | None
    calibration: RsuCalibration | None


@with_config(STRICT)
class OrderStep(TypedDict):
    t: Ms
    state: str
    reason: str
    vehicle: str | None
    cycle: int | None


class OrderCard(OrderRow):
    id: str
    history: list[OrderStep]
    demand: int | None
    mass_kg: Number | None
    service_s: Number | None
    skills: list[str]


@with_config(STRICT)
class UnservedStop(TypedDict):
    stop: str
    reason: str


@with_config(STRICT)
class VehicleWords(TypedDict):
    id: str
    lines: list[str]


@with_config(STRICT)
class CycleWords(TypedDict):
    summary: list[str]
    vehicles: list[VehicleWords]
    orders: list[VehicleWords]
    refused: list[str]
    notes: list[str]


class CycleCard(CycleRow):
    n: int
    solvers: list[dict[str, Any]]
    unserved: list[UnservedStop]  # in place of their number
    energy: EnergySum | None
    explain: CycleWords | None


@with_config(STRICT)
class Config(TypedDict):
    version: str
    title: str
    control: bool
    scene_url: str | None
    units: Literal["metric", "imperial"]
    time_zone: str | None
    co2_kg_per_kwh: Number
    price_per_kwh: Number
    currency: str
    live: bool
    history: bool


@with_config(STRICT)
class Origin(TypedDict):
    lat: Number
    lon: Number


@with_config(STRICT)
class Road(TypedDict):
    id: str
    name: str | None
    shape: list[Number]
    length_m: Number
    limit_kmh: int
    lanes: int


@with_config(STRICT)
class Depot(TypedDict):
    id: str
    x: Number
    y: Number


@with_config(STRICT)
class Network(TypedDict):
    id: str
    bounds: Annotated[list[Number], Field(min_length=4, max_length=4)]
    left_hand: bool
    origin: Origin | None
    roads: list[Road]
    depots: list[Depot]


SHAPES: dict[str, Any] = {
    shape.__name__: shape
    for shape in (
        *(Config, Network, Road, Depot, Origin, Moment, Delta, VehicleRow, RoadRow, RsuRow),
        *(OrderRow, CycleRow, AlarmRow, Status, StatusItem, Energy, EnergySum),
        *(VehicleCard, PlanCard, PlanStop, PlanSegment, PlanHistory, RoadCard, Feature, Hour),
        *(
            Counts,
            Flow,
            Measured,
            Refused,
            Stopped,
            RsuCard,
            Reception,
            RsuCalibration,
            OrderCard,
            OrderStep,
            CycleCard,
            CycleWords,
            VehicleWords,
            UnservedStop,
        ),
    )
}
"""All shapes by their names in docs/page.md."""


def names(shape: Any) -> list[str]:
    """Fields of a shape as they are in JSON."""
    return [name.rstrip("_") for name in get_type_hints(shape)]
