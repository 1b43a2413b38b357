"""States are read quickly as they are read wholly: nothing else is admitted, refused or shown."""

from __future__ import annotations

import json

import pytest

from dashboard import states
from dashboard.states import StateReader
from slipstream.admission import LIMITS, refusal
from slipstream.errors import InputError
from slipstream.messages import SegmentState, state_key

RSU, ROAD = "rsu-1", "avenue_east"
KEY = state_key(RSU, ROAD)


@pytest.fixture
def reader(world):
    """That has heard of one sender."""
    rsus = {RSU: (ROAD,)}
    reader = StateReader(world.network, lambda state: refusal(state, world.network, rsus))
    reader.read(KEY, world.state(ROAD, rsu=RSU).to_bytes())
    return reader


def _forms():
    """Payloads by name, as changes of a sound one."""
    yield "sound", {}
    for name, values in {
        "rsu": ("rsu-2", "", 3, None),
        "segment": ("avenue_west", "nowhere", None),
        "sequence": (-1, 2**63, "1", 1.0, True),
        "time_ns": (0, -1, 2**63, 1.5, None),
        "window_s": (0, 3600, 3600.1, "10", 10),
        "features": (None, {}, []),
        "y_e": (0, 1, None, 2, True, "1"),
        "reason": ("uncertain", "no reason", 1),
        "vehicles": (0, 10_000, 10_001, 2.0, -1),
        "frames": (0, 1, 2**63),
        "coverage": (0, 1, 1.01, "NaN"),
        "surplus": (1,),
    }.items():
        yield from ((f"{name}={value!r}", {name: value}) for value in values)
    yield "unknown", {"y_e": None, "reason": "uncertain"}
    yield "empty", {"y_e": None, "reason": "too_few_vehicles", "features": None, "vehicles": 0}


def _feature_forms():
    for name, (low, high) in LIMITS.items():
        for value in (low, high, low - 1e-6, high + 1e-6, 1, "1", None, True):
            yield f"{name}={value!r}", name, {"value": value}
        for error in (0, 1e4, 1.1e4, -1e-9, None, "0"):
            yield f"{name} error={error!r}", name, {"value": 1.0, "standard_error": error}
        yield f"{name} with more", name, {"value": 1.0, "surplus": 0}
        yield f"{name} missing", name, None
    yield "faster than its road allows", "mean_speed_mps", {"value": 60.0}


def _wholly(world, payload):
    whole = StateReader(None, lambda state: refusal(state, world.network, {RSU: (ROAD,)}))
    return _outcome(whole, payload)


def _outcome(reader, payload):
    try:
        state = reader.read(KEY, payload)
    except InputError as error:
        return str(error)
    assert (state.rsu, state.segment, state.time_ns) == (
        state.message.rsu,
        state.message.segment,
        state.message.time_ns,
    )
    assert (state.y_e, state.reason, state.vehicles) == (
        state.message.y_e,
        state.message.reason,
        state.message.vehicles,
    )
    assert state.features == state.message.features
    return state.message, state.measured


@pytest.mark.parametrize(
    ("name", "changes"), [pytest.param(*form, id=form[0]) for form in _forms()]
)
def test_fields_are_checked_as_those_of_the_message(world, reader, name, changes):
    """Whatever a field holds, the outcome is that of the whole message."""
    told = json.loads(world.state(ROAD, rsu=RSU).to_bytes()) | changes
    payload = json.dumps(told).encode()
    assert _outcome(reader, payload) == _wholly(world, payload)


@pytest.mark.parametrize(
    ("name", "feature", "value"), [pytest.param(*form, id=form[0]) for form in _feature_forms()]
)
def test_features_are_checked_as_those_of_the_message(world, reader, name, feature, value):
    """Likewise of each feature, with the limits of admission."""
    told = json.loads(world.state(ROAD, rsu=RSU).to_bytes())
    if value is None:
        del told["features"][feature]
    else:
        told["features"][feature] = value
    payload = json.dumps(told).encode()
    assert _outcome(reader, payload) == _wholly(world, payload)


@pytest.mark.parametrize("payload", [b"", b"{}", b"null", b"[]", b"\xff", b'{"rsu":"rsu-1"'])
def test_what_is_no_state_is_refused(world, reader, payload):
    """With the line that the message's own reader gives."""
    assert _outcome(reader, payload) == _wholly(world, payload)


def test_a_sound_state_is_read_quickly(world, reader, monkeypatch):
    """The second one of a key is not read as a whole message."""

    def whole(*_):
        raise AssertionError("read wholly")

    monkeypatch.setattr(states, "decode", whole)
    state: SegmentState = world.state(ROAD, rsu=RSU, speed_mps=14.0)
    assert reader.read(KEY, state.to_bytes()).measured[0] == 14.0
