"""The kinds of alarms, and a condition that one of them is for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from slipstream.messages import Severity


@dataclass(frozen=True)
class AlarmKind:
    """How a kind of condition is told of.

    Attributes:
        raise_after_s: how long a condition lasts before it is an alarm, s.
        end_after_s: how long it is gone before the alarm has ended, s.
        many: what several subjects are or have, where one alarm stands for many: "12 `many`".
        check: that the dispatcher does not meet, and so is not ready, while a condition of the kind
            is critical.
    """

    severity: Severity
    mend: str
    raise_after_s: float = 0.0
    end_after_s: float = 10.0
    many: str | None = None
    check: str | None = None


@dataclass(frozen=True)
class Condition:
    """Something that is wrong now.

    Attributes:
        subject: as `slipstream.messages.Alarm` has it. There is one of each kind and subject.
        awaited: the dispatcher has just started, and what is missing may be about to come: it is no
            alarm yet.
    """

    kind: str
    subject: str
    text: str
    since_ns: int | None = None
    severity: Severity | None = None
    awaited: bool = False


STARTED_S: Final = 60.0
"""By then after a start each listed RSU and the fleet have been heard, s."""
_JOURNAL: Final = "journalctl -u slipstream-dispatcher says more"

KINDS: Final[Mapping[str, AlarmKind]] = {
    "rsu_silent": AlarmKind(
        "warning", "look at its box, its network and its journal", many="RSUs are silent"
    ),
    "rsu_no_signal": AlarmKind(
        "warning", "mend the camera or its network", 5.0, many="RSUs have no picture"
    ),
    "camera_fault": AlarmKind(
        "warning", "look at the camera and its view", 5.0, many="cameras have a fault"
    ),
    "rsu_clock": AlarmKind(
        "warning", "set its clock: NTP", 10.0, many="RSUs have a clock that is off"
    ),
    "rsu_states_missed": AlarmKind(
        "warning", "look at its network and its load", many="RSUs have states that do not come"
    ),
    "vehicle_stopped": AlarmKind(
        "warning", "look at the camera; send help", 10.0, many="roads have a vehicle that stands"
    ),
    "wrong_way": AlarmKind(
        "warning",
        "look at the camera; warn the police",
        end_after_s=60.0,
        many="roads have a vehicle that drives the wrong way",
    ),
    "rsus_lost": AlarmKind(
        "critical",
        "look at their boxes, and at the network between them and here",
        5.0,
        check="rsus",
    ),
    "cycle_failed": AlarmKind(
        "critical", f"mend what it names; {_JOURNAL}", 0.0, 0.0, check="cycle"
    ),
    "cycle_overran": AlarmKind(
        "warning", "raise interval_s, or lower deadline_s or city.search.time_limit_s", 0.0, 0.0
    ),
    "baseline_only": AlarmKind(
        "warning", "look at what each solver says, or raise deadline_s", check="cycle"
    ),
    "paused": AlarmKind("warning", "resume it: POST /v1/control/resume", 0.0, 0.0),
    "bus_lost": AlarmKind("critical", "systemctl restart slipstream-router", 3.0, check="bus"),
    "database_fault": AlarmKind(
        "critical",
        f"make room, see whether its disk is read-only, or restore a backup; {_JOURNAL}",
        0.0,
        0.0,
        check="database",
    ),
    "database_set_aside": AlarmKind(
        "warning", "restore a backup, or acknowledge this if the new database shall stay"
    ),
    "clock_untrusted": AlarmKind(
        "warning",
        "set the clock; if it is right, wait, or say so: slipstream db prune --trust-clock",
        0.0,
        0.0,
    ),
    "database_nearly_full": AlarmKind(
        "info", "raise keep_mb, or lower keep_days, if older cycles shall stay", 0.0, 600.0
    ),
    "disk_nearly_full": AlarmKind("warning", "make room on the disk", 0.0, 60.0, check="database"),
    "solver_broken": AlarmKind(
        "warning", "mend what it names, or take it off the solvers", check="solvers"
    ),
    "cluster_lost": AlarmKind("warning", "restart scheduler and workers", 10.0),
    "fleet_lost": AlarmKind(
        "critical",
        "start the agents, or look at the network that vehicles send over",
        check="vehicles",
    ),
    "vehicle_silent": AlarmKind(
        "warning", "call its driver; look at its box", many="vehicles are silent"
    ),
    "vehicle_unheard": AlarmKind(
        "warning",
        "start its agent, or take it out of the fleet's file",
        many="vehicles have orders and were never heard",
    ),
    "plan_refused": AlarmKind(
        "warning",
        "ask its driver; what it says is the reason",
        0.0,
        0.0,
        "vehicles have refused their plan, or not answered it",
    ),
    "vehicle_late": AlarmKind(
        "warning", "tell the customer, or move the window", 10.0, 30.0, "vehicles are late"
    ),
    "brakes_weak": AlarmKind(
        "warning",
        "have its brakes seen to, or declare in its type what they do",
        many="vehicles brake less than declared",
    ),
    "order_late": AlarmKind(
        "warning", "call its driver; tell the customer", 10.0, 30.0, "orders are late"
    ),
    "service_disputed": AlarmKind(
        "warning",
        "ask its driver and who speaks for it; then say whether it was served: "
        "slipstream orders settle ORDER --served, or --open",
        15.0,
    ),
    "order_failed": AlarmKind(
        "warning", "tell the customer; submit it again", 0.0, 0.0, "orders have failed"
    ),
    "order_unserved": AlarmKind(
        "warning",
        "mend the order, move its window or add a vehicle",
        many="orders have no vehicle",
    ),
}

CHECKS: Final = tuple(dict.fromkeys(kind.check for kind in KINDS.values() if kind.check))


def unmet(conditions: Iterable[Condition]) -> dict[str, str]:
    """Why the dispatcher is not ready, by check: what is critical now."""
    found: dict[str, list[str]] = {}
    for one in conditions:
        kind = KINDS[one.kind]
        if kind.check and not one.awaited and (one.severity or kind.severity) == "critical":
            found.setdefault(kind.check, []).append(one.text)
    return {check: "; ".join(texts) for check, texts in found.items()}
