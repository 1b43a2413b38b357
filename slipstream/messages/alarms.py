"""What the dispatcher tells its operators of that needs them: alarms in force and lately ended."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self, get_args

from pydantic import Field, model_validator

from slipstream.messages.base import ROOT, Count, Identifier, Model, TimeNs

Severity = Literal["critical", "warning", "info"]
SEVERITIES: Final[tuple[Severity, ...]] = get_args(Severity)
"""Worst first."""

MAX_ALARMS: Final = 500


class Alarm(Model):
    """A condition that somebody should know of, from when it was noticed until it has ended."""

    id: Identifier = Field(description="Of this one occurrence; it stays over restarts.")
    severity: Severity
    kind: Identifier = Field(
        description="Code of the condition; docs/operations.md lists them. New ones may come with "
        "any version."
    )
    subject: Annotated[str, Field(min_length=1, max_length=250)] = Field(
        description="What it concerns: rsu/NAME, vehicle/NAME, order/NAME, road/NAME, dispatcher, "
        "database or cluster."
    )
    since_ns: TimeNs = Field(description="UTC at which the condition began, as far as is known.")
    ended_ns: TimeNs | None = Field(description="UTC of its end; null: it is in force.")
    text: str = Field(description="The condition in words, as it is now or was last.")
    mend: str | None = Field(description="What to do about it; null: nothing.")
    acknowledged_by: Identifier | None = Field(
        default=None, description="Who has acknowledged it; null: nobody."
    )
    acknowledged_ns: TimeNs | None = Field(default=None, description="UTC of that.")

    @model_validator(mode="after")
    def _acknowledged_by_somebody(self) -> Self:
        if (self.acknowledged_by is None) != (self.acknowledged_ns is None):
            raise ValueError("acknowledged_by and acknowledged_ns are given together")
        return self


class Alarms(Model):
    """The alarms in force and those that ended in the last ten minutes.

    Those in force stand before ended ones, worse before lesser, later before earlier ones.
    """

    time_ns: TimeNs
    alarms: Annotated[tuple[Alarm, ...], Field(max_length=MAX_ALARMS)]
    more: Count = Field(default=0, description="Alarms that found no place here.")


ALARMS_KEY: Final = f"{ROOT}/dispatcher/alarms"
