"""The wire format."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.errors import InputError
from slipstream.messages import (
    ALL_STATES,
    Estimate,
    KinematicFeatures,
    SegmentState,
    decode,
    plan_key,
    state_key,
)


def a_state(**changes: object) -> SegmentState:
    """A valid state, with changes."""
    fields: dict[str, object] = {
        "rsu": "r",
        "segment": "s",
        "sequence": 1,
        "time_ns": 1,
        "window_s": 10.0,
        "features": KinematicFeatures(
            mean_speed_mps=Estimate(value=16.5, standard_error=0.1),
            mean_acceleration_mps2=Estimate(value=0.0),
            density_veh_per_m=Estimate(value=0.05),
            speed_std_mps=Estimate(value=0.2),
            acceleration_variance_m2ps4=Estimate(value=0.01),
        ),
        "y_e": 1,
        "reason": None,
        "vehicles": 9,
        "frames": 300,
        "coverage": 1.0,
    }
    return SegmentState.model_validate(fields | changes)


def test_a_state_survives_the_wire() -> None:
    """Encoding and decoding gives the same message."""
    state = a_state()
    assert decode(SegmentState, state.to_bytes(), "k") == state


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"y_e": 2}, "y_e"),
        ({"coverage": 1.5}, "coverage"),
        ({"time_ns": "1"}, "time_ns"),
        ({"window_s": None}, "window_s"),
        ({"surprise": 1}, "surprise"),
        ({"reason": "because"}, "reason"),
    ],
)
def test_what_is_not_a_state_is_refused_with_its_key(changes: dict[str, object], key: str) -> None:
    """The error line names the sender's key and the field."""
    payload = json.dumps(a_state().model_dump(mode="json") | changes).encode()
    with pytest.raises(InputError, match=key) as caught:
        decode(SegmentState, payload, "slipstream/v1/rsu/r/segment/s/state")
    assert "\n" not in str(caught.value)
    assert "rsu/r/segment/s" in str(caught.value)


@given(st.binary(max_size=200))
def test_noise_is_refused_and_never_crashes(payload: bytes) -> None:
    """No bytes raise anything but InputError."""
    with pytest.raises(InputError):
        decode(SegmentState, payload, "k")


def test_unknown_needs_a_reason_and_a_flag_needs_features() -> None:
    """Neither a bare null nor a flag without data can be said."""
    for changes in ({"y_e": None}, {"reason": "too_few_vehicles"}, {"features": None}):
        payload = json.dumps(a_state().model_dump(mode="json") | changes).encode()
        with pytest.raises(InputError):
            decode(SegmentState, payload, "k")
    assert a_state(y_e=None, reason="too_few_vehicles", features=None).y_e is None


def test_foreign_names_cannot_break_out_of_their_key_chunk() -> None:
    """Characters that mean something to zenoh are encoded."""
    assert state_key("a/b", "-12#1*") == "slipstream/v1/rsu/a%2Fb/segment/-12%231%2A/state"
    assert plan_key("van a") == "slipstream/v1/fleet/van%20a/plan"
    assert ALL_STATES.count("*") == 2
