"""How a vehicle of the fleet drives: platooning, speed advice, signal priority, departure second.

Plan, vehicle states and signal timing in; speed caps, speed factors, signal requests and a
departure second out. No dispatching, no records, no evaluation.

These modules still read and set the running simulation through libsumo: `fleet_controller` (not
exported here for that reason), `vehicle.read_state`, `advice.radar`, `advice.road`,
`platooning.road`, and in `signals` the modules `crossings`, `priority`, `priority_requests` and
`timing`. Vehicle types are `simulation.sumo`'s.
"""

from simulation.controllers.vehicle import PREFIX, SPEED_CHECKS, LegOrder, VehicleState, read_state

__all__ = ["PREFIX", "SPEED_CHECKS", "LegOrder", "VehicleState", "read_state"]
