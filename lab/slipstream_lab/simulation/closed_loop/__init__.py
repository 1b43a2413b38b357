"""The closed loop: the fleet drives in SUMO as the dispatcher plans, gated by what the RSUs see.

`arm` runs one arm in a subprocess, `dispatching` its cycles, `tours` the fleet's day, `world` the
fleet's vehicles in SUMO, and `record` is what an arm leaves.
"""
