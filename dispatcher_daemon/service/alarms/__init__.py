"""Alarms: what is wrong now by plain rules, kept from begin to end, told, stored, acknowledged."""

from dispatcher_daemon.service.alarms.conditions import (
    CHECKS,
    KINDS,
    AlarmKind,
    Condition,
    unmet,
)
from dispatcher_daemon.service.alarms.fleet import fleet_conditions, fleet_lost
from dispatcher_daemon.service.alarms.roadside import RoadsideWatch
from dispatcher_daemon.service.alarms.service import ServiceFacts, service_conditions
from dispatcher_daemon.service.alarms.watch import AlarmWatch

__all__ = [
    "CHECKS",
    "KINDS",
    "AlarmKind",
    "AlarmWatch",
    "Condition",
    "RoadsideWatch",
    "ServiceFacts",
    "fleet_conditions",
    "fleet_lost",
    "service_conditions",
    "unmet",
]
