"""An instance as the cycle that a dispatcher would run on it, in either form."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Final

from dispatcher_daemon.planning.arc_form import ArcForm, arc_form, arc_form_obstacle
from dispatcher_daemon.planning.cycle import cycle_of
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.route_form import RouteForm, route_form
from dispatcher_daemon.planning.routes import servable_part
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.errors import InputError
from slipstream_lab.research.instances.instance import Instance

DEFAULT_SETTINGS: Final = DispatcherSettings()


def instance_cycle(
    instance: Instance, seed: int, settings: DispatcherSettings = DEFAULT_SETTINGS
) -> Cycle:
    """Cycle 0 in the instance's traffic; times count from its start, no deadline holds."""
    settings = settings.model_copy(update={"sync_window_s": instance.sync_window_s})
    return cycle_of(instance.problem, instance.snapshot, settings, seed=seed, reference_delay_s=0.0)


def arc_form_of(
    instance: Instance, seed: int = 1, settings: DispatcherSettings = DEFAULT_SETTINGS
) -> ArcForm:
    """The arc form of an instance; stops that no vehicle can serve are left out. Raises
    InputError: the arc form cannot express the fleet, or no stop can be served.
    """
    cycle = instance_cycle(instance, seed, settings)
    routing, unserved = servable_part(cycle.problem, cycle.snapshot)
    if routing is None:
        raise _no_servable_stop(instance, unserved)
    obstacle = arc_form_obstacle(routing.fleet)
    if obstacle is not None:
        raise InputError(instance.name, f"not for the arc form: {obstacle}", "take --form route")
    return arc_form(replace(cycle, problem=routing), unserved)


def route_form_of(
    instance: Instance, seed: int = 1, settings: DispatcherSettings = DEFAULT_SETTINGS
) -> RouteForm:
    """The route form of an instance: all its vehicles as one block. Raises InputError: no stop can
    be served.
    """
    with ThreadPoolExecutor(max_workers=1) as executor:
        form = route_form(instance_cycle(instance, seed, settings), executor)
    if not form.problem.choices:
        raise _no_servable_stop(instance, form.unserved)
    return form


def _no_servable_stop(instance: Instance, missing: Mapping[str, str]) -> InputError:
    why = "; ".join(f"{stop}: {reason}" for stop, reason in list(missing.items())[:3])
    return InputError(
        instance.name,
        f"no stop can be served ({why})",
        "mend the fleet or the network",
        key="fleet.stops",
    )
