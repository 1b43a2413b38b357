"""docs/wire.md names every message, its key, and the fields that have a counterpart elsewhere."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

import pytest

from slipstream import messages
from slipstream.messages import (
    ENCODING,
    ROOT,
    SCHEMA,
    Message,
    MovementEvent,
    MovementState,
    PlannedCrossing,
    PlatoonControl,
    PlatoonManagement,
    RequestStatus,
    SignalPhaseAndTiming,
    SignalRequest,
    SignalStatus,
    VehiclePosition,
)

PAGE = (Path(__file__).parents[2] / "docs" / "wire.md").read_text()

KEYS = {
    messages.acknowledgement_key("{vehicle}"),
    messages.advice_key("{vehicle}"),
    messages.driver_key("{vehicle}"),
    messages.order_key("{order}", "{action}"),
    messages.plan_key("{vehicle}"),
    messages.platoon_control_key("{segment}", "{vehicle}"),
    messages.platoon_management_key("{partner}", "{vehicle}"),
    messages.position_key("{vehicle}"),
    messages.preview_key("{rsu}"),
    messages.bare_preview_key("{rsu}"),
    messages.progress_key("{vehicle}"),
    messages.rsu_health_key("{rsu}"),
    messages.sensing_key("{vehicle}"),
    messages.signal_request_key("{intersection}", "{vehicle}"),
    messages.signal_status_key("{intersection}"),
    messages.spat_key("{intersection}"),
    messages.state_key("{rsu}", "{segment}"),
    messages.stopped_key("{rsu}", "{segment}"),
    messages.counts_key("{rsu}", "{segment}"),
    messages.running_counts_key("{rsu}", "{segment}"),
    messages.ALARMS_KEY,
    messages.CYCLE_KEY,
    messages.DISPATCHER_HEALTH_KEY,
}


def test_the_schema_version_is_the_one_that_is_sent() -> None:
    """The page names it and its encoding."""
    assert f"`{SCHEMA}`" in PAGE
    assert f"`{ENCODING}`" in PAGE


@pytest.mark.parametrize("key", sorted(KEYS))
def test_each_key_has_a_row(key: str) -> None:
    """As it is written before names are put in."""
    assert f"`{unquote(key.removeprefix(f'{ROOT}/'))}`" in PAGE


def test_no_key_is_missing_above() -> None:
    """Each function that makes one key is tried."""
    made = [name for name in vars(messages) if name.endswith(("_key", "_KEY"))]
    assert len(made) - 1 == len(KEYS)  # segment_states_key is an expression for many


@pytest.mark.parametrize(
    "model",
    [
        SignalPhaseAndTiming,
        MovementState,
        MovementEvent,
        SignalRequest,
        SignalStatus,
        RequestStatus,
        PlannedCrossing,
        PlatoonControl,
        PlatoonManagement,
        VehiclePosition,
    ],
)
def test_each_field_with_a_counterpart_is_named(model: type[Message]) -> None:
    """A new field has to be put into the table, or to be named as ours."""
    missing = [
        name
        for name in model.model_fields
        if f"`{name}`" not in PAGE and f"`{model.__name__}.{name}`" not in PAGE
    ]
    assert not missing
