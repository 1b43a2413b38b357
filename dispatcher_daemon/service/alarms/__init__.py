"""Alarms: what is wrong now by plain rules, kept from begin to end, told, stored, acknowledged."""

from dispatcher_daemon.service.alarms.conditions import KINDS, AlarmKind, Condition
from dispatcher_daemon.service.alarms.fleet import fleet_conditions
from dispatcher_daemon.service.alarms.roadside import RoadsideWatch
from dispatcher_daemon.service.alarms.service import ServiceFacts, service_conditions
from dispatcher_daemon.service.alarms.watch import AlarmWatch

__all__ = [
    "KINDS",
    "AlarmKind",
    "AlarmWatch",
    "Condition",
    "RoadsideWatch",
    "ServiceFacts",
    "fleet_conditions",
    "service_conditions",
]
