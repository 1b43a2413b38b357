"""Simulated worlds, vehicle controllers in them, and the measurement of what they save.

Worlds: `streetdrive` (rendered clips), `sumo` (running SUMO), `sumo_view` (clips of SUMO traffic),
`scenarios` (whole days of a city and a corridor). Vehicles: `controllers`. Closed loop:
`closed_loop` (dispatcher, RSUs and fleet in SUMO), `live` (the same in real time with the real
daemons), `exogenous` (the fleet on recorded traffic). Measurement: `evaluation`. `training` trains
the detector on rendered scenes.
"""
