"""Messages on the bus: one pydantic model each, JSON in UTF-8, and the key expressions.

All models refuse unknown fields and wrong types, so that a message that is not what its key
promises is noticed where it arrives. Times are UTC in
nanoseconds since 1970; units are in names.
"""

from slipstream.messages.alarms import (
    ALARMS_KEY,
    MAX_ALARMS,
    SEVERITIES,
    Alarm,
    Alarms,
    Severity,
)
from slipstream.messages.base import (
    ENCODING,
    ROOT,
    SCHEMA,
    Count,
    Identifier,
    Message,
    Model,
    NonNegative,
    TimeNs,
    check_version,
    decode,
)
from slipstream.messages.dispatch import (
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    CarrierSummary,
    CycleReport,
    DispatcherHealth,
    EnergySummary,
    Gate,
    HardwareHealth,
    OrderState,
    RsuReception,
    SilentVehicle,
    SolverReport,
    Unserved,
)
from slipstream.messages.fleet import (
    ALL_ACKNOWLEDGEMENTS,
    ALL_POSITIONS,
    ALL_PROGRESS,
    PlanAcknowledgement,
    VehiclePosition,
    VehicleProgress,
    Visit,
    acknowledgement_key,
    position_key,
    progress_key,
)
from slipstream.messages.orders import (
    ALL_ORDERS,
    OrderHistory,
    OrderReceipt,
    OrderRefusal,
    OrderRequest,
    OrderStatus,
    OrderStep,
    Reason,
    RefusalKind,
    order_key,
)
from slipstream.messages.pictures import capture_time_ns, with_capture_time
from slipstream.messages.plans import (
    ALL_PLANS,
    DrivingAdvice,
    PlannedCrossing,
    PlannedSegment,
    PlannedStop,
    VehiclePlan,
    plan_key,
)
from slipstream.messages.platoons import (
    PlatoonControl,
    PlatoonManagement,
    PlatoonMode,
    platoon_control_key,
    platoon_controls_on,
    platoon_management_key,
    platoon_managements_to,
)
from slipstream.messages.roadside import (
    ALL_COUNTS,
    ALL_PREVIEWS,
    ALL_RSU_HEALTH,
    ALL_RUNNING_COUNTS,
    ALL_STATES,
    ALL_STOPPED,
    CAMERA_FAULTS,
    MIN_WATCHED_S,
    QUARTER_HOUR_S,
    CameraCalibration,
    CameraFault,
    ClassCount,
    CountedClass,
    Estimate,
    KinematicFeatures,
    RsuHealth,
    SegmentCounts,
    SegmentState,
    StabilityLimits,
    StoppedVehicle,
    StoppedVehicles,
    UnknownReason,
    UnwatchedReason,
    bare_preview_key,
    counts_key,
    preview_key,
    rsu_health_key,
    running_counts_key,
    segment_states_key,
    state_key,
    stopped_key,
)
from slipstream.messages.signals import (
    ALL_SIGNAL_REQUESTS,
    ALL_SPAT,
    MAY_GO,
    MovementEvent,
    MovementState,
    PhaseState,
    RequestStatus,
    SignalPhaseAndTiming,
    SignalRequest,
    SignalStatus,
    signal_request_key,
    signal_status_key,
    spat_key,
)
from slipstream.messages.vehicle import (
    AdviceMode,
    DriverReport,
    SensedVehicle,
    VehicleAdvice,
    VehicleSensing,
    advice_key,
    driver_key,
    sensing_key,
)
