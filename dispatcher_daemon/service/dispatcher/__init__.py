"""The dispatcher between bus, cycles and database: states in, cycles run, plans out once stored."""

from dispatcher_daemon.service.dispatcher.control import Control, ControlRefused
from dispatcher_daemon.service.dispatcher.delivery import PlanDelivery
from dispatcher_daemon.service.dispatcher.dispatcher import Dispatcher
from dispatcher_daemon.service.dispatcher.publishing import Announce, MessageBus, announce_nothing
from dispatcher_daemon.service.dispatcher.runner import CycleOutcome, CycleRunner, Surroundings
from dispatcher_daemon.service.dispatcher.watching import AlarmSource
from dispatcher_daemon.service.fleet_watch import FleetWatch

__all__ = [
    "AlarmSource",
    "Announce",
    "Control",
    "ControlRefused",
    "CycleOutcome",
    "CycleRunner",
    "Dispatcher",
    "FleetWatch",
    "MessageBus",
    "PlanDelivery",
    "Surroundings",
    "announce_nothing",
]
