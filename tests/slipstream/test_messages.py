"""The wire format."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from slipstream.errors import InputError
from slipstream.messages import (
    ALL_STATES,
    CycleReport,
    Estimate,
    SegmentState,
    Unserved,
    decode,
    plan_key,
    state_key,
)
from tests.slipstream.sent import a_report, a_state


def feature(**fields: object) -> dict[str, object]:
    """A state's features, one of them changed."""
    features = json.loads(a_state().to_bytes())["features"]
    return {"features": features | {"mean_speed_mps": fields}}


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
        ({"sequence": 2**70}, "sequence"),
        ({"surprise": 1}, "surprise"),
        ({"reason": "because"}, "reason"),
        ({"y_e": True}, "y_e"),
        ({"rsu": ""}, "rsu"),
        ({"vehicles": 2.0}, "vehicles"),
        ({"features": {}}, "features: .*mean_speed_mps"),
        (feature(value=None), "features.mean_speed_mps.value"),
        (feature(value=1.0, standard_error=-1.0), "features.mean_speed_mps.standard_error"),
        (feature(value=1.0, surplus=0), "features.mean_speed_mps: .*surplus"),
    ],
)
def test_what_is_not_a_state_is_refused_with_its_key(changes: dict[str, object], key: str) -> None:
    """The error line names the sender's key and the field."""
    payload = json.dumps(json.loads(a_state().to_bytes()) | changes).encode()
    with pytest.raises(InputError, match=key) as caught:
        decode(SegmentState, payload, "slipstream/v1/rsu/r/segment/s/state")
    assert "\n" not in str(caught.value)
    assert "rsu/r/segment/s" in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"coverage": 1.5},
        {"rsu": ""},
        {"sequence": -1},
        {"features": replace(a_state().features, mean_speed_mps=Estimate(value=float("nan")))},
    ],
)
def test_what_would_be_refused_is_not_sent(changes: dict[str, object]) -> None:
    """The sender has the error, and its receivers nothing to refuse."""
    with pytest.raises(ValueError, match=next(iter(changes))):
        replace(a_state(), **changes).to_bytes()


@given(st.binary(max_size=200))
def test_noise_is_refused_and_never_crashes(payload: bytes) -> None:
    """No bytes raise anything but InputError."""
    with pytest.raises(InputError):
        decode(SegmentState, payload, "k")


def test_unknown_needs_a_reason_and_a_flag_needs_features() -> None:
    """Neither a bare null nor a flag without data can be said; but for one that is kept."""
    empty = {"features": None, "vehicles": 0}
    for changes in (
        {"y_e": None},
        {"reason": "too_few_vehicles"},
        {"features": None},
        {"y_e": 0, **empty},
    ):
        payload = json.dumps(json.loads(a_state().to_bytes()) | changes).encode()
        with pytest.raises(InputError):
            decode(SegmentState, payload, "k")
    assert a_state(y_e=None, reason="too_few_vehicles", features=None).y_e is None
    assert a_state(y_e=1, **empty).y_e == 1


def test_foreign_names_cannot_break_out_of_their_key_chunk() -> None:
    """Characters that mean something to zenoh are encoded."""
    assert state_key("a/b", "-12#1*") == "slipstream/v1/rsu/a%2Fb/segment/-12%231%2A/state"
    assert plan_key("van a") == "slipstream/v1/fleet/van%20a/plan"
    assert ALL_STATES.count("*") == 2


def test_unserved_stops_survive_the_wire() -> None:
    """A report keeps the stops left out, their reasons and their order."""
    report = a_report(
        Unserved(stop="Käse & co", reason="no vehicle has room for it"),
        Unserved(stop="a", reason="no road leads there"),
    )
    assert decode(CycleReport, report.to_bytes(), "k") == report


@pytest.mark.parametrize(
    ("unserved", "key"),
    [
        ([{"stop": "", "reason": "r"}], "unserved.0.stop"),
        ([{"stop": "a"}], "unserved.0.reason"),
        (None, "unserved"),
    ],
)
def test_unserved_stops_need_name_and_reason(unserved: object, key: str) -> None:
    """A stop without a name or a reason, and a null list, are refused by their key."""
    fields = a_report().model_dump(mode="json") | {"unserved": unserved}
    with pytest.raises(InputError, match=key):
        decode(CycleReport, json.dumps(fields).encode(), "k")
