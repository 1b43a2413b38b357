"""SegmentStates as the page takes them in: checked whole, kept as far as they are shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Final, Literal, NamedTuple, NotRequired

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict

from slipstream import admission
from slipstream.errors import InputError
from slipstream.messages import KinematicFeatures, SegmentState, UnknownReason, decode, state_key
from slipstream.messages.base import Finite, NonNegative
from slipstream.roads import RoadNetwork

MAX_KEYS: Final = 20_000
"""Keys whose sender is remembered."""


class HeardState:
    """A SegmentState; what is not shown of each road is read from its bytes where it is asked for.

    Attributes:
        rsu: as of the message; so are `segment`, `time_ns`, `y_e`, `reason` and `vehicles`.
        measured: mean and standard deviation of speed, m/s, and variance of acceleration, m²/s⁴;
            None: it has no features.
    """

    __slots__ = ("_payload", "measured", "reason", "rsu", "segment", "time_ns", "vehicles", "y_e")

    def __init__(
        self,
        payload: bytes,
        rsu: str,
        segment: str,
        time_ns: int,
        y_e: Literal[0, 1] | None,
        reason: UnknownReason | None,
        vehicles: int,
        measured: tuple[float, float, float] | None,
    ) -> None:
        self._payload = payload
        self.rsu, self.segment, self.time_ns = rsu, segment, time_ns
        self.y_e, self.reason, self.vehicles = y_e, reason, vehicles
        self.measured = measured

    @classmethod
    def of(cls, state: SegmentState, payload: bytes) -> HeardState:
        """A state that was read whole."""
        found = state.features
        return cls(
            payload,
            state.rsu,
            state.segment,
            state.time_ns,
            state.y_e,
            state.reason,
            state.vehicles,
            None
            if found is None
            else (
                found.mean_speed_mps.value,
                found.speed_std_mps.value,
                found.acceleration_variance_m2ps4.value,
            ),
        )

    @property
    def message(self) -> SegmentState:
        """The whole message, read anew."""
        return decode(SegmentState, self._payload, state_key(self.rsu, self.segment))

    @property
    def features(self) -> KinematicFeatures | None:
        """All features, read anew."""
        return None if self.measured is None else self.message.features


State = SegmentState | HeardState


class _Known(NamedTuple):
    rsu: str
    segment: str
    max_speed_mps: float


class StateReader:
    """Reads states that are admitted.

    The first one of a key is read as any message. Those that follow are checked by one compiled
    validator with the limits of admission in it, which makes no objects of what is not shown; what
    it does not take is read as the first one was, so that nothing else is admitted or refused.

    Args:
        network: roads; None: each state is read as the first one.
        refusal: why a state is not admitted by `slipstream.admission.refusal`; None: it is.
    """

    def __init__(
        self,
        network: RoadNetwork | None,
        refusal: Callable[[SegmentState], admission.Refusal | None],
    ) -> None:
        self._network, self._refusal = network, refusal
        self._known: dict[str, _Known] = {}

    def read(self, key: str, payload: bytes) -> HeardState:
        """Read one state.

        Raises:
            InputError: the payload is no SegmentState, belongs under another key, or is not
                admitted.
        """
        known = self._known.get(key)
        return (known and self._quickly(known, payload)) or self._wholly(key, payload)

    def _quickly(self, known: _Known, payload: bytes) -> HeardState | None:
        """A state of a known sender; None: look at it more closely."""
        try:
            told = _VALIDATOR.validate_json(payload)
        except ValidationError:
            return None
        rsu, segment, max_speed_mps = known
        features, y_e, reason = told["features"], told["y_e"], told["reason"]
        speed_mps = features["mean_speed_mps"]["value"]
        if (
            told["rsu"] != rsu
            or told["segment"] != segment
            or (y_e is None) == (reason is None)
            or speed_mps > max_speed_mps
        ):
            return None
        measured = (
            speed_mps,
            features["speed_std_mps"]["value"],
            features["acceleration_variance_m2ps4"]["value"],
        )
        return HeardState(
            payload, rsu, segment, told["time_ns"], y_e, reason, told["vehicles"], measured
        )

    def _wholly(self, key: str, payload: bytes) -> HeardState:
        state = decode(SegmentState, payload, key)
        expected = state_key(state.rsu, state.segment)
        if key != expected:
            raise InputError(key, f"its message belongs under {expected}", "check the sender")
        if (refused := self._refusal(state)) is not None:
            raise InputError(key, f"state refused: {refused.text}", "check the sender")
        segment = None if self._network is None else self._network.segments.get(state.segment)
        if key not in self._known and segment is not None and len(self._known) < MAX_KEYS:
            max_speed_mps = admission.max_mean_speed_mps(segment)
            self._known[key] = _Known(state.rsu, state.segment, max_speed_mps)
        return HeardState.of(state, payload)


def _validator() -> Any:
    """Of states with features, by the fields of the message and the limits of admission."""
    config = ConfigDict(extra="forbid", strict=True)
    typed_dict: Any = TypedDict

    def typed(name: str, fields: dict[str, Any]) -> Any:
        return with_config(config)(typed_dict(name, fields))

    features: dict[str, Any] = {}
    for name, field in KinematicFeatures.model_fields.items():
        low, high = admission.LIMITS[name]
        error = Annotated[NonNegative, Field(le=admission.MAX_STANDARD_ERROR)]
        estimate = typed(
            name,
            {
                "value": Annotated[Finite, Field(ge=low, le=high)],
                "standard_error": NotRequired[error | None],
            },
        )
        features[name] = estimate if field.is_required() else NotRequired[estimate | None]
    limits = {
        "features": typed("features", features),
        "window_s": Annotated[float, Field(gt=0, le=admission.MAX_WINDOW_S)],
        "vehicles": Annotated[int, Field(ge=0, le=admission.MAX_VEHICLES)],
        "frames": Annotated[int, Field(gt=0, lt=2**63)],
    }
    fields: dict[str, Any] = {
        name: Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
        for name, field in SegmentState.model_fields.items()
    }
    return TypeAdapter(typed("state", fields | limits)).validator


_VALIDATOR: Final = _validator()
